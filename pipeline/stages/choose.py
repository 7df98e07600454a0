"""Fourth stage: choose the offing and the departures that a scenario leaves open.

`pipeline.stages.region` chooses an open region before the first stage.

The offing is the sum of three lengths: the chart's accuracy; the distance sailed in two minutes,
until somebody acts; and, for the turn that follows, the larger of the turning circle's diameter and
the vessel's length. With land of OpenStreetMap the offing is 0.4 nautical miles for a vessel of 7 m
at 9.7 knots, and 0.9 for a ship of 200 m at 15 knots.

A case with an anchorage where the vessel may wait becomes two. The way to the anchorage is planned
first, and keeps its name. The way on is a case of its own: its departure is chosen between the
arrival and the end of the wait. So each part has departure, arrival, hours early and late, water
and files of its own. On the first part the route of least fuel also arrives first, since the vessel
has one speed; and a vessel that leaves later never arrives earlier. So no other pair of parts needs
less fuel, except by the steps between departures. While the vessel lies at anchor there must be
enough water, and it may lie in no shut area.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.errors import RequestError, StageError
from pipeline.findings.text import planner_text, season_text
from pipeline.machine.store import Artefact, Store, artefact_key, load_artefact, save_artefact
from pipeline.model import (
    Case,
    CaseResult,
    DepartureChoice,
    Fetched,
    Note,
    Say,
    SpeedChoice,
    Water,
    plan_options,
)
from pipeline.model.case import MIN_LATENESS_S
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.model import PlannerOptions, Scenario
from pipeline.scenario.season import (
    DepartureTimes,
    Season,
    departure_name,
    interval,
    named_departure,
)
from pipeline.stages.plan_case import planned
from pipeline.stages.tasks import Status, run_tasks, status_of, stored_case
from renew.errors import Moment
from renew.inputs.openings import Opening

_T = TypeVar("_T")


@dataclass(frozen=True)
class Chosen:
    """A complete scenario with its data and cases; the chosen departures, and notes on choices."""

    scenario: Scenario
    fetched: Fetched
    cases: Artefact[tuple[Case, ...]]
    choices: tuple[DepartureChoice, ...] = ()
    notes: tuple[Note, ...] = ()

    def case(self, name: str) -> Case:
        """Return the case of a name."""
        return next(case for case in self.cases.value if case.name == name)

    def at_clock(
        self, scenario: Scenario, begun: Case, earlier: Case, shift: float, *, keeps: bool = False
    ) -> "Chosen":
        """Return the choice with the case `begun`, whose clock begins `shift` seconds later.

        It takes the place of the `earlier` case, or stands behind it if that is kept. The scenario
        has its season.
        """
        name, label, fetched, cases = earlier.name, begun.name, self.fetched, self.cases.value
        at = [case.name for case in cases].index(name)
        cases = (*cases[: at + keeps], begun, *cases[at + 1 :])
        keys, grids = dict(fetched.current_keys), {grid.case: grid for grid in fetched.currents}
        keys[label] = artefact_key("departures", keys[name], begun.departure)
        if grid := grids.get(name):
            grids[label] = replace(grid, case=label, times_s=grid.times_s - shift)
        names = [case.name for case in cases]
        notes = fetched.notes
        if not keeps:
            notes = tuple(
                one.about(*(label if of == name else of for of in one.cases)) for one in notes
            )
        return replace(
            self,
            scenario=scenario,
            fetched=replace(
                fetched,
                currents=tuple(grids[one] for one in names if one in grids),
                notes=notes,
                # A season without a departure has a case, but no key any more.
                current_keys={one: keys[one] for one in names if one in keys},
            ),
            cases=Artefact(
                artefact_key("departures", self.cases.key, name, label, begun.departure), cases
            ),
        )


def in_thread(work: Callable[[], _T]) -> _T:
    """Call `work` in a thread: a signal handler must not raise inside compiled code."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(work).result()


# Least time between two departures from the anchorage, min.
_STEP_MIN = 10
# Largest number of departures from the anchorage, roughly.
_MOST = 48
# No vessel departs to the second, s.
_MINUTE_S = 60.0
# Number of characters to which a season's name is cut before an addition.
_NAME = 56


def with_onward_legs(given: Chosen) -> Chosen:
    """Return cases that end at the anchorage, and cases that go on; unchanged without one."""
    if given.scenario.anchorage is None:
        return given
    at, wait = given.scenario.anchorage
    cases = tuple(replace(case, goal=case.via[at], via=case.via[:at]) for case in given.cases.value)
    key = artefact_key("onward", given.cases.key)
    split = replace(given, cases=Artefact(key, cases))
    for case in given.cases.value:
        onward = replace(case, start=case.via[at], via=case.via[at + 1 :], follows=case.name)
        split = _split(split, split.case(case.name), onward, wait)
    return split


def _split(given: Chosen, first: Case, onward: Case, wait: timedelta) -> Chosen:
    """Add the case that goes on from the anchorage; none if there is no way to it."""
    plan = in_thread(partial(planned, first.copy(), given.scenario.planner)).plan
    if plan is None or first.departure is None:
        return given  # it is planned again, and says why
    arrival = plan.best.duration * first.projection.scale
    onward = replace(onward, spent_j=plan.best.fuel * first.projection.scale)
    shift = _MINUTE_S * math.ceil(arrival / _MINUTE_S)
    wait_s = max(0.0, wait.total_seconds() + arrival - shift)
    step_min = max(_STEP_MIN, math.ceil(wait_s / _MINUTE_S / _MOST))
    waits = np.arange(0.0, wait_s + 1.0, step_min * _MINUTE_S)
    departures = DepartureTimes(
        first=first.departure + timedelta(seconds=shift),
        every=f"{step_min}min",
        count=_afloat(first, arrival, shift + waits),
    )
    season = next(one for one in given.scenario.seasons if one.name == first.name)
    label = f"{first.name[:_NAME]}-onward"
    keys = {
        "name": label,
        "title": f"{season.title or first.name}, onward from the anchorage",
        "departure": None,
        "departures": departures,
    }
    seasons = *given.scenario.seasons, season.model_copy(update=keys)
    scenario = given.scenario.model_copy(update={"seasons": seasons})
    return given.at_clock(scenario, onward.later(shift, label), first, shift, keeps=True)


def _afloat(case: Case, arrival: float, times: FloatArray) -> int:
    """Return how many of the departures (n,), s, come before the anchorage is shut; at least 1."""
    depth = case.tidal_depth
    areas: list[Opening] = [*case.areas, *(depth.tidal_areas if depth else ())]
    here, ends = shapely.Point(case.goal), times + MIN_LATENESS_S
    begins, shut = np.full(len(ends), arrival), np.zeros(len(ends), dtype=bool)
    for area in areas:
        if shapely.dwithin(area.polygon, here, case.vessel.length):
            shut |= area.is_shut(begins, ends)
    return max(1, int(np.argmax(shut)) if shut.any() else len(shut))


def waiting_notes(chosen: Chosen) -> Iterator[Note]:
    """Yield a note on each time at anchor."""
    waiting = {case.name: case for case in chosen.cases.value if case.follows}
    for choice in chosen.choices:
        if choice.season in waiting:
            case = waiting[choice.season]
            yield Note.of(
                "waits-at-anchor",
                place=case.water.place(case.start),
                begin=choice.first,
                until=choice.chosen,
            ).about(choice.season)


def choose(given: Chosen, store: Store, say: Say, scheduler: str | None = None) -> Chosen:
    """Return a complete scenario with its cases, and report each choice through `say`.

    Raises RequestError, StageError if no season has a departure that can be planned.
    """
    split = with_onward_legs(_with_offing(given))
    chosen = choose_departures(split, store, say, scheduler)
    chosen = replace(chosen, notes=(*chosen.notes, *waiting_notes(chosen)))
    for note in chosen.notes[len(given.notes) :]:
        say(note)
    return chosen


def _with_offing(given: Chosen) -> Chosen:
    """Set the planner's clearance to the chosen offing if the scenario does not give one."""
    scenario, accuracy_m = given.scenario, given.fetched.land.accuracy_m
    options = with_offing(scenario, given.cases.value[0], accuracy_m)
    if options is scenario.planner:
        return given
    note = Note.of(
        "offing-chosen",
        offing_m=(options.clearance or 0.0) * scenario.scale,
        narrow_share=options.narrow_share,
    )
    complete = scenario.model_copy(update={"planner": options})
    return replace(given, scenario=complete, notes=(*given.notes, note))


# Time until a danger is noticed and the helm is over, s; an assumption, as no rule gives a value.
_REACTION_S = 120.0
# Largest offing as a share of the distance between start and goal.
_DISTANCE_SHARE = 1 / 200
# In narrows, the share of the passage's half-width that its shores keep instead of the offing.
_NARROW_SHARE = 0.5
# Spacing of the points of a route at which its distance from land is measured, in offings.
_SPACING = 0.1
# A route counts as closer than the offing below this share of it, which allows for rounding.
_CLOSER = 0.99


def with_offing(scenario: Scenario, case: Case, accuracy_m: float) -> PlannerOptions:
    """Return a scenario's options; without a clearance on a chart, the clearance is the offing."""
    options = scenario.planner
    if options.clearance is not None or scenario.is_planar:
        return options
    distance_m = case.projection.geodesic_length_m(case.stops)
    metres = offing_m(scenario.fastest_vessel, accuracy_m, distance_m)
    # In whole metres, except on the smallest charts.
    kept = float(math.floor(metres)) if metres > 1 else metres
    chosen = {
        "clearance": kept / scenario.scale,
        "narrow_share": min(options.narrow_share, _NARROW_SHARE),
    }
    return options.model_copy(update=chosen)


def offing_m(vessel: VesselSpec, accuracy_m: float, distance_m: float) -> float:
    """Return the offing, true metres, for a vessel, a chart's accuracy, and a voyage's distance."""
    circle_m = 2 * vessel.speed_m_s / math.radians(vessel.turn_rate_deg_s)
    room_m = accuracy_m + _REACTION_S * vessel.speed_m_s + max(circle_m, vessel.length_m)
    return min(room_m, _DISTANCE_SHARE * distance_m)


def narrows_notes(
    water: Water, results: Sequence[CaseResult], options: PlannerOptions
) -> tuple[Note, ...]:
    """Return a note for each case whose best route is closer to land than the offing."""
    if not options.clearance:
        return ()
    notes = (
        (one.name, _narrows(water, np.asarray(one.routes[0].path), options.clearance))
        for one in results
        if one.routes
    )
    return tuple(note.about(name) for name, note in notes if note is not None)


def room_notes(
    water: Water, results: Sequence[CaseResult], options: PlannerOptions
) -> tuple[Note, ...]:
    """Return a note for each case on what its best route's room is for: turns, or an offing."""
    scale, offing = water.projection.scale, options.clearance or 0.0
    return tuple(
        Note.of("room-kept", turns_m=scale * most, offing_m=scale * offing).about(result.name)
        for result in results
        for most in [float(one.turn_padding.max(initial=0.0)) for one in result.routes[:1]]
        if offing and options.padding in ("adaptive", "triangle")
    )


def _narrows(water: Water, path: FloatArray, offing: float) -> Note | None:
    """Return a note on how far and where a path (n, 2) is closer to land than the offing."""
    # The chart's land has a margin, the original one goes on beyond the region's edge.
    land = np.array([*water.chart.no_go, *water.land], dtype=object)
    line, tree = shapely.LineString(path), shapely.STRtree(land)
    if not len(tree.query(line, "dwithin", _CLOSER * offing)):
        return None
    places = shapely.get_coordinates(shapely.segmentize(line, _SPACING * offing))
    # A piece is closer where its middle is; the nearest place may be an end of the path.
    points = np.concatenate([(places[1:] + places[:-1]) / 2, places])
    # Most of a long way is far from land: how far, takes time and tells nothing.
    (closer, _), apart = tree.query_nearest(
        shapely.points(points), _CLOSER * offing, return_distance=True, all_matches=False
    )
    if not len(closer):
        return None
    nearest, scale = int(apart.argmin()), water.projection.scale
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    return Note.of(
        "offing-yields",
        offing_m=offing * scale,
        length_m=float(lengths[closer[closer < len(lengths)]].sum()) * scale,
        least_m=float(apart[nearest]) * scale,
        place=water.place(points[closer[nearest]]),
    )


# Share by which fuels in one steady current differ only because a path is found again.
_AS_GOOD = 1e-4
# Number of plans between two progress notes.
_PLANS_PER_NOTE = 5


@dataclass(frozen=True, slots=True)
class SweepTask:
    """The inputs and result path to plan the departures of one case, and to choose among them."""

    asked: Season
    cases_path: Path
    choice_path: Path
    options: PlannerOptions
    owner: str = ""

    @property
    def case(self) -> str:
        """The case's name."""
        return self.asked.name

    def result(self) -> DepartureChoice | None:
        """Load the choice from the store; None if it is missing or damaged."""
        return load_artefact(self.choice_path, DepartureChoice)

    def make(self) -> Status:
        """Choose the departure; an error becomes a failure."""
        return status_of(self.case, lambda: sweep(self))


def sweep(task: SweepTask, say: Say = lambda _: None) -> str:
    """Choose a case's departure, and store the choice; return why there is none, or ""."""
    case = stored_case(task)
    try:
        choice = _choice(case, task.asked, task.options, say)
    except renew.PlanningError as error:
        reason = planner_text(error.text, case)
        if case.follows:
            reason += "; or let the vessel wait longer at its anchorage"
        return reason
    save_artefact(task.choice_path, choice, task.owner)
    return ""


def _choice(case: Case, season: Season, options: PlannerOptions, say: Say) -> DepartureChoice:
    """Plan a case's departures, and choose the best or the latest that arrives in time."""
    asked: dict[str, Any] = {
        "options": plan_options(options, case.projection.scale, min_lateness=MIN_LATENESS_S),
        **case.itinerary(0.0 if case.speeds is None else case.speeds.within_s),
    }
    given, first = (case.chart, case.current, case.vessel, case.start, case.goal), case.departure
    if first is None:
        raise ValueError(f"season {season.name!r} leaves a departure open without a clock")
    by = math.inf
    if season.arrive_by is not None and season.speed is None:
        by = (season.arrive_by - first).total_seconds()
    if season.departures is None:
        return _latest(renew.plan(*given, **asked | {"arrive_by": by}).best, first, season)
    times = season.departures.seconds
    say(Note.of("departures-asked", count=len(times)))
    within = None if season.to_within is None else interval(season.to_within).total_seconds()
    # The plan stage plans all classes at the best departure, rounded to the second.
    found = renew.plan_departures(
        *given,
        times,
        **asked,
        to_within=within,
        spacing=_MINUTE_S,
        progress=partial(_say_progress, len(times), say),
        with_classes=False,
    )
    fuels = np.where(found.arrivals <= by, found.fuels, np.inf)
    if case.follows:
        # At anchor the hotel load is burnt, which may be worth an earlier departure.
        waited = found.departures - found.departures[0]
        fuels = fuels + case.vessel.hotel * waited / case.projection.scale
    causes = [
        _too_late(arrival, by) if cause is None and arrival > by else cause
        for cause, arrival in zip(found.causes, found.arrivals, strict=True)
    ]
    if not np.isfinite(fuels).any():
        raise _too_late(found.arrivals.min(), by)
    # Where only the hours of areas matter, many departures are as good: the earliest is taken.
    enough = (1 + _AS_GOOD) * fuels.min() if case.current.is_steady else fuels.min()
    best = int((fuels <= enough).argmax())
    return DepartureChoice(
        season=season.name,
        first=first,
        departures_s=found.departures,
        fuels=fuels,
        durations_s=found.durations,
        homotopies=found.homotopies,
        reasons=tuple("" if cause is None else planner_text(cause.text, case) for cause in causes),
        chosen_s=float(found.departures[best]),
        unproven_s=found.unproven,
        has_speeds=season.speed is not None,
    )


def _too_late(arrival: float, by: float) -> renew.ArrivalError:
    """Return the error of a departure whose route arrives after the latest arrival, s."""
    return renew.ArrivalError("arrives at {0}, later than {1}", Moment(arrival), Moment(by))


def _latest(route: renew.Route, first: datetime, season: Season) -> DepartureChoice:
    """Return the departure of a route that arrives just in time, as the season's choice."""
    begin = float(route.times[0])
    return DepartureChoice(
        season=season.name,
        first=first,
        departures_s=np.array([begin]),
        fuels=np.array([route.fuel]),
        durations_s=np.array([route.duration]),
        homotopies=(route.homotopy,),
        reasons=("",),
        chosen_s=begin,
        arrive_by=season.arrive_by,
    )


def _say_progress(asked: int, say: Say, count: int, unproven_s: float) -> None:
    """Report progress after every few plans, first of the given departures, then of added ones."""
    if count % _PLANS_PER_NOTE:
        return
    if count < asked:
        say(Note.of("departures-planned", count=count, asked=asked))
    elif count > asked:
        say(Note.of("departures-refined", count=count, unproven_s=unproven_s))


def choose_departures(
    given: Chosen, store: Store, say: Say, scheduler: str | None = None
) -> Chosen:
    """Choose the departure of every season that leaves it open, and store the new cases.

    The cases are independent tasks; see :mod:`pipeline.stages.tasks`. Raises RequestError if no
    season has a departure that can be planned; StageError if that is because tasks crashed, or the
    scheduler can't be used.
    """
    tasks = {task.case: task for task in _sweeps(given, store)}
    waiting = [task for task in tasks.values() if task.result() is None]
    failures, crashed = dict[str, str](), set[str]()

    def report(status: Status) -> None:
        failures[status.case] = status.failure
        crashed.update({status.case} if status.crashed else ())

    def work(task: SweepTask) -> str:
        about = given.scenario.season_if_several(task.case)
        return sweep(task, lambda note: say(note.about(*about)))

    if waiting:  # tasks load their case from the store
        store.load_or_make("project", given.cases.key, tuple, lambda: given.cases.value)
    run_tasks(waiting, scheduler, report, work)
    departed = given
    for season, task in tasks.items():
        choice = task.result()
        if choice is not None:
            departed = _with_departure(departed, replace(choice, asked=task.asked))
        else:
            missing = "its result is missing from the store; run again"
            departed = _without(departed, season, failures.get(season) or missing)
    if not departed.fetched.current_keys:
        reasons = [f"{season_text(n)}: {why}" for n, why in departed.fetched.failures.items()]
        raise StageError("; ".join(reasons)) if crashed else RequestError(reasons)
    store.load_or_make("project", departed.cases.key, tuple, lambda: departed.cases.value)
    return departed


def _sweeps(given: Chosen, store: Store) -> Iterator[SweepTask]:
    """Yield a task for each season that has a current and leaves its departure open."""
    options = given.scenario.planner
    for season in given.scenario.seasons:
        if season.leaves_departure_open and season.name in given.fetched.current_keys:
            key = artefact_key(
                "departures", given.cases.key, options.model_dump(mode="json"), season.model_dump()
            )
            cases, choice = store.path("project", given.cases.key), store.path("departures", key)
            yield SweepTask(season, cases, choice, options, store.owner)


def _with_departure(departed: Chosen, choice: DepartureChoice) -> Chosen:
    """Set a season's chosen departure, and count the times of its current and areas from it."""
    name = choice.season
    # Output files have times in whole seconds, so the plan starts at a whole second, too.
    shift = float(round(choice.chosen_s))
    chosen = choice.first + timedelta(seconds=shift)
    label = _label(departed.scenario, name, chosen)
    scenario = departed.scenario.departing(name, chosen, label)
    case = departed.case(name)
    season = next(one for one in scenario.seasons if one.name == label)
    waited_j = case.vessel.hotel * shift * bool(case.follows)
    begun = replace(
        case.later(shift, label), speeds=SpeedChoice.of(season), spent_j=case.spent_j + waited_j
    )
    notes = [Note.of("departure-chosen", choice=choice)]
    if case.members is not None:
        notes.append(Note.of("departure-in-mean"))
    return replace(
        departed.at_clock(scenario, begun, case, shift),
        choices=(*departed.choices, replace(choice, season=label)),
        notes=(
            *departed.notes,
            *(note.about(*scenario.season_if_several(label)) for note in notes),
        ),
    )


def _label(scenario: Scenario, season: str, chosen: datetime) -> str:
    """Name a season by its chosen departure, unless it has a name of its own."""
    label = departure_name(chosen)
    others = {one.name for one in scenario.seasons}
    return season if named_departure(season) is None or label in others else label


def _without(departed: Chosen, season: str, reason: str) -> Chosen:
    """Leave out the plan of a season that has no departure, with the reason."""
    fetched = departed.fetched
    keys = {name: key for name, key in fetched.current_keys.items() if name != season}
    failures = {**fetched.failures, season: reason}
    return replace(departed, fetched=replace(fetched, current_keys=keys, failures=failures))
