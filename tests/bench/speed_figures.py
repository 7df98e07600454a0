"""Figures of chosen speeds: least fuel by a deadline, beside exact figures and an optimizer."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from shapely import box

import renew
from tests.bench.clock import warm
from tests.bench.figure import Figure, at_most
from tests.speed_oracle import least_fuel
from tests.strategies import PAPER_VESSEL, StreamFunctionCurrent, random_scene

if TYPE_CHECKING:
    from collections.abc import Iterator

    from renew._types import FloatArray
    from renew.inputs.fuel import Drift

OPEN_WATERS = range(6)
"""Seeds of the currents in which path and speeds are compared with SciPy's optimizer."""

FLOWN = range(4)
"""Seeds of the scenes with islands whose turns are flown at the speeds sailed."""

# Least fuel over two metres with and against 0.4 m/s, by the exponent of the fuel law.
_WITH_AND_AGAINST = {2.0: 2.155556, 3.0: 2.366361}
_SPEEDS, _DEADLINE = (0.75, 2.0), 130.0
_DRIFTS: tuple[Drift, ...] = ("projected", "crab")


def figures() -> Iterator[Figure]:
    """Fuel, bound, safety and time."""
    yield from _exact()
    yield from _beside_an_optimizer()
    yield from _turns()
    yield from _times()


def _with_and_against(points: FloatArray) -> FloatArray:
    u = np.where(points[..., 0] < 1, 0.4, -0.4)
    return np.stack([u, np.zeros_like(u)], axis=-1)


def _exact() -> Iterator[Figure]:
    """Cases with an exact least fuel, or speed."""
    chart = renew.Chart(box(-1, -1, 3, 1))
    for exponent, least in _WITH_AND_AGAINST.items():
        vessel = replace(PAPER_VESSEL, turn_rate=1e3, fuel_exponent=exponent)
        best = renew.plan(
            chart,
            _with_and_against,
            vessel,
            (0, 0),
            (2, 0),
            padding="none",
            speed=(0.3, 2.0),
            arrive_by=2 / 0.9,
        ).best
        text = f"1 m with, 1 m against 0.4 m/s, k = {exponent:g}: off by"
        yield at_most(text, 100 * abs(best.fuel / least - 1), 0.1, " %", digits=5)
        free = renew.plan(
            chart,
            renew.UniformCurrent(-0.4, 0.0),
            vessel,
            (0, 0),
            (2, 0),
            padding="none",
            drift="crab",
            speed=(0.3, 2.0),
        ).best
        off = float(np.abs(free.speeds / (exponent * 0.4 / (exponent - 1)) - 1).max())
        text = f"against 0.4 m/s, time free, k = {exponent:g}: speed off by"
        yield at_most(text, 100 * off, 0.1, " %", digits=5)


def _beside_an_optimizer() -> Iterator[Figure]:
    """Fuel over that of SciPy's optimizer over path and speeds, and the bound below it."""
    dearest, above, largest = 0.0, 0, 0.0
    for seed in OPEN_WATERS:
        for exponent, drift in itertools.product((2.0, 3.0), _DRIFTS):
            current = StreamFunctionCurrent(seed, 0.6)
            best = renew.plan(
                renew.Chart(box(0, 0, 150, 150)),
                current,
                replace(PAPER_VESSEL, fuel_exponent=exponent),
                (20, 30),
                (130, 120),
                drift=drift,
                speed=_SPEEDS,
                arrive_by=_DEADLINE,
            ).best
            least = least_fuel(
                np.linspace((20, 30), (130, 120), 25),
                current,
                _SPEEDS,
                _DEADLINE,
                exponent=exponent,
                crab=drift == "crab",
                moving=True,
            )
            dearest = max(dearest, best.fuel / least)
            above += best.fuel_bound.value > least
            largest = max(largest, 100 * best.optimality_gap)
    name = f"chosen speeds, {4 * len(OPEN_WATERS)} cases of open water"
    yield at_most(f"{name}: dearest beside an optimizer", dearest, 1.001, digits=5)
    yield at_most(f"{name}: bounds above the optimizer's fuel", above, 0, digits=0)
    yield Figure(f"{name}: largest gap", "", f"{largest:.2f} %")


def _turns() -> Iterator[Figure]:
    """Turns at the speeds sailed that touch land."""
    trials = collisions = 0
    for seed in FLOWN:
        chart, current, start, goal = random_scene(seed)
        by = 1.1 * math.dist(start, goal)
        plan = renew.plan(chart, current, PAPER_VESSEL, start, goal, speed=(0.9, 2.0), arrive_by=by)
        for route in plan.routes:
            flown = renew.contingency(route, chart, current, PAPER_VESSEL, spacing=0.5)
            trials, collisions = trials + flown.trials, collisions + flown.collisions
    yield at_most(f"turns at chosen speeds that touch land, of {trials:,}", collisions, 0, digits=0)


def _times() -> Iterator[Figure]:
    """CPU time beside that of a plan at constant speed."""
    chart, current, start, goal = random_scene(3)
    constant, plan = warm(lambda: renew.plan(chart, current, PAPER_VESSEL, start, goal))
    by = plan.best.times[-1]
    chosen, _ = warm(
        lambda: renew.plan(
            chart, current, PAPER_VESSEL, start, goal, speed=(0.9, 1.5), arrive_by=by
        )
    )
    name = "chosen speeds beside constant ones, CPU"
    yield Figure(name, "", f"{chosen.cpu / constant.cpu:.1f} ({chosen.cpu:.2f} s)")
