"""Plan one season, and measure every route of it against the original, unsimplified land."""

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from datetime import timedelta
from functools import partial

import numpy as np
import shapely

import renew
from pipeline.findings.text import planner_text, season_text
from pipeline.geo.lonlat import share_without
from pipeline.geo.projection import densified
from pipeline.model import (
    EnsembleFigures,
    Evaluation,
    RouteMetrics,
    Scene,
    SeasonPlan,
    plan_options,
    planning,
)
from pipeline.scenario.model import PlannerOptions
from pipeline.sources.land.shapes import extract_polygons
from pipeline.stages.places import is_shut_in
from pipeline.stages.seasons.second_shoreline import SecondShoreline, refusal
from pipeline.stages.seasons.under_way import replanned
from renew.errors import Text, TooLateError
from renew.inputs.arguments import MAX_STATIONS
from renew.planner.ensemble.statistics import STATISTICS
from renew.turns.turn_reach import TurnReach
from renew.watching import Step, watched

OnStep = Callable[[str, Step], None]
"""Called with a season and a step of its plan, in the thread that plans."""


def ignore_step(season: str, step: Step) -> None:
    """Ignore a step."""
    del season, step


MIN_LATENESS_S = 3600.0
"""Minimum of the times by which turns are checked early and late in changing currents, s."""
# Hardly any strait has less padding than this share of the least padding of the refused straits.
_SURE = 0.95
# Spacing of the points at which hard-over turns begin: at least this many planar metres, as
# published, and at least this many turning radii, because nearer turns are almost the same.
_MIN_SPACING = 1.0
_SPACING_RADII = 0.5
# Maximum number of points per route that are stored although no turn from them collides, evenly
# spaced; at true scale a route has 100,000 points.
_MAX_POINTS = 1000
# Length (true metres) of the pieces of a route whose distance from land is measured: the plane's
# scale is nearly constant across each. Land within _NEARLY times the smallest distance is measured
# again along geodesics.
_PIECE_M = 10_000.0
_NEARLY = 1.02
# Segments per quadrant of the buffer around routes, and the factor on its width that compensates
# for what 16-sided circles cut off (2 %), with a reserve.
_QUADRANT_SEGMENTS = 4
_BUFFER_RESERVE = 1.1


def plan_season(
    scene: Scene,
    season: str,
    options: PlannerOptions,
    on_step: OnStep = ignore_step,
    havens: tuple[renew.Haven, ...] = (),
) -> SeasonPlan:
    """Plan one season; if that is impossible, the result's `failure` has the reason.

    Under way the reason says which of the `havens` to turn off to.

    `on_step` is called with the season and each step of its plan, whose path is in lon/lat degrees.
    """
    started = time.perf_counter()
    asked, arrive_by_s = plan_options(options, min_lateness=MIN_LATENESS_S), math.inf
    ensemble = again = None
    planned = partial(scene.planned, season, asked)

    def tell(step: Step) -> None:
        path = None if step.path is None else scene.projection.to_lonlat(step.path)
        on_step(season, replace(step, path=path))

    def spelled(reason: Text) -> str:
        return planner_text(reason, scene, season)

    try:
        with watched(tell):
            if scene.before is not None:
                plan, again = replanned(scene, scene.before, season, asked, havens)
            elif season in scene.speeds:
                plan, arrive_by_s = planning.planned_in_time(planned, scene, season)
            elif season in scene.members:
                found = scene.planned_ensemble(season, asked)
                plan, ensemble = found.plan, EnsembleFigures.of(found, spelled)
            else:
                plan = planned(arrive_by_s)
    except renew.PlanningError as error:
        stretch = planning.largest_stretch(scene, season) if season in scene.speeds else 1.0
        failure = planner_text(error.text, scene, season, stretch)
        causes = error.causes if isinstance(error, renew.UnreachableError) else ()
        are_late = [isinstance(cause, TooLateError) for cause in causes]
        if any(are_late):
            failure += (
                f"; {season_text(season)}: its currents end too early: give currents that reach "
                "further, raise its max_hours if they do, or depart earlier"
            )
        if causes and not all(are_late):
            failure += "; these are keys of [planner]; renew go has the option --clearance"
        is_shut = isinstance(error, renew.UnreachableError) and not is_shut_in(
            scene, error.straits, _smallest_padding(error, scene, season, asked)
        )
        return SeasonPlan(
            season,
            None,
            failure,
            time.perf_counter() - started,
            is_shut,
            class_names=error.text.class_names,
        )
    seconds = time.perf_counter() - started
    made = SeasonPlan(
        season,
        plan,
        "",
        seconds,
        arrive_by_s=arrive_by_s,
        ensemble=ensemble,
        replanned=again,
    )
    failure = refusal(scene, made)
    return SeasonPlan(season, None, failure, seconds) if failure else made


def _smallest_padding(
    error: renew.UnreachableError, scene: Scene, season: str, options: renew.PlanOptions
) -> float:
    """Return a width, planar metres; hardly any padding of the refused classes is narrower."""
    paddings = [max(one.padding_left, one.padding_right) for one in error.straits]
    likely = options.likely_width(scene.vessel_in(season).turning_radius)
    return max(likely, _SURE * min(paddings, default=0.0))


def evaluate_season(scene: Scene, plan: SeasonPlan, options: PlannerOptions) -> Evaluation:
    """Measure one season's routes, by rank; the result is empty if the season was not planned.

    In a changing current, the drift model determines the times along a route. Turns are simulated
    on time, and early and late by the share `lateness` of the time since departure.
    """
    routes = plan.ranked_routes
    if not routes:
        return Evaluation((), {})
    evaluator = _RouteEvaluator(scene, plan.season, routes, options)
    rows, flown = [], {}
    for rank, route in enumerate(routes, start=1):
        turns = evaluator.turns(route, in_members=rank == 1)
        flown[plan.season, rank] = _sampled(turns)
        rows.append(evaluator.metrics(route, turns, rank))
    if plan.ensemble is not None:
        rows = [_in_members(row, plan.ensemble) for row in rows]
    return Evaluation(tuple(rows), flown, SecondShoreline(scene).all_crossings(plan))


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


def combine_seasons(parts: Iterable[Evaluation]) -> Evaluation:
    """Combine the evaluations of all seasons."""
    parts = tuple(parts)
    return Evaluation(
        routes=tuple(row for part in parts for row in part.routes),
        contingency={key: turns for part in parts for key, turns in part.contingency.items()},
        shore_crossings=tuple(one for part in parts for one in part.shore_crossings),
        gap_shares=tuple(one for part in parts for one in part.gap_shares),
        clock_worths=tuple(one for part in parts for one in part.clock_worths),
    )


class _RouteEvaluator:
    """Measures the routes of one season."""

    def __init__(
        self, scene: Scene, season: str, routes: Sequence[renew.Route], options: PlannerOptions
    ) -> None:
        self._scene, self._season, self._current = scene, season, scene.currents[season]
        members = scene.members.get(season)
        self._members = members.currents if members else ()
        self._options = options
        self._land = np.array(scene.land, dtype=object)
        self._tree = shapely.STRtree(self._land)
        every = (self._current, *self._members)
        self._near_land = land_within_reach(scene, every, scene.vessel_in(season), routes)

    def metrics(self, route: renew.Route, turns: renew.Contingency, rank: int) -> RouteMetrics:
        """Return all measurements of one route."""
        line = shapely.LineString(route.path)
        land_m, land_lon, land_lat = self._over_land(line)
        measured = RouteMetrics(
            season=self._season,
            rank=rank,
            homotopy=route.homotopy,
            fuel=route.fuel,
            fuel_per_distance=route.fuel_per_distance,
            length=route.length,
            length_m=self._scene.projection.geodesic_length_m(route.path),
            clearance_m=self._clearance_m(line),
            duration_s=planning.true_duration_s(route, self._scene, self._season),
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
        least, kept_m = route.least_water, self._scene.under_keel_clearance_m
        if least is None:
            return measured
        return replace(
            measured,
            least_water_m=least.spare + kept_m,
            least_water_at=self._scene.departures[self._season]
            + timedelta(seconds=round(least.time)),
            least_water_early_m=least.early + kept_m,
            least_water_late_m=least.late + kept_m,
        )

    def turns(self, route: renew.Route, *, in_members: bool) -> renew.Contingency:
        """Simulate the hard-over turns of a route against the original land within their reach.

        They are those in the season's current, and on request in each of its members as well.
        """
        first, *others = (
            self._turns(route, one)
            for one in (self._current, *(self._members if in_members else ()))
        )
        return replace(
            first,
            trials=first.trials + sum(one.trials for one in others),
            collisions=first.collisions + sum(one.collisions for one in others),
            collided=np.any([first.collided, *(one.collided for one in others)], axis=0),
        )

    def _turns(self, route: renew.Route, current: renew.CurrentField) -> renew.Contingency:
        """Simulate the hard-over turns of a route in a current."""
        vessel = self._scene.vessel_in(self._season)
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
        projection = self._scene.projection
        points = densified(shapely.get_coordinates(line), _PIECE_M / self._scene.projection.scale)
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
        cells = self._scene.current_cells.get(self._season)
        if cells is None:
            return 0.0
        return share_without(route.path, self._scene.projection, cells.at)

    def _uncharted_share(self, route: renew.Route) -> float:
        """Return the share of a route without charted depth; NaN if the chart has no depths."""
        depths = self._scene.depths
        if depths is None:
            return math.nan
        return share_without(route.path, self._scene.projection, depths.at)

    def _over_land(self, line: shapely.LineString) -> tuple[float, float, float]:
        """Return true metres of a route over original land, and lon, lat of the longest part."""
        projection = self._scene.projection
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
    scene: Scene,
    currents: Sequence[renew.CurrentField],
    vessel: renew.Vessel,
    routes: Sequence[renew.Route],
) -> renew.Chart:
    """Return a chart of only the original land that a turn from any route can reach."""
    tables = [one.table(scene.chart.bounds) for one in currents]
    reach = max(TurnReach.of(one, vessel).furthest.max() for one in tables)
    paths = [shapely.LineString(route.path) for route in routes]
    zone = shapely.union_all(
        shapely.buffer(paths, _BUFFER_RESERVE * float(reach), quad_segs=_QUADRANT_SEGMENTS)
    )
    shapely.prepare(zone)
    land = np.array(scene.land, dtype=object)
    near = land[shapely.intersects(zone, land)]
    crosses = ~shapely.covers(zone, near)
    near[crosses] = shapely.intersection(near[crosses], zone)
    return renew.Chart(scene.chart.extent, list(extract_polygons(near)))


def _sampled(turns: renew.Contingency) -> renew.Contingency:
    """Keep every point with a collision, and at most _MAX_POINTS others."""
    others = np.flatnonzero(~turns.collided)
    kept = others[np.linspace(0, others.size - 1, min(_MAX_POINTS, others.size)).astype(int)]
    chosen = np.sort(np.concatenate([np.flatnonzero(turns.collided), kept]))
    return replace(turns, points=turns.points[chosen], collided=turns.collided[chosen])
