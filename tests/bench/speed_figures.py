"""Figures of chosen speeds: least fuel by a deadline, beside exact figures and an optimizer."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from shapely import box

import renew
from renew._types import FloatArray
from renew.inputs.options import Drift
from tests.bench.figure import Figure, at_most
from tests.moving_waters import moving_scene
from tests.speed_oracles import (
    CostModel,
    improved,
    least_fuel,
    least_fuel_in_table,
    with_and_against,
)
from tests.strategies import PAPER_VESSEL, SIZE, StreamFunctionCurrent, random_scene

OPEN_WATERS = range(6)
"""Seeds of the currents in which path and speeds are compared with SciPy's optimizer."""

FLOWN = range(4)
"""Seeds of the scenes with islands whose turns are flown at the speeds sailed."""

MOVING = range(1, 7)
"""Seeds of the currents that change, in which plans are compared with a table and an optimizer."""

FLOWN_AS_IT_CHANGES = (0, 2, 3, 8)
"""Seeds of scenes with islands, as the current changes, whose turns are flown."""

# Time under way allowed in the currents that change (s), and speeds (m/s).
_UNDER_WAY, _CHANGING_SPEEDS = 200.0, (0.75, 1.6)
# Legs of the optimizer's paths.
_LEGS = 14
# Least fuel over two metres with and against 0.4 m/s, by the exponent of the fuel law.
_WITH_AND_AGAINST = {2.0: 2.155556, 3.0: 2.366361}
_SPEEDS, _DEADLINE = (0.75, 2.0), 130.0
_DRIFTS: tuple[Drift, ...] = ("projected", "crab")


def figures() -> Iterator[Figure]:
    """Fuel, bound and safety."""
    yield from _exact()
    yield from _beside_an_optimizer()
    yield from _turns()
    yield from _changing()
    yield from _turns_as_it_changes()
    yield from _hardly_changing()


def _exact() -> Iterator[Figure]:
    """Cases with an exact least fuel, or speed."""
    chart = renew.Chart(box(-1, -1, 3, 1))
    for exponent, least in _WITH_AND_AGAINST.items():
        vessel = replace(PAPER_VESSEL, turn_rate=1e3, fuel_exponent=exponent)
        best = renew.plan(
            chart,
            with_and_against,
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
        scene = random_scene(seed)
        by = 1.1 * math.dist(scene.start, scene.goal)
        plan = scene.plan(speed=(0.9, 2.0), arrive_by=by)
        for route in plan.routes:
            flown = scene.turns(route, spacing=0.5)
            trials, collisions = trials + flown.trials, collisions + flown.collisions
    yield at_most(f"turns at chosen speeds that touch land, of {trials:,}", collisions, 0, digits=0)


def _changing() -> Iterator[Figure]:
    """Fuel in open water as the current changes, beside a table improved by an optimizer."""
    dearest, above, largest, saved = 0.0, 0, 0.0, 0.0
    axis = np.linspace(0, SIZE, 25)
    nodes = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    for seed in MOVING:
        exponent = 2.0 + seed % 2
        scene = replace(moving_scene(seed), chart=renew.Chart(box(0, 0, SIZE, SIZE)))
        vessel = replace(PAPER_VESSEL, fuel_exponent=exponent)
        deadline = scene.departure + _UNDER_WAY
        waters = scene.chart, scene.current, vessel, scene.start, scene.goal
        best = renew.plan(
            *waters,
            drift=scene.drift,
            departure=scene.departure,
            speed=_CHANGING_SPEEDS,
            arrive_by=deadline,
        ).best
        costs = CostModel(
            scene.current,
            scene.start,
            scene.goal,
            scene.departure,
            deadline,
            _CHANGING_SPEEDS,
            exponent,
            scene.drift,
        )
        least, path, speeds = least_fuel_in_table(costs, nodes, reach=26, buckets=120, tried=6)
        if math.isfinite(least):
            least = min(least, improved(costs, path, speeds, _LEGS)[0])
        dearest = max(dearest, best.fuel / least)
        above += best.fuel_bound.value > least
        largest = max(largest, 100 * best.optimality_gap)
        once = _at_one_speed(waters, scene.drift, scene.departure, deadline)
        saved = max(saved, 100 * (1 - best.fuel / once))
    name = f"chosen speeds as the current changes, {len(MOVING)} open waters"
    yield at_most(f"{name}: dearest beside a table and an optimizer", dearest, 1.001, digits=5)
    yield at_most(f"{name}: bounds above their fuel", above, 0, digits=0)
    yield Figure(f"{name}: largest gap", "", f"{largest:.0f} %")
    yield Figure(f"{name}: saved beside one speed, at most", "", f"{saved:.1f} %")


def _at_one_speed(
    waters: tuple[renew.Chart, renew.CurrentField, renew.Vessel, FloatArray, FloatArray],
    drift: Drift,
    departure: float,
    deadline: float,
) -> float:
    """Fuel at the lowest constant speed that brings the vessel there in time."""
    chart, current, vessel, start, goal = waters
    low, high, fuel = *_CHANGING_SPEEDS, math.inf
    for _ in range(12):
        middle = (low + high) / 2
        best = renew.plan(
            chart,
            current,
            replace(vessel, speed=middle),
            start,
            goal,
            drift=drift,
            departure=departure,
            classes=1,
        ).best
        if best.times[-1] <= deadline:
            high, fuel = middle, best.fuel
        else:
            low = middle
    return fuel


def _turns_as_it_changes() -> Iterator[Figure]:
    """Turns early, on time and late that touch land, and fuel beside one speed."""
    trials = collisions = 0
    dearest = 0.0
    for seed in FLOWN_AS_IT_CHANGES:
        scene = moving_scene(seed)
        one = scene.plan().best
        plan = scene.plan(speed=(0.75, 1.5), arrive_by=one.times[-1])
        dearest = max(dearest, plan.best.fuel / one.fuel)
        for route in plan.routes:
            flown = scene.turns(route, spacing=0.5)
            trials, collisions = trials + flown.trials, collisions + flown.collisions
    yield at_most(
        f"turns at chosen speeds as the current changes that touch land, of {trials:,}",
        collisions,
        0,
        digits=0,
    )
    yield at_most("chosen speeds beside one speed by its arrival, dearest", dearest, 1, digits=5)


def _hardly_changing() -> Iterator[Figure]:
    """Fuel beside the steady plan where slices are equal, or nearly."""
    chart, still = renew.Chart(box(0, 0, 150, 150)), StreamFunctionCurrent(1, 0.6)

    def fuel(current: renew.CurrentField) -> float:
        return renew.plan(
            chart, current, PAPER_VESSEL, (20, 30), (130, 120), speed=_SPEEDS, arrive_by=_DEADLINE
        ).best.fuel

    steady = fuel(still)
    for share, limit in ((0.0, 1e-4), (1e-5, 0.1)):
        slices = [still, StreamFunctionCurrent(1, 0.6 * (1 + share))]
        found = fuel(renew.VaryingCurrent([0.0, 1000.0], slices))
        text = f"two slices that differ by {share:g} of themselves, off the steady plan by"
        yield at_most(text, 100 * abs(found / steady - 1), limit, " %", digits=5)
