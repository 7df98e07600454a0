"""Measure each route of a case against the original, unsimplified land, and split up its fuel.

A second, independent shoreline may have land where the chart has water. For the world's land that
is GSHHG, and a crossing is a reason to check an official chart. For files of the user's it is the
world's land: a file may hold some of the land only, so a plan is refused whose routes lie deeper in
it than both are accurate.

Fuel is measured by the causes of its gap to the bound, and by what the clock is worth.
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
from pipeline.findings.text import distance
from pipeline.geo.projection import Projection, densified, share_without
from pipeline.model import (
    Case,
    CaseResult,
    ClockWorth,
    Current,
    EnsembleFigures,
    GapShares,
    Measures,
    NarrowStretch,
    Place,
    RouteMetrics,
    ShoreCrossing,
    SpeedChoice,
    Water,
    plan_options,
)
from pipeline.model.case import MIN_LATENESS_S
from pipeline.scenario.model import PlannerOptions
from pipeline.sources.land.shapes import extract_polygons
from pipeline.stages.limits import worst_met
from pipeline.stages.narrow import narrow_stretches
from renew.inputs.options import MAX_STATIONS, Drift
from renew.turns.turn_reach import TurnReach
from renew.vary.ensemble import STATISTICS
from renew.voyage.fuel import passage

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
            clearance_m=self._clearance_m(line),
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
            filled_share=self._filled_share(route),
            uncharted_share=self._uncharted_share(route),
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
    vessel = water.chart.turning(vessel)
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
    return water.chart.with_no_go(extract_polygons(near))


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


# Factor on the turn rate of a vessel that turns on the spot.
_ON_THE_SPOT = 100.0
# Number of classes in the other plans, of which only the best route is used.
_CLASSES = 4
# Number of bisections for the factor on speeds.
_HALVINGS = 30


def gap_shares(case: Case, result: CaseResult, options: PlannerOptions) -> GapShares | None:
    """Split the gap of a case's best route; None without a plan. Takes as long as planning.

    The lower bound on fuel holds on the original land, for any vessel, with tidal water open at all
    times. The fuel of more plans lies between the bound and the route: (1) the best route on the
    original land, and (2) the best route on the chart with its margin and offing. These plans have
    no padding and a vessel that turns on the spot, because many ways close to land have no room for
    a turning circle. The chart's share is the fuel of (2) minus (1). The share of padding and
    turning circle is the fuel of the route minus (2). With a tide, the plan (0) is that of (1) with
    tidal water open at all times, and the tide's share is the fuel of (1) minus (0). The bound's
    own share, which no route can save, is the fuel of (0), or else of (1), minus the bound.
    """
    if result.plan is None:
        return None
    best, by_s = result.plan.best, result.arrive_by_s
    kept = _least_fuel(case, options, options.clearance or 0.0, by_s)
    on_land = replace(case, water=replace(case.water, chart=_land_alone(case.chart)))
    free = _least_fuel(on_land, options, 0.0, by_s)
    # A search may miss the best route. But a route of a more limited problem is also a route of a
    # less limited one, so its fuel counts there as well.
    kept = min(kept, best.fuel)
    free = min(free, kept)
    depth, opened = case.tidal_depth, free
    if depth is not None:
        areas = (*case.areas, *depth.never_open)
        tideless = replace(on_land, areas=areas, tidal_depth=None)
        opened = min(free, _least_fuel(tideless, options, 0.0, by_s))
    bound = best.fuel / (1 + best.optimality_gap)
    return GapShares(
        chart=(kept - free) / bound,
        padding=(best.fuel - kept) / bound,
        bound=(opened - bound) / bound,
        tide=(free - opened) / bound,
    )


def _least_fuel(case: Case, options: PlannerOptions, clearance: float, arrive_by_s: float) -> float:
    """Return the least fuel at `clearance` planar metres off land, without padding, or inf."""
    asked = options.model_copy(
        update={
            "padding": "none",
            "risk_at": "route",  # "point" needs adaptive padding
            "clearance": clearance,
            "classes": _CLASSES,
            "method": "optimal",
        }
    )
    own = plan_options(asked, case.projection.scale)
    nimble = replace(case.vessel, turn_rate=_ON_THE_SPOT * case.vessel.turn_rate)
    try:
        return replace(case, vessel=nimble).planned(own, arrive_by_s).best.fuel
    except renew.PlanningError:
        return math.inf


def _land_alone(chart: renew.Chart) -> renew.Chart:
    """Return the chart of the original land, for which the bound is computed."""
    land = shapely.difference(chart.extent, chart.open_water)
    return chart.with_no_go([land])


def clock_worth(case: Case, result: CaseResult, options: PlannerOptions) -> ClockWorth | None:
    """Compare a case's fuel with other plans; None for a steady current or without a plan.

    They use the current at departure, its mean over the voyage, or no current, which gives the
    shortest safe path. All are sailed in the changing current, with the same departure and padding
    rules. If speeds are chosen, a plan's speeds are multiplied by a factor so that it is in time.
    """
    current = case.current
    if result.plan is None or not isinstance(current, renew.VaryingCurrent):
        return None
    best = result.plan.best
    frozen, mean, shortest = (
        _sailed(case, result, planned_in, options)
        for planned_in in (
            weighted(current, hat_weights(current.slice_times, 0.0)),
            weighted(current, mean_weights(current.slice_times, float(best.times[-1]))),
            renew.UniformCurrent(0.0, 0.0),
        )
    )
    bound = best.fuel / (1 + best.optimality_gap)
    return ClockWorth(best.fuel, frozen, mean, shortest, bound, in_time=case.speeds is not None)


def hat_weights(times: FloatArray, moment: float) -> FloatArray:
    """Return weights (nt,) of a current's slices that interpolate linearly to a moment, s."""
    return np.array([np.interp(moment, times, one) for one in np.eye(len(times))])


def mean_weights(times: FloatArray, end: float) -> FloatArray:
    """Return weights (nt,) of a current's slices for its mean from 0 to `end`, s."""
    knots = np.unique(np.concatenate([[0.0, end], times[(times > 0) & (times < end)]]))
    shares = np.zeros(len(knots))
    shares[1:] += np.diff(knots) / 2
    shares[:-1] += np.diff(knots) / 2
    each = np.array([np.interp(knots, times, one) for one in np.eye(len(times))])
    return np.asarray(each @ shares / end)


def weighted(current: renew.VaryingCurrent, weights: FloatArray) -> renew.GriddedCurrent:
    """Return the weighted sum of a current's slices as a steady current."""
    grids = [one for one in current.slices if isinstance(one, renew.GriddedCurrent)]
    used = [(grid, weight) for grid, weight in zip(grids, weights, strict=True) if weight > 0]
    uv = sum((weight * grid.uv for grid, weight in used), np.zeros(grids[0].uv.shape))
    return renew.GriddedCurrent(grids[0].x, grids[0].y, uv[..., 0], uv[..., 1])


def _sailed(case: Case, result: CaseResult, planned_in: Current, options: PlannerOptions) -> float:
    """Return the fuel in a case's current of the best route planned in `planned_in`, or inf."""
    asked = options.model_copy(update={"classes": _CLASSES})
    try:
        plan = replace(case, current=planned_in).planned(plan_options(asked), result.arrive_by_s)
    except renew.PlanningError:
        return math.inf
    speeds: FloatArray | None = plan.best.speeds
    if case.speeds is not None:
        speeds = speeds_in_time(plan.best, case, case.speeds, result.arrive_by_s, options.drift)
        if speeds is None:
            return math.inf
    return renew.fuel(
        plan.best.path,
        case.current,
        case.vessel,
        drift=options.drift,
        speeds=speeds,
        chart=case.chart,
    )


def speeds_in_time(
    route: renew.Route, case: Case, choice: SpeedChoice, arrive_by_s: float, drift: Drift
) -> FloatArray | None:
    """Return a route's speeds (n - 1,), m/s, times the least factor with which it is in time.

    Speeds are clipped to the range of the choice. Returns None if the highest are too slow.
    """
    vessel = renew.Vessel(choice.most, turn_rate=1.0)

    def speeds(factor: float) -> FloatArray:
        return np.clip(factor * route.speeds, choice.least, choice.most)

    def is_late(factor: float) -> bool:
        own = speeds(factor)
        passed = passage(
            route.path, case.current, vessel, drift=drift, speeds=own, chart=case.chart
        )
        return bool(passed.times[-1] > arrive_by_s)

    low, high = choice.least / choice.most, choice.most / choice.least
    if is_late(high):
        return None
    for _ in range(_HALVINGS):
        factor = math.sqrt(low * high)
        low, high = (factor, high) if is_late(factor) else (low, factor)
    return speeds(high)
