"""The risk of the padding by Monte Carlo: turns are integrated here, not taken in closed form.

In every triangle of every route's channel, and for every constrained edge of that triangle, at most
a share 1 - σ of the drawn turns reaches beyond the edge's padding. The test uses only what a plan
gives (the channel, the padding of each edge) and the current.
"""

import itertools
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest

import renew
from renew._types import FloatArray
from renew.turns.turn_reach import HEADING_SPREAD
from tests.strategies import PAPER_VESSEL, Scene, random_scene, single_gyre

# Number of drawn turns for each triangle and edge.
DRAWS = 20_000
# Number of steps of a full turn: its reach is too small by at most 3e-4 of the turning radius.
STEPS = 256


class Crossing(NamedTuple):
    """A triangle (3, 2) of a channel, and where the channel's midline enters and leaves it."""

    triangle: FloatArray
    enter: FloatArray
    leave: FloatArray


def crossings(route: renew.Route, start: FloatArray, goal: FloatArray) -> Iterator[Crossing]:
    """Triangles of a route's channel that have a passing edge with the ones before and after."""
    shared = [
        np.array([corner for corner in one if (other == corner).all(axis=1).any()])
        for one, other in itertools.pairwise(route.channel)
    ]
    middles = [start, *(edge.mean(axis=0) if len(edge) == 2 else None for edge in shared), goal]
    for triangle, (enter, leave) in zip(route.channel, itertools.pairwise(middles), strict=True):
        if enter is not None and leave is not None:
            yield Crossing(triangle, enter, leave)


def drawn_turns(
    crossing: Crossing, current: renew.CurrentField, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Headings (n,) rad and currents (n, 2) m/s at which turns in a triangle begin."""
    spread = current.statistics(crossing.triangle[None])
    speed = rng.normal(spread.speed[0], spread.speed_std[0], DRAWS).clip(min=0)
    towards = rng.normal(spread.direction[0], spread.direction_std[0], DRAWS)
    east, north = crossing.leave - crossing.enter
    heading = math.atan2(north, east) + rng.uniform(-HEADING_SPREAD, HEADING_SPREAD, DRAWS)
    return heading, speed[:, None] * np.column_stack([np.cos(towards), np.sin(towards)])


def reaches(heading: FloatArray, drift: FloatArray, normal: FloatArray) -> FloatArray:
    """Furthest reach (n,) m along a normal of full turns to either side, by the midpoint rule."""
    step = 2 * math.pi / PAPER_VESSEL.turn_rate / STEPS
    turned = PAPER_VESSEL.turn_rate * step * (np.arange(STEPS) + 0.5)
    # Distance made good along, and to the left of, the first heading in still water, by steps.
    along, left = (PAPER_VESSEL.speed * step * f(turned).cumsum() for f in (np.cos, np.sin))
    bearing = heading - math.atan2(normal[1], normal[0])
    carried = np.outer(drift @ normal, step * np.arange(1, STEPS + 1))
    carried += np.outer(np.cos(bearing), along)
    across = np.outer(np.sin(bearing), left)
    return np.asarray(np.maximum((carried + across).max(1), (carried - across).max(1)).clip(min=0))


def shares_beyond(
    route: renew.Route,
    current: renew.CurrentField,
    start: FloatArray,
    goal: FloatArray,
    rng: np.random.Generator,
) -> Iterator[float]:
    """Share of turns beyond the padding, for each triangle and each constrained edge of it."""
    for crossing in crossings(route, start, goal):
        heading, drift = drawn_turns(crossing, current, rng)
        for row in route.padding_used:
            a, b, padding = row[:2], row[2:4], row[4]
            if not all((crossing.triangle == vertex).all(axis=1).any() for vertex in (a, b)):
                continue
            normal = np.array([a[1] - b[1], b[0] - a[0]]) / math.dist(a, b)
            if (a - crossing.triangle.mean(axis=0)) @ normal < 0:
                normal = -normal
            yield float((reaches(heading, drift, normal) > padding).mean())


def check_risk(scene: Scene[Any], risk: float, classes: int) -> None:
    _, current, start, goal = scene.parts
    plan = scene.plan(classes=classes, risk=risk, padding="triangle")
    rng = np.random.default_rng(20_260_101)
    beyond = [
        share for route in plan.routes for share in shares_beyond(route, current, start, goal, rng)
    ]
    assert len(beyond) > classes
    assert max(beyond) <= risk + 3 * math.sqrt(risk * (1 - risk) / DRAWS)
    # Padding is a quantile and no worst case: in some places turns do reach beyond it.
    assert max(beyond) > 0


@pytest.mark.parametrize("risk", [0.05, 0.2])
def test_turns_in_the_single_gyre_are_within_the_risk_in_every_triangle(risk: float) -> None:
    check_risk(single_gyre(), risk, classes=2)


# Paths that bulge out of their channels. In the second and third scene they pass edges on headings
# for which the channel alone would not have padded those edges.
@pytest.mark.gate_share(1)
@pytest.mark.parametrize(("seed", "risk", "classes"), [(3, 0.05, 2), (5, 0.05, 4), (11, 0.3, 4)])
def test_turns_among_islands_are_within_the_risk_in_every_triangle(
    seed: int, risk: float, classes: int
) -> None:
    check_risk(random_scene(seed), risk, classes)


@pytest.mark.slow
@pytest.mark.parametrize("risk", [0.01, 0.05, 0.3])
@pytest.mark.parametrize("seed", range(12))
def test_turns_in_many_scenes_are_within_the_risk_in_every_triangle(seed: int, risk: float) -> None:
    check_risk(random_scene(seed), risk, classes=8)
