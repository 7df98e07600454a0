"""When to leave: fuel by departure, the best one and its proof, and arrival by a time."""

import math
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar
from shapely import box

import renew
from renew._types import FloatArray
from renew.inputs.options import Padding
from renew.planner.classes import ClassSearch
from renew.request import Request
from renew.vary.departures import in_order_of_arrival, sailing_at
from renew.voyage.voyage import Voyage
from tests.moving_waters import moving_scene
from tests.strategies import PAPER_VESSEL

PERIOD, STRENGTH = 400.0, 0.4
CHART = renew.Chart(box(0, 0, 200, 60))
START, GOAL = (20.0, 30.0), (180.0, 30.0)
TIMES = np.arange(0.0, 1600.0, 20.0)


def _tide(time: float) -> float:
    return STRENGTH * math.cos(2 * math.pi * time / PERIOD)


def _along(points: FloatArray, times: FloatArray) -> FloatArray:
    """Velocity (..., 2) of the tide, which runs along the way everywhere."""
    del points
    u = STRENGTH * np.cos(2 * np.pi * times / PERIOD)
    return np.stack([u, np.zeros_like(u)], axis=-1)


TIDE = renew.VaryingCurrent(TIMES, _along)


def _duration(departure: float) -> float:
    """Least time in a tide that runs along the way: nothing is gained by leaving the line."""

    def missing(duration: float) -> float:
        carried, _ = quad(_tide, departure, departure + duration)
        return float(duration + carried - math.dist(START, GOAL))

    return float(brentq(missing, 50.0, 400.0))


def test_durations_and_the_best_departure_are_those_of_the_tide() -> None:
    given = np.arange(0.0, 401.0, 100.0)
    found = renew.plan_departures(CHART, TIDE, PAPER_VESSEL, START, GOAL, given, to_within=5.0)
    exact = np.array([_duration(t) for t in found.departures])
    assert found.durations == pytest.approx(exact, rel=1e-3)
    assert set(given) <= set(found.departures)
    least = minimize_scalar(_duration, bounds=(200.0, 400.0), method="bounded").fun
    assert found.durations[found.best] == pytest.approx(least, rel=1e-3)
    assert found.fuels == pytest.approx(found.durations * PAPER_VESSEL.fuel_rate)
    assert found.plan.best.times[0] == found.departures[found.best]
    assert found.plan.best.fuel == found.fuels[found.best]


def test_the_choice_is_proven_with_few_plans() -> None:
    tolerance, reports = 8.0, []
    found = renew.plan_departures(
        CHART,
        TIDE,
        PAPER_VESSEL,
        START,
        GOAL,
        [0.0, 800.0],
        to_within=tolerance,
        progress=lambda count, unproven: reports.append((count, unproven)),
    )
    assert found.unproven <= tolerance * (1 + 1e-5)
    assert [count for count, _ in reports] == list(range(1, len(found.departures) + 1))
    # Departures looked at: both ends, at most as many as cross the window in steps of the
    # tolerance, and six near the best.
    assert len(found.departures) <= 2 + 800 / tolerance + 6
    best = found.durations[found.best]
    assert min(_duration(t) for t in np.arange(0.0, 800.0, 2.0)) >= best - found.unproven


def test_without_a_tolerance_only_those_asked_for_are_planned() -> None:
    found = renew.plan_departures(CHART, TIDE, PAPER_VESSEL, START, GOAL, [0.0, 90.0, 200.0])
    assert found.departures.tolist() == [0.0, 90.0, 200.0]
    # A departure after 0 s arrives no earlier than one at 0 s; the tide's rate of change gives a
    # closer bound.
    bound = min(a - after for a, after in zip(found.arrivals, found.departures[1:], strict=False))
    best = found.durations[found.best]
    assert 0 < found.unproven < best - bound
    assert min(_duration(t) for t in np.arange(0.0, 200.0, 2.0)) >= best - found.unproven


@pytest.mark.parametrize("drift", ["projected", "crab"])
@pytest.mark.parametrize("seed", range(3))
def test_no_path_gains_more_by_leaving_later_than_the_current_changes(
    seed: int, drift: Literal["projected", "crab"]
) -> None:
    scene = moving_scene(seed)
    path = scene.plan(padding="none", classes=1).best.path
    voyage = replace(scene, drift=drift, departure=0.0).voyage
    departures = np.arange(0.0, 120.0, 2.0)
    taken = np.array([voyage.leaving(t).fuel(path) for t in departures.tolist()])
    slope = 1 - math.exp(-voyage.speed_change * (taken.max() + 2.0))
    assert 0 < slope < 1
    assert (np.diff(taken) / 2.0).min() >= -slope * (1 + 1e-6)


def test_departures_in_a_current_that_does_not_change_need_no_plans_between() -> None:
    still = renew.UniformCurrent(0.1, 0.0)
    found = renew.plan_departures(
        CHART, still, PAPER_VESSEL, START, GOAL, [0.0, 1e4, 2e4], to_within=10.0
    )
    assert found.unproven == pytest.approx(0.0, abs=1e-6)
    assert len(found.departures) <= 3 + 6


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("padding", ["none", "adaptive"])
def test_departures_are_planned_as_single_plans_and_in_order_of_arrival(padding: Padding) -> None:
    scene = moving_scene(7)
    given = np.linspace(0.0, 300.0, 4)
    found = scene.plan_departures(given, padding=padding)
    single = [scene.plan(departure=t, padding=padding).best for t in given.tolist()]
    assert found.fuels == pytest.approx([route.fuel for route in single], rel=2e-3)
    assert (np.diff(found.arrivals) >= -1e-6).all()
    assert len(set(found.homotopies)) > 1
    for path, times, fuel in zip(found.paths, found.times, found.fuels, strict=True):
        assert times is not None
        assert path is not None
        sailed = renew.fuel(
            path, scene.current, PAPER_VESSEL, drift=scene.drift, departure=times[0]
        )
        assert sailed == pytest.approx(fuel, rel=1e-9)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", [2, 4, 11])
def test_a_few_classes_are_enough_to_find_the_best_one(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside a sweep that looks at all sixteen at each departure."""
    scene = moving_scene(seed)
    departures = scene.departure + np.array([0.0, 40.0, 80.0])
    found = scene.plan_departures(departures, with_classes=False)
    monkeypatch.setattr(ClassSearch, "find_best", ClassSearch.find_first)
    every = scene.plan_departures(departures, with_classes=False)
    np.testing.assert_allclose(found.fuels, every.fuels, rtol=1e-4)


def test_the_next_departures_path_is_sailed_where_it_arrives_earlier() -> None:
    scene = moving_scene(7)
    voyage = scene.plan(classes=1).best.fuel_bound.source
    assert isinstance(voyage, Voyage)
    options = renew.PlanOptions(classes=4, drift=voyage.drift)
    request = Request(scene.chart, voyage.current, PAPER_VESSEL, voyage.stops, options)
    early, late = sailing_at(request, 0.0), sailing_at(request, 1.0)
    assert early.found is not None
    poor = replace(early, found=early.found._replace(fuel=early.found.fuel + 100.0))
    better, same = in_order_of_arrival([poor, late])
    assert same is late
    assert better.found is not None
    assert late.found is not None
    assert better.arrival <= late.arrival
    assert np.array_equal(better.found.path, late.found.path)
    # Nothing is changed where all is in order.
    assert in_order_of_arrival([early, late])[0] is early


def test_the_latest_departure_that_arrives_in_time() -> None:
    for asked in (300.0, 520.0):
        route = renew.plan(CHART, TIDE, PAPER_VESSEL, START, GOAL, arrive_by=asked).best
        latest = brentq(lambda t, by=asked: t + _duration(t) - by, 0.0, asked)
        assert route.times[-1] <= asked
        assert route.times[0] == pytest.approx(latest, abs=2e-3 * route.duration)


def test_an_arrival_in_a_steady_current() -> None:
    current = renew.UniformCurrent(0.1, 0.0)
    route = renew.plan(CHART, current, PAPER_VESSEL, START, GOAL, arrive_by=1000.0).best
    assert 1000.0 - 1e-3 * route.duration <= route.times[-1] <= 1000.0


def test_an_arrival_that_cannot_be_made_says_what_would_do() -> None:
    with pytest.raises(renew.ArrivalError) as caught:
        renew.plan(CHART, TIDE, PAPER_VESSEL, START, GOAL, departure=400.0, arrive_by=500.0)
    message = str(caught.value)
    assert f"arrives at {400 + _duration(400.0):.4g}"[:14] in message
    departure, speed = _numbers_after(message, "leave before "), _numbers_after(message, "makes ")
    assert departure + _duration(departure) <= 500.0
    faster = replace(PAPER_VESSEL, speed=speed * 1.01)
    plan = renew.plan(CHART, TIDE, faster, START, GOAL, departure=400.0)
    assert plan.best.times[-1] <= 500.0


def _numbers_after(message: str, words: str) -> float:
    return float(message.split(words)[1].split(maxsplit=1)[0])


def test_departures_that_come_too_late_have_a_reason() -> None:
    last = TIMES[-1]
    found = renew.plan_departures(
        CHART, TIDE, PAPER_VESSEL, START, GOAL, [last - 400.0, last - 20.0]
    )
    assert math.isfinite(found.arrivals[0])
    assert math.isinf(found.arrivals[1])
    assert "known until" in found.reasons[1]
    assert found.paths[1] is None
    assert found.best == 0
    with pytest.raises(renew.UnreachableError, match="reach further"):
        renew.plan_departures(CHART, TIDE, PAPER_VESSEL, START, GOAL, [last - 20.0])


def test_a_current_as_strong_as_the_vessel_leaves_no_proof() -> None:
    # Half-way across it runs at 1.2 m/s when it is strongest.
    strong = renew.VaryingCurrent(
        TIMES,
        lambda points, times: (
            _along(points, times) * (1 + 2 * np.exp(-(((points[..., :1] - 100) / 20) ** 2)))
        ),
    )
    given = np.arange(0.0, 401.0, 100.0)
    found = renew.plan_departures(CHART, strong, PAPER_VESSEL, START, GOAL, given)
    assert math.isinf(found.unproven)
    assert len(set(map(math.isfinite, found.fuels))) == 2
    assert math.isfinite(found.durations[found.best])


@pytest.mark.parametrize(
    ("departures", "options", "message"),
    [
        ([], {}, "1 to 10,000 finite times"),
        ([0.0, math.nan], {}, "1 to 10,000 finite times"),
        ([10.0, 10.0], {}, r"departures\[1\] = 10 s does not come after departures\[0\]"),
        ([0.0, 9999.0], {}, "departure = 9999 s lies outside"),
        ([0.0], {"to_within": 0.0}, "to_within = 0.0 s must be"),
        ([0.0], {"method": "sampled"}, "method = 'optimal'"),
        ([0.0], {"risk": 2.0, "classes": 0}, "classes = 0 .*; risk = 2.0"),
    ],
)
def test_bad_departures_are_refused(
    departures: list[float], options: dict[str, object], message: str
) -> None:
    with pytest.raises(renew.ParameterError, match=message):
        renew.plan_departures(
            CHART,
            TIDE,
            PAPER_VESSEL,
            START,
            GOAL,
            departures,
            **options,  # type: ignore[arg-type]
        )


def test_options_that_depend_on_the_departure_are_refused_in_a_sweep() -> None:
    with pytest.raises(TypeError, match="no option 'departure'"):
        renew.plan_departures(  # type: ignore[call-arg]
            CHART, TIDE, PAPER_VESSEL, START, GOAL, [0.0], departure=1.0
        )


@pytest.mark.parametrize("asked", [math.nan, -1.0, 0.0])
def test_a_bad_arrival_is_refused(asked: float) -> None:
    with pytest.raises(renew.ParameterError, match="arrive_by = "):
        renew.plan(CHART, TIDE, PAPER_VESSEL, START, GOAL, arrive_by=asked)
