"""Risk at every point of a route, against turns drawn and flown by a twin that knows no padding."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import renew
from renew._types import FloatArray
from renew.inputs.current import as_field
from renew.inputs.options import RiskAt
from renew.turns.contingency import stations
from tests.strategies import PAPER_VESSEL, random_scene

RISK, DRAWS = 0.05, 500


def shares_that_touch(
    route: renew.Route, chart: renew.Chart, current: renew.CurrentField
) -> FloatArray:
    """Shares (n,) of turns drawn every 2 m of a route that touch land.

    Left out are points in V around a start or goal that lies in V itself.
    """
    rng = np.random.default_rng(1)
    land = chart.hard_no_go
    shapely.prepare(land)
    points, course = stations(route.path, 2.0)
    triangles = shapely.polygons(route.corners)
    tree = shapely.STRtree(triangles)
    v, w = PAPER_VESSEL.speed, PAPER_VESSEL.turn_rate
    time = np.linspace(0, PAPER_VESSEL.turn_period, 73)
    parts = [
        part
        for part in shapely.get_parts(route.soft_no_go)
        if part.intersects(shapely.MultiPoint(route.path[[0, -1]]))
    ]
    shares = []
    for point, heading in zip(points, course, strict=True):
        place = shapely.Point(point)
        if any(part.intersects(place) for part in parts) or place.distance(land) > 12.0:
            continue
        own = tree.query(place, predicate="intersects")[:1]
        s = as_field(current).statistics(route.corners[own])
        speed = np.maximum(0.0, rng.normal(s.speed[0], s.speed_std[0], DRAWS))
        towards = rng.normal(s.direction[0], s.direction_std[0], DRAWS)
        drift = speed[:, None] * np.stack([np.cos(towards), np.sin(towards)], axis=-1)
        begin = heading + rng.uniform(-np.radians(20), np.radians(20), DRAWS)
        touched = np.zeros(DRAWS, dtype=bool)
        for side in (1.0, -1.0):
            turned = begin[:, None] + side * w * time
            circle = np.stack(
                [
                    np.sin(turned) - np.sin(begin)[:, None],
                    np.cos(begin)[:, None] - np.cos(turned),
                ],
                axis=-1,
            )
            track = point + side * v / w * circle + drift[:, None] * time[:, None]
            touched |= shapely.intersects(shapely.linestrings(track), land)
        shares.append(touched.mean())
    return np.array(shares)


@pytest.mark.parametrize("seed", [18, 19])
def test_from_no_point_more_turns_reach_land_than_the_risk_allows(seed: int) -> None:
    chart, current, start, goal = random_scene(seed, 0.85)

    def worst(risk_at: RiskAt) -> float:
        plan = renew.plan(
            chart, current, PAPER_VESSEL, start, goal, classes=4, risk=RISK, risk_at=risk_at
        )
        return float(max(shares_that_touch(route, chart, current).max() for route in plan.routes))

    # Three standard deviations of a share of as many draws.
    error = 3 * np.sqrt(RISK * (1 - RISK) / DRAWS)
    assert worst("route") > RISK + error
    assert worst("point") <= RISK + error


def test_a_risk_at_every_point_needs_adaptive_padding() -> None:
    chart, current, start, goal = random_scene(0)
    with pytest.raises(renew.ParameterError, match=r'needs padding = "adaptive", not 2\.0'):
        renew.plan(chart, current, PAPER_VESSEL, start, goal, padding=2.0, risk_at="point")
