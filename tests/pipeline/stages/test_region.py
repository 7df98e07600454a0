"""A region grows where a route comes near its edge."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import xarray as xr
from shapely import Polygon, box

from pipeline.errors import RequestError
from pipeline.machine.store import Store
from pipeline.model import Note
from pipeline.run import Outcome, run
from pipeline.scenario.catalogue import read_toml, scenario_path
from pipeline.scenario.loading import load_scenario, parse_scenario
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import Season
from pipeline.sources.land import osm
from pipeline.stages.region import (
    SIDES,
    chosen_region,
    covered_by_currents,
    endpoints_on_land,
    grown,
    require_covered,
    require_whole_files,
    sides_near,
    uncovered_seasons,
)
from pipeline.stages.water_grid import DirectLine
from tests.pipeline.sources.depth_grids import gebco
from tests.pipeline.synthetic_currents import dataset, sea, write
from tests.true_scale import GEOD

BOUNDS = (10.0, 50.0, 12.0, 51.0)
WORLD = (-180.0, -89.0, 360.0, 89.0)
MARGIN_M = 20_000.0


def near(*places: tuple[float, float]) -> list[str]:
    return [SIDES[side] for side in sides_near(BOUNDS, [np.array(places)], MARGIN_M)]


def test_only_the_sides_that_a_path_comes_near_are_found() -> None:
    assert near((11, 50.5)) == []
    assert near((10.05, 50.5)) == ["west"]
    assert near((11, 50.5), (11.95, 50.97)) == ["east", "north"]
    assert near((11, 50.02)) == ["south"]
    assert sides_near(BOUNDS, [], MARGIN_M) == []


def test_stops_half_a_world_apart_are_refused_at_once() -> None:
    table = read_toml(scenario_path("palawan-season")) | {"start": [0.0, 0.0], "goal": [180.0, 0.0]}
    season = {"name": "a", "currents": ["still"]}
    asked = parse_scenario({**table, "region": None, "seasons": [season]})
    (fault,) = uncovered_seasons(asked)
    assert fault.startswith("the stops are 180 degrees of longitude apart")


def test_a_mark_of_byte_order_is_no_part_of_a_scenario(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("\ufeffname = 'a'\r\n", encoding="utf-8")
    assert read_toml(tmp_path / "a.toml") == {"name": "a"}


def test_near_is_a_share_of_the_margin_on_the_ground() -> None:
    for share, is_near in ((0.25, True), (0.35, False)):
        lon = GEOD.fwd(10, 50.5, 90, share * MARGIN_M)[0]
        assert (near((lon, 50.5)) == ["west"]) is is_near


def test_a_shut_region_opens_on_all_sides_as_far_as_the_limits_allow() -> None:
    west, south, east, north = grown(BOUNDS, range(4), 50_000.0, WORLD)
    assert GEOD.inv(west, 51, 10, 51)[2] == pytest.approx(50_000.0, rel=0.02)
    assert GEOD.inv(east, 51, 12, 51)[2] == pytest.approx(50_000.0, rel=0.02)
    assert GEOD.inv(11, south, 11, 50)[2] == pytest.approx(50_000.0, rel=0.02)
    assert GEOD.inv(11, north, 11, 51)[2] == pytest.approx(50_000.0, rel=0.02)
    assert grown(BOUNDS, range(4), 50_000.0, BOUNDS) == BOUNDS


def test_sides_move_outward_as_far_as_the_limits_allow() -> None:
    west, south, east, north = grown(BOUNDS, [0, 3], 2 * MARGIN_M, WORLD)
    assert (south, east) == BOUNDS[1:3]
    assert GEOD.inv(west, 51, 10, 51)[2] == pytest.approx(2 * MARGIN_M, rel=0.02)
    assert GEOD.inv(11, 51, 11, north)[2] == pytest.approx(2 * MARGIN_M, rel=0.02)
    assert grown(BOUNDS, [0, 3], 2 * MARGIN_M, (9.9, 40, 20, 51.0)) == (9.9, 50.0, 12.0, 51.0)
    assert grown(BOUNDS, [0], 2 * MARGIN_M, (9.99, 40, 20, 51.0)) == BOUNDS
    assert grown(BOUNDS, [], 2 * MARGIN_M, WORLD) == BOUNDS


def test_a_chosen_region_holds_the_havens_that_can_be_reached(tmp_path: Path) -> None:
    # In open water across 180 degrees: 37 km at 2 m/s, with 2 hours, or 14.4 km, to a haven.
    start, goal = (179.8, -40.0), (180.235, -40.0)
    near_by, too_far = (GEOD.fwd(180, -40, 180, 1000 * km)[:2] for km in (12.0, 25.0))
    (tmp_path / "havens.csv").write_text(
        f"name,lon,lat\nnear,{near_by[0]},{near_by[1]}\nfar,{too_far[0]},{too_far[1]}\n"
    )
    vessel = {"length_m": 5.0, "speed_m_s": 2.0, "turn_rate_deg_s": 10.0}
    table = {"schema_version": 1, "name": "pacific", "vessel": vessel, "start": start, "goal": goal}
    still = [{"name": "still", "valid": "2024-07", "currents": ["still"]}]
    about = {"seasons": still, "havens": {"path": "havens.csv", "within": "2h"}}
    scenario = parse_scenario(table | about, tmp_path)
    _, south, east, _ = chosen_region(scenario, Store(tmp_path), offline=True).bounds
    assert too_far[1] < south < near_by[1]
    assert 180.235 < east < 181
    # It reaches as far as the land of which routes are to keep clear.
    clear = parse_scenario(table | {"seasons": still, "planner": {"clearance": 9e4}}, tmp_path)
    west, *_ = chosen_region(clear, Store(tmp_path), offline=True).bounds
    assert GEOD.inv(west, -40, 179.8, -40)[2] >= 9e4


# --- What the currents of a voyage cover ---


PALAWAN = DirectLine.between((120.30, 12.80), (116.80, 7.70))
GLORYS, EMBEDDED = "copernicus-glorys-monthly", "embedded-palawan"


@pytest.fixture(autouse=True)
def _no_account(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("USERNAME", "PASSWORD"):
        monkeypatch.delenv(f"COPERNICUSMARINE_SERVICE_{name}", raising=False)
    monkeypatch.setenv("COPERNICUSMARINE_CREDENTIALS_DIRECTORY", str(tmp_path / "nobody"))


def season(month: str, *currents: str | tuple[str, ...]) -> Season:
    return Season(name=month, valid=month, currents=currents)


def covered(folder: Path, *seasons: Season, direct: DirectLine = PALAWAN) -> Any:  # noqa: ANN401
    return covered_by_currents(seasons, direct, folder, offline=False)


def test_without_an_account_the_embedded_table_limits_the_region(tmp_path: Path) -> None:
    bounds, sources = covered(tmp_path, season("2024-07", GLORYS, EMBEDDED))
    assert bounds == pytest.approx((114.75, 6.75, 123.25, 14.25))
    assert set(sources) == {EMBEDDED}


def test_with_an_account_the_service_has_the_world(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("USERNAME", "PASSWORD"):
        monkeypatch.setenv(f"COPERNICUSMARINE_SERVICE_{name}", "someone")
    (west, south, east, north), _ = covered(tmp_path, season("2024-07", GLORYS, EMBEDDED))
    assert east - west > 290
    assert (south, north) == (-80, 89)


def test_seasons_limit_the_region_together(tmp_path: Path) -> None:
    field = sea(np.arange(116, 121.1, 0.5), np.arange(6, 13.6, 0.5))
    path = write(tmp_path / "field.nc", dataset(field))
    both = season("2024-07", (str(path),)), season("2024-08", EMBEDDED)
    bounds, sources = covered(tmp_path, *both)
    assert bounds == pytest.approx((115.75, 6.75, 121.25, 13.75))
    assert sources[1] == EMBEDDED
    assert sources[0] == sources[3] == "field.nc"


def test_still_water_covers_everything(tmp_path: Path) -> None:
    (_, south, _, north), _ = covered(tmp_path, Season(name="still", currents=("still",)))
    assert (south, north) == (-89, 89)


def test_without_any_current_the_error_says_why_and_what_would_do(tmp_path: Path) -> None:
    aegean = DirectLine.between((23.6, 37.9), (28.3, 36.5))
    with pytest.raises(RequestError) as caught:
        covered(tmp_path, season("2024-07", GLORYS, EMBEDDED), direct=aegean)
    (line,) = caught.value.faults
    assert "free Copernicus Marine account" in line
    assert "embedded-palawan has no data west of 114.75" in line
    assert "--currents FILE" in line
    assert "--currents still" in line


def test_a_season_without_currents_does_not_stop_the_others(tmp_path: Path) -> None:
    bounds, _ = covered(tmp_path, season("2024-05", GLORYS), season("2024-07", EMBEDDED))
    assert bounds == pytest.approx((114.75, 6.75, 123.25, 14.25))


@pytest.mark.parametrize(
    "about", [{"current_variables": ["speed_x", "speed_y"]}, {"members": {"along": "realization"}}]
)
def test_currents_are_looked_at_as_a_season_says(tmp_path: Path, about: dict[str, Any]) -> None:
    field = sea(np.arange(131.0, 135.1, 0.25), np.arange(16.0, 19.1, 0.25))
    data = dataset(field, names=("speed_x", "speed_y"), standard=("", ""))
    if "members" in about:
        data = xr.concat([dataset(field)] * 3, "realization")
    path = write(tmp_path / "own.nc", data)
    asked = scenario((132.5, 17.0), (133.5, 18.0)).model_dump(exclude_defaults=True)
    asked["seasons"] = [{"name": "it", "valid": "2024-07", "currents": [[str(path)]], **about}]
    assert not list(uncovered_seasons(Scenario.model_validate(asked)))


def test_stops_at_the_pole_need_a_region_of_their_own() -> None:
    table = load_scenario("palawan-usv").model_dump(mode="json")
    still = [{"name": "still", "currents": ["still"]}]
    ends = {"start": (10.0, 89.5), "goal": (20.0, -89.6), "seasons": still}
    asked = Scenario.model_validate({**table, "region": None, **ends})
    with pytest.raises(RequestError) as caught:
        require_covered(asked)
    assert [fault.split(" lies beyond 89 degrees")[0] for fault in caught.value.faults] == [
        "start = [10.0, 89.5]",
        "goal = [20.0, -89.6]",
    ]
    region = {"bbox": (-60.0, 87.0, 60.0, 90.0)}
    require_covered(Scenario.model_validate({**table, **ends, "region": region, "goal": (20, 88)}))


# --- A quick look whether start and goal are in water ---


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


@pytest.mark.parametrize(("shortfall", "longitude"), [("refuse", 29.995), ("least", 30.02)])
def test_the_nearest_water_lies_in_an_inlet_where_less_room_may_be_kept(
    shortfall: str, longitude: float, tmp_path: Path
) -> None:
    # The inlet is 330 m wide and 2 km long; the vessel turns on a circle of 500 m.
    inlet = shapely.box(29.9, 10.4985, 30.02, 10.5015)
    file = tmp_path / "inlet.geojson"
    file.write_text(shapely.to_geojson(shapely.difference(ISLAND, inlet)))
    table = scenario((30.025, 10.5), WATER, file).model_dump(mode="json")
    table["vessel"] = {
        "origin": "test",
        "length_m": 150.0,
        "speed_m_s": 6.0,
        "turn_rate_deg_s": math.degrees(6.0 / 250.0),
    }
    table["planner"]["shortfall"] = shortfall
    (fault,) = endpoints_on_land(Scenario.model_validate(table))
    place = re.search(r"with a way out at \[([\d.]+), ", fault)
    assert place is not None
    assert float(place[1]) == pytest.approx(longitude, abs=0.002)


def test_shallow_water_is_not_called_land_nor_its_coordinates_swapped(
    chart: Path, tmp_path: Path
) -> None:
    table = scenario(WATER, (29.8, 10.4), chart).model_dump(mode="json")
    table["vessel"] |= {"draught_m": 30.0}
    axis = np.arange(0.0, 1.3, 0.05)
    bank = gebco(tmp_path / "bank.nc", 29.2 + axis, 9.9 + axis, np.full((26, 26), -20.0))
    table["chart"]["depths"] = str(bank)
    faults = endpoints_on_land(Scenario.model_validate(table))
    assert len(faults) == 2
    for fault in faults:
        assert "lies on land, or water too shallow for the vessel or not charted" in fault
        assert "did you mean" not in fault


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


def test_the_quick_look_at_the_world_reads_no_second_shoreline(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    read, near = list[str](), osm.polygons_near

    def noted(
        shoreline: osm.Shoreline, where: Polygon
    ) -> tuple[osm.NearPolygons, tuple[Note, ...]]:
        read.append(shoreline)
        return near(shoreline, where)

    monkeypatch.setattr(osm, "polygons_near", noted)
    assert endpoints_on_land(scenario((-40.0, 35.0), (-41.0, 35.0))) == []
    assert read == ["Osm", "Osm"]


@pytest.mark.slow
def test_for_a_position_in_a_lake_the_message_says_that_the_chart_has_no_lakes(chart: Path) -> None:
    faults = endpoints_on_land(scenario((6.5, 46.45), (28.9, 36.2)))  # Lake Geneva
    assert ["without lakes and rivers" in fault for fault in faults] == [True]
    own = endpoints_on_land(scenario((30.01, 10.5), (30.275, 10.5), chart))
    assert not any("lakes" in fault for fault in own)


# --- Where a stop is told to move, the voyage is planned: no advice leads into a pocket ---


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


@pytest.mark.gate_share(1)
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
    (fault,) = endpoints_on_land(scenario(beside_lagoon, (29.8, 10.5), file))
    _, (lon, lat) = advised(RequestError(fault.replace("move it", "move start")))
    assert lon < 30
    assert island.distance(shapely.Point(lon, lat)) > 0


@pytest.mark.slow
def test_a_tide_over_no_depths_is_found_before_a_run() -> None:
    table = read_toml(scenario_path("palawan-season")) | {"tide": {"stations": ["boston"]}}
    departure = {"time_method": "changing", "departure": "2026-11-22T06:00:00Z"}
    season = {"name": "a", "currents": ["copernicus-total-hourly"], **departure}
    with pytest.raises(RequestError, match=r"\[tide\] needs a chart with depths"):
        require_whole_files(parse_scenario({**table, "scale": 1, "seasons": [season]}))
