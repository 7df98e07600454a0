"""`report.html` of the experiments, one file that works offline, and the CSV files beside it."""

from __future__ import annotations

import base64
import itertools
import json
from pathlib import Path

import jinja2

from experiments.figures.all_figures import drawings
from experiments.report.verdicts import verdicts
from experiments.tables.summary import Cell, Row, Table
from experiments.tables.tables import Findings
from pipeline.errors import StageError
from pipeline.formats.appearance import COLOURS, DARK
from pipeline.machine.files import replacing

REPORT = "report.html"
_DPI = 110
_TEXTS = {
    "environment", "scene", "case", "planner", "origin", "form", "order", "ours_is", "figure",
}  # fmt: skip
# Columns that a group of rows shares: they stand in a line above it.
_SHARED = ("environment", "case", "scene")
_HEADINGS = {
    "fuel_sd": "± sd",
    "fuel_best": "best seed",
    "clearance_m": "clearance, m",
    "fuel_per_distance": "F/D",
    "length_m": "length, m",
    "class_kept": "class kept",
    "beside_ours_percent": "beside ours, %",
    "ours_is": "ours is",
    "full_collisions": "collisions, all turns",
    "full_trials": "trials, all turns",
    "from_its_rows": "from its own rows",
}
# Digits behind the point.
_DIGITS = {
    "fuel": 2, "fuel_sd": 2, "fuel_best": 2, "clearance_m": 2, "fuel_per_distance": 3,
    "length_m": 1, "states": 0, "seconds": 2, "beside_ours_percent": 3, "printed": 2,
    "from_its_rows": 3,
}  # fmt: skip


def write_report(found: Findings, directory: Path) -> Path:
    """Write report, tables and figures to a folder, which is replaced as a whole.

    Raises
    ------
    StageError
        The disk refuses.
    """
    written: list[str] = []
    try:
        with replacing(directory, lambda: written) as folder:
            files = [table.write_csv(folder) for table in found.tables]
            pictures = []
            for drawing in drawings(found):
                path = folder / f"{drawing.name}.png"
                drawing.figure.savefig(
                    path, dpi=_DPI, bbox_inches="tight", metadata={"Software": None}
                )
                files.append(path)
                encoded = base64.b64encode(path.read_bytes()).decode("ascii")
                pictures.append((encoded, drawing.caption))
            (folder / REPORT).write_text(_page(found, pictures), encoding="utf-8")
            facts = json.dumps(found.facts, ensure_ascii=False, indent=2)
            (folder / "facts.json").write_text(facts + "\n", encoding="utf-8")
            written += [*(path.name for path in files), REPORT, "facts.json"]
    except OSError as error:
        raise StageError(
            f"experiments: cannot write to {directory}: {error.strerror or error}; free some "
            "space, or choose another folder with --output"
        ) from error
    return directory / REPORT


def _page(found: Findings, pictures: list[tuple[str, str]]) -> str:
    """Fill the template."""
    loader = jinja2.PackageLoader("experiments.report", "templates")
    environment = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    return environment.get_template("experiments.html.jinja").render(
        tables=found.tables,
        environments=found.environments,
        drawings=pictures,
        facts=found.facts,
        verdicts=verdicts(found.tables),
        texts=_TEXTS,
        headings=_HEADINGS,
        cell=_cell,
        groups=_groups,
        row_class=_row_class,
        light=COLOURS,
        dark=DARK,
    )


def _cell(value: Cell, column: str) -> str:
    """Spell a figure with the digits of its column."""
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:,.{_DIGITS.get(column, 2)}f}".replace(",", "\u202f")
    return str(value)


def _groups(table: Table) -> tuple[list[str], list[tuple[str, list[Row]]]]:
    """Columns of a table, and its rows by what they share, each group with its heading."""
    if "case" not in table.columns:
        return list(table.columns), [("", list(table.rows))]
    groups = [
        (_heading(shared), list(rows))
        for shared, rows in itertools.groupby(
            table.rows, key=lambda row: tuple(row.get(name) for name in _SHARED)
        )
    ]
    return [column for column in table.columns if column not in _SHARED], groups


def _heading(shared: tuple[Cell, ...]) -> str:
    """What stands above the rows of a case."""
    environment, case, scene = shared
    return f"{environment}, {case}" + (f" (scene: {scene})" if scene else "")


def _row_class(row: Row, rows: list[Row]) -> str:
    """How a row is shown: published, or ours among others."""
    if row.get("origin") == "published":
        return "published"
    computed = {other.get("planner") for other in rows if other.get("origin") == "computed"}
    is_ours = str(row.get("planner", "")).startswith("RENEW")
    return "ours" if is_ours and len(computed) > 1 else ""
