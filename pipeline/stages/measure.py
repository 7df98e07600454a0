"""Measure every route of a case against the original, unsimplified land.

A second, independent shoreline may have land where the chart has water. For the world's land that
is GSHHG, and a crossing is a reason to check an official chart. For files of the user's it is the
world's land: a file may hold some of the land only, so a plan is refused whose routes lie deeper in
it than both are accurate.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import timedelta

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.findings.text import distance
from pipeline.geo.lonlat import share_without
from pipeline.geo.projection import densified
from pipeline.model import (
    Case,
    CaseResult,
    EnsembleFigures,
    Measures,
    Place,
    RouteMetrics,
    ShoreCrossing,
    Water,
)
from pipeline.model.case import MIN_LATENESS_S, true_duration_s
from pipeline.scenario.model import PlannerOptions
from pipeline.sources.land.shapes import extract_polygons
from renew.inputs.options import MAX_STATIONS
from renew.turns.turn_reach import TurnReach
from renew.vary.statistics import STATISTICS

# Spacing of the points at which hard-over turns begin: at least this many planar metres, as
# published.
_MIN_SPACING = 1.0
# The spacing is at least this many turning radii, because nearer turns are almost the same.
_SPACING_RADII = 0.5
# Maximum number of points per route that are stored although no turn from them collides, evenly
# spaced; at true scale a route has 100,000 points.
_MAX_POINTS = 1000
# Length (true metres) of the pieces of a route whose distance from land is measured: the plane's
# scale is nearly constant across each.
_PIECE_M = 10_000.0
# Land within this multiple of the smallest distance is measured again along geodesics.
_NEARLY = 1.02
# Segments per quadrant of the buffer around routes.
_QUADRANT_SEGMENTS = 4
# Factor on the buffer's width that compensates for what 16-sided circles cut off (2 %), with a
# reserve.
_BUFFER_RESERVE = 1.1


def measured(case: Case, result: CaseResult, options: PlannerOptions) -> Measures:
    """Measure a case's routes, by rank; the result is empty if the case was not planned.

    In a changing current, the drift model determines the times along a route. Turns are simulated
    on time, and early and late by the share `lateness` of the time since departure.
    """
    routes = result.routes
    if not routes:
        return Measures()
    evaluator = _RouteEvaluator(case, routes, options)
    rows, flown = list[RouteMetrics](), list[renew.Contingency]()
    for rank, route in enumerate(routes, start=1):
        turns = evaluator.turns(route, in_members=rank == 1)
        flown.append(_sampled(turns))
        rows.append(evaluator.metrics(route, turns, rank))
    if result.ensemble is not None:
        rows = [_in_members(row, result.ensemble) for row in rows]
    return Measures(tuple(rows), tuple(flown), SecondShoreline(case.water).all_crossings(result))


def _in_members(row: RouteMetrics, found: EnsembleFigures) -> RouteMetrics:
    """Return a route's metrics with those over the members of its current."""
    known = (found.statistic(name, row.rank) for name in STATISTICS)
    mean, p90, cvar, regret = (one if math.isfinite(one) else math.nan for one in known)
    if not found.has_quantiles:
        p90 = cvar = math.nan
    return replace(
        row,
        members_share=found.share(row.rank),
        members_mean_fuel=mean,
        members_p90_fuel=p90,
        members_cvar90_fuel=cvar,
        members_regret=regret,
    )


class _RouteEvaluator:
    """Measures the routes of one case."""

    def __init__(self, case: Case, routes: Sequence[renew.Route], options: PlannerOptions) -> None:
        self._case, self._projection = case, case.projection
        self._members = case.members.currents if case.members else ()
        self._options = options
        self._land = np.array(case.water.land, dtype=object)
        self._tree = shapely.STRtree(self._land)
        self._near_land = land_within_reach(
            case.water, (case.current, *self._members), case.vessel, routes
        )

    def metrics(self, route: renew.Route, turns: renew.Contingency, rank: int) -> RouteMetrics:
        """Return all measurements of one route."""
        line = shapely.LineString(route.path)
        land_m, land_lon, land_lat = self._over_land(line)
        measured = RouteMetrics(
            rank=rank,
            homotopy=route.homotopy,
            fuel=route.fuel,
            fuel_per_distance=route.fuel_per_distance,
            length=route.length,
            length_m=self._projection.geodesic_length_m(route.path),
            clearance_m=self._clearance_m(line),
            duration_s=true_duration_s(route, self._case),
            speed_m_s=float(np.average(route.speeds, weights=np.diff(route.times))),
            optimality_gap=route.optimality_gap,
            trials=turns.trials,
            collisions=turns.collisions,
            land_m=land_m,
            land_lon=land_lon,
            land_lat=land_lat,
            filled_share=self._filled_share(route),
            uncharted_share=self._uncharted_share(route),
        )
        least, kept_m = route.least_water, self._case.under_keel_clearance_m
        if least is None or self._case.departure is None:
            return measured
        return replace(
            measured,
            least_water_m=least.spare + kept_m,
            least_water_at=self._case.departure + timedelta(seconds=round(least.time)),
            least_water_early_m=least.early + kept_m,
            least_water_late_m=least.late + kept_m,
        )

    def turns(self, route: renew.Route, *, in_members: bool) -> renew.Contingency:
        """Simulate the hard-over turns of a route against the original land within their reach.

        They are those in the case's current, and on request in each of its members as well.
        """
        first, *others = (
            self._turns(route, one)
            for one in (self._case.current, *(self._members if in_members else ()))
        )
        return replace(
            first,
            trials=first.trials + sum(one.trials for one in others),
            collisions=first.collisions + sum(one.collisions for one in others),
            collided=np.any([first.collided, *(one.collided for one in others)], axis=0),
        )

    def _turns(self, route: renew.Route, current: renew.CurrentField) -> renew.Contingency:
        """Simulate the hard-over turns of a route in a current."""
        vessel = self._case.vessel
        # Long routes have wider spacing, for at most MAX_STATIONS points, despite rounding.
        least = max(_MIN_SPACING, 1.000001 * route.length / MAX_STATIONS)
        return renew.contingency(
            route,
            self._near_land,
            current,
            vessel,
            spacing=max(least, _SPACING_RADII * vessel.turning_radius),
            seed=self._options.seed,
            drift=self._options.drift,
            lateness=self._options.lateness,
            min_lateness=MIN_LATENESS_S,
        )

    def _clearance_m(self, line: shapely.LineString) -> float:
        """Return true metres from a route to the nearest original land; inf if there is no land.

        The nearest land in the plane may not be the nearest on earth, because the plane's scale
        varies along the route. So all land within _NEARLY times the smallest distance is measured.
        """
        if not len(self._land):
            return math.inf
        projection = self._projection
        points = densified(shapely.get_coordinates(line), _PIECE_M / projection.scale)
        pieces = shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1))
        apart = self._tree.query_nearest(pieces, return_distance=True, all_matches=False)[1]
        true = apart / projection.point_scale(projection.to_lonlat((points[:-1] + points[1:]) / 2))
        near = true <= true.min() * _NEARLY
        piece, land = self._tree.query(
            pieces[near], predicate="dwithin", distance=apart[near] * _NEARLY
        )
        gaps = shapely.shortest_line(pieces[near][piece], self._land[land])
        return min(projection.geodesic_length_m(shapely.get_coordinates(gap)) for gap in gaps)

    def _filled_share(self, route: renew.Route) -> float:
        """Return the share of a route in cells without a value in the current's source."""
        cells = self._case.current_cells
        if cells is None:
            return 0.0
        return share_without(route.path, self._projection, cells.at)

    def _uncharted_share(self, route: renew.Route) -> float:
        """Return the share of a route without charted depth; NaN if the chart has no depths."""
        depths = self._case.water.depths
        if depths is None:
            return math.nan
        return share_without(route.path, self._projection, depths.at)

    def _over_land(self, line: shapely.LineString) -> tuple[float, float, float]:
        """Return true metres of a route over original land, and lon, lat of the longest part."""
        projection = self._projection
        crossed = self._land[self._tree.query(line, predicate="intersects")]
        over = shapely.get_parts(shapely.intersection(line, shapely.union_all(crossed)))
        parts = over[shapely.length(over) > 0]
        if not len(parts):
            return 0.0, math.nan, math.nan
        lengths = [projection.geodesic_length_m(shapely.get_coordinates(part)) for part in parts]
        longest = parts[int(np.argmax(lengths))]
        middle = shapely.line_interpolate_point(longest, 0.5, normalized=True)
        lon, lat = projection.to_lonlat(shapely.get_coordinates(middle)[0]).tolist()
        return float(sum(lengths)), lon, lat


def land_within_reach(
    water: Water,
    currents: Sequence[renew.CurrentField],
    vessel: renew.Vessel,
    routes: Sequence[renew.Route],
) -> renew.Chart:
    """Return a chart of only the original land that a turn from any route can reach."""
    tables = [one.table(water.chart.bounds) for one in currents]
    reach = max(TurnReach.of(one, vessel).furthest.max() for one in tables)
    paths = [shapely.LineString(route.path) for route in routes]
    zone = shapely.union_all(
        shapely.buffer(paths, _BUFFER_RESERVE * float(reach), quad_segs=_QUADRANT_SEGMENTS)
    )
    shapely.prepare(zone)
    land = np.array(water.land, dtype=object)
    near = land[shapely.intersects(zone, land)]
    crosses = ~shapely.covers(zone, near)
    near[crosses] = shapely.intersection(near[crosses], zone)
    return renew.Chart(water.chart.extent, list(extract_polygons(near)))


def _sampled(turns: renew.Contingency) -> renew.Contingency:
    """Keep every point with a collision, and at most _MAX_POINTS others."""
    others = np.flatnonzero(~turns.collided)
    kept = others[np.linspace(0, others.size - 1, min(_MAX_POINTS, others.size)).astype(int)]
    chosen = np.sort(np.concatenate([np.flatnonzero(turns.collided), kept]))
    return replace(turns, points=turns.points[chosen], collided=turns.collided[chosen])


# Minimum length of a crossing, true metres: a shorter one only grazes the shore.
_LEAST_M = 1.0
# Spacing of the points at which the depth of a crossing is measured, as a share of the limit.
_SPACING = 0.25


class SecondShoreline:
    """The land of a chart's second shoreline, with a spatial index."""

    def __init__(self, water: Water) -> None:
        self._projection, self._limit_m = water.projection, water.refused_m
        self._shore = np.array(water.second_shore, dtype=object)
        self._tree = shapely.STRtree(self._shore)

    def all_crossings(self, result: CaseResult) -> tuple[ShoreCrossing, ...]:
        """Return where a case's routes cross the second shoreline's land."""
        return tuple(
            one
            for rank, route in enumerate(result.routes, start=1)
            for one in self.crossings(np.asarray(route.path), rank)
        )

    def crossings(self, path: FloatArray, rank: int) -> tuple[ShoreCrossing, ...]:
        """Return where a path (n, 2), planar metres, crosses the second shoreline's land."""
        line = shapely.LineString(path)
        land = shapely.union_all(self._shore[self._tree.query(line, predicate="intersects")])
        found = []
        for part in shapely.get_parts(shapely.intersection(line, land)):
            length_m = self._projection.geodesic_length_m(shapely.get_coordinates(part))
            if length_m >= _LEAST_M:
                middle = shapely.line_interpolate_point(part, 0.5, normalized=True)
                lon, lat = self._projection.to_lonlat(shapely.get_coordinates(middle)[0])
                inland_m = self._inland_m(part, land)
                found.append(ShoreCrossing(rank, float(lon), float(lat), length_m, inland_m))
        return tuple(found)

    def _inland_m(self, part: shapely.Geometry, land: shapely.Geometry) -> float:
        """Return how far from the shore a part of a path gets, m; 0 where there is no limit."""
        if math.isinf(self._limit_m):
            return 0.0
        scale, shore = self._projection.scale, shapely.boundary(land)
        shapely.prepare(shore)
        dense = shapely.segmentize(part, _SPACING * self._limit_m / scale)
        points = shapely.points(shapely.get_coordinates(dense))
        return float(shapely.distance(points, shore).max()) * scale


def refusal(water: Water, result: CaseResult) -> str:
    """Say which route lies on land that the user's files lack; "" where none does."""
    found = SecondShoreline(water).all_crossings(result) if math.isfinite(water.refused_m) else ()
    deep = [one for one in found if one.inland_m > water.refused_m]
    if not deep:
        return ""
    worst = max(deep, key=lambda one: one.length_m)
    return (
        f"route {worst.rank} crosses {distance(worst.length_m)} of land at "
        f"{Place(worst.lon, worst.lat).text}, {distance(worst.inland_m)} from its shore, which "
        "OpenStreetMap has and the chart's files have not: in a scenario (renew go without "
        '--charts writes one), add it under [chart], source = ["osm-land", { path = "…" }], or if '
        'the files are right, say so, source = { path = "…", complete = true }'
    )
