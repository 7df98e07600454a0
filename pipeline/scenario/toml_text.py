"""Scenarios as TOML: values on one line, and whole tables."""

import json
from collections.abc import Iterator
from typing import Any

from pipeline.scenario import catalogue
from pipeline.scenario.model import Scenario


def inline(value: object) -> str:
    """Spell a value as in TOML, on one line; empty entries of tables are left out."""
    if isinstance(value, dict):
        given = {key: one for key, one in value.items() if one not in (None, "")}
        return f"{{ {', '.join(f'{key} = {inline(one)}' for key, one in given.items())} }}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(inline(one) for one in value)}]"
    # As in JSON, but for the one control character that JSON leaves as it is.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def scenario_text(scenario: Scenario) -> str:
    """Spell a scenario as TOML, without what has its default; a known vessel by its name."""
    table = scenario.model_dump(mode="json", exclude_defaults=True)
    table = {"schema_version": scenario.schema_version, **table}
    name = scenario.vessel.name
    if name in catalogue.names("vessels") and catalogue.vessel(name) == scenario.vessel:
        table["vessel"] = name
    return "\n".join(_lines(table, "")) + "\n"


def _lines(table: dict[str, Any], path: str) -> Iterator[str]:
    """Yield the lines of a table: its values first, then the tables in it."""
    inner = {
        key: value for key, value in table.items() if isinstance(value, dict) or _is_list(value)
    }
    for key, value in table.items():
        if key not in inner:
            yield f"{key} = {inline(value)}"
    for key, value in inner.items():
        name = f"{path}.{key}".strip(".")
        for one in value if _is_list(value) else (value,):
            yield ""
            yield f"[[{name}]]" if _is_list(value) else f"[{name}]"
            yield from _lines(one, name)


def _is_list(value: object) -> bool:
    """Whether a value is a list of tables."""
    return isinstance(value, list) and bool(value) and all(isinstance(one, dict) for one in value)
