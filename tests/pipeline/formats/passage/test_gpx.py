"""GPX: what gpxpy and GDAL read back, and the order of elements that GPX 1.1 wants."""

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeAlias

import gpxpy
import numpy as np
import pyogrio
import pytest
import shapely
from lxml import etree

from pipeline.findings.result import RunResult
from pipeline.findings.route_profile import planned_times
from pipeline.formats.passage.routes import write_gpx
from pipeline.formats.passage.waypoints import both_sides, case_waypoints
from tests.pipeline.formats import runs, small_run
from tests.true_scale import GEOD

Element: TypeAlias = Any  # lxml has no types
DEPARTURE = datetime(2026, 12, 31, 20, 30, tzinfo=UTC)
NAMESPACE = "{http://www.topografix.com/GPX/1/1}"
OPENCPN = "{http://www.opencpn.org}"
# The children that GPX 1.1 allows, in its order.
POINT = "ele time magvar geoidheight name cmt desc src link sym type fix sat hdop vdop pdop "
ORDER = {
    "gpx": "metadata wpt rte trk extensions",
    "metadata": "name desc author copyright link time keywords bounds extensions",
    "author": "name email link",
    "copyright": "year license",
    "rte": "name cmt desc src link number type extensions rtept",
    "trk": "name cmt desc src link number type extensions trkseg",
    "trkseg": "trkpt extensions",
    "rtept": POINT + "ageofdgpsdata dgpsid extensions",
    "trkpt": POINT + "ageofdgpsdata dgpsid extensions",
}


def written(
    result: RunResult, path: Path, *, departure: datetime | None = None, every: bool = True
) -> gpxpy.gpx.GPX:
    write_gpx(result.case(result.results[0].name), path, departure=departure, every=every)
    return gpxpy.parse(path.read_text(encoding="utf-8"))


def check_order(root: Element) -> None:
    """Check that all elements and attributes are of GPX 1.1, and the elements in its order."""
    assert root.tag == f"{NAMESPACE}gpx"
    assert root.get("version") == "1.1"
    assert root.get("creator")
    for element in root.iter(f"{NAMESPACE}*"):
        if element.tag == f"{NAMESPACE}extensions":
            assert all(not child.tag.startswith(NAMESPACE) for child in element)
            continue
        name = element.tag.removeprefix(NAMESPACE)
        order = ORDER.get(name, "").split()
        places = [order.index(child.tag.removeprefix(NAMESPACE)) for child in element]
        assert places == sorted(places)
        if name in {"rtept", "trkpt"}:
            assert set(element.attrib) == {"lat", "lon"}
            assert -90 <= float(element.get("lat")) <= 90
            assert -180 <= float(element.get("lon")) < 180
            assert "e" not in element.get("lat") + element.get("lon")


@pytest.mark.gate_share(6)
@pytest.mark.parametrize("departure", [None, DEPARTURE])
def test_the_structure_is_that_of_gpx_1_1(
    any_run: RunResult, tmp_path: Path, departure: datetime | None
) -> None:
    path = tmp_path / "a.gpx"
    written(any_run, path, departure=departure)
    check_order(etree.parse(path).getroot())


def test_gpxpy_reads_every_route_with_its_waypoints(any_run: RunResult, tmp_path: Path) -> None:
    gpx = written(any_run, tmp_path / "a.gpx")
    season = any_run.results[0].name
    found = case_waypoints(any_run.case(season))
    assert [route.number for route in gpx.routes] == [p.ranked.rank for p in found]
    for route, points in zip(gpx.routes, found, strict=True):
        words = (route.name or "").split()
        assert season in words
        assert points.ranked.rank == int(words[words.index(season) + 1])
        assert (route.name or "").endswith(points.ranked.metrics.main_side)
        at = np.array([[p.longitude, p.latitude] for p in route.points])
        apart = at - points.lonlat
        apart[:, 0] = (apart[:, 0] + 180) % 360 - 180
        assert np.abs(apart).max() < 2e-8
        assert route.points[0].name == f"S01-{points.ranked.rank}"
        assert tuple(point.name for point in route.points) == points.names
        assert (route.points[-1].description or "").startswith(f"{route.name}: ")
        assert f"course {points.course_deg[0]:05.1f}°" in (route.points[0].description or "")


def test_a_plotters_list_is_in_order_and_no_two_points_have_one_name(
    any_run: RunResult, tmp_path: Path
) -> None:
    gpx = written(any_run, tmp_path / "a.gpx")
    names = [route.name or "" for route in gpx.routes]
    assert names == sorted(set(names))
    points = [point.name for route in gpx.routes for point in route.points]
    assert len(set(points)) == len(points)


def test_the_usual_file_has_the_best_of_each_side(any_run: RunResult, tmp_path: Path) -> None:
    gpx = written(any_run, tmp_path / "a.gpx", every=False)
    found = both_sides(any_run.case(any_run.results[0].name))
    assert [route.number for route in gpx.routes] == [p.ranked.rank for p in found]
    assert found[0].ranked.rank == 1
    first, *others = (
        p.ranked.metrics for p in case_waypoints(any_run.case(found[0].ranked.season))
    )
    elsewhere = [row for row in others if row.main_passage != first.main_passage]
    if elsewhere:
        assert [p.ranked.metrics for p in found[1:]] == [min(elsewhere, key=lambda r: r.fuel)]
    else:
        assert len(found) == 1


def test_names_tell_a_person_what_a_route_is(tmp_path: Path) -> None:
    gpx = written(small_run.parts(), tmp_path / "a.gpx")
    names = {"Small run summer 1 south", "Small run summer 1 north"}
    assert gpx.routes[0].name in names


@pytest.mark.parametrize("departure", [None, DEPARTURE])
def test_gpx_gives_opencpn_speeds_and_departure(
    any_run: RunResult, tmp_path: Path, departure: datetime | None
) -> None:
    """As OpenCPN 5.10 shows them: each waypoint's speed is that of the leg which leads to it."""
    path = tmp_path / "a.gpx"
    written(any_run, path, departure=departure)
    found = case_waypoints(any_run.case(any_run.results[0].name))
    for route, points in zip(etree.parse(path).iter(f"{NAMESPACE}rte"), found, strict=True):
        extensions = {child.tag.removeprefix(OPENCPN): child.text for child in route[3]}
        assert (extensions["start"], extensions["end"]) == (points.names[0], points.names[-1])
        hours = points.time_s[-1] / 3600
        assert float(extensions["planned_speed"]) * hours * 1852 == pytest.approx(
            points.length_m[:-1].sum(), rel=1e-4
        )
        assert extensions.get("planned_departure") == (departure and "2026-12-31T20:30:00Z")
        speeds = [
            None if (rte := point.find(f".//{OPENCPN}rte_properties")) is None else rte.attrib
            for point in route.findall(f"{NAMESPACE}rtept")
        ]
        assert speeds[0] is None
        legs = points.length_m[:-1] / 1852
        knots = [float(speed["planned_speed"]) for speed in speeds[1:] if speed]
        passage = sum(legs / knots)
        assert passage == pytest.approx(hours, rel=1e-4)


@pytest.mark.usefixtures("every_driver")
def test_gdal_reads_it(any_run: RunResult, tmp_path: Path) -> None:
    path = tmp_path / "a.gpx"
    gpx = written(any_run, path)
    assert {"routes", "tracks"} <= {name for name, _ in pyogrio.list_layers(path)}
    routes = pyogrio.read_dataframe(path, layer="routes")
    assert len(routes) == len(gpx.routes)
    assert list(routes["number"]) == [route.number for route in gpx.routes]
    for line, route in zip(routes.geometry, gpx.routes, strict=True):
        assert shapely.get_coordinates(line) == pytest.approx(
            np.array([[p.longitude, p.latitude] for p in route.points])
        )
    assert len(pyogrio.read_dataframe(path, layer="tracks")) == 1


def test_the_track_is_the_best_route_as_planned(any_run: RunResult, tmp_path: Path) -> None:
    gpx = written(any_run, tmp_path / "a.gpx")
    (track,) = gpx.tracks
    (segment,) = track.segments
    best = case_waypoints(any_run.case(any_run.results[0].name))[0].ranked
    at = np.array([[p.longitude, p.latitude] for p in segment.points])
    at[:, 0] = at[0, 0] + (at[:, 0] - at[0, 0] + 180) % 360 - 180
    plane = shapely.LineString(any_run.water.projection.to_plane(at))
    # 0.2 m at true scale.
    near = 0.2 / any_run.water.projection.scale
    assert shapely.hausdorff_distance(plane, shapely.LineString(best.route.path)) < near
    assert GEOD.line_length(at[:, 0], at[:, 1]) == pytest.approx(best.metrics.length_m, rel=1e-5)


def test_times_run_from_departure_to_arrival(any_run: RunResult, tmp_path: Path) -> None:
    gpx = written(any_run, tmp_path / "a.gpx", departure=DEPARTURE)
    found = case_waypoints(any_run.case(any_run.results[0].name))
    chains = [route.points for route in gpx.routes] + [gpx.tracks[0].segments[0].points]
    durations = [*[p.time_s[-1] for p in found], found[0].ranked.metrics.duration_s]
    for chain, duration in zip(chains, durations, strict=True):
        times = [point.time for point in chain if point.time is not None]
        assert len(times) == len(chain)
        assert times == sorted(times)
        assert times[0] == DEPARTURE
        assert (times[-1] - DEPARTURE).total_seconds() == pytest.approx(duration, abs=1)


def test_the_track_passes_each_vertex_when_the_plan_does(
    any_run: RunResult, tmp_path: Path
) -> None:
    gpx = written(any_run, tmp_path / "a.gpx", departure=DEPARTURE)
    best = case_waypoints(any_run.case(any_run.results[0].name))[0].ranked
    points = gpx.tracks[0].segments[0].points
    at = np.array([[p.longitude, p.latitude] for p in points])
    seconds = [(p.time - DEPARTURE).total_seconds() for p in points if p.time is not None]
    path = any_run.water.projection.to_lonlat(best.route.path)
    for place, time in zip(path, planned_times(best), strict=True):
        apart = at - place
        apart[:, 0] = (apart[:, 0] + 180) % 360 - 180
        nearest = int(np.abs(apart).max(axis=1).argmin())
        assert np.abs(apart[nearest]).max() < 2e-8
        assert seconds[nearest] == pytest.approx(time, abs=1)


def test_without_a_departure_no_point_has_a_time(any_run: RunResult, tmp_path: Path) -> None:
    path = tmp_path / "a.gpx"
    gpx = written(any_run, path)
    assert gpx.time == any_run.created
    root = etree.parse(path).getroot()
    assert len(root.findall(f".//{NAMESPACE}time")) == 1


def test_without_land_no_clearance_is_stated(tmp_path: Path) -> None:
    (route,) = written(runs.open_sea(), tmp_path / "a.gpx").routes
    assert re.match(r"[\d.]+ km, [\d.]+ h\. No depths in this chart", route.description or "")
