"""Land of a second, independent shoreline that routes cross, as the chart has water there.

For the world's land that is GSHHG, and a crossing is a reason to check an official chart. For files
of the user's it is the world's land: a file may hold some of the land only, so a plan is refused
whose routes lie deeper in it than both are accurate.
"""

import math

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.findings.text import distance
from pipeline.model import Place, Scene, SeasonPlan, ShoreCrossing

# Minimum length of a crossing, true metres: a shorter one only grazes the shore.
_LEAST_M = 1.0
# Spacing of the points at which the depth of a crossing is measured, as a share of the limit.
_SPACING = 0.25


class SecondShoreline:
    """The land of a scene's second shoreline, with a spatial index."""

    def __init__(self, scene: Scene) -> None:
        self._projection, self._limit_m = scene.projection, scene.refused_m
        self._shore = np.array(scene.second_shore, dtype=object)
        self._tree = shapely.STRtree(self._shore)

    def all_crossings(self, plan: SeasonPlan) -> tuple[ShoreCrossing, ...]:
        """Return where the routes of a plan cross the second shoreline's land."""
        return tuple(
            one
            for rank, route in enumerate(plan.ranked_routes, start=1)
            for one in self.crossings(np.asarray(route.path), plan.season, rank)
        )

    def crossings(self, path: FloatArray, season: str, rank: int) -> tuple[ShoreCrossing, ...]:
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
                found.append(
                    ShoreCrossing(season, rank, float(lon), float(lat), length_m, inland_m)
                )
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


def refusal(scene: Scene, plan: SeasonPlan) -> str:
    """Say which route lies on land that the user's files lack; "" where none does."""
    found = SecondShoreline(scene).all_crossings(plan) if math.isfinite(scene.refused_m) else ()
    deep = [one for one in found if one.inland_m > scene.refused_m]
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
