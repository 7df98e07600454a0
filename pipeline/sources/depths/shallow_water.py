"""The cells of a grid that are too shallow, and one cell around them, as polygons."""

import numpy as np
import shapely
from contourpy import FillType, contour_generator
from scipy import ndimage

from pipeline._types import FloatArray, Geometries
from pipeline.sources.depths.depth_file import Heights

# Rings of cells that are added around a grid.
_RINGS = 2
# Distance below which the points of an outline are on one line, as a share of a cell.
_STRAIGHT = 1e-6


def shallow_polygons(heights: Heights, safety_depth_m: float) -> Geometries:
    """Return valid polygons (lon/lat degrees) of what is shallower, and one cell around.

    Land is shallow, too. The outline is the contour halfway between the nodes of the cells that are
    taken and those that are not: it lies one cell off every shallow cell, and cuts the corners.
    """
    with np.errstate(invalid="ignore"):
        shallow = heights.height_m > -safety_depth_m
    if not shallow.any():
        return np.empty(0, dtype=object)
    # Two rings more: the cell around those at the grid's edge, and one that closes the outlines.
    taken = ndimage.binary_dilation(np.pad(shallow, _RINGS), np.ones((3, 3)))
    lon, lat = (_extended(axis) for axis in (heights.lon, heights.lat))
    contours = contour_generator(
        lon, lat, taken.astype(np.float64), fill_type=FillType.OuterOffset
    ).filled(0.5, 2.0)
    cell_deg = min(np.diff(lon).min(), np.diff(lat).min())
    polygons = shapely.simplify(
        np.array(
            [
                shapely.Polygon(rings[0], rings[1:])
                for points, offsets in zip(*contours, strict=True)
                for rings in [np.split(points, offsets[1:-1])]
            ],
            dtype=object,
        ),
        _STRAIGHT * cell_deg,
    )
    # Where two outlines meet in a point.
    invalid = ~shapely.is_valid(polygons)
    polygons[invalid] = shapely.make_valid(
        polygons[invalid], method="structure", keep_collapsed=False
    )
    return np.asarray(shapely.get_parts(polygons))


def _extended(axis: FloatArray) -> FloatArray:
    """Continue an axis beyond both ends."""
    steps = np.arange(1, _RINGS + 1)
    before = axis[0] - (axis[1] - axis[0]) * steps[::-1]
    return np.concatenate([before, axis, axis[-1] + (axis[-1] - axis[-2]) * steps])
