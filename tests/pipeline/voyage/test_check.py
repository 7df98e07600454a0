"""`renew check-route` says of our own files what they say, and of a way over land where it lies."""

import json
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import gpxpy
import numpy as np
import pytest
import shapely
from typer.testing import CliRunner, Result

from pipeline.cli.main import app
from pipeline.errors import RequestError
from pipeline.run import Outcome
from pipeline.voyage.one_line import go
from pipeline.voyage.positions import read_position
from pipeline.voyage.route_file import read_route
from tests.pipeline.results import plain_pages
from tests.pipeline.voyage.waters import FIGURES, GOAL, ISLAND, START, write_tide
from tests.true_scale import GEOD

BEGIN = "2026-11-22T06:00Z"


def write_land(file: Path, islands: dict[str, shapely.Polygon]) -> None:
    named = [
        {"type": "Feature", "properties": {"name": name}, "geometry": shapely.geometry.mapping(at)}
        for name, at in islands.items()
    ]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": named}))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("check")
    write_land(made / "land.geojson", {"Isla Sola": ISLAND})
    write_tide(made / "tide.nc")
    return made


@pytest.fixture(scope="module")
def planned(folder: Path) -> Outcome:
    with plain_pages():
        return go(
            START, GOAL, **FIGURES, depart=datetime.fromisoformat(BEGIN),
            charts=folder / "land.geojson",
            currents=(folder / "tide.nc",), output=folder / "out", name="tide",
        )  # fmt: skip


def checked(folder: Path, file: Path, *more: str) -> Result:
    words = [
        "check-route", str(file), "--speed", "8kn", "--length", "12m", "--turning-circle", "40m",
        *([] if "--charts" in more else ["--charts", str(folder / "land.geojson")]),
        "--currents", str(folder / "tide.nc"), "--output", str(folder / "out"), "--quiet", *more,
    ]  # fmt: skip
    return CliRunner().invoke(app, words)


def answer(folder: Path, file: Path, *more: str) -> dict[str, Any]:
    found = checked(folder, file, "--json", *more)
    assert found.exit_code in (0, 1), found.stderr
    (season,) = json.loads(found.stdout)["seasons"]
    return dict(season)


def test_our_own_path_costs_what_was_planned(folder: Path, planned: Outcome) -> None:
    file = next(planned.directory.glob("*.geojson"))
    found = answer(folder, file, "--depart", BEGIN)
    best = planned.result.routes[0].metrics
    assert found["fuel"] == pytest.approx(best.fuel, rel=1e-6)
    assert found["duration_s"] == pytest.approx(best.duration_s, abs=1.0)
    assert found["length_m"] == pytest.approx(best.length_m, rel=1e-6)
    assert found["clearance_m"] == pytest.approx(best.clearance_m, abs=0.1)
    assert (found["crosses"], found["turns_meet_land_from"]) == ([], [])
    for beside in ("same_side", "best"):
        assert abs(found[beside]["fuel_more_share"]) < 1e-3
    assert found["way"] == found["best"]["way"] == best.way == "south of Isla Sola"


@pytest.mark.slow
def test_ways_have_the_names_that_they_have_in_a_plan(folder: Path, tmp_path: Path) -> None:
    north, south = (shapely.box(-40.005, y, -39.995, y + 0.012) for y in (34.996, 34.976))
    write_land(tmp_path / "land.geojson", {"Isla Norte": north, "Isla Sur": south})
    more = ["--charts", str(tmp_path / "land.geojson"), "--depart", BEGIN]
    planned = go(
        START, GOAL, **FIGURES, depart=datetime.fromisoformat(BEGIN), charts=more[1],
        currents=(folder / "tide.nc",), output=tmp_path / "out", name="two",
    )  # fmt: skip
    found = answer(folder, next(planned.directory.glob("*.geojson")), *more)
    assert found["best"]["way"] == planned.result.routes[0].metrics.way
    assert all(name in found["best"]["way"] for name in ("Isla Norte", "Isla Sur"))


def test_a_route_that_ends_where_it_begins_has_its_farthest_point_as_a_stop(tmp_path: Path) -> None:
    places = [[179.5, 60.0], [-179.9, 60.0], [180.2, 60.2], [179.5, 60.0]]
    (tmp_path / "a.geojson").write_text(json.dumps({"type": "LineString", "coordinates": places}))
    home = "60.00000000N 179.50000000E"
    via = ["60.20000000N 179.80000000W"]
    assert read_route(tmp_path / "a.geojson").stops == {"start": home, "via": via, "goal": home}


@pytest.mark.slow
def test_a_round_trip_is_checked_beside_one_through_its_farthest_point(
    folder: Path, tmp_path: Path
) -> None:
    there = [START, (-40.0, 34.97), GOAL]
    line = shapely.to_geojson(shapely.LineString([*there, *there[1::-1]]))
    (tmp_path / "a.geojson").write_text(line)
    result = checked(folder, tmp_path / "a.geojson", "--depart", BEGIN, "--json")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    (season,) = found["seasons"]
    assert season["length_m"] > 2 * GEOD.inv(*START, *GOAL)[2]
    assert 0 <= season["best"]["fuel_more_share"] < 0.1
    assert any("it ends where it begins" in one for one in found["decided"])


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("kind", ["gpx", "rtz"])
def test_times_of_our_own_legs_are_those_that_the_file_states(
    folder: Path, planned: Outcome, kind: str
) -> None:
    file = next(one for one in planned.directory.glob(f"*.{kind}") if "-all" not in one.name)
    found = answer(folder, file)  # it leaves when the file says
    assert len(found["points"]) > 2
    for point in found["points"]:
        passed, stated = (datetime.fromisoformat(point[key]) for key in ("passed", "stated"))
        assert abs((passed - stated).total_seconds()) <= 1.0
    table = checked(folder, file).stdout
    assert "+0 s" in table
    assert "W02-1" in table


def test_a_way_across_the_island_is_named_with_place_and_metres(
    folder: Path, planned: Outcome, tmp_path: Path
) -> None:
    assert planned.fresh is not None
    gpx = gpxpy.gpx.GPX()
    gpx.routes.append(gpxpy.gpx.GPXRoute(name="straight"))
    for lon, lat in (START, GOAL):
        gpx.routes[0].points.append(gpxpy.gpx.GPXRoutePoint(lat, lon))
    file = tmp_path / "straight.gpx"
    file.write_text(gpx.to_xml())
    result = checked(folder, file, "--depart", BEGIN)
    assert result.exit_code == 1
    assert "OVER LAND: 1.83 km of Isla Sola at 40.0000 W 35.0000 N" in result.stdout
    found = answer(folder, file, "--depart", BEGIN)
    (land,) = found["crosses"]
    # On the parallel of 35 degrees, that is a loxodrome.
    west, south, east, north = ISLAND.bounds
    assert south < START[1] < north
    at = np.linspace(west, east, 200)
    assert land["length_m"] == pytest.approx(GEOD.line_length(at, np.full(200, START[1])), rel=1e-4)
    assert (land["place"]["lon"], land["place"]["lat"]) == pytest.approx((-40.0, 35.0), abs=1e-4)
    assert found["nearest"] is None
    assert found["turns_meet_land_from"]
    assert found["best"]["fuel"] > 0
    assert found["same_side"] is None
    assert "of its side" not in result.stdout
    assert re.findall(r"\(route (\d)\)", result.stdout) == ["1", "2"], "as notes call them"


def test_a_way_through_a_shut_area_says_so(folder: Path, planned: Outcome, tmp_path: Path) -> None:
    south = shapely.box(-40.005, 34.96, -39.995, 34.99)
    (tmp_path / "shut.geojson").write_text(shapely.to_geojson(south))
    file = next(planned.directory.glob("*.geojson"))
    found = checked(folder, file, "--depart", BEGIN, "--avoid", str(tmp_path / "shut.geojson"))
    assert found.exit_code == 1
    assert "SHUT: it enters" in found.stdout
    assert "always shut" in found.stdout


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("none.gpx", None, "does not exist"),
        ("a.gpx", "<gpx", "is damaged"),
        ("a.gpx", "<gpx version='1.1'><wpt lat='1' lon='2'/></gpx>", "no route, track or line"),
        ("a.kml", "<kml/>", "no route, track or line"),
        ("a.json", "[" * 100_000, "nested too deep"),
        ("a.json", '{"type": "Point", "coordinates": [1, 2]}', "no route, track or line"),
        (
            "a.json",
            '{"type": "LineString", "coordinates": [[1, 2], [1, 95]]}',
            "latitude 95, which is not on earth: give degrees",
        ),
        ("a.json", '{"type": "LineString", "coordinates": [[1, 2], [1, 2]]}', "all at one place"),
        ("a.json", '{"type": "LineString", "coordinates": [[1, "x"], [1, 2]]}', "is damaged"),
        ("a.json", '{"type": "LineString", "coordinates": [[1], [2]]}', "is damaged"),
        ("a.json", f'{{"type": "LineString", "coordinates": [[1{"0" * 400}, 2]]}}', "is damaged"),
        ("a.rtz", "<route><waypoints><waypoint/></waypoints></route>", "is damaged"),
    ],
)
def test_what_is_no_route_says_why(
    tmp_path: Path, name: str, content: str | None, why: str
) -> None:
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(RequestError, match=f"^FILE: .*{name} .*{why}"):
        read_route(tmp_path / name)


@pytest.mark.slow
def test_a_route_on_which_the_currents_end_is_not_checked(folder: Path, planned: Outcome) -> None:
    file = next(planned.directory.glob("*.geojson"))
    result = checked(folder, file, "--depart", "2026-11-23T10:50Z")
    assert result.exit_code == 2
    assert "FILE: the currents end at 2026-11-23 11:00 UTC, and the route at" in result.stderr


def test_a_season_that_could_not_be_checked_is_named_and_counts(
    folder: Path, planned: Outcome
) -> None:
    file = next(planned.directory.glob("*.geojson"))
    result = checked(folder, file, "--month", "2026-11", "--month", "2026-12")
    assert "2026-12' was not checked" in result.stdout
    assert result.exit_code == 1


def test_four_places_on_land_are_three_and_one_more(folder: Path, tmp_path: Path) -> None:
    (west, lat), (east, _) = START, GOAL
    step = (east - west) / 9
    boxes = [shapely.box(west + at * step, lat - 0.01, west + (at + 1) * step, lat + 0.01)
             for at in (1, 3, 5, 7)]  # fmt: skip
    write_land(tmp_path / "four.geojson", {str(at): one for at, one in enumerate(boxes)})
    (file := tmp_path / "a.geojson").write_text(
        shapely.to_geojson(shapely.LineString([START, GOAL]))
    )
    charts = ("--charts", str(tmp_path / "four.geojson"))
    lines = checked(folder, file, "--depart", BEGIN, *charts).stdout.splitlines()
    over = [line for line in lines if line.startswith("OVER LAND")]
    assert over[3:] == ["OVER LAND at 1 more place"]


def test_what_a_source_does_not_cover_is_told(folder: Path, planned: Outcome) -> None:
    """Here that some hours stand for a month, as a plan tells it."""
    file = next(planned.directory.glob("*.geojson"))
    printed = checked(folder, file, "--month", "2026-11").stdout
    (told,) = (line for line in printed.splitlines() if " time steps stand for all of " in line)
    found = json.loads(checked(folder, file, "--month", "2026-11", "--json").stdout)
    assert told.removeprefix("- ") in found["notes"]
    lines = [line for line in printed.splitlines() if line.startswith("- ")]
    assert len(lines) == len({*lines})


def test_the_times_of_a_track_are_those_that_the_file_states(tmp_path: Path) -> None:
    points = (
        f"<trkpt lat='-17' lon='{lon}'><time>2026-11-22T0{lon - 170}:00:00{zone}</time></trkpt>"
        for lon, zone in ((176, "Z"), (177, ""), (178, "+01:00"))
    )
    (tmp_path / "a.gpx").write_text(
        f"<gpx version='1.1'><trk><trkseg>{''.join(points)}</trkseg></trk></gpx>"
    )
    route = read_route(tmp_path / "a.gpx")
    assert [point.time for point in route.points] == [
        datetime(2026, 11, 22, hour, tzinfo=UTC) for hour in (6, 7, 7)
    ]
    assert route.points[-1].curve is None


@pytest.mark.parametrize("lat", [-89.5, -17.0, 0.0, 60.25])
@pytest.mark.parametrize("lon", [-179.5, -30.0, 0.0, 150.0, 190.0])
def test_the_ends_of_a_route_are_read_as_they_are(tmp_path: Path, lon: float, lat: float) -> None:
    places = [(lon, lat), (lon + 0.5, lat + 0.5)]
    line = shapely.to_geojson(shapely.LineString(places))
    (tmp_path / "a.geojson").write_text(line)
    stops = read_route(tmp_path / "a.geojson").stops
    assert stops["via"] == []
    for end, (x, y) in zip(("start", "goal"), places, strict=True):
        read = read_position(stops[end])
        assert ((read.lon - x) % 360, read.lat) == (0, y)


def test_a_line_across_180_degrees_is_one(tmp_path: Path) -> None:
    (tmp_path / "a.geojson").write_text(
        '{"type": "MultiLineString", "coordinates": [[[179, 1], [180, 2]], [[-180, 2], [-179, 3]]]}'
    )
    route = read_route(tmp_path / "a.geojson")
    assert route.lonlat[:, 0] == pytest.approx([179, 180, 181])
    ends = {"start": "1.00000000N 179.00000000E", "goal": "3.00000000N 179.00000000W"}
    assert route.stops == {**ends, "via": []}
    assert route.joined_m == 0


@pytest.mark.parametrize("form", ["geojson", "gpx"])
def test_parts_that_do_not_meet_are_joined_and_that_is_said(
    folder: Path, tmp_path: Path, form: str
) -> None:
    (west, south), (east, _) = START, GOAL
    north = south + 0.05
    parts = [[(west, south), (west, north)], [(east, north), GOAL]]
    segments = ("".join(f"<trkpt lon='{lon}' lat='{lat}'/>" for lon, lat in part) for part in parts)
    (file := tmp_path / f"a.{form}").write_text(
        shapely.to_geojson(shapely.MultiLineString(parts))
        if form == "geojson"
        else f"<gpx><trk><trkseg>{'</trkseg><trkseg>'.join(segments)}</trkseg></trk></gpx>"
    )
    far_m = GEOD.inv(west, north, east, north)[2]
    assert read_route(file).joined_m == pytest.approx(far_m)
    result = checked(folder, file, "--depart", BEGIN)
    told = f"- its parts were joined by straight lines of up to {far_m / 1000:.2f} km\n"
    assert told in result.stdout


def test_a_range_of_speeds_is_refused_with_what_can_be_given(tmp_path: Path) -> None:
    (tmp_path / "a.geojson").write_text(shapely.to_geojson(shapely.LineString([START, GOAL])))
    result = checked(tmp_path, tmp_path / "a.geojson", "--speed", "4kn..8kn")
    assert (result.exit_code, "--arrive-by" in result.stderr) == (2, False)
    assert "checked at one speed; give one, as 12kn" in result.stderr


def test_legs_of_an_rtz_without_a_geometry_have_that_of_its_default_waypoint(
    tmp_path: Path,
) -> None:
    places = ((45.0, -50.0), (45.0, -10.0), (45.0, -9.0))
    own = ("", "", '<leg geometryType="Loxodrome"/>')
    points = (
        f'<waypoint id="{i}"><position lat="{lat}" lon="{lon}"/>{leg}</waypoint>'
        for i, ((lat, lon), leg) in enumerate(zip(places, own, strict=True))
    )
    (tmp_path / "a.rtz").write_text(
        '<route xmlns="http://www.cirm.org/RTZ/1/2" version="1.2"><routeInfo routeName="a"/>'
        '<waypoints><defaultWaypoint><leg geometryType="Orthodrome"/></defaultWaypoint>'
        f"{''.join(points)}</waypoints></route>"
    )
    line, at = read_route(tmp_path / "a.rtz").drawn
    ((_, north),) = GEOD.npts(-50, 45, -10, 45, 1)
    assert line[: at[1], 1].max() == pytest.approx(north, abs=1e-3)
    assert line[at[1] :, 1] == pytest.approx(45.0)
