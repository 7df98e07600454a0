"""Generated parts of the documents: `make reference` writes them, and a test compares.

They are the reference of a scenario's keys and its JSON schema, from the models; of all commands
and their options, from the command line; of a route's figures, from the table of columns; and the
README's table, from a run's metrics.csv.
"""

import csv
import inspect
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel
from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from pipeline.cli.main import app
from pipeline.findings.names import COLUMNS
from pipeline.findings.text import clearance, gap_figure
from pipeline.scenario.loading import inline
from pipeline.scenario.model import Scenario
from pipeline.scenario.pairs import PAIRS
from pipeline.scenario.strict import limit_text, model_in
from tests.conftest import ROOT

METRICS = ROOT / "docs" / "figures" / "palawan-season.csv"
"""Figures of the README's run, which `make figures` copies."""
BEGIN, END = "<!-- figures of docs/figures/palawan-season.csv: make figures -->\n", "<!-- end -->"
"""Marks of the README's table."""
_REFERENCE = ROOT / "docs" / "reference"
_SCHEMA = "scenario.schema.json"


def pages() -> dict[Path, str]:
    """Return the text that each page must have."""
    marked = {
        ROOT / "README.md": (BEGIN, _run_table(), END),
        ROOT / "outputs" / "README.md": (
            "<!-- columns: make reference -->\n",
            _columns(),
            "<!-- end of columns -->",
        ),
        _REFERENCE / "command-line.md": (
            "<!-- commands: make reference -->\n",
            "\n".join(_section(name, command) for name, command in sorted(commands().items())),
            "<!-- end of commands -->",
        ),
    }
    texts = {page: _between(page.read_text("utf-8"), *new) for page, new in marked.items()}
    keys = [_INTRODUCTION, *map(_keys_of, tables()), _pairs()]
    return {
        **texts,
        _REFERENCE / "scenario-keys.md": "\n".join(keys),
        _REFERENCE / _SCHEMA: json.dumps(schema(), indent=2, ensure_ascii=False) + "\n",
    }


def _between(page: str, begin: str, new: str, end: str) -> str:
    """Return the page with new text between its marks `begin` and `end`."""
    before, rest = page.split(begin)
    return f"{before}{begin}{new}{end}{rest.split(end, 1)[1]}"


# --- the README's table of a run

_HEAD = (
    "| season | way | fuel | length | clear of land | F/D | optimality gap "
    "| hard-over turns that met land |\n"
    "|---|---|---|---|---|---|---|---|\n"
)


def _run_table() -> str:
    """Return the routes of the run as a Markdown table; the best of each season in bold."""
    with METRICS.open(newline="", encoding="utf-8") as file:
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


# --- figures of a route

# Kinds of files that have a route's figures -> the heading of their column.
_FILES = {"csv": "`metrics.csv`", "layer": "layer, GeoJSON", "json": "`--json`", "night": "night"}
# Kinds of files without the optional columns that no row has a value for.
_SPARING = {"csv", "layer"}
_ALWAYS = "always"
_OPTIONAL = "with a value"


def _columns() -> str:
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


# --- commands


def commands() -> dict[str, TyperCommand]:
    """Every command that does something, by what is typed: "renew nightly run"."""
    return dict(_commands("renew", typer.main.get_command(app)))


def _commands(name: str, command: object) -> Iterator[tuple[str, TyperCommand]]:
    """Yield a command, or all those in a group."""
    if isinstance(command, TyperGroup):
        for inner, one in command.commands.items():
            yield from _commands(f"{name} {inner}", one)
    elif isinstance(command, TyperCommand):
        yield name, command


def options(command: TyperCommand) -> dict[str, TyperOption]:
    """A command's options by their long names; those that are switched off have two."""
    return {
        name: one
        for one in command.params
        if isinstance(one, TyperOption) and not one.hidden
        for name in (*one.opts, *one.secondary_opts)
        if name.startswith("--")
    }


def _section(name: str, command: TyperCommand) -> str:
    """One command."""
    arguments = [str(one.metavar or one.name).upper() for one in command.params
                 if isinstance(one, TyperArgument)]  # fmt: skip
    typed = " ".join((name, *arguments))
    what = " ".join((command.help or "").split("\n\n", 1)[0].split())
    rows = [
        f"| `{option}` | {_cell(one.help or '')}{_default(one)} |"
        for option, one in options(command).items()
    ]
    table = ["", "| option | what it does |", "|---|---|", *rows] if rows else []
    return "\n".join((f"### `{typed}`", "", _cell(what), *table, ""))


def _cell(words: str) -> str:
    """Text that stays in one cell of a Markdown table."""
    return " ".join(words.split()).replace("|", "\\|").replace("<", "&lt;")


def _default(option: TyperOption) -> str:
    """An option's default, where it has one that is worth a word."""
    value = option.default
    shown = not option.is_flag and value not in (None, "", (), []) and not callable(value)
    return f" Left out, `{getattr(value, 'value', value)}`." if shown else ""


# --- keys of a scenario

# Units by the ending of a key; other units are given with the field.
_UNITS = {"_deg_s": "degrees/s", "_m_s": "m/s", "_m": "m"}
_NUMBERS = {"number": "number", "integer": "whole number"}
_RELATIONS = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
# A bar inside a cell of a Markdown table.
_BAR = "\\|"
_INTRODUCTION = f"""# Keys of a scenario

Generated by `make reference` from `pipeline/scenario/`; edit the descriptions there.

A scenario is a TOML file. `renew show palawan-season` prints one to start from, `renew go` makes
one in one line and writes it beside its results, and `renew check FILE` lists all faults of one. A
*plane* scenario has a `[plane]`, a *chart* scenario a `[region]`, or neither: then a run chooses
the region. Unknown keys are refused. A default of – means that the key may be left out, and that a
table then has its own defaults. Metres are true ones unless the unit says otherwise: *planar m* are
true metres divided by `scale`. For completion and checks in an editor, use the JSON schema
[{_SCHEMA}]({_SCHEMA}).
"""


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the scenario: its path ("" at the top), its model, and whether it is a list."""

    path: str
    model: type[BaseModel]
    is_list: bool


def tables() -> list[Table]:
    """Return all tables of a scenario, each followed by the tables inside it."""
    return list(_with_inner(Table("", Scenario, is_list=False)))


def _with_inner(table: Table) -> Iterator[Table]:
    """Yield a table and all tables inside it."""
    yield table
    for name, field in table.model.model_fields.items():
        model = model_in(field.annotation)
        if model is not None:
            path = f"{table.path}.{name}".strip(".")
            is_list = str(field.annotation).startswith("tuple[")
            yield from _with_inner(Table(path, model, is_list))


def schema() -> dict[str, Any]:
    """Return the JSON schema of a scenario."""
    dialect = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": dialect, **Scenario.model_json_schema()}


def _pairs() -> str:
    """Return the section of the features that don't go together."""
    lines = [
        "## What does not go together",
        "",
        "No feature of the first column is planned together with one of the second. Every other",
        "pair is.",
        "",
        "| feature | not with | reason | instead |",
        "|---|---|---|---|",
    ]
    for pair in PAIRS:
        row = (", ".join(pair.first), ", ".join(pair.second), pair.reason, pair.remedy)
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join([*lines, ""])


def _keys_of(table: Table) -> str:
    """Return the section of one table."""
    heading = f"## `[[{table.path}]]`" if table.is_list else f"## `[{table.path}]`"
    lines = [
        heading if table.path else "## Top level",
        "",
        " ".join(inspect.cleandoc(table.model.__doc__ or "").split()),
        "",
        "| key | type | unit | default | meaning | example |",
        "|---|---|---|---|---|---|",
    ]
    generated = table.model.model_json_schema()
    for name, field in table.model.model_fields.items():
        spelled = field.alias or name
        key = generated["properties"][spelled]
        row = (
            f"`{spelled}`",
            _type_text(key),
            _unit(name, key),
            "required" if field.is_required() else _default_text(key),
            key.get("description", ""),
            _example_text(key),
        )
        lines.append(f"| {' | '.join(cell.replace('|', _BAR) for cell in row)} |")
    return "\n".join([*lines, ""])


def _unit(name: str, key: dict[str, Any]) -> str:
    """Return a key's unit, or "" where it has none."""
    endings = (unit for ending, unit in _UNITS.items() if name.endswith(ending))
    return str(key.get("unit") or next(endings, ""))


def _type_text(key: dict[str, Any]) -> str:
    """Return the type of a key in words."""
    if "anyOf" in key:
        kinds = [_type_text(one) for one in key["anyOf"] if one.get("type") != "null"]
        text = " or ".join(dict.fromkeys(kinds))
    elif "enum" in key or "const" in key:
        text = " or ".join(_toml(value) for value in key.get("enum", [key.get("const")]))
    elif "prefixItems" in key:
        text = f"list of {len(key['prefixItems'])} numbers"
    elif "items" in key:
        items = _type_text(key["items"])
        text = "list of tables" if items == "table" else f"list of ({items})"
    elif key.get("type") in _NUMBERS:
        text = _NUMBERS[key["type"]] + _limits(key)
    elif key.get("type") == "string":
        text = "date and time" if key.get("format") == "date-time" else "text"
    else:
        text = "true or false" if key.get("type") == "boolean" else "table"
    return text


def _limits(key: dict[str, Any]) -> str:
    """Return the limits of a number, such as " > 0"."""
    limits = [
        f"{relation} {limit_text(key[limit])}"
        for limit, relation in _RELATIONS.items()
        if limit in key
    ]
    return f" {', '.join(limits)}" if limits else ""


def _default_text(key: dict[str, Any]) -> str:
    """Return a key's default; "–" where it is left out, or is a table of defaults."""
    default = key.get("default")
    return "–" if default is None or default in ("", []) or "$ref" in key else _toml(default)


def _example_text(key: dict[str, Any]) -> str:
    """Return an example of a key; "" for a table of defaults."""
    if "date and time" in _type_text(key):
        return f"`{key['examples'][0]}`"
    return "" if "$ref" in key else _toml(key.get("examples", [key.get("default")])[0])


def _toml(value: object) -> str:
    """Spell a value as in TOML, marked as code; "" for None."""
    return "" if value in (None, "", []) else f"`{inline(value)}`"


if __name__ == "__main__":
    for page, text in pages().items():
        page.write_text(text, encoding="utf-8")
