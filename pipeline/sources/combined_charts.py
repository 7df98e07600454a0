"""Charts made of others: several as one, or one with a grid of depths.

An area that any of several charts forbids is no-go. With depths, water too shallow for the vessel
is no-go as well: the grid's cells that are too shallow, and one cell around them, as polygons.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from pathlib import Path

import numpy as np
import shapely
from contourpy import FillType, contour_generator
from scipy import ndimage

from pipeline._types import BoolArray, FloatArray, Geometries
from pipeline.errors import RequestError
from pipeline.geo.lonlat import METRES_PER_DEGREE, DepthCover, KnownCells
from pipeline.machine.store import file_hash
from pipeline.model import Credit, Land, Note, Zone
from pipeline.model.depths import DepthRule, TidalWater
from pipeline.model.inputs import LandSource
from pipeline.sources.current_field import LandMask
from pipeline.sources.depth_file import DepthFile, Heights, name_of
from pipeline.sources.land import osm
from pipeline.sources.land.shapes import box_around, extract_polygons


@dataclass(frozen=True)
class Overlay:
    """One or more sources of land as one.

    `refused_m`, if given: the world's land is the second shoreline, and how far inside it a route
    is refused, besides the accuracy of the sources, m.
    """

    sources: tuple[LandSource, ...]
    refused_m: float | None = None

    @property
    def identity(self) -> tuple[str, ...]:
        """The identities of all sources, in their order."""
        parts = tuple(part for source in self.sources for part in (*source.identity, ""))
        return (*parts, f"{self.refused_m}", *osm.OsmLand().identity)

    def land(self, region: shapely.Polygon) -> Land:
        """Return the land of all sources near a region (lon/lat degrees)."""
        land = overlay([source.land(region) for source in self.sources])
        if self.refused_m is None:
            return land
        shore, limit_m = osm.land_polygons(region).polygons, self.refused_m + land.accuracy_m
        return replace(land, second_shore=shore, refused_m=limit_m)


def overlay(lands: Sequence[Land]) -> Land:
    """Combine charts: areas that any of them forbids, or none of them covers, are no-go.

    The least accurate chart sets the accuracy of the coast.
    """
    zones = [zone for land in lands for zone in land.zones if zone.kind != "uncharted"]
    blank = reduce(
        shapely.intersection,
        (
            shapely.union_all([zone.area for zone in land.zones if zone.kind == "uncharted"])
            for land in lands
        ),
    )
    uncharted = extract_polygons(blank)
    if len(uncharted):
        zones.append(Zone("uncharted", "", "no chart covers it", shapely.union_all(uncharted)))
    return Land(
        polygons=(*(polygon for land in lands for polygon in land.polygons), *uncharted.tolist()),
        credits=tuple(dict.fromkeys(credit for land in lands for credit in land.credits)),
        accuracy_m=max(land.accuracy_m for land in lands),
        notes=tuple(dict.fromkeys(note for land in lands for note in land.notes)),
        zones=tuple(zones),
        second_shore=tuple(polygon for land in lands for polygon in land.second_shore),
        places=tuple(place for land in lands for place in land.places),
        depths=_depths(lands),
        depth_areas=tuple(area for land in lands for area in land.depth_areas),
        tidal_water=tuple(area for land in lands for area in land.tidal_water),
        datum=" and ".join(sorted({land.datum for land in lands if land.datum})),
    )


def _depths(lands: Sequence[Land]) -> DepthCover | None:
    """Return where any chart has depths; None if no chart has any."""
    found = [land.depths for land in lands if land.depths is not None]
    return DepthCover(tuple(area for one in found for area in one.areas)) if found else None


# Size in bytes above which a file is identified by its name, size and time of change, not by its
# content: reading the whole of GEBCO, 7 GB, takes half a minute.
_MAX_HASHED_BYTES = 500 << 20
# Number of places along each side of the region at which heights are compared with the chart's
# land; least number of places in water; largest share of such places that may lie above the sea.
_PLACES, _MIN_PLACES, _MAX_DRY_SHARE = 60, 30, 0.5
# Depth range, m, of a band of tidal water, for all of which the same height of tide is required.
_BAND_M = 0.25
# A note is given if more than this share of the region has no depths.
_MIN_NOTED_SHARE = 0.005


@dataclass(frozen=True)
class SoundedChart:
    """Land of any source, with depths from a file; `rule` says which are deep enough."""

    chart: LandSource
    file: DepthFile
    rule: DepthRule

    @property
    def identity(self) -> tuple[str, ...]:
        """The land's identity, the rule of depths, and the file's hash."""
        path = self.file.path
        status = path.stat()
        digest = _hash(path, status.st_size, status.st_mtime_ns)
        return (*self.chart.identity, "depths", f"{self.rule!r}", digest)

    def land(self, region: shapely.Polygon) -> Land:
        """Return the land near a region (lon/lat degrees), and the water that is too shallow.

        Raises
        ------
        RequestError
            The source of the land is at fault; or the file of depths covers nothing of the region,
            is damaged, or puts most of the water above the sea.
        """
        land = self.chart.land(region)
        heights = self.file.heights(box_around(region).bounds)
        name = name_of(self.file.path)
        if heights is None or not _covered_share(heights, region):
            raise RequestError(
                f"chart.depths: {name} covers nothing of the region; give a grid of the region, or "
                "leave depths out"
            )
        self._check_sign(heights, land, region)
        shallow = shallow_polygons(heights, self.rule.least_m)
        text = f"shallower than {self.rule.least_m:.3g} m"
        shoal = Zone("shoal", name, text, _without_land(shallow, land))
        cells = KnownCells(heights.lon, heights.lat, np.isfinite(heights.height_m))
        areas = land.depths.areas if land.depths else ()
        return replace(
            land,
            polygons=(*land.polygons, *shallow.tolist()),
            credits=(*land.credits, self._credit()),
            notes=(*land.notes, *self._notes(heights, region)),
            zones=(*land.zones, shoal),
            depths=DepthCover(areas, cells),
            tidal_water=(*land.tidal_water, *_tidal_bands(heights, self.rule)),
        )

    def _credit(self) -> Credit:
        """Return the credit from the file's own attributes."""
        name = self.file.title or f"{name_of(self.file.path)}, user's file"
        return Credit(name, "land", f"Depths: {name}", self.file.licence)

    def _notes(self, heights: Heights, region: shapely.Polygon) -> Iterator[Note]:
        """Yield a note on too shallow water, and one if part of the region has no depths."""
        name, cell_m = name_of(self.file.path), _cell_m(heights)
        depth_m = self.rule.safety_depth_m
        yield Note.of("depths-no-go", source=name, safety_depth_m=depth_m, cell_m=cell_m)
        lacking = 1 - _covered_share(heights, region)
        if lacking > _MIN_NOTED_SHARE:
            yield Note.of("depths-lacking", source=name, share=lacking)

    def _check_sign(self, heights: Heights, land: Land, region: shapely.Polygon) -> None:
        """Refuse heights by which most of the chart's water lies above the sea."""
        west, south, east, north = region.bounds
        lon, lat = (
            axis[(axis >= low) & (axis <= high)]
            for axis, low, high in ((heights.lon, west, east), (heights.lat, south, north))
        )
        lon, lat = (axis[:: max(1, axis.size // _PLACES)] for axis in (lon, lat))
        if not (lon.size and lat.size):
            return
        rows, columns = np.searchsorted(heights.lat, lat), np.searchsorted(heights.lon, lon)
        height_m = heights.height_m[np.ix_(rows, columns)]
        known = np.isfinite(height_m) & ~LandMask.of(land.polygons, region.bounds).on_grid(lon, lat)
        dry = float((height_m[known] > 0).mean()) if known.sum() >= _MIN_PLACES else 0.0
        if dry > _MAX_DRY_SHARE:
            sign = "up" if self.file.sign > 0 else "down"
            raise RequestError(
                f"chart.depths: by {name_of(self.file.path)}, {dry:.0%} of the region's water lies "
                f"above the sea: {self.file.variable} is read as positive {sign}, but may be "
                f"positive {'down' if self.file.sign > 0 else 'up'}, or belong to another place; "
                "set its attribute 'positive', or its standard name"
            )


@lru_cache(maxsize=8)
def _hash(path: Path, size: int, changed_ns: int) -> str:
    """Return the SHA-256 of a file; of its name, size and time of change where it is large."""
    if size <= _MAX_HASHED_BYTES:
        return file_hash(path)
    return hashlib.sha256(f"{path.name} {size} {changed_ns}".encode()).hexdigest()


def _cell_m(heights: Heights) -> float:
    """Return the longer side of a cell, true metres."""
    up = float(np.diff(heights.lat).max())
    across = float(np.diff(heights.lon).max() * np.cos(np.radians(np.abs(heights.lat).min())))
    return max(up, across) * METRES_PER_DEGREE


def _covered_share(heights: Heights, region: shapely.Polygon) -> float:
    """Return the share of a region's places at which the depth is known."""
    west, south, east, north = region.bounds
    steps = (np.arange(200) + 0.5) / 200
    lon, lat = np.meshgrid(west + steps * (east - west), south + steps * (north - south))
    inside = shapely.contains_xy(region, lon.ravel(), lat.ravel())
    points = np.stack([lon.ravel(), lat.ravel()], axis=-1)[inside]
    cells = KnownCells(heights.lon, heights.lat, np.isfinite(heights.height_m))
    return float(cells.at(points).mean()) if len(points) else 0.0


def _without_land(shallow: Geometries, land: Land) -> shapely.Geometry:
    """Return the part of shallow polygons that is water, for maps."""
    ground = np.array(land.polygons, dtype=object)
    meets = np.unique(shapely.STRtree(ground).query(shallow, predicate="intersects")[1])
    dry = shapely.disjoint_subset_union_all(ground[meets])
    parts = shapely.get_parts(shapely.difference(shapely.multipolygons(shallow), dry))
    return shapely.multipolygons(parts[shapely.area(parts) > 0])


# Rings of cells that are added around a grid.
_RINGS = 2
# Distance below which the points of an outline are on one line, as a share of a cell.
_STRAIGHT = 1e-6


def shallow_polygons(heights: Heights, safety_depth_m: float) -> Geometries:
    """Return valid polygons (lon/lat degrees) of shallower water and land, and one cell around."""
    with np.errstate(invalid="ignore"):
        return _polygons_around(heights, heights.height_m > -safety_depth_m)


def _tidal_bands(heights: Heights, rule: DepthRule) -> Iterator[TidalWater]:
    """Yield the water that is deep enough for some hours only, in bands of depth.

    A band needs the tide that its shallowest water needs.
    """
    deepest = rule.safety_depth_m - rule.tide.lowest_m
    depth = -heights.height_m
    for least in np.arange(rule.least_m, deepest, _BAND_M).tolist():
        with np.errstate(invalid="ignore"):
            is_in = (depth >= least) & (depth < min(least + _BAND_M, deepest))
        for area in _polygons_around(heights, is_in):
            yield TidalWater(
                f"depth {least:.2f} to {least + _BAND_M:.2f} m", rule.need_m(least), area
            )


def _polygons_around(heights: Heights, cells: BoolArray) -> Geometries:
    """Return valid polygons (lon/lat degrees) of some cells of a grid, and of one cell around.

    The outline is the contour halfway between nodes inside and nodes outside. It lies one cell off
    each of the cells, and cuts the corners.
    """
    if not cells.any():
        return np.empty(0, dtype=object)
    # One ring is for cells around shallow ones at the edge, the other closes the outlines.
    taken = ndimage.binary_dilation(np.pad(cells, _RINGS), np.ones((3, 3)))
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
    # A polygon is invalid if two outlines meet in a point.
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
