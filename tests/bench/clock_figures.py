"""Figures of currents that change on the way, beside an oracle that runs the clock.

Windows of departures are of a whole number of minutes, each of which the referee plans alone: the
moving scenes are small, and a voyage lasts about 40 of the minutes here, which are `MINUTE_S` long.
A window is asked for as `renew go --until` does: departures half an hour apart and the end of the
window, then what the proof needs, in whole minutes.
"""

import math
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import renew
from renew.inputs.current import as_field
from tests.bench.clock import warm
from tests.bench.figure import Figure, at_most, quoted
from tests.moving_waters import PERIODS, moving_scene

SCENES = range(20)
"""Seeds of the scenes that are planned without padding beside the oracle."""

BOUNDED = 200
"""Number of scenes in which the bound is compared with the oracle, a fifth of them rough."""

FLOWN = range(12)
"""Seeds of the scenes whose turns are flown."""

SWEPT = 48
"""Number of departures that are planned at once, and one by one."""

# Scene whose departures are planned, and the window (s) in which they lie.
_DEPARTING = 7
_WINDOW_S = 600.0
# Largest gaps asked for by the current's period, in voyages, %.
_GAPS = dict(zip(PERIODS, (12.0, 7.0, 4.0), strict=True))
# Strongest current (m/s) of the rough scenes: in places it outruns the vessel.
_ROUGH = 1.6


def figures() -> Iterator[Figure]:
    """Fuel, gap, bound, turns and times of moving scenes."""
    yield from _exact()
    yield from _bounded()
    yield from _turns()
    yield from _times()
    yield from _departures()


def _exact() -> Iterator[Figure]:
    """Fuel over the oracle's, and the gap by the current's period."""
    ratios: list[float] = []
    gaps: dict[float, list[float]] = {period: [] for period in PERIODS}
    for seed in SCENES:
        scene = moving_scene(seed)
        best = scene.plan(padding="none").best
        ratios.append(best.fuel / scene.oracle())
        gaps[PERIODS[seed % len(PERIODS)]].append(100 * best.optimality_gap)
    name = f"{len(SCENES)} moving scenes"
    yield at_most(f"{name}: dearest beside the oracle", max(ratios), 1.005, digits=5)
    for period, found in gaps.items():
        yield at_most(
            f"{name}: largest gap, period of {period:g} voyages", max(found), _GAPS[period], " %"
        )


def _bounded() -> Iterator[Figure]:
    """How often the bound exceeds the oracle's fuel."""
    above, largest = 0, 0.0
    for seed in range(BOUNDED):
        rough = seed % 5 == 0
        scene = moving_scene(1000 + seed, _ROUGH if rough else 0.7)
        try:
            bound = scene.plan(padding="none", classes=1).best.fuel_bound.value
        except renew.PlanningError:
            continue  # no way against the current: there is nothing to compare with
        least = scene.oracle()
        above += bound > least
        largest = max(largest, bound / least)
    text = f"{above} (nearest {largest:.4f})"
    yield Figure(f"bound above the oracle's fuel, {BOUNDED} moving scenes", "0", text, above == 0)


def _turns() -> Iterator[Figure]:
    """Turns early, on time and late that touch land."""
    trials = collisions = 0
    for seed in FLOWN:
        scene = moving_scene(seed)
        for route in scene.plan().routes:
            flown = scene.turns(route, spacing=0.5)
            trials, collisions = trials + flown.trials, collisions + flown.collisions
    text = f"{collisions} of {trials:,}"
    met = collisions == 0 and trials >= 100_000
    yield Figure("turns early, on time and late that touch land", "0 of 100,000", text, met)


def _times() -> Iterator[Figure]:
    """CPU time of a plan in a changing current beside the same in that of its departure."""
    scene = moving_scene(4)
    at_departure = as_field(lambda points: scene.current.velocity(points, scene.departure))
    still = replace(scene.in_current(at_departure), departure=0.0)
    changing, _ = warm(scene.plan)
    steady, _ = warm(still.plan)
    yield at_most("changing plan beside a steady one, CPU", changing.cpu / steady.cpu, 3)


def _departures() -> Iterator[Figure]:
    """CPU time of departures planned at once beside that of as many plans, and the fuel of both."""
    scene = moving_scene(_DEPARTING)
    given = np.linspace(0.0, _WINDOW_S, SWEPT)
    scene.plan_departures(given[:2])
    begin = time.process_time()
    found = scene.plan_departures(given)
    at_once = time.process_time() - begin
    scene.plan(departure=0.0)
    begin = time.process_time()
    single = np.array([scene.plan(departure=t).best.fuel for t in given.tolist()])
    one_by_one = time.process_time() - begin
    name = f"{SWEPT} departures beside as many plans"
    yield at_most(f"{name}, CPU", at_once / one_by_one, 0.5)
    yield at_most(f"{name}, dearest", float((found.fuels / single).max()), 1.001, digits=5)


WINDOWS = 20
"""Number of windows; each has a scene and a length by its own seed."""

MINUTE_S = 6.0
"""Length of a minute of these windows, s: departures are multiples of it."""

# Least and largest length of a window, minutes; the step of the first departures, minutes; the
# share of the window to which the best is proven.
_SHORTEST, _LONGEST, _STEP, _PROVEN_SHARE = 40, 100, 30, 1 / 48
# Largest error of a path, as a share of the time under way: two plans of one departure may differ
# by as much.
_PATH_ERROR = 1e-3


def windows() -> Iterator[Figure]:
    """How much dearer the chosen departures are than the best minute, and what the proofs allow."""
    beyond, dearer, lasts, plans, minutes = [], [], 0, 0, 0
    for seed in range(WINDOWS):
        length = int(np.random.default_rng([seed, 40]).integers(_SHORTEST, _LONGEST + 1))
        found = _chosen(seed, length)
        least_s = _least_duration(seed, length)
        excess_s = float(found.durations[found.best]) - least_s
        beyond.append((excess_s - found.unproven) / least_s)
        dearer.append(excess_s / least_s)
        lasts += bool(found.departures[-1] == length * MINUTE_S)
        plans += len(found.departures)
        minutes += length + 1
    name = f"best departure of {WINDOWS} windows beside every minute"
    yield at_most(
        f"{name}: dearer than its proof allows, share of the fuel",
        max(beyond),
        _PATH_ERROR,
        digits=5,
        key="beyond_proof",
    )
    yield at_most(f"{name}: windows whose end is not planned", WINDOWS - lasts, 0, digits=0)
    yield quoted(f"{name}: dearer, the largest and the mean", worst=max(dearer), mean=_mean(dearer))
    yield quoted(f"{name}: departures planned, and minutes", planned=plans, minutes=minutes)


def _chosen(seed: int, length: int) -> renew.Departures:
    """Choose the departure of a window of `length` minutes."""
    scene = moving_scene(seed)
    minutes = [*range(0, length, _STEP), length]
    within = math.ceil(length * _PROVEN_SHARE)
    return scene.plan_departures(
        MINUTE_S * np.array(minutes), to_within=within * MINUTE_S, spacing=MINUTE_S
    )


def _least_duration(seed: int, length: int) -> float:
    """Plan every minute of a window by itself, and return the least time under way, s."""
    scene = moving_scene(seed)
    departures = (MINUTE_S * minute for minute in range(length + 1))
    return min(scene.plan(departure=departure).best.duration for departure in departures)


def _mean(values: list[float]) -> float:
    """Return the mean."""
    return sum(values) / len(values)
