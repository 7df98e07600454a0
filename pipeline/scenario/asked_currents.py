"""The currents that `--currents` names, in place of those of a scenario's seasons."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from pipeline.errors import RequestError
from pipeline.machine.paths import resolved
from pipeline.scenario import catalogue
from pipeline.scenario.season import Season


def asked_currents(asked: Sequence[str | Path]) -> list[str | list[str]]:
    """Return the sources that --currents names, in their order of preference.

    Names of the catalogue stay as they are; files are one source, in the place of the first.
    """
    known = catalogue.names("sources")
    found: list[str | list[str]] = []
    files: list[str] = []
    for one in map(str, asked):
        if one in known:
            found.append(one)
            continue
        if not files:
            found.append(files)
        files.append(str(resolved(one, "--currents")))
    return found


def with_currents(
    data: dict[str, Any], asked: Sequence[str | Path]
) -> tuple[dict[str, Any], list[str]]:
    """Replace the currents of a scenario's seasons by the sources that --currents names.

    Tables hold some seasons only: the others are left out, each with a note, unless that is all.
    """
    if "plane" in data:
        raise RequestError(
            ["--currents needs a scenario with a [region]; a [plane] gives its current as numbers"]
        )
    currents = asked_currents(asked)
    given = data.get("seasons")
    seasons = [
        {**season, "currents": currents} if isinstance(season, dict) else season
        for season in (given if isinstance(given, list) else [])
    ]
    held = [season for season in seasons if not _is_in_no_table(season, currents)]
    if not held:
        return {**data, "seasons": seasons}, []
    notes = [
        f"season {season['name']!r} is left out: {', '.join(map(str, currents))} has no such season"
        for season in seasons
        if season not in held
    ]
    return {**data, "seasons": held}, notes


def _is_in_no_table(season: object, currents: Sequence[str | list[str]]) -> bool:
    """Whether all sources are embedded tables, and none of them has a (valid) season."""
    tables = [catalogue.source(one) for one in currents if isinstance(one, str)]
    try:
        valid = Season.model_validate(season)
    except ValidationError:
        return False
    return len(tables) == len(currents) and all(
        isinstance(table, catalogue.EmbeddedTableSpec) and table.part(valid) is None
        for table in tables
    )
