"""Simulated voyages: the vessel is steered through the true current, and plans in forecasts of it.

Steering and motion are this module's own: line of sight to a point ahead on the path, a heading
that turns by the vessel's turn rate, and the midpoint rule. The forecast issued at a time is the
truth then, and errs the more the further it looks ahead.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import shapely
from shapely import box

import renew
from renew._types import FloatArray
from tests.moving_waters import Drifting
from tests.strategies import PAPER_VESSEL, SIZE, random_islands

Flow: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]
"""The current, (..., 2) m/s, at points (..., 2) m and times (...) s."""
HORIZON_S = 600.0
"""How long currents are known, s."""
RENEWED_S = 30.0
"""Time between forecasts, s; a voyage takes about 230 s."""

# Strongest true current and strongest error of a forecast, m/s; lead at which the error is full.
_TRUE, _ERROR, _FULL_LEAD_S = 0.45, 0.3, 200.0
# Time (s) between two slices of a current, and its nodes along either axis.
_SLICE_S, _NODES = 20.0, 41
# Step of the clock, s.
_STEP_S = 0.25
# Step of a path, m.
_ALONG_M = 0.5
# How far ahead the vessel looks along its path, m.
_SIGHT_M = 5.0
# How far ahead its place on its path is looked for, m.
_WINDOW_M = 25.0
# Distance at which the goal is reached, m.
_ARRIVED_M = 1.5


@dataclass(frozen=True)
class Waters:
    """A chart, the true current, and its forecasts."""

    seed: int
    chart: renew.Chart
    eddies: Drifting

    @classmethod
    def of(cls, seed: int) -> Waters:
        """Return seeded waters; their eddies drift by half their size in a voyage."""
        chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed, 6))
        return cls(seed, chart, Drifting(seed, _TRUE, 460.0))

    def forecast(self, issued: float) -> renew.VaryingCurrent:
        """Return the forecast issued at a time (s)."""
        error = Drifting(1000 * (self.seed + 1) + round(issued / RENEWED_S), _ERROR, 460.0)

        def velocity(points: FloatArray, times: FloatArray) -> FloatArray:
            lead = np.clip((np.asarray(times) - issued) / _FULL_LEAD_S, 0.0, 1.0)
            return self.eddies(points, times) + lead[..., None] * error(points, times)

        return _gridded(velocity)

    @cached_property
    def truth(self) -> renew.VaryingCurrent:
        """The true current, on a grid as forecasts are."""
        return _gridded(self.eddies)

    def plan(self, current: renew.CurrentField) -> renew.Plan:
        """Plan the voyage from corner to corner at time 0."""
        ends = (np.full(2, 0.05 * SIZE), np.full(2, 0.95 * SIZE))
        return renew.plan(self.chart, current, PAPER_VESSEL, *ends, classes=4, drift="crab")


def _strands(chart: renew.Chart, track: FloatArray) -> bool:
    """Whether a track (n, 2) touches land or leaves the chart."""
    line = shapely.LineString(track)
    return bool(line.intersects(chart.hard_no_go)) or not chart.extent.covers(line)


def _gridded(field: Flow) -> renew.VaryingCurrent:
    """Return a current as forecasts come: nodes of a grid, at times."""
    times = np.arange(0.0, HORIZON_S + 1, _SLICE_S)
    axis = np.linspace(0.0, SIZE, _NODES)
    nodes = np.stack(np.meshgrid(axis, axis), axis=-1)
    slices = [field(nodes, np.full(nodes.shape[:-1], time)) for time in times]
    return renew.VaryingCurrent(
        times, [renew.GriddedCurrent(axis, axis, uv[..., 0], uv[..., 1]) for uv in slices]
    )


@dataclass
class Vessel:
    """Where the vessel is (2,), m, when, s, and on which heading, rad; with its track so far."""

    sea: Waters
    at: FloatArray
    time: float
    heading: float
    track: list[FloatArray]
    has_arrived: bool = False

    @classmethod
    def at_start(cls, sea: Waters, route: renew.Route) -> Vessel:
        """Return the vessel where a route begins, on its first heading."""
        time, x, y, heading = route.trajectory[0]
        at = np.array([x, y])
        return cls(sea, at, float(time), float(heading), [at])

    def sail(self, path: FloatArray, until: float) -> None:
        """Follow a path (n, 2) in the true current until a time (s) or the goal."""
        line = shapely.segmentize(shapely.LineString(path), _ALONG_M)
        points = shapely.get_coordinates(line)
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        place = 0
        while self.time < until and not self.has_arrived:
            window = slice(place, int(np.searchsorted(along, along[place] + _WINDOW_M)) + 1)
            place += int(np.linalg.norm(points[window] - self.at, axis=1).argmin())
            ahead = int(np.searchsorted(along, along[place] + _SIGHT_M))
            self._steer(points[min(ahead, len(points) - 1)])
            self.track.append(self.at)
            self.has_arrived = bool(np.linalg.norm(self.at - path[-1]) < _ARRIVED_M)

    def _steer(self, towards: FloatArray) -> None:
        """Turn towards a point (2,), and move for one step of the clock."""
        truth, craft, step_s = self.sea.eddies, PAPER_VESSEL, _STEP_S
        course = (towards - self.at) / max(float(np.linalg.norm(towards - self.at)), 1e-9)
        current = truth(self.at, np.asarray(self.time))
        across = float(course[0] * current[1] - course[1] * current[0])
        drift = math.asin(max(-1.0, min(1.0, across / craft.speed)))
        wanted = math.atan2(course[1], course[0]) - drift
        most = craft.turn_rate * step_s
        lacking = (wanted - self.heading + math.pi) % (2 * math.pi) - math.pi
        turn = max(-most, min(most, lacking))
        middle = self.heading + turn / 2
        through = craft.speed * np.array([math.cos(middle), math.sin(middle)])
        half = self.at + step_s / 2 * (through + current)
        moved = through + truth(half, np.asarray(self.time + step_s / 2))
        self.at, self.time = self.at + step_s * moved, self.time + step_s
        self.heading = (self.heading + turn) % (2 * math.pi)


@dataclass(frozen=True)
class Outcome:
    """What a simulated voyage came to: when it arrived (s), or inf; whether it touched land."""

    arrival: float
    stranded: bool
    switches: int = 0


def sailed(sea: Waters, plan: renew.Plan) -> Outcome:
    """Sail a plan's best path as it is, without planning again."""
    vessel = Vessel.at_start(sea, plan.best)
    vessel.sail(plan.best.path, HORIZON_S)
    return _outcome(vessel)


def replanned(sea: Waters, plan: renew.Plan) -> Outcome:
    """Sail a plan, and plan again in each new forecast."""
    vessel = Vessel.at_start(sea, plan.best)
    switches, issued = 0, RENEWED_S
    vessel.sail(plan.best.path, issued)
    while not vessel.has_arrived and issued < HORIZON_S - RENEWED_S:
        answer = renew.replan(
            plan, vessel.at, vessel.time, heading=vessel.heading, current=sea.forecast(issued)
        )
        switches += answer.answer == "switched"
        plan = answer.plan or plan
        issued += RENEWED_S
        vessel.sail(plan.best.path, issued)
    return _outcome(vessel, switches)


def _outcome(vessel: Vessel, switches: int = 0) -> Outcome:
    """Return what a voyage came to."""
    arrival = vessel.time if vessel.has_arrived else math.inf
    strands = _strands(vessel.sea.chart, np.array(vessel.track))
    return Outcome(arrival, strands, switches)
