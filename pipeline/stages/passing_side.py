"""On which side of the great island a route passes: the first thing that a navigator asks."""

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


class Sides:
    """Names the side on which routes from start to goal pass the largest island between them.

    That island lies whole inside the chart, so that both ways round it exist, and at least partly
    between the lines through start and goal that are square to the line from one to the other.
    """

    def __init__(self, scene: Scene) -> None:
        self._start = scene.start
        axis = scene.goal - scene.start
        self._length = float(np.linalg.norm(axis))
        self._axis = axis / max(self._length, 1e-12)
        self._left = np.array([-self._axis[1], self._axis[0]])
        self._mark = self._mark_in(scene)
        east_north = scene.projection.rotate_to_lonlat(
            scene.projection.to_lonlat((scene.start + scene.goal) / 2), self._left
        )
        bearing = float(np.degrees(np.arctan2(east_north[0], east_north[1])))
        self._names = [_COMPASS[round((bearing + turn) / 90) % 4] for turn in (0, 180)]

    def side(self, path: FloatArray) -> str:
        """Compass point of the side that a planar path (n, 2) takes; empty without an island.

        Every route crosses the line through the island that is square to the way, an odd number of
        times in all: so it passes on the left just where it crosses left of the mark an odd
        number of times.
        """
        if self._mark is None:
            return ""
        along = (path - self._mark) @ self._axis
        across = (path - self._mark) @ self._left
        before, after = along[:-1], along[1:]
        crosses = (before < 0) != (after < 0)
        share = before[crosses] / (before[crosses] - after[crosses])
        offset = across[:-1][crosses] * (1 - share) + across[1:][crosses] * share
        return self._names[0 if np.count_nonzero(offset > 0) % 2 else 1]

    def _mark_in(self, scene: Scene) -> FloatArray | None:
        """A point on the largest island between start and goal."""
        for island in _islands(scene):
            between = shapely.intersection(island, self._strip(scene))
            if not between.is_empty and between.area > 0:
                mark: FloatArray = shapely.get_coordinates(between.representative_point())[0]
                return mark
        return None

    def _strip(self, scene: Scene) -> Polygon:
        """The part of the plane between start and goal, as wide as the chart."""
        xmin, ymin, xmax, ymax = scene.chart.bounds
        wide = self._left * 2 * float(np.hypot(xmax - xmin, ymax - ymin))
        goal = self._start + self._axis * self._length
        return shapely.Polygon([self._start + wide, goal + wide, goal - wide, self._start - wide])


def _islands(scene: Scene) -> list[Polygon]:
    """Original land that lies whole inside the chart, holes left out, the largest first."""
    extent = scene.chart.extent
    shapely.prepare(extent)
    land = np.array(scene.land, dtype=object)
    inner = land[shapely.contains_properly(extent, land)]
    islands = shapely.polygons(shapely.get_exterior_ring(inner))
    return list(islands[np.argsort(-shapely.area(islands), kind="stable")])
