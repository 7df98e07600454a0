"""Via points and shut areas of a scenario: planned, noted, drawn with their hours; or refused."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely

import renew
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.run import run
from pipeline.scenario.loading import load_scenario, parse_scenario
from pipeline.scenario.model import Anchorage
from pipeline.stages.places import avoided_zones
from pipeline.stages.region import require_whole_files
from tests.pipeline.formats import small_run
from tests.pipeline.voyage.waters import scenario_of, write_tide

ISLAND = shapely.box(-40.01, 34.985, -39.99, 35.02)
RANGE = shapely.box(-40.01, 35.02, -39.98, 35.06)
VIA = (-40.03, 35.04)


def scenario_data(folder: Path, **asked: object) -> dict[str, Any]:
    """A voyage past an island whose north is shut in the morning, in a tide."""
    (folder / "island.geojson").write_text(shapely.to_geojson(ISLAND))
    (folder / "range.geojson").write_text(shapely.to_geojson(RANGE))
    return {
        "schema_version": 1,
        "name": "hours",
        "start": [-40.06, 35.0],
        "goal": [-39.94, 35.0],
        "via": [list(VIA)],
        "vessel": {"length_m": 12.0, "speed_m_s": 4.1, "turn_rate_deg_s": 11.8},
        "avoid": [
            {
                "path": "range.geojson",
                "from": "2026-11-22T06:00:00Z",
                "until": "2026-11-22T08:00:00Z",
            }
        ],
        "region": {"bbox": [-40.09, 34.95, -39.91, 35.10]},
        "chart": {"source": {"path": "island.geojson", "accuracy_m": 10}},
        "planner": {"classes": 2},
        "seasons": [
            {
                "name": "tide",
                "time_method": "changing",
                "departure": "2026-11-22T06:20:00Z",
                "currents": ["./tide.nc"],
                "max_hours": 20,
            }
        ],
        **asked,
    }


def test_a_run_passes_its_points_and_keeps_out_of_an_area_in_its_hours(tmp_path: Path) -> None:
    write_tide(tmp_path / "tide.nc")
    scenario = parse_scenario(scenario_data(tmp_path), tmp_path)
    outcome = run(scenario, tmp_path / "outputs")
    assert outcome.exit_code == 0
    (plan,) = outcome.result.results
    assert plan.plan is not None
    (met,) = plan.plan.shut
    assert isinstance(met, renew.ShutArea)
    assert met.begin == -20 * 60
    assert met.end == 100 * 60
    assert any(
        "a way of less fuel leads through area 'range', which is shut from 2026-11-22 06:00 UTC "
        "until 2026-11-22 08:00 UTC" in note
        for note in note_texts(outcome.fetched.notes)
    )
    assert plan.plan.best.times[-1] < met.end
    for route in plan.routes:
        assert shapely.LineString(route.path).distance(met.polygon) > 0
    package = outcome.directory / "routes.gpkg"
    areas = geopandas.read_file(package, layer="chart_areas")
    (shut,) = areas[areas.kind == "shut"].itertuples()
    assert shut.name == "range"
    assert shut.rule == "shut from 2026-11-22 06:00 UTC until 2026-11-22 08:00 UTC"
    routes = geopandas.read_file(package, layer="routes")
    assert shapely.dwithin(routes.geometry.to_numpy(), shapely.Point(VIA), 1e-5).all()
    # The files for plotters have a waypoint there, and keep out of the area as well.
    text = (outcome.directory / "hours-tide.rtz").read_text("utf-8")
    given = re.findall(r'lat="([-.\d]+)" lon="([-.\d]+)"', text)
    waypoints = np.array([(float(lon), float(lat)) for lat, lon in given])
    assert np.abs(waypoints - VIA).max(axis=1).min() < 1e-5
    assert not shapely.LineString(waypoints).intersects(RANGE.buffer(-1e-4))
    report = (outcome.directory / "report.html").read_text("utf-8")
    assert "range, shut from 2026-11-22 06:00 UTC until 2026-11-22 08:00 UTC" in report
    # The stored artefacts give the same routes again.
    made = load_scenario(str(outcome.directory / "scenario.toml"))
    assert made == outcome.scenario


def test_the_clock_of_an_area_begins_with_the_departure_that_was_chosen() -> None:
    area = renew.ShutArea(RANGE, 600.0, 1200.0, "range")
    case = small_run.parts(planar=True).planned["gyre"]
    later = replace(case, areas=(area, renew.ShutArea(RANGE))).later(500.0, "later")
    moved, always = later.areas
    assert (moved.begin, moved.end) == (100.0, 700.0)
    assert always.is_always_shut
    assert later.name == "later"


def test_a_stop_in_an_area_that_is_always_shut_is_found_before_a_run(tmp_path: Path) -> None:
    calm = [{"name": "calm", "currents": ["still"]}]
    data = scenario_data(tmp_path, avoid=[{"path": "range.geojson"}], seasons=calm)
    for region in ({}, {"region": data.pop("region")}):
        given = data | region
        require_whole_files(parse_scenario(given, tmp_path))
        with pytest.raises(RequestError, match=r"via\[0\] = .* lies in area 'range' .*; move it"):
            require_whole_files(parse_scenario(given | {"via": [[-40.0, 35.04]]}, tmp_path))


@pytest.mark.parametrize("is_open", [False, True])
def test_a_run_and_a_check_refuse_a_start_in_a_shut_area_by_the_same_sentence(
    tmp_path: Path, is_open: bool
) -> None:
    calm = [{"name": "calm", "currents": ["still"]}]
    data = scenario_data(tmp_path, avoid=[{"path": "range.geojson"}], seasons=calm)
    given = data | {"start": [-40.0, 35.04], "via": []}
    if is_open:
        del given["region"]
    inside = parse_scenario(given, tmp_path)
    said = []
    for refuse in (require_whole_files, lambda scenario: run(scenario, tmp_path / "outputs")):
        with pytest.raises(RequestError, match=r"^start = .* lies in area 'range'") as refused:
            refuse(inside)
        said.append(refused.value.faults)
    assert said[0] == said[1]
    assert not (tmp_path / "outputs").exists()


def test_all_faults_are_reported_at_once(tmp_path: Path) -> None:
    bad = scenario_data(
        tmp_path,
        via=[[-40.06, 35.0], [20.0, 20.0], [20.0, 20.0]],
        avoid=[{"path": "a.json", "from": "2026-11-22T09:00:00Z", "until": "2026-11-22T08:00:00Z"}],
        planner={"order": "length"},
    )  # fmt: skip
    with pytest.raises(RequestError) as refused:
        parse_scenario(bad, tmp_path)
    (key,) = refused.value.faults
    assert "avoid[0] is shut from 2026-11-22T09:00:00+00:00 until 2026-11-22T08:00:00" in key
    # Faults between tables are reported once each table is right by itself.
    with pytest.raises(RequestError) as refused:
        parse_scenario({key: bad[key] for key in bad.keys() - {"avoid"}}, tmp_path)
    text = "\n".join(refused.value.faults)
    assert "start and via[0] are the same place, [-40.06, 35.0]" in text
    assert "via[1] = [20.0, 20.0] lies" in text
    assert "km outside the region" in text
    assert "via[1] and via[2] are the same place" in text
    assert "has another planner.order than 'fuel' together with via points" in text
    steady = scenario_data(tmp_path)
    steady["seasons"] = [{"name": "still", "currents": ["still"]}]
    with pytest.raises(RequestError, match=r"season 'still' has no 'departure', from which"):
        parse_scenario(steady, tmp_path)
    without_zone = scenario_data(
        tmp_path, avoid=[{"path": "a.geojson", "from": "2026-11-22T09:00"}]
    )
    with pytest.raises(RequestError, match=r"avoid\[0\].from .*zone"):
        parse_scenario(without_zone, tmp_path)


@pytest.mark.usefixtures("plain_report")
def test_points_on_land_and_areas_that_are_not_there_are_refused(tmp_path: Path) -> None:
    write_tide(tmp_path / "tide.nc")
    on_land = scenario_data(tmp_path, via=[[-40.0, 35.0]])
    with pytest.raises(RequestError, match=r"via\[0\] = \[-40.0, 35.0\] lies on land, .* move it"):
        run(parse_scenario(on_land, tmp_path), tmp_path / "outputs")
    missing = scenario_data(tmp_path, avoid=[{"path": "none.geojson"}, {"path": "island.nc"}])
    with pytest.raises(RequestError) as refused:
        run(parse_scenario(missing, tmp_path), tmp_path / "outputs")
    assert [fault.partition(":")[0] for fault in refused.value.faults] == ["avoid[0]", "avoid[1]"]


@pytest.mark.usefixtures("plain_report")
def test_what_a_message_about_an_area_proposes_works(tmp_path: Path) -> None:
    write_tide(tmp_path / "tide.nc")
    points = shapely.MultiPoint([(-40.005, 35.03), (-39.99, 35.04)])
    (tmp_path / "buoys.geojson").write_text(shapely.to_geojson(points))
    geopandas.GeoSeries([RANGE], crs=4326).to_file(tmp_path / "bare.shp")
    (tmp_path / "bare.prj").unlink()
    two = tmp_path / "two.gpkg"
    for layer in ("range", "anchorage"):
        geopandas.GeoSeries([RANGE], crs=4326).to_file(two, layer=layer)
    files = ("buoys.geojson", "bare.shp", "two.gpkg")
    asked = scenario_data(tmp_path, avoid=[{"path": one} for one in files])
    with pytest.raises(RequestError) as refused:
        run(parse_scenario(asked, tmp_path), tmp_path / "outputs")
    tables = [re.findall(r"\{.*?\}", fault)[0] for fault in sorted(refused.value.faults)]
    read = [tomllib.loads(f"table = {one.replace('…', 'range')}")["table"] for one in tables]
    assert [one.pop("path") for one in read] == [*files]
    assert read == [{"radius_m": 20}, {"crs": "EPSG:4326"}, {"layer": "range"}]
    read = [{"path": path, **keys} for path, keys in zip(files, read, strict=True)]
    scenario = parse_scenario(scenario_data(tmp_path, avoid=read), tmp_path)
    zones, _ = avoided_zones(scenario.avoid, shapely.box(-41, 34, -39, 36))
    assert [zone.name for zone in zones] == ["buoys", "bare", "two"]
    assert zones[1].area.equals(RANGE)
    assert shapely.area(zones[0].area) > 0


@pytest.mark.slow
def test_an_area_of_very_many_vertices_is_covered_by_one_of_few(tmp_path: Path) -> None:
    write_tide(tmp_path / "tide.nc")
    turn = np.linspace(0, 2 * np.pi, 200_001)[:-1]
    radius = 0.02 + 0.002 * np.sin(9 * turn) + 1e-4 * np.sin(2001 * turn)
    lon, lat = -40.0 + radius * np.cos(turn), 35.03 + radius * np.sin(turn)
    area = shapely.Polygon(np.stack([lon, lat], axis=-1))
    (tmp_path / "wide.geojson").write_text(shapely.to_geojson(area))
    data = scenario_data(tmp_path, avoid=[{"path": "wide.geojson"}])
    ((zone,), _) = avoided_zones(
        parse_scenario(data, tmp_path).avoid, shapely.box(-41, 34, -39, 36)
    )
    assert zone.area.covers(area)
    assert shapely.get_num_coordinates(zone.area) < 20_000
    # Half a thousandth of its width of 4 km, and mitred corners.
    assert area.buffer(5e-5).covers(zone.area)


def test_a_one_line_voyage_takes_points_and_files(tmp_path: Path) -> None:
    (tmp_path / "range.geojson").write_text(shapely.to_geojson(RANGE))
    asked: dict[str, Any] = {
        "start": "179.9,35", "goal": "-179.9,35", "vessel": "usv-7m", "currents": ("still",),
    }  # fmt: skip
    stops = {"via": ("35.1N 179.95W",), "avoid": (tmp_path / "range.geojson",)}
    scenario, _ = scenario_of({**asked, **stops})
    assert scenario.via == ((180.05, 35.1),)
    assert scenario.avoid[0].path == str(tmp_path / "range.geojson")
    waiting = {**asked, "depart": "2026-11-22T06:00Z", "tide": ("boston",)}
    scenario, _ = scenario_of({**waiting, "via": ("35.1N 179.95W wait 6h",)})
    assert scenario.via == (Anchorage(at=(180.05, 35.1), wait="6h"),)
    with pytest.raises(RequestError, match="--via 'here'"):
        scenario_of({**asked, "via": ("here",)})
