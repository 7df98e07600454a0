"""The output of `renew list`: the entries of the catalogue, and what each scenario needs."""

import json
from typing import Any

from pipeline.scenario import catalogue
from pipeline.scenario.season import Season

_ACCOUNT = "a Copernicus Marine account"


def listed() -> dict[str, list[dict[str, str]]]:
    """Return the entries of each section, sorted by name; only scenarios have `needs`."""
    sections: dict[str, list[dict[str, str]]] = {}
    for section in catalogue.SECTIONS:
        sections[section] = []
        for name in catalogue.names(section):
            content = catalogue.entry(section, name)
            needs = _needs(content) if section == "scenarios" else ""
            sections[section].append(_entry(section, name, str(content.get("title", "")), needs))
    sections["tides"] = [
        _entry("tides", name, json.loads(path.read_text(encoding="utf-8"))["name"])
        for name, path in catalogue.stations().items()
    ]
    return sections


def _entry(section: str, name: str, title: str, needs: str = "") -> dict[str, str]:
    return {"section": section, "name": name, "title": title, "needs": needs}


def as_text(sections: dict[str, list[dict[str, str]]]) -> str:
    """Return the sections as text, a line for each entry."""
    width = max(len(entry["name"]) for entries in sections.values() for entry in entries) + 1
    lines: list[str] = []
    for section, entries in sections.items():
        lines.append(f"{section}:")
        for entry in entries:
            needs = f" ({entry['needs']})" if entry["needs"] else ""
            lines.append(f"  {entry['name']:<{width}}{entry['title']}{needs}")
    return "\n".join(lines)


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
