"""Old keys are accepted with a note: renamed ones alone, removed ones without effect."""

from __future__ import annotations

from typing import Any

import pytest

from pipeline.errors import RequestError
from pipeline.loading import parse_scenario
from pipeline.scenario.catalogue import read_toml, scenario_path
from pipeline.scenario.model import Scenario
from pipeline.scenario.old_keys import REMOVED_KEYS, RENAMED_KEYS, with_current_keys
from pipeline.scenario.reference import tables

CASES = [(table, old, new) for table, names in RENAMED_KEYS.items() for old, new in names.items()]
REMOVED = [(table, key) for table, keys in REMOVED_KEYS.items() for key in keys]
VALUES: dict[str, object] = {"time": "linear", "rtz": "1.2"}


def with_keys(table: str, keys: dict[str, object]) -> dict[str, Any]:
    """Return a scenario of the catalogue with keys added to one of its tables."""
    data = read_toml(scenario_path("palawan-season"))
    place = data["seasons"][1] if table == "seasons" else data.setdefault(table, {})
    place.update(keys)
    return data


def path_of(table: str) -> str:
    """Return the table's path in messages."""
    return "seasons[1]" if table == "seasons" else table


@pytest.mark.parametrize(("table", "old", "new"), CASES)
def test_an_old_name_means_the_same_and_gives_a_note(table: str, old: str, new: str) -> None:
    notes: list[str] = []
    renamed = parse_scenario(with_keys(table, {old: VALUES[old]}), on_note=notes.append)
    assert renamed == parse_scenario(with_keys(table, {new: VALUES[old]}))
    assert renamed != parse_scenario(with_keys(table, {}))
    path = path_of(table)
    assert notes == [f"{path}.{old} is now called {path}.{new}; the old name is still accepted"]


@pytest.mark.parametrize(("table", "old", "new"), CASES)
def test_both_names_at_once_are_a_fault(table: str, old: str, new: str) -> None:
    data = with_keys(table, {old: VALUES[old], new: VALUES[old]})
    data["planner"]["clases"] = 3
    with pytest.raises(RequestError) as caught:
        parse_scenario(data)
    both, unknown = caught.value.faults
    path = path_of(table)
    assert f"{path}.{old} is the old name of {path}.{new}, and both are given" in both
    assert f"remove {path}.{old}" in both
    assert "planner.clases" in unknown


def test_a_fault_in_an_old_key_names_the_current_one() -> None:
    with pytest.raises(RequestError, match=r"outputs\.rtz_version = \"9\" is not one of"):
        parse_scenario(with_keys("outputs", {"rtz": "9"}))


@pytest.mark.parametrize(("table", "key"), REMOVED)
@pytest.mark.parametrize("value", [300, -1, "what was refused once"])
def test_a_removed_key_changes_nothing_and_gives_a_note(
    table: str, key: str, value: object
) -> None:
    notes: list[str] = []
    found = parse_scenario(with_keys(table, {key: value}), on_note=notes.append)
    assert found == parse_scenario(with_keys(table, {}))
    (note,) = notes
    assert note.startswith(f"{table}.{key} has no effect any more: ")
    assert note.endswith("; remove it")
    assert key not in {name for one in tables() for name in one.model.model_fields}


def test_the_current_names_exist_and_the_old_ones_do_not() -> None:
    fields = {table.path: table.model.model_fields.keys() for table in tables()}
    for table, old, new in CASES:
        assert new in fields[table]
        assert old not in fields[table]
    assert Scenario.model_config["extra"] == "forbid"


@pytest.mark.parametrize("value", [None, 3, "text", [1, "two"]])
def test_tables_of_another_type_are_left_to_the_model(value: object) -> None:
    data = {"chart": value, "seasons": value, "outputs": value}
    assert with_current_keys(data) == (data, [], [])
