"""Plan and evaluate a season as one task, for a thread, a process or a Dask worker.

A task has paths instead of arrays, because Dask can't transfer large arguments reliably. Results
are stored as soon as they are complete; the next run after a killed one loads them.
"""

import json
import math
import os
import pickle
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.errors import StageError, one_line
from pipeline.machine.interpreters import end_with_parent, run_python
from pipeline.machine.store import load_artefact, save_artefact
from pipeline.model import (
    ClockWorth,
    Current,
    Evaluation,
    GapShares,
    Scene,
    SeasonPlan,
    SpeedChoice,
    plan_options,
)
from pipeline.scenario.model import PlannerOptions
from pipeline.stages.seasons.one_season import (
    OnStep,
    evaluate_season,
    ignore_step,
    plan_season,
)
from renew.inputs.options import Drift
from renew.voyage.fuel import passage

# Factor on the turn rate of a vessel that turns on the spot.
_ON_THE_SPOT = 100.0
# Number of classes in the other plans, of which only the best route is used; number of bisections
# for the factor on speeds.
_CLASSES, _HALVINGS = 4, 30


def gap_shares(scene: Scene, season: SeasonPlan, options: PlannerOptions) -> GapShares | None:
    """Split the gap of a season's best route; None without a plan. Takes as long as planning.

    The lower bound on fuel holds on the original land, for any vessel, with tidal water open at all
    times. The fuel of more plans lies between the bound and the route: (1) the best route on the
    original land, and (2) the best route on the chart with its margin and offing. These plans have
    no padding and a vessel that turns on the spot, because many ways close to land have no room for
    a turning circle. The chart's share is the fuel of (2) minus (1). The share of padding and
    turning circle is the fuel of the route minus (2). With a tide, the plan (0) is that of (1) with
    tidal water open at all times, and the tide's share is the fuel of (1) minus (0). The bound's
    own share, which no route can save, is the fuel of (0), or else of (1), minus the bound.
    """
    if season.plan is None:
        return None
    best = season.plan.best
    kept = _least_fuel(scene, scene.chart, season, options, options.clearance or 0.0)
    land = _land_alone(scene.chart)
    free = _least_fuel(scene, land, season, options, 0.0)
    # A search may miss the best route. But a route of a more limited problem is also a route of a
    # less limited one, so its fuel counts there as well.
    kept = min(kept, best.fuel)
    free = min(free, kept)
    depth, opened = scene.tidal_depths.get(season.season), free
    if depth is not None:
        areas = (*scene.areas.get(season.season, ()), *depth.never_open)
        tideless = replace(scene, areas={season.season: areas}, tidal_depths={})
        opened = min(free, _least_fuel(tideless, land, season, options, 0.0))
    bound = best.fuel / (1 + best.optimality_gap)
    return GapShares(
        season=season.season,
        chart=(kept - free) / bound,
        padding=(best.fuel - kept) / bound,
        bound=(opened - bound) / bound,
        tide=(free - opened) / bound,
    )


def _least_fuel(
    scene: Scene, chart: renew.Chart, season: SeasonPlan, options: PlannerOptions, clearance: float
) -> float:
    """Return the least fuel at `clearance` planar metres off a chart, without padding, or inf."""
    asked = options.model_copy(
        update={
            "padding": "none",
            "risk_at": "route",  # "point" needs adaptive padding
            "clearance": clearance,
            "classes": _CLASSES,
            "method": "optimal",
        }
    )
    nimble = replace(scene.vessel, turn_rate=_ON_THE_SPOT * scene.vessel.turn_rate)
    other = replace(scene, chart=chart, vessel=nimble)
    try:
        return other.planned(season.season, plan_options(asked), season.arrive_by_s).best.fuel
    except renew.PlanningError:
        return math.inf


def _land_alone(chart: renew.Chart) -> renew.Chart:
    """Return the chart of the original land, for which the bound is computed."""
    land = shapely.difference(chart.extent, chart.open_water)
    return renew.Chart(chart.extent, [land])


def clock_worth(scene: Scene, season: SeasonPlan, options: PlannerOptions) -> ClockWorth | None:
    """Compare a season's fuel with other plans; None for a steady current or without a plan.

    They use the current at departure, its mean over the voyage, or no current, which gives the
    shortest safe path. All are sailed in the changing current, with the same departure and padding
    rules. If speeds are chosen, a plan's speeds are multiplied by a factor so that it is in time.
    """
    current = scene.currents[season.season]
    if season.plan is None or not isinstance(current, renew.VaryingCurrent):
        return None
    best = season.plan.best
    frozen, mean, shortest = (
        _sailed(scene, season, planned_in, options)
        for planned_in in (
            weighted(current, hat_weights(current.slice_times, 0.0)),
            weighted(current, mean_weights(current.slice_times, float(best.times[-1]))),
            renew.UniformCurrent(0.0, 0.0),
        )
    )
    bound = best.fuel / (1 + best.optimality_gap)
    in_time = season.season in scene.speeds
    return ClockWorth(season.season, best.fuel, frozen, mean, shortest, bound, in_time)


def hat_weights(times: FloatArray, moment: float) -> FloatArray:
    """Return weights (nt,) of a current's slices that interpolate linearly to a moment, s."""
    return np.array([np.interp(moment, times, one) for one in np.eye(len(times))])


def mean_weights(times: FloatArray, end: float) -> FloatArray:
    """Return weights (nt,) of a current's slices for its mean from 0 to `end`, s."""
    knots = np.unique(np.concatenate([[0.0, end], times[(times > 0) & (times < end)]]))
    shares = np.zeros(len(knots))
    shares[1:] += np.diff(knots) / 2
    shares[:-1] += np.diff(knots) / 2
    each = np.array([np.interp(knots, times, one) for one in np.eye(len(times))])
    return np.asarray(each @ shares / end)


def weighted(current: renew.VaryingCurrent, weights: FloatArray) -> renew.GriddedCurrent:
    """Return the weighted sum of a current's slices as a steady current."""
    grids = [one for one in current.slices if isinstance(one, renew.GriddedCurrent)]
    used = [(grid, weight) for grid, weight in zip(grids, weights, strict=True) if weight > 0]
    uv = sum((weight * grid.uv for grid, weight in used), np.zeros(grids[0].uv.shape))
    return renew.GriddedCurrent(grids[0].x, grids[0].y, uv[..., 0], uv[..., 1])


def _sailed(
    scene: Scene, season: SeasonPlan, planned_in: Current, options: PlannerOptions
) -> float:
    """Return the fuel in a season's current of the best route planned in `planned_in`, or inf."""
    asked, name = options.model_copy(update={"classes": _CLASSES}), season.season
    vessel, current = scene.vessel_in(name), scene.currents[name]
    other = replace(scene, currents={name: planned_in})
    try:
        plan = other.planned(name, plan_options(asked), season.arrive_by_s)
    except renew.PlanningError:
        return math.inf
    speeds: FloatArray | None = plan.best.speeds
    if name in scene.speeds:
        speeds = speeds_in_time(
            plan.best, current, scene.speeds[name], season.arrive_by_s, options.drift
        )
        if speeds is None:
            return math.inf
    return renew.fuel(plan.best.path, current, vessel, drift=options.drift, speeds=speeds)


def speeds_in_time(
    route: renew.Route, current: Current, choice: SpeedChoice, arrive_by_s: float, drift: Drift
) -> FloatArray | None:
    """Return a route's speeds (n - 1,), m/s, times the least factor with which it is in time.

    Speeds are clipped to the range of the choice. Returns None if the highest are too slow.
    """
    vessel = renew.Vessel(choice.most, turn_rate=1.0)

    def speeds(factor: float) -> FloatArray:
        return np.clip(factor * route.speeds, choice.least, choice.most)

    def is_late(factor: float) -> bool:
        own = speeds(factor)
        arrivals = passage(route.path, current, vessel, drift=drift, speeds=own).times
        return bool(arrivals[-1] > arrive_by_s)

    low, high = choice.least / choice.most, choice.most / choice.least
    if is_late(high):
        return None
    for _ in range(_HALVINGS):
        factor = math.sqrt(low * high)
        low, high = (factor, high) if is_late(factor) else (low, factor)
    return speeds(high)


_PLAN = "from pipeline.stages.seasons.task import plan_from_stdin; plan_from_stdin()"
# Largest length of a process's last output in a message, in characters.
_MAX_SHOWN = 200


@dataclass(frozen=True, slots=True)
class SeasonTask:
    """The inputs and result paths to plan and evaluate one season.

    `owner` is the scenario's name, `limit_s` the task's time limit or None. With `explains_gap` the
    evaluation splits the optimality gap into its causes. Under way the vessel turns off to one of
    the `havens` if no way leads on.
    """

    season: str
    scene_path: Path
    plan_path: Path
    evaluation_path: Path
    options: PlannerOptions
    owner: str = ""
    limit_s: float | None = None
    explains_gap: bool = False
    havens: tuple[renew.Haven, ...] = ()

    def result(self) -> tuple[SeasonPlan, Evaluation] | None:
        """Load plan and evaluation from the store; None if one is missing or damaged."""
        plan = load_artefact(self.plan_path, SeasonPlan)
        evaluation = load_artefact(self.evaluation_path, Evaluation)
        return None if plan is None or evaluation is None else (plan, evaluation)

    def stored_failure(self) -> str | None:
        """Return why the stored plan has no route, or ""; None if the store has no result."""
        found = self.result()
        return None if found is None else found[0].failure

    def make(self, stop: threading.Event | None = None) -> "Status":
        """Plan the season; if it has a time limit, in a process that is killed after it."""
        if self.limit_s is None:
            return Status(self.season, plan_and_evaluate(self), crashed=False)
        return status_in_process(self, stop)


def plan_and_evaluate(task: SeasonTask, on_step: OnStep = ignore_step) -> str:
    """Plan and evaluate a season, and store both; return why it could not be planned, or ""."""
    scene = load_artefact(task.scene_path, Scene)
    if scene is None:
        raise StageError(
            f"this worker can't read {task.scene_path}: give all workers access to the same output "
            "folder"
        )
    plan = load_artefact(task.plan_path, SeasonPlan)
    if plan is None:
        plan = plan_season(scene, task.season, task.options, on_step, task.havens)
        save_artefact(task.plan_path, plan, task.owner)
    shares = gap_shares(scene, plan, task.options) if task.explains_gap else None
    worth = clock_worth(scene, plan, task.options)
    evaluation = replace(
        evaluate_season(scene, plan, task.options),
        gap_shares=() if shares is None else (shares,),
        clock_worths=() if worth is None else (worth,),
    )
    save_artefact(task.evaluation_path, evaluation, task.owner)
    return plan.failure


@dataclass(frozen=True, slots=True)
class Status:
    """How a season's task ended; `failure` is "" if the season has a plan.

    `crashed`: the task itself failed, so that the store has no result for the season.
    """

    season: str
    failure: str
    crashed: bool


def status_of(season: str, result: Callable[[], str]) -> Status:
    """Call `result` and return how the task ended; an exception becomes a failure."""
    try:
        return Status(season, result(), crashed=False)
    except Exception as error:  # noqa: BLE001 - whatever it is, the other seasons continue
        return Status(season, one_line(error), crashed=True)


def status_in_process(task: SeasonTask, stop: threading.Event | None = None) -> Status:
    """Plan and evaluate a season in a process that is killed after its limit, or at `stop`."""
    result = run_python(
        ["-c", _PLAN, str(os.getpid())],
        pickle.dumps(task).hex(),
        math.inf if task.limit_s is None else task.limit_s,
        stop,
    )
    if result.exit_code is None:
        reason = f"took longer than the limit of {task.limit_s:g} s"
        return Status(task.season, reason, crashed=True)
    try:
        failure, crashed = json.loads(result.stdout)
    except ValueError:
        last = next(filter(None, map(str.strip, reversed(result.stderr.split("\n")))), "")
        words = f": {last[:_MAX_SHOWN]}" if last else " (out of memory?)"
        failure, crashed = f"its process ended with code {result.exit_code}{words}", True
    return Status(task.season, str(failure), bool(crashed))


def plan_from_stdin() -> None:
    """Plan the pickled task of standard input; print its failure, and whether it crashed."""
    end_with_parent(int(sys.argv[1]))
    given = bytes.fromhex(sys.stdin.read())
    task = pickle.loads(given)  # noqa: S301 - written by the process that started this
    answer, sys.stdout = sys.stdout, sys.stderr  # keeps libraries' output out of the answer
    status = status_of(task.season, partial(plan_and_evaluate, task))
    answer.write(json.dumps([status.failure, status.crashed]))
