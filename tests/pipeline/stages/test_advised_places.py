"""Where a stop is told to move, the voyage is planned: no advice leads into a pocket."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import shapely
from shapely import Polygon, box

from pipeline.errors import RequestError
from pipeline.run import Outcome, run
from pipeline.scenario.catalogue import read_toml, scenario_path
from pipeline.scenario.loading import parse_scenario
from pipeline.stages.region import endpoints_on_land
from tests.pipeline.stages.test_endpoint_look import scenario as on_chart

# A wall of 20 m round a pool of 40 m, in a plane of 400 m; the vessel turns in a circle of 3.3 m.
WALL = (box(60, 60, 80, 140), box(120, 60, 140, 140), box(60, 60, 140, 80), box(60, 120, 140, 140))
POOL, GOAL = (100.0, 100.0), (350.0, 300.0)


def planned(start: tuple[float, float], goal: tuple[float, float], *land: Polygon) -> Outcome:
    """Plan in the plane, in a folder of its own."""
    table = read_toml(scenario_path("single-gyre"))
    corners = [list(one.exterior.coords[:-1]) for one in land]
    table["plane"] |= {"extent": [0, 0, 400, 400], "obstacles": corners}
    table |= {"start": list(start), "goal": list(goal), "name": "advised"}
    table["planner"] |= {"classes": 1}
    return run(parse_scenario(table), Path.cwd())


def advised(error: RequestError) -> tuple[str, tuple[float, float]]:
    """Return which stop is to be moved, and where."""
    found = re.search(r"at \[([\d.]+), ([\d.]+)\]; move (the )?(\w+)", str(error))
    assert found is not None, error
    return found[4], (float(found[1]), float(found[2]))


@pytest.mark.parametrize("in_pool", ["start", "goal"])
def test_a_stop_in_a_pool_is_moved_out_of_it(
    in_pool: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ends = (POOL, GOAL) if in_pool == "start" else (GOAL, POOL)
    with pytest.raises(RequestError, match="lies in another body of water") as refused:
        planned(*ends, *WALL)
    moved, place = advised(refused.value)
    assert moved == in_pool
    assert shapely.union_all(WALL).envelope.distance(shapely.Point(place)) > 0
    moved_ends = (place, GOAL) if in_pool == "start" else (GOAL, place)
    assert planned(*moved_ends, *WALL).exit_code == 0


def test_a_stop_on_land_is_not_moved_into_a_pinched_pocket(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    # A gap of 1 m leads from the pool to the sea, and the stop is closest to the pool.
    pinched = (*WALL[:1], box(120, 60, 140, 99.5), box(120, 100.5, 140, 140), *WALL[2:])
    on_land = (78.0, 100.0)
    with pytest.raises(RequestError, match="lies on land") as refused:
        planned(on_land, GOAL, *pinched)
    _, place = advised(refused.value)
    assert shapely.union_all(WALL).envelope.distance(shapely.Point(place)) > 0
    assert planned(place, GOAL, *pinched).exit_code == 0


def test_the_quick_look_finds_water_with_a_way_out(tmp_path: Path) -> None:
    """An island of 60 km with a lagoon of 3 km, whose mouth is 22 m wide."""
    lagoon = box(30.02, 10.49, 30.05, 10.51).union(box(29.99, 10.4999, 30.03, 10.5001))
    island = box(30, 10, 30.55, 11).difference(lagoon)
    file = tmp_path / "island.geojson"
    file.write_text(shapely.to_geojson(island))
    beside_lagoon = (30.016, 10.495)
    (fault,) = endpoints_on_land(on_chart(beside_lagoon, (29.8, 10.5), file))
    _, (lon, lat) = advised(RequestError(fault.replace("move it", "move start")))
    assert lon < 30
    assert island.distance(shapely.Point(lon, lat)) > 0
