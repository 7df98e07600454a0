"""Overpowered water: no route leads through it, and the plan says where it is."""

import re
from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely import Point, box

import renew
from renew.classes.triangulation import overpowered_water
from renew.voyage.voyage import Voyage
from tests.strategies import PAPER_VESSEL

CHART = renew.Chart(box(0, 0, 100, 100))


def race(points: np.ndarray) -> np.ndarray:
    """A tidal race across the middle of the chart, 2 m/s to the south at its strongest."""
    away = np.hypot((points[..., 0] - 50) / 15, (points[..., 1] - 50) / 25)
    return np.stack([np.zeros_like(away), -2 * np.exp(-(away**4))], axis=-1)


def strength(points: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(race(points), axis=-1))


def test_routes_lead_around_it_on_both_sides() -> None:
    plan = renew.plan(CHART, race, PAPER_VESSEL, (10, 50), (90, 50))
    assert sorted(route.homotopy for route in plan.routes) == ["e", "s1"]
    for route in plan.routes:
        line = shapely.LineString(route.path)
        assert not line.intersects(plan.overpowering)
        along = shapely.get_coordinates(line.segmentize(0.1))
        assert strength(along).max() < PAPER_VESSEL.speed
        assert np.isinf(route.clearance)
    # The way round costs no more than a generous estimate of the detour.
    detour = np.array([[10, 50], [35, 85], [65, 85], [90, 50]], dtype=float)
    assert plan.best.fuel < renew.fuel(detour, race, PAPER_VESSEL)


def test_it_covers_all_of_it_and_little_more() -> None:
    plan = renew.plan(CHART, race, PAPER_VESSEL, (10, 50), (90, 50), classes=1)
    voyage = plan.best.fuel_bound.source
    assert isinstance(voyage, Voyage)
    table = voyage.table
    zone = overpowered_water(voyage)
    assert zone.equals(plan.overpowering)
    points = np.random.default_rng(0).uniform(0, 100, (20_000, 2))
    strong = strength(points) >= PAPER_VESSEL.speed
    cell = table.x[1] - table.x[0]
    covered = shapely.dwithin(zone, shapely.points(points[strong]), 0.1 * cell)
    assert strong.any()
    assert covered.all()
    true_zone = shapely.MultiPoint(points[strong]).convex_hull  # an oval
    assert zone.within(true_zone.buffer(2 * cell))


def test_a_weaker_current_closes_no_water() -> None:
    plan = renew.plan(CHART, lambda p: 0.4 * race(p), PAPER_VESSEL, (10, 50), (90, 50))
    assert plan.overpowering.is_empty
    assert [route.homotopy for route in plan.routes] == ["e"]


def test_a_chart_blocked_by_it_is_unreachable() -> None:
    def stream(points: np.ndarray) -> np.ndarray:
        strong = np.exp(-(((points[..., 0] - 50) / 15) ** 4))
        return np.stack([np.zeros_like(strong), -2 * strong], axis=-1)

    with pytest.raises(
        renew.UnreachableError,
        match=r"the current shuts all ways .* runs at 2 m/s at \(5.*, 50\) m, and the vessel makes "
        r"1 m/s .* Take a vessel of 2\.0\d m/s",
    ) as refused:
        renew.plan(CHART, stream, PAPER_VESSEL, (10, 50), (90, 50))
    enough = float(re.findall(r"a vessel of ([\d.]+) m/s", str(refused.value))[0])
    faster = replace(PAPER_VESSEL, speed=enough)
    assert renew.plan(CHART, stream, faster, (10, 50), (90, 50), padding="none").routes
    # A strait's stream that turns: what it never falls below counts.
    turning = renew.VaryingCurrent([0, 500], [stream, lambda points: 0.8 * stream(points)])
    with pytest.raises(renew.UnreachableError, match=r"runs at no less than 1\.6 m/s"):
        renew.plan(CHART, turning, PAPER_VESSEL, (10, 50), (90, 50))


def test_land_and_not_the_current_is_said_to_separate_them() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(70, -1, 75, 101)])
    with pytest.raises(renew.UnreachableError, match="the no-go zone separates them"):
        renew.plan(chart, race, PAPER_VESSEL, (10, 50), (90, 50))


@pytest.mark.parametrize(("name", "first"), [("start", 0), ("goal", 1)])
def test_a_start_or_goal_in_it_is_refused(name: str, first: int) -> None:
    points = [(50.0, 50.0), (10.0, 50.0)]
    message = f"at the {name} runs at 2 m/s; the vessel makes 1 m/s"
    with pytest.raises(renew.CurrentTooStrongError, match=message):
        renew.plan(CHART, race, PAPER_VESSEL, points[first], points[1 - first])


def test_it_is_made_of_polygons_even_where_it_only_touches_a_shore() -> None:
    def stream(points: np.ndarray) -> np.ndarray:
        strong = 0.02 * points[..., 0]
        return np.stack([np.zeros_like(strong), strong], axis=-1)

    # The current is as strong as the vessel, less 1 %, from x = 49.5 on; there an island begins.
    chart = renew.Chart(box(0, 0, 100, 100), [box(49.5, 20, 101, 80)])
    plan = renew.plan(chart, stream, PAPER_VESSEL, (10, 10), (10, 90), classes=1)
    assert plan.overpowering.geom_type == "MultiPolygon"
    assert plan.overpowering.bounds == pytest.approx((49.5, 0, 100, 100))
    assert plan.overpowering.area == pytest.approx(2 * 50.5 * 20)


def test_islands_keep_their_numbers() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [Point(20, 20).buffer(4), Point(80, 80).buffer(3)])
    plan = renew.plan(chart, race, PAPER_VESSEL, (10, 50), (90, 50), padding="none")
    letters = {letter for r in plan.routes for letter in r.homotopy.split(".")} - {"e"}
    assert letters == {"s1", "s2", "s3"}
    south = next(route for route in plan.routes if route.homotopy == "s1")
    # South of the race and north of the larger island.
    assert shapely.LineString(south.path).intersects(box(49, 0, 51, 50))
