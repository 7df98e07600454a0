"""The layers of `routes.gpkg`, and the file around them."""

import json
import math
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely

from pipeline.findings.names import COLUMNS
from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RunResult
from pipeline.formats.gis.geopackage import write_geopackage
from pipeline.formats.passage.waypoints import case_waypoints
from pipeline.formats.records import manifest
from pipeline.model import RouteMetrics, ShoreCrossing, Zone
from tests.pipeline.formats import runs, small_run
from tests.pipeline.formats.gis.cases import BAD_CREDIT, ODD, SCRIPT, badly_named, moved_east
from tests.pipeline.formats.gis.tables import LAYERS, ROUTE_COLUMNS, layer, query, without_routes
from tests.pipeline.results import rows_of, with_measures, with_rows
from tests.true_scale import GEOD
from tests.validators import geopackage_faults


def test_is_a_geopackage_1_3_with_its_layers(package: Path) -> None:
    assert query(package, "PRAGMA application_id") == [(int.from_bytes(b"GPKG", "big"),)]
    assert query(package, "PRAGMA user_version") == [(10300,)]
    assert query(package, "PRAGMA integrity_check") == [("ok",)]
    assert query(package, "PRAGMA foreign_key_check") == []
    assert dict(pyogrio.list_layers(package).tolist()) == {**LAYERS, "layer_styles": None}


def test_every_layer_has_a_description_and_is_in_lon_lat(package: Path) -> None:
    contents = query(
        package, "SELECT table_name, identifier, description, data_type FROM gpkg_contents"
    )
    assert {name: kind for name, _, _, kind in contents} == {
        **dict.fromkeys(LAYERS, "features"),
        "layer_styles": "attributes",
    }
    assert all(title and title != name and len(text) > 20 for name, title, text, _ in contents)
    columns = query(package, "SELECT table_name, column_name, srs_id FROM gpkg_geometry_columns")
    assert set(columns) == {(name, "geom", 4326) for name in LAYERS}
    for name in LAYERS:
        info = query(package, f"PRAGMA table_info({name})")
        assert [row[1] for row in info if row[5]] == ["fid"]
        assert layer(package, name).is_valid.all()


def test_routes_carry_the_evaluation(package: Path, result: RunResult) -> None:
    routes = layer(package, "routes")
    named_otherwise = {"speed_through_water_m_s", "side"}
    assert set(routes.columns) - {"geometry", "current", "caveats"} - named_otherwise == (
        ROUTE_COLUMNS
    )
    assert routes.side.tolist() == [metrics.main_passage for metrics in rows_of(result)]
    speeds = [metrics.speed_m_s for metrics in rows_of(result)]
    assert routes.speed_through_water_m_s.tolist() == speeds
    assert len(routes) == len(rows_of(result)) > 2
    for row, ranked in zip(routes.itertuples(), result.routes, strict=True):
        for column in ROUTE_COLUMNS:
            stated = getattr(ranked if column == "season" else ranked.metrics, column)
            is_blank = isinstance(stated, float) and math.isnan(stated)
            assert is_blank or getattr(row, column) == stated, column
        assert row.current == result.case(row.season).current_text
        assert "planned on " in row.caveats


def test_routes_have_the_length_that_they_state(package: Path) -> None:
    for row in layer(package, "routes").itertuples():
        assert GEOD.geometry_length(row.geometry) == pytest.approx(row.length_m, rel=1e-3)


def test_a_route_drawn_in_degrees_is_the_route_planned(package: Path, result: RunResult) -> None:
    """Points along a planar path are within a metre of the line in the file."""
    for row, ranked in zip(layer(package, "routes").itertuples(), result.routes, strict=True):
        length = ranked.route.length
        path = shapely.segmentize(shapely.LineString(ranked.route.path), length / 3000)
        lonlat = result.water.projection.to_lonlat(shapely.get_coordinates(path))
        off = shapely.distance(shapely.points(lonlat), row.geometry)
        assert off.max() * 111_000 < 1.0


def test_waypoints_lead_from_start_to_goal(package: Path, result: RunResult) -> None:
    """Each leg, followed by course and length, ends at the next waypoint at the time given."""
    waypoints = layer(package, "path_points")
    for ranked in result.routes:
        chosen = (waypoints.season == ranked.season) & (waypoints["rank"] == ranked.rank)
        mine = waypoints[chosen]
        assert mine.sequence.tolist() == list(range(1, len(ranked.route.path) + 1))
        x, y = mine.geometry.x.to_numpy(), mine.geometry.y.to_numpy()
        legs = mine.iloc[:-1]
        lon, lat, _ = GEOD.fwd(x[:-1], y[:-1], legs.course_deg, legs.leg_length_m)
        _, _, off = GEOD.inv(lon, lat, x[1:], y[1:])
        # The planned line is not a geodesic: on 80 km it bends by this much.
        assert np.max(off) < 0.5
        times = mine.time_s.to_numpy()
        assert times[0] == 0
        assert times[-1] == pytest.approx(ranked.metrics.duration_s)
        sailed = np.diff(times) * legs.speed_over_ground_m_s.to_numpy()
        assert sailed == pytest.approx(legs.leg_length_m.to_numpy())
        assert mine.course_deg.isna().tolist() == [False] * len(legs) + [True]


def test_the_passage_is_what_the_bridge_steers(package: Path, result: RunResult) -> None:
    """The waypoints of RTZ and GPX; each leg's area holds it, and is as wide as its limits."""
    passage, legs = layer(package, "passage"), layer(package, "legs")
    for season in ("summer", "winter"):
        for points in case_waypoints(result.case(season)):
            mine, areas = (
                table[(table.season == season) & (table["rank"] == points.ranked.rank)]
                for table in (passage, legs)
            )
            at = np.stack([mine.geometry.x, mine.geometry.y], axis=-1)
            assert at == pytest.approx(points.lonlat)
            assert mine.name.tolist() == list(points.names)
            assert mine.name.tolist()[0] == f"S01-{points.ranked.rank}"
            assert mine.sequence.tolist() == list(range(1, len(at) + 1))
            assert areas.sequence.tolist() == mine.sequence.tolist()[:-1]
            assert areas.port_m.tolist() == points.port_m[:-1].tolist()
            for row, begin, end in zip(areas.itertuples(), at[:-1], at[1:], strict=True):
                wide = row.port_m + row.starboard_m
                found = abs(GEOD.geometry_area_perimeter(row.geometry)[0])
                assert found == pytest.approx(wide * row.leg_length_m, rel=0.01)
                middle = shapely.Point((begin + end) / 2)
                assert row.geometry.distance(middle) < 1e-4


def test_land_goes_on_beyond_the_region(result: RunResult, tmp_path: Path) -> None:
    """A cape that was cut where fetching ends is one with the land around; nothing else moves."""
    cape = shapely.box(119.3, 9.9, 119.5, 10.18)
    island = shapely.box(121.0, 9.0, 121.2, 9.3)
    around = (shapely.box(119.2, 10.0, 119.6, 11.5), island)
    land = replace(result.fetched.land, polygons=(*result.fetched.land.polygons, cape))
    fetched = replace(result.fetched, land=land, surroundings=around)
    write_geopackage(replace(result, fetched=fetched), tmp_path / "routes.gpkg")
    coast = layer(tmp_path / "routes.gpkg", "coast")
    assert len(coast) == len(land.polygons) + 1
    expected = shapely.union_all([*land.polygons, *around])
    assert coast.union_all().symmetric_difference(expected).area < 1e-12
    [edge] = layer(tmp_path / "routes.gpkg", "region").geometry
    region = result.scenario.area
    assert shapely.hausdorff_distance(edge, region.exterior) < 1e-3
    assert edge.is_ring


def test_the_coast_is_the_sources_own(result: RunResult, tmp_path: Path) -> None:
    """Land without shoals and hazards, which are layers of their own."""
    rock = shapely.Point(119.2, 9.2).buffer(0.01)
    zoned = small_run.with_zones(result)
    land = zoned.fetched.land
    zones = (*land.zones, Zone("hazard", "rock", "", rock))
    land = replace(land, zones=zones, polygons=(*land.polygons, rock))
    path = tmp_path / "routes.gpkg"
    write_geopackage(replace(zoned, fetched=replace(zoned.fetched, land=land)), path)
    coast, no_go = layer(path, "coast").union_all(), layer(path, "no_go").union_all()
    (shoal,) = zoned.no_go_water("shoal")
    expected = shapely.union_all(result.fetched.land.polygons).difference(shoal)
    assert coast.symmetric_difference(expected).area < 1e-12
    assert no_go.area > coast.area
    hazards, areas = layer(path, "hazards"), layer(path, "chart_areas")
    assert hazards.name.tolist() == ["rock"]
    assert areas.kind.tolist() == [zone.kind for zone in zoned.fetched.land.zones]


def test_a_following_current_makes_the_leg_faster(package: Path) -> None:
    """Summer sets east at 0.2 to 0.4 m/s: eastward legs are faster than through water."""
    waypoints = layer(package, "path_points")
    east = waypoints[(waypoints.season == "summer") & waypoints.course_deg.between(60, 120)]
    assert len(east) > 0
    assert (east.speed_over_ground_m_s > 1.05).all()


def test_currents_are_the_sources_own(package: Path, result: RunResult) -> None:
    currents = layer(package, "currents")
    for grid in result.fetched.currents:
        mine = currents[currents.season == grid.case]
        assert len(mine) == np.isfinite(grid.u).sum() < grid.u.size
        for row in mine.itertuples():
            j = np.argmin(abs(grid.lat - row.geometry.y))
            i = np.argmin(abs(grid.lon - row.geometry.x))
            assert (row.u, row.v) == (grid.u[0, j, i], grid.v[0, j, i])
            # Towards `direction`, clockwise from north, at `speed`.
            bearing = np.radians(row.direction)
            assert row.speed * np.sin(bearing) == pytest.approx(row.u, abs=1e-12)
            assert row.speed * np.cos(bearing) == pytest.approx(row.v, abs=1e-12)


def test_a_current_given_as_figures_is_sampled(planar_result: RunResult, tmp_path: Path) -> None:
    write_geopackage(planar_result, tmp_path / "routes.gpkg")
    currents = layer(tmp_path / "routes.gpkg", "currents")
    assert currents.speed.max() == pytest.approx(0.5, rel=0.01)
    # One clockwise gyre of 0.5 m/s: north along its left edge, south along its right one.
    x, y = currents.geometry.x, currents.geometry.y
    half_way_up = abs(y - y.mean()) < 1e-9
    for edge, v in ((x.min(), 0.5), (x.max(), -0.5)):
        there = currents[half_way_up & (abs(x - edge) < 1e-9)]
        assert there.v.tolist() == pytest.approx([v])
        assert there.u.tolist() == pytest.approx([0.0], abs=1e-9)


def test_zones_and_channels_fit_the_routes(package: Path, result: RunResult) -> None:
    routes, soft = layer(package, "routes"), layer(package, "soft_no_go")
    channels, no_go = layer(package, "channels"), layer(package, "no_go")
    assert no_go.area.sum() == pytest.approx(sum(p.area for p in result.simplified.polygons))
    assert no_go.vertices.tolist() == [
        len(shapely.get_coordinates(p)) for p in result.simplified.polygons
    ]
    planned = channels[channels["rank"] > 0]
    rejected = channels[channels["rank"] == 0]
    assert rejected.empty or (rejected.rejected_because != "").all()
    for route, zone, channel in zip(routes.geometry, soft.geometry, planned.geometry, strict=True):
        assert not route.intersects(no_go.union_all())
        assert route.intersection(zone).length < 1e-3 * route.length
        assert route.difference(channel.buffer(1e-4)).is_empty
    assert (soft.padding_min_m <= soft.padding_max_m).all()
    # Padding of the paper's vehicle is some metres, at 1:1000 some kilometres.
    assert soft.padding_max_m.between(1_000, 20_000).all()


def test_contingency_points_are_the_trials(package: Path, result: RunResult) -> None:
    points = layer(package, "contingency")
    for ranked in result.routes:
        found = ranked.case.measures.turns[ranked.rank - 1]
        mine = points[(points.season == ranked.season) & (points["rank"] == ranked.rank)]
        assert len(mine) == len(found.points)
        assert mine.collided.sum() == found.collided.sum()
        back = result.water.projection.to_plane(shapely.get_coordinates(mine.geometry))
        assert back == pytest.approx(found.points, abs=1e-6)


def test_land_of_another_shoreline_is_a_layer_with_its_lengths(
    result: RunResult, tmp_path: Path
) -> None:
    summer, winter = (ShoreCrossing(1, 119.4, 9.4, 2461.0), ShoreCrossing(2, 119.5, 9.5, 30.0))
    path = tmp_path / "routes.gpkg"
    crossed = with_measures(result, "summer", shore_crossings=(summer,))
    write_geopackage(with_measures(crossed, "winter", shore_crossings=(winter,)), path)
    found = layer(path, "shore_crossings")
    assert list(found[["season", "rank", "length_m"]].itertuples(index=False, name=None)) == [
        ("summer", 1, 2461.0),
        ("winter", 2, 30.0),
    ]
    assert shapely.get_coordinates(found.geometry) == pytest.approx(
        np.array([[119.4, 9.4], [119.5, 9.5]])
    )


def test_of_very_many_turns_those_that_matter_are_shown(result: RunResult, tmp_path: Path) -> None:
    found, *others = result.case("summer").measures.turns
    points = np.linspace(found.points[0], found.points[-1], 9_001)
    collided = np.zeros(len(points), dtype=bool)
    collided[[7, 8, 9, 4_321, 9_000]] = True
    many = replace(found, points=points, collided=collided)
    path = tmp_path / "routes.gpkg"
    write_geopackage(with_measures(result, "summer", turns=(many, *others)), path)
    shown = layer(path, "contingency")
    shown = shown[(shown.season == "summer") & (shown["rank"] == 1)]
    assert shown.collided.sum() == 5
    assert 1_000 < (~shown.collided).sum() <= 2_000
    gaps = np.hypot(np.diff(shown.geometry.x), np.diff(shown.geometry.y))
    assert gaps.max() < 6 * 1.2 / len(points)


def test_across_180_degrees_layers_are_continuous(result: RunResult, tmp_path: Path) -> None:
    """The fixtures' run, 60.4 degrees further east: so are all layers, otherwise unchanged."""
    ours, theirs = tmp_path / "here.gpkg", tmp_path / "there.gpkg"
    write_geopackage(result, ours)
    write_geopackage(moved_east(result, 60.4), theirs)
    for name in LAYERS:
        here, there = layer(ours, name), layer(theirs, name)
        assert len(here) == len(there)
        shift = np.array([60.4, 0.0, 60.4, 0.0])
        assert there.total_bounds - here.total_bounds == pytest.approx(shift, abs=1e-6)
        assert there.geometry.length.to_numpy() == pytest.approx(
            here.geometry.length.to_numpy(), abs=1e-6
        )
    west, _, east, _ = layer(theirs, "no_go").total_bounds
    assert west < 180 < east


def test_a_failed_season_leaves_the_others(result: RunResult, tmp_path: Path) -> None:
    write_geopackage(small_run.with_a_failed_season(result), tmp_path / "routes.gpkg")
    assert set(layer(tmp_path / "routes.gpkg", "routes").season) == {"summer"}


def test_without_any_route_its_layer_is_empty_and_the_others_that_would_be_are_not_there(
    result: RunResult, tmp_path: Path
) -> None:
    path = tmp_path / "routes.gpkg"
    write_geopackage(without_routes(result), path)
    there = {"routes", "islands", "coast", "region", "no_go", "currents", "layer_styles"}
    assert set(dict(pyogrio.list_layers(path).tolist())) == there
    routes = layer(path, "routes")
    assert len(routes) == 0
    assert set(routes.columns) >= ROUTE_COLUMNS
    assert len(layer(path, "no_go")) == 2


def test_sources_travel_inside_the_file(package: Path, result: RunResult) -> None:
    rows = query(
        package,
        "SELECT mime_type, metadata, reference_scope FROM gpkg_metadata"
        " JOIN gpkg_metadata_reference ON md_file_id = id",
    )
    assert [(mime, scope) for mime, _, scope in rows] == [("application/json", "geopackage")]
    content = json.loads(rows[0][1])
    assert content["land_sources"][0]["text"] == small_run.LAND.text
    assert [s["name"] for s in content["current_sources"]] == ["Test table", "Better source"]
    assert content["notes"] == note_texts(result.fetched.notes)
    # The manifest without the list of files, of which this is one.
    assert set(content) == set(manifest(result, ())) - {"outputs"}
    assert content["scenario_as_run"]["name"] == "small-run"


def test_every_column_has_a_title_and_a_meaning(package: Path) -> None:
    rows = query(
        package, "SELECT table_name, column_name, name, title, description FROM gpkg_data_columns"
    )
    described = {(table, column) for table, column, *_ in rows}
    present = {
        (name, row[1])
        for name in LAYERS
        for row in query(package, f"PRAGMA table_info({name})")
        if row[1] != "geom"
    }
    assert described == present
    for _, column, name, title, meaning in rows:
        # GDAL shows `name`, other readers `title`.
        assert name == title
        assert title not in {"", column}
        assert len(meaning) > 5
    extensions = query(
        package,
        "SELECT table_name, extension_name, definition, scope FROM gpkg_extensions"
        " WHERE table_name LIKE 'gpkg_%'",
    )
    assert {(table, name) for table, name, *_ in extensions} == {
        ("gpkg_metadata", "gpkg_metadata"),
        ("gpkg_metadata_reference", "gpkg_metadata"),
        ("gpkg_data_columns", "gpkg_schema"),
        ("gpkg_data_column_constraints", "gpkg_schema"),
    }
    assert all(scope == "read-write" for *_, scope in extensions)


def test_titles_have_units(package: Path) -> None:
    """Titles of columns that end in a unit, and of the currents' columns, state the unit."""
    titles = dict(query(package, "SELECT column_name, title FROM gpkg_data_columns"))
    for column, title in titles.items():
        for ending, unit in (("_deg", "(° true)"), ("_m_s", "(m/s)"), ("_m", "(m)"), ("_s", "(s)")):
            if column.endswith(ending):
                assert title.endswith(unit), column
                break
    for column in ("u", "v", "speed"):
        assert titles[column].endswith("(m/s)")
    assert titles["direction"].endswith("(° true)")


def test_the_same_run_is_the_same_file(result: RunResult, tmp_path: Path) -> None:
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        write_geopackage(result, tmp_path / folder / "routes.gpkg")
        time.sleep(0.01)  # longer than the resolution of the dates in it
    first, second = sorted(tmp_path.glob("*/routes.gpkg"))
    assert first.read_bytes() == second.read_bytes()


def test_times_are_times_and_columns_without_a_value_are_left_out(
    result: RunResult, package: Path, tmp_path: Path
) -> None:
    """Of a run without a departure there are none; with one a waypoint is passed `time_s` later."""
    left = datetime(2026, 7, 1, 6, tzinfo=UTC)
    seasons = [one.model_copy(update={"departure": left}) for one in result.scenario.seasons]
    scenario = result.scenario.model_copy(update={"seasons": tuple(seasons)})
    write_geopackage(replace(result, scenario=scenario), tmp_path / "routes.gpkg")
    for name in ("passage", "path_points"):
        points = layer(tmp_path / "routes.gpkg", name)
        after = (points.passed_at.dt.tz_convert(UTC) - left).dt.total_seconds()
        assert after.tolist() == pytest.approx(points.time_s.tolist(), abs=0.51)
        assert "passed_at" not in layer(package, name)
    routes = layer(tmp_path / "routes.gpkg", "routes")
    took = (routes.arrival - routes.departure).dt.total_seconds()
    assert took.tolist() == pytest.approx(routes.duration_s.tolist(), abs=0.51)
    for name in LAYERS:
        table = layer(package, name)
        others = [one for one in table.columns.drop("geometry") if not COLUMNS[one].files]
        assert all((table[one].notna() & table[one].ne("")).any() for one in others), name
    assert "name" not in layer(package, "islands")


def test_names_with_a_meaning_in_sql_are_stored_as_text(result: RunResult, tmp_path: Path) -> None:
    path = tmp_path / "routes.gpkg"
    write_geopackage(badly_named(result), path)
    assert set(layer(path, "routes").season) == {SCRIPT, ODD}
    assert set(query(path, "SELECT DISTINCT season FROM currents")) == {(SCRIPT,), (ODD,)}
    assert query(path, "PRAGMA integrity_check") == [("ok",)]
    [(metadata,)] = query(path, "SELECT metadata FROM gpkg_metadata")
    assert json.loads(metadata)["land_sources"][0]["text"] == BAD_CREDIT.text


def test_figures_that_do_not_exist_are_null(result: RunResult, tmp_path: Path) -> None:
    def unknown(_: str, row: RouteMetrics) -> RouteMetrics:
        return replace(row, optimality_gap=float("nan"), clearance_m=float("inf"))

    path = tmp_path / "routes.gpkg"
    write_geopackage(with_rows(result, unknown), path)
    found = query(path, "SELECT DISTINCT optimality_gap, clearance_m FROM routes")
    assert found == [(None, None)]


@pytest.mark.gate_share(1)
@pytest.mark.parametrize(
    "case", ["as it is", "planar", "badly named", "without routes", "without land"]
)
def test_gdals_own_checker_finds_nothing(
    result: RunResult, planar_result: RunResult, tmp_path: Path, case: str
) -> None:
    checked_result = {
        "as it is": lambda: result,
        "planar": lambda: planar_result,
        "badly named": lambda: badly_named(result),
        "without routes": lambda: without_routes(result),
        "without land": lambda: runs.open_sea(),  # noqa: PLW0108 - mypy takes them for one kind
    }[case]()
    package = tmp_path / "routes.gpkg"
    write_geopackage(checked_result, package)
    faults = geopackage_faults(package)
    if faults is None:
        pytest.skip("GDAL's Python samples are not installed (Debian: python3-gdal)")
    assert faults == ""
