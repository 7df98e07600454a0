"""Shut straits are reported with place, width and need; open ones and rock gaps are not."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

import renew
from pipeline.findings.other_ways import shut_straits, side_bound
from pipeline.findings.text import distance, planner_text
from pipeline.findings.way_names import way_names
from pipeline.model import Case, CaseResult, CurrentGrid, Fetched, Land, Measures, ShutStrait
from pipeline.scenario.model import Scenario
from pipeline.stages.project import project
from pipeline.stages.simplify import simplify_land
from renew.errors import Length
from tests.pipeline.formats import small_run
from tests.pipeline.results import rows_of, with_rows
from tests.true_scale import GEOD

MARGIN_M, TOLERANCE_M = 60.0, 60.0
STILL = {"name": "still", "valid": "2024-07", "currents": ["still"]}
# A vessel that turns in 0.6 km, and one that turns on the spot.
SLOW = {"length_m": 30.0, "speed_m_s": 5.0, "turn_rate_deg_s": 0.5}
AGILE = {"length_m": 2.0, "speed_m_s": 1.0, "turn_rate_deg_s": 35.0}


def islands(width_m: float) -> list[shapely.Polygon]:
    """Two islands between start and goal with a strait along 9.5 N, and a rock off each."""
    half = width_m / 2 / GEOD.inv(119.6, 9.5, 119.6, 9.51)[2] * 0.01
    south, north = 9.5 - half, 9.5 + half
    return [
        shapely.box(119.5, 9.2, 119.7, south),
        shapely.box(119.5, north, 119.7, 9.8),
        shapely.box(119.701, 9.3, 119.702, 9.301),
        shapely.box(119.498, 9.7, 119.499, 9.701),
    ]


def atoll(mouth_m: float) -> list[shapely.Polygon]:
    """A ring of two reefs with a mouth between them west and east, and an island 1.66 km off it."""
    half = mouth_m / 2 / GEOD.inv(119.6, 9.5, 119.6, 9.51)[2] * 0.01
    ring = shapely.box(119.45, 9.35, 119.75, 9.65) - shapely.box(119.5, 9.4, 119.7, 9.6)
    reefs = ring - shapely.box(119.4, 9.5 - half, 119.8, 9.5 + half)
    return [*reefs.geoms, shapely.box(119.55, 9.45, 119.65, 9.585)]


def straits(
    land: list[shapely.Polygon], clearance: float, vessel: dict[str, float]
) -> tuple[tuple[ShutStrait, ...], Case, CaseResult]:
    """Plan round and between islands; return the straits that are shut, and the plan."""
    asked: Scenario = small_run.scenario(
        scale=1.0,
        vessel=vessel,
        seasons=[STILL],
        planner={"classes": 4, "clearance": clearance, "distinct_by": 2000.0},
    )
    assert asked.region is not None
    simplified = simplify_land(
        land,
        asked.region.shape,
        margin_m=MARGIN_M,
        tolerance_m=TOLERANCE_M,
        endpoints=(asked.start, asked.goal),
    )
    lon, lat = np.linspace(118.8, 120.4, 9), np.linspace(8.8, 10.2, 8)
    still = np.zeros((8, 9))
    grid = CurrentGrid("still", lon, lat, still[None], still[None], "2024-07", small_run.STAND_IN)
    (scene,) = project(asked, Fetched(Land(tuple(land), (), MARGIN_M), (grid,)), simplified)
    plan = renew.plan(
        scene.chart, scene.current, scene.vessel, scene.start, scene.goal,
        classes=4, clearance=clearance, distinct_by=2000.0,
    )  # fmt: skip
    result = CaseResult("still", plan, "", 1.0)
    return shut_straits([(scene, result)], asked.planner), scene, result


def is_open(scene: Case, padding: float) -> bool:
    """Whether water of the planner's chart leads through the strait, off land by a padding."""
    mouth, other = scene.projection.to_plane([(119.45, 9.5), (119.75, 9.5)])
    box = shapely.box(*scene.projection.to_plane([(119.45, 9.45), (119.75, 9.55)]).ravel())
    land = shapely.union_all(shapely.buffer(np.array(scene.chart.no_go), padding, quad_segs=32))
    bodies = shapely.get_parts(shapely.difference(box.buffer(10), land))
    ends = shapely.points([mouth, other])
    return bool(shapely.intersects(bodies[:, None], ends).all(axis=1).any())


def ways_m(scene: Case) -> tuple[float, float]:
    """Lengths of the way round the islands and of the straight way, planar metres."""
    land = shapely.union_all(np.array(scene.water.land)).convex_hull
    ends, ways = shapely.points(scene.stops), []
    # Start and goal are corners of the hull round them and the islands.
    hull = shapely.convex_hull(shapely.union(land, shapely.linestrings(scene.stops)))
    for side in (1, -1):
        ring = shapely.LinearRing(shapely.get_coordinates(hull.exterior)[::side])
        begin, end = (ring.project(stop) for stop in ends)
        ways.append((end - begin) % ring.length)
    return min(ways), float(np.linalg.norm(scene.goal - scene.start))


@pytest.mark.gate_share(1)
@pytest.mark.parametrize(
    ("width_m", "clearance", "by"),
    [(110.0, 300.0, "margin"), (500.0, 300.0, "padding"), (1000.0, 300.0, ""), (300.0, 0.0, "")],
)
def test_a_shut_strait_is_reported_with_its_place(
    width_m: float, clearance: float, by: str
) -> None:
    found, scene, _ = straits(islands(width_m), clearance, AGILE)
    assert is_open(scene, clearance) == (not by), "the oracle's own chart"
    assert is_open(scene, 0.0) == (by != "margin")
    assert [strait.by for strait in found] == [by] * bool(by)
    for strait in found:
        assert strait.lat == pytest.approx(9.5, abs=1e-4)
        assert 119.5 <= strait.lon <= 119.7
        assert strait.width_m == pytest.approx(width_m, rel=2e-3)
        assert strait.padding_m == pytest.approx(2 * clearance)
        # Margin and tolerance are what they are there, where a class was refused, or the most.
        assert strait.width_m < strait.needed_m
        assert 0 < strait.needed_m - 2 * clearance <= 2 * (MARGIN_M + TOLERANCE_M) + 1e-6
        assert strait.way == 1
        around, through = ways_m(scene)
        assert strait.saves == pytest.approx(1 - through / around, abs=0.01)


def test_a_strait_with_wider_padding_than_most_is_found_by_its_rejected_class() -> None:
    radius = SLOW["speed_m_s"] / math.radians(SLOW["turn_rate_deg_s"])
    width_m = 2 * radius + 2 * (MARGIN_M + TOLERANCE_M) + 60
    (strait,), scene, result = straits(islands(width_m), 0.0, SLOW)
    assert is_open(scene, radius)
    assert (strait.by, strait.seasons) == ("padding", ("still",))
    assert strait.lat == pytest.approx(9.5, abs=2e-3)
    assert strait.width_m == pytest.approx(width_m, rel=2e-3)
    assert strait.needed_m > strait.width_m
    assert strait.padding_m > 2 * radius
    # One strait has one width, in whatever output.
    assert result.plan is not None
    shut = [one for one in result.plan.rejected if one.strait is not None]
    assert shut
    for one in shut:
        width, needed, left, right = map(scene.water.true_m, one.text.values_of(Length))
        assert (width, needed) == pytest.approx((strait.width_m, strait.needed_m), rel=1e-4)
        assert left + right == pytest.approx(strait.padding_m, rel=1e-4)
        assert distance(width) == distance(strait.width_m)
        said = f"the gap is {distance(width)} wide, and {distance(needed)} are needed, with "
        assert said in planner_text(one.text, scene)


@pytest.mark.slow
def test_straits_of_enclosed_water_are_shut_by_its_mouths() -> None:
    """Enclosed water is land to the planner; its mouths shut it, so these are reported."""
    found, scene, _ = straits(atoll(100.0), 900.0, AGILE)
    lagoon = shapely.Point(scene.projection.to_plane([119.6, 9.595]))
    assert shapely.intersects(np.array(scene.chart.no_go), lagoon).any()
    assert [strait.by for strait in found] == ["margin"]
    assert found[0].width_m == pytest.approx(100.0, rel=2e-3)
    # The mouths are so wide that the water is open, but the way round the island is not.
    found, _, _ = straits(atoll(2000.0), 900.0, AGILE)
    assert {strait.by for strait in found} == {"padding"}
    for strait in found:
        assert strait.width_m <= strait.needed_m * 1.001


def test_a_plane_and_a_run_without_routes_have_none() -> None:
    result = small_run.parts(planar=True)
    none = CaseResult("gyre", None, "no water", 0.0)
    for one in (result.results[0], none):
        planned, options = [(result.planned["gyre"], one)], result.scenario.planner
        assert shut_straits(planned, options) == ()


# --- The other side's bound: below every route there, and above the best if the detour is long ---


def planned_around(island: shapely.Polygon, speed: float) -> tuple[list[renew.Route], float]:
    """Routes around an island in a current along x, m/s; and the bound of the worse side."""
    like = small_run.parts(planar=True)
    chart = renew.Chart(shapely.box(0, 0, 100, 100), [island])
    water = replace(like.water, chart=chart, land=(island,))
    case = replace(like.planned["gyre"], water=water, current=renew.UniformCurrent(speed, 0.0))
    plan = renew.plan(
        chart, case.current, case.vessel, case.start, case.goal, classes=4, padding="none"
    )
    rows = tuple(
        replace(rows_of(like)[0], rank=rank, homotopy=route.homotopy, fuel=route.fuel, passages=())
        for rank, route in enumerate(plan.routes, start=1)
    )
    result = CaseResult("gyre", plan, "", 0.0, measures=Measures(rows))
    (named,), (main, *_), _ = way_names(water, [result], ())
    bound = side_bound(case, named, main, like.scenario.planner)
    assert bound is not None
    return list(plan.routes), bound


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_no_route_on_the_other_side_is_below_the_bound(speed: float) -> None:
    # Start and goal are (10, 10) and (90, 90): north-west about is much the longer way.
    island = shapely.Polygon([(20, 30), (30, 20), (70, 60), (60, 96), (20, 96)])
    (best, other, *_), bound = planned_around(island, speed)
    assert bound <= other.fuel
    assert best.fuel_bound.value < best.fuel < bound
    # The bound is taken on a grid: a few per cent below the best route there.
    assert bound > 0.9 * other.fuel


def test_nothing_is_proven_of_two_sides_that_are_alike() -> None:
    island = shapely.Polygon([(40, 50), (50, 40), (60, 50), (50, 60)])
    (best, other, *_), bound = planned_around(island, 0.0)
    assert other.fuel == pytest.approx(best.fuel, rel=1e-3)
    assert bound <= best.fuel


def test_cases_without_another_side_have_no_bound() -> None:
    result = with_rows(small_run.parts(), lambda _, row: replace(row, passages=()))
    for case in result.cases:
        options = result.scenario.planner
        assert side_bound(case.case, case.result, result.islands[0], options) is None


def test_the_bound_of_a_real_plan_is_below_its_routes_there() -> None:
    result, found = small_run.parts(), []
    for case in result.cases:
        bound = side_bound(case.case, case.result, result.islands[0], result.scenario.planner)
        if bound is not None:
            best, *others = case.routes
            there = [o for o in others if o.metrics.main_passage != best.metrics.main_passage]
            assert bound <= min(one.route.fuel for one in there)
            assert np.isfinite(bound)
            found.append(bound)
    assert found
