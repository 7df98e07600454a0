"""Compiles every kernel that planning calls, by planning.

Which kernels a plan calls, and with which types, shows only when the plan runs. A list of
signatures would become outdated as the planner changes. So a few small plans use every option and
every kind of current. Once all kernels are compiled, each of these plans takes about a second.
"""

import contextlib
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from shapely import Polygon, box

from renew.errors import InfeasibleError, UnreachableError
from renew.inputs.chart_and_vessel import Chart, Vessel
from renew.inputs.current import (
    CurrentLike,
    GriddedCurrent,
    GyreCurrent,
    SwingingGyre,
    UniformCurrent,
    VaryingCurrent,
    as_field,
)
from renew.inputs.openings import OverLimit
from renew.planner.fit import fitted_along
from renew.planner.free_ways import CELLS, MARGINS, FreeWays, fine_roadmap
from renew.planner.plan import planner_of
from renew.request import Request
from renew.turns.contingency import contingency, tightest
from renew.underway.adrift import adrift
from renew.vary.plan import plan
from renew.voyage.fuel import fuel

_SIDE = 100.0
_EXTENT = box(0.0, 0.0, _SIDE, _SIDE)
# Three islands, one of them concave: there are several classes, corners to round, a strait to pad.
_ISLANDS = (
    Polygon([(28, 61.5), (36, 61.5), (36, 70), (30, 70)]),
    Polygon([(51, 67.5), (55, 67), (55, 72), (52, 72)]),
    Polygon([(39, 43), (43.5, 47.5), (64, 50), (64.5, 24), (61, 25)]),
)
_START = (10.0, 10.0)
_GOAL = (90.0, 90.0)
_VESSEL = Vessel(speed=1.0, turn_rate=math.radians(35), length=2.0)
# Its law of fuel is a table.
_TABLED = Vessel(1.0, math.radians(35), power=((0.8, 0.6), (1.0, 1.0), (1.4, 2.4)), hotel=0.2)
_GYRE = GyreCurrent(0.8, _SIDE, _SIDE)
_STORM = OverLimit(box(60.0, 60.0, 75.0, 75.0), 40.0, 200.0, "waves", 2.0)


def _as_grid(field: Callable[[Any], Any]) -> GriddedCurrent:
    """A field on unevenly spaced nodes, like those of a projected chart."""
    axis = np.linspace(0.0, 1.0, 21) ** 1.1 * _SIDE
    uv = field(np.stack(np.meshgrid(axis, axis), axis=-1))
    return GriddedCurrent(axis, axis, uv[..., 0], uv[..., 1])


REHEARSALS: tuple[tuple[str, CurrentLike, dict[str, Any]], ...] = (
    ("adaptive padding", _GYRE, {}),
    ("a current in a table", _as_grid(_GYRE), {}),
    ("a uniform current", UniformCurrent(0.1, 0.0), {}),
    ("a current that is a function", lambda points: _GYRE(points), {}),  # noqa: PLW0108 - any function, not a field
    ("a current that changes", SwingingGyre(0.2, _SIDE, _SIDE, 0.25, 0.05), {}),
    ("overpowered water", GyreCurrent(1.05, _SIDE, _SIDE), {}),
    ("the exact drift model", _GYRE, {"drift": "crab"}),
    ("no padding", _GYRE, {"padding": "none"}),
    ("fixed padding", _GYRE, {"padding": 3.0}),
    ("a clearance", _GYRE, {"clearance": 4.0}),
    ("a small risk", _GYRE, {"risk": 1e-6}),
    ("risk at each point", _GYRE, {"risk_at": "point"}),
    ("random chains", _GYRE, {"method": "sampled", "samples": 50}),
    ("classes by length", _GYRE, {"order": "length"}),
    ("classes depth first", _GYRE, {"order": "depth-first"}),
    ("distinct classes", _GYRE, {"distinct_by": "auto"}),
    ("chosen speeds", _GYRE, {"speed": (0.9, 1.3), "arrive_by": 120.0}),
    ("chosen speeds, crabbing", _GYRE, {"speed": (0.9, 1.3), "drift": "crab"}),
    (
        "chosen speeds as the current changes",
        VaryingCurrent([0.0, 400.0], [_GYRE, GyreCurrent(0.6, _SIDE, _SIDE)]),
        {"speed": (0.9, 1.3), "arrive_by": 120.0, "classes": 2},
    ),
    ("weather over a limit", _GYRE, {"avoid": [_STORM]}),
    ("a power by speed", _GYRE, {"vessel": _TABLED, "speed": (0.9, 1.3), "arrive_by": 120.0}),
    (
        "a power by speed as the current changes",
        VaryingCurrent([0.0, 400.0], [_GYRE, GyreCurrent(0.6, _SIDE, _SIDE)]),
        {"vessel": _TABLED, "speed": (0.9, 1.3), "arrive_by": 120.0, "classes": 2},
    ),
    ("no way through", _GYRE, {"padding": 30.0}),
)
"""Small plans: their descriptions, currents and options. Together they call every kernel with all
its types. The first takes most of the time."""


def rehearse() -> Iterator[str]:
    """Plan each of `REHEARSALS`, and compute all figures of its routes; yields the next one's name.

    This compiles the kernels for which no machine code is found; see :mod:`renew._compiled`.
    """
    chart = _chart()
    for what, current, options in REHEARSALS:
        yield what
        with contextlib.suppress(UnreachableError):
            given = dict(options)
            vessel = given.pop("vessel", _VESSEL)
            route = plan(chart, current, vessel, _START, _GOAL, **given).best
            contingency(route, chart, current, vessel)
            tightest(route, current, vessel)
            fuel(route.path, current, vessel)
            _ = (route.channel, route.soft_no_go)
            if what == REHEARSALS[0][0]:
                _sail_freely(chart, current)
                adrift(route, chart, current, horizon=10.0)
            # The bound takes longest, and its kernels depend on these two options only.
            if not options or options.keys() & {"drift", "speed"}:
                _ = route.optimality_gap


def _chart() -> Chart:
    """Return a small chart on a plane with a point scale, as charts of the earth have one."""
    return Chart(_EXTENT, _ISLANDS, point_scale=lambda points: np.ones(points.shape[:-1]))


def _sail_freely(chart: Chart, current: CurrentLike) -> None:
    """Plan ways of free turns, which a search takes only where padding costs much."""
    planner = planner_of(Request(chart, as_field(current), _VESSEL, np.array((_START, _GOAL))))
    ways = FreeWays(planner.problem, fine_roadmap(planner.problem, CELLS[0]), MARGINS[0])
    for path in ways.paths(1, math.inf):
        with contextlib.suppress(InfeasibleError):
            fitted_along(planner, path, ways)


def rehearse_half(half: int) -> None:
    """Compile half of a first plan's kernels: the search for classes and the bound, or the rest.

    Two processes compile one half each, and take about equally long. A few kernels belong to both
    halves, and are compiled in both processes.
    """
    chart, current, ends = _chart(), _as_grid(_GYRE), (_START, _GOAL)
    if half:
        plan(chart, current, _VESSEL, *ends, order="depth-first")
        return
    problem = planner_of(Request(chart, current, _VESSEL, np.array(ends))).problem
    scout = problem.scout(problem.likely_width)
    start, goal = problem.voyage.start, problem.voyage.goal
    midlines = [found.midline(start, goal) for found in scout.channels(2)]
    scout.channels_beside(midlines, 1)
    _ = problem.fuel_bound.value
