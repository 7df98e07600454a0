"""Stage between comparing and writing: from where along each best route a haven is reached in time.

A plane's times differ a little from true ones, as its point scale does along a way. The limits are
therefore lowered so far that all ways keep them in true time.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import shapely

import renew
from pipeline.errors import RequestError
from pipeline.findings.result import RunResult, addressed
from pipeline.findings.text import hours, planner_text, season_text
from pipeline.machine.interpreters import cores
from pipeline.machine.store import Artefact, Store, artefact_key
from pipeline.model import HavenLimits, Note, Place, Say, Scene, plan_options
from pipeline.scenario.model import Scenario
from pipeline.sources.land.vector import HavenPoint, read_havens
from pipeline.stages.seasons.one_season import MIN_LATENESS_S


def havens_in(scenario: Scenario, scene: Scene) -> tuple[tuple[renew.Haven, ...], tuple[Note, ...]]:
    """Return the scenario's havens that lie in the water of a scene, and notes on the others.

    Raises
    ------
    RequestError
        The file can't be read, or none of its havens lies in the water; all are named.
    """
    if scenario.havens is None:
        return (), ()
    found, left_out = list[renew.Haven](), list[Note]()
    for one in read_havens(Path(scenario.havens.path)):
        reason = _misplaced(scenario, scene, one)
        if reason:
            place = Place(one.lon, one.lat)
            left_out.append(Note.of("haven-left-out", haven=one.name, place=place, reason=reason))
        else:
            found.append(renew.Haven(one.name, scene.projection.to_plane((one.lon, one.lat))))
    if not found:
        names = [f"{dict(note.values)['haven']} {dict(note.values)['reason']}" for note in left_out]
        raise RequestError(f"havens.path: no haven can be used: {'; '.join(names)}")
    return tuple(found), tuple(left_out)


def _misplaced(scenario: Scenario, scene: Scene, haven: HavenPoint) -> str:
    """Say why a haven does not lie in the water of a scene; "" if it does."""
    area, here = scenario.area, shapely.Point(haven.lon, haven.lat)
    west, _, east, _ = area.bounds
    turns = round((haven.lon - (west + east) / 2) / 360)
    if not area.covers(shapely.Point(haven.lon - 360 * turns, haven.lat)):
        return "lies outside the region; widen the region, or leave it out"
    chart = scene.chart
    here = shapely.Point(scene.projection.to_plane((haven.lon, haven.lat)))
    if chart.water.covers(here):
        return ""
    line = shapely.get_coordinates(shapely.shortest_line(here, chart.water))
    metres = scene.projection.geodesic_length_m(line)
    obstacle = "land or water too shallow for the vessel" if scenario.chart.depths else "land"
    return (
        f"lies on {obstacle} or within the margin around it, {metres:.0f} m from the nearest "
        f"water at {scene.place_text(line[-1])}; move it there"
    )


def cover(result: Artefact[RunResult], store: Store, say: Say) -> Artefact[RunResult]:
    """Return a result with the coverage of each season's best route by havens, and its notes.

    Raises
    ------
    RequestError
        The endurance is below a route's own time; all seasons are named.
    """
    run = result.value
    spec, scene = run.scenario.havens, run.scene
    if spec is None:
        return result
    havens, notes = havens_in(run.scenario, scene)
    limited = limits_of(run.scenario, havens)
    best = {one.season: one for one in run.routes if one.rank == 1}
    faults = [
        f"havens.endurance = {spec.endurance!r} is below the {hours(one.metrics.duration_s)} that "
        f"the best route of {season_text(season)} takes; give more"
        for season, one in best.items()
        if spec.endurance_s is not None and spec.endurance_s < one.metrics.duration_s
    ]
    if faults:
        raise RequestError(faults)
    places = [(haven.name, *haven.place.tolist()) for haven in havens]
    limits = spec.model_dump(mode="json", exclude={"path"})

    def covered(season: str) -> renew.Coverage:
        key = artefact_key("cover", result.key, season, places, limits)
        make = partial(_covered, run, season, limited)
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


def limits_of(scenario: Scenario, havens: Sequence[renew.Haven]) -> HavenLimits:
    """Return a scenario's limits on the way to havens; none if it has no havens."""
    spec = scenario.havens
    if spec is None:
        return HavenLimits((), None, None)
    return HavenLimits(tuple(havens), spec.within_s, spec.endurance_s)


def _covered(run: RunResult, season: str, limited: HavenLimits) -> renew.Coverage:
    """Return the coverage of a season's best route, with the ways that it needs."""
    scene = run.scene.leg(season)
    within, endurance = limited.in_plane(scene, season)
    best, *others = run.season_routes(season)
    sides = {one.metrics.main_passage: one for one in reversed(others)}
    sides.pop(best.metrics.main_passage, None)
    ranks = {} if len(scene.via) else {one.route: one.rank for one in sides.values()}
    coverage = renew.cover(
        best.route,
        scene.chart,
        scene.currents[season],
        scene.vessel_in(season),
        limited.havens,
        within=within,
        endurance=endurance,
        others=tuple(ranks),
        options=plan_options(run.scenario.planner, min_lateness=MIN_LATENESS_S),
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
    """Yield notes on each season's coverage, and on havens to which no way was found."""
    for season, coverage in run.coverages.items():
        yield Note.of(
            "coverage",
            covered=coverage.share("covered"),
            uncovered=coverage.share("uncovered"),
            not_settled=coverage.share("not settled"),
        ).about(season)
        for haven, error in coverage.left_out:
            yield Note.of(
                "haven-left-out",
                haven=haven.name,
                place=run.scene.place(np.asarray(haven.place)),
                reason=f"is not used: {planner_text(error.text, run.scene, season)}",
            ).about(season)
