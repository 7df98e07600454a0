"""What a night's workers make: charts and currents, which many cases share, and batches of cases.

A chart or current is made once and stored. A batch of cases on one chart loads both from their
paths. Yesterday's route, sailed in tonight's current, is compared with tonight's best route.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

import numpy as np
import shapely

import renew
from pipeline import model
from pipeline.errors import StageError, one_line
from pipeline.findings.choices import close_sides, ensemble_figures, flips_text, side_shares
from pipeline.findings.names import figures
from pipeline.findings.note_words import note_texts
from pipeline.findings.way_names import way_names
from pipeline.machine.store import Artefact, Store, artefact_key, load_artefact, save_artefact
from pipeline.nightly.cycles import Row
from pipeline.nightly.records import ACT, LOOK, SAME, EarlierRoute
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import Season
from pipeline.scenario.strict import Point
from pipeline.sources.current_field import land_freed_at_end
from pipeline.sources.registry import charted_land, weather_grids
from pipeline.stages.choose import with_offing
from pipeline.stages.fetch import Fetcher, on_clock
from pipeline.stages.limits import limited_fields, over_limits
from pipeline.stages.places import plane_current, plane_water
from pipeline.stages.plan_case import plan_case
from pipeline.stages.project import members_of, planar_current, water_of
from pipeline.stages.region import chosen_region
from pipeline.stages.simplify import simplify
from renew import Route
from renew.inputs.options import Drift

STAGE = "night-chart"
"""Stage of charts and currents in the keys of the store."""
PLANNED = "planned"
FAILED = "failed"
BROKEN = "broken"
"""Status of a case: the worker that planned it has died, twice."""
# If start or goal moved by more than this share of the route's length, routes are not compared.
_SAME_END = 1e-6
# If yesterday's route is cheaper by more than this percentage, that is reported; the planner's
# tolerance is smaller.
_CHEAPER_PERCENT = 0.1
# Largest spacing of points from which two lines' distance is measured, as a share of a leg.
_DENSIFY = 0.01
_Stored = TypeVar("_Stored", "NightChart", "NightCurrent")


# --- charts and currents ---


@dataclass(frozen=True)
class NightChart:
    """A scenario with its region, and its chart for one vessel in the planner's plane."""

    scenario: Scenario
    water: model.Water
    accuracy_m: float


@dataclass(frozen=True)
class NightCurrent:
    """A current in the planner's plane.

    `stand_in` is "" or says which current replaces the first choice, and why. `members` are there
    if it is the mean of several, and `left_out` says which of them can't be used, and why. The
    `weather` is wind and waves with a limit.
    """

    current: model.Current
    valid: str
    source: str
    stand_in: str
    members: model.MemberCurrents | None = None
    left_out: tuple[str, ...] = ()
    weather: tuple[model.inputs.LimitedField, ...] = ()


@dataclass(frozen=True, slots=True)
class ChartTask:
    """A task to make a chart; `ends` are the starts and goals of all pairs on it."""

    scenario: Scenario
    ends: tuple[Point, ...]
    store_root: Path
    path: Path

    def make(self) -> None:
        """Make the chart and store it, unless it is stored already."""
        if load_artefact(self.path, NightChart) is None:
            store = Store(self.store_root, "nightly")
            save_artefact(self.path, _chart(self.scenario, self.ends, store))


@dataclass(frozen=True, slots=True)
class CurrentTask:
    """A task to fetch one current of a chart."""

    season: Season
    chart_path: Path
    store_root: Path
    path: Path

    def make(self) -> None:
        """Fetch the current, project it to the chart's plane, and store it, unless it is stored.

        Raises StageError if no source has the current, or the chart is missing.
        """
        if load_artefact(self.path, NightCurrent) is not None:
            return
        chart = loaded_chart(self.chart_path)
        save_artefact(self.path, _current(self, chart))


@lru_cache(maxsize=2)
def loaded_chart(path: Path) -> NightChart:
    """Load a stored chart; a worker keeps the last two in memory."""
    return _loaded(path, NightChart)


@lru_cache(maxsize=4)
def loaded_current(path: Path) -> NightCurrent:
    """Load a stored current; a worker keeps the last four in memory."""
    return _loaded(path, NightCurrent)


def _loaded(path: Path, kind: type[_Stored]) -> _Stored:
    """Load a chart or current that a task has stored; raise StageError if it can't be read."""
    stored = load_artefact(path, kind)
    if stored is None:
        raise StageError(f"can't read {path}; give all workers access to the same output folder")
    return stored


def chart_key(scenario: Scenario, ends: Sequence[Point]) -> str:
    """Return the store's key of a scenario's chart on which `ends` stay in water."""
    names = {"region", "plane", "scale", "chart", "vessel", "limits", "start", "goal", "planner"}
    inputs = scenario.model_dump(mode="json", include=names)
    identity = () if scenario.is_planar else charted_land(scenario).identity
    return artefact_key(STAGE, identity, inputs, list(ends))


def _chart(scenario: Scenario, ends: Sequence[Point], store: Store) -> NightChart:
    """Fetch, simplify and project a scenario's chart, on which `ends` stay in water."""
    if scenario.plane is not None:
        return NightChart(scenario, plane_water(scenario, scenario.plane), 0.0)
    if scenario.region is None:
        region = chosen_region(scenario, store, offline=False)
        scenario = region.complete(scenario)
    fetcher = _fetcher(scenario, store)
    land = fetcher.land
    simplified = simplify(scenario, Artefact(fetcher.land_key, land), store, ends).value
    return NightChart(scenario, water_of(scenario, land, simplified), land.accuracy_m)


def _fetcher(scenario: Scenario, store: Store) -> Fetcher:
    """Return the fetcher of land and currents in a scenario's region."""
    if scenario.region is None:
        raise StageError("the chart's region is yet to be chosen")
    land = charted_land(scenario)
    return Fetcher(scenario.region, land, store, offline=False)


@lru_cache(maxsize=1)
def _chart_fetcher(chart_path: Path, store_root: Path) -> Fetcher:
    """Return a chart's fetcher; cached, because it contains the land."""
    return _fetcher(loaded_chart(chart_path).scenario, Store(store_root, "nightly"))


def _current(task: CurrentTask, chart: NightChart) -> NightCurrent:
    """Fetch a current and project it to the chart's plane."""
    season, water, seed = task.season, chart.water, chart.scenario.planner.seed
    if chart.scenario.is_planar:
        current = plane_current(season, water.chart.extent)
        members = members_of(water, season.members, seed, current, None)
        return NightCurrent(current, season.title or season.name, "numbers", "", members)
    with land_freed_at_end():
        fetched = _chart_fetcher(task.chart_path, task.store_root).current(season)
    if not isinstance(fetched, Artefact):
        raise fetched
    grid = fetched.value
    current = planar_current(grid, water.projection, water.chart.bounds)
    members = members_of(water, season.members, seed, current, grid)
    left_out = note_texts(note for note in grid.notes if note.kind == "member-left-out")
    weather = limited_fields(
        weather_grids(chart.scenario, on_clock(season, chart.scenario)),
        chart.scenario.weather_limits,
    )
    return NightCurrent(
        *(current, grid.valid, grid.credit.name, _stand_in(grid), members, tuple(left_out)), weather
    )


def _stand_in(grid: model.CurrentGrid) -> str:
    """Return which current replaces the first choice, and why; "" if it is the first choice."""
    reasons = [reason for _, reason in grid.passed_over]
    return "; ".join((*note_texts(grid.stand_in_notes), *reasons)) if grid.is_stand_in else ""


# --- cases ---


@dataclass(frozen=True, slots=True)
class NightCaseTask:
    """One case for a worker.

    `names` are the six parts of its name; `leaves` is its departure. Start and goal are None if the
    case uses those of the scenario. `earlier` is yesterday's route. `failure` is the reason why the
    case can't be planned, or "".
    """

    index: int
    name: str
    names: tuple[str, ...]
    current_path: Path
    start: Point | None
    goal: Point | None
    leaves: datetime | None
    earlier: EarlierRoute | None = None
    failure: str = ""


@dataclass(frozen=True, slots=True)
class PlanBatch:
    """Neighbouring cases on one chart, with what says which of them somebody should look at.

    `look_percent` is the smallest saving over yesterday's route that should be looked at. `stale`
    says why the currents are too old, or "".
    """

    cases: tuple[NightCaseTask, ...]
    chart_path: Path
    look_percent: float
    stale: str

    def make(self) -> list[Row]:
        """Plan the cases; return their rows. A case's last row has the seconds that it took."""
        rows: list[Row] = []
        for case in self.cases:
            begun = time.perf_counter()
            rows += rows_of(case, self)
            rows[-1]["seconds"] = time.perf_counter() - begun
        return rows


def rows_of(case: NightCaseTask, batch: PlanBatch) -> list[Row]:
    """Plan a case; return the rows of its routes, then the row of the case itself."""
    if case.failure:
        return [failed_row(case, case.failure, batch.stale)]
    try:
        chart = loaded_chart(batch.chart_path)
        current = loaded_current(case.current_path)
        voyage = _case_of(case, chart, current)
        options = with_offing(chart.scenario, voyage, chart.accuracy_m)
        planned = plan_case(voyage, options)
        ((planned,), *_) = way_names(voyage.water, [planned], ())
        figures = planned.measures.routes
    except Exception as error:  # noqa: BLE001 - the other cases continue
        return [failed_row(case, one_line(error), batch.stale)]
    if planned.plan is None:
        row = failed_row(case, planned.failure, batch.stale)
        return [row | _described(current)]
    routes = [
        _route_row(case, voyage, route, figure)
        for route, figure in zip(planned.routes, figures, strict=True)
    ]
    best = routes[0]
    row = _row_of(case, 0) | {key: best[key] for key in best if key not in {"rank", "index"}}
    if planned.ensemble is not None:
        row |= ensemble_figures(planned.ensemble, figures)
        close = "too close to call: " * bool(close_sides(planned.ensemble, figures))
        row["members_sides"] = close + side_shares(planned.ensemble, figures)
    row |= _described(current) | {
        "status": PLANNED,
        "reason": "",
        "leaves": case.leaves,
        "routes": len(routes),
        "rejected": len(planned.plan.rejected),
    }
    if case.earlier is not None:
        row |= compared(case.earlier, voyage, planned, drift=options.drift, leaves=case.leaves)
    outcome, why = judged(row, planned, case.earlier, batch)
    return [*routes, row | {"outcome": outcome, "why": why}]


def _case_of(case: NightCaseTask, chart: NightChart, current: NightCurrent) -> model.Case:
    scenario, water = chart.scenario, chart.water
    start, goal = water.to_plane([case.start or scenario.start, case.goal or scenario.goal])
    voyage = model.Case(
        case.names[1],
        water,
        model.planner_vessel(scenario.vessel),
        start,
        goal,
        current.current,
        under_keel_clearance_m=scenario.chart.under_keel_clearance_m,
        members=current.members,
        power=scenario.vessel.power,
        weather=current.weather,
        areas=tuple(over_limits(current.weather, water.projection, water.chart.extent)),
    )
    is_steady = current.current.is_steady and not current.weather
    return voyage if is_steady else replace(voyage, departure=case.leaves)


def failed_row(case: NightCaseTask, reason: str, stale: str, status: str = FAILED) -> Row:
    """Return the row of a case without a route."""
    row = _row_of(case, 0) | {
        "status": status,
        "reason": reason,
        "outcome": "act",
        "why": "no route",
        "leaves": case.leaves,
        "routes": 0,
        "rejected": 0,
        "seconds": 0.0,
    }
    if case.earlier is not None:
        row |= case.earlier.columns()
    if stale:
        row["why"] += f"; {stale}"
    return row


def _row_of(case: NightCaseTask, rank: int) -> Row:
    """Return the columns that identify a row: the case's name and the route's rank."""
    names = ("scenario", "season", "pair", "departure", "vessel", "member")
    named = dict(zip(names, case.names, strict=True))
    return {"index": case.index, "case": case.name, **named, "rank": rank}


def _described(current: NightCurrent) -> Row:
    return {
        "currents": current.valid,
        "source": current.source,
        "stand_in": current.stand_in,
        "members_left_out": "; ".join(current.left_out) or None,
    }


def _route_row(
    case: NightCaseTask, voyage: model.Case, route: Route, figure: model.RouteMetrics
) -> Row:
    lonlat = voyage.projection.to_lonlat(np.asarray(route.path))
    return _row_of(case, figure.rank) | {
        **{name: _known(value) for name, value in figures(figure, "night").items()},
        "arrival": _arrival(case.leaves, figure.duration_s),
        "geometry": shapely.to_wkb(shapely.LineString(lonlat)),
    }


def _known(figure: object) -> object:
    """Return a figure, or None if it is a number that is not finite."""
    return None if isinstance(figure, float) and not math.isfinite(figure) else figure


def _arrival(leaves: datetime | None, duration_s: float) -> datetime | None:
    """Return the arrival, to the second; None without a departure."""
    return None if leaves is None else leaves + timedelta(seconds=round(duration_s))


def compared(
    earlier: EarlierRoute,
    voyage: model.Case,
    planned: model.CaseResult,
    *,
    drift: Drift,
    leaves: datetime | None,
) -> Row:
    """Return the columns that compare tonight's best route with yesterday's.

    `keep_fuel` is the fuel of yesterday's route in tonight's current, from tonight's departure on
    if the current changes. It is missing if the current overpowers the vessel or ends before the
    arrival, or if the route now meets land. The arrival is computed from it, because
    duration and fuel are proportional at constant thrust.
    """
    path = voyage.projection.to_plane(earlier.path)
    route = planned.routes[0]
    allowed = _SAME_END * max(route.length, 1e-9)
    if max(np.hypot(*(path[0] - voyage.start)), np.hypot(*(path[-1] - voyage.goal))) > allowed:
        return {}
    chart = voyage.chart
    keep = renew.fuel(path, voyage.current, voyage.vessel, drift=drift, chart=chart)
    line = shapely.LineString(path)
    # A route without padding may touch land, and rounding may move it onto the land.
    is_over_land = shapely.intersection(chart.hard_no_go, line).length > allowed
    if is_over_land or keep > voyage.vessel.fuel_rate * voyage.current.span[1]:
        keep = math.inf
    row = earlier.columns()
    apart = shapely.hausdorff_distance(line, shapely.LineString(route.path), densify=_DENSIFY)
    row["apart_m"] = float(apart) * voyage.projection.scale
    if math.isfinite(keep):
        row["keep_fuel"] = keep
        row["saving_percent"] = 100 * (keep - route.fuel) / keep
        duration_s = planned.measures.routes[0].duration_s * keep / route.fuel
        row["keep_arrival"] = _arrival(leaves, duration_s)
    return row


def judged(
    row: Row, planned: model.CaseResult, earlier: EarlierRoute | None, batch: PlanBatch
) -> tuple[str, str]:
    """Return a planned case's outcome, and the reasons if it is not "same"."""
    act, look = list[str](), list[str]()
    if earlier is not None and "earlier_class" in row:
        rejected = {path.homotopy for path in planned.plan.rejected} if planned.plan else set()
        sailed = {route.homotopy for route in planned.routes}
        name = earlier.homotopy
        if name in rejected - sailed or row.get("keep_fuel") is None:
            act.append(f"yesterday's class {name} can't be sailed any more")
        if earlier.island == row["island"] and earlier.side != row["side"]:
            sure = f"; {flips_text(row)}" if "members_flips" in row else ""
            look.append(f"{earlier.side} yesterday, {row['side']} now{sure}")
        saving = row.get("saving_percent")
        if saving is not None and saving < -_CHEAPER_PERCENT:
            # Tonight's best route has the least fuel of all routes that are safe tonight.
            look.append(
                f"yesterday's route would need {-saving:.1f} % less, but no longer keeps the "
                "clearance that tonight's current asks for"
            )
        if saving is not None and saving > batch.look_percent:
            look.append(f"changing the route saves {saving:.1f} %")
    if batch.stale:
        look.append(batch.stale)
    if row.get("stand_in"):
        look.append(row["stand_in"])
    outcome = ACT if act else LOOK if look else SAME
    return outcome, "; ".join([*act, *look])
