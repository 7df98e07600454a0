"""OpenStreetMap land for any region, offline, from the package `roaring-landmask`.

The package has GSHHG, an older shoreline of other origin, too: land to compare routes with.

It is simplified by the package's makers to 0.0005 degrees, and cut at 180 degrees.
"""

from dataclasses import dataclass, replace
from importlib.metadata import version

import numpy as np
import shapely
from shapely.geometry import Polygon

from pipeline._types import Geometries
from pipeline.model import Credit, Land
from pipeline.model.notes import Note
from pipeline.sources.land.polygons import (
    BEYOND_M,
    box_around,
    clipped,
    extract_polygons,
    repair_note,
    repaired,
)
from pipeline.sources.land.world import NAME, NearPolygons, Shoreline, polygons_near

# Accuracy of the coast, m: it is simplified by 0.0005 degrees, 55.7 m along a meridian.
ACCURACY_M = 60.0


@dataclass(frozen=True, slots=True)
class LandPolygons:
    """Valid polygons in lon/lat degrees near a region, and what was done to them.

    `repaired` counts invalid polygons made valid, `duplicates` those dropped because they came
    twice, and `seam_pieces` the pieces cut at 180 degrees that were joined. `notes` are those on
    reading.
    """

    polygons: tuple[Polygon, ...]
    repaired: int
    duplicates: int
    seam_pieces: int
    notes: tuple[Note, ...] = ()


def land(region: Polygon, beyond_m: float = BEYOND_M) -> Land:
    """Return the land near a region with its credit, as the fetch stage passes it on."""
    found, second = (land_polygons(region, beyond_m, shoreline) for shoreline in ("Osm", "Gshhg"))
    return Land(
        found.polygons,
        (credit(),),
        ACCURACY_M,
        notes=(*found.notes, *repair_note("OpenStreetMap land", found.repaired)),
        second_shore=second.polygons,
    )


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


def land_polygons(
    region: Polygon, beyond_m: float = BEYOND_M, shoreline: Shoreline = "Osm"
) -> LandPolygons:
    """Return OpenStreetMap's land near a region, or that of another shoreline.

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
    box = box_around(region, beyond_m)
    near, notes = polygons_near(shoreline, box)
    return replace(clean(near, box), notes=notes)


def clean(near: NearPolygons, box: Polygon) -> LandPolygons:
    """Repair polygons, clip them to the box, drop duplicates and join pieces at 180 degrees."""
    valid, repairs = repaired(*near)
    parts = clipped(valid, box)
    distinct = np.array(list(dict.fromkeys(parts.tolist())), dtype=object)
    joined, seam_pieces = _joined_at_180(distinct)
    return LandPolygons(
        polygons=tuple(joined.tolist()),
        repaired=repairs,
        duplicates=len(parts) - len(distinct),
        seam_pieces=seam_pieces,
    )


def _joined_at_180(polygons: Geometries) -> tuple[Geometries, int]:
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


@dataclass(frozen=True)
class OsmLand:
    """The world's land from the package `roaring-landmask`; always available, no network."""

    @property
    def identity(self) -> tuple[str, ...]:
        """Release of the package: its data change with it."""
        return ("osm-land", version("roaring-landmask"))

    def land(self, region: Polygon) -> Land:
        """Return the land near a region (lon/lat degrees)."""
        return land(region)
