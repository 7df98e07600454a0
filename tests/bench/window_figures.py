"""Figures of the best departure: windows of a whole number of minutes, each minute planned alone.

The moving scenes are small, and a voyage lasts about 40 of the minutes here, which are `MINUTE_S`
long. A window is asked for as `renew go --until` does: departures half an hour apart and the end of
the window, then what the proof needs, in whole minutes. The referee plans every minute by itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

import renew
from tests.bench.figure import Figure, at_most, quoted
from tests.moving_waters import moving_scene

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


def figures() -> Iterator[Figure]:
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
        MINUTE_S * np.array(minutes),
        to_within=within * MINUTE_S,
        spacing=MINUTE_S,
    )


def _least_duration(seed: int, length: int) -> float:
    """Plan every minute of a window by itself, and return the least time under way, s."""
    scene = moving_scene(seed)
    departures = (MINUTE_S * minute for minute in range(length + 1))
    return min(scene.plan(departure=departure).best.duration for departure in departures)


def _mean(values: list[float]) -> float:
    """Return the mean."""
    return sum(values) / len(values)
