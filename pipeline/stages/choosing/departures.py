"""Choose each season's departure: the best of several, or the latest that arrives in time.

The chosen departure is set in the scenario, and the times of the season's current are counted from
it. Later stages treat it as a given departure.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import partial
from typing import Any, TypeVar

import numpy as np

import renew
from pipeline.errors import RequestError
from pipeline.formats.shared.text import planner_text, season_text
from pipeline.machine.store import Made, Store, artefact_key
from pipeline.model import DepartureChoice, Note, Say, Scene, plan_options
from pipeline.model.planning import speed_choices
from pipeline.scenario.model import PlannerOptions, Scenario
from pipeline.scenario.season import Season
from pipeline.scenario.times import departure_name, interval, named_departure
from pipeline.stages.fetch import FetchedParts
from pipeline.stages.places import later
from pipeline.stages.seasons.one_season import MIN_LATENESS_S

_T = TypeVar("_T")

# Number of plans between two progress notes.
_TOLD_EVERY = 5
# Nobody leaves by the second: departures that are added are whole minutes after the first.
_MINUTE_S = 60.0


@dataclass(frozen=True)
class Chosen:
    """A complete scenario with its data and scene; the chosen departures, and notes on choices."""

    scenario: Scenario
    parts: FetchedParts
    scene: Made[Scene]
    choices: tuple[DepartureChoice, ...] = ()
    notes: tuple[Note, ...] = ()


def choose_departures(given: Chosen, store: Store, say: Say) -> Chosen:
    """Choose the departure of every season that leaves it open, and store the new scene.

    Raises
    ------
    RequestError
        No season has a departure that can be planned.
    """
    departed, scenario, scene = given, given.scenario, given.scene
    for season in scenario.seasons:
        if not season.leaves_departure_open or season.name not in given.parts.current_keys:
            continue
        key = artefact_key(
            "departures", scene.key, scenario.planner.model_dump(mode="json"), season.model_dump()
        )
        choice = store.load("departures", key, DepartureChoice)

        def say_of_it(
            note: Note, about: tuple[str, ...] = scenario.season_if_several(season.name)
        ) -> None:
            say(note.about(*about))

        try:
            if choice is None:
                asked = scene.value, season, scenario.planner, say_of_it
                choice = _in_thread(partial(_choice, *asked))
                store.save("departures", key, choice)
            departed = _with_departure(departed, replace(choice, asked=season))
        except renew.PlanningError as error:
            reason = planner_text(error.text, scene.value, season.name)
            departed = _without(departed, season.name, reason)
    if scenario.seasons and not departed.parts.current_keys:
        raise RequestError(
            [f"{season_text(n)}: {why}" for n, why in departed.parts.failures.items()]
        )
    if departed.scene.key != scene.key:  # tasks load it from the store
        store.load_or_make("project", departed.scene.key, Scene, lambda: departed.scene.value)
    return departed


def _in_thread(work: Callable[[], DepartureChoice]) -> DepartureChoice:
    """Call `work` in a thread: a signal handler must not raise inside compiled code."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(work).result()


def _choice(scene: Scene, season: Season, options: PlannerOptions, say: Say) -> DepartureChoice:
    """Plan a season's departures, and choose the best or the latest that arrives in time."""
    asked: dict[str, Any] = {
        "options": plan_options(options, min_lateness=MIN_LATENESS_S),
        **scene.itinerary(season.name),
    }
    given = (scene.chart, scene.currents[season.name], scene.vessel, scene.start, scene.goal)
    first = scene.departures[season.name]
    if season.arrive_by is not None and season.speed is None:
        by = (season.arrive_by - first).total_seconds()
        return _latest(renew.plan(*given, **asked, arrive_by=by).best, first, season)
    if season.departures is None:
        raise ValueError(f"season {season.name!r} leaves no departure open")
    times = season.departures.seconds
    say(Note.of("departures-asked", count=len(times)))
    within = None if season.to_within is None else interval(season.to_within).total_seconds()
    # The plan stage plans all classes at the best departure, rounded to the second.
    found = renew.plan_departures(
        *given,
        times,
        **asked,
        **scene.pace(season.name, scene.speeds[season.name].within_s if season.speed else 0.0),
        to_within=within,
        spacing=_MINUTE_S,
        progress=partial(_say_progress, len(times), say),
        with_classes=False,
    )
    return DepartureChoice(
        season=season.name,
        first=first,
        departures_s=found.departures,
        fuels=found.fuels,
        durations_s=found.durations,
        homotopies=found.homotopies,
        reasons=tuple(
            "" if cause is None else planner_text(cause.text, scene, season.name)
            for cause in found.causes
        ),
        chosen_s=float(found.departures[found.best]),
        unproven_s=found.unproven,
        has_speeds=season.speed is not None,
    )


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
    if count % _TOLD_EVERY:
        return
    if count < asked:
        say(Note.of("departures-planned", count=count, asked=asked))
    elif count > asked:
        say(Note.of("departures-refined", count=count, unproven_s=unproven_s))


def _with_departure(departed: Chosen, choice: DepartureChoice) -> Chosen:
    """Set a season's chosen departure, and count the times of its current and areas from it."""
    name, parts, scene = choice.season, departed.parts, departed.scene.value
    # Output files have times in whole seconds, so the plan starts at a whole second, too.
    shift = float(round(choice.chosen_s))
    chosen = choice.first + timedelta(seconds=shift)
    label = _label(departed.scenario, name, chosen)
    scenario = departed.scenario.departing(name, chosen, label)
    current = scene.currents[name]
    if isinstance(current, renew.VaryingCurrent):
        current = renew.VaryingCurrent(current.slice_times - shift, current.slices)
    grids = tuple(
        replace(grid, season=label, times_s=grid.times_s - shift) if grid.season == name else grid
        for grid in parts.fetched.currents
    )
    key = artefact_key("departures", parts.current_keys[name], chosen)
    return replace(
        departed,
        scenario=scenario,
        parts=replace(
            parts,
            fetched=replace(
                parts.fetched,
                currents=grids,
                notes=tuple(
                    one.about(*(label if of == name else of for of in one.seasons))
                    for one in parts.fetched.notes
                ),
            ),
            current_keys={**_renamed(parts.current_keys, name, label), label: key},
        ),
        scene=Made(
            artefact_key("departures", departed.scene.key, name, chosen),
            replace(
                scene,
                currents={**_renamed(scene.currents, name, label), label: current},
                current_cells=_renamed(scene.current_cells, name, label),
                areas={
                    **_renamed(scene.areas, name, label),
                    label: later(scene.areas.get(name, ()), shift),
                },
                departures={**_renamed(scene.departures, name, label), label: chosen},
                speeds=speed_choices(scenario),
            ),
        ),
        choices=(*departed.choices, replace(choice, season=label)),
        notes=(
            *departed.notes,
            Note.of("departure-chosen", choice=choice).about(*scenario.season_if_several(label)),
        ),
    )


def _label(scenario: Scenario, season: str, chosen: datetime) -> str:
    """Name a season by its chosen departure, unless it has a name of its own."""
    label = departure_name(chosen)
    others = {one.name for one in scenario.seasons}
    return season if named_departure(season) is None or label in others else label


def _renamed(by_season: Mapping[str, _T], season: str, label: str) -> dict[str, _T]:
    """Return values by season, with one season renamed."""
    return {label if name == season else name: value for name, value in by_season.items()}


def _without(departed: Chosen, season: str, reason: str) -> Chosen:
    """Move a season that has no departure from the currents to the failures, with the reason."""
    parts = departed.parts
    keys = {name: key for name, key in parts.current_keys.items() if name != season}
    failures = {**parts.failures, season: reason}
    return replace(departed, parts=replace(parts, current_keys=keys, failures=failures))
