"""On which side a route passes the largest island on its way: a navigator's first question."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import shapely

if TYPE_CHECKING:
    import numpy.typing as npt
    from shapely.geometry import Polygon

    from pipeline.model import Scene

    FloatArray = npt.NDArray[np.float64]

_COMPASS = ("north", "east", "south", "west")


class PassingSide:
    """Names the side on which routes pass the largest island between start and goal.

    Only islands that lie entirely inside the chart count, so that both ways round exist, and that
    lie at least partly between the perpendiculars to the direct line through start and goal.
    """

    def __init__(self, scene: Scene) -> None:
        self._start = scene.start
        axis = scene.goal - scene.start
        self._length = float(np.linalg.norm(axis))
        self._axis = axis / max(self._length, 1e-12)
        self._left = np.array([-self._axis[1], self._axis[0]])
        self._reference = self._reference_point(scene)
        east_north = scene.projection.rotate_to_lonlat(
            scene.projection.to_lonlat((scene.start + scene.goal) / 2), self._left
        )
        bearing = float(np.degrees(np.arctan2(east_north[0], east_north[1])))
        self._names = [_COMPASS[round((bearing + turn) / 90) % 4] for turn in (0, 180)]

    def name(self, path: FloatArray) -> str:
        """Compass point of the side that a planar path (n, 2) takes; empty without an island.

        Every route crosses the perpendicular through the reference point an odd number of times in
        all. It passes on the left if and only if it crosses left of that point an odd number of
        times.
        """
        if self._reference is None:
            return ""
        along = (path - self._reference) @ self._axis
        across = (path - self._reference) @ self._left
        before, after = along[:-1], along[1:]
        crosses = (before < 0) != (after < 0)
        share = before[crosses] / (before[crosses] - after[crosses])
        offset = across[:-1][crosses] * (1 - share) + across[1:][crosses] * share
        return self._names[0 if np.count_nonzero(offset > 0) % 2 else 1]

    def _reference_point(self, scene: Scene) -> FloatArray | None:
        """Return a point (2,) on the largest island between start and goal."""
        for island in _islands(scene):
            between = shapely.intersection(island, self._strip(scene))
            if not between.is_empty and between.area > 0:
                point: FloatArray = shapely.get_coordinates(between.representative_point())[0]
                return point
        return None

    def _strip(self, scene: Scene) -> Polygon:
        """Return the part of the plane between start and goal, as wide as the chart."""
        xmin, ymin, xmax, ymax = scene.chart.bounds
        wide = self._left * 2 * float(np.hypot(xmax - xmin, ymax - ymin))
        goal = self._start + self._axis * self._length
        return shapely.Polygon([self._start + wide, goal + wide, goal - wide, self._start - wide])


def _islands(scene: Scene) -> list[Polygon]:
    """Return the original land entirely inside the chart, without holes, the largest first."""
    extent = scene.chart.extent
    shapely.prepare(extent)
    land = np.array(scene.land, dtype=object)
    inner = land[shapely.contains_properly(extent, land)]
    islands = shapely.polygons(shapely.get_exterior_ring(inner))
    return list(islands[np.argsort(-shapely.area(islands), kind="stable")])
