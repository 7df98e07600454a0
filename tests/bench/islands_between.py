"""The largest island between two places, and on which sides paths pass it; no planner's code.

An island lies between two places where both ways round it are at most a given multiple of the best
way, on a raster of the water. Land that no raster cell parts counts as one island: whether a
narrower strait can be sailed is a matter of margin and padding.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import shapely
from shapely.geometry import Polygon

from pipeline._types import FloatArray
from pipeline.geo.lonlat import Bounds
from pipeline.stages.water_grid import WaterGrid

# Cells along each side, and those that the smallest island has: rocks are no choice of sides.
_CELLS, _LEAST_CELLS = 400, 20
# Number of islands that are tried, the largest first.
_TRIED = 12


def largest_between(
    land: Sequence[Polygon],
    bounds: Bounds,
    start: FloatArray,
    goal: FloatArray,
    longest_way: float = 1.25,
) -> FloatArray | None:
    """Point (lon, lat) in the largest island with both ways at most so long, in best ways."""
    grid = _grid(land, bounds)
    first, last = grid.water_near(*start), grid.water_near(*goal)
    if first is None or last is None or not (ways := grid.shortest_paths(first, last)):
        return None
    longest = longest_way * ways[0].length_m
    size = np.bincount(grid.islands.ravel())
    size[0] = 0
    largest_first = [int(one) for one in np.argsort(-size) if size[one] >= _LEAST_CELLS]
    inner = [island for island in largest_first if not grid.leaves(island)]
    for island in inner[:_TRIED]:
        ways = grid.shortest_paths(first, last, island)
        if len(ways) > 1 and ways[-1].length_m <= longest:
            return np.array(grid.place_on(island))
    return None


def sides(paths: Iterable[FloatArray], point: FloatArray) -> set[int]:
    """Sides on which paths (n, 2) with the same ends pass a point: numbers of turns round it."""
    swept = []
    for path in paths:
        x, y = (path - point).T
        swept.append(np.diff(np.unwrap(np.arctan2(y, x))[[0, -1]]).item())
    return {round((angle - min(swept)) / (2 * np.pi)) for angle in swept}


def _grid(land: Sequence[Polygon], bounds: Bounds) -> WaterGrid:
    """Cells whose centres are half a cell off land: straits narrower than a cell are shut."""
    west, south, east, north = bounds
    lon, lat = (
        low + (high - low) * (np.arange(_CELLS) + 0.5) / _CELLS
        for low, high in ((west, east), (south, north))
    )
    centres = shapely.points(np.stack(np.meshgrid(lon, lat), axis=-1).reshape(-1, 2))
    is_water = np.ones(len(centres), dtype=bool)
    near = (north - south) / _CELLS / 2
    is_water[shapely.STRtree(centres).query(land, predicate="dwithin", distance=near)[1]] = False
    return WaterGrid(lon, lat, is_water.reshape(_CELLS, _CELLS))
