"""Generated pages are up to date; a scenario's keys and JSON schema are true."""

import json
import re
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import RequestError
from pipeline.scenario import catalogue
from pipeline.scenario.loading import parse_scenario
from tests import reference
from tests.conftest import ROOT

TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "number": (int, float),
    "integer": (int,),
    "null": (type(None),),
}
LIMITS: dict[str, Callable[[Any, Any], bool]] = {
    "minimum": lambda value, limit: value >= limit,
    "exclusiveMinimum": lambda value, limit: value > limit,
    "maximum": lambda value, limit: value <= limit,
    "exclusiveMaximum": lambda value, limit: value < limit,
    "minItems": lambda value, limit: len(value) >= limit,
    "maxItems": lambda value, limit: len(value) <= limit,
    "pattern": lambda value, limit: re.search(limit, value) is not None,
    "const": lambda value, limit: value == limit,
    "enum": lambda value, limit: value in limit,
}
# Keywords that describe, or that `faults` handles by themselves.
NO_LIMITS = {
    *("$defs", "$schema", "default", "deprecated", "description", "examples", "format", "title"),
    *("unit", "type", "$ref", "anyOf", "properties", "required", "additionalProperties"),
    *("items", "prefixItems"),
}
MINIMAL: dict[str, Any] = {
    "schema_version": 1,
    "name": "minimal",
    "vessel": "paper-asv",
    "start": [10, 50],
    "goal": [90, 50],
    "plane": {"extent": [0, 0, 100, 100]},
    "seasons": [{"name": "calm", "uniform": {"u": 0.1}}],
}


def faults(value: object, rules: dict[str, Any], root: dict[str, Any]) -> list[str]:
    """Check a value by the part of JSON Schema that pydantic generates; refuse any other part."""
    kind = rules.get("type")
    if kind and (not isinstance(value, TYPES[kind]) or isinstance(value, bool)):
        return [f"{value!r} is not of type {kind}"]
    found = [fault for nested in (members, items) for fault in nested(value, rules, root)]
    if "$ref" in rules:
        found += faults(value, root["$defs"][rules["$ref"].removeprefix("#/$defs/")], root)
    if "anyOf" in rules and all(faults(value, option, root) for option in rules["anyOf"]):
        found.append(f"{value!r} fits no option")
    for keyword in rules.keys() - NO_LIMITS:
        if not LIMITS[keyword](value, rules[keyword]):
            found.append(f"{value!r} is against {keyword} {rules[keyword]!r}")
    return found


def members(value: object, rules: dict[str, Any], root: dict[str, Any]) -> list[str]:
    """Check the members of an object."""
    if not isinstance(value, dict) or "properties" not in rules:
        return []
    keys = rules["properties"]
    assert rules["additionalProperties"] is False
    return [
        *(f"unknown {key}" for key in value if key not in keys),
        *(f"missing {key}" for key in rules.get("required", ()) if key not in value),
        *(f for key, one in value.items() for f in faults(one, keys.get(key, {}), root)),
    ]


def items(value: object, rules: dict[str, Any], root: dict[str, Any]) -> list[str]:
    """Check the items of an array."""
    if not isinstance(value, list):
        return []
    by_item = rules.get("prefixItems") or [rules.get("items", {})] * len(value)
    return [f for one, rule in zip(value, by_item, strict=False) for f in faults(one, rule, root)]


def as_json(data: dict[str, Any]) -> object:
    """Return a TOML table as the JSON that an editor's validator sees."""
    return json.loads(json.dumps(data, default=datetime.isoformat))


PAGES = reference.pages()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_generated_parts_of_the_pages_are_up_to_date(page: Path) -> None:
    assert page.read_text("utf-8") == PAGES[page], "run `make reference`"


@pytest.mark.parametrize("name", catalogue.names("scenarios"))
def test_the_schema_accepts_every_scenario_of_the_catalogue(name: str) -> None:
    schema = reference.schema()
    assert faults(as_json(catalogue.entry("scenarios", name)), schema, schema) == []


@pytest.mark.parametrize(
    "change",
    [
        {"colour": 1},
        {"schema_version": 2},
        {"scale": 0},
        {"scale": "large"},
        {"name": "Capital"},
        {"start": [1]},
        {"seasons": []},
        {"seasons": [{"title": "nameless"}]},
        {"planner": {"classes": 0}},
        {"planner": {"classes": 1.5}},
        {"planner": {"risk": 1}},
        {"planner": {"method": "guess"}},
        {"planner": {"padding": -1}},
        {"chart": {"tolerance_m": -3}},
        {"chart": {"source": [{"nme": "osm-land"}]}},
        {"vessel": {"length_m": 2}},
    ],
)
def test_the_schema_refuses_what_the_models_refuse(change: dict[str, Any]) -> None:
    schema = reference.schema()
    assert faults(as_json(MINIMAL), schema, schema) == []
    assert faults(as_json(MINIMAL | change), schema, schema) != []
    assert parse_scenario(MINIMAL).name == "minimal"
    with pytest.raises(RequestError):
        parse_scenario(MINIMAL | change)


@pytest.mark.parametrize(
    "change",
    [
        {"vessel": {"length_m": 2, "speed_m_s": 1, "turn_rate_deg_s": 35}},
        {"chart": {"source": ["osm-land", {"path": "./piers.gpkg", "radius_m": 5}]}},
        {"chart": {"source": "./charts"}},
        {"seasons": [{"name": "a", "valid": "2024-07", "currents": ["x", ["a.nc", "b.nc"]]}]},
        {"planner": {"padding": 3}},
    ],
)
def test_the_schema_knows_the_short_forms(change: dict[str, Any]) -> None:
    schema = reference.schema()
    assert faults(as_json(MINIMAL | change), schema, schema) == []


def test_every_key_has_a_row_with_type_default_and_example() -> None:
    """What can be left out has a default or says "–"; examples are valid by the schema."""
    schema = reference.schema()
    text = PAGES[ROOT / "docs" / "reference" / "scenario-keys.md"]
    rows = dict(re.findall(r"^\| `(\w+)` \| (.+) \|$", text, re.MULTILINE))
    for table in reference.tables():
        assert (
            (f"## `[[{table.path}]]`" in text) or (f"## `[{table.path}]`" in text) or not table.path
        )
        generated = table.model.model_json_schema()
        for name, key in generated["properties"].items():
            assert name in rows
            for example in key.get("examples", ()):
                local = schema | {"$defs": schema["$defs"] | generated.get("$defs", {})}
                assert faults(example, key, local) == [], (table.path, name)
            has_example = "examples" in key or key.get("default") not in (None, "", [])
            is_table = "$ref" in key or "anyOf" in key or "$ref" in key.get("items", {})
            assert has_example or is_table, (table.path, name)
