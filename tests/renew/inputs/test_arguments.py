"""Bad arguments of plan(): each is refused, with its value and what would do."""

from __future__ import annotations

import math

import pytest
from shapely import Polygon, box

import renew
from tests.strategies import PAPER_VESSEL, single_gyre

STILL = renew.UniformCurrent(0.0, 0.0)


@pytest.mark.parametrize(
    ("start", "goal", "error", "message"),
    [
        (
            (50, 50),
            (90, 90),
            renew.StartInNoGoError,
            r"start \(50, 50\) m lies in the no-go zone, 10 m",
        ),
        ((10, 10), (50, 45), renew.GoalInNoGoError, r"5 m from the nearest water at \(50, 40\)"),
        ((-3, 10), (90, 90), renew.StartInNoGoError, "off the chart, 3 m"),
        ((math.nan, 1), (90, 90), renew.ParameterError, "two finite numbers"),
        ((10, 10), (10, 10), renew.ParameterError, "the same point"),
    ],
)
def test_bad_endpoints_are_refused(
    start: tuple[float, float],
    goal: tuple[float, float],
    error: type[Exception],
    message: str,
) -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(40, 40, 60, 60)])
    with pytest.raises(error, match=message):
        renew.plan(chart, STILL, PAPER_VESSEL, start, goal)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"classes": 0}, "classes = 0"),
        ({"classes": "2", "seed": -1}, r"classes = '2' .*; seed = -1"),
        ({"padding": None}, "padding = None"),
        ({"distinct_by": math.nan}, "distinct_by = nan"),
        ({"samples": 0, "method": "sampled"}, "samples = 0"),
        ({"risk": 0.0, "padding": -1.0}, r"padding = -1.0 must .*; risk = 0.0"),
        ({"risk": 1.0}, "risk = 1.0"),
        ({"padding": "wide"}, "'wide'"),
        ({"clearance": math.inf}, "clearance = inf"),
        ({"method": "magic"}, "'magic' is not one of optimal, sampled"),
        ({"order": "random"}, "'random'"),
        ({"drift": "none"}, "projected, crab"),
        ({"classes": 10**25}, "classes = 10000000000000000000000000 must be a whole number from 1"),
        ({"samples": 10**9}, "samples = 1000000000"),
        ({"seed": 2**80}, "seed = "),
        ({"risk": 1e-10}, "risk = 1e-10 must lie between 1e-09 and 1"),
    ],
)
def test_bad_options_are_refused(options: dict[str, object], message: str) -> None:
    chart, current = single_gyre()
    with pytest.raises(renew.ParameterError, match=message):
        renew.plan(chart, current, PAPER_VESSEL, (10, 10), (90, 90), **options)  # type: ignore[arg-type]


def test_a_current_too_strong_at_the_start_is_refused() -> None:
    with pytest.raises(renew.CurrentTooStrongError, match=r"1\.5 m/s; the vessel makes 1 m/s"):
        renew.plan(
            renew.Chart(box(0, 0, 100, 100), [Polygon([(40, 40), (60, 40), (50, 60)])]),
            renew.UniformCurrent(1.5, 0),
            PAPER_VESSEL,
            (10, 10),
            (90, 90),
        )
