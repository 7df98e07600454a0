"""Routes measured against the original land."""

import math
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pytest
import shapely

import renew
from pipeline.geo.projection import DepthCover, KnownCells, Projection
from pipeline.model import Case, CaseResult, Water
from pipeline.run import Outcome
from pipeline.scenario.model import PlannerOptions
from pipeline.stages import measure
from pipeline.stages.choose import narrows_notes
from pipeline.stages.measure import land_within_reach, measured
from renew.inputs import options
from renew.turns.turn_reach import TurnReach
from renew.voyage.fuel import passage
from tests.pipeline.formats import small_run
from tests.pipeline.results import with_measures
from tests.true_scale import GEOD, clearance_m

VESSEL = renew.Vessel(speed=1.0, turn_rate=math.radians(35))
REGION = shapely.box(115.5, 7, 122, 13.5)
SCALE = 1000.0
Planned: TypeAlias = tuple[Case, shapely.Polygon, CaseResult]


def lonlat_scene() -> tuple[Case, shapely.Polygon]:
    """Return a case at 1:1000 whose chart has a wider island, and the island in lon/lat."""
    projection = Projection.for_region(REGION, SCALE)
    island = shapely.Polygon([(118, 9), (119, 9.5), (119.5, 11), (118.8, 10.5)])
    planar = projection.geometry_to_plane(island)
    region = projection.geometry_to_plane(REGION)
    chart = renew.Chart(region, [planar.buffer(10)], point_scale=projection.scale_at)
    ends = projection.to_plane([(120.3, 12.8), (116.8, 7.7)])
    current = renew.UniformCurrent(0.0, 0.1)
    return Case(
        "still", Water(chart, (planar,), projection), VESSEL, ends[0], ends[1], current
    ), island


@pytest.fixture(scope="module")
def planned() -> Planned:
    """Plan both ways round the island."""
    scene, island = lonlat_scene()
    plan = renew.plan(scene.chart, scene.current, VESSEL, scene.start, scene.goal, classes=2)
    return scene, island, CaseResult("still", plan, "", 1.0)


def test_lengths_clearances_and_times_are_true_ones(planned: Planned) -> None:
    scene, island, plan = planned
    evaluation = measured(scene, plan, PlannerOptions())
    assert plan.plan is not None
    assert len(evaluation.routes) == len(plan.plan.routes) == 2
    coast = shapely.get_coordinates(shapely.segmentize(island.exterior, 0.005))
    for row, route in zip(evaluation.routes, plan.plan.routes, strict=True):
        path = shapely.segmentize(shapely.LineString(route.path), 0.5)
        lonlat = scene.projection.to_lonlat(shapely.get_coordinates(path))
        assert row.length_m == pytest.approx(GEOD.line_length(*lonlat.T), rel=1e-3)
        # A point of the route each 2 km against every point of the coast.
        lon, lat = (np.broadcast_arrays(lonlat[::4, None, i], coast[:, i]) for i in (0, 1))
        apart = GEOD.inv(lon[0], lat[0], lon[1], lat[1])[2].min()
        assert row.clearance_m == pytest.approx(apart, rel=0.01)
        # Times in the plane, stretched step by step as the plane's metres are.
        planar = shapely.get_coordinates(path)
        times = passage(planar, scene.current, VESSEL).durations
        steps = GEOD.line_lengths(*lonlat.T) / np.linalg.norm(np.diff(planar, axis=0), axis=1)
        assert row.duration_s == pytest.approx((times * steps).sum(), rel=1e-4)
        assert row.duration_s == pytest.approx(route.duration * SCALE, rel=2e-3)
        assert row.land_m == 0
        assert row.collisions == 0
        assert row.trials == evaluation.turns[row.rank - 1].trials > 100
    assert [row.rank for row in evaluation.routes] == [1, 2]


def test_the_nearest_land_is_the_nearest_on_earth() -> None:
    # A plane of 3,000 km stretches its edges by 1 % and shrinks its middle: an island 40.0 km off
    # the route near the edge lies further off in the plane than one 40.2 km off in the middle.
    region = shapely.box(118, 22, 148, 45)
    projection = Projection.for_region(region, 2000.0)
    endpoints = projection.to_plane([(119.0, 22.5), (147.0, 44.0)])
    line = projection.to_lonlat(
        endpoints[0] + np.linspace(0, 1, 20_001)[:, None] * (endpoints[1] - endpoints[0])
    )
    islands = []
    for step, apart in ((400, 40_000.0), (10_000, 40_200.0)):
        here, ahead = line[step].tolist(), line[step + 1].tolist()
        azimuth, _, _ = GEOD.inv(here[0], here[1], ahead[0], ahead[1])
        lon, lat, _ = GEOD.fwd(here[0], here[1], azimuth + 90, apart)
        islands.append(shapely.box(lon - 1e-3, lat - 1e-3, lon + 1e-3, lat + 1e-3))
    planar = projection.geometry_to_plane(np.array(islands, dtype=object))
    there = shapely.distance(planar, shapely.LineString(endpoints))
    assert there[1] < there[0], "in the plane the other island is nearer"
    water = Water(renew.Chart(projection.geometry_to_plane(region)), tuple(planar), projection)
    scene = Case("still", water, VESSEL, endpoints[0], endpoints[1], renew.UniformCurrent(0.0, 0.0))
    plan = renew.plan(scene.chart, scene.current, VESSEL, *endpoints, classes=1, padding="none")
    length = float(np.linalg.norm(endpoints[1] - endpoints[0]))
    share = np.linspace(0, 1, 2_000)[:, None]
    track = np.hstack(
        [share * length, endpoints[0] + share * (endpoints[1] - endpoints[0]), 0 * share]
    )
    straight = replace(plan.best, path=endpoints, trajectory=track, length=length, duration=length)
    season = CaseResult("still", replace(plan, routes=(straight,)), "", 1.0)
    (row,) = measured(scene, season, PlannerOptions()).routes
    assert row.clearance_m == pytest.approx(clearance_m(line, islands), abs=1.0)
    assert row.length_m == pytest.approx(GEOD.line_length(*line.T), rel=1e-5)


def test_land_beyond_a_regions_edge_counts_for_turns_and_clearance() -> None:
    """The region ends between a route and land 2 m off it: neither is told to be safe."""
    region = shapely.box(0.0, 0.0, 0.001, 0.001)
    projection = Projection.for_region(region)
    west, south, _, north = (chart := renew.Chart(projection.geometry_to_plane(region))).bounds
    ends = np.array([[west + 1, south + 20], [west + 1, north - 20]])
    calm = renew.UniformCurrent(0.0, 0.0)
    plan = renew.plan(chart, calm, VESSEL, *ends, clearance=5.0)
    found = CaseResult("still", plan, "", 1.0)
    for off_m, is_met in ((1, True), (50, False)):
        land = shapely.box(west - 100, south, west - off_m, north)
        water = Water(chart, (land,), projection)
        scene = Case("still", water, VESSEL, ends[0], ends[1], calm)
        asked = PlannerOptions(clearance=5.0)
        (row,) = measured(scene, found, asked).routes
        assert (row.collisions == row.trials / 2) == is_met
        assert bool(row.collisions) == is_met
        notes = [dict(note.values) for note in narrows_notes(water, [found], asked)]
        assert [one["least_m"] for one in notes] == [pytest.approx(2.0, abs=0.1)] * is_met
    # Where land is nearest at an end, the end counts, not only the middles between places.
    land = shapely.box(west - 100, ends[0, 1] - 23, west + 50, ends[0, 1] - 3)
    (note,) = narrows_notes(Water(chart, (land,), projection), [found], asked)
    assert dict(note.values)["least_m"] == pytest.approx(3.0, abs=0.01)


def test_a_route_over_land_is_detected(planned: Planned) -> None:
    scene, island, plan = planned
    assert plan.plan is not None
    middle = scene.projection.to_plane((118.9, 10.0))
    route = replace(
        plan.plan.best,
        path=np.array([scene.start, middle, scene.goal]),
        speeds=np.full(2, scene.vessel.speed),
        times=np.array([0.0, 1.0, 2.0]),
    )
    over = CaseResult("still", replace(plan.plan, routes=(route,)), "", 1.0)
    row = measured(scene, over, PlannerOptions()).routes[0]
    # The crossing in lon/lat, where the legs are almost straight too.
    legs = shapely.LineString([(120.3, 12.8), (118.9, 10.0), (116.8, 7.7)])
    inside = shapely.get_coordinates(shapely.intersection(shapely.segmentize(legs, 0.01), island))
    assert row.land_m == pytest.approx(GEOD.line_length(*inside.T), rel=0.03)
    assert row.land_m > 20_000
    assert island.buffer(1e-3).contains(shapely.Point(row.land_lon, row.land_lat))
    assert legs.distance(shapely.Point(row.land_lon, row.land_lat)) < 0.02
    result = small_run.parts()
    over_land = with_measures(result, "summer", routes=(row,))
    (fault,) = Outcome(over_land, Path(), fresh=True, seconds=1.0).failures
    assert f"m of the original land, the most at {row.land_lon:.4f} E {row.land_lat:.4f} N" in fault
    assert row.clearance_m == 0
    assert row.collisions > 0


def test_on_the_longest_ways_turns_begin_as_near_as_there_may_be_points(
    planned: Planned, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, _, plan = planned
    for module in (measure, options):
        monkeypatch.setattr(module, "MAX_STATIONS", 50)
    rows = measured(scene, plan, PlannerOptions()).routes
    assert len(rows) == 2


def test_a_season_without_a_plan_has_no_rows() -> None:
    scene, _ = lonlat_scene()
    evaluation = measured(scene, CaseResult("still", None, "no", 0.0), PlannerOptions())
    assert evaluation.routes == ()


@pytest.mark.parametrize(("reaches", "is_included"), [(0.97, True), (1.5, False)])
def test_all_land_that_a_turn_can_reach_is_included_and_no_more(
    planned: Planned, reaches: float, *, is_included: bool
) -> None:
    """The bound on a turn's reach is the planner's own, not a copy of it."""
    scene, _, plan = planned
    current = renew.UniformCurrent(0.6, 0.0)
    reach = TurnReach.of(current.table(scene.chart.bounds), VESSEL).furthest.max()
    west = min(plan.routes, key=lambda route: route.path[:, 0].min())
    begin, end = west.path[:2]
    along = (end - begin) / np.linalg.norm(end - begin)
    rock = shapely.Point(begin - (reaches * reach + 1.0) * along).buffer(1.0)
    chart = land_within_reach(replace(scene.water, land=(rock,)), [current], scene.vessel, (west,))
    assert bool(chart.no_go) == is_included


def test_shares_without_figures_are_those_of_the_grids(planned: Planned) -> None:
    """Of both routes, the part north of 10 N has no figure of the current, none west of 118 E."""
    scene, _, plan = planned
    lon, lat = np.arange(110.5, 130), np.arange(0.5, 20)
    north = KnownCells(lon, lat, np.repeat((lat < 10)[:, None], lon.size, axis=1))
    west = DepthCover((shapely.box(110, 0, 118, 20),))
    known = replace(scene, water=replace(scene.water, depths=west), current_cells=north)
    for row in measured(scene, plan, PlannerOptions()).routes:
        assert row.filled_share == 0
        assert math.isnan(row.uncharted_share)
    rows = measured(known, plan, PlannerOptions()).routes
    for row, route in zip(rows, plan.routes, strict=True):
        line = shapely.segmentize(shapely.LineString(route.path), 0.2)
        points = scene.projection.to_lonlat(shapely.get_coordinates(line))
        lengths = GEOD.line_lengths(*points.T)
        middles = (points[1:] + points[:-1]) / 2
        for share, missing in (
            (row.filled_share, middles[:, 1] > 10),
            (row.uncharted_share, middles[:, 0] > 118),
        ):
            assert 0 < share < 1
            assert share == pytest.approx(lengths[missing].sum() / lengths.sum(), abs=1e-3)


# --- The parts of an optimality gap add up to it, and each is there only where its cause is ---
