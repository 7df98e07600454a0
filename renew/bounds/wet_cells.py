"""Which cells of a grid hold water that a route may touch."""

import numpy as np
import shapely

from renew._types import BoolArray, FloatArray
from renew.inputs.chart import Chart


def wet_cells(
    chart: Chart, x: FloatArray, y: FloatArray, among: BoolArray | None = None
) -> BoolArray:
    """Cells (ny - 1, nx - 1) that hold water, of some; a sliver along their sides is none."""
    from scipy.ndimage import label

    near_shore = _near_lines(chart.open_water.boundary, x, y)
    # A region apart from all shores is all water or all land: one point tells which.
    regions, count = label(~near_shore)
    one_of = np.zeros(count + 1, dtype=np.int64)
    one_of[regions.ravel()] = np.arange(regions.size)
    row, column = np.divmod(one_of, regions.shape[1])
    middle_x, middle_y = (x[column] + x[column + 1]) / 2, (y[row] + y[row + 1]) / 2
    wet = shapely.contains_xy(chart.open_water, middle_x, middle_y)[regions]
    if among is not None:
        wet &= among
        near_shore &= among
    # Land whose shore runs along a line of the grid leaves no cells of water on its own side.
    shrink = 10 * chart.precision
    row, column = np.nonzero(near_shore)
    cells = shapely.box(
        x[column] + shrink, y[row] + shrink, x[column + 1] - shrink, y[row + 1] - shrink
    )
    water = shapely.get_parts(chart.open_water)
    holds_water = np.zeros(len(cells), dtype=bool)
    holds_water[shapely.STRtree(cells).query(water, predicate="intersects")[1]] = True
    wet[near_shore] = holds_water
    return np.asarray(wet)


def _near_lines(lines: shapely.Geometry, x: FloatArray, y: FloatArray) -> BoolArray:
    """Cells (ny - 1, nx - 1) that the bounding box of a piece of some lines touches."""
    points, line = shapely.get_coordinates(shapely.get_parts(lines), return_index=True)
    joined = line[:-1] == line[1:]
    low, high = (
        np.minimum(points[:-1], points[1:])[joined],
        np.maximum(points[:-1], points[1:])[joined],
    )
    # A box that ends on a line of the grid touches the cells on both sides of it.
    count = np.zeros((len(y) + 1, len(x) + 1), dtype=np.int64)
    left, right = np.searchsorted(x, low[:, 0]) - 1, np.searchsorted(x, high[:, 0], "right")
    below, above = np.searchsorted(y, low[:, 1]) - 1, np.searchsorted(y, high[:, 1], "right")
    left, below = np.maximum(left, 0), np.maximum(below, 0)
    for rows, columns, step in (
        (below, left, 1),
        (below, right, -1),
        (above, left, -1),
        (above, right, 1),
    ):
        np.add.at(count, (rows, columns), step)
    return np.asarray(count.cumsum(axis=0).cumsum(axis=1)[:-2, :-2] > 0)
