"""A chart with as few vertices as the paper's charts have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

import renew
from pipeline.errors import RequestError
from renew._types import FloatArray

# Tolerances that are tried, as shares of the chart's diagonal.
_TOLERANCES = np.geomspace(0.1, 1e-4, 200)


def vertices(chart: renew.Chart) -> int:
    """Number of vertices of the chart's triangulation, the extent's corners included."""
    return len(np.unique(shapely.get_coordinates(chart.water), axis=0))


def coarse(
    chart: renew.Chart, land: Sequence[shapely.Geometry], most: int, ends: FloatArray
) -> renew.Chart:
    """Return a chart of at most so many vertices, with land cut by Douglas and Peucker.

    The tolerance is reduced until the chart would have more, with `ends` (n, 2) in the water. Small
    islands are lost, and so are straits: that is for comparison with the paper only.

    Raises
    ------
    RequestError
        No tolerance does.
    """
    west, south, east, north = chart.extent.bounds
    found = None
    for tolerance in np.hypot(east - west, north - south) * _TOLERANCES:
        cut = shapely.simplify(np.array(land, dtype=object), tolerance, preserve_topology=False)
        inside = shapely.intersection(shapely.union_all(shapely.make_valid(cut)), chart.extent)
        parts = shapely.get_parts(inside)
        finer = renew.Chart(chart.extent, list(parts[shapely.area(parts) > 0]))
        if vertices(finer) > most:
            break
        if shapely.contains_xy(finer.water, ends).all():
            found = finer
    if found is None:
        raise RequestError([f"no chart of {most} vertices has both ends in the water; allow more"])
    return found
