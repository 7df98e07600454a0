"""Waypoints: fewer than the path has, and every leg as safe as the plan."""

import itertools
from collections.abc import Iterator

import networkx as nx
import numpy as np
import pytest
import shapely
from shapely.geometry.base import BaseGeometry

import renew
from pipeline.findings.result import RunResult
from pipeline.formats.passage.safe_corridor import Obstacles, safe_corridor
from pipeline.formats.passage.waypoints import (
    MAX_CROSS_TRACK_M,
    MAX_EXTRA_FUEL,
    Waypoints,
    case_waypoints,
    waypoints,
)
from tests.pipeline.formats import oracles, runs
from tests.true_scale import GEOD


def every(result: RunResult) -> Iterator[Waypoints]:
    for entry in result.results:
        yield from case_waypoints(result.case(entry.name))


def inner_legs(points: Waypoints) -> range:
    """Legs that have to be outside V: not those in it at a start or a goal."""
    route, count = points.ranked.route, len(points.lonlat) - 1
    inside = shapely.intersects(
        route.soft_no_go,
        shapely.linestrings(np.stack([route.path[:-1], route.path[1:]], axis=1)),
    )
    # A leg in V gets at most one waypoint more: where it leaves.
    skipped = int(np.argmin(inside)), int(np.argmin(inside[::-1]))
    return range(skipped[0], count - skipped[1])


def blocked_area(points: Waypoints, result: RunResult) -> BaseGeometry:
    return shapely.union_all([points.ranked.route.soft_no_go, *result.water.land])


def test_legs_as_sailed_are_clear_of_land_and_of_v(any_run: RunResult) -> None:
    land = shapely.union_all(any_run.water.land)
    for points in every(any_run):
        lines = [oracles.in_plane(any_run, line) for line in oracles.drawn(points)]
        assert not shapely.intersects(lines, land).any()
        inner = [lines[leg] for leg in inner_legs(points)]
        # Corners may be rounded in V beside a goal inside it.
        assert len(inner) >= len(lines) - 8
        assert not shapely.intersects(inner, points.ranked.route.soft_no_go).any()


def test_only_a_route_that_begins_in_v_has_legs_in_it(any_run: RunResult) -> None:
    for points in every(any_run):
        route = points.ranked.route
        legs, count = inner_legs(points), len(points.lonlat) - 1
        assert (legs.start > 0) == route.starts_in_soft_no_go
        assert (legs.stop < count) == route.ends_in_soft_no_go


def test_waypoints_begin_at_the_start_and_end_at_the_goal(any_run: RunResult) -> None:
    ends = np.array([any_run.scenario.start, any_run.scenario.goal])
    for points in every(any_run):
        assert np.abs(points.lonlat[[0, -1]] - ends).max() <= 1e-8


def test_legs_stay_near_the_planned_line(any_run: RunResult) -> None:
    for points in every(any_run):
        path = shapely.LineString(points.ranked.route.path)
        line = shapely.union_all(
            [oracles.in_plane(any_run, leg) for leg in oracles.drawn(points, 1000.0)]
        )
        # One percent for the drawing error of the legs; on a short route 30 m are near.
        tolerance = max(1e-3 * points.ranked.route.length, 30.0 / any_run.water.projection.scale)
        nearness = 1.01 * min(tolerance, 1e-2 * points.ranked.route.length)
        assert shapely.covers(path.buffer(nearness), line)
        assert shapely.covers(line.buffer(2 * nearness), path)


def test_nothing_lies_between_the_legs_and_the_planned_line(any_run: RunResult) -> None:
    land = shapely.union_all([*any_run.water.land, *any_run.water.chart.no_go])
    for points in every(any_run):
        legs = [oracles.in_plane(any_run, leg) for leg in oracles.drawn(points)]
        both = shapely.union_all([shapely.LineString(points.ranked.route.path), *legs])
        between = shapely.get_parts(shapely.polygonize([both]))
        islands = shapely.get_parts(land)
        inside = shapely.STRtree(between).query(
            shapely.point_on_surface(islands), predicate="within"
        )
        assert inside.shape[1] == 0


def test_the_thinned_route_needs_at_most_the_allowed_extra_fuel(any_run: RunResult) -> None:
    for points in every(any_run):
        line = np.vstack([leg[:-1] for leg in oracles.drawn(points, 500.0)] + [points.lonlat[-1:]])
        case, route = points.ranked.case.case, points.ranked.route
        planar = case.projection.to_plane(line)
        middles = shapely.points((planar[:-1] + planar[1:]) / 2)
        own = shapely.linestrings(np.stack([route.path[:-1], route.path[1:]], axis=1))
        needed = renew.fuel(
            planar,
            case.current,
            case.vessel,
            drift=any_run.scenario.planner.drift,
            speeds=route.speeds[shapely.distance(middles[:, None], own).argmin(axis=1)],
        )
        assert needed <= (1 + 1.01 * MAX_EXTRA_FUEL) * points.ranked.route.fuel


def test_finer_tolerances_are_tried_until_the_fuel_is_near_enough(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    result = runs.random_run(1)
    case = result.planned[runs.SEASON]
    (usual, *_), obstacles = case_waypoints(result.case(runs.SEASON)), Obstacles(case)
    monkeypatch.setattr("pipeline.formats.passage.waypoints.MAX_EXTRA_FUEL", 3e-5)
    finer = waypoints(usual.ranked, obstacles)
    assert len(finer.lonlat) > len(usual.lonlat)
    line = np.vstack([leg[:-1] for leg in oracles.drawn(finer, 500.0)] + [finer.lonlat[-1:]])
    needed = renew.fuel(case.projection.to_plane(line), case.current, case.vessel)
    assert needed <= (1 + 3.5e-5) * usual.ranked.route.fuel


def test_corridors_end_at_the_edge_of_the_chart() -> None:
    result = runs.along_the_edge()
    obstacles = Obstacles(result.planned[runs.SEASON])
    for ranked in result.routes:
        corridor = safe_corridor(ranked.route, obstacles, 1e-3 * ranked.route.length)
        assert shapely.covers(result.water.chart.extent, corridor.free)


def test_a_long_path_becomes_a_fraction_of_its_vertices(any_run: RunResult) -> None:
    for points in every(any_run):
        planned = len(points.ranked.route.path)
        thinned = len(points.lonlat)
        # Two more where the path leaves and enters V.
        assert thinned <= planned + 2
        if planned > 50:
            assert thinned < 0.6 * planned


def test_without_weight_of_clearance_no_chain_of_own_vertices_has_fewer_legs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pipeline.formats.passage.thinning._CLEARANCE_WEIGHT", 0.0)
    result = runs.random_run(2)
    obstacles = Obstacles(result.planned[runs.SEASON])
    for ranked in result.routes:
        points, route = waypoints(ranked, obstacles), ranked.route
        corridor = safe_corridor(route, obstacles, 1e-3 * route.length)
        lonlat = result.water.projection.to_lonlat(route.path)
        own = nx.path_graph(len(route.path))
        for one, other in itertools.combinations(range(len(route.path)), 2):
            leg = oracles.in_plane(result, oracles.loxodrome(lonlat[one], lonlat[other], 50))
            if shapely.covers(corridor.free, leg):
                own.add_edge(one, other)
        fewest = nx.shortest_path_length(own, 0, len(route.path) - 1)
        assert len(points.lonlat) - 1 <= fewest


def test_the_figures_of_legs_are_true(any_run: RunResult) -> None:
    for points in every(any_run):
        for leg, line in enumerate(oracles.drawn(points)):
            length = GEOD.line_length(line[:, 0], line[:, 1])
            assert points.length_m[leg] == pytest.approx(length, rel=1e-6)
            course = GEOD.inv(*line[0], *line[1])[0] % 360
            apart = (points.course_deg[leg] - course + 180) % 360 - 180
            assert abs(apart) < 0.01
        passage = np.diff(points.time_s)
        assert points.speed_m_s[:-1] * passage == pytest.approx(points.length_m[:-1])
        for column in (points.course_deg, points.length_m, points.speed_m_s, points.port_m):
            assert np.isfinite(column[:-1]).all()
            assert np.isnan(column[-1])


def test_the_corridor_beside_each_leg_is_free(any_run: RunResult) -> None:
    extent = any_run.water.chart.extent
    for points in every(any_run):
        blocked = blocked_area(points, any_run)
        shapely.prepare(blocked)
        for leg, line in enumerate(oracles.drawn(points)):
            for side, limit in ((1, points.port_m[leg]), (-1, points.starboard_m[leg])):
                assert 0 <= limit <= MAX_CROSS_TRACK_M
                for share in (0.25, 0.5, 0.75, 0.999) if limit else ():
                    aside = oracles.in_plane(any_run, oracles.beside(line, side * share * limit))
                    assert not shapely.intersects(blocked, aside)
                    assert shapely.covers(extent.buffer(1e-6), aside)


def test_the_corridor_is_as_wide_as_it_can_be(any_run: RunResult) -> None:
    chart, projection = any_run.water.chart, any_run.water.projection
    for points in every(any_run):
        parts = [blocked_area(points, any_run), *chart.no_go, shapely.boundary(chart.extent)]
        for leg in inner_legs(points):
            line = oracles.in_plane(any_run, oracles.drawn(points)[leg])
            gap = shapely.shortest_line(line, shapely.union_all(parts))
            nearest = projection.geodesic_length_m(shapely.get_coordinates(gap))
            narrower = min(points.port_m[leg], points.starboard_m[leg])
            assert narrower == pytest.approx(min(nearest, MAX_CROSS_TRACK_M), rel=0.02, abs=0.05)


def test_legs_have_cross_track_limits_where_there_is_water_for_it() -> None:
    """The plan itself runs within metres of V, since that takes the least fuel."""
    result = runs.short_way()
    blocked = [[ranked.route.soft_no_go, *result.water.land] for ranked in result.routes]
    for ranked, parts in zip(result.routes, blocked, strict=True):
        planned = shapely.distance(shapely.LineString(ranked.route.path), parts).min()
        assert planned * result.water.projection.scale < 3
    for points in every(result):
        limit = min(points.port_m[:-1].min(), points.starboard_m[:-1].min())
        # Longer routes have more corners, which use up more of the fuel that is allowed.
        assert limit > (4 if points.ranked.rank == 1 else 2)


def test_the_legs_in_v_around_the_ends_have_a_limit_of_0_and_no_other_has() -> None:
    for points in case_waypoints(runs.harbours().case(runs.SEASON)):
        limits = np.stack([points.port_m, points.starboard_m])[:, :-1]
        assert (limits[:, [0, -1]] == 0).all()
        free = np.flatnonzero((limits > 0).all(axis=0))
        assert (limits[:, free[0] : free[-1] + 1] > 0).all()
        assert (np.delete(limits, free, axis=1) == 0).all()


def test_turns_cut_corners_inside_free_water(any_run: RunResult) -> None:
    projection = any_run.water.projection
    largest = 0.0
    for points in every(any_run):
        radius, blocked = points.radius_m, blocked_area(points, any_run)
        assert radius[0] == radius[-1] == 0
        taken = np.zeros((len(points.lonlat) - 1, 2))
        for at in np.flatnonzero(radius):
            before = GEOD.inv(*points.lonlat[at], *points.lonlat[at - 1])
            after = GEOD.inv(*points.lonlat[at], *points.lonlat[at + 1])
            inside = abs((after[0] - before[0] + 180) % 360 - 180) / 2
            tangent = radius[at] / np.tan(np.radians(inside))
            taken[at - 1, 1], taken[at, 0] = tangent, tangent
            bisector = before[0] + ((after[0] - before[0] + 180) % 360 - 180) / 2
            apart = radius[at] / np.sin(np.radians(inside))
            corner = points.lonlat[at]
            *centre, _ = GEOD.fwd(corner[0], corner[1], bisector, apart)
            turn = np.linspace(-(90 - inside), 90 - inside, 30) + bisector + 180
            arc = np.column_stack(
                GEOD.fwd(
                    np.full(30, centre[0]), np.full(30, centre[1]), turn, np.full(30, radius[at])
                )[:2]
            )
            arc[:, 0] = points.lonlat[at, 0] + (arc[:, 0] - points.lonlat[at, 0] + 180) % 360 - 180
            assert not shapely.intersects(blocked, oracles.in_plane(any_run, arc))
        assert (taken.sum(axis=1) <= points.length_m[:-1] * 1.01).all()
        largest = max(largest, radius.max())
    fastest = max(ranked.route.speeds.max() for ranked in any_run.routes)
    hard_over = fastest / any_run.cases[0].case.vessel.turn_rate * projection.scale
    assert largest == pytest.approx(hard_over, rel=0.1)


def test_waypoints_are_computed_once_per_result() -> None:
    result = runs.across_180()
    assert case_waypoints(result.case(runs.SEASON)) is case_waypoints(result.case(runs.SEASON))


def test_routes_of_a_planar_scenario_are_thinned_too(planar_result: RunResult) -> None:
    for points in every(planar_result):
        assert 2 <= len(points.lonlat) <= len(points.ranked.route.path)
