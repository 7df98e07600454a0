"""Water deep enough for some hours is planned, noted and written with its hours, or refused."""

from __future__ import annotations

import csv
import json
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely

import pipeline
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.formats.passage.waypoints import case_waypoints
from pipeline.formats.tables import headings, rows
from pipeline.geo.lonlat import DepthCover
from pipeline.geo.projection import Projection
from pipeline.model import Land, SimplifiedLand
from pipeline.run import Outcome, run
from pipeline.scenario.loading import parse_scenario
from pipeline.sources.tides.station import find_station
from pipeline.stages.places import tidal_depth
from tests.pipeline.sources.depth_grids import emodnet
from tests.pipeline.voyage.waters import scenario_of

# Off Boston, near enough to its station.
START, GOAL = (-71.03, 42.34), (-70.99, 42.34)
BOX = (-71.05, 42.325, -70.97, 42.355)
ISLAND = shapely.box(-71.012, 42.337, -71.008, 42.343)
BAR = shapely.box(-71.0105, 42.30, -71.0095, 42.40)
BAR_DEPTH_M, DRAUGHT_M, SURGE_M = 0.8, 1.5, 0.3
EBB = datetime(2026, 11, 22, 18, 30, tzinfo=UTC)  # low water is half an hour later


def scenario_data(folder: Path, **asked: object) -> dict[str, Any]:
    """A voyage past an island on a bar, on a grid of depths."""
    (folder / "island.geojson").write_text(shapely.to_geojson(ISLAND))
    lon, lat = np.arange(-71.06, -70.96, 0.001), np.arange(42.315, 42.365, 0.001)
    x, y = np.meshgrid(lon, lat)
    height = np.where(shapely.contains_xy(BAR, x, y), -BAR_DEPTH_M, -20.0)
    emodnet(folder / "depths.nc", lon, lat, height)
    return {
        "schema_version": 1,
        "name": "bar",
        "start": list(START),
        "goal": list(GOAL),
        "vessel": {
            "length_m": 7.0,
            "draught_m": DRAUGHT_M,
            "speed_m_s": 3.0,
            "turn_rate_deg_s": 16.5,
        },
        "region": {"bbox": list(BOX)},
        "chart": {
            "source": {"path": "island.geojson", "accuracy_m": 5, "complete": True},
            "depths": "depths.nc",
            "datum": "MLLW",
        },
        "tide": {"stations": ["boston"], "surge_m": SURGE_M},
        "planner": {"classes": 2},
        "seasons": [
            {
                "name": "day",
                "departures": {"first": EBB, "every": "2h", "count": 4},
                "currents": ["still"],
            }
        ],
        **asked,
    }


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Give the run of a day of departures over the bar."""
    folder = tmp_path_factory.mktemp("bar")
    return run(parse_scenario(scenario_data(folder), folder), folder / "outputs")


def relied_on_m(moment: datetime) -> float:
    """The least height of the tide within a quarter of an hour, less the surge."""
    tide = find_station("boston").tide(moment)
    return float(tide.heights(np.arange(-900.0, 901.0, 30.0)).min()) - SURGE_M


def test_the_bar_is_crossed_when_there_is_enough_water(outcome: Outcome) -> None:
    assert outcome.exit_code == 0
    (table,) = outcome.directory.glob("*departures.csv")
    with table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert 0 < sum(bool(row["fuel"]) for row in rows) < len(rows)
    need = DRAUGHT_M + 1.0 - BAR_DEPTH_M
    for row in rows:
        at_bar = datetime.fromisoformat(row["departure"]) + timedelta(seconds=550)
        if row["fuel"]:
            # The vessel may be an hour late, or early, but not before its departure.
            for minutes in (-9, 0, 60):
                assert relied_on_m(at_bar + timedelta(minutes=minutes)) > need
        else:
            assert "m of tide" in row["reason"]
    with (outcome.directory / "metrics.csv").open(encoding="utf-8", newline="") as file:
        best = next(csv.DictReader(file))
    at = datetime.fromisoformat(best["least_water_at"])
    # The band of depth in which the bar lies begins up to 0.25 m above it.
    under_keel = relied_on_m(at) + BAR_DEPTH_M - DRAUGHT_M
    assert under_keel - 0.25 < float(best["least_water_m"]) <= under_keel + 0.03
    early, late = float(best["least_water_early_m"]), float(best["least_water_late_m"])
    assert min(early, late) >= 1.0
    assert min(early, late) < float(best["least_water_m"])


def test_hours_and_heights_are_in_the_notes_and_the_geopackage(outcome: Outcome) -> None:
    texts = " ".join(note_texts(outcome.fetched.notes))
    assert "depths and the tide of BOSTON are counted from MLLW" in texts
    assert re.search(
        r"\d\.\d m under the keel where that is least, .* There is enough water from", texts
    )
    areas = geopandas.read_file(outcome.directory / "routes.gpkg", layer="tidal_water")
    assert (areas["need_m"] > 0).all()
    for hours, need in zip(areas["hours"], areas["need_m"], strict=True):
        for span in hours.split(", "):
            begin, end = (
                datetime.strptime(one, "%Y-%m-%d %H:%M UTC").replace(tzinfo=UTC)
                for one in span.split(" to ")
            )
            assert relied_on_m(begin + (end - begin) / 2) > need
    routes = geopandas.read_file(outcome.directory / "routes.gpkg", layer="routes")
    assert (routes["least_water_m"] >= 1.0).all()
    assert routes["least_water_at"].str.endswith("UTC").all()
    report = (outcome.directory / "report.html").read_text(encoding="utf-8")
    assert f"Water under the keel, m: least {routes['least_water_m'][0]:.1f}" in report
    manifest = json.loads((outcome.directory / "manifest.json").read_text(encoding="utf-8"))
    assert "tide-relied-on" in json.dumps(manifest)


def test_a_row_of_the_passage_plan_has_the_water_of_the_leg_that_leads_to_it(
    outcome: Outcome,
) -> None:
    result = outcome.result
    points = case_waypoints(result.case("day"))[0]
    departure = result.case("day").spec.departure
    assert departure is not None
    table = rows(points, departure)
    assert headings(points).water == "Water under\nkeel, m"
    depth = result.planned["day"].tidal_depth
    assert depth is not None
    tide = shapely.union_all(depth.areas)
    for index, row in enumerate(table[1:]):
        leg = shapely.LineString(result.water.projection.to_plane(points.lonlat[index : index + 2]))
        assert bool(row.water) == leg.intersects(tide)
    over = [row for row in table if row.water]
    assert over
    stated = min(float(row.water) for row in over)
    assert stated == pytest.approx(points.ranked.metrics.least_water_m, abs=0.11)


@pytest.mark.parametrize(
    ("asked", "text"),
    [
        (
            {"chart": {"datum": ""}},
            "if the depths are from there, too, set chart.datum = 'MLLW'",
        ),
        (
            {"chart": {"datum": "MSL"}},
            "(MSL is 1.59 m above it); give a station's TOML file with datum = 'MSL'",
        ),
        ({"chart": {"depths": ""}}, "[tide] needs a chart with depths"),
        (
            {"tide": {"stations": ["boston", "hull"]}},
            "tide: hull does not exist, and is no station of the catalogue",
        ),
        ({"vessel": {"draught_m": 15.0, "squat_m": 1.5}}, "no water connects them"),
        ({"seasons": {"departures": None}}, "has no 'departure', from which the hours of [tide]"),
    ],
)
def test_what_does_not_fit_the_tide_is_refused(
    tmp_path: Path, asked: dict[str, Any], text: str
) -> None:
    data = scenario_data(tmp_path)
    for key, value in asked.items():
        if key == "seasons":
            data[key] = [{**data[key][0], **value}]
        else:
            data[key] = {**data[key], **value} if isinstance(value, dict) else value
    with pytest.raises(RequestError) as caught:
        run(parse_scenario(data, tmp_path), tmp_path / "outputs")
    assert text in str(caught.value)
    assert not (tmp_path / "outputs" / "bar").exists()


def test_a_grid_beside_cells_does_not_take_their_datum(tmp_path: Path) -> None:
    data = scenario_data(tmp_path)
    data["chart"] = {**data["chart"], "datum": ""}
    scenario = parse_scenario(data, tmp_path)
    cells = Land((), (), 5.0, depths=DepthCover(()), datum="MLLW")
    region = shapely.box(*BOX)
    simplified = SimplifiedLand((), (), 0, 0, 5.0, 5.0)
    with pytest.raises(RequestError, match="does not state the datum of its depths"):
        tidal_depth(scenario, cells, simplified, region, Projection.for_region(region))


def test_water_far_from_every_station_is_refused_with_the_nearest(tmp_path: Path) -> None:
    data = scenario_data(tmp_path)
    station = tmp_path / "far.toml"
    source = Path(pipeline.__file__).parents[1] / "catalog" / "tides" / "boston.json"
    station.write_text(
        f'constants = "{source}"\nname = "Far"\nposition = [-71.5, 42.34]\n', encoding="utf-8"
    )
    data["tide"] = {"stations": ["far.toml"]}
    with pytest.raises(
        RequestError,
        match=r"no station counts there: the nearest is Far \(4\d km in a straight line\)",
    ):
        run(parse_scenario(data, tmp_path), tmp_path / "outputs")


def test_a_voyage_in_one_line_takes_the_tide(tmp_path: Path) -> None:
    scenario_data(tmp_path)
    voyage = {
        "start": "42.34N 71.03W", "goal": "42.34N 70.99W", "currents": ("still",),
        "speed": "6kn", "length": "7m", "turning_circle": "30m", "draught": "1.5m",
        "depths": tmp_path / "depths.nc", "datum": "MLLW", "tide": ("boston",),
        "depart": "2026-11-22T18:30Z", "until": "2026-11-23T00:30Z",
    }  # fmt: skip
    scenario, notes = scenario_of(voyage)
    assert notes == ()
    assert scenario.chart.datum == "MLLW"
    assert scenario.tide is not None
    assert scenario.tide.stations == ("boston",)
    (season,) = scenario.seasons
    assert season.departures is not None
    assert (season.departures.begin, season.departures.count) == (EBB, 13)
    with pytest.raises(RequestError) as caught:
        scenario_of({**voyage, "depart": "", "until": "", "depths": None, "tide": ("hull",)})
    assert "--tide counts from the departure; add --depart" in str(caught.value)
    assert "hull" in str(caught.value)
    assert "--datum = 'MLLW' is of charted depths; add --depths or --charts" in str(caught.value)
