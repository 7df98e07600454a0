"""Measure each route of a case against the original, unsimplified land.

A second, independent shoreline may have land where the chart has water. For the world's land that
is GSHHG, and a crossing is a reason to check an official chart. For files of the user's it is the
world's land: a file may hold some of the land only, so a plan is refused whose routes lie deeper in
it than both are accurate.
"""

import contextlib
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import timedelta

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.findings.route_profile import closest_approach
from pipeline.findings.text import distance
from pipeline.geo.coast import within
from pipeline.geo.projection import DepthCover, KnownCells, Projection, densified, share_without
from pipeline.model import (
    Case,
    CaseResult,
    EnsembleFigures,
    Measures,
    NarrowStretch,
    Place,
    RouteMetrics,
    ShoreCrossing,
    Water,
    plan_options,
)
from pipeline.model.case import MIN_LATENESS_S
from pipeline.scenario.model import PlannerOptions
from pipeline.sources.land.shapes import extract_polygons
from pipeline.stages.limits import worst_met
from pipeline.stages.narrow import narrow_stretches
from renew.inputs.options import MAX_STATIONS
from renew.turns.turn_reach import TurnReach
from renew.vary.ensemble import STATISTICS

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
    narrow, adrift = list[NarrowStretch](), list[renew.Adrift]()
    for rank, route in enumerate(routes, start=1):
        turns = evaluator.turns(route, in_members=rank == 1)
        flown.append(_sampled(turns))
        row = evaluator.metrics(route, turns, rank)
        narrow += evaluator.narrow(route, rank)
        if not case.water.is_planar:
            adrift.append(evaluator.adrift(route))
            row = replace(
                _adrift(row, adrift[-1], case.projection),
                members_adrift_share=evaluator.soon_ashore_in_members(route),
            )
        rows.append(row)
    if result.ensemble is not None:
        rows = [_in_members(row, result.ensemble) for row in rows]
    crossings = shore_crossings(case.water, (route.path for route in routes))
    near = _near_best(case, result)
    return Measures(tuple(rows), tuple(flown), crossings, tuple(adrift), tuple(narrow), near)


def _near_best(case: Case, result: CaseResult) -> shapely.Geometry | None:
    """Return the water of routes that need at most 1 % more fuel than the best; None if unknown."""
    # A voyage under way begins with a turn that the bound does not know.
    if result.plan is not None and case.before is None:
        with contextlib.suppress(renew.ParameterError):
            return renew.near_best(result.plan)
    return None


ADRIFT_S = 72 * 3600.0
"""For how long a vessel without thrust is followed, s."""
SOON_ASHORE_S = 6 * 3600.0
"""Time until land, s, below which a place is counted as one from which help comes too late."""


def _adrift(row: RouteMetrics, found: renew.Adrift, projection: Projection) -> RouteMetrics:
    """Return a route's metrics with those of a vessel without thrust."""
    scale, (lon, lat) = projection.scale, (math.nan, math.nan)
    least = float(found.seconds[found.least]) * scale
    if math.isfinite(least):
        lon, lat = projection.to_lonlat(found.points[found.least]).tolist()
    return replace(
        row,
        adrift_s=least,
        adrift_lon=lon,
        adrift_lat=lat,
        adrift_share=found.share_below(SOON_ASHORE_S / scale),
        ashore_share=found.share_below(math.inf),
    )


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
        points = densified(shapely.get_coordinates(line), _PIECE_M / self._projection.scale)
        closest = closest_approach(self._tree, points, self._projection)
        choice, still = self._case.speeds, self._case.vessel.speed
        if choice is not None:
            still = float(np.clip(route.length / route.duration, choice.least, choice.most))
        measured = RouteMetrics(
            rank=rank,
            homotopy=route.homotopy,
            fuel=route.fuel,
            fuel_per_distance=route.fuel_per_distance,
            length=route.length,
            length_m=self._projection.geodesic_length_m(route.path),
            clearance_m=math.inf if closest is None else closest[1],
            duration_s=route.duration * self._projection.scale,
            speed_m_s=float(np.average(route.speeds, weights=np.diff(route.times))),
            still_fuel=float(self._case.vessel.rates(still)) * route.length / still,
            energy=self._case.energy,
            optimality_gap=route.optimality_gap,
            trials=turns.trials,
            collisions=turns.collisions,
            land_m=land_m,
            land_lon=land_lon,
            land_lat=land_lat,
            filled_share=self._share_without(route, self._case.current_cells, 0.0),
            uncharted_share=self._share_without(route, self._case.water.depths, math.nan),
        )
        measured = replace(measured, **worst_met(self._case, route, self._options.drift))
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

    def soon_ashore_in_members(self, route: renew.Route) -> float:
        """Return the share of a route from which land is met soon, in the mean of the members.

        NaN without members.
        """
        members, soon = self._case.members, SOON_ASHORE_S / self._projection.scale
        if members is None:
            return math.nan
        found = (self.adrift(route, one, soon) for one in members.currents)
        shares = [one.share_below(soon) for one in found]
        return float(np.average(shares, weights=members.weights))

    def adrift(
        self,
        route: renew.Route,
        current: renew.CurrentField | None = None,
        horizon: float = math.inf,
    ) -> renew.Adrift:
        """Follow a vessel that loses its thrust on a route, until it meets the original land."""
        return renew.adrift(
            route,
            self._case.chart,
            self._case.adrift_in(self._case.current if current is None else current),
            land=self._land.tolist(),
            horizon=min(ADRIFT_S / self._projection.scale, horizon),
            lateness=self._options.lateness,
            min_lateness=MIN_LATENESS_S,
        )

    def narrow(self, route: renew.Route, rank: int) -> Iterator[NarrowStretch]:
        """Yield the stretches of a route without room for a turn."""
        asked = plan_options(self._options, min_lateness=MIN_LATENESS_S)
        yield from narrow_stretches(self._case, route, rank, self._near_land, asked)

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
        length = shapely.LineString(route.path).length
        least = max(_MIN_SPACING, 1.000001 * length / MAX_STATIONS)
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

    def _share_without(
        self, route: renew.Route, known: KnownCells | DepthCover | None, otherwise: float
    ) -> float:
        """Return the share of a route where nothing is known; `otherwise` if nothing could be."""
        return otherwise if known is None else share_without(route.path, self._projection, known.at)

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
    """Return a chart of only the original land that a turn from any route can reach.

    It reaches as far as the turns, as land beyond a region's edge is met like any other.
    """
    tables = [one.table(water.chart.bounds) for one in currents]
    vessel = water.chart.turning(vessel)
    reach = max(TurnReach.of(one, vessel).furthest.max() for one in tables)
    paths = [shapely.LineString(route.path) for route in routes]
    zone = shapely.union_all(
        shapely.buffer(paths, _BUFFER_RESERVE * float(reach), quad_segs=_QUADRANT_SEGMENTS)
    )
    near = within(np.array(water.land, dtype=object), zone)
    around = shapely.box(*shapely.union(zone, water.chart.extent).bounds)
    return water.chart.with_no_go(
        extract_polygons(near), extent=None if water.is_planar else around
    )


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


def shore_crossings(water: Water, paths: Iterable[FloatArray]) -> tuple[ShoreCrossing, ...]:
    """Return where paths (n, 2), planar metres, by rank, cross the second shoreline's land."""
    projection, shore = water.projection, np.array(water.second_shore, dtype=object)
    tree, found = shapely.STRtree(shore), []
    for rank, path in enumerate(paths, start=1):
        line = shapely.LineString(path)
        land = shapely.union_all(shore[tree.query(line, predicate="intersects")])
        for part in shapely.get_parts(shapely.intersection(line, land)):
            length_m = projection.geodesic_length_m(shapely.get_coordinates(part))
            if length_m >= _LEAST_M:
                middle = shapely.line_interpolate_point(part, 0.5, normalized=True)
                lon, lat = projection.to_lonlat(shapely.get_coordinates(middle)[0]).tolist()
                inland_m = _inland_m(part, land, water)
                found.append(ShoreCrossing(rank, lon, lat, length_m, inland_m))
    return tuple(found)


def _inland_m(part: shapely.Geometry, land: shapely.Geometry, water: Water) -> float:
    """Return how far from the shore a part of a path gets, m; 0 where there is no limit."""
    if math.isinf(water.refused_m):
        return 0.0
    scale, shore = water.projection.scale, shapely.boundary(land)
    shapely.prepare(shore)
    dense = shapely.segmentize(part, _SPACING * water.refused_m / scale)
    points = shapely.points(shapely.get_coordinates(dense))
    return float(shapely.distance(points, shore).max()) * scale


def refusal(water: Water, result: CaseResult) -> str:
    """Say which route lies on land that the user's files lack; "" where none does."""
    if math.isinf(water.refused_m):
        return ""
    found = shore_crossings(water, (route.path for route in result.routes))
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
