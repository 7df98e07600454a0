"""Old names of keys, which scenarios may still use."""

from __future__ import annotations

from typing import Any

# Old name -> current name, by table.
RENAMED_KEYS: dict[str, dict[str, str]] = {
    "chart": {"join_gap_m": "close_gaps_m"},
    "seasons": {"time": "time_method"},
    "outputs": {"rtz": "rtz_version"},
}


def with_current_names(data: dict[str, Any]) -> tuple[dict[str, Any], list[str], list[str]]:
    """Return a scenario's table with the current names of its keys, notes and faults.

    There is a note for each old name, and a fault for each key that is given by both names.
    """
    renamed, notes, faults = dict(data), list[str](), list[str]()
    for table, names in RENAMED_KEYS.items():
        given = data.get(table)
        if isinstance(given, dict):
            renamed[table] = _renamed(given, names, table, notes, faults)
        elif isinstance(given, list):
            renamed[table] = [
                _renamed(item, names, f"{table}[{i}]", notes, faults)
                if isinstance(item, dict)
                else item
                for i, item in enumerate(given)
            ]
    return renamed, notes, faults


def _renamed(
    table: dict[str, Any], names: dict[str, str], path: str, notes: list[str], faults: list[str]
) -> dict[str, Any]:
    """Return one table with current names; add to notes and faults."""
    for old, new in names.items():
        if old in table and new in table:
            faults.append(
                f"{path}.{old} is the old name of {path}.{new}, and both are given; remove "
                f"{path}.{old}"
            )
        elif old in table:
            notes.append(f"{path}.{old} is now called {path}.{new}; the old name is still accepted")
    return {
        names.get(key, key): value
        for key, value in table.items()
        if names.get(key) is None or names[key] not in table
    }
