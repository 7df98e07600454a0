"""Fifth stage: every route judged against the original, unsimplified land."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import shapely

import renew
from pipeline.geo.projection import in_pieces
from pipeline.model import Evaluation, RouteMetrics
from pipeline.stages.passing_side import Sides

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    import numpy.typing as npt
    from shapely.geometry import Polygon

    from pipeline.model import Current, RouteKey, Scene, SeasonPlan

    FloatArray = npt.NDArray[np.float64]

# Turns begin every metre of the plane, as published, or every so much of a turning radius where
# that is more: a shorter step flies the same turn again.
_LEAST_SPACING = 1.0
_SPACING_RADII = 0.5
# Draws of the current's spread stay within this many times its strength, as in renew.contingency.
_MOST_DRIFT = 3.0
# Places of a route's turns that are kept, evenly along it: at true scale there are 100,000.
_MOST_PLACES = 1000
# A route is held against the land in pieces of this length (true metres), across which the plane's
# scale does not change; what is nearer than this times the least distance is measured on earth.
_PIECE_M = 10_000.0
_NEARLY = 1.02
# Sides of the polygon that stands for the circle around a route's bends.
_QUADRANT_SEGMENTS = 4


@dataclass(frozen=True, slots=True)
class SeasonEvaluation:
    """One season's share of an Evaluation.

    `contingency` counts all turns, and keeps the places of all collisions but not of all turns.
    """

    routes: tuple[RouteMetrics, ...]
    contingency: Mapping[RouteKey, renew.Contingency]


def evaluate_season(scene: Scene, plan: SeasonPlan, scale: float, seed: int) -> SeasonEvaluation:
    """Judge one season's routes; none where the season was not planned."""
    if plan.plan is None:
        return SeasonEvaluation((), {})
    judge = _Judge(scene, scene.currents[plan.season], plan.plan.routes, scale, seed)
    rows, flown = [], {}
    for rank, route in enumerate(plan.plan.routes, start=1):
        turns = judge.turns(route)
        flown[plan.season, rank] = _thinned(turns)
        rows.append(judge.metrics(route, turns, plan.season, rank))
    return SeasonEvaluation(tuple(rows), flown)


def joined(parts: Iterable[SeasonEvaluation]) -> Evaluation:
    """Put the seasons together."""
    parts = tuple(parts)
    return Evaluation(
        routes=tuple(row for part in parts for row in part.routes),
        contingency={key: turns for part in parts for key, turns in part.contingency.items()},
    )


class _Judge:
    """Measures routes of one season."""

    def __init__(
        self,
        scene: Scene,
        current: Current,
        routes: Sequence[renew.Route],
        scale: float,
        seed: int,
    ) -> None:
        self._scene, self._current, self._routes = scene, current, routes
        self._scale, self._seed = scale, seed
        self._land = np.array(scene.land, dtype=object)
        self._tree = shapely.STRtree(self._land)
        self._sides = Sides(scene)

    def metrics(
        self, route: renew.Route, turns: renew.Contingency, season: str, rank: int
    ) -> RouteMetrics:
        """All figures of one route."""
        line = shapely.LineString(route.path)
        return RouteMetrics(
            season=season,
            rank=rank,
            homotopy=route.homotopy,
            fuel=route.fuel,
            fuel_per_distance=route.fuel_per_distance,
            length=route.length,
            length_m=self._scene.projection.geodesic_length_m(route.path),
            clearance_m=self._clearance_m(line),
            duration_s=self._duration_s(route),
            optimality_gap=route.optimality_gap,
            trials=turns.trials,
            collisions=turns.collisions,
            land_m=self._over_land_m(line),
            side=self._sides.side(np.asarray(route.path)),
        )

    def turns(self, route: renew.Route) -> renew.Contingency:
        """Fly the hard-over turns of a route against the original land within their reach."""
        radius = self._scene.vessel.turning_radius
        return renew.contingency(
            route,
            self._chart,
            self._current,
            self._scene.vessel,
            spacing=max(_LEAST_SPACING, _SPACING_RADII * radius),
            seed=self._seed,
        )

    @cached_property
    def _chart(self) -> renew.Chart:
        """The original land that turns of any route can reach: whole coasts would take long."""
        vessel = self._scene.vessel
        drift = self._current.max_speed(self._scene.chart.bounds) * vessel.turn_period
        reach = 1.1 * (2 * vessel.turning_radius + _MOST_DRIFT * drift)
        paths = [shapely.LineString(route.path) for route in self._routes]
        zone = shapely.union_all(shapely.buffer(paths, reach, quad_segs=_QUADRANT_SEGMENTS))
        near = self._land[self._tree.query(zone, predicate="intersects")]
        shapely.prepare(zone)
        over = ~shapely.covers(zone, near)
        near[over] = shapely.intersection(near[over], zone)
        return renew.Chart(self._scene.chart.extent, _polygons(near))

    def _clearance_m(self, line: shapely.LineString) -> float:
        """True metres between a route and the nearest original land; inf where there is none.

        What is nearest in the plane need not be so on earth, where the plane's scale differs along
        the route: all that comes nearly as near is measured.
        """
        if not len(self._land):
            return math.inf
        projection = self._scene.projection
        points = in_pieces(shapely.get_coordinates(line), _PIECE_M / self._scale)
        pieces = shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1))
        apart = self._tree.query_nearest(pieces, return_distance=True, all_matches=False)[1]
        true = apart / projection.point_scale(projection.to_lonlat((points[:-1] + points[1:]) / 2))
        near = true <= true.min() * _NEARLY
        piece, land = self._tree.query(
            pieces[near], predicate="dwithin", distance=apart[near] * _NEARLY
        )
        gaps = shapely.shortest_line(pieces[near][piece], self._land[land])
        return min(projection.geodesic_length_m(shapely.get_coordinates(gap)) for gap in gaps)

    def _duration_s(self, route: renew.Route) -> float:
        """Seconds at true scale: a metre of the plane is more or less than one on earth."""
        time, track = route.trajectory[:, 0], route.trajectory[:, 1:3]
        steps = np.diff(time)
        middles = self._scene.projection.to_lonlat((track[:-1] + track[1:]) / 2)
        true = steps / self._scene.projection.point_scale(middles)
        return float(route.duration * self._scale * true.sum() / steps.sum())

    def _over_land_m(self, line: shapely.LineString) -> float:
        """True metres of a route over original land."""
        crossed = self._land[self._tree.query(line, predicate="intersects")]
        if not crossed.size:
            return 0.0
        over = shapely.intersection(line, shapely.union_all(crossed))
        lines = [part for part in shapely.get_parts(over) if part.length > 0]
        lengths = [
            self._scene.projection.geodesic_length_m(shapely.get_coordinates(part))
            for part in lines
        ]
        return float(sum(lengths))


def _thinned(turns: renew.Contingency) -> renew.Contingency:
    """Keep every place of a collision, and so many of the others as a map can show."""
    others = np.flatnonzero(~turns.collided)
    kept = others[np.linspace(0, others.size - 1, min(_MOST_PLACES, others.size)).astype(int)]
    chosen = np.sort(np.concatenate([np.flatnonzero(turns.collided), kept]))
    return replace(turns, points=turns.points[chosen], collided=turns.collided[chosen])


def _polygons(geometries: npt.NDArray[np.object_]) -> list[Polygon]:
    """Take the polygons out of any geometries."""
    return [
        part
        for part in shapely.get_parts(shapely.get_parts(geometries))
        if isinstance(part, shapely.Polygon) and not part.is_empty
    ]
