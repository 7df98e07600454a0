"""The output of `renew list`, the catalogue, and of `renew clean`, the space that was freed."""

import json
import re
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import typer

from pipeline.errors import RequestError
from pipeline.scenario import catalogue
from pipeline.scenario.season import Season

_DAYS = {"h": 1 / 24, "d": 1.0, "w": 7.0}
_MB = 1e6
_TIDES = "tides"
_SECTIONS = (*catalogue.SECTIONS, _TIDES)
_ACCOUNT = "a Copernicus Marine account"


@dataclass(frozen=True, slots=True)
class Entry:
    """An entry of the catalogue; only scenarios have `needs`."""

    section: str
    name: str
    title: str
    needs: str = ""


def listed() -> list[Entry]:
    """Return every entry, sorted by section and name."""
    return [
        Entry(
            section,
            name,
            str(content.get("title", "")),
            _needs(content) if section == "scenarios" else "",
        )
        for section in catalogue.SECTIONS
        for name in catalogue.names(section)
        for content in [catalogue.entry(section, name)]
    ] + [
        Entry(_TIDES, name, json.loads(path.read_text(encoding="utf-8"))["name"])
        for name, path in catalogue.stations().items()
    ]


def as_text(entries: Sequence[Entry]) -> str:
    """Return entries as text, one line each."""
    width = max(len(entry.name) for entry in entries) + 1
    lines: list[str] = []
    for section in _SECTIONS:
        lines.append(f"{section}:")
        for entry in entries:
            if entry.section == section:
                needs = f" ({entry.needs})" if entry.needs else ""
                lines.append(f"  {entry.name:<{width}}{entry.title}{needs}")
    return "\n".join(lines)


def spelled_as_json(entries: Sequence[Entry]) -> str:
    """Return entries as one JSON object with a list for each section."""
    sections = {
        section: [asdict(entry) for entry in entries if entry.section == section]
        for section in _SECTIONS
    }
    return json.dumps(sections, ensure_ascii=False)


def _needs(scenario: dict[str, Any]) -> str:
    """Say which files or account a scenario needs, or that it runs offline."""
    files = "--charts with S-57 cells" if scenario.get("chart", {}).get("source") == "s57" else ""
    seasons = [Season.model_validate(table) for table in scenario["seasons"]]
    offline = [season.name for season in seasons if _runs_offline(season)]
    if len(offline) == len(seasons):
        return f"needs {files}" if files else "runs offline"
    if not offline:
        return f"needs {' and '.join(filter(None, (files, _ACCOUNT)))}, or --currents"
    online = [season.name for season in seasons if season.name not in offline]
    return f"offline: {', '.join(offline)}; {', '.join(online)} needs {_ACCOUNT}, or --currents"


def _runs_offline(season: Season) -> bool:
    """Whether a season has a current that needs neither account nor network."""
    if not season.currents:
        return True  # a formula
    for name in season.currents:
        if not isinstance(name, str):
            continue  # the user's own files, which no scenario of the catalogue has
        source = catalogue.source(name)
        if source.adapter == "still":
            return True
        if source.adapter == "embedded-table" and source.season_for(season) is not None:
            return True
    return False


def require_consent() -> None:
    """Ask before the land cache is removed, which is the user's; RequestError without a terminal.

    Raises typer.Abort if the answer is no.
    """
    from renew._compiled import user_cache

    folder = user_cache()
    if folder is None or not any(folder.glob("*.shoreline*")):
        return
    what = (
        f"--all also removes the world's land in {folder}, which all projects of this "
        "user share; the next plan makes it again in some seconds"
    )
    if not sys.stdin.isatty():
        raise RequestError(f"{what}: add --yes, or leave out --all")
    typer.confirm(f"{what}. Remove it?", abort=True)


def freed(output: Path, *, older: str, everything: bool) -> str:
    """Prune the store of an output folder; return one line on the space that was freed.

    Raises
    ------
    RequestError
        `older` is not an age, or there is no store.
    StageError
        A run is using the folder.
    """
    from pipeline.machine.store import MAX_STORE_BYTES, seconds_ago
    from pipeline.session import clean
    from pipeline.sources.land.osm import remove_cached

    age = re.fullmatch(r"(\d{1,6})([hdw])", older)
    if age is None:
        raise RequestError(
            [f"--older = {older!r} is not an age: give hours, days or weeks, as in 12h, 30d, 2w"]
        )
    days = int(age[1]) * _DAYS[age[2]]
    freed = clean(
        output, max_bytes=0 if everything else MAX_STORE_BYTES, used_before=seconds_ago(days)
    )
    text = (
        f"Freed {freed.size / _MB:,.1f} MB ({freed.files:,} files); {freed.remaining / _MB:,.1f} "
        f"MB remain in {output / '.artefacts'}"
    )
    if everything and (land := remove_cached()):
        text += f". The world's land was removed from the user's cache, too ({land / _MB:,.1f} MB)"
    return text
