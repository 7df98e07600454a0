"""The place where a route is nearest to land: where it is, and how far turns reach there."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import renew
from renew.turns.turn_reach import turn_reach
from tests.strategies import PAPER_VESSEL, random_scene


@pytest.fixture(scope="module")
def planned() -> tuple[renew.Route, renew.CurrentField, renew.Tightest]:
    chart, current, start, goal = random_scene(5)
    route = renew.plan(chart, current, PAPER_VESSEL, start, goal, classes=1).best
    found = renew.tightest(route, current, PAPER_VESSEL)
    assert found is not None
    return route, current, found


def test_it_is_where_the_route_is_nearest_to_land(
    planned: tuple[renew.Route, renew.CurrentField, renew.Tightest],
) -> None:
    route, _, found = planned
    way = shapely.LineString(route.path)
    assert found.gap == pytest.approx(shapely.LineString(found.edge).distance(way))
    assert found.gap == pytest.approx(route.clearance, abs=0.3 * PAPER_VESSEL.turning_radius)
    assert shapely.Point(found.point).distance(way) < 1e-9
    assert shapely.Point(found.point).distance(shapely.LineString(found.edge)) == pytest.approx(
        found.gap
    )
    # The path lies outside the soft no-go zone.
    assert found.gap >= found.padding


def test_turns_reach_no_further_than_the_risk_allows(
    planned: tuple[renew.Route, renew.CurrentField, renew.Tightest],
) -> None:
    route, current, found = planned
    assert found.reaches.shape == (4096,)
    assert (found.reaches > found.gap).mean() <= 0.06
    # Begun on the course in the mean current, a turn reaches no further than most draws do.
    triangle = next(
        t
        for t in route.corners
        if shapely.Polygon(t).buffer(1e-9).contains(shapely.Point(found.point))
    )
    mean = current.statistics(triangle[None]).mean[0]
    away = found.edge.mean(axis=0) - found.point
    normal = np.array([found.edge[0, 1] - found.edge[1, 1], found.edge[1, 0] - found.edge[0, 0]])
    normal = normal / np.linalg.norm(normal) * np.sign(normal @ away)
    reach = turn_reach(PAPER_VESSEL, np.asarray(found.heading), mean, normal)
    assert found.reaches.min() < reach < np.quantile(found.reaches, 0.95)


def test_a_route_without_padding_has_no_such_place() -> None:
    chart, current, start, goal = random_scene(5)
    route = renew.plan(chart, current, PAPER_VESSEL, start, goal, classes=1, padding="none").best
    assert renew.tightest(route, current, PAPER_VESSEL) is None
