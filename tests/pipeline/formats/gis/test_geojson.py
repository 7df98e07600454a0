"""GeoJSON: valid by RFC 7946, with the same routes as the GeoPackage."""

import itertools
import json
import math
from datetime import datetime
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st

from pipeline.findings.result import RunResult
from pipeline.formats.gis.geopackage import bounding_box, write_geojson
from pipeline.formats.gis.layers import FRAMES
from pipeline.formats.passage.waypoints import case_waypoints, split_at_antimeridian
from tests.pipeline.formats import runs


def refused(text: str) -> None:
    raise AssertionError(f"{text} is no JSON")


def written(result: RunResult, path: Path) -> dict[str, Any]:
    write_geojson(result.case(result.results[0].name), path)
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"), parse_constant=refused)
    return content


def of_kind(content: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    return [f for f in content["features"] if f["properties"]["feature"] == kind]


def test_it_is_a_feature_collection_without_a_crs(any_run: RunResult, tmp_path: Path) -> None:
    content = written(any_run, tmp_path / "a.geojson")
    assert content["type"] == "FeatureCollection"
    assert "crs" not in content
    assert len(content["bbox"]) == 4
    for feature in content["features"]:
        assert set(feature) == {"type", "geometry", "properties"}
        assert feature["type"] == "Feature"
        geometry = feature["geometry"]
        for longitude, latitude in shapely.get_coordinates(shapely.geometry.shape(geometry)):
            assert -180 <= longitude <= 180
            assert -90 <= latitude <= 90
            assert round(longitude, 7) == longitude
            assert round(latitude, 7) == latitude


def test_routes_are_those_of_the_geopackage(any_run: RunResult, tmp_path: Path) -> None:
    season = any_run.results[0].name
    frame = FRAMES["routes"](any_run)
    rows = frame[frame.season == season]
    features = of_kind(written(any_run, tmp_path / "a.geojson"), "route")
    assert len(features) == len(rows) > 0
    for feature, (_, row) in zip(features, rows.iterrows(), strict=True):
        for name, expected in row.drop("geometry").items():
            value = feature["properties"][name]
            if isinstance(expected, float) and not math.isfinite(expected):
                assert value is None
            elif isinstance(expected, datetime):
                assert datetime.fromisoformat(value) == expected
            else:
                assert value == expected
        ours = shapely.get_coordinates(shapely.geometry.shape(feature["geometry"]))
        theirs = shapely.get_coordinates(row.geometry)
        if feature["geometry"]["type"] == "LineString":
            assert ours == pytest.approx(theirs, abs=1e-7)


def test_waypoints_have_their_legs(any_run: RunResult, tmp_path: Path) -> None:
    season = any_run.results[0].name
    features = of_kind(written(any_run, tmp_path / "a.geojson"), "waypoint")
    expected = [
        (points.ranked.rank, index + 1, points)
        for points in case_waypoints(any_run.case(season))
        for index in range(len(points.lonlat))
    ]
    assert len(features) == len(expected)
    for feature, (rank, sequence, points) in zip(features, expected, strict=True):
        values = feature["properties"]
        assert feature["geometry"]["type"] == "Point"
        assert (values["season"], values["rank"], values["sequence"]) == (season, rank, sequence)
        last = sequence == len(points.lonlat)
        for name, column in (
            ("course_deg", points.course_deg),
            ("leg_length_m", points.length_m),
            ("port_m", points.port_m),
            ("starboard_m", points.starboard_m),
        ):
            assert values[name] == (None if last else column[sequence - 1])


def test_geopandas_reads_it(any_run: RunResult, tmp_path: Path) -> None:
    path = tmp_path / "a.geojson"
    content = written(any_run, path)
    frame = geopandas.read_file(path)
    assert frame.crs.to_epsg() == 4326
    assert len(frame) == len(content["features"])
    assert frame.geometry.is_valid.all()
    for feature, geometry in zip(content["features"], frame.geometry, strict=True):
        assert shapely.equals(shapely.geometry.shape(feature["geometry"]), geometry)


def test_straight_lines_in_degrees_are_within_a_metre(any_run: RunResult, tmp_path: Path) -> None:
    season = any_run.results[0].name
    features = of_kind(written(any_run, tmp_path / "a.geojson"), "route")
    projection = any_run.water.projection
    for feature, ranked in zip(features, any_run.case(season).routes, strict=True):
        path = shapely.LineString(ranked.route.path)
        for part in shapely.get_parts(shapely.geometry.shape(feature["geometry"])):
            finely = shapely.get_coordinates(shapely.segmentize(part, 0.002))
            turns = np.round((finely[:, 0] - projection.central_longitude) / 360)
            finely[:, 0] -= 360 * turns
            points = shapely.points(projection.to_plane(finely))
            assert shapely.distance(points, path).max() * projection.scale < 1.0


def test_a_route_over_180_degrees_is_cut_there(tmp_path: Path) -> None:
    result = runs.across_180()
    content = written(result, tmp_path / "a.geojson")
    west, south, east, north = content["bbox"]
    # The box begins in the west of the line and ends in the east of it: west is the greater.
    assert west == pytest.approx(178.2)
    assert east == pytest.approx(-178.2)
    assert -19 < south < north < -16
    for feature in of_kind(content, "route"):
        assert feature["geometry"]["type"] == "MultiLineString"
        one, other = feature["geometry"]["coordinates"]
        assert one[-1][0] == 180
        assert other[0][0] == -180
        assert one[-1][1] == other[0][1]
        assert min(point[0] for point in one) > 178
        assert max(point[0] for point in other) < -178
    assert {f["geometry"]["coordinates"][0] > 0 for f in of_kind(content, "waypoint")} == {
        True,
        False,
    }


@pytest.mark.parametrize(
    ("corners", "box"),
    [
        ([[1, 2], [3, 4]], [1, 2, 3, 4]),
        ([[178, -2], [182, 4]], [178, -2, -178, 4]),
        ([[-182, -2], [-178, 4]], [178, -2, -178, 4]),
        ([[175, 0], [180, 1]], [175, 0, 180, 1]),
        ([[180, 0], [185, 1]], [-180, 0, -175, 1]),
        ([[355, 0], [365, 1]], [-5, 0, 5, 1]),
        ([[-10, 60], [400, 90]], [-180, 60, 180, 90]),
    ],
)
def test_boxes(corners: list[list[float]], box: list[float]) -> None:
    assert bounding_box(np.array(corners, dtype=float)) == box


lines = st.lists(
    st.tuples(st.floats(-500, 500), st.floats(-80, 80)), min_size=2, max_size=12, unique=True
).map(np.array)


@given(lines)
def test_parts_lie_within_180_degrees_and_join_up(line: np.ndarray[Any, Any]) -> None:
    parts = split_at_antimeridian(line)
    for part in parts:
        assert (np.abs(part[:, 0]) <= 180).all()
    for one, other in itertools.pairwise(parts):
        # At the cut, or around a part that was dropped for having no length.
        assert abs(one[-1, 0]) == abs(other[0, 0]) == 180
        assert one[-1, 1] == pytest.approx(other[0, 1])
    length = sum(np.linalg.norm(np.diff(part, axis=0), axis=1).sum() for part in parts)
    whole = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    assert length == pytest.approx(whole, rel=1e-9, abs=1e-6)


def test_a_line_that_ends_at_180_degrees_stays_whole() -> None:
    (part,) = split_at_antimeridian(np.array([[179.0, 1.0], [180.0, 2.0]]))
    assert part.tolist() == [[179.0, 1.0], [180.0, 2.0]]
    (part,) = split_at_antimeridian(np.array([[180.0, 1.0], [181.0, 2.0]]))
    assert part.tolist() == [[-180.0, 1.0], [-179.0, 2.0]]


def test_a_line_along_180_degrees_stays_whole() -> None:
    (part,) = split_at_antimeridian(np.array([[180.0, 1.0], [180.0, 2.0]]))
    assert part.tolist() == [[-180.0, 1.0], [-180.0, 2.0]]
