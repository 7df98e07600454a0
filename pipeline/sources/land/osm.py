"""OpenStreetMap land for any region, offline, from the package `roaring-landmask`.

It is simplified by the package's makers to 0.0005 degrees, and cut at 180 degrees. The package has
GSHHG, an older shoreline of other origin, too: land to compare routes with.

The package carries each of its shorelines as one WKB MultiPolygon: OpenStreetMap's has 745,676
whole polygons (cut at 180 degrees only), 9.6 million vertices, 154 MB. To unpack it and walk
through it takes seconds and a gigabyte. So this is done once. The unchanged polygons go into a file
in the user's cache, after a table of their bounds and validity: checking the validity of a
continent's polygons again would take a second. From the file a region is read in some 40 ms.

FlatGeobuf was measured (GDAL 3.12): a region is read as fast, but the file has no checksum, so that
a flipped bit would be land in another place. GDAL takes all polygons at once only: making its file
takes 1.25 GB of memory, making this one 0.7 GB, and the container for a night has 1 GiB.

The file is named by the package's release and the format's version; several processes may make it
at once. The table and each polygon have a checksum: a damaged file is made again. Where the cache
can't be written, the package is read each time, and a note says so.
"""

import contextlib
import math
import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from itertools import compress
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt
import shapely

from pipeline._types import BoolArray, FloatArray, Geometries, IntArray
from pipeline.geo.projection import METRES_PER_DEGREE
from pipeline.machine.files import UNFINISHED, remove_abandoned, whole_file
from pipeline.model import Credit, Land, Note
from pipeline.sources.land import shapes
from pipeline.sources.land.shapes import box_around, clipped, extract_polygons, repaired
from renew._compiled import user_cache

Shoreline = Literal["Osm", "Gshhg"]
"""The package's shorelines, by its own names: of OpenStreetMap, and the older GSHHG."""

NAME = "roaring-landmask"
_FORMAT = 2
_HEAD = struct.Struct("<16sQI")
_MAGIC = b"RENEW shoreline\n"
# Bounds of a polygon, degrees; the end of its WKB after the table, bytes; the checksum of its WKB;
# whether it is valid.
_ENTRY = np.dtype([("bounds", "<f8", 4), ("end", "<u8"), ("crc", "<u4"), ("is_valid", "?")])
# Age after which an unfinished file is that of a killed process, s.
_ABANDONED_S = 3600.0

# Size of a polygon's WKB above which it is kept for the next region, bytes: a voyage reads land a
# dozen times, and a continent takes 40 ms. What is kept takes up to 50 MB, until it is cleared.
_LARGE = 2_000_000
# Number of polygons built at a time: 20,000 are 250,000 vertices on average, some 30 MB.
_CHUNK = 20_000

# WKB (OGC 06-103r4, 8.2), little endian: byte order 1, type 6 MultiPolygon, number of polygons;
# then for each of them byte order, type 3, number of rings; for each ring its number of points,
# and the points as two float64 each.
_MULTIPOLYGON = b"\x01" + struct.pack("<I", 6)
_COUNT = struct.Struct("<I")
_HEADER = len(_MULTIPOLYGON)
_POINT = 16


NearPolygons: TypeAlias = tuple[Geometries, BoolArray]
"""Polygons (n,) of a shoreline near a box, not repaired, and whether each is valid (n,)."""


def polygons_near(
    shoreline: Shoreline, box: shapely.Polygon, least_deg: float = 0.0
) -> tuple[NearPolygons, tuple[Note, ...]]:
    """Return a shoreline's polygons whose bounds meet a box (degrees), unchanged, and notes.

    They are moved by whole turns into the box's longitudes; one that meets the box after two
    different moves comes twice. Those whose longer side is below `least_deg` are left out.
    """
    path, problem = cache_file(shoreline), "there is no home"
    if path is not None:
        if (near := read_cached(path, box, least_deg)) is not None:
            return near, ()
        try:
            write_cached(path, unpacked(shoreline))
        except OSError as error:
            problem = f"{path.parent}: {error.strerror or error}"
        else:
            near = read_cached(path, box, least_deg)
            if near is not None:
                return near, ()
            problem = f"{path} is damaged as soon as it is written"
    return read_near(unpacked(shoreline), box, least_deg), (
        Note.of("land-not-cached", problem=problem),
    )


def cache_file(shoreline: Shoreline) -> Path | None:
    """Return the path of a shoreline's file, whether it exists or not; None without a home."""
    folder = user_cache()
    if folder is None:
        return None
    return folder / f"{shoreline.lower()}-{version(NAME)}-{_FORMAT}.shoreline"


def remove_cached() -> int:
    """Remove the files of all shorelines and releases; return their size in bytes."""
    folder, freed = user_cache(), 0
    for path in folder.glob("*.shoreline*") if folder is not None else ():
        with contextlib.suppress(OSError):
            size = path.stat().st_size
            path.unlink()
            freed += size
    return freed


def unpacked(shoreline: Shoreline) -> bytes:
    """Return a shoreline as the package has it."""
    # Imported late: loading its library of 110 MB takes a moment that `renew --help` must not.
    from roaring_landmask import LandmaskProvider, Shapes

    wkb: bytes = Shapes.wkb(getattr(LandmaskProvider, shoreline))
    return wkb


def read_near(wkb: bytes, box: shapely.Polygon, least_deg: float = 0.0) -> NearPolygons:
    """Return what `polygons_near` does from a WKB MultiPolygon, without a file."""
    near = [
        polygons[_near(shapely.bounds(polygons), box, least_deg)] for polygons, _, _ in _chunks(wkb)
    ]
    polygons, _ = shapes.near_box(np.concatenate([np.empty(0, dtype=object), *near]), box)
    return polygons, shapely.is_valid(polygons)


def _near(bounds: FloatArray, box: shapely.Polygon, least_deg: float) -> IntArray:
    """Return the indices of bounds (n, 4) that meet a box, and are not below `least_deg`."""
    # By latitude first: this leaves few of the 745,676 polygons.
    _, south, _, north = box.bounds
    near = np.flatnonzero((bounds[:, 1] <= north) & (bounds[:, 3] >= south))
    near = near[shapes.meets_box(bounds[near], box)]
    sides = bounds[near, 2:] - bounds[near, :2]
    return np.asarray(near[sides.max(axis=1, initial=0.0) >= least_deg])


def write_cached(path: Path, wkb: bytes) -> None:
    """Write the polygons of a WKB MultiPolygon, with a table of their bounds.

    Raises OSError if the file can't be written; nothing is left of it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_abandoned(path.parent, f"*.shoreline.*{UNFINISHED}", _ABANDONED_S)
    table = np.zeros(_COUNT.unpack_from(wkb, _HEADER)[0], dtype=_ENTRY)
    first = 0
    with whole_file(path) as file:
        file.seek(_HEAD.size + table.nbytes)
        for polygons, begins, end in _chunks(wkb):
            ends = np.append(begins[1:], end)
            entries = table[first : first + len(begins)]
            entries["bounds"] = shapely.bounds(polygons)
            entries["is_valid"] = shapely.is_valid(polygons)
            entries["end"] = ends - (_HEADER + _COUNT.size)
            spans = zip(begins.tolist(), ends.tolist(), strict=True)
            entries["crc"] = [zlib.crc32(wkb[a:b]) for a, b in spans]
            file.write(wkb[begins[0] : end])
            first += len(begins)
        file.seek(0)
        content = table.tobytes()
        file.write(_HEAD.pack(_MAGIC, len(table), zlib.crc32(content)) + content)


def read_cached(path: Path, box: shapely.Polygon, least_deg: float = 0.0) -> NearPolygons | None:
    """Return what `polygons_near` does from a file; None where it is absent or damaged."""
    try:
        with path.open("rb") as file:
            magic, count, crc = _HEAD.unpack(file.read(_HEAD.size).ljust(_HEAD.size, b"\0"))
            size = os.fstat(file.fileno()).st_size - _HEAD.size
            if magic != _MAGIC or count * _ENTRY.itemsize > size:
                return None
            table = np.fromfile(file, dtype=_ENTRY, count=count)
            size -= table.nbytes
            if zlib.crc32(table.data) != crc or (count and int(table["end"][-1]) != size):
                return None
            content = np.memmap(file, dtype=np.uint8, mode="r", offset=_HEAD.size + table.nbytes)
    except (OSError, ValueError):  # absent; a map of an empty file
        return None
    near = _near(table["bounds"], box, least_deg)
    ends = table["end"][near].astype(np.int64)
    begins = np.where(near > 0, table["end"][near - 1], 0).astype(np.int64)
    spans = list(zip(begins.tolist(), ends.tolist(), table["crc"][near].tolist(), strict=True))
    first, is_large = _HEAD.size + table.nbytes, ends - begins > _LARGE
    geometries = np.empty(len(near), dtype=object)
    try:
        geometries[~is_large] = shapely.from_wkb(
            [_checked(content[a:b], crc) for a, b, crc in compress(spans, ~is_large)]
        )
        geometries[is_large] = [
            large_polygon(path, first + a, first + b, crc)
            for a, b, crc in compress(spans, is_large)
        ]
    except ValueError:
        return None
    polygons, index = shapes.near_box(geometries, box)
    return polygons, table["is_valid"][near][index]


@lru_cache(maxsize=6)
def large_polygon(path: Path, begin: int, end: int, crc: int) -> shapely.Geometry:
    """Return the polygon between two bytes of a file; ValueError where it is damaged."""
    content = np.memmap(path, dtype=np.uint8, mode="r", offset=begin, shape=(end - begin,))
    return shapely.from_wkb(_checked(content, crc))


def _checked(content: npt.NDArray[np.uint8], crc: int) -> bytes:
    """Return some bytes of a file; ValueError where they have another checksum."""
    text = content.tobytes()
    if zlib.crc32(text) != crc:
        raise ValueError("damaged")
    return text


def _chunks(wkb: bytes) -> Iterator[tuple[Geometries, IntArray, int]]:
    """Yield a MultiPolygon's polygons, a few at a time to save memory.

    With them come the bytes at which they begin, and at which the last one ends.
    """
    total: int = _COUNT.unpack_from(wkb, _HEADER)[0]
    position = _HEADER + _COUNT.size
    for first in range(0, total, _CHUNK):
        begins = []
        for _ in range(min(_CHUNK, total - first)):
            begins.append(position)
            rings = _COUNT.unpack_from(wkb, position + _HEADER)[0]
            position += _HEADER + _COUNT.size
            for _ring in range(rings):
                position += _COUNT.size + _POINT * _COUNT.unpack_from(wkb, position)[0]
        head = _MULTIPOLYGON + _COUNT.pack(len(begins))
        polygons = shapely.get_parts(shapely.from_wkb(head + wkb[begins[0] : position]))
        yield polygons, np.array(begins), position


# Accuracy of the coast, m: it is simplified by 0.0005 degrees, 55.7 m along a meridian.
ACCURACY_M = 60.0


def land_polygons(
    region: shapely.Polygon, beyond_m: float = shapes.BEYOND_M, shoreline: Shoreline = "Osm"
) -> Land:
    """Return OpenStreetMap's land near a region, or that of another shoreline.

    The region is in lon/lat degrees, continuous across 180 (170 to 190). Land is kept up to
    `beyond_m` outside its bounds (true metres, about); mainland is cut along that box. Returns
    valid polygons, in the region's own longitudes, and whole unless they cross the box: pieces that
    the source cuts at 180 degrees are joined again.
    """
    box = shapes.box_around(region, beyond_m)
    near, notes = polygons_near(shoreline, box)
    polygons, repairs = clean(near, box)
    notes = (*notes, *shapes.repair_note("OpenStreetMap land", repairs))
    release = version(NAME)
    # The Open Database License asks for this credit line.
    credit = Credit(
        name=f"OpenStreetMap land polygons (roaring-landmask {release})",
        kind="land",
        text=f"© OpenStreetMap contributors, land polygons via roaring-landmask {release}",
        licence="ODbL 1.0",
        url="https://www.openstreetmap.org/copyright",
    )
    return Land(tuple(polygons.tolist()), (credit,), ACCURACY_M, notes)


def clean(near: NearPolygons, box: shapely.Polygon) -> tuple[Geometries, int]:
    """Repair polygons, clip them to the box, drop duplicates and join pieces at 180 degrees.

    The number of those that were invalid is returned, too.
    """
    valid, repairs = shapes.repaired(*near)
    distinct = dict.fromkeys(shapes.clipped(valid, box).tolist())
    return _joined_at_180(np.array(list(distinct), dtype=object)), repairs


def _joined_at_180(polygons: Geometries) -> Geometries:
    """Join the polygons with an edge on an odd multiple of 180 degrees.

    Only they are merged: a union of all would take seconds and merge polygons that merely touch.
    """
    if len(polygons) == 0:
        return polygons
    xmin, _, xmax, _ = shapely.bounds(polygons).T
    at_seam = ((xmin % 360 == 180) | (xmax % 360 == 180)) & (xmax - xmin < 360)
    if not at_seam.any():
        return polygons
    merged = shapes.extract_polygons(shapely.union_all(polygons[at_seam]))
    return np.concatenate([polygons[~at_seam], merged])


@dataclass(frozen=True)
class OsmLand:
    """The world's land from the package `roaring-landmask`; always available, no network."""

    @property
    def identity(self) -> tuple[str, ...]:
        """Release of the package: its data change with it."""
        return ("osm-land", version(NAME))

    def land(self, region: shapely.Polygon) -> Land:
        """Return the land near a region (lon/lat degrees), with GSHHG as the second shoreline."""
        second = land_polygons(region, shoreline="Gshhg")
        return replace(land_polygons(region), second_shore=second.polygons)


# Distance outside the region's bounds up to which maps show land, as a share of the longer side: a
# sheet of paper is at most that much wider than a tall region.
_REACH = 0.75
# Detail, as a share of the longer side: a quarter of a millimetre on a sheet with the region on it.
_DETAIL = 1e-3


def surroundings(region: shapely.Polygon) -> tuple[shapely.Polygon, ...]:
    """Return the land outside a region's bounds (lon/lat degrees), coarse.

    It reaches over the land that the sources fetch around the region, so that the two can be joined
    on maps without a gap.
    """
    west, south, east, north = region.bounds
    across = (east - west) * math.cos(math.radians((south + north) / 2))
    side_deg = max(across, north - south)
    wide = box_around(region, _REACH * side_deg * METRES_PER_DEGREE)
    detail = _DETAIL * side_deg
    near, _ = polygons_near("Osm", wide, least_deg=detail)
    # Clipped first: a continent has millions of vertices.
    cut = shapely.clip_by_rect(repaired(*near)[0], *wide.bounds)
    coarse = shapely.simplify(cut, detail, preserve_topology=False)
    valid = clipped(extract_polygons(repaired(coarse)[0]), wide)
    box = shapely.box(*region.bounds)
    reaches_in = shapely.intersects(box, valid)
    beyond = extract_polygons(shapely.difference(valid[reaches_in], box))
    return tuple(np.concatenate([valid[~reaches_in], beyond]).tolist())
