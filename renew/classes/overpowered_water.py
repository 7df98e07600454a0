"""Water whose current is as strong as the vessel: no-go for it, though no land lies there."""

import numpy as np
import shapely
from contourpy import FillType, contour_generator
from shapely.geometry.base import BaseGeometry

from renew._types import FloatArray
from renew.kernels.current_table import weakest_and_strongest
from renew.voyage.voyage import Voyage

# Tolerance, as a share of a cell, by which its outline is simplified.
_TOLERANCE = 0.1
# Shares of the vessel's speed from which the table's current counts as that strong: at most, so
# that a simplified outline doesn't reach into it, and at least, however coarse the table.
_AT_MOST, _AT_LEAST = 0.99, 0.5
# Radius, in cells, of the water around start and goal that stays open: there the path itself finds
# out how strong the current is.
_OPEN_RADIUS = 2.0


def overpowered_water(voyage: Voyage) -> BaseGeometry:
    """Water where the current is always at least as strong as the vessel is fast, as one geometry.

    It is bounded by a contour of the table's currents, lowered by what the table may be in error.
    """
    table, chart, speed = voyage.table, voyage.chart, voyage.vessel.speed
    weakest, _ = weakest_and_strongest(table)
    level = float(np.clip(speed - table.error, _AT_LEAST * speed, _AT_MOST * speed))
    if weakest.max() < level:
        return shapely.MultiPolygon()
    cell = float(max(np.diff(table.x).max(), np.diff(table.y).max()))
    zone = _at_least(table.x, table.y, weakest, level).simplify(_TOLERANCE * cell)
    endpoints = shapely.points(voyage.stops)
    kept_open = shapely.union_all(shapely.buffer(endpoints, _OPEN_RADIUS * cell))
    closed = shapely.difference(chart.water, kept_open)
    parts = shapely.get_parts(shapely.intersection(zone, closed, grid_size=chart.precision))
    # Where the zone only touches the shore, the grid leaves lines and points.
    return shapely.multipolygons(parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON])


def _at_least(x: FloatArray, y: FloatArray, values: FloatArray, level: float) -> BaseGeometry:
    """Where values (ny, nx) at nodes, linear between them, are a level or more."""
    contours = contour_generator(x, y, values, fill_type=FillType.OuterOffset)
    polygons = [
        shapely.Polygon(outer, holes)
        for points, offsets in zip(*contours.filled(level, np.inf), strict=True)
        for outer, *holes in [np.split(points, offsets[1:-1])]
    ]
    # Two outlines may meet in a point.
    return shapely.union_all([shapely.make_valid(polygon) for polygon in polygons])
