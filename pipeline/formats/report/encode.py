"""Geometry and figures as whole numbers, each the difference to the one before.

So written a coast of 50,000 vertices takes half a megabyte of JSON, and the page sums it up in
milliseconds.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

if TYPE_CHECKING:
    import numpy.typing as npt
    from shapely.geometry import Polygon

    FloatArray = npt.NDArray[np.float64]

# A chart's longer side has this many steps or up to ten times as many: 1 m on 700 km.
_FEWEST_STEPS = 2e5
# A series goes from its least to its greatest in this many steps: a fifth digit is never shown.
_SERIES_STEPS = 50_000
# GEOS's number for a polygon.
_POLYGON = 3


@dataclass(frozen=True)
class Lattice:
    """Places as whole steps from the chart's lower left corner.

    `origin` (2,) and `step` are in planar units; `step_m` is the step in metres of the plane at
    its true scale, a power of ten.
    """

    origin: FloatArray
    step: float
    step_m: float

    @classmethod
    def of(cls, bounds: tuple[float, float, float, float], scale: float) -> Lattice:
        """Choose the step for a chart's bounds (planar units) at a scale."""
        xmin, ymin, xmax, ymax = bounds
        side_m = max(xmax - xmin, ymax - ymin) * scale
        step_m = 10.0 ** math.floor(math.log10(side_m / _FEWEST_STEPS))
        return cls(np.array([xmin, ymin]), step_m / scale, step_m)

    def whole(self, places: FloatArray) -> npt.NDArray[np.int64]:
        """Round places (n, 2) of the plane to whole steps (n, 2)."""
        return np.rint((places - self.origin) / self.step).astype(np.int64)

    def line(self, places: FloatArray) -> list[int]:
        """Flat x, y, dx, dy, …: the first place and the moves from each to the next other one."""
        moves = np.diff(self.whole(places), axis=0, prepend=0)
        keep = np.asarray(moves.any(axis=1))
        keep[:1] = True
        return [int(value) for value in moves[keep].ravel()]

    def rings(self, areas: npt.NDArray[np.object_]) -> list[list[int]]:
        """Every ring of polygonal geometries (n,); outer rings anticlockwise, holes clockwise.

        A ring that a step swallows is left out; the last place, which is the first, is too.
        """
        polygons = shapely.orient_polygons(shapely.get_parts(areas))
        rings = shapely.get_rings(polygons[shapely.get_type_id(polygons) == _POLYGON])
        lines = (self.line(shapely.get_coordinates(ring)[:-1]) for ring in rings)
        return [line for line in lines if len(line) >= 6]


def series(values: FloatArray) -> dict[str, object]:
    """Figures (n,) as `{"step": s, "moves": [...]}`; the last is exact, infinite ones are None."""
    if not np.isfinite(values).all():
        return {"step": 1.0, "moves": None}
    reach = float(np.abs(values).max(initial=0.0))
    last = abs(float(values[-1])) if len(values) else 0.0
    # A whole number of steps to the last: fuel and time then end at the route's own figures.
    step = (last if last > 0.1 * reach else reach) / _SERIES_STEPS or 1.0
    moves = np.diff(np.rint(values / step).astype(np.int64), prepend=0)
    return {"step": step, "moves": [int(value) for value in moves]}


def within(areas: npt.NDArray[np.object_], extent: Polygon) -> npt.NDArray[np.object_]:
    """Cut geometries (n,) to the extent; those that lie in it stay as they are."""
    shapely.prepare(extent)
    areas = areas[shapely.intersects(extent, areas)]
    outside = ~shapely.covers(extent, areas)
    cut = areas.copy()
    cut[outside] = shapely.intersection(areas[outside], extent)
    return cut


def coarser(areas: npt.NDArray[np.object_], step: float, most: int) -> npt.NDArray[np.object_]:
    """Simplify geometries (n,) by a step, two, four, … until they have at most so many vertices.

    Islets smaller than such a step become empty. After twenty doublings a coast is a handful of
    triangles, and stays as it is.
    """
    for _ in range(20):
        many = shapely.get_num_coordinates(areas).sum() / most
        if many <= 1:
            break
        west, south, east, north = shapely.bounds(areas).T
        seen = np.maximum(east - west, north - south) >= step
        areas = np.where(seen, shapely.simplify(areas, step), shapely.Polygon())
        # All vertices take their time again and again: with many, larger steps.
        step *= 4 if many > 8 else 2
    return areas


def json_for_script(data: object) -> str:
    """JSON that may stand in a `<script>` element: no `<` that could end it or open a comment."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
