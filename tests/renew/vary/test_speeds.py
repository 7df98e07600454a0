"""Speeds chosen through via points, around areas shut for some hours, and at several departures."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.optimize import minimize_scalar
from shapely import box

import renew
from tests.renew.test_shut_areas import BARRIER, CHART, START, flights_inside
from tests.strategies import PAPER_VESSEL, STILL, StreamFunctionCurrent

GOAL = (180.0, 30.0)
ISLAND = renew.Chart(box(0, 0, 150, 150), [box(60, 55, 90, 84)])
CORNERS = (20.0, 30.0), (75.0, 120.0), (130.0, 40.0)
# Turns cost it nothing, so that the way to a point and the way on can be planned for themselves.
NIMBLE = renew.Vessel(speed=1.0, turn_rate=10.0, length=0.01)
PERIOD, STRENGTH = 200.0, 0.3


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "exponent"), [(0, 2.0), (1, 3.0)])
def test_no_share_of_the_time_between_the_ways_to_and_from_a_point_needs_less(
    seed: int, exponent: float
) -> None:
    """SciPy divides the time between two plans; one price of time for both is as good."""
    current, deadline, speeds = StreamFunctionCurrent(seed, 0.5), 160.0, (0.5, 2.0)
    vessel = replace(NIMBLE, fuel_exponent=exponent)
    start, point, goal = CORNERS
    best = renew.plan(
        ISLAND, current, vessel, start, goal, via=[point], classes=4, speed=speeds,
        arrive_by=deadline,
    ).best  # fmt: skip

    def in_two_parts(first: float) -> float:
        return sum(
            renew.plan(
                ISLAND, current, vessel, *ends, classes=4, speed=speeds, arrive_by=time
            ).best.fuel
            for *ends, time in ((start, point, first), (point, goal, deadline - first))
        )

    oracle = minimize_scalar(
        in_two_parts, bounds=(70.0, 95.0), method="bounded", options={"xatol": 0.5, "maxiter": 5}
    ).fun
    assert best.fuel == pytest.approx(oracle, rel=2e-3)
    assert best.fuel_bound.value <= oracle
    assert best.times[-1] <= deadline
    assert shapely.distance(shapely.LineString(best.path), shapely.Point(point)) < 0.01


@pytest.mark.slow
def test_turns_at_the_speeds_chosen_are_safe_through_a_point() -> None:
    start, point, goal = CORNERS
    current = StreamFunctionCurrent(2, 0.5)
    chart = renew.Chart(ISLAND.extent, [box(60, 55, 90, 106)])
    plan = renew.plan(
        chart, current, PAPER_VESSEL, start, goal, via=[point], speed=(0.6, 2.0), arrive_by=200.0,
        classes=3,
    )  # fmt: skip
    for route in plan.routes:
        flown = renew.contingency(route, chart, current, PAPER_VESSEL, spacing=0.3)
        assert (flown.trials > 1000, flown.collisions) == (True, 0)
        assert route.times[-1] <= 200.0
        assert len(np.unique(route.speeds)) > 1


def test_via_points_in_a_current_that_changes_are_refused_with_the_remedy() -> None:
    current = renew.SwingingGyre(0.05, 150.0, 150.0, 0.25, 0.05)
    with pytest.raises(renew.ParameterError, match="plan from one via point to the next"):
        renew.plan(
            ISLAND, current, PAPER_VESSEL, CORNERS[0], CORNERS[2], via=[CORNERS[1]],
            speed=(0.5, 2.0), arrive_by=300.0,
        )  # fmt: skip


@pytest.mark.parametrize(
    ("hours", "is_entered"),
    [
        ((60.0, 90.0), True),  # at its highest speed the vessel arrives at 75 s
        ((140.0, 160.0), False),  # at the speed of least fuel it arrives there at 150 s
        ((205.0, 260.0), True),
    ],
)
def test_an_area_is_kept_out_of_at_the_speeds_chosen(
    hours: tuple[float, float], is_entered: bool
) -> None:
    """Least fuel in still water takes all the time there is: half the speed, and 150 s."""
    area = renew.ShutArea(BARRIER, *hours)
    plan = renew.plan(
        CHART, STILL, PAPER_VESSEL, START, GOAL, avoid=[area], speed=(0.2, 1.0), arrive_by=320.0
    )
    assert shapely.LineString(plan.best.path).intersects(BARRIER) == is_entered
    assert plan.trade_off is None
    for route in plan.routes:
        assert route.times[-1] <= 320.0
        assert flights_inside(route, BARRIER, hours, STILL, 0.05) == 0
    if is_entered:
        assert plan.best.fuel == pytest.approx(320.0 * 0.5**2, rel=1e-3)


def ebb(points: np.ndarray, times: np.ndarray) -> np.ndarray:
    """A tide that is the same everywhere, along the way and against it."""
    u = STRENGTH * np.sin(2 * np.pi * np.asarray(times) / PERIOD)
    return np.stack([u + 0 * points[..., 0], 0 * points[..., 0]], axis=-1)


def closed_form(departure: float, deadline: float, length: float, most: float) -> float:
    """Least fuel, v² a second, at one speed, which is best where the tide is the same everywhere.

    Over all arrivals up to the deadline.
    """
    arrivals = np.linspace(departure + 1.0, deadline, 20_001)
    phase = 2 * np.pi / PERIOD
    carried = STRENGTH / phase * (np.cos(phase * departure) - np.cos(phase * arrivals))
    lasts = arrivals - departure
    speed = (length - carried) / lasts
    return float(np.where((speed <= most) & (speed > 0.2), speed**2 * lasts, math.inf).min())


@pytest.mark.slow
def test_each_departure_has_the_speeds_of_least_fuel_and_the_best_one_is_found() -> None:
    current = renew.VaryingCurrent(np.linspace(0.0, 600.0, 241), ebb)
    departures, deadline = np.array([0.0, 180.0, 290.0]), 380.0
    told: list[int] = []
    given = CHART, current, NIMBLE, START, GOAL
    asked: dict[str, Any] = {
        "speed": (0.2, 1.5),
        "arrive_by": deadline,
        "classes": 1,
        "drift": "crab",
    }
    found = renew.plan_departures(
        *given, departures, progress=lambda count, _: told.append(count), **asked
    )
    least = [closed_form(t, deadline, 160.0, 1.5) for t in departures.tolist()]
    assert math.isinf(least[-1])
    np.testing.assert_allclose(found.fuels[:-1], least[:-1], rtol=2e-3)
    assert math.isinf(found.fuels[-1])
    assert "arrive_by = 380 s can't be made" in found.reasons[-1]
    assert found.paths[-1] is None
    assert found.best == int(np.argmin(least))
    assert (found.arrivals[:-1] <= deadline).all()
    assert found.unproven == math.inf
    assert told == [1, 2, 3]
    alone = renew.plan(*given, departure=float(departures[found.best]), **asked)
    assert found.plan.best.fuel == pytest.approx(alone.best.fuel, rel=1e-4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"arrive_by": 300.0}, "give speed=.lowest, highest"),
        ({"speed": (0.5, 1.0), "to_within": 5.0}, "to_within can't be proven"),
        ({"speed": (0.5, 1.0), "arrive_by": 300.0, "method": "sampled"}, "not 'sampled'"),
    ],
)
def test_what_a_sweep_cannot_do_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(renew.ParameterError, match=message):
        renew.plan_departures(CHART, STILL, NIMBLE, START, GOAL, [0.0, 10.0], **options)  # type: ignore[arg-type]


def test_where_no_departure_is_in_time_the_error_says_so() -> None:
    with pytest.raises(renew.ArrivalError, match="let speed reach"):
        renew.plan_departures(
            CHART, STILL, NIMBLE, START, GOAL, [0.0, 10.0], speed=(0.5, 1.0), arrive_by=100.0
        )


@pytest.mark.parametrize("arrive_by", [61.0, 77.7, 93.3])
def test_the_speed_that_an_error_asks_for_is_enough(arrive_by: float) -> None:
    def plan(most: float) -> renew.Plan:
        return renew.plan(
            CHART, STILL, NIMBLE, START, GOAL, departure=0.0, arrive_by=arrive_by, speed=(0.5, most)
        )

    with pytest.raises(renew.ArrivalError) as caught:
        plan(1.0)
    asked = re.search(r"let speed reach ([\d.]+) m/s", str(caught.value))
    assert asked is not None
    assert plan(float(asked[1])).best.times[-1] <= arrive_by
