"""Fifth stage: every route judged against the original, unsimplified land."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import shapely

import renew
from pipeline.model import Evaluation, RouteMetrics
from pipeline.side import Sides

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

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
    judge = _Judge(scene, scene.currents[plan.season], scale, seed)
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

    def __init__(self, scene: Scene, current: Current, scale: float, seed: int) -> None:
        self._scene, self._current, self._scale, self._seed = scene, current, scale, seed
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
            duration_s=route.duration * self._scale,
            optimality_gap=route.optimality_gap,
            trials=turns.trials,
            collisions=turns.collisions,
            land_m=self._over_land_m(line),
            side=self._sides.side(np.asarray(route.path)),
        )

    def turns(self, route: renew.Route) -> renew.Contingency:
        """Fly the hard-over turns of a route against the original land within their reach."""
        vessel = self._scene.vessel
        drift = self._current.max_speed(self._scene.chart.bounds) * vessel.turn_period
        reach = 2 * vessel.turning_radius + _MOST_DRIFT * drift
        zone = shapely.LineString(route.path).buffer(1.1 * reach, _QUADRANT_SEGMENTS)
        # Whole coasts would be compared with every turn: only what lies in the zone matters.
        near = shapely.intersection(
            self._land[self._tree.query(zone, predicate="intersects")], zone
        )
        chart = renew.Chart(self._scene.chart.extent, _polygons(near))
        return renew.contingency(
            route,
            chart,
            self._current,
            vessel,
            spacing=max(_LEAST_SPACING, _SPACING_RADII * vessel.turning_radius),
            seed=self._seed,
        )

    def _clearance_m(self, line: shapely.LineString) -> float:
        """True metres between a route and the nearest original land; inf where there is none."""
        nearest = self._tree.query_nearest(line, all_matches=False)
        if not nearest.size:
            return math.inf
        gap = shapely.get_coordinates(shapely.shortest_line(line, self._land[nearest[0]]))
        return self._scene.projection.geodesic_length_m(gap)

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
