"""Stage between comparing and writing: from where along each best route a haven is reached in time.

A plane's times differ a little from true ones, as its point scale does along a way. The limits are
therefore lowered so far that all ways keep them in true time.
"""

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import shapely

import renew
from pipeline.errors import RequestError, refuse_any
from pipeline.findings.result import RunCase, RunResult, addressed
from pipeline.findings.text import hours, planner_text, season_text
from pipeline.machine.interpreters import cores
from pipeline.machine.store import Artefact, Store, artefact_key
from pipeline.model import Case, Note, Place, Say, Water, plan_options
from pipeline.model.case import MIN_LATENESS_S
from pipeline.scenario.model import HavensSpec, Scenario
from pipeline.sources.land.vector import read_havens
from renew.inputs.openings import with_always_shut


def havens_in(scenario: Scenario, water: Water) -> tuple[tuple[renew.Haven, ...], tuple[Note, ...]]:
    """Return the scenario's havens that lie in the water, and notes on the others.

    Raises RequestError if the file can't be read, or none of its havens lies in the water; all are
    named.
    """
    if scenario.havens is None:
        return (), ()
    found, left_out = list[renew.Haven](), list[Note]()
    for name, place in read_havens(Path(scenario.havens.path)).items():
        reason = _misplaced(scenario, water, place)
        if reason:
            left_out.append(Note.of("haven-left-out", haven=name, place=place, reason=reason))
        else:
            found.append(renew.Haven(name, water.projection.to_plane((place.x, place.y))))
    if not found:
        names = [f"{dict(note.values)['haven']} {dict(note.values)['reason']}" for note in left_out]
        raise RequestError(f"havens.path: no haven can be used: {'; '.join(names)}")
    return tuple(found), tuple(left_out)


def _misplaced(scenario: Scenario, water: Water, place: Place) -> str:
    """Say why a haven does not lie in the water; "" if it does."""
    area = scenario.area
    west, _, east, _ = area.bounds
    turns = round((place.x - (west + east) / 2) / 360)
    if not area.covers(shapely.Point(place.x - 360 * turns, place.y)):
        return "lies outside the region; widen the region, or leave it out"
    chart = water.chart
    here = shapely.Point(water.projection.to_plane((place.x, place.y)))
    if chart.water.covers(here):
        return ""
    line = shapely.get_coordinates(shapely.shortest_line(here, chart.water))
    metres = water.projection.geodesic_length_m(line)
    return (
        f"lies on {scenario.chart.no_go}, or within the margin around it, {metres:.0f} m from the "
        f"nearest water at {water.place_text(line[-1])}; move it there"
    )


def cover(result: Artefact[RunResult], store: Store, say: Say) -> Artefact[RunResult]:
    """Return a result with the coverage of each case's best route by havens, and its notes.

    Raises RequestError if the endurance is below a route's own time; all cases are named.
    """
    run = result.value
    spec = run.scenario.havens
    if spec is None:
        return result
    havens, notes = havens_in(run.scenario, run.water)
    best = {case.name: case.routes[0] for case in run.cases if case.routes}
    # Time under way before each case: nothing is burnt at an anchorage, but on the way to it.
    before = {name: run.case(name).case.follows for name in best}
    spent_s = {
        name: best[first].metrics.duration_s if first in best else 0.0
        for name, first in before.items()
    }
    lasts_s = {name: _endurance_s(run.case(name).case, spec, spent_s[name]) for name in best}
    faults = [
        f"havens.endurance = {spec.endurance or hours(lasts_s[name])!r} is below the "
        f"{hours(spent_s[name] + one.metrics.duration_s)} that the best route of "
        f"{season_text(name)} takes; give more{'' if spec.endurance else ' battery or tank'}"
        for name, one in best.items()
        if lasts_s[name] < spent_s[name] + one.metrics.duration_s
    ]
    refuse_any(faults)
    places = [(haven.name, *haven.place.tolist()) for haven in havens]
    limits = spec.model_dump(mode="json", exclude={"path"})

    def covered(name: str) -> renew.Coverage:
        key = artefact_key("cover", result.key, name, places, limits)
        left_s = lasts_s[name] - spent_s[name]
        make = partial(_covered, run.case(name), spec, havens, left_s)
        return store.load_or_make("cover", key, renew.Coverage, make)

    with ThreadPoolExecutor(min(len(best), cores())) as pool:
        coverages = dict(zip(best, pool.map(covered, best), strict=True))
    found = replace(run, coverages=coverages)
    notes = addressed((*notes, *_notes(found)), run.scenario)
    for note in notes:
        say(note)
    fetched = replace(run.fetched, notes=(*run.fetched.notes, *notes))
    key = artefact_key("cover", result.key, places, limits)
    return Artefact(key, replace(found, fetched=fetched))


def _endurance_s(case: Case, spec: HavensSpec, spent_s: float) -> float:
    """Return how long fuel lasts from the departure on, s, of which `spent_s` are over before.

    As given, or by battery or tank; infinite where nothing is known of them.
    """
    if spec.endurance_s is not None:
        return spec.endurance_s
    if case.energy is None or not math.isfinite(case.energy.on_board):
        return math.inf
    return spent_s + case.projection.scale * case.energy.on_board / case.vessel.fuel_rate


def _covered(
    case: RunCase, spec: HavensSpec, havens: Sequence[renew.Haven], left_s: float
) -> renew.Coverage:
    """Return the coverage of a case's best route, with the ways that it needs.

    Fuel lasts for `left_s` seconds from the beginning of the case on.
    """
    planned, scale = case.case, case.case.projection.scale
    within_s = spec.within_s
    best, *others = case.routes
    sides = {one.metrics.main_passage: one for one in reversed(others)}
    sides.pop(best.metrics.main_passage, None)
    ranks = {} if len(planned.via) else {one.route: one.rank for one in sides.values()}
    coverage = renew.cover(
        best.route,
        with_always_shut(planned.chart, planned.areas),
        planned.current,
        planned.vessel,
        havens,
        within=None if within_s is None else within_s / scale,
        endurance=planned.vessel.fuel_rate * left_s / scale if math.isfinite(left_s) else None,
        others=tuple(ranks),
        options=plan_options(case.scenario.planner, min_lateness=MIN_LATENESS_S),
    )
    turns = tuple(_named(one, f"goal by route {ranks[one.other]}") for one in coverage.class_turns)
    coverage = replace(coverage, class_turns=turns)
    return replace(coverage, diversions=tuple(_needed(coverage)))


def _named(turn: renew.ClassTurn, name: str) -> renew.ClassTurn:
    """Return a change to another class whose way has a name that readers know."""
    way = turn.diversion
    return replace(turn, diversion=replace(way, haven=replace(way.haven, name=name)))


def _needed(coverage: renew.Coverage) -> Iterator[renew.Diversion]:
    """Yield the ways by which a coverage says what to do, each once, in order of time."""
    ends = [*coverage.abort_points, *filter(None, [coverage.no_return])]
    ways = [
        *(one.diversion for one in coverage.stretches if one.diversion is not None),
        *(one.diversion for one in ends),
        *(one.diversion for one in coverage.class_turns),
        *(way for one in coverage.equal_points for way in (one.before, one.after)),
    ]
    yield from sorted(dict.fromkeys(ways), key=lambda way: way.time)


def _notes(run: RunResult) -> Iterator[Note]:
    """Yield notes on each case's coverage, and on havens to which no way was found."""
    for name, coverage in run.coverages.items():
        yield Note.of(
            "coverage",
            covered=coverage.share("covered"),
            uncovered=coverage.share("uncovered"),
            not_settled=coverage.share("not settled"),
        ).about(name)
        for haven, error in coverage.left_out:
            yield Note.of(
                "haven-left-out",
                haven=haven.name,
                place=run.water.place(np.asarray(haven.place)),
                reason=f"is not used: {planner_text(error.text, run.case(name).case)}",
            ).about(name)
