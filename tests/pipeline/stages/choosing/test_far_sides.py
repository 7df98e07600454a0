"""Far sides of islands that a region leaves out: named with a bound on fuel, or planned."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import shapely

from pipeline.findings.note_words import note_text
from pipeline.model import Note
from pipeline.run import planned_scenario
from pipeline.scenario.loading import load_scenario
from pipeline.sources.current_field import Field
from pipeline.stages.choosing.region_choice import BoundedSide, FarSide, are_on_both_sides
from tests.pipeline.results import rows_of
from tests.pipeline.synthetic_currents import dataset

GEOD = pyproj.Geod(ellps="WGS84")
START, GOAL = (-30.0, 0.0), (-28.0, 0.0)
# The direct line passes close to the island's southern end; its northern end is far off it.
ISLAND = shapely.box(-29.2, 0.05, -28.8, 1.6)
# Waypoints round the northern end.
NORTH_ABOUT = [START, (-29.2, 1.6), (-28.8, 1.6), GOAL]
SPEED_M_S = 2.0


def notes_of(folder: Path, help_m_s: float) -> tuple[tuple[Note, ...], set[str]]:
    """Plan with a current along the northern way round; return notes and the routes' sides."""
    (folder / "island.geojson").write_text(json.dumps(shapely.geometry.mapping(ISLAND)))
    lon, lat = np.linspace(-33, -25, 81), np.linspace(-3, 4, 71)
    x, y = np.meshgrid(lon, lat)
    # The current runs north on the island's west, east on its north, south on its east; none south
    # of the line.
    u = np.where((y > 0.1) & (y > 1.5), help_m_s, 0.0)
    v = np.where(y > 0.1, np.where(x < -29, help_m_s, -help_m_s) * (y < 1.8), 0.0)
    dataset(Field(lon, lat, u, v)).to_netcdf(folder / "current.nc")
    (folder / "far.toml").write_text(
        f"""
schema_version = 1
name = "far"
start = {list(START)}
goal = {list(GOAL)}
[vessel]
speed_m_s = {SPEED_M_S}
length_m = 20
turn_rate_deg_s = 2
[chart]
source = {{ path = "island.geojson", accuracy_m = 50 }}
[[seasons]]
name = "july"
valid = "2024-07"
currents = ["{"current.nc" if help_m_s else "still"}"]
[planner]
classes = 2
padding = "none"
"""
    )
    scenario = load_scenario(str(folder / "far.toml"))
    with planned_scenario(scenario, folder / "outputs", offline=True) as result:
        assert max(row.fuel for row in rows_of(result)) < 1.5 * min(
            row.fuel for row in rows_of(result)
        )
        return result.choices, {row.main_side for row in rows_of(result)}


def test_a_side_left_out_is_named_with_a_bound_below_the_way_there(
    tmp_path: Path,
) -> None:
    choices, sides = notes_of(tmp_path, 0.0)
    assert sides == {""}  # one route
    [note] = [note for note in choices if note.kind == "side-left-out"]
    values: dict[str, Any] = dict(note.values)
    assert values["of"] == "fuel"
    # In still water, fuel is in proportion to length.
    longer = GEOD.line_length(*np.array(NORTH_ABOUT).T) / GEOD.inv(*START, *GOAL)[2]
    # The grid's coast is up to a cell off the true one.
    assert 1.5 < values["ratio"] < 1.01 * longer
    assert values["ratio"] > 0.93 * longer
    assert "needs at least" in note_text(note)


def test_a_side_that_a_current_makes_cheap_is_planned(tmp_path: Path) -> None:
    choices, sides = notes_of(tmp_path, 1.2)
    assert sides == {"north", "south"}
    kinds = [note.kind for note in choices]
    assert "region-widened-for-sides" in kinds
    assert "side-left-out" not in kinds
    [widened] = [note for note in choices if note.kind == "region-widened-for-sides"]
    values: dict[str, Any] = dict(widened.values)
    assert shapely.box(*values["bounds"]).contains(ISLAND)
    assert "because ways round the far side of the island at" in note_text(widened)


def test_paths_on_one_side_of_a_place_are_distinguished_from_paths_on_both() -> None:
    south = np.array([START, (-29.0, -0.2), GOAL])
    north, round_it = np.array(NORTH_ABOUT), np.array([START, (-29.2, 1.7), (-28.8, 1.7), GOAL])
    place = (-29.0, 0.8)
    assert are_on_both_sides([south, north], place)
    assert not are_on_both_sides([north, round_it], place)
    assert not are_on_both_sides([south], place)


def test_a_side_without_a_way_on_the_chart_is_named_by_its_length() -> None:
    side = FarSide(119.0, 10.0, 9e5, 3.3, (118.0, 9.0, 120.0, 11.0), (110.0, 0.0, 130.0, 20.0))
    assert "at least 3.3 times as long" in note_text(BoundedSide(side, "Palawan", math.inf).note)
