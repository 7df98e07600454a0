"""The reference of a route's figures, from the table of columns itself: `make reference`.

`python -m tests.column_reference` puts it between the marks in outputs/README.md.
"""

from __future__ import annotations

from pipeline.findings.names import COLUMNS
from tests.command_reference import between
from tests.conftest import ROOT

PAGE = ROOT / "outputs" / "README.md"
BEGIN, END = "<!-- columns: make reference -->\n", "<!-- end of columns -->"
# Kinds of files that have a route's figures -> the heading of their column.
_FILES = {"csv": "`metrics.csv`", "layer": "layer, GeoJSON", "json": "`--json`", "night": "night"}
# Kinds of files without the optional columns that no row has a value for.
_SPARING = {"csv", "layer"}
_ALWAYS = "always"
_OPTIONAL = "with a value"


def text() -> str:
    """Each figure as a row of Markdown: its title with unit, its meaning, and where it stands."""
    head = ["column", "title", "meaning", *_FILES.values()]
    rows = [head, ["---"] * len(head)]
    for name, column in COLUMNS.items():
        if column.files:
            there = [
                (_OPTIONAL if column.optional and kind in _SPARING else _ALWAYS)
                if kind in column.files
                else ""
                for kind in _FILES
            ]
            rows.append([f"`{name}`", column.alias, column.meaning, *there])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows) + "\n"


def with_columns(page: str) -> str:
    """Return the page with today's table between its marks."""
    return between(page, BEGIN, text(), END)


if __name__ == "__main__":
    PAGE.write_text(with_columns(PAGE.read_text("utf-8")), encoding="utf-8")
