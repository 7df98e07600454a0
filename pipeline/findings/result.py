"""A finished run and its cases, as all formats read them, and notes on what is not known."""

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property, partial, wraps
from typing import Any, Literal, TypeVar

import numpy as np
import shapely

import renew
from pipeline import model
from pipeline._types import FloatArray, Geometries
from pipeline.errors import RequestError
from pipeline.findings.names import safe_name
from pipeline.findings.text import capitalised, gap_figure, planner_text, season_name
from pipeline.geo.projection import MAX_EDGE_M
from pipeline.model import ShoreCrossing
from pipeline.model.inputs import NOT_KNOWN, Note, Place, of_cases
from pipeline.model.result import NumberedIsland
from pipeline.scenario.catalogue import has_world_land
from pipeline.scenario.model import Scenario
from pipeline.scenario.region import ChartSpec
from pipeline.scenario.season import Season, interval

_T = TypeVar("_T")
NO_SHARE = 5e-4
"""Shares of a route below this count as none: percentages have one decimal."""
# Crossings whose positions agree to this many decimals of a degree (100 m) are one place.
_SAME_PLACE = 3


def route_notes(rows: Sequence[model.RouteMetrics]) -> list[Note]:
    """Note for how much of a case's routes depths, or data of the current, are lacking."""
    notes = []
    for kind, name in (("current-filled", "filled_share"), ("depth-uncharted", "uncharted_share")):
        every = ((row.rank, getattr(row, name)) for row in rows)
        if shares := tuple(one for one in every if one[1] > NO_SHARE):
            notes.append(Note.of(kind, first=rows[0].rank, shares=shares))
    return notes


def strait_notes(straits: Sequence[model.ShutStrait]) -> Iterator[Note]:
    """Yield a note on the best way through shut straits, if one would be quicker."""
    way = [strait for strait in straits if strait.way == 1]
    if way:
        passed = (
            Note.of(
                "strait-shut",
                place=Place(one.lon, one.lat),
                beside=one.beside,
                width_m=one.width_m,
                needed_m=one.needed_m,
            )
            for one in way
        )
        yield Note.of("straits-shut", count=len(straits), saves=way[0].saves, straits=tuple(passed))


def crossing_notes(crossings: Sequence[ShoreCrossing], chart: ChartSpec) -> tuple[Note, ...]:
    """Return a note on the places where a case's routes cross the second shoreline, if any.

    Crossings of the best route come first; the longest come first within both groups.
    """
    kind = "second-shoreline" if has_world_land(chart) else "unlisted-land"
    return (Note.of(kind, crossings=_crossing_places(crossings)),) if crossings else ()


def _crossing_places(crossings: Sequence[ShoreCrossing]) -> tuple[Note, ...]:
    """Return the places, each with its longest crossing and all routes that cross."""
    there: dict[tuple[float, float], list[ShoreCrossing]] = {}
    for one in crossings:
        place = round(one.lon, _SAME_PLACE), round(one.lat, _SAME_PLACE)
        there.setdefault(place, []).append(one)
    places = [
        (min(one.rank for one in group) > 1, max(group, key=lambda one: one.length_m), group)
        for group in there.values()
    ]
    return tuple(
        Note.of(
            "crossing",
            length_m=longest.length_m,
            place=Place(longest.lon, longest.lat),
            routes=tuple(sorted({one.rank for one in group})),
        )
        for _, longest, group in sorted(places, key=lambda one: (one[0], -one[1].length_m))
    )


# Distance, planar metres, within which a point of a route lies on a stretch of it.
_ON_LINE = 1e-3
DEAR = 0.25
"""A route that needs more than this share more fuel than the best is folded where routes stand."""
MAX_STRAITS = 10
"""Largest number of straits that a report lists, those that save most first."""


@dataclass(frozen=True)
class RankedRoute:
    """A case's route with its metrics; `rank` 1 is the best. A way to a haven has a `label`."""

    case: "RunCase" = field(repr=False, compare=False)
    rank: int
    route: renew.Route
    metrics: model.RouteMetrics
    label: str = ""

    @property
    def season(self) -> str:
        """The case's name."""
        return self.case.name


@dataclass(frozen=True, eq=False)
class RunCase:
    """A case of a run: what was asked, its result, and what was found about it.

    `number` is its position among the run's, from 0; it sets its colour. `planned` is the case as
    it was planned; None where it has no current, so that it could not be.
    """

    run: "RunResult" = field(repr=False)
    number: int
    planned: model.Case | None = field(repr=False)

    @property
    def result(self) -> model.CaseResult:
        """What planning gave."""
        return self.run.results[self.number]

    @property
    def name(self) -> str:
        """Its name."""
        return self.result.name

    @property
    def stem(self) -> str:
        """The beginning of the names of its files."""
        return safe_name(f"{self.scenario.name}-{self.name}")

    @property
    def scenario(self) -> Scenario:
        """The run's complete scenario."""
        return self.run.scenario

    @property
    def case(self) -> model.Case:
        """The case as it was planned; ValueError where it has no current."""
        if self.planned is None:
            raise ValueError(f"{self.name}: {self.result.failure}")
        return self.planned

    @property
    def plan(self) -> renew.Plan | None:
        """The plan; None if there is none."""
        return self.result.plan

    @property
    def measures(self) -> model.Measures:
        """The figures of its routes."""
        return self.result.measures

    @property
    def spec(self) -> Season:
        """The case as the scenario describes it."""
        return self.scenario.seasons[self.number]

    @cached_property
    def routes(self) -> tuple[RankedRoute, ...]:
        """The routes with their metrics, best first; empty if it could not be planned."""
        return tuple(
            RankedRoute(self, row.rank, self.result.routes[row.rank - 1], row)
            for row in self.measures.routes
        )

    @property
    def grid(self) -> model.CurrentGrid | None:
        """The current on its source's grid; None for a formula, or if not found."""
        return next((one for one in self.run.fetched.currents if one.case == self.name), None)

    @property
    def source_grid(self) -> model.CurrentGrid:
        """The current on its source's grid; ValueError where there is none."""
        if self.grid is None:
            raise ValueError(f"the current of {self.name} has no grid")
        return self.grid

    @property
    def departure_choice(self) -> model.DepartureChoice | None:
        """When to leave, and alternatives; None if the departure was given."""
        return next((one for one in self.run.departures if one.season == self.name), None)

    @property
    def coverage(self) -> renew.Coverage | None:
        """From where along the best route a haven is reached; None without havens."""
        return self.run.coverages.get(self.name)

    @property
    def is_stand_in(self) -> bool:
        """Whether the current is not the scenario's first choice."""
        return self.grid is not None and self.grid.is_stand_in

    @property
    def lacks_current(self) -> bool:
        """Whether the current on the best route is not known at all.

        It was left out, or its source has no values anywhere on the route.
        """
        grid, rows = self.grid, self.measures.routes
        if grid is None or not rows:
            return False
        return grid.is_left_out or rows[0].filled_share >= 1 - NO_SHARE

    def is_dear(self, row: model.RouteMetrics) -> bool:
        """Whether a route needs so much more fuel than the first that it is folded."""
        return row.fuel > (1 + DEAR) * self.routes[0].metrics.fuel

    @property
    def followed(self) -> list[RankedRoute]:
        """The routes that one may follow: the first on each side, and those that are not dear."""
        first = {one.metrics.main_passage: one for one in reversed(self.routes)}.values()
        ranks = {one.rank for one in first}
        return [one for one in self.routes if one.rank in ranks or not self.is_dear(one.metrics)]

    def gap_figure(self, row: model.RouteMetrics) -> str:
        """Return a route's gap for readers: none is proven where the current is not known."""
        gap = self.proven_gap(row)
        return "not proven" if gap is None else gap_figure(gap)

    def proven_gap(self, row: model.RouteMetrics) -> float | None:
        """Return a route's optimality gap; None where the current is not known."""
        return None if self.lacks_current else row.optimality_gap

    def narrow(self, rank: int) -> tuple[model.NarrowStretch, ...]:
        """Return the stretches of a route without room for a hard-over turn."""
        return tuple(one for one in self.measures.narrow if one.rank == rank)

    def marked(self, rank: int) -> dict[str, list[FloatArray]]:
        """Return the stretches (n, 2), m, of a route that maps mark, by their colour's role."""
        return {
            "adrift": [line for line, _ in self.adrift(rank)],
            "narrow": [one.line for one in self.narrow(rank)],
        }

    def adrift(self, rank: int, hours: Sequence[int] = (6,)) -> Iterator[tuple[FloatArray, int]]:
        """Yield parts (n, 2), m, of a route from which a vessel adrift is ashore within hours.

        Each comes with the least of the ascending hours; parts for which all are too few are left
        out. A part between two stations counts as the worse of them.
        """
        for found in self.measures.adrift[rank - 1 :][:1]:
            seconds = found.seconds * self.run.water.projection.scale
            least = np.minimum(seconds[:-1], seconds[1:])
            band = np.searchsorted(np.array(hours) * 3600.0, least)
            begin = np.flatnonzero(np.diff(band, prepend=-1))
            for first, last in zip(begin, [*begin[1:], len(band)], strict=True):
                if band[first] < len(hours):
                    yield found.points[first : last + 1], hours[band[first]]

    def crossings(self, rank: int) -> FloatArray:
        """Return middles (n, 2), lon/lat, of a route's parts over the second shoreline's land."""
        places = [(one.lon, one.lat) for one in self.measures.shore_crossings if one.rank == rank]
        return np.array(places, dtype=float).reshape(-1, 2)

    @property
    def title(self) -> str:
        """Its name for readers, with the title in the scenario if that adds anything.

        A stand-in has no title: "July 2024" would be wrong for it.
        """
        name, title = capitalised(season_name(self.name)), self.spec.title
        if not title or self.is_stand_in:
            return name
        says_name = name != self.name.capitalize() or self.name in title.lower()
        return title if says_name else f"{name} ({title})"

    @property
    def valid_text(self) -> str:
        """The period that the current represents; empty if not stated."""
        if self.grid is None or not self.grid.valid:
            return ""
        shown = "; maps show it at departure" if self.grid.changes else ""
        return f"valid {self.period_text}{shown}"

    @property
    def current_text(self) -> str:
        """Which current it was planned on: its source and period."""
        if self.grid is None:
            return "formula"
        return ", ".join(filter(None, (self.grid.credit.name, self.period_text)))

    @property
    def period_text(self) -> str:
        """Dates of the current, "2024-01-03 to 2024-01-28"; empty if not stated."""
        return self.grid.valid.replace("/", " to ") if self.grid is not None else ""

    def rejection_reason(self, rejected: renew.Rejected) -> str:
        """Return why a class has no route, as text for readers."""
        return planner_text(rejected.text, self.case)

    def current_samples(self) -> tuple[FloatArray, FloatArray]:
        """Return points of the current, lon/lat degrees (n, 2), and its velocity (n, 2).

        A changing current is sampled at departure. Velocity is in m/s towards east and north. The
        points are those of the source's grid that have data, or 25 by 25 over the chart if there
        is no grid; none if there is no current.
        """
        if (grid := self.grid) is not None:
            lon, lat = np.meshgrid(grid.lon, grid.lat)
            u, v = grid.at_departure
            known = np.isfinite(u) & np.isfinite(v)
            return (
                np.stack([lon[known], lat[known]], axis=-1),
                np.stack([u[known], v[known]], axis=-1),
            )
        if self.planned is None:
            return np.empty((0, 2)), np.empty((0, 2))
        xmin, ymin, xmax, ymax = self.planned.chart.bounds
        x, y = np.meshgrid(np.linspace(xmin, xmax, 25), np.linspace(ymin, ymax, 25))
        points = np.stack([x.ravel(), y.ravel()], axis=-1)
        projection = self.planned.projection
        lonlat = projection.to_lonlat(points)
        velocity = np.asarray(self.planned.current(points), dtype=float)
        return lonlat, projection.rotate_to_lonlat(lonlat, velocity)


@dataclass(frozen=True)
class RunResult:
    """A run: its scenario, data and cases; `created` is the time of writing (UTC).

    Attributes
    ----------
    scenario : complete; `choices` say what was chosen for the parts that the request left open;
        they are among the notes of `fetched`, too.
    planned : the cases that have a current, by name.
    results : of all cases, in the scenario's order.
    timings : s, by stage.
    islands, class_islands : the islands in the names of ways, the main island first; and other
        islands in the names of homotopy classes.
    straits : the shut straits, those first through which a way would be quicker.
    departures : the choices of when to leave, for the cases that leave it open.
    coverages : from where along each case's best route a haven is reached, if any are given.
    side_bounds : returns the bounds of cases whose routes differ in their side, by name. It may
        wait: they are computed while files that don't show them are written.
    kept : what `once_per_case` has computed.
    """

    scenario: Scenario
    fetched: model.Fetched
    simplified: model.SimplifiedLand
    water: model.Water
    planned: Mapping[str, model.Case]
    results: tuple[model.CaseResult, ...]
    timings: Mapping[str, float]
    created: datetime
    islands: tuple[NumberedIsland, ...] = ()
    class_islands: tuple[NumberedIsland, ...] = ()
    choices: tuple[model.Note, ...] = ()
    straits: tuple[model.ShutStrait, ...] = ()
    departures: tuple[model.DepartureChoice, ...] = ()
    coverages: Mapping[str, renew.Coverage] = field(default_factory=dict)
    side_bounds: Callable[[], Mapping[str, float]] = dict
    kept: dict[tuple[str, str], Any] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def with_choices(self, notes: tuple[Note, ...]) -> "RunResult":
        """Return the run with more notes on what was chosen."""
        fetched = replace(self.fetched, notes=(*self.fetched.notes, *notes))
        return replace(self, fetched=fetched, choices=(*self.choices, *notes))

    @cached_property
    def cases(self) -> tuple[RunCase, ...]:
        """All cases, in the scenario's order."""
        return tuple(
            RunCase(self, number, self.planned.get(one.name))
            for number, one in enumerate(self.results)
        )

    def case(self, name: str) -> RunCase:
        """Return the case of a name."""
        return next(one for one in self.cases if one.name == name)

    @cached_property
    def stops(self) -> FloatArray:
        """The scenario's start, via points and goal, planar metres (n + 2, 2)."""
        return self.water.to_plane([*self.scenario.stops.values()])

    @property
    def routes(self) -> tuple[RankedRoute, ...]:
        """Every planned route with its metrics, by case, then by rank."""
        return tuple(route for case in self.cases for route in case.routes)

    @cached_property
    def unknowns(self) -> tuple[model.Note, ...]:
        """Notes on what is not known about the routes; they are among all notes, too.

        There are none in a planar scenario.
        """
        if self.scenario.is_planar:
            return ()
        planned = [case for case in self.cases if case.measures.routes]
        found = (
            *_of_currents(planned),
            *of_cases(
                {
                    case.name: crossing_notes(case.measures.shore_crossings, self.scenario.chart)
                    for case in planned
                }
            ),
            *_of_chart(self),
            *of_cases({case.name: route_notes(case.measures.routes) for case in planned}),
            *strait_notes(self.straits),
        )
        said = (note for note in self.fetched.notes if note.kind in NOT_KNOWN)
        return (*addressed(found, self.scenario), *said)

    @cached_property
    def decisions(self) -> tuple[model.Note, ...]:
        """Notes on each case's current, and on what a name, an order or a default decided."""
        used = {
            grid.case: [Note.of("current-used", source=grid.credit.name, valid=grid.valid)]
            for grid in self.fetched.currents
            if not grid.is_stand_in and not grid.is_left_out
        }
        decided = (note for note in self.fetched.notes if note.is_decision)
        return (*addressed(of_cases(used), self.scenario), *decided)

    @property
    def narrow_notes(self) -> tuple[model.Note, ...]:
        """Notes on the stretches of the best routes without room for a hard-over turn."""
        return tuple(note for note in self.fetched.notes if note.kind == "narrow-stretch")

    @property
    def credits(self) -> tuple[model.Credit, ...]:
        """All sources that were used, each once, land first."""
        currents = (grid.credit for grid in self.fetched.currents)
        weather = self.fetched.weather_credits
        return (*self.fetched.land.credits, *dict.fromkeys([*currents, *weather]))

    def no_go_water(self, kind: Literal["shoal", "hazard"]) -> list[shapely.Geometry]:
        """Return water too shallow for the vessel, or dangers with room around, lon/lat degrees."""
        return [zone.area for zone in self.fetched.land.zones if zone.kind == kind]

    @cached_property
    def land_label(self) -> str:
        """Name in legends for the land, which includes water that no chart covers."""
        return "land or uncharted" if self._zones_in_chart({"uncharted"}) else "land"

    @cached_property
    def drawn_land(self) -> Geometries:
        """Land in the plane as maps draw it: beyond the region, too, where it is known there."""
        around = np.array([*_projected(self.water, self.fetched.surroundings)], dtype=object)
        return continued(np.array(self.water.land, dtype=object), shapely.make_valid(around))

    @cached_property
    def open_zones(self) -> tuple[tuple[model.Zone, shapely.Geometry], ...]:
        """The chart's restricted areas, traffic schemes and shut areas, with planar areas.

        Routes may pass through them.
        """
        return self._zones_in_chart({"restricted", "traffic", "shut"})

    def _zones_in_chart(self, kinds: set[str]) -> tuple[tuple[model.Zone, shapely.Geometry], ...]:
        """Return zones of some kinds that lie at least partly in the chart, with planar areas."""
        zones = [zone for zone in self.fetched.land.zones if zone.kind in kinds]
        areas = self.water.projection.geometry_to_plane(
            np.array([zone.area for zone in zones], dtype=object), MAX_EDGE_M
        )
        inside = shapely.relate_pattern(areas, self.water.chart.extent, "T********")
        return tuple(
            (zone, area)
            for zone, area, is_seen in zip(zones, areas, inside, strict=True)
            if is_seen
        )


def continued(land: Geometries, surroundings: Geometries) -> Geometries:
    """Join land with the land around it, so that no edge shows where one ends in the other."""
    if not len(surroundings):
        return land
    touched = np.unique(shapely.STRtree(land).query(surroundings, predicate="intersects")[1])
    joined = shapely.disjoint_subset_union_all(np.concatenate([land[touched], surroundings]))
    return np.concatenate([np.delete(land, touched), shapely.get_parts(joined)])


def _projected(
    water: model.Water, polygons: Sequence[shapely.Polygon]
) -> Iterator[shapely.Polygon]:
    """Yield polygons in the plane; skip those that the plane can't hold, such as around a pole."""
    for polygon in polygons:
        with contextlib.suppress(RequestError):
            yield water.projection.geometry_to_plane(polygon)


def once_per_case(make: Callable[[RunCase], _T]) -> Callable[[RunCase], _T]:
    """Keep in a run what is made of each case, as several output files need it."""

    @wraps(make)
    def made(case: RunCase) -> _T:
        kept, key = case.run.kept, (make.__name__, case.name)
        if key not in kept:
            kept[key] = make(case)
        found: _T = kept[key]
        return found

    return made


def addressed(notes: Iterable[Note], scenario: Scenario) -> tuple[Note, ...]:
    """Return notes that name their cases only where the scenario has several."""
    if len(scenario.seasons) > 1:
        return tuple(notes)
    return tuple(note.about() for note in notes)


def route_caveats(ranked: RankedRoute) -> tuple[Note, ...]:
    """Note how one route is not safe, what is not known about it, and what was decided for it."""
    name, found = ranked.case.name, ranked.case.run.decisions
    decided = (note.about() for note in found if not note.cases or name in note.cases)
    return (*unsafe_notes(ranked), *route_unknowns(ranked), *decided)


def narrow_notes(ranked: RankedRoute) -> Iterator[Note]:
    """Yield a note on each stretch of a route without room for a hard-over turn."""
    if not ranked.metrics.trials:
        return  # a way to a haven, of which nothing is measured, has the number of a route
    metrics, case, place = ranked.metrics, ranked.case, ranked.case.run.water.place
    for one in case.narrow(ranked.rank):
        yield Note.of(
            "narrow-stretch",
            rank=one.rank,
            begin=place(one.line[0]),
            end=place(one.line[-1]),
            length_m=one.length_m,
            side=one.side,
            no_go=metrics.no_go_name,
            width_m=one.width_m,
            place=place(one.place),
            needed_m=one.needed_m,
            kept_m=one.kept_m,
        )


def adrift_notes(ranked: RankedRoute) -> Iterator[Note]:
    """Yield notes on how long a route is from land without thrust, and on the limit it keeps."""
    row, case = ranked.metrics, ranked.case
    asked = case.scenario.planner.adrift
    for found in case.measures.adrift[ranked.rank - 1 :][:1] if asked else ():
        scale = case.run.water.projection.scale
        both = found.ends_below(interval(asked or "").total_seconds() / scale)
        ends = tuple(
            (which, scale * far, scale * least)
            for which, (far, least) in zip(("first", "last"), both, strict=True)
        )
        yield Note.of("adrift-kept", asked=asked, ends=ends)
    if math.isfinite(row.adrift_s):
        yield Note.of(
            "adrift",
            least_s=row.adrift_s,
            place=Place(row.adrift_lon, row.adrift_lat),
            soon=row.adrift_share,
            ashore=row.ashore_share,
            carries="current and the wind carry" if case.case.leeway else "current carries",
        )


def weather_notes(ranked: RankedRoute) -> Iterator[Note]:
    """Yield a note on the highest waves, and one on the strongest wind, that a route meets."""
    row = partial(getattr, ranked.metrics)
    for name, of, unit, key in (("waves", "wave", "m", "m"), ("wind", "wind", "m/s", "m_s")):
        most, at, left = map(row, (f"worst_{of}_{key}", f"worst_{of}_at", f"{of}_headroom_{key}"))
        place = Place(row(f"worst_{of}_lon"), row(f"worst_{of}_lat"))
        if math.isfinite(most):
            yield Note.of(
                "worst-met", name=name, unit=unit, most=most, place=place, at=at, left=left
            )


def unsafe_notes(ranked: RankedRoute) -> Iterator[Note]:
    """Yield notes: stretches without room for a turn, too little energy, other turns into no-go."""
    yield from narrow_notes(ranked)
    energy = ranked.metrics.energy
    if energy is not None and ranked.metrics.left < 0:
        needs, has = (energy.units * one for one in (ranked.metrics.fuel, energy.on_board))
        yield Note.of("energy-short", rank=ranked.rank, needs=needs, has=has, unit=energy.unit)
    metrics, case, narrow = ranked.metrics, ranked.case, ranked.case.narrow(ranked.rank)
    if not metrics.collisions:
        return
    turns = case.measures.turns[metrics.rank - 1]
    met = np.asarray(turns.points)[np.asarray(turns.collided)]
    stretches = shapely.union_all([shapely.LineString(one.line) for one in narrow])
    met = met[~shapely.dwithin(shapely.points(met), stretches, _ON_LINE)]
    if len(met):
        yield Note.of(
            "not-safe-everywhere",
            collisions=metrics.collisions,
            turns=metrics.trials,
            no_go=metrics.no_go_name,
            rank=metrics.rank,
            place=case.run.water.place(met[0]),
            padding=case.scenario.planner.padding,
        )


def route_unknowns(ranked: RankedRoute) -> tuple[Note, ...]:
    """Note what is not known about one route."""
    case, rank = ranked.case, ranked.rank
    if case.scenario.is_planar:
        return ()
    crossings = [one for one in case.measures.shore_crossings if one.rank == rank]
    said = (
        note
        for note in case.run.fetched.notes
        if note.kind in NOT_KNOWN - {"energy-short", "narrow-stretch"}
        and (not note.cases or case.name in note.cases)
    )
    of_case = (*_of_currents([case]), *crossing_notes(crossings, case.scenario.chart))
    return (
        *(note.about() for note in (*of_case, *said)),
        *_of_chart(case.run),
        *route_notes([ranked.metrics]),
    )


def _of_currents(cases: Iterable[RunCase]) -> Iterator[Note]:
    """Yield a note on each case whose current is not known at all."""
    for case in cases:
        if case.grid is not None and case.lacks_current:
            yield Note.of("current-unknown", left_out=case.grid.is_left_out).about(case.name)


def _of_chart(result: RunResult) -> Iterator[Note]:
    """Yield a note if the chart has no depths."""
    if result.fetched.land.depths is None:
        yield Note.of("no-depths")
