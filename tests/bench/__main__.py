"""Measure every figure that RENEW is held to and print them beside what was asked.

Name some, as in `python -m tests.bench gyre islands`, to measure these only. With `--record` the
figures that pages quote are written to docs/figures/SUITE.csv.
"""

import argparse
import sys
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.table import Table

from tests.bench import (
    clock_figures,
    ensemble_figures,
    nightly_figures,
    pipeline_figures,
    planner_figures,
    published_figures,
    side_figures,
    speed_figures,
    tide_figures,
    waters_figures,
)
from tests.bench.figure import Figure, record

SUITES: dict[str, Callable[[], Iterator[Figure]]] = {
    "padding": planner_figures.paddings,
    "draws": published_figures.paddings,
    "gyre": planner_figures.single_gyre_fuel,
    "sampled": planner_figures.sampled_method,
    "published": published_figures.scenes,
    "triangulators": published_figures.triangulators,
    "scenes": planner_figures.random_scenes,
    "times": planner_figures.times,
    "startup": pipeline_figures.startup,
    "first-classes": planner_figures.first_classes,
    "sides": side_figures.figures,
    "islands": pipeline_figures.islands,
    "pipeline": pipeline_figures.figures,
    "ensembles": ensemble_figures.figures,
    "offing": side_figures.offing,
    "waters": waters_figures.figures,
    "clock": clock_figures.figures,
    "tide": tide_figures.figures,
    "water-levels": tide_figures.water_levels,
    "windows": clock_figures.windows,
    "speeds": speed_figures.figures,
    "nightly": nightly_figures.figures,
    "slurm": nightly_figures.slurm_job,
}


def main() -> int:
    """Print the table; exit 1 where a figure is missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument("suites", nargs="*", choices=[*SUITES, []], help="all, if none is named")
    parser.add_argument("--record", action="store_true", help="write what pages quote")
    arguments = parser.parse_args()
    table = Table("figure", "asked", "reached", "", title="RENEW: figures to reach")
    console = Console(width=140 if not sys.stdout.isatty() else None)
    figures: list[Figure] = []
    for name in arguments.suites or SUITES:
        values: dict[str, float] = {}
        for figure in SUITES[name]():
            figures.append(figure)
            console.print(f"[dim]{figure.name}: {figure.reached}[/dim]", highlight=False)
            table.add_row(figure.name, figure.asked, figure.reached, figure.verdict)
            values |= figure.values
        if arguments.record and values:
            record(name, values)
    console.print(table)
    return int(any(figure.met is False for figure in figures))


if __name__ == "__main__":
    raise SystemExit(main())
