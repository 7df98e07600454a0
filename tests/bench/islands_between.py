"""The largest island between two places, and on which sides paths pass it; no planner's code.

An island lies between two places where both ways round it are at most a quarter longer than the
best way, on a raster of the water. Land that no raster cell parts counts as one island: whether a
narrower strait can be sailed is a matter of margin and padding.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import shapely
from shapely.geometry import Polygon

from pipeline._types import FloatArray, IndexArray
from pipeline.sources.quality.coverage import Bounds
from pipeline.stages.choosing.water_grid import Cell, WaterGrid

# Cells along each side, and the longest way round an island in best ways.
_CELLS, _LONGEST = 400, 1.25
# Number of islands that are tried, the largest first.
_TRIED = 12


def largest_between(
    land: Sequence[Polygon], bounds: Bounds, start: FloatArray, goal: FloatArray
) -> FloatArray | None:
    """Point (lon, lat) in the largest island that both ways round can be sailed, or None."""
    grid = _grid(land, bounds)
    first, last = grid.water_near(*start), grid.water_near(*goal)
    best = None if first is None or last is None else grid.shortest_way(first, last)
    if first is None or last is None or best is None:
        return None
    longest = _LONGEST * best.length_m
    numbers, size = np.unique(grid.islands[grid.islands > 0], return_counts=True)
    largest_first = numbers[np.argsort(-size, kind="stable")].tolist()
    inner = [island for island in largest_first if not grid.leaves(island)]
    for island in inner[:_TRIED]:
        cells = np.argwhere(grid.islands == island)
        # A cell of the island itself: the middle of a crescent is water.
        middle = cells[np.abs(cells - cells.mean(axis=0)).sum(axis=1).argmin()]
        ways = [grid.shortest_way(first, last, ray) for ray in _rays(grid, middle, first, last)]
        if all(way is not None and way.length_m <= longest for way in ways):
            return np.array([grid.lon[middle[1]], grid.lat[middle[0]]])
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


def _rays(grid: WaterGrid, middle: IndexArray, first: Cell, last: Cell) -> Iterator[IndexArray]:
    """Cells (n, 2) of two rays from a cell to the grid's edge, square to the direct way."""
    along = np.subtract(last, first) / np.linalg.norm(np.subtract(last, first))
    for across in (np.array([-along[1], along[0]]), np.array([along[1], -along[0]])):
        cells = np.rint(middle + np.arange(0, 3 * _CELLS)[:, None] / 2 * across).astype(np.intp)
        inside = ((cells >= 0) & (cells < grid.is_water.shape)).all(axis=1)
        yield cells[inside]
