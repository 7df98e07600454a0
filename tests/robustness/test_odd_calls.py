"""Odd calls of the public API give a right result or a documented error, in bounded time.

Some arguments of right calls get a wrong type, shape or size.
"""

import datetime as dt
import functools
import gc
import math
import resource
import warnings
from collections.abc import Callable, Iterable
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Point, Polygon, box

import renew
from tests.robustness.limits import SEED, TooSlowError, cpu_limit, failure, number
from tests.strategies import PAPER_VESSEL, random_scene, single_gyre

Rng = np.random.Generator

NAN, INF = math.nan, math.inf


class Call(NamedTuple):
    """A call of the API: the function's name, and the arguments."""

    name: str
    function: Callable[..., Any]
    arguments: dict[str, Any]

    def __str__(self) -> str:
        """The call as one would write it, shortened."""
        given = ", ".join(f"{key}={_shortened(value)}" for key, value in self.arguments.items())
        return f"{self.name}({given})"


def _shortened(value: object) -> str:
    """A value as Python shows it, with the middle of a long one left out."""
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:60]}...{text[-15:]}"


def odd_values() -> list[Any]:
    """Values that are wrong for nearly all arguments; some are iterators, which get used up."""
    return [
        None, True, False, 0, -1, 1, 2, 3, 0.5, -0.5, NAN, INF, -INF, 1e300, -1e300, 1e-300, 10**30,
        -(10**400), 1j, 1 + 0j, np.float64(NAN), np.float32(1.5), np.int64(3), np.int8(-3),
        np.bool_(1), np.uint64(2**64 - 1), np.complex128(1), np.str_("1"), "", "1", "auto",
        "adaptive", "none", "crab", "sampled", "x" * 5000, "\0", "{0}", b"1", [], [1], (1, 2),
        (1.0, INF), [NAN, 1], [1, 2, 3], [[1, 2], [3, 4]], [[1, 2], [3]], ["1", "2"], [None, None],
        [[]], {}, {"x": 1}, {1, 2}, object(), np.array([]), np.array(5.0), np.array([10, 90]),
        np.array([20.0, 20.0], dtype=np.float16), np.array([[1.0, 2.0]]), np.zeros((2, 0)),
        np.array([NAN, 1.0]), np.array([1 + 1j, 2]), np.array(["a", "b"]), np.array([None, 1]),
        np.array(["2026-01-01", "2026-01-02"], dtype="datetime64[D]"), np.ma.masked,
        np.ma.array([10.0, 20.0], mask=[True, False]), np.empty((0, 2)), np.zeros((3, 2)),
        np.array([[10.0, 10.0], [NAN, 1.0], [90.0, 90.0]]), np.full((4, 2), 1e200), Decimal("1.5"),
        Fraction(1, 2), range(3), range(0), iter([]), iter([1, 2]), lambda: 0,
        lambda points: points, len, int, renew.Vessel, PAPER_VESSEL, single_gyre().parts[:2],
        renew.UniformCurrent(0.1, 0.0),
        Polygon(), Point(1, 1), box(0, 0, 100, 100), box(45, 45, 55, 55), MultiPolygon(),
        [box(45, 45, 55, 55), None], [Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])],
        Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), box(0, 0, INF, 1),
        [renew.ShutArea(box(45, 45, 55, 55))], renew.ShutArea(box(45, 45, 55, 55), 0, 50),
        [renew.ShutArea(box(45, 45, 55, 55), 0, 50)] * 2, [(50.0, 50.0)], [(50.0, 50.0)] * 2,
        dt.datetime(2026, 1, 1, tzinfo=dt.UTC), dt.timedelta(1), slice(3),
        ValueError("x"), NotImplemented, ..., bytearray(2), memoryview(b"12"),
    ]  # fmt: skip


def _answers() -> list[Callable[[Any], Any]]:
    """Functions that return, for a planner's points, something that is hardly or not a current."""
    return [
        lambda points: np.full(np.shape(points), "0.1"),
        lambda points: np.full(np.shape(points), 0.1 + 0.1j),
        lambda points: np.full(np.shape(points), 0.1, dtype=np.float16),
        lambda points: np.zeros(np.shape(points), dtype=bool),
        lambda points: np.full(np.shape(points), None),
        lambda points: np.zeros(np.shape(points), dtype="datetime64[s]"),
        lambda points: np.zeros(np.shape(points)).tolist(),
        lambda points: np.full(np.shape(points), NAN),
        lambda points: np.ma.array(points, mask=True),
        lambda points: np.zeros(np.shape(points)[:-1]),
        lambda _: (0.1, 0.0),
        lambda _: "0.1",
        lambda _: None,
        lambda points: points,
        lambda points: np.broadcast_to(0.1, np.shape(points)),
        lambda points: -0.3 * np.sign(points - 50.0),
        lambda points: np.where(points > 50, 1e11, 0.0),
    ]


@functools.cache
def _route() -> renew.Route:
    """A route for functions that take one."""
    return single_gyre().plan(classes=1).best


def _currents(rng: Rng) -> Any:  # noqa: ANN401 - any current
    """A current that can be planned in, mostly."""
    kind = rng.integers(7)
    gyre = single_gyre().current
    if kind == 0:
        return renew.SwingingGyre(0.2, 100.0, 100.0, 0.25, float(rng.choice([0.01, 0.1, 1.0, 1e3])))
    if kind == 1:
        return renew.VaryingCurrent([0.0, 200.0, 400.0], [gyre, renew.UniformCurrent(0, 0), gyre])
    if kind == 2:
        answers = _answers()
        return answers[int(rng.integers(len(answers)))]
    return gyre if kind < 5 else renew.UniformCurrent(0.1, -0.1)


def _plan_arguments(rng: Rng) -> dict[str, Any]:
    """Arguments of a plan that is possible."""
    chart = single_gyre().chart
    if rng.random() < 0.3:
        chart = random_scene(int(rng.integers(5)), islands=3).chart
    given = {
        "chart": chart, "current": _currents(rng), "vessel": PAPER_VESSEL, "start": (10.0, 10.0),
        "goal": (90.0, 90.0), "classes": 1,
    }  # fmt: skip
    options = {
        "classes": 2, "risk": 0.1, "padding": 2.0, "clearance": 1.0, "distinct_by": "auto",
        "drift": "crab", "seed": 3, "order": "length", "risk_at": "point", "lateness": 0.1,
        "min_lateness": 5.0, "gap_to": 0.02, "via": [(60.0, 60.0)],
        "avoid": [renew.ShutArea(box(70, 70, 75, 75), 0, 60)], "speed": (0.8, 1.2),
        "arrive_by": 300.0, "method": "sampled", "samples": 20, "departure": 10.0,
    }  # fmt: skip
    names = rng.choice(list(options), int(rng.integers(4)), replace=False)
    return given | {str(name): options[str(name)] for name in names}


def _without_departure(arguments: dict[str, Any]) -> dict[str, Any]:
    """Arguments for departures of their own."""
    return {name: value for name, value in arguments.items() if name != "departure"}


def _right_call(rng: Rng) -> Call:
    """A call with arguments that can be right."""
    axis, path = np.linspace(0, 100, 4), np.array([[10.0, 10.0], [40.0, 60.0], [90.0, 90.0]])
    uv = np.full((4, 4), 0.1)
    kinds: list[tuple[str, Callable[..., Any], dict[str, Any]]] = [
        ("Vessel", renew.Vessel, {"speed": 1.0, "turn_rate": 0.6, "length": 2.0,
                                  "fuel_coefficient": 1.0, "fuel_exponent": 2.0}),
        ("Chart", renew.Chart, {"extent": box(0, 0, 100, 100), "no_go": [box(40, 40, 60, 60)],
                                "land": [box(45, 45, 55, 55)]}),
        ("ShutArea", renew.ShutArea, {"polygon": box(0, 0, 9, 9), "begin": 0.0, "end": 9.0,
                                      "name": "range"}),
        ("UniformCurrent", renew.UniformCurrent, {"u": 0.1, "v": 0.2}),
        ("GyreCurrent", renew.GyreCurrent, {"amplitude": 0.5, "width": 100.0, "height": 100.0,
                                            "columns": 2, "rows": 1}),
        ("GriddedCurrent", renew.GriddedCurrent, {"x": axis, "y": axis, "u": uv, "v": uv}),
        ("SwingingGyre", renew.SwingingGyre, {"amplitude": 0.1, "width": 100.0, "height": 100.0,
                                              "epsilon": 0.25, "omega": 0.05}),
        ("Tide", renew.Tide, {"constants": {"M2": (1.0, 30.0)}, "mean_level": 1.5,
                              "epoch": np.datetime64("2026-11-22"), "name": "Pier",
                              "datum": "MLLW", "ratio": 1.0, "offset": 0.0}),
        ("VaryingCurrent", renew.VaryingCurrent,
         {"times": [0.0, 100.0], "currents": [renew.UniformCurrent(0, 0)] * 2}),
        ("fuel", renew.fuel, {"path": path, "current": _currents(rng), "vessel": PAPER_VESSEL,
                              "drift": "crab", "departure": 1.0, "speeds": [1.0, 0.9]}),
        ("contingency", renew.contingency,
         {"route": _route(), "chart": single_gyre().chart, "current": _currents(rng),
          "vessel": PAPER_VESSEL, "spacing": 5.0, "seed": 1, "departure": 0.0, "lateness": 0.1,
          "min_lateness": 1.0, "drift": "crab"}),
        ("tightest", renew.tightest, {"route": _route(), "current": _currents(rng),
                                      "vessel": PAPER_VESSEL, "seed": 1}),
        ("plan_departures", renew.plan_departures,
         _without_departure(_plan_arguments(rng))
         | {"departures": [0.0, 20.0], "with_classes": False}),
    ]  # fmt: skip
    if rng.random() < 0.5:
        return Call("plan", renew.plan, _plan_arguments(rng))
    return Call(*kinds[int(rng.integers(len(kinds)))])


def odd_call(seed: list[int]) -> Call:
    """Make a call with up to three odd arguments."""
    rng = np.random.default_rng(seed)
    call = _right_call(rng)
    values = odd_values()
    count = int(rng.choice([0, 1, 2, 3], p=[0.1, 0.5, 0.25, 0.15]))
    names = rng.choice(list(call.arguments), min(count, len(call.arguments)), replace=False)
    odd = {str(name): values[int(rng.integers(len(values)))] for name in names}
    return call._replace(arguments=call.arguments | odd)


def broken(call: Call, result: Any) -> list[str]:  # noqa: ANN401 - of any call
    """Which of its function's promises a result breaks."""
    if call.name == "fuel":
        return [] if isinstance(result, float) and result > 0 else [f"fuel {result!r}"]
    plan = result.plan if call.name == "plan_departures" else result
    if not isinstance(plan, renew.Plan):
        return []
    given, found = call.arguments, []
    drift = given.get("drift", "projected")
    for route in plan.routes:
        line = shapely.LineString(route.path)
        outside = line.difference(shapely.buffer(given["chart"].extent, 1e-6)).length
        inside = line.intersection(shapely.buffer(given["chart"].hard_no_go, -1e-6)).length
        fuel = renew.fuel(
            route.path, given["current"], given["vessel"],
            drift=drift, departure=float(route.times[0]), speeds=route.speeds,
        )  # fmt: skip
        checks = {
            f"outside the chart by {outside} m": outside > 0,
            f"on land for {inside} m": inside > 0,
            f"fuel {route.fuel}, by renew.fuel {fuel}": not math.isclose(
                fuel, route.fuel, rel_tol=1e-6
            ),
            "times don't ascend": not (np.diff(route.times) > 0).all(),
            f"fuel {route.fuel} below its bound": route.optimality_gap < -1e-9,
        }
        found += [f"{route.homotopy}: {what}" for what, is_so in checks.items() if is_so]
    return found


SAMPLE = 60
# Longest time of a call, s: one with chosen speeds in a current that changes takes 20.
_MAX_CALL_S = 60.0
# Plans before memory is measured (the compiler's and the allocator's pools are filled then), and
# those in which it may grow by 5 %.
_WARM_PLANS, _PLANS = 50, 300


def failures(cases: Iterable[int], seed: str) -> list[str]:
    """Make odd calls; describe those that ended otherwise than by a result or a documented error.

    Not documented are another class of error, a warning, a result that breaks its function's
    promises, and a call that takes longer than the limit.
    """
    found = []
    for case in cases:
        call = odd_call([int(seed), case])
        try:
            with cpu_limit(_MAX_CALL_S), warnings.catch_warnings():
                warnings.simplefilter("error")
                faults = broken(call, call.function(**call.arguments))
        except renew.PlanningError:
            continue
        except (Exception, TooSlowError) as error:  # noqa: BLE001 - these are what is looked for
            faults = [failure(case, error)]
        found += [f"{call}: {fault}" for fault in faults]
    return found


def test_a_sample_of_odd_calls_is_answered_or_refused() -> None:
    assert failures(range(SAMPLE), SEED) == []


@pytest.mark.slow
def test_odd_calls_are_answered_or_refused() -> None:
    found = failures(range(number("calls", 500)), SEED)
    assert not found, "\n".join(found)


def _memory_kb() -> int:
    """Resident memory of this process, kB."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() // 1024


@pytest.mark.slow
def test_memory_does_not_grow_over_many_plans() -> None:
    def plan(seed: int) -> None:
        random_scene(seed % 10, islands=5).plan(classes=4)

    for seed in range(_WARM_PLANS):
        plan(seed)
    before = _memory_kb()
    for seed in range(_PLANS):
        plan(seed)
    assert _memory_kb() <= 1.05 * before
