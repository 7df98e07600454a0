"""A quick look whether start and goal are in water."""

from __future__ import annotations

from pathlib import Path

import pytest
import shapely

from pipeline.scenario.loading import load_scenario
from pipeline.scenario.model import Scenario
from pipeline.stages.region import endpoints_on_land

LonLat = tuple[float, float]

# An island of 60 km by 110 km, another beside it, and nothing else for half the world.
ISLAND, ISLET = shapely.box(30, 10, 30.55, 11), shapely.box(29.9, 10.4, 29.95, 10.5)
WATER = (29.8, 10.5)


@pytest.fixture
def chart(tmp_path: Path) -> Path:
    file = tmp_path / "islands.geojson"
    file.write_text(shapely.to_geojson(shapely.MultiPolygon([ISLAND, ISLET])))
    return file


def scenario(start: LonLat, goal: LonLat, chart: Path | None = None) -> Scenario:
    table = load_scenario("palawan-usv").model_dump(mode="json")
    if chart is not None:
        table["chart"] = {"source": {"path": str(chart), "accuracy_m": 10}}
    return Scenario.model_validate({**table, "region": None, "start": start, "goal": goal})


def test_endpoints_in_water_and_far_from_the_chart_have_no_fault(chart: Path) -> None:
    assert endpoints_on_land(scenario(WATER, (100.0, 50.0), chart)) == []
    assert endpoints_on_land(load_scenario("single-gyre")) == []


def test_both_endpoints_on_land_are_reported_with_the_nearest_water(chart: Path) -> None:
    faults = endpoints_on_land(scenario((30.01, 10.5), (30.275, 10.5), chart))
    assert [fault.split()[0] for fault in faults] == ["start", "goal"]
    assert "1.2 km from the nearest water with a way out at [29.99" in faults[0]
    assert "more than 20 km from the nearest water" in faults[1]


def test_swapped_coordinates_are_recognised_far_inland_only(chart: Path) -> None:
    near, deep = endpoints_on_land(scenario((30.01, 10.5), (30.275, 10.5), chart))
    assert "did you mean" not in near
    assert "did you mean [10.5, 30.275]? A place is [longitude, latitude]" in deep


@pytest.mark.slow
def test_land_of_the_world_is_checked_where_no_chart_is_named() -> None:
    """The sea east of Rhodes, with its latitude first, is a desert in Arabia."""
    (fault,) = endpoints_on_land(scenario((36.4, 28.9), (28.9, 36.2)))
    assert fault.startswith("start = [36.4, 28.9] lies on land, more than 20 km")
    assert "did you mean [28.9, 36.4]?" in fault


@pytest.mark.slow
def test_for_a_position_in_a_lake_the_message_says_that_the_chart_has_no_lakes(chart: Path) -> None:
    faults = endpoints_on_land(scenario((6.5, 46.45), (28.9, 36.2)))  # Lake Geneva
    assert ["without lakes and rivers" in fault for fault in faults] == [True]
    own = endpoints_on_land(scenario((30.01, 10.5), (30.275, 10.5), chart))
    assert not any("lakes" in fault for fault in own)
