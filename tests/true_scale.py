"""How near a route comes to land on earth, found without the pipeline's projection and evaluation.

Piece by piece in an azimuthal-equidistant plane of its own, centred on the piece, in which 30 km
are right to a few centimetres; the land is the original polygons, in degrees.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
import pyproj
import shapely
from shapely.geometry import Polygon

from pipeline._types import FloatArray, Geometries

GEOD = pyproj.Geod(ellps="WGS84")
"""The earth's ellipsoid."""
_METRES_PER_DEGREE = 111_195.0
_PIECE_M = 10_000.0
_FIRST_LOOK_M, _LAST_LOOK_M = 2_000.0, 2_000_000.0


def clearance_m(route: FloatArray, polygons: Sequence[Polygon]) -> float:
    """Least distance (m) of a route (n, 2), in degrees and finely cut, from polygons in degrees."""
    land = np.array(polygons, dtype=object)
    tree = shapely.STRtree(land)
    least = math.inf
    for piece in _pieces(route):
        least = min(least, _apart_m(piece, land, tree, least))
    return least


def _pieces(route: FloatArray) -> Iterator[FloatArray]:
    """Yield a route piece by piece."""
    steps = GEOD.line_lengths(route[:, 0], route[:, 1])
    number = (np.concatenate([[0.0], np.cumsum(steps)]) // _PIECE_M).astype(int)
    for piece in range(number[-1] + 1):
        (mine,) = np.nonzero(number == piece)
        if len(mine):
            yield route[max(mine[0] - 1, 0) : mine[-1] + 2]


def _apart_m(piece: FloatArray, land: Geometries, tree: shapely.STRtree, least: float) -> float:
    """Distance (m) of a piece from the land, infinite where it is more than the least so far."""
    lon, lat = piece[len(piece) // 2].tolist()
    aeqd = f"+proj=aeqd +lon_0={lon!r} +lat_0={lat!r} +datum=WGS84"
    plane = pyproj.Transformer.from_crs("OGC:CRS84", aeqd, always_xy=True)

    def project(points: FloatArray) -> FloatArray:
        return np.column_stack(plane.transform(points[:, 0], points[:, 1]))

    line = shapely.LineString(project(piece))
    look_m = min(_FIRST_LOOK_M, least)
    while True:
        # A little wider than asked for: what is nearer than that lies in it whole.
        rise = 1.1 * look_m / _METRES_PER_DEGREE
        run = rise / math.cos(math.radians(min(abs(lat) + 1, 89.0)))
        west, south, east, north = shapely.LineString(piece).bounds
        window = shapely.box(west - run, south - rise, east + run, north + rise)
        near = shapely.intersection(land[tree.query(window, predicate="intersects")], window)
        near = near[~shapely.is_empty(near)]
        if len(near):
            apart = shapely.distance(shapely.transform(near, project), line).min()
            if apart <= look_m:
                return float(apart)
        if look_m >= min(least, _LAST_LOOK_M):
            return math.inf
        look_m *= 2
