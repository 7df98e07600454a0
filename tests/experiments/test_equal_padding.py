"""The padding that rivals keep: no more than ours, and no hole where no route of ours passes."""

import math

import numpy as np
import pytest
import shapely

import renew
from experiments.kernels.water import PaddedWater
from experiments.referee.equal_padding import equal_padding, smallest_paddings
from renew.voyage.voyage import Voyage, Waters
from tests.experiments.scenes import VESSEL, islands_voyage


def planned(voyage: Voyage, classes: int = 16) -> renew.Plan:
    places = voyage.start, voyage.goal
    return renew.plan(
        voyage.chart, voyage.current, voyage.vessel, *places, classes=classes, padding="triangle"
    )


@pytest.mark.slow
def test_rivals_need_keep_no_further_off_than_our_best_route() -> None:
    voyage = islands_voyage()
    plan = planned(voyage)
    water = PaddedWater.of(voyage.chart, equal_padding(plan, voyage))
    # The route may touch V: middles of its legs lie off it, but for rounding.
    middles = (plan.best.path[1:] + plan.best.path[:-1]) / 2
    assert water.holds(middles).mean() > 0.95
    # And where it is padded, a path closer to land is not allowed.
    assert plan.best.padding_used[:, 4].max() > 0
    padded = plan.best.padding_used[plan.best.padding_used[:, 4] > 0.5]
    beside = padded[:, :2] + 0.45 * padded[:, 4:5] * np.array([[0.0, -1.0]])
    assert not water.holds(beside).any()


def strait_voyage() -> Voyage:
    """A strait of 2 m on the straight way between two islands; a turn is 3.3 m wide."""
    islands = [shapely.box(25, 5, 35, 29), shapely.box(25, 31, 35, 55)]
    chart = renew.Chart(shapely.box(0, 0, 60, 60), islands)
    current = renew.UniformCurrent(0.0, 0.0)
    return Voyage(
        Waters(chart, current), VESSEL, np.array([5.0, 30.0]), np.array([55.0, 30.0]), "projected"
    )


def test_a_strait_too_narrow_for_any_route_of_ours_is_shut_to_rivals() -> None:
    voyage = strait_voyage()
    plan = planned(voyage)
    # No route passes the strait, so no route pads its shores.
    assert all(abs(route.path[:, 1] - 30).max() > 20 for route in plan.routes)
    water = PaddedWater.of(voyage.chart, equal_padding(plan, voyage))
    a, b = np.array([[20.0, 30.0]]), np.array([[40.0, 30.0]])
    assert PaddedWater.of(voyage.chart).clear(a, b)[0]
    assert not water.clear(a, b)[0]


def test_without_a_current_each_shore_has_the_width_of_a_turn() -> None:
    """In still water a hard-over turn begun along a shore is as wide as its circle, 2 v/ω."""
    paddings = smallest_paddings(strait_voyage())
    width = 2 * VESSEL.turning_radius
    assert len(paddings) == 8
    assert list(paddings.values()) == pytest.approx([width] * 8, rel=1e-3)


@pytest.mark.parametrize("angle", [0, 90, 180, 270])
def test_a_current_off_the_shore_needs_less_padding_than_one_on_to_it(angle: float) -> None:
    """The padding of the northern shore of the strait grows with the current towards it."""
    still = strait_voyage()
    towards = math.sin(math.radians(angle))
    current = renew.UniformCurrent(0.4 * math.cos(math.radians(angle)), 0.4 * towards)
    voyage = Voyage(Waters(still.chart, current), VESSEL, still.start, still.goal, "projected")
    found, without = (north_shore(one) for one in (voyage, still))
    assert math.copysign(1, round(found - without, 6)) == towards or abs(towards) < 1e-9


def north_shore(voyage: Voyage) -> float:
    """Padding (m) of the northern shore of the strait."""
    paddings = {tuple(np.round(ends, 3)): one for ends, one in smallest_paddings(voyage).items()}
    return paddings[25.0, 31.0, 35.0, 31.0]


def test_the_floor_on_the_padding_holds_for_every_shore() -> None:
    assert min(smallest_paddings(strait_voyage(), 5.0).values()) == 5.0
