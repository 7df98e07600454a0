"""Keys of earlier versions, which scenarios may still have: renamed ones, and removed ones."""

from __future__ import annotations

from typing import Any

# Old name -> current name, by table.
RENAMED_KEYS: dict[str, dict[str, str]] = {
    "seasons": {"time": "time_method"},
    "outputs": {"rtz": "rtz_version"},
}
_NO_GAP = "gaps are no longer closed, every strait is on the chart"
# Key -> what is done in its place, by table.
REMOVED_KEYS: dict[str, dict[str, str]] = {
    "chart": {
        "close_gaps_m": _NO_GAP,
        "join_gap_m": _NO_GAP,
        "vertex_budget": "the coast is followed within chart.tolerance_m, by as many vertices as "
        "that takes",
    },
}


def with_current_keys(data: dict[str, Any]) -> tuple[dict[str, Any], list[str], list[str]]:
    """Return a scenario's table with current keys alone, notes and faults.

    There is a note for each old key, and a fault for each key that is given by both names.
    """
    current, notes, faults = dict(data), list[str](), list[str]()
    for table in (*RENAMED_KEYS, *REMOVED_KEYS):
        given = data.get(table)
        if isinstance(given, dict):
            current[table] = _current(given, table, table, notes, faults)
        elif isinstance(given, list):
            current[table] = [
                _current(item, table, f"{table}[{i}]", notes, faults)
                if isinstance(item, dict)
                else item
                for i, item in enumerate(given)
            ]
    return current, notes, faults


def _current(
    given: dict[str, Any], table: str, path: str, notes: list[str], faults: list[str]
) -> dict[str, Any]:
    """Return one table with current keys; add to notes and faults."""
    names, removed = RENAMED_KEYS.get(table, {}), REMOVED_KEYS.get(table, {})
    for old, new in names.items():
        if old in given and new in given:
            faults.append(
                f"{path}.{old} is the old name of {path}.{new}, and both are given; remove "
                f"{path}.{old}"
            )
        elif old in given:
            notes.append(f"{path}.{old} is now called {path}.{new}; the old name is still accepted")
    notes += [
        f"{path}.{key} has no effect any more: {instead}; remove it"
        for key, instead in removed.items()
        if key in given
    ]
    return {
        names.get(key, key): value
        for key, value in given.items()
        if key not in removed and (names.get(key) is None or names[key] not in given)
    }
