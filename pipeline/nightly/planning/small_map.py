"""A small map of a chart as SVG paths, for the page of a night."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.model import Scene

_WIDTH = 480.0
# Detail of a map, and least area of an island on it, in units of the map's frame.
_TOLERANCE, _LEAST_AREA = 0.4, 0.6


@dataclass(frozen=True)
class SmallMap:
    """Land as an SVG path in a frame of `width` by `height`, and the map of planar x, y to it."""

    width: float
    height: float
    land: str
    west: float
    north: float
    per_metre: float

    @classmethod
    def of(cls, scene: Scene) -> SmallMap:
        """Draw a scene's land, without details too small to see."""
        xmin, ymin, xmax, ymax = scene.chart.bounds
        per_metre = _WIDTH / max(xmax - xmin, (ymax - ymin) / 1.4)
        empty = cls((xmax - xmin) * per_metre, (ymax - ymin) * per_metre, "", xmin, ymax, per_metre)
        land = shapely.simplify(np.array(scene.chart.no_go, dtype=object), _TOLERANCE / per_metre)
        rings = [
            shapely.get_coordinates(ring)
            for polygon in land
            if polygon.area * per_metre**2 >= _LEAST_AREA
            for part in shapely.get_parts(polygon)
            for ring in (part.exterior, *part.interiors)
        ]
        path = "".join(f"{empty.path(ring)}Z" for ring in rings)
        return cls(empty.width, empty.height, path, xmin, ymax, per_metre)

    def path(self, xy: FloatArray) -> str:
        """Return points (n, 2), planar metres, as an SVG path."""
        simple = shapely.get_coordinates(
            shapely.simplify(shapely.LineString(xy), _TOLERANCE / self.per_metre)
        )
        x = (simple[:, 0] - self.west) * self.per_metre
        y = (self.north - simple[:, 1]) * self.per_metre
        points = [f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True)]
        return f"M{'L'.join(points)}"
