"""Measure every figure that RENEW is held to and print them beside what was asked.

Name some, as in `python -m tests.bench palawan islands`, to measure these only. With `--record` the
figures that pages quote are written to docs/figures/SUITE.csv. With `--save` times are appended to
docs/figures/bench.csv and drawn, and those that are slower than before are named.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import partial

from rich.console import Console
from rich.table import Table

from tests.bench import (
    archipelago_figures,
    bound_figures,
    class_figures,
    clock_figures,
    ensemble_figures,
    haven_figures,
    history,
    nightly_figures,
    palawan_figures,
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
    "eddies": class_figures.eddies,
    "padded-eddies": class_figures.padded_eddies,
    "bounds": bound_figures.figures,
    "walls": class_figures.thin_walls,
    "order": class_figures.order,
    "classes": class_figures.each_class,
    "first-classes": class_figures.first_classes,
    "palawan": palawan_figures.figures,
    "sides": side_figures.figures,
    "islands": archipelago_figures.islands,
    "pipeline": pipeline_figures.figures,
    "havens": haven_figures.figures,
    "ensembles": ensemble_figures.figures,
    "offing": side_figures.offing,
    "waters": waters_figures.figures,
    "clock": clock_figures.figures,
    "tide": tide_figures.figures,
    "water-levels": tide_figures.water_levels,
    "windows": clock_figures.windows,
    "speeds": speed_figures.figures,
    "nightly": nightly_figures.figures,
}
# Those that measure times of what people wait for, within minutes.
TIMED = ("startup", "times", "islands", "pipeline")


def main() -> int:
    """Print the table; exit 1 where a figure is missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument("suites", nargs="*", choices=[*SUITES, []], help="all, if none is named")
    parser.add_argument("--record", action="store_true", help="write what pages quote")
    parser.add_argument(
        "--save", action="store_true", help=f"keep times; of {', '.join(TIMED)}, if none is named"
    )
    parser.add_argument("--whole", action="store_true", help="all routes and scenes of `havens`")
    arguments = parser.parse_args()
    suites = SUITES | {"havens": partial(haven_figures.figures, is_whole=arguments.whole)}
    chosen = arguments.suites or list(TIMED if arguments.save else SUITES)
    table = Table("figure", "asked", "reached", "", title="RENEW: figures to reach")
    console = Console(width=140 if not sys.stdout.isatty() else None)
    figures: list[Figure] = []
    for name in chosen:
        values: dict[str, float] = {}
        for figure in suites[name]():
            figures.append(figure)
            console.print(f"[dim]{figure.name}: {figure.reached}[/dim]", highlight=False)
            table.add_row(figure.name, figure.asked, figure.reached, figure.verdict)
            values |= figure.values
        if arguments.record and values:
            record(name, values)
    console.print(table)
    if arguments.save:
        keep(figures)
    return int(any(figure.met is False for figure in figures))


def keep(figures: Iterable[Figure]) -> None:
    """Save the times of figures, say which are slower than before, and draw all of them."""
    before, loop_s = history.saved(), history.loop_s()
    times = [
        history.now(one.name, one.seconds, loop_s) for one in figures if one.seconds is not None
    ]
    history.save(times)
    history.draw([*before, *times])
    for sentence in filter(None, (history.slower(time, before) for time in times)):
        print(sentence)


if __name__ == "__main__":
    raise SystemExit(main())
