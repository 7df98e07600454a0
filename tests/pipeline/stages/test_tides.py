"""Water deep enough for some hours is planned, noted and written with its hours, or refused."""

import csv
import json
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely

import pipeline
import renew
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RunResult
from pipeline.formats.passage.waypoints import case_waypoints
from pipeline.formats.tables import leg_headings, rows
from pipeline.geo.projection import DepthCover, Projection
from pipeline.machine.store import Artefact
from pipeline.model import Case, Land, SimplifiedLand, Water
from pipeline.run import Outcome, run
from pipeline.scenario.loading import load_scenario, parse_scenario
from pipeline.sources.tide_stations import find_station
from pipeline.stages.choose import Chosen, with_onward_legs
from pipeline.stages.places import tidal_depth
from renew._types import BoolArray, FloatArray
from renew.inputs.openings import ReliedOnTide
from tests.clock_oracle import earliest_arrival
from tests.pipeline.results import plain_pages
from tests.pipeline.sources.cf.levels_files import write_s104
from tests.pipeline.sources.depth_grids import emodnet
from tests.pipeline.tidal_run import run as tidal_run, tide
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
    assert routes["least_water_at"].between(routes["departure"], routes["arrival"]).all()
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
    assert leg_headings(points)["water"] == "Water under keel, m"
    depth = result.planned["day"].tidal_depth
    assert depth is not None
    tide = shapely.union_all(depth.areas)
    for index, row in enumerate(table[1:]):
        leg = shapely.LineString(result.water.projection.to_plane(points.lonlat[index : index + 2]))
        assert bool(row["water"]) == leg.intersects(tide)
    over = [row for row in table[1:] if row["water"]]
    assert over
    stated = min(float(row["water"]) for row in over)
    assert stated == pytest.approx(points.ranked.metrics.least_water_m, abs=0.11)


def test_with_official_levels_the_water_at_each_place_and_hour_counts(tmp_path: Path) -> None:
    # On the bar the sea stands as the tide at the start, and 0.35 m lower.
    lon, lat = np.arange(-71.06, -70.95, 0.002), np.arange(42.31, 42.37, 0.002)
    hours: FloatArray = EBB.timestamp() - 1800 + 3600.0 * np.arange(30.0)
    tide = find_station("boston").tide(datetime.fromtimestamp(0, UTC)).heights(hours)
    sea = tide[:, None, None] - np.where(lon > -71.015, 0.35, 0.0) * np.ones((lat.size, 1))
    write_s104(tmp_path / "levels.h5", (lon, lat), hours, sea)
    asked = {"stations": ["./levels.h5", "boston"], "surge_m": SURGE_M}
    season = {"name": "day", "departure": EBB + timedelta(hours=7), "currents": ["still"]}
    data = scenario_data(tmp_path, tide=asked, seasons=[season])
    made = run(parse_scenario(data, tmp_path), tmp_path / "outputs")
    texts = " ".join(note_texts(made.fetched.notes))
    assert "levels.h5 at each place and hour, from 2026-11-22 18:00 UTC until" in texts
    assert "within 10 km of BOSTON the official levels are for" in texts
    with (made.directory / "metrics.csv").open(encoding="utf-8", newline="") as file:
        best = next(csv.DictReader(file))
    at = datetime.fromisoformat(best["least_water_at"])
    under_keel = relied_on_m(at) - 0.35 + BAR_DEPTH_M - DRAUGHT_M
    # The bar's band of depth begins up to 0.25 m above it, a zone is up to 0.1 m too low.
    assert under_keel - 0.35 < float(best["least_water_m"]) <= under_keel + 0.03
    season["departure"] = EBB + timedelta(days=3)
    late = parse_scenario(scenario_data(tmp_path, tide=asked, seasons=[season]), tmp_path)
    with pytest.raises(RequestError, match="has levels from 2026-11-22 18:00 UTC until"):
        run(late, tmp_path)


@pytest.mark.parametrize(
    ("asked", "text"),
    [
        ({"chart": {"datum": ""}}, "if the depths are from there, too, set chart.datum = 'MLLW'"),
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


def test_depths_without_a_datum_are_refused(tmp_path: Path) -> None:
    data = scenario_data(tmp_path)
    data["chart"] = {**data["chart"], "datum": ""}
    scenario = parse_scenario(data, tmp_path)
    cells = Land((), (), 5.0, depths=DepthCover(()))
    simplified = SimplifiedLand((), (), 0, 0, 5.0, 5.0)
    region = shapely.box(*BOX)
    water = Water(renew.Chart(region), (), Projection.for_region(region))
    with pytest.raises(RequestError, match="does not state the datum of its depths"):
        tidal_depth(scenario.tide, scenario.chart, cells, simplified, water)


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


# --- A vessel waits at an anchorage until there is water on the bar behind it, and then goes on ---


ANCHORAGE, ON_THE_BAR = [-71.02, 42.34], [-71.01, 42.333]
WAIT = timedelta(hours=9)
STEP = timedelta(minutes=12)
HIGH = datetime(2026, 11, 23, 1, 0, tzinfo=UTC)
LATE_S, LATENESS = 3600.0, 0.05


def voyage(folder: Path, via: object, departure: datetime = EBB) -> Outcome:
    season = {"name": "day", "departure": departure, "currents": ["still"]}
    asked = scenario_data(folder, seasons=[season], via=[via])
    with plain_pages():
        return run(parse_scenario(asked, folder), folder / "outputs")


def table(waited: Outcome, name: str = "metrics.csv") -> list[dict[str, str]]:
    with (waited.directory / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def times(row: dict[str, str]) -> tuple[datetime, datetime]:
    return datetime.fromisoformat(row["departure"]), datetime.fromisoformat(row["arrival"])


@pytest.fixture(scope="module")
def waited(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Give the run of a voyage that begins on the ebb, and waits."""
    folder = tmp_path_factory.mktemp("waiting")
    return voyage(folder, {"at": ANCHORAGE, "wait": "9h"})


@pytest.mark.slow
@pytest.mark.usefixtures("plain_report")
def test_without_a_wait_every_way_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=r"every way may meet .* m of tide"):
        voyage(tmp_path, ANCHORAGE)
    short = voyage(tmp_path, {"at": ANCHORAGE, "wait": "1h"})
    assert short.exit_code != 0
    reasons = {plan.name: plan.failure for plan in short.result.results}
    assert reasons["day"] == ""
    assert reasons["day-onward"].endswith("or let the vessel wait longer at its anchorage")


def test_the_way_on_begins_when_the_bar_opens(waited: Outcome) -> None:
    there, onward = (
        next(row for row in table(waited) if row["season"] == name and row["rank"] == "1")
        for name in ("day", "day-onward")
    )
    (left, arrived), (goes_on, at_goal) = times(there), times(onward)
    assert left == EBB
    assert arrived < goes_on <= arrived + WAIT
    text = f"lies at anchor at 71.0200 W 42.3400 N from {arrived + timedelta(minutes=1):%Y-%m-%d}"
    assert text in " ".join(note_texts(waited.fetched.notes) + list(waited.choices))
    assert there["least_water_m"] == ""
    assert (
        min(float(onward[key]) for key in onward if "least_water" in key and "_at" not in key) >= 1
    )
    assert int(onward["collisions"]) == 0
    # The vessel burns fuel for the time under way only.
    for row, (begin, end) in ((there, times(there)), (onward, (goes_on, at_goal))):
        rate = 3.0**2
        assert float(row["fuel"]) == pytest.approx(rate * (end - begin).total_seconds(), rel=2e-3)


def test_each_file_has_the_hours_of_its_part(waited: Outcome) -> None:
    rows = {row["season"]: times(row) for row in reversed(table(waited))}
    places = {"day": (START, tuple(ANCHORAGE)), "day-onward": (tuple(ANCHORAGE), GOAL)}
    manifest = (waited.directory / "manifest.json").read_text(encoding="utf-8")
    for season, (begin, end) in rows.items():
        gpx = (waited.directory / f"bar-{season}.gpx").read_text(encoding="utf-8")
        found = [datetime.fromisoformat(one) for one in re.findall(r"<time>([^<]*)</time>", gpx)]
        assert {begin, end} <= set(found)
        rtz = (waited.directory / f"bar-{season}.rtz").read_text(encoding="utf-8")
        assert f'etd="{begin:%Y-%m-%dT%H:%M:%SZ}"' in rtz
        # Its legs replace the path by fewer ones of at most 0.2 % more fuel.
        eta = datetime.fromisoformat(re.findall(r'eta="([^"]*)"', rtz)[-1])
        assert abs((eta - end).total_seconds()) <= 1 + 0.003 * (end - begin).total_seconds()
        path = waited.directory / f"bar-{season}.geojson"
        geometries = [
            shapely.from_geojson(json.dumps(one["geometry"]))
            for one in json.loads(path.read_text(encoding="utf-8"))["features"]
        ]
        lines = [one for one in geometries if one.geom_type == "LineString"]
        assert lines
        for end_of, place in zip((0, -1), places[season], strict=True):
            assert shapely.get_coordinates(lines[0])[end_of] == pytest.approx(place, abs=1e-5)
        assert f"{begin:%Y-%m-%dT%H:%M:%SZ}" in manifest


@pytest.mark.slow
@pytest.mark.usefixtures("plain_report")
def test_the_written_scenario_gives_the_same_voyage(waited: Outcome, tmp_path: Path) -> None:
    again = run(load_scenario(str(waited.directory / "scenario.toml")), tmp_path)
    assert table(again) == table(waited)


def is_shut_for(case: Case, departure: float) -> Any:  # noqa: ANN401 - as the oracle takes it
    """Say which legs are shut, by this test's own rule: early, on time, late and for a turn."""
    depth, turn = case.tidal_depth, case.vessel.turn_period
    assert depth is not None
    kinds = depth.tide if isinstance(depth.tide, list) else [depth.tide] * len(depth.areas)
    relied = {one: ReliedOnTide(one, depth.surge, depth.lag) for one in set(kinds)}

    def is_shut(a: FloatArray, b: FloatArray, begin: FloatArray, end: FloatArray) -> BoolArray:
        shut = ~np.isfinite(end)
        legs = shapely.linestrings(np.stack([a, b], axis=1))
        for area, need, kind in zip(depth.areas, depth.needs, kinds, strict=True):
            at = np.flatnonzero(shapely.intersects(area, legs) & ~shut)
            late = np.maximum(LATE_S, LATENESS * (end[at] - departure))
            early = np.maximum(begin[at] - late, departure)
            hours = np.linspace(early, end[at] + late + turn, 25)
            shut[at] = relied[kind].heights(hours).min(axis=0) < need
        return shut

    return is_shut


@pytest.mark.slow
def test_an_oracle_that_waits_at_that_node_does_not_arrive_earlier(waited: Outcome) -> None:
    season, first = "day-onward", waited.result.planned["day"]
    anchorage, goal = waited.result.stops[1:]
    there, onward = (
        next(row for row in table(waited) if row["season"] == name) for name in ("day", season)
    )
    arrived, chosen = ((one - EBB).total_seconds() for one in (times(there)[1], times(onward)[0]))

    def way_on(departure: float) -> float:
        fuel, _ = earliest_arrival(
            first.chart,
            first.current,
            first.vessel,
            anchorage,
            goal,
            departure,
            spacing=120.0,
            clearance=float(waited.scenario.planner.clearance or 0.0),
            is_shut=is_shut_for(first, departure),
        )
        return fuel

    # Waiting at the anchorage's node, the oracle finds the bar shut until the vessel goes on.
    waits = np.arange(arrived, chosen - STEP.total_seconds() - 60.0, 5400.0)
    assert len(waits) > 2
    assert all(map(np.isinf, map(way_on, [*waits, chosen - STEP.total_seconds() - 60.0])))
    assert float(onward["fuel"]) <= 1.005 * way_on(chosen)


@pytest.mark.slow
@pytest.mark.usefixtures("plain_report")
def test_no_wait_at_all_changes_nothing(tmp_path: Path) -> None:
    given = [tmp_path / name for name in ("point", "anchorage")]
    for folder in given:
        folder.mkdir()
    point, anchorage = (
        voyage(folder, via, HIGH)
        for folder, via in zip(given, (ANCHORAGE, {"at": ANCHORAGE, "wait": "0min"}), strict=True)
    )
    assert table(anchorage) == table(point)
    (one,), (other,) = (
        [one.plan for one in found.result.results if one.plan is not None]
        for found in (point, anchorage)
    )
    for route, same in zip(one.routes, other.routes, strict=True):
        np.testing.assert_array_equal(same.path, route.path)
        np.testing.assert_array_equal(same.trajectory, route.trajectory)


@pytest.mark.slow
@pytest.mark.usefixtures("plain_report")
def test_a_vessel_leaves_before_its_anchorage_falls_dry(tmp_path: Path) -> None:
    found = voyage(tmp_path, {"at": ON_THE_BAR, "wait": "9h"}, HIGH)
    (choice,) = found.result.departures
    depth = found.result.planned["day"].tidal_depth
    assert depth is not None
    here = shapely.Point(found.result.stops[1:-1][0])
    shut = [area for area in depth.tidal_areas if shapely.dwithin(area.polygon, here, 7.0)]
    assert shut
    dry = min(area.next_hours(0.0)[1] for area in shut)  # type: ignore[index]
    last = (choice.first - HIGH).total_seconds() + choice.departures_s[-1]
    assert 0 <= dry - LATE_S - last <= STEP.total_seconds() + 60
    assert last < WAIT.total_seconds() / 2


def test_the_way_on_has_the_current_and_the_hours_of_its_own_clock() -> None:
    result: RunResult = tidal_run(tide(30), ())
    middle = [119.05, 9.53]
    via = result.scenario.model_validate(
        {**result.scenario.model_dump(exclude_unset=True), "via": [{"at": middle, "wait": "6h"}]}
    )
    area = renew.ShutArea(shapely.box(9e3, 0, 9.1e3, 10), 7200.0, 9000.0)
    anchorage = result.water.projection.to_plane(np.array([middle]))
    case = replace(result.planned["tide"], via=anchorage, areas=(area,))
    fetched = replace(result.fetched, land_key="land", current_keys={"tide": "current"})
    given = Chosen(via, fetched, Artefact("cases", (case,)))
    split = with_onward_legs(given)
    season, onward = split.scenario.seasons
    assert (season.name, onward.name) == ("tide", "tide-onward")
    assert onward.departures is not None
    window = onward.departures.window
    assert timedelta(hours=6) - timedelta(minutes=11) < window <= timedelta(hours=6)
    assert season.departure is not None
    shift = (onward.departures.begin - season.departure).total_seconds()
    assert shift > 0
    first, second = split.case("tide"), split.case("tide-onward")
    np.testing.assert_allclose(
        second.current.velocity(case.start, 600.0),
        first.current.velocity(case.start, shift + 600.0),
        atol=1e-12,
    )
    assert second.areas[0].begin == pytest.approx(7200.0 - shift)
    assert set(split.fetched.current_keys) == {"tide", "tide-onward"}
    assert len(split.fetched.currents) == 2
    np.testing.assert_array_equal(first.goal, anchorage[0])
    np.testing.assert_array_equal(second.start, anchorage[0])
    assert second.follows == "tide"
