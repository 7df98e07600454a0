"""Choose the departure of a season that leaves it open, as one task; see `seasons/task.py`."""

import math
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import renew
from pipeline.findings.text import planner_text
from pipeline.machine.store import load_artefact, save_artefact
from pipeline.model import Case, DepartureChoice, Note, Say, plan_options
from pipeline.model.case import MIN_LATENESS_S
from pipeline.scenario.model import PlannerOptions
from pipeline.scenario.season import Season, interval
from pipeline.stages.seasons.task import Status, status_of, stored_case
from renew.errors import Moment

# Number of plans between two progress notes.
_PLANS_PER_NOTE = 5
# Departures that are added are whole minutes after the first: no vessel departs to the second.
_MINUTE_S = 60.0


@dataclass(frozen=True, slots=True)
class SweepTask:
    """The inputs and result path to plan the departures of one season, and to choose among them."""

    asked: Season
    scene_path: Path
    choice_path: Path
    options: PlannerOptions
    owner: str = ""

    @property
    def season(self) -> str:
        """The season's name."""
        return self.asked.name

    def result(self) -> DepartureChoice | None:
        """Load the choice from the store; None if it is missing or damaged."""
        return load_artefact(self.choice_path, DepartureChoice)

    def stored_failure(self) -> str | None:
        """Return "" if the store has the choice, else None: failures are not stored."""
        return None if self.result() is None else ""

    def make(self) -> Status:
        """Choose the departure; an error becomes a failure."""
        return status_of(self.season, lambda: sweep(self))


def _ignore(note: Note) -> None:
    """Ignore a note."""
    del note


def sweep(task: SweepTask, say: Say = _ignore) -> str:
    """Choose a season's departure, and store the choice; return why there is none, or ""."""
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
        "options": plan_options(options, min_lateness=MIN_LATENESS_S),
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
    causes = [
        _too_late(arrival, by) if cause is None and arrival > by else cause
        for cause, arrival in zip(found.causes, found.arrivals, strict=True)
    ]
    if not np.isfinite(fuels).any():
        raise _too_late(found.arrivals.min(), by)
    return DepartureChoice(
        season=season.name,
        first=first,
        departures_s=found.departures,
        fuels=fuels,
        durations_s=found.durations,
        homotopies=found.homotopies,
        reasons=tuple("" if cause is None else planner_text(cause.text, case) for cause in causes),
        chosen_s=float(found.departures[fuels.argmin()]),
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
