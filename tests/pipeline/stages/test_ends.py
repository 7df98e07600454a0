"""A start or goal on land is moved to the nearest water that joins the other end."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st
from shapely import box

from pipeline.errors import RequestError
from pipeline.model import Land
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.model import Scenario
from pipeline.stages.ends import in_water
from pipeline.voyage.one_line import go
from tests.pipeline.voyage.waters import FIGURES
from tests.true_scale import GEOD

# In the middle of the Atlantic: a long island with a pond, and a mole around a basin.
ISLAND = box(-40.01, 34.98, -39.98, 35.02) - box(-39.997, 34.999, -39.995, 35.001)
BASIN = box(-40.05, 34.99, -40.04, 35.01) - box(-40.049, 34.991, -40.041, 35.009)
LAND = Land((ISLAND, BASIN), (), 50.0)


def scenario(start: tuple[float, float], goal: tuple[float, float], **more: object) -> Scenario:
    return parse_scenario(
        {
            "schema_version": 1,
            "name": "quays",
            "vessel": "usv-7m",
            "region": {"bbox": [-40.1, 34.9, -39.9, 35.1]},
            "start": list(start),
            "goal": list(goal),
            "seasons": [{"name": "still", "currents": ["still"]}],
            "planner": {"snap": 500.0},
            **more,
        }
    )


def metres_from(place: tuple[float, float], area: shapely.Geometry) -> float:
    """Distance from a place to an area, by geodesics to points 2 m apart along its edge."""
    edge = shapely.get_coordinates(shapely.segmentize(shapely.boundary(area), 2e-5))
    lon, lat = np.broadcast_to(place[0], len(edge)), np.broadcast_to(place[1], len(edge))
    return float(np.min(GEOD.inv(lon, lat, edge[:, 0], edge[:, 1])[2]))


@settings(max_examples=30, deadline=None)
@given(st.floats(-40.009, -39.981), st.floats(34.981, 35.019))
def test_a_start_on_land_begins_in_the_nearest_water_that_joins_the_goal(
    lon: float, lat: float
) -> None:
    asked = scenario((lon, lat), (-39.93, 35.0))
    moved, notes = in_water(asked, LAND)
    shore = metres_from((lon, lat), shapely.Polygon(ISLAND.exterior))
    if ISLAND.covers(shapely.Point(lon, lat)) and shore <= 440:
        ((name, value),) = [pair for note in notes for pair in note.values if pair[0] == "moved_m"]
        *_, went = GEOD.inv(lon, lat, *moved.start)
        assert (name, value) == ("moved_m", pytest.approx(went, rel=1e-4))
        # In the sea, never in the pond; as far off land as the chart is accurate.
        assert not shapely.Polygon(ISLAND.exterior).covers(shapely.Point(moved.start))
        off = metres_from(moved.start, ISLAND)
        assert 47 <= off <= 53
        assert went == pytest.approx(shore + 50, abs=4)
        assert moved.goal == asked.goal
    elif not ISLAND.covers(shapely.Point(lon, lat)) or shore > 510:
        assert (moved, notes) == (asked, ())


def test_goal_and_via_points_are_moved_too_and_nothing_without_snap() -> None:
    asked = scenario((-40.08, 35.0), (-39.982, 35.0), via=[[-40.008, 35.0]])
    moved, notes = in_water(asked, LAND)
    assert [dict(note.values)["stop"] for note in notes] == ["via[0]", "goal"]
    assert all(note.is_decision for note in notes)
    for place in (*moved.via, moved.goal):
        assert not ISLAND.covers(shapely.Point(place))
    kept = scenario((-40.08, 35.0), (-39.982, 35.0), planner={"snap": 0.0})
    assert in_water(kept, LAND) == (kept, ())


def test_a_start_beside_a_shut_basin_is_moved_outside() -> None:
    """The basin is nearer, and joins nothing."""
    moved, _ = in_water(scenario((-40.0493, 35.0), (-39.93, 35.0)), LAND)
    assert moved.start[0] < -40.05


def test_a_voyage_from_a_quay_says_so_in_every_file(tmp_path: Path) -> None:
    chart = tmp_path / "land.geojson"
    chart.write_text(shapely.to_geojson(shapely.GeometryCollection([ISLAND])))
    asked: dict[str, Any] = {
        **FIGURES, "currents": ["still"], "charts": chart, "output": tmp_path, "name": "quay"
    }  # fmt: skip
    outcome = go((-39.9815, 35.0), (-39.94, 35.0), **asked)
    said = [text for text in outcome.result.decisions if text.kind == "stop-moved"]
    assert len(said) == 1
    start = outcome.scenario.start
    path = outcome.result.water.projection.to_lonlat(outcome.result.routes[0].route.path)
    assert path[0] == pytest.approx(start, abs=1e-6)
    for name in ("report.html", "manifest.json", "quay-still.rtz", "quay-still.gpx"):
        assert "lies on land: it was moved" in (outcome.directory / name).read_text()
    with pytest.raises(RequestError, match=r"start = .* lies on land"):
        go((-39.9815, 35.0), (-39.94, 35.0), **asked, snap_m=0.0)
