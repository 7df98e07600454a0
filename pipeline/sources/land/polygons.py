"""What every chart source does to its geometries, in lon/lat degrees: mend, clip, turn, widen."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely import affinity

from pipeline.geo.projection import Projection

if TYPE_CHECKING:
    import numpy.typing as npt
    from shapely.geometry import Polygon
    from shapely.geometry.base import BaseGeometry

    FloatArray = npt.NDArray[np.float64]
    Geometries = npt.NDArray[np.object_]

# Chart this far outside the region's bounds is kept too: land may reach over the edge once it is
# buffered or joined, and a map needs its surroundings.
BEYOND_M = 20_000.0

_METRES_PER_DEGREE = 111_195.0
# A quarter of a circle in four: the buffer around a point has 16 corners.
_QUADRANT_SEGMENTS = 4
# What two areas share by rounding of 1 cm is a seam between them, and no slit.
_GRID_DEG = 1e-7


def box_around(region: Polygon, beyond_m: float = BEYOND_M) -> Polygon:
    """Return the region's bounds, wider by `beyond_m`; at most one turn wide, poles included."""
    west, south, east, north = region.bounds
    rise = beyond_m / _METRES_PER_DEGREE
    south, north = max(south - rise, -90.0), min(north + rise, 90.0)
    cosine = math.cos(math.radians(max(abs(south), abs(north))))
    room = (360 - (east - west)) / 2
    run = min(rise / cosine, room) if cosine > rise / 360 else room
    return shapely.box(west - run, south, east + run, north)


def turns_into(geometries: Geometries, box: Polygon) -> tuple[Geometries, npt.NDArray[np.int64]]:
    """Return the geometries whose bounds meet a box, moved by whole turns, and their indices.

    One that meets it both ways round comes twice.
    """
    west, south, east, north = box.bounds
    xmin, ymin, xmax, ymax = shapely.bounds(geometries).T
    found: list[Geometries] = [np.empty(0, dtype=object)]
    index: list[npt.NDArray[np.int64]] = [np.empty(0, dtype=np.int64)]
    for turn in (-360.0, 0.0, 360.0):
        met = (xmin + turn <= east) & (xmax + turn >= west) & (ymin <= north) & (ymax >= south)
        chosen = geometries[met]
        found.append(chosen if turn == 0 else _shifted(chosen, turn))
        index.append(np.flatnonzero(met))
    return np.concatenate(found), np.concatenate(index)


def _shifted(geometries: Geometries, turn: float) -> Geometries:
    """Move geometries by whole turns of longitude."""
    moved = np.empty(len(geometries), dtype=object)
    moved[:] = [affinity.translate(geometry, turn) for geometry in geometries]
    return moved


def mended(geometries: Geometries) -> tuple[Geometries, int]:
    """Make invalid areas valid, covering what their rings enclose; count those that were not."""
    unsound = ~shapely.is_valid(geometries)
    if not unsound.any():
        return geometries, 0
    sound = geometries.copy()
    sound[unsound] = shapely.make_valid(
        geometries[unsound], method="structure", keep_collapsed=False
    )
    return sound, int(unsound.sum())


def mended_note(name: str, count: int) -> tuple[str, ...]:
    """Say that areas of a source were invalid; nothing where none was."""
    if not count:
        return ()
    were = "1 area was invalid and was" if count == 1 else f"{count:,} areas were invalid and were"
    return (f"{name}: {were} mended (rings that cross or touch themselves)",)


def clipped(polygons: Geometries, box: Polygon) -> Geometries:
    """Cut valid areas along a box; those inside stay as they are."""
    shapely.prepare(box)
    over = ~shapely.covers(box, polygons)
    return polygonal(np.concatenate([polygons[~over], shapely.intersection(polygons[over], box)]))


def polygonal(geometries: Geometries) -> Geometries:
    """Take the polygons out of any geometries; lines and points that clipping left go."""
    parts: Geometries = shapely.get_parts(shapely.get_parts(geometries))
    kind = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    polygons: Geometries = parts[kind & ~shapely.is_empty(parts)]
    return polygons


def merged(geometries: Geometries) -> BaseGeometry:
    """Merge areas that share seams, closing slits of rounding."""
    return shapely.union_all(geometries, grid_size=_GRID_DEG)


def less(area: BaseGeometry, taken: BaseGeometry) -> BaseGeometry:
    """Take one area from another, leaving no slivers of rounding along their seams."""
    return shapely.difference(area, taken, grid_size=_GRID_DEG)


def off_edge(lines: Geometries, area: BaseGeometry) -> Geometries:
    """Return what of lines lies inside an area and not on its edge."""
    inside = shapely.intersection(lines, area, grid_size=_GRID_DEG)
    inner = shapely.difference(inside, shapely.boundary(area), grid_size=_GRID_DEG)
    return np.asarray(inner[shapely.length(inner) > 0])


def widened(geometries: Geometries, radius_m: npt.ArrayLike) -> Geometries:
    """Buffer geometries by true metres; the polygon around a point encloses its circle."""
    if len(geometries) == 0:
        return geometries
    box = shapely.box(*shapely.total_bounds(geometries))
    plane = Projection.for_region(box.buffer(0.01))
    planar = plane.geometry_to_plane(geometries)
    at = shapely.get_coordinates(shapely.centroid(geometries))
    around = math.cos(math.pi / (4 * _QUADRANT_SEGMENTS))
    radius = np.asarray(radius_m) * plane.point_scale(at) / around
    grown = shapely.buffer(planar, radius, quad_segs=_QUADRANT_SEGMENTS)
    return np.asarray(plane.geometry_to_lonlat(grown))
