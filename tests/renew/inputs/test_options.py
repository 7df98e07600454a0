"""Options, times and points: all faults in them are named at once."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from shapely import box

import renew
from renew.inputs.options import RANGES, Padding
from tests.strategies import PAPER_VESSEL, STILL, single_gyre

ANY: Any = renew
"""The API without its types."""


@pytest.mark.parametrize(
    ("padding", "clearance", "width"),
    [("adaptive", 0.0, 0.0), ("adaptive", 2.0, 2.0), ("none", 3.0, 3.0), (4, 3.0, 4.0), (1, 3, 3)],
)
def test_no_padding_is_below_the_fixed_width_or_the_clearance(
    padding: Padding, clearance: float, width: float
) -> None:
    options = renew.PlanOptions(padding=padding, clearance=clearance)
    assert options.min_width == width
    assert options.is_adaptive == (padding == "adaptive")


@pytest.mark.parametrize("name", RANGES)
def test_the_ends_of_each_range_are_taken_and_what_lies_beyond_is_refused(name: str) -> None:
    bounds = RANGES[name]
    taken = [bounds["ge"], *([bounds["le"]] if "le" in bounds else [])]
    refused: list[object] = [-1, math.nan, None, "1", bounds.get("lt", math.inf)]
    refused += [bounds["le"] + 1] if "le" in bounds else []
    for value in taken:
        assert getattr(ANY.PlanOptions(**{name: value}), name) == value
    for value in refused:
        with pytest.raises(renew.ParameterError, match=f"^{name} = "):
            ANY.PlanOptions(**{name: value})


def test_all_faults_are_named_at_once_wherever_they_are_given() -> None:
    message = "(?s)classes = 0 .*samples = 0 .*order = 'x' .*"
    with pytest.raises(renew.ParameterError, match=message):
        ANY.PlanOptions(classes=0, samples=0, order="x")
    chart, current = single_gyre().parts[:2]
    given = chart, current, PAPER_VESSEL, (10, 10), (90, 90)
    message += "departure = nan .*arrive_by needs method = 'optimal'"
    with pytest.raises(renew.ParameterError, match=message):
        ANY.plan(
            *given, classes=0, samples=0, order="x", method="sampled", departure=math.nan,
            arrive_by=1.0,
        )  # fmt: skip
    with pytest.raises(TypeError, match=r"no option 'risks'; it has classes, risk, padding"):
        ANY.plan_departures(*given, [0.0], risks=0.1)


def test_options_as_an_object_and_by_name_give_one_plan() -> None:
    chart, current = single_gyre().parts[:2]
    given = chart, current, PAPER_VESSEL, (10, 10), (90, 90)
    options = renew.PlanOptions(classes=3, padding="none", drift="crab")
    by_name = renew.plan(*given, classes=3, padding="none", drift="crab")
    assert renew.plan(*given, options=options).best.fuel == by_name.best.fuel
    changed = renew.plan(*given, options=options, drift="projected", classes=1)
    assert len(changed.routes) == 1
    assert changed.best.fuel != by_name.best.fuel
    swept = renew.plan_departures(*given, [0.0], options=options)
    assert swept.plan.best.fuel == by_name.best.fuel
    with pytest.raises(dataclasses.FrozenInstanceError):
        ANY.PlanOptions().risk = 0.1


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
    start: tuple[float, float], goal: tuple[float, float], error: type[Exception], message: str
) -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(40, 40, 60, 60)])
    with pytest.raises(error, match=message):
        renew.plan(chart, STILL, PAPER_VESSEL, start, goal)


CHART, GYRE = single_gyre().parts[:2]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"chart": None}, r"chart = None must be a renew\.Chart"),
        ({"vessel": "boat"}, r"vessel = 'boat' must be a renew\.Vessel"),
        ({"avoid": [box(1, 1, 2, 2)]}, r"avoid\[0\] = .* must be a renew\.ShutArea"),
        ({"avoid": 3}, "avoid = 3 must be areas in a row"),
        ({"via": None}, "via = None must be points"),
        ({"via": "here"}, "via = 'here' must be points"),
        ({"start": ("10", "10")}, r"start = \('10', '10'\) must be real numbers"),
        ({"goal": np.array([90 + 1j, 90])}, "goal = .* must be real numbers"),
        ({"goal": np.ma.array([90.0, 90.0], mask=[True, False])}, "goal = .* real numbers"),
        ({"method": np.zeros(2)}, "method = .* is not one of optimal, sampled"),
        ({"padding": np.zeros(2), "distinct_by": np.zeros(2)}, "padding = .* must be"),
        ({"clearance": 10**400}, "clearance = 1000.* m must be finite"),
        ({"risk": np.complex128(0.1)}, "risk = .* must lie between"),
        ({"speed": np.array(1.0)}, "speed = .* must be two speeds"),
        ({"order": "x" * 5000}, r"^order = .{,110} is not one of fuel, length, depth-first$"),
        ({"current": lambda points: np.full(points.shape, "0.1")}, "the function .* real numbers"),
        ({"current": lambda points: 1j * points}, "current: what the function returned = .* real"),
        ({"padding": None}, "padding = None"),
        ({"distinct_by": math.nan}, "distinct_by = nan"),
        ({"risk": 0.0, "padding": -1.0}, r"padding = -1.0 must .*; risk = 0.0"),
        ({"padding": "wide"}, "'wide'"),
        ({"method": "magic"}, "'magic' is not one of optimal, sampled"),
        ({"drift": "none"}, "projected, crab"),
        ({"classes": 10**25}, "classes = 10000000000000000000000000 must be a whole number from 1"),
        ({"risk": 1e-10}, "risk = 1e-10 must lie between 1e-09 and 1"),
    ],
)
def test_arguments_of_another_kind_and_options_out_of_range_are_refused(
    wrong: dict[str, Any], message: str
) -> None:
    right = {"chart": CHART, "current": GYRE, "vessel": PAPER_VESSEL, "start": (10, 10)}
    with pytest.raises(renew.ParameterError, match=message):
        ANY.plan(**(right | {"goal": (90, 90)} | wrong))


def test_a_current_that_changes_faster_than_the_vessel_can_turn_is_refused() -> None:
    fast = renew.SwingingGyre(0.2, 100.0, 100.0, 0.25, omega=1e3)
    with pytest.raises(renew.ParameterError, match=r"changes by .* each second; more than 0\.305 "):
        renew.plan(CHART, fast, PAPER_VESSEL, (10, 10), (90, 90))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ANY.Vessel("1", None), "speed = '1' must be a number .*; turn_rate = None"),
        (lambda: ANY.Vessel(speed=True, turn_rate=0.6), "speed = True must be a number"),
        (lambda: ANY.UniformCurrent(None, 1j), r"u = None, v = 1j must be numbers"),
        (lambda: ANY.GyreCurrent(0.1, 9.0, 9.0, columns="2"), "columns = '2' must be numbers"),
        (lambda: ANY.GriddedCurrent([0, 1], [0, 1], [["a"]], None), "u = .* real numbers"),
        (lambda: ANY.GriddedCurrent([0, 1], [0, 1], [1, 2], [1]), "u has shape"),
        (lambda: ANY.VaryingCurrent(["0", "1"], [GYRE, GYRE]), "times = .* real numbers"),
        (lambda: ANY.VaryingCurrent([0, 1], None), "currents = None must be a sequence"),
        (lambda: ANY.ShutArea(box(0, 0, 1, 1), None, 3), "shut from None until 3 s"),
        (lambda: ANY.Chart(box(0, 0, 1, 1), box(0, 0, 1, 1)), "no_go must be polygons in a row"),
        (lambda: ANY.Chart(box(0, 0, 1, 1), [None]), r"no_go\[0\] must be a Polygon, not None"),
        (lambda: ANY.fuel([[0, 0], [math.inf, 1]], GYRE, PAPER_VESSEL), "path has points that"),
        (lambda: ANY.fuel([[0, 0], [1, 1]], GYRE, None), "vessel = None must be"),
        (lambda: ANY.fuel([[0, 0], [1, 1]], GYRE, PAPER_VESSEL, departure="0"), "departure = '0'"),
        (lambda: ANY.contingency(None, CHART, GYRE, PAPER_VESSEL), "path = None must be"),
        (lambda: ANY.tightest(None, GYRE, PAPER_VESSEL), r"route = None must be a renew\.Route"),
    ],
)
def test_objects_of_wrong_figures_are_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(renew.PlanningError, match=message):
        make()
