"""Narrow water: padding yields only where it must, and every stretch without room is listed.

An oracle of its own flies the hard-over turns: circles, drawn with NumPy, against the land's
polygons. In still water that is all there is to a turn.
"""

import math

import numpy as np
import pytest
import shapely
from shapely import box

import renew
from renew._types import BoolArray, FloatArray

STILL = renew.UniformCurrent(0.0, 0.0)
# Turns on a circle of 40 m diameter.
SHIP = renew.Vessel(speed=2.0, turn_rate=0.1, length=10.0)
RADIUS = 20.0
EXTENT = box(0, 0, 1000, 400)


def hits(
    path: FloatArray, land: list[shapely.Polygon], radius: float, spacing: float = 2.0
) -> tuple[FloatArray, BoolArray]:
    """Return stations along a path, m, and whether a turning circle to a side meets land."""
    line = shapely.LineString(path)
    along = np.linspace(0, line.length, 1 + math.ceil(line.length / spacing))
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, along))
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    leg = np.searchsorted(np.cumsum(lengths), along, side="right").clip(max=len(lengths) - 1)
    course = (np.diff(path, axis=0) / lengths[:, None])[leg]
    angle = np.linspace(0, 2 * np.pi, 91)
    touched = np.zeros(len(along), dtype=bool)
    for side in (1, -1):
        centre = points + radius * side * np.column_stack([-course[:, 1], course[:, 0]])
        ring = np.column_stack([np.cos(angle), np.sin(angle)])
        circles = shapely.linestrings(centre[:, None] + radius * ring)
        touched |= shapely.intersects(circles, shapely.union_all(land))
    return along, touched


def assert_listed(route: renew.Route, land: list[shapely.Polygon]) -> None:
    """Every turn that meets land is in a listed stretch, and each of these has such a turn."""
    along, touched = hits(route.path, land, RADIUS)
    _, nearly = hits(route.path, land, 1.05 * RADIUS)
    listed = np.zeros(len(along), dtype=bool)
    for one in route.shortfalls:
        inside = (along >= one.begin) & (along <= one.end)
        listed |= inside
        assert nearly[inside].any()
        assert one.needed == pytest.approx(2 * RADIUS, rel=1e-3)
        if one.kept > 0:
            # The circle that is said to fit does.
            _, meets = hits(route.path, land, one.kept / 2)
            assert not meets[inside].any()
    assert not (touched & ~listed).any()


def plan(land: list[shapely.Polygon], goal: tuple[float, float], **options: object) -> renew.Plan:
    """Plan from the west to a goal."""
    chart = renew.Chart(EXTENT, land)
    return renew.plan(chart, STILL, SHIP, (60, 200), goal, shortfall="least", **options)  # type: ignore[arg-type]


def walls(*gaps: tuple[float, float], x: float = 500.0) -> list[shapely.Polygon]:
    """Return a wall from south to north with gaps in it."""
    ends = [0.0, *(y for gap in gaps for y in gap), 400.0]
    return [box(x, low, x + 30, high) for low, high in zip(ends[::2], ends[1::2], strict=True)]


def test_where_there_is_room_nothing_changes() -> None:
    """The route is the one of the refusing plan, bit for bit, and no stretch is listed."""
    land = walls((100, 300))
    found = plan(land, (900, 200))
    refusing = renew.plan(renew.Chart(EXTENT, land), STILL, SHIP, (60, 200), (900, 200))
    assert (found.best.path == refusing.best.path).all()
    assert found.best.shortfalls == refusing.best.shortfalls == ()


def test_a_harbour_that_is_refused_is_planned_with_its_stretch() -> None:
    """A basin behind a mouth of 30 m, for a circle of 40 m: padding yields there alone."""
    land = [*walls((185, 215), x=700), box(760, 0, 1000, 170), box(760, 230, 1000, 400)]
    with pytest.raises(renew.UnreachableError):
        renew.plan(renew.Chart(EXTENT, land), STILL, SHIP, (60, 200), (950, 200))
    route = plan(land, (950, 200)).best
    assert_listed(route, land)
    (stretch,) = route.shortfalls
    assert stretch.begin > 500
    assert stretch.kept < 20
    # In open water the padding is whole.
    assert route.padding_used[:, 4].max() == pytest.approx(2 * RADIUS, rel=0.05)


@pytest.mark.parametrize("far", [330.0, 395.0])
def test_of_two_gaps_the_wider_is_taken_if_it_costs_little(far: float) -> None:
    """Neither gap has room: the near one leaves less."""
    land = walls((195, 205), (far - 30, far))
    route = plan(land, (900, 200)).best
    at_wall = np.interp(515, route.path[:, 0], route.path[:, 1])
    assert at_wall > 250
    assert_listed(route, land)


def test_a_wider_gap_far_off_is_no_way() -> None:
    """It needs more than 1.2 times the least fuel; it is listed with the others."""
    land = [*walls((20, 50), (380, 395)), box(200, 60, 800, 340)]
    chart = renew.Chart(EXTENT, land)
    start, goal = (400.0, 360.0), (600.0, 360.0)
    found = renew.plan(chart, STILL, SHIP, start, goal, shortfall="least")
    assert found.best.path[:, 1].min() > 300
    assert_listed(found.best, land)


def test_a_basin_that_is_not_joined_is_refused_alike() -> None:
    """Padding can't open it, and the reason is the same."""
    land = [box(700, 0, 730, 400)]
    with pytest.raises(renew.UnreachableError, match="no water joins"):
        plan(land, (900, 200))


def test_a_clearance_and_a_padding_in_metres_are_kept() -> None:
    """They are asked for, whatever turns need."""
    land = walls((185, 215))
    for asked in ({"clearance": 20.0}, {"padding": 20.0}):
        with pytest.raises(renew.UnreachableError):
            plan(land, (900, 200), **asked)
    assert plan(land, (900, 200), clearance=20.0, narrow_share=0.5).best.shortfalls


def test_narrow_water_goes_with_a_point_on_the_way_speeds_and_departures() -> None:
    """The whole planner plans with the padding that is there."""
    land = walls((180, 220))
    chart, ends = renew.Chart(EXTENT, land), ((60.0, 200.0), (900.0, 200.0))
    on_the_way = plan(land, (900, 200), via=[(300.0, 100.0)]).best
    assert_listed(on_the_way, land)
    assert on_the_way.shortfalls
    (slow,) = plan(land, (900, 200), speed=(1.0, 2.0), arrive_by=2000.0).best.shortfalls
    # At half the speed half the circle is needed, which touches both walls.
    assert slow[2:] == pytest.approx((RADIUS, 0.9 * RADIUS), rel=1e-3)
    tide = renew.VaryingCurrent([0.0, 3600.0], [STILL, renew.UniformCurrent(0.0, 0.2)])
    found = renew.plan_departures(chart, tide, SHIP, *ends, [0.0, 600.0], shortfall="least")
    assert found.plan.best.shortfalls


def test_the_vessel_turns_faster_only_where_a_stretch_is_listed() -> None:
    """A passage with a bend that no vessel rounds at its speed: a tug helps there."""
    land = [
        box(400, 0, 640, 185),
        box(400, 215, 610, 400),
        box(640, 0, 700, 330),
        box(610, 360, 700, 400),
    ]
    route = plan(land, (950, 200)).best
    assert_listed(route, land)
    t, x, y, heading = route.trajectory.T
    along = shapely.line_locate_point(shapely.LineString(route.path), shapely.points(x, y))
    fast = np.abs(np.diff(heading)) > (1 + 1e-6) * SHIP.turn_rate * np.maximum(np.diff(t), 1e-9)
    listed = np.zeros(len(fast), dtype=bool)
    for one in route.shortfalls:
        listed |= (along[1:] >= one.begin) & (along[:-1] <= one.end)
    assert not (fast & ~listed).any()
