"""Sixth stage: compare the routes of all cases, and name the way that each takes."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial

import numpy as np
import shapely

import renew
from pipeline.errors import Faults
from pipeline.findings.choices import ensemble_notes, replanned_notes, speed_notes
from pipeline.findings.other_ways import shut_straits, side_bound
from pipeline.findings.result import RunResult, addressed, adrift_notes, unsafe_notes, weather_notes
from pipeline.findings.way_names import way_names
from pipeline.geo.projection import METRES_PER_DEGREE, KnownCells, share_without
from pipeline.machine.interpreters import cores
from pipeline.machine.store import Artefact, Store, artefact_key
from pipeline.model import Case, CaseResult, CurrentGrid, Note, Place, Say, SimplifiedLand, Water
from pipeline.model.result import NumberedIsland
from pipeline.sources.cf.fields import WEAK_SHARE
from pipeline.stages.choose import Chosen, in_thread, narrows_notes, room_notes
from pipeline.stages.lanes import against_lanes
from pipeline.stages.limits import limit_notes
from pipeline.stages.places import shut_notes, tide_notes


def compare(
    chosen: Chosen,
    land: Artefact[SimplifiedLand],
    planned: Artefact[tuple[CaseResult, ...]],
    store: Store,
    say: Say,
    late: Faults,
) -> Artefact[RunResult]:
    """Name each route's way, and find the straits that are shut; what fails is left out.

    Returns the result with its notes on choices, data, land and routes.
    """
    scenario, fetched = chosen.scenario, chosen.fetched
    inputs, water = (planned.key, chosen.cases.key), chosen.cases.value[0].water
    results = planned.value
    islands = class_islands = tuple[NumberedIsland, ...]()
    with late.kept("naming the ways"):
        results, islands, class_islands = way_names(water, planned.value, fetched.land.places)
    cases = {case.name: case for case in chosen.cases.value}
    pairs = [(cases[one.name], one) for one in results if one.name in cases]
    result = RunResult(
        scenario,
        fetched,
        land.value,
        water,
        cases,
        results,
        {},
        datetime.now(UTC),
        islands,
        class_islands,
        departures=chosen.choices,
    )
    find = partial(shut_straits, pairs, scenario.planner, fetched.land.places)
    with late.kept("the search for shut straits"):
        straits = in_thread(partial(store.artefact, "straits", tuple, inputs, find))
        result = replace(result, straits=straits.value)
    said, about_routes = tuple[Note, ...](), tuple[Note, ...]()
    with late.kept("the notes on choices"):
        said = (
            *speed_notes(result),
            *replanned_notes(result),
            *ensemble_notes(result),
            *room_notes(water, results, scenario.planner),
            *narrows_notes(water, results, scenario.planner),
        )
    with late.kept("the notes on routes"):
        about_routes = _notes(result, pairs)
    notes = (*said, *about_routes)
    for note in notes:
        say(note)
    every = dict.fromkeys((*chosen.notes, *fetched.notes, *land.value.notes, *notes))
    complete = replace(
        result,
        choices=addressed((*chosen.notes, *said), scenario),
        fetched=replace(fetched, notes=addressed(every, scenario)),
    )
    return Artefact(artefact_key("compare", *inputs), complete)


def bounds_of_sides(result: Artefact[RunResult], store: Store, late: Faults) -> dict[str, float]:
    """Bound the fuel of ways on the other sides; this takes long, and only reports show it."""
    run, options = result.value, result.value.scenario.planner

    def bounds() -> dict[str, float]:
        planned = [case for case in run.cases if case.planned is not None]
        main = next(iter(run.islands), None)
        # Threads run in parallel here, because most of the work is compiled code.
        with ThreadPoolExecutor(max_workers=cores()) as pool:
            found = pool.map(lambda one: side_bound(one.case, one.result, main, options), planned)
            bound_of = {one.name: bound for one, bound in zip(planned, found, strict=True)}
        return {name: bound for name, bound in bound_of.items() if bound is not None}

    found: dict[str, float] = {}
    with late.kept("the bound on other sides"):
        found.update(store.artefact("sides", dict, (result.key, options.drift), bounds).value)
    return found


def _notes(result: RunResult, planned: Sequence[tuple[Case, CaseResult]]) -> tuple[Note, ...]:
    return (
        *safety_notes(result),
        *shut_notes(planned),
        *(
            Note.of("lane-kept", lane=lane).about(case.name)
            for case, found in planned
            for lane in found.kept_lanes
        ),
        *tide_notes(result.scenario.tide, planned),
        *limit_notes(result.scenario, planned),
        *waiting_notes(planned),
        *unresolved_strait_notes(result),
        *weak_stream_notes(result),
        *lanes_broken(result),
        *result.unknowns,
    )


def safety_notes(result: RunResult) -> Iterator[Note]:
    """Yield notes on room to turn, a vessel without thrust, and weather on the best routes."""
    for case in result.cases:
        for best in case.routes[:1]:
            for note in (*unsafe_notes(best), *adrift_notes(best), *weather_notes(best)):
                yield note.about(case.name)


def lanes_broken(result: RunResult) -> Iterator[Note]:
    """Yield a note for each traffic lane that a case's best route sails against."""
    for case in result.cases:
        for best in case.routes[:1]:
            line = result.water.projection.to_lonlat(best.route.path)
            for zone, length_m, place in against_lanes(line, result.fetched.land.zones):
                yield Note.of(
                    "against-lane", rank=best.rank, lane=zone.name, length_m=length_m, place=place
                ).about(case.name)


# Minimum number of cells across a strait for the grid to resolve its tide.
_MIN_CELLS = 2.0
# A point within this distance of a coast counts as on it, planar metres.
_ON_COAST = 1e-6


def waiting_notes(planned: Iterable[tuple[Case, CaseResult]]) -> Iterator[Note]:
    """Yield notes on the hours when the current blocks ways of routes or of rejected classes."""
    for case, result in planned:
        routes = {f"route {rank}": one for rank, one in enumerate(result.routes, start=1)}
        rejected = result.plan.rejected if result.plan else ()
        classes = {f"class {one.homotopy}": one for one in rejected}
        for kind, ways in (("routes-shut-for-hours", routes), ("classes-shut-for-hours", classes)):
            shut = tuple(
                Note.of("way-shut", way=name, places=_places(one.overpowered, case))
                for name, one in ways.items()
                if one.overpowered
            )
            if shut:
                yield Note.of(kind, ways=shut).about(case.name)


def _places(hours: Iterable[renew.OverpoweredHours], case: Case) -> tuple[Note, ...]:
    """Return the places where the current blocks a way, each with its hours."""
    return tuple(
        Note.of(
            "place-shut",
            place=case.water.place(one.place),
            begin=case.moment(one.begin),
            until=case.moment(one.end),
        )
        for one in hours
    )


def unresolved_strait_notes(result: RunResult) -> Iterator[Note]:
    """Yield a note for each case's best route on the worst strait with an unresolved tide."""
    for case in result.cases:
        grid = case.grid
        if grid is None or not grid.changes:
            continue
        for best in case.routes[:1]:
            straits = [
                (width_m * _MIN_CELLS / cell, width_m, cell, middle)
                for width_m, middle in straits_of(best.route, result.water)
                if (cell := _cell_m(grid, middle[1])) * _MIN_CELLS > width_m
            ]
            if straits:
                _, width_m, cell, middle = min(straits, key=lambda one: one[0])
                yield Note.of(
                    "strait-unresolved", place=Place(*middle), width_m=width_m, cell_m=cell
                ).about(case.name)


def weak_stream_notes(result: RunResult) -> Iterator[Note]:
    """Yield a note for each case on its routes' shares with unreliable tidal constants."""
    for case in result.cases:
        grid = case.grid
        if grid is None or grid.weak is None or not grid.weak.any():
            continue
        strong = KnownCells(grid.lon, grid.lat, ~grid.weak)
        found = [
            (one.rank, share_without(one.route.path, result.water.projection, strong.at))
            for one in case.routes
        ]
        if shares := tuple((rank, share) for rank, share in found if share > 0):
            note = Note.of("streams-weak", limit=WEAK_SHARE, first=found[0][0], shares=shares)
            yield note.about(case.name)


def straits_of(route: renew.Route, water: Water) -> Iterator[tuple[float, tuple[float, float]]]:
    """Yield the straits on a route: true width (m), and the middle (lon, lat), degrees.

    A strait is a triangle's side that the route crosses and that joins two islands.
    """
    if not water.chart.no_go:
        return
    coasts = shapely.STRtree(water.chart.no_go)
    channel = route.channel
    for here, ahead in itertools.pairwise(channel):
        side = here[(here[:, None] == ahead[None]).all(axis=-1).any(axis=1)]
        if len(side) != 2:
            continue
        end, coast = coasts.query(shapely.points(side), predicate="dwithin", distance=_ON_COAST)
        one, other = (set(coast[end == i].tolist()) for i in (0, 1))
        if one and other and not one & other:
            lon, lat = water.projection.to_lonlat(side.mean(axis=0)).tolist()
            yield water.width_m(side), (lon, lat)


def _cell_m(grid: CurrentGrid, lat: float) -> float:
    """Return the longer side of a cell at a latitude, true metres."""
    across = float(np.median(np.diff(grid.lon)) * np.cos(np.radians(lat)))
    return max(across, float(np.median(np.diff(grid.lat)))) * METRES_PER_DEGREE
