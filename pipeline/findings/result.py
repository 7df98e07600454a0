"""The finished run, as all formats read it, and what is not known about it."""

import contextlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from typing import Any

import numpy as np
import shapely

import renew
from pipeline import model
from pipeline._types import FloatArray, Geometries
from pipeline.errors import RequestError
from pipeline.findings.text import capitalised, gap_figure, planner_text, season_name
from pipeline.findings.unknowns import NO_SHARE, crossing_notes, route_notes, strait_notes
from pipeline.geo.projection import MAX_EDGE_M
from pipeline.model.inputs import NOT_KNOWN, Note, of_seasons
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import Season

MAX_STRAITS = 10
"""Largest number of straits that are listed, the widest first."""


@dataclass(frozen=True)
class RankedRoute:
    """A route with its metrics; `rank` 1 is the season's best. A way to a haven has a `label`."""

    season: str
    rank: int
    route: renew.Route
    metrics: model.RouteMetrics
    label: str = ""


@dataclass(frozen=True)
class RunResult:
    """All artefacts of a run; `created` is the time of writing (UTC), `timings` are in seconds.

    The scenario is complete: `choices` say what was chosen for the parts that the request left
    open; they are among the notes of `fetched`, too. `straits` are the shut straits, the widest
    first. `departures` are the choices of when to leave, for the seasons that leave it open.
    `coverages` say from where along each season's best route a haven is reached, if any are given.
    `side_bounds` waits for the bounds of seasons whose routes differ in their side, which are still
    being computed while files that don't show them are written.
    `kept` is what several output files need and is computed once, such as waypoints.
    """

    scenario: Scenario
    fetched: model.Fetched
    simplified: model.Simplified
    scene: model.Scene
    plans: tuple[model.SeasonPlan, ...]
    evaluation: model.Evaluation
    timings: Mapping[str, float]
    created: datetime
    choices: tuple[model.Note, ...] = ()
    straits: tuple[model.ShutStrait, ...] = ()
    departures: tuple[model.DepartureChoice, ...] = ()
    coverages: Mapping[str, renew.Coverage] = field(default_factory=dict)
    side_bounds: Callable[[], tuple[model.SideBound, ...]] = tuple
    kept: dict[str, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    @cached_property
    def routes(self) -> tuple[RankedRoute, ...]:
        """Every planned route with its metrics, by season in the plans' order, then by rank.

        The evaluation sets the ranks: a plan is sorted by fuel, but the sampled method may choose
        another route than the first.
        """
        ranked = []
        for entry in self.plans:
            if entry.plan is None:
                continue
            routes = {(route.homotopy, route.fuel): route for route in entry.plan.routes}
            rows = (row for row in self.evaluation.routes if row.season == entry.season)
            ranked += [
                RankedRoute(entry.season, row.rank, routes[row.homotopy, row.fuel], row)
                for row in sorted(rows, key=lambda row: row.rank)
            ]
        return tuple(ranked)

    @cached_property
    def unknowns(self) -> tuple[model.Note, ...]:
        """Notes on what is not known about the routes; they are among all notes, too.

        There are none in a planar scenario.
        """
        if self.scenario.is_planar:
            return ()
        rows = self.evaluation.routes
        seasons = dict.fromkeys(row.season for row in rows)
        by_season = {
            season: route_notes([row for row in rows if row.season == season]) for season in seasons
        }
        found = (
            *_of_currents(self, seasons),
            *crossing_notes(self.evaluation.shore_crossings, self.scenario.chart),
            *_of_chart(self),
            *of_seasons(by_season),
            *strait_notes(self.straits),
        )
        said = (note for note in self.fetched.notes if note.kind in NOT_KNOWN)
        return (*addressed(found, self.scenario), *said)

    @cached_property
    def decisions(self) -> tuple[model.Note, ...]:
        """Notes on each season's current, and on what a name, an order or a default decided."""
        used = {
            grid.season: [Note.of("current-used", source=grid.credit.name, valid=grid.valid)]
            for grid in self.fetched.currents
            if not grid.is_stand_in and not grid.is_left_out
        }
        decided = (note for note in self.fetched.notes if note.is_decision)
        return (*addressed(of_seasons(used), self.scenario), *decided)

    def departure_choice(self, season: str) -> model.DepartureChoice | None:
        """Return when to leave in a season, and alternatives; None if the departure was given."""
        return next((one for one in self.departures if one.season == season), None)

    def side_bound_of(self, season: str) -> model.SideBound | None:
        """Return the bound on the other sides of a season, if its routes differ in their side."""
        return next((bound for bound in self.side_bounds() if bound.season == season), None)

    def spec_of(self, season: str) -> Season:
        """Return a season as the scenario describes it."""
        return next(one for one in self.scenario.seasons if one.name == season)

    def plan_of(self, season: str) -> renew.Plan | None:
        """Return a season's plan; None if it could not be planned."""
        return next((entry.plan for entry in self.plans if entry.season == season), None)

    def grid_of(self, season: str) -> model.CurrentGrid | None:
        """Return a season's current on its source's grid; None for a formula, or if not found."""
        return next((grid for grid in self.fetched.currents if grid.season == season), None)

    def season_routes(self, season: str) -> tuple[RankedRoute, ...]:
        """Return one season's routes, best first; empty where the season could not be planned."""
        return tuple(ranked for ranked in self.routes if ranked.season == season)

    @property
    def credits(self) -> tuple[model.Credit, ...]:
        """All sources that were used, each source of currents once, land first."""
        currents = dict.fromkeys(grid.credit for grid in self.fetched.currents)
        return (*self.fetched.land.credits, *currents)

    @property
    def shoals(self) -> tuple[shapely.Geometry, ...]:
        """Water too shallow for the vessel, lon/lat degrees: no-go like land."""
        return tuple(zone.area for zone in self.fetched.land.zones if zone.kind == "shoal")

    @cached_property
    def land_label(self) -> str:
        """Name in legends for the land, which includes water that no chart covers."""
        return "land or uncharted" if self._zones_in_chart({"uncharted"}) else "land"

    @cached_property
    def drawn_land(self) -> Geometries:
        """Land in the plane as maps draw it: beyond the region, too, where it is known there."""
        around = np.array([*_projected(self.scene, self.fetched.surroundings)], dtype=object)
        return continued(np.array(self.scene.land, dtype=object), shapely.make_valid(around))

    @property
    def hazards(self) -> tuple[shapely.Geometry, ...]:
        """Rocks, wrecks, marks and the like with the room around them, lon/lat degrees: no-go."""
        return tuple(zone.area for zone in self.fetched.land.zones if zone.kind == "hazard")

    @cached_property
    def open_zones(self) -> tuple[tuple[model.Zone, shapely.Geometry], ...]:
        """The chart's restricted areas, traffic schemes and shut areas, with planar areas.

        Routes may pass through them.
        """
        return self._zones_in_chart({"restricted", "traffic", "shut"})

    def _zones_in_chart(self, kinds: set[str]) -> tuple[tuple[model.Zone, shapely.Geometry], ...]:
        """Return zones of some kinds that lie at least partly in the chart, with planar areas."""
        zones = [zone for zone in self.fetched.land.zones if zone.kind in kinds]
        areas = self.scene.projection.geometry_to_plane(
            np.array([zone.area for zone in zones], dtype=object), MAX_EDGE_M
        )
        inside = shapely.relate_pattern(areas, self.scene.chart.extent, "T********")
        return tuple(
            (zone, area)
            for zone, area, is_seen in zip(zones, areas, inside, strict=True)
            if is_seen
        )

    def is_stand_in(self, season: str) -> bool:
        """Whether the season's current is not the scenario's first choice."""
        grid = self.grid_of(season)
        return grid is not None and grid.is_stand_in

    def lacks_current(self, season: str) -> bool:
        """Whether the current on a season's best route is not known at all.

        It was left out, or its source has no values anywhere on the route.
        """
        grid = self.grid_of(season)
        best = next((row for row in self.evaluation.routes if row.season == season), None)
        if grid is None or best is None:
            return False
        return grid.is_left_out or best.filled_share >= 1 - NO_SHARE

    def gap_figure(self, row: model.RouteMetrics) -> str:
        """Return a route's gap for readers: none is proven where the current is not known."""
        return "not proven" if self.lacks_current(row.season) else gap_figure(row.optimality_gap)

    def crossings(self, season: str, rank: int) -> FloatArray:
        """Return middles (n, 2), lon/lat, of a route's parts over the second shoreline's land."""
        found = [
            (one.lon, one.lat)
            for one in self.evaluation.shore_crossings
            if (one.season, one.rank) == (season, rank)
        ]
        return np.array(found, dtype=float).reshape(-1, 2)

    def season_index(self, season: str) -> int:
        """Return position of a season among the scenario's, from 0; it sets the season's colour."""
        return [entry.season for entry in self.plans].index(season)

    def season_title(self, season: str) -> str:
        """Return the season's name for readers, with its title if that adds anything.

        A stand-in has no title: "July 2024" would be wrong for it.
        """
        name = capitalised(season_name(season))
        title = next((spec.title for spec in self.scenario.seasons if spec.name == season), "")
        if not title or self.is_stand_in(season):
            return name
        says_name = name != season.capitalize() or season in title.lower()
        return title if says_name else f"{name} ({title})"

    def valid_text(self, season: str) -> str:
        """Return the period that a season's current represents; empty if not stated."""
        grid = self.grid_of(season)
        if grid is None or not grid.valid:
            return ""
        shown = "; maps show it at departure" if grid.changes else ""
        return f"valid {self.period_text(season)}{shown}"

    def current_text(self, season: str) -> str:
        """Return which current a season was planned on: its source and period."""
        grid = self.grid_of(season)
        if grid is None:
            return "formula"
        return ", ".join(filter(None, (grid.credit.name, self.period_text(season))))

    def period_text(self, season: str) -> str:
        """Return dates of a season's current, "2024-01-03 to 2024-01-28"; empty if not stated."""
        grid = self.grid_of(season)
        return grid.valid.replace("/", " to ") if grid is not None else ""

    def rejection_reason(self, season: str, rejected: renew.Rejected) -> str:
        """Return why a class of a season has no route, as text for readers."""
        return planner_text(rejected.text, self.scene, season)

    def current_samples(self, season: str) -> tuple[FloatArray, FloatArray]:
        """Return points of a season's current, lon/lat degrees (n, 2), and its velocity (n, 2).

        A changing current is sampled at departure. Velocity is in m/s towards east and north. The
        points are those of the source's grid that have data, or 25 by 25 over the chart if there
        is no grid; none if the season has no current.
        """
        if (grid := self.grid_of(season)) is not None:
            lon, lat = np.meshgrid(grid.lon, grid.lat)
            u, v = grid.at_departure
            known = np.isfinite(u) & np.isfinite(v)
            return (
                np.stack([lon[known], lat[known]], axis=-1),
                np.stack([u[known], v[known]], axis=-1),
            )
        if season not in self.scene.currents:
            return np.empty((0, 2)), np.empty((0, 2))
        xmin, ymin, xmax, ymax = self.scene.chart.bounds
        x, y = np.meshgrid(np.linspace(xmin, xmax, 25), np.linspace(ymin, ymax, 25))
        points = np.stack([x.ravel(), y.ravel()], axis=-1)
        lonlat = self.scene.projection.to_lonlat(points)
        velocity = np.asarray(self.scene.currents[season](points), dtype=float)
        return lonlat, self.scene.projection.rotate_to_lonlat(lonlat, velocity)


def continued(land: Geometries, surroundings: Geometries) -> Geometries:
    """Join land with the land around it, so that no edge shows where one ends in the other."""
    if not len(surroundings):
        return land
    touched = np.unique(shapely.STRtree(land).query(surroundings, predicate="intersects")[1])
    joined = shapely.disjoint_subset_union_all(np.concatenate([land[touched], surroundings]))
    return np.concatenate([np.delete(land, touched), shapely.get_parts(joined)])


def _projected(
    scene: model.Scene, polygons: Sequence[shapely.Polygon]
) -> Iterator[shapely.Polygon]:
    """Yield polygons in the plane; skip those that the plane can't hold, such as around a pole."""
    for polygon in polygons:
        with contextlib.suppress(RequestError):
            yield scene.projection.geometry_to_plane(polygon)


def addressed(notes: Iterable[Note], scenario: Scenario) -> tuple[Note, ...]:
    """Return notes that name their seasons only where the scenario has several."""
    if len(scenario.seasons) > 1:
        return tuple(notes)
    return tuple(note.about() for note in notes)


def route_caveats(result: RunResult, metrics: model.RouteMetrics) -> tuple[Note, ...]:
    """Note how one route is not safe, what is not known about it, and what was decided for it."""
    season, found = metrics.season, result.decisions
    decided = (note.about() for note in found if not note.seasons or season in note.seasons)
    return (*unsafe_notes(result, metrics), *route_unknowns(result, metrics), *decided)


def unsafe_notes(result: RunResult, metrics: model.RouteMetrics) -> Iterator[Note]:
    """Yield a note if a hard-over turn along a route meets no-go, with the first place."""
    if metrics.collisions:
        turns = result.evaluation.contingency[metrics.season, metrics.rank]
        first = np.asarray(turns.points)[np.asarray(turns.collided)][0]
        yield Note.of(
            "not-safe-everywhere",
            collisions=metrics.collisions,
            turns=metrics.trials,
            no_go=metrics.no_go_name,
            rank=metrics.rank,
            place=result.scene.place(first),
            padding=result.scenario.planner.padding,
        )


def route_unknowns(result: RunResult, metrics: model.RouteMetrics) -> tuple[Note, ...]:
    """Note what is not known about one route."""
    if result.scenario.is_planar:
        return ()
    crossings = [
        one
        for one in result.evaluation.shore_crossings
        if (one.season, one.rank) == (metrics.season, metrics.rank)
    ]
    of_season = (
        *_of_currents(result, [metrics.season]),
        *crossing_notes(crossings, result.scenario.chart),
    )
    said = (
        note
        for note in result.fetched.notes
        if note.kind in NOT_KNOWN and (not note.seasons or metrics.season in note.seasons)
    )
    return (
        *(note.about() for note in (*of_season, *said)),
        *_of_chart(result),
        *route_notes([metrics]),
    )


def _of_currents(result: RunResult, seasons: Collection[str]) -> Iterator[Note]:
    """Yield a note on each season whose current is not known at all."""
    for grid in result.fetched.currents:
        if grid.season in seasons and result.lacks_current(grid.season):
            yield Note.of("current-unknown", left_out=grid.is_left_out).about(grid.season)


def _of_chart(result: RunResult) -> Iterator[Note]:
    """Yield a note if the chart has no depths."""
    if result.fetched.land.depths is None:
        yield Note.of("no-depths")
