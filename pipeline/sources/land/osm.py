"""OpenStreetMap land for any region, offline, from the package `roaring-landmask`.

The package carries the world as one WKB MultiPolygon: 745,676 whole polygons (cut at 180 degrees
only), 9.6 million vertices, 154 MB, simplified by its makers to 0.0005 degrees. Building them all
takes 1.1 GB, so they are built a few thousand at a time and only those near the region are kept.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.model import Credit, Land
from pipeline.sources.land.polygons import (
    BEYOND_M,
    box_around,
    clipped,
    extract_polygons,
    near_box,
    repair_note,
    repaired,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt
    from shapely.geometry import Polygon

    Polygons = npt.NDArray[np.object_]

NAME = "roaring-landmask"
# Accuracy of the coast, m: it is simplified by 0.0005 degrees, 55.7 m along a meridian.
ACCURACY_M = 60.0

# Number of polygons built at a time: 20,000 are 250,000 vertices on average, some 30 MB.
_CHUNK = 20_000

# WKB (OGC 06-103r4, 8.2), little endian: byte order 1, type 6 MultiPolygon, number of polygons;
# then for each of them byte order, type 3, number of rings; for each ring its number of points,
# and the points as two float64 each.
_MULTIPOLYGON = b"\x01" + struct.pack("<I", 6)
_COUNT = struct.Struct("<I")
_HEADER = len(_MULTIPOLYGON)
_POINT = 16


@dataclass(frozen=True, slots=True)
class LandPolygons:
    """Valid polygons in lon/lat degrees near a region, and what was done to them.

    `repaired` counts invalid polygons made valid, `duplicates` those dropped because they came
    twice, and `seam_pieces` the pieces cut at 180 degrees that were joined.
    """

    polygons: tuple[Polygon, ...]
    repaired: int
    duplicates: int
    seam_pieces: int


def land(region: Polygon, beyond_m: float = BEYOND_M) -> Land:
    """Return the land near a region with its credit, as the fetch stage passes it on."""
    found = land_polygons(region, beyond_m)
    notes = repair_note("OpenStreetMap land", found.repaired)
    return Land(found.polygons, (credit(),), ACCURACY_M, notes=notes)


def credit() -> Credit:
    """Return the credit line that the Open Database License asks for."""
    release = version(NAME)
    return Credit(
        name=f"OpenStreetMap land polygons (roaring-landmask {release})",
        kind="land",
        text=f"© OpenStreetMap contributors, land polygons via roaring-landmask {release}",
        licence="ODbL 1.0",
        url="https://www.openstreetmap.org/copyright",
    )


def land_polygons(region: Polygon, beyond_m: float = BEYOND_M) -> LandPolygons:
    """Return OpenStreetMap's land near a region.

    Parameters
    ----------
    region
        Lon/lat degrees, continuous across 180 (170 to 190).
    beyond_m
        Distance outside the region's bounds up to which land is kept (true metres, about). Mainland
        is cut along that box.

    Returns
    -------
    LandPolygons
        Valid, in the region's own longitudes, and whole unless they cross the box: pieces that the
        source cuts at 180 degrees are joined again.
    """
    # Imported late: loading its library of 110 MB takes a moment that `renew --help` must not.
    from roaring_landmask import LandmaskProvider, Shapes

    box = box_around(region, beyond_m)
    return clean(read_near(Shapes.wkb(LandmaskProvider.Osm), box), box)


def read_near(wkb: bytes, box: Polygon) -> Polygons:
    """Return the polygons of a WKB MultiPolygon whose bounds meet a box (degrees), unchanged.

    They are moved by whole turns into the box's longitudes; one that meets the box both ways round
    comes twice.
    """
    return np.concatenate(
        [np.empty(0, dtype=object), *(near_box(polygons, box)[0] for polygons in _chunks(wkb))]
    )


def clean(polygons: Polygons, box: Polygon) -> LandPolygons:
    """Repair polygons, clip them to the box, drop duplicates and join pieces at 180 degrees."""
    valid, repairs = repaired(polygons)
    parts = clipped(valid, box)
    distinct = np.array(list(dict.fromkeys(parts.tolist())), dtype=object)
    joined, seam_pieces = _joined_at_180(distinct)
    return LandPolygons(
        polygons=tuple(joined.tolist()),
        repaired=repairs,
        duplicates=len(parts) - len(distinct),
        seam_pieces=seam_pieces,
    )


def _chunks(wkb: bytes) -> Iterator[Polygons]:
    """Yield a MultiPolygon's polygons, a few at a time to save memory."""
    total: int = _COUNT.unpack_from(wkb, _HEADER)[0]
    position = begin = _HEADER + _COUNT.size
    for first in range(0, total, _CHUNK):
        count = min(_CHUNK, total - first)
        for _ in range(count):
            rings = _COUNT.unpack_from(wkb, position + _HEADER)[0]
            position += _HEADER + _COUNT.size
            for _ring in range(rings):
                position += _COUNT.size + _POINT * _COUNT.unpack_from(wkb, position)[0]
        chunk = _MULTIPOLYGON + _COUNT.pack(count) + wkb[begin:position]
        yield shapely.get_parts(shapely.from_wkb(chunk))
        begin = position


def _joined_at_180(polygons: Polygons) -> tuple[Polygons, int]:
    """Join the polygons with an edge on an odd multiple of 180 degrees; count these pieces.

    Only they are merged: a union of all would take seconds and merge polygons that merely touch.
    """
    if len(polygons) == 0:
        return polygons, 0
    xmin, _, xmax, _ = shapely.bounds(polygons).T
    at_seam = ((xmin % 360 == 180) | (xmax % 360 == 180)) & (xmax - xmin < 360)
    if not at_seam.any():
        return polygons, 0
    merged = extract_polygons(np.array([shapely.union_all(polygons[at_seam])], dtype=object))
    return np.concatenate([polygons[~at_seam], merged]), int(at_seam.sum())
