"""Sixth stage: compare the routes of all seasons, and name the way that each takes."""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial

import numpy as np
import shapely

import renew
from pipeline.errors import LateFaults
from pipeline.findings.departures_and_speeds import speed_notes
from pipeline.findings.ensembles import ensemble_notes
from pipeline.findings.other_ways import shut_straits, side_bounds
from pipeline.findings.result import RunResult, addressed, unsafe_notes
from pipeline.findings.under_way import replanned_notes
from pipeline.findings.way_names import with_way_names
from pipeline.geo.lonlat import METRES_PER_DEGREE, KnownCells, share_without
from pipeline.machine.store import Artefact, Store, artefact_key
from pipeline.model import CurrentGrid, Note, Place, Say, Scene, SeasonPlan, SideBound
from pipeline.sources.cf.fields import WEAK_SHARE
from pipeline.stages.choose import narrows_notes, room_notes
from pipeline.stages.choosing.chosen import Chosen, in_thread
from pipeline.stages.places import shut_notes
from pipeline.stages.plan import Planned
from pipeline.stages.simplify import SimplifiedLand
from pipeline.stages.tides import tide_notes


def compare(
    chosen: Chosen,
    land: Artefact[SimplifiedLand],
    planned: Artefact[Planned],
    store: Store,
    say: Say,
    late: LateFaults,
) -> Artefact[RunResult]:
    """Name each route's way, and find the straits that are shut; what fails is left out.

    Returns the result with its notes on choices, data, land and routes.
    """
    options, scene = chosen.scenario.planner, chosen.scene.value
    plans, inputs = planned.value.plans, (planned.key, chosen.scene.key)
    unnamed, places = planned.value.evaluation, chosen.data.fetched.land.places
    name = partial(with_way_names, unnamed, scene, plans, places)
    named = late.attempt("naming the ways", name, unnamed)
    found = partial(shut_straits, scene, land.value.simplified, plans, options)
    find = partial(store.artefact, "straits", tuple, inputs, found)
    straits = late.attempt("the search for shut straits", lambda: in_thread(find).value, ())
    result = RunResult(
        chosen.scenario,
        chosen.data.fetched,
        land.value.simplified,
        scene,
        plans,
        named,
        {},
        datetime.now(UTC),
        chosen.notes,
        straits,
        chosen.choices,
    )
    said = late.attempt("what is said of the result", partial(_said, result), ())
    result = replace(result, choices=addressed((*chosen.notes, *said), result.scenario))
    notes = (*said, *late.attempt("notes on the routes", partial(_notes, result), ()))
    for note in notes:
        say(note)
    every = (*chosen.notes, *chosen.data.fetched.notes, *land.value.notes, *notes)
    fetched = replace(chosen.data.fetched, notes=addressed(every, result.scenario))
    return Artefact(artefact_key("compare", *inputs), replace(result, fetched=fetched))


def bounds_of_sides(result: Artefact[RunResult], store: Store) -> tuple[SideBound, ...]:
    """Bound the fuel of ways on the other sides; this takes long, and only reports show it."""
    run, options = result.value, result.value.scenario.planner
    bounds = partial(side_bounds, run.scene, run.plans, run.evaluation, options)
    return store.artefact("sides", tuple, (result.key, options.drift), bounds).value


def _said(result: RunResult) -> tuple[Note, ...]:
    """Return the notes on speeds, members, a voyage planned again, and room for turns."""
    return (
        *speed_notes(result),
        *replanned_notes(result),
        *ensemble_notes(result),
        *room_notes(result.scene, result.plans, result.scenario.planner),
        *narrows_notes(result.scene, result.plans, result.scenario.planner),
    )


def _notes(result: RunResult) -> tuple[Note, ...]:
    """Return the notes on the routes and on unknowns."""
    return (
        *safety_notes(result),
        *shut_notes(result.scene, result.plans),
        *tide_notes(result.scenario, result.scene, result.plans),
        *waiting_notes(result.scene, result.plans),
        *unresolved_strait_notes(result),
        *weak_stream_notes(result),
        *result.unknowns,
    )


def safety_notes(result: RunResult) -> Iterator[Note]:
    """Yield a note for each season whose best route has a hard-over turn that meets no-go."""
    for row in result.evaluation.routes:
        if row.rank == 1:
            yield from (note.about(row.season) for note in unsafe_notes(result, row))


# Minimum number of cells across a strait for the grid to resolve its tide.
_MIN_CELLS = 2.0
# A point within this distance of a coast counts as on it, planar metres.
_ON_COAST = 1e-6


def waiting_notes(scene: Scene, plans: Iterable[SeasonPlan]) -> Iterator[Note]:
    """Yield notes on the hours when the current blocks ways of routes or of rejected classes."""
    for plan in plans:
        routes = {f"route {rank}": one for rank, one in enumerate(plan.ranked_routes, start=1)}
        rejected = plan.plan.rejected if plan.plan else ()
        classes = {f"class {one.homotopy}": one for one in rejected}
        for kind, ways in (("routes-shut-for-hours", routes), ("classes-shut-for-hours", classes)):
            shut = tuple(
                Note.of("way-shut", way=name, places=_places(one.overpowered, scene, plan.season))
                for name, one in ways.items()
                if one.overpowered
            )
            if shut:
                yield Note.of(kind, ways=shut).about(plan.season)


def _places(hours: Iterable[renew.OverpoweredHours], scene: Scene, season: str) -> tuple[Note, ...]:
    """Return the places where the current blocks a way, each with its hours."""
    return tuple(
        Note.of(
            "place-shut",
            place=scene.place(one.place),
            begin=scene.moment(season, one.begin),
            until=scene.moment(season, one.end),
        )
        for one in hours
    )


def unresolved_strait_notes(result: RunResult) -> Iterator[Note]:
    """Yield a note for each season's best route on the worst strait with an unresolved tide."""
    for grid in result.fetched.currents:
        if not grid.changes:
            continue
        for best in result.season_routes(grid.season)[:1]:
            straits = [
                (width_m * _MIN_CELLS / cell, width_m, cell, middle)
                for width_m, middle in straits_of(best.route, result.scene)
                if (cell := _cell_m(grid, middle[1])) * _MIN_CELLS > width_m
            ]
            if straits:
                _, width_m, cell, middle = min(straits, key=lambda one: one[0])
                yield Note.of(
                    "strait-unresolved", place=Place(*middle), width_m=width_m, cell_m=cell
                ).about(grid.season)


def weak_stream_notes(result: RunResult) -> Iterator[Note]:
    """Yield a note for each season on its routes' shares with unreliable tidal constants."""
    for grid in result.fetched.currents:
        if grid.weak is None or not grid.weak.any():
            continue
        strong = KnownCells(grid.lon, grid.lat, ~grid.weak)
        found = [
            (one.rank, share_without(one.route.path, result.scene.projection, strong.at))
            for one in result.season_routes(grid.season)
        ]
        if shares := tuple((rank, share) for rank, share in found if share > 0):
            note = Note.of("streams-weak", limit=WEAK_SHARE, first=found[0][0], shares=shares)
            yield note.about(grid.season)


def straits_of(route: renew.Route, scene: Scene) -> Iterator[tuple[float, tuple[float, float]]]:
    """Yield the straits on a route: true width (m), and the middle (lon, lat), degrees.

    A strait is a triangle's side that the route crosses and that joins two islands.
    """
    if not scene.chart.no_go:
        return
    coasts = shapely.STRtree(scene.chart.no_go)
    channel = route.channel
    for here, ahead in itertools.pairwise(channel):
        side = here[(here[:, None] == ahead[None]).all(axis=-1).any(axis=1)]
        if len(side) != 2:
            continue
        end, coast = coasts.query(shapely.points(side), predicate="dwithin", distance=_ON_COAST)
        one, other = (set(coast[end == i].tolist()) for i in (0, 1))
        if one and other and not one & other:
            lon, lat = scene.projection.to_lonlat(side.mean(axis=0)).tolist()
            yield scene.projection.geodesic_length_m(side), (lon, lat)


def _cell_m(grid: CurrentGrid, lat: float) -> float:
    """Return the longer side of a cell at a latitude, true metres."""
    across = float(np.median(np.diff(grid.lon)) * np.cos(np.radians(lat)))
    return max(across, float(np.median(np.diff(grid.lat)))) * METRES_PER_DEGREE
