"""Measure every figure that RENEW is held to and print them beside what was asked."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from tests.bench import pipeline_figures, planner_figures

if TYPE_CHECKING:
    from tests.bench.figure import Figure

SUITES = {"planner": planner_figures.figures, "pipeline": pipeline_figures.figures}


def main() -> int:
    """Print the table; exit 1 where a figure is missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument("suites", nargs="*", choices=[*SUITES, []], help="all, if none is named")
    chosen = parser.parse_args().suites or list(SUITES)
    table = Table("figure", "asked", "reached", "", title="RENEW: figures to reach")
    console = Console(width=140 if not sys.stdout.isatty() else None)
    figures: list[Figure] = []
    for name in chosen:
        for figure in SUITES[name]():
            figures.append(figure)
            console.print(f"[dim]{figure.name}: {figure.reached}[/dim]", highlight=False)
            table.add_row(figure.name, figure.asked, figure.reached, figure.verdict)
    console.print(table)
    return int(any(figure.met is False for figure in figures))


if __name__ == "__main__":
    raise SystemExit(main())
