"""The world's land in tiles for the page's map: from the file of the whole world, simplified.

Tiles are those of web maps: at zoom z the world is 2^z tiles wide, in Mercator's projection. Small
zooms would need the outlines of continents with millions of vertices, so up to _COARSE_ZOOM land
comes from a coarse copy, which is made once and kept in the user's cache. That takes half a minute:
until then tiles come from the coast that is in this package.
"""

import contextlib
import json
import struct
import threading
from functools import lru_cache
from pathlib import Path

import numpy as np
import shapely

from pipeline._types import FloatArray, Geometries
from pipeline.sources.land import osm, shapes

COAST = Path(__file__).with_name("coast.json")
"""The coarse coast: rings of x, y, dx, dy, ... From OpenStreetMap (ODbL), as `osm-land`."""
COAST_STEP_DEG = 0.02
"""Size of a step there, degrees."""
TILE_PX = 512
"""Pixels along each side of a tile."""
MAX_ZOOM = 14
"""The closest view: a pixel is some 5 m at the equator, and the coast is accurate to 60 m."""

# Zoom of tiles of 512 pixels up to which the coarse copy is taken.
_COARSE_ZOOM = 4
# Detail of the coarse copy, degrees: half a pixel at that zoom.
_COARSE_DEG = 0.02
# Room around a tile so that outlines along the cut are not seen, pixels.
_ROOM_PX = 8
# Time, seconds, after which the sharp coast is made: it keeps a core busy while the page is opened.
_LATER_S = 3.0
# Steps to a pixel in the answer.
_STEPS = 4
# Latitude at which the square map ends, degrees.
_MAX_LATITUDE = 85.0511287
# Tiles are made one at a time, so that a map that is moved leaves a core to the plans.
_making = threading.Lock()
# Set once the sharp coast is in the user's cache.
_is_ready = threading.Event()

Rings = tuple[tuple[int, ...], ...]


def tile(zoom: int, column: int, row: int) -> tuple[Rings, bool]:
    """Return the rings of the land in a tile, and whether its coast is sharp.

    They are x, y, x, y, ... in quarters of its pixels. Holes are rings as well: fill by the
    even-odd rule. Raises IndexError for a tile off the map.
    """
    count = 2**zoom
    if not (0 <= zoom <= MAX_ZOOM and 0 <= column < count and 0 <= row < count):
        raise IndexError
    _begin()
    is_sharp = _is_ready.is_set()
    return _tile(zoom, column, row, is_sharp=is_sharp), is_sharp


@lru_cache(maxsize=1)
def _begin() -> None:
    """Have the sharp coast made, unless it is in the user's cache."""
    path = osm.cache_file("Osm")
    if path is not None and path.exists() and _coarse_file(path).exists():
        _is_ready.set()
        return
    making = threading.Timer(_LATER_S, _get_ready)
    making.daemon = True
    making.start()


def _get_ready() -> None:
    """Make the land's files in the user's cache, unless they are there."""
    somewhere = shapely.box(0, 0, 1, 1)
    for zoom in (_COARSE_ZOOM, _COARSE_ZOOM + 1):
        _near(somewhere, zoom, 0.0)
    _is_ready.set()


@lru_cache(maxsize=512)
def _tile(zoom: int, column: int, row: int, *, is_sharp: bool) -> Rings:
    """Return the rings of the land in a tile, of the sharp coast or of the coarse one."""
    count = 2**zoom
    # A tile of the coarse coast is made at once: it has few points.
    with _making if is_sharp else contextlib.nullcontext():
        corner, px = np.array([column, row]) * float(TILE_PX), TILE_PX * count
        low, high = corner - _ROOM_PX, corner + TILE_PX + _ROOM_PX
        west, north = _degrees(low, px)
        east, south = _degrees(high, px)
        box = shapely.box(west, south, east, north)
        near = _near(box, zoom, 180 / px) if is_sharp else _coast()
        land = shapes.clipped(shapes.repaired(*near)[0], box)

        def to_tile(points: FloatArray) -> FloatArray:
            return np.asarray((_pixels(points, px) - corner) * _STEPS)

        drawn = shapely.simplify(shapely.transform(land, to_tile), _STEPS / 2)
        rings = shapely.get_rings(shapely.get_parts(drawn))
        points = (np.rint(shapely.get_coordinates(ring)[:-1]).astype(int) for ring in rings)
        return tuple(tuple(ring.ravel().tolist()) for ring in points if len(ring) > 2)


def _near(box: shapely.Polygon, zoom: int, least_deg: float) -> osm.NearPolygons:
    """Return the land near a box, except what is smaller than half a pixel."""
    if zoom > _COARSE_ZOOM:
        return osm.polygons_near("Osm", box, least_deg)[0]
    path = osm.cache_file("Osm")
    coarse = None if path is None else _coarse_file(path)
    near = None if coarse is None else osm.read_cached(coarse, box, least_deg)
    if near is not None:
        return near
    wkb = _coarse()
    if coarse is not None:
        with contextlib.suppress(OSError):  # a cache that can't be written: it is made each time
            osm.write_cached(coarse, wkb)
    return osm.read_near(wkb, box, least_deg)


def _coarse_file(path: Path) -> Path:
    """Return the path of the coarse copy of a file of the cache."""
    return path.with_name(f"coarse-{path.name}")


@lru_cache(maxsize=1)
def _coast() -> osm.NearPolygons:
    """Return the coarse coast that is in this package."""
    rings = json.loads(COAST.read_text("utf-8"))
    lonlat = [np.cumsum(np.reshape(ring, (-1, 2)), axis=0) * COAST_STEP_DEG for ring in rings]
    polygons = np.array([shapely.Polygon(ring) for ring in lonlat], dtype=object)
    return polygons, shapely.is_valid(polygons)


@lru_cache(maxsize=1)
def _coarse() -> bytes:
    """Return the world's land with less detail, as WKB."""
    # Up to 180 degrees itself, what ends there would come a second time from the other side.
    world = shapely.box(-179.999, -90, 179.999, 90)
    near = osm.polygons_near("Osm", world, least_deg=_COARSE_DEG)[0][0]
    parts: Geometries = shapely.get_parts(
        shapely.make_valid(shapely.simplify(near, _COARSE_DEG, preserve_topology=False))
    )
    kept = parts[shapely.area(parts) > 0]
    bodies = [shapely.to_wkb(body, byte_order=1) for body in kept]
    return b"\x01" + struct.pack("<II", 6, len(bodies)) + b"".join(bodies)


def _pixels(points: FloatArray, px: int) -> FloatArray:
    """Return points (n, 2), lon/lat degrees, on a map of the world that is `px` pixels wide."""
    lat = np.radians(np.clip(points[:, 1], -_MAX_LATITUDE, _MAX_LATITUDE))
    y = 0.5 - np.arcsinh(np.tan(lat)) / (2 * np.pi)
    return np.asarray(np.stack([points[:, 0] / 360 + 0.5, y], axis=1) * px)


def _degrees(point: FloatArray, px: int) -> tuple[float, float]:
    """Return longitude and latitude, degrees, of a point (2,) on a map `px` pixels wide."""
    x, y = point / px
    return 360 * (x - 0.5), float(np.degrees(np.arctan(np.sinh(np.pi * (1 - 2 * y)))))
