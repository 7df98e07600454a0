"""The columns of all files by one table, `columns.toml`: what each means, and where it stands."""

import tomllib
from collections.abc import Iterable, Mapping
from importlib.resources import files
from typing import Any, NamedTuple

from pipeline.model import RouteMetrics


class Column(NamedTuple):
    """A column: its name for readers with the unit in brackets, its meaning, and its type.

    Attributes
    ----------
    type : "number", "whole", "text", "flag" or "time".
    attribute : of RouteMetrics, if the column is one of a route's figures.
    files : in which files that figure stands: "csv", "layer", "json" and "night".
    optional : whether it is left out where no row has a value.
    """

    alias: str
    meaning: str
    type: str = "number"
    attribute: str = ""
    files: tuple[str, ...] = ()
    optional: bool = False


COLUMNS = {
    name: Column(**{"attribute": name, **fields})
    for name, fields in tomllib.loads(
        files("pipeline.findings").joinpath("columns.toml").read_text(encoding="utf-8")
    ).items()
}


def figure_columns(file: str) -> tuple[str, ...]:
    """Return the columns of a route's figures in a kind of file."""
    return tuple(name for name, column in COLUMNS.items() if file in column.files)


def figures(metrics: RouteMetrics, file: str) -> dict[str, Any]:
    """Return a route's figures for a kind of file, by column."""
    return {name: getattr(metrics, COLUMNS[name].attribute) for name in figure_columns(file)}


def used(columns: Iterable[str], rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return columns without the optional ones that are empty in all rows."""
    filled = {name for row in rows for name, value in row.items() if value not in {None, ""}}
    return [name for name in columns if name in filled or not _is_optional(name)]


def _is_optional(name: str) -> bool:
    """Whether a column may be left out."""
    return name in COLUMNS and COLUMNS[name].optional
