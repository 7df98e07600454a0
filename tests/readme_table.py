"""The README's table of figures, from a run's metrics.csv: `make figures` writes both.

`python -m tests.readme_table METRICS` copies the file to docs/figures/ and puts its table between
the marks in README.md.
"""

from __future__ import annotations

import csv
import shutil
import sys
from pathlib import Path

from pipeline.findings.text import clearance, gap_figure
from tests.conftest import ROOT

METRICS = ROOT / "docs" / "figures" / "palawan-season.csv"
README = ROOT / "README.md"
BEGIN, END = "<!-- figures of docs/figures/palawan-season.csv: make figures -->\n", "<!-- end -->"
_HEAD = (
    "| season | way | fuel | length | clear of land | F/D | optimality gap "
    "| hard-over turns that met land |\n"
    "|---|---|---|---|---|---|---|---|\n"
)


def table(metrics: Path) -> str:
    """Return the routes of a run as a Markdown table; the best of each season in bold."""
    with metrics.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return _HEAD + "".join(
        f"| {row['season']} | {_way(row)} "
        f"| {float(row['fuel']):.1f} | {float(row['length_m']) / 1000:.0f} km "
        f"| {clearance(float(row['clearance_m']))} | {float(row['fuel_per_distance']):.2f} "
        f"| {gap_figure(float(row['optimality_gap']))} "
        f"| {int(row['collisions']):,} of {int(row['trials']):,} |\n"
        for row in rows
    )


def _way(row: dict[str, str]) -> str:
    """Return a route's way round, the best of its season in bold."""
    return f"**{row['way']}**" if row["rank"] == "1" else row["way"]


def with_table(text: str, new: str) -> str:
    """Return the README's text with a new table between its marks."""
    before, rest = text.split(BEGIN)
    return before + BEGIN + new + END + rest.split(END, 1)[1]


if __name__ == "__main__":
    shutil.copyfile(Path(sys.argv[1]), METRICS)
    README.write_text(with_table(README.read_text("utf-8"), table(METRICS)), encoding="utf-8")
