"""Shut areas are never entered, early, on time, late or in a turn: this module flies the routes."""

import math
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Polygon, box

import renew
from tests.moving_waters import moving_scene
from tests.strategies import PAPER_VESSEL, SIZE, STILL, Scene, single_gyre
from tests.tidal_waters import positions

CHART = renew.Chart(box(0, 0, 200, 60))
START, GOAL = (20.0, 30.0), (180.0, 30.0)
# Across the whole way but for a gap in the north.
BARRIER = box(95, -1, 105, 40)


def plan(**options: Any) -> renew.Plan:
    asked: dict[str, Any] = {"classes": 4, **options}
    return renew.plan(CHART, STILL, PAPER_VESSEL, START, GOAL, **asked)


def flights_inside(
    route: renew.Route,
    area: Polygon | MultiPolygon,
    hours: tuple[float, float],
    current: renew.CurrentField,
    lateness: float,
    min_lateness: float = 0.0,
) -> int:
    """Number of moments at which the vessel is in an area while it is shut; flown step by step."""
    begin, end = route.trajectory[[0, -1], 0]
    along = np.arange(begin, end, 0.5)
    late = np.maximum(lateness * (along - route.times[0]), min_lateness)
    shapely.prepare(area)
    scene = Scene(CHART, current, *route.path[[0, -1]])
    return sum(
        int((shapely.contains_xy(area, place) & (hours[0] <= now) & (now < hours[1])).sum())
        for share in (-1.0, -0.5, 0.0, 0.5, 1.0)
        for side in (1.0, -1.0)
        for place, now in positions(route, scene, along, share * late, side, 0.1)
    )


def test_what_is_always_shut_is_gone_around_like_land() -> None:
    as_land = renew.Chart(box(0, 0, 200, 60), [BARRIER])
    expected = renew.plan(as_land, STILL, PAPER_VESSEL, START, GOAL, classes=4).best
    found = plan(avoid=[renew.ShutArea(BARRIER)])
    assert found.best.fuel == pytest.approx(expected.fuel, rel=1e-9)
    assert found.best.fuel_bound.value == pytest.approx(expected.fuel_bound.value, rel=1e-9)
    assert found.shut == ()
    assert flights_inside(found.best, BARRIER, (-math.inf, math.inf), STILL, 0.05) == 0


@pytest.mark.parametrize(
    ("hours", "is_entered"),
    [
        ((0.0, 60.0), True),  # it comes there at 75 s, 71 s at the earliest
        ((0.0, 72.0), False),
        ((70.0, 90.0), False),
        ((88.0, 95.0), False),  # late, it is there until 89 s, and a turn takes 10 s
        ((110.0, 200.0), True),
    ],
)
def test_an_area_is_passed_while_it_is_open_and_gone_around_while_it_is_shut(
    hours: tuple[float, float], is_entered: bool
) -> None:
    area = renew.ShutArea(BARRIER, *hours, name="firing range")
    found = plan(avoid=[area])
    assert shapely.LineString(found.best.path).intersects(BARRIER) == is_entered
    for route in found.routes:
        assert flights_inside(route, BARRIER, hours, STILL, 0.05) == 0
    if is_entered:
        assert found.best.fuel == pytest.approx(160.0, rel=1e-6)
        assert found.shut == ()
    else:
        around = plan(avoid=[renew.ShutArea(BARRIER)]).best.fuel
        assert found.best.fuel == pytest.approx(around, rel=1e-9)
        assert found.shut == (area,)
        # No bound for a route that is open at other hours.
        assert found.best.fuel_bound.value <= 160.0


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", [0, 2, 4])
@pytest.mark.parametrize("shift", [0.0, 60.0, 110.0])
def test_no_route_of_a_moving_scene_is_in_a_shut_area_early_on_time_or_late(
    seed: int, shift: float
) -> None:
    scene = moving_scene(seed)
    middle = box(0.35 * SIZE, 0.35 * SIZE, 0.65 * SIZE, 0.65 * SIZE)
    hours = (scene.departure + shift, scene.departure + shift + 60.0)
    area = renew.ShutArea(middle, *hours)
    found = scene.plan(avoid=[area], classes=4, lateness=0.08, min_lateness=8.0)
    for route in found.routes:
        assert flights_inside(route, middle, hours, scene.current, 0.08, 8.0) == 0
    unhindered = scene.plan(classes=4, lateness=0.08, min_lateness=8.0).best
    assert found.best.fuel >= unhindered.fuel * (1 - 1e-3)
    if found.shut:
        assert found.best.fuel >= unhindered.fuel * (1 + 1e-9)


def test_of_several_areas_only_those_are_closed_that_are_met() -> None:
    met = renew.ShutArea(BARRIER, 70.0, 90.0, "met")
    early = renew.ShutArea(box(140, -1, 150, 61), 0.0, 60.0, "over before it comes")
    found = plan(avoid=[met, early])
    assert found.shut == (met,)
    assert shapely.LineString(found.best.path).intersects(early.polygon)


def test_where_an_area_shuts_every_way_the_plan_is_refused_with_its_hours() -> None:
    whole = renew.ShutArea(box(95, -1, 105, 61), 70.0, 90.0, "firing range")
    with pytest.raises(
        renew.UnreachableError,
        match=r"every way may meet area 'firing range', which is shut from 70 s until 90 s; "
        r"around them: no water joins .*Depart at another time",
    ):
        plan(avoid=[whole])
    with pytest.raises(renew.UnreachableError, match="no water joins"):
        plan(avoid=[renew.ShutArea(whole.polygon)])


def test_a_departure_that_passes_while_it_is_open_is_found() -> None:
    area = renew.ShutArea(BARRIER, 60.0, 135.0)
    found = renew.plan_departures(
        CHART, STILL_BUT_TIMED, PAPER_VESSEL, START, GOAL, [0.0, 40.0, 80.0], avoid=[area]
    )
    assert found.unproven == math.inf
    assert found.fuels[2] == pytest.approx(160.0, rel=1e-3)
    assert (found.fuels[:2] > 161.0).all()
    assert found.plan.best.times[0] == 80.0
    for departure, path in zip(found.departures, found.paths, strict=True):
        assert path is not None
        assert shapely.LineString(path).intersects(BARRIER) == (departure == 80.0)
    late = renew.plan(
        CHART, STILL_BUT_TIMED, PAPER_VESSEL, START, GOAL, arrive_by=400.0, avoid=[area]
    )
    assert late.best.times[-1] <= 400.0
    assert flights_inside(late.best, BARRIER, (60.0, 135.0), STILL, 0.05) == 0


STILL_BUT_TIMED = renew.VaryingCurrent([0.0, 1000.0], [STILL, renew.UniformCurrent(1e-6, 0.0)])


def test_names_of_classes_keep_the_numbers_of_the_land() -> None:
    scene = single_gyre()
    free = scene.plan(classes=4)
    area = renew.ShutArea(box(75, 70, 85, 80))
    found = scene.plan(classes=8, avoid=[area])
    assert all(shapely.LineString(r.path).distance(area.polygon) > 0 for r in found.routes)
    names = {
        name.replace(".s4", "").replace(".p4", "") for name in (r.homotopy for r in found.routes)
    }
    assert free.best.homotopy in names


def test_an_invalid_area_is_refused() -> None:
    bow = Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])
    for given, text in (
        ((bow,), r"area '' is not valid: Self-intersection"),
        ((Polygon(),), "non-empty polygon"),
        ((Polygon([(0, 0), (1, 0), (1, math.inf)]),), "not finite"),
    ):
        with pytest.raises(renew.GeometryError, match=text):
            renew.ShutArea(*given)
    with pytest.raises(
        renew.ParameterError, match=r"from 5\.0 until 5\.0 s; the end must come after"
    ):
        renew.ShutArea(BARRIER, 5.0, 5.0)
