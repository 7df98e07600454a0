"""Water whose current outruns the vessel: no-go for it, though no land lies there."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from renew._types import FloatArray
from renew.inputs.chart import Chart
from renew.inputs.current_table import Table

# The outline of cells is a staircase; it is straightened by this share of a cell.
_STRAIGHTENED = 0.5
# So many cells around an end stay open: what the water is like there a path finds out for itself.
_AROUND_ENDS = 2.0


def overpowering_water(
    table: Table, speed: float, chart: Chart, ends: tuple[FloatArray, FloatArray]
) -> BaseGeometry:
    """Water where the current is at least as strong as the vessel is fast, as one geometry.

    It is made of the table's cells with a node that strong, and so reaches up to a cell further.
    """
    strong = np.linalg.norm(table.uv, axis=-1) >= speed
    row, column = np.nonzero(strong[1:, 1:] | strong[1:, :-1] | strong[:-1, 1:] | strong[:-1, :-1])
    if not len(row):
        return shapely.MultiPolygon()
    x, y = table.x, table.y
    cell = float(max(np.diff(x).max(), np.diff(y).max()))
    cells = shapely.box(x[column], y[row], x[column + 1], y[row + 1])
    zone = shapely.coverage_union_all(cells).simplify(_STRAIGHTENED * cell)
    around = shapely.union_all(shapely.buffer(shapely.points(ends), _AROUND_ENDS * cell))
    open_water = shapely.difference(chart.water, around)
    return shapely.intersection(zone, open_water, grid_size=chart.precision)
