"""Water whose current is as strong as the vessel: no-go for it, though no land lies there."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from renew.inputs.voyage import Voyage

# Tolerance, as a share of a cell, by which the staircase outline of cells is straightened.
_TOLERANCE = 0.5
# Radius, in cells, of the water around start and goal that stays open: there the path itself finds
# out how strong the current is.
_OPEN_RADIUS = 2.0


def overpowered_water(voyage: Voyage) -> BaseGeometry:
    """Water where the current is always at least as strong as the vessel is fast, as one geometry.

    It is made of the table's cells with a node that strong, and so reaches up to a cell too far.
    """
    table, chart = voyage.table, voyage.chart
    strong = (np.linalg.norm(table.uv, axis=-1) >= voyage.vessel.speed).all(axis=0)
    row, column = np.nonzero(strong[1:, 1:] | strong[1:, :-1] | strong[:-1, 1:] | strong[:-1, :-1])
    if not len(row):
        return shapely.MultiPolygon()
    x, y = table.x, table.y
    cell = float(max(np.diff(x).max(), np.diff(y).max()))
    cells = shapely.box(x[column], y[row], x[column + 1], y[row + 1])
    zone = shapely.coverage_union_all(cells).simplify(_TOLERANCE * cell)
    endpoints = shapely.points([voyage.start, voyage.goal])
    kept_open = shapely.union_all(shapely.buffer(endpoints, _OPEN_RADIUS * cell))
    closed = shapely.difference(chart.water, kept_open)
    parts = shapely.get_parts(shapely.intersection(zone, closed, grid_size=chart.precision))
    # Where the zone only touches the shore, the grid leaves lines and points.
    return shapely.multipolygons(parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON])
