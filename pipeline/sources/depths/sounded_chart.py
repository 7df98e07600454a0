"""A chart of land with a grid of depths: what is too shallow for the vessel is no-go as well."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from pipeline._types import Geometries
from pipeline.errors import RequestError
from pipeline.geo.earth import METRES_PER_DEGREE
from pipeline.geo.known_cells import DepthCover, KnownCells
from pipeline.machine.storage.store import file_hash
from pipeline.model import Credit, Land, Zone
from pipeline.model.notes import Note
from pipeline.sources.depths.depth_file import DepthFile, Heights, name_of
from pipeline.sources.depths.shallow_water import shallow_polygons
from pipeline.sources.interfaces import LandSource
from pipeline.sources.land.polygons import box_around
from pipeline.sources.quality.field import LandMask

# Size in bytes above which a file is identified by its name, size and time of change, not by its
# content: reading the whole of GEBCO, 7 GB, takes half a minute.
_MAX_HASHED_BYTES = 500 << 20
# Number of places along each side of the region at which heights are compared with the chart's
# land; least number of places in water; largest share of those that may lie above the sea.
_PLACES, _MIN_PLACES, _MAX_DRY_SHARE = 60, 30, 0.5
# A note is given if more than this share of the region has no depths.
_MIN_NOTED_SHARE = 0.005


@dataclass(frozen=True)
class SoundedChart:
    """Land of any source, with depths from a file; `safety_depth_m` is draught plus clearance."""

    chart: LandSource
    file: DepthFile
    safety_depth_m: float

    @property
    def identity(self) -> tuple[str, ...]:
        """The land's identity, the safety depth, and the file's hash."""
        path = self.file.path
        status = path.stat()
        digest = _hash(path, status.st_size, status.st_mtime_ns)
        return (*self.chart.identity, "depths", f"{self.safety_depth_m!r}", digest)

    def land(self, region: Polygon) -> Land:
        """Return the land near a region (lon/lat degrees), and the water that is too shallow.

        Raises
        ------
        RequestError
            The source of the land raises it; or the file covers nothing of the region, is damaged,
            or puts most of the water above the sea.
        """
        land = self.chart.land(region)
        heights = self.file.heights(box_around(region).bounds)
        name = name_of(self.file.path)
        if heights is None or not _covered_share(heights, region):
            fault = (
                f"chart.depths: {name} covers nothing of the region; give a grid of the region, or "
                "leave depths out"
            )
            raise RequestError([fault])
        self._check_sign(heights, land, region)
        shallow = shallow_polygons(heights, self.safety_depth_m)
        rule = f"shallower than {self.safety_depth_m:g} m"
        shoal = Zone("shoal", name, rule, _without_land(shallow, land))
        cells = KnownCells(heights.lon, heights.lat, np.isfinite(heights.height_m))
        areas = land.depths.areas if land.depths else ()
        return replace(
            land,
            polygons=(*land.polygons, *shallow.tolist()),
            credits=(*land.credits, self._credit()),
            notes=(*land.notes, *self._notes(heights, region)),
            zones=(*land.zones, shoal),
            depths=DepthCover(areas, cells),
        )

    def _credit(self) -> Credit:
        """Credit from the file's own attributes."""
        name = self.file.title or f"{name_of(self.file.path)}, user's file"
        return Credit(name, "land", f"Depths: {name}", self.file.licence)

    def _notes(self, heights: Heights, region: Polygon) -> Iterator[Note]:
        """Yield a note on what is no-go by depth, and one if part of the region has no depths."""
        name, cell_m = name_of(self.file.path), _cell_m(heights)
        depth_m = self.safety_depth_m
        yield Note.of("depths-no-go", source=name, safety_depth_m=depth_m, cell_m=cell_m)
        lacking = 1 - _covered_share(heights, region)
        if lacking > _MIN_NOTED_SHARE:
            yield Note.of("depths-lacking", source=name, share=lacking)

    def _check_sign(self, heights: Heights, land: Land, region: Polygon) -> None:
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
        known = np.isfinite(height_m) & ~LandMask.from_land(land, region.bounds).on_grid(lon, lat)
        dry = float((height_m[known] > 0).mean()) if known.sum() >= _MIN_PLACES else 0.0
        if dry > _MAX_DRY_SHARE:
            sign = "up" if self.file.sign > 0 else "down"
            fault = (
                f"chart.depths: by {name_of(self.file.path)}, {dry:.0%} of the region's water lies "
                f"above the sea: {self.file.variable} is read as positive {sign}, but may be "
                f"positive {'down' if self.file.sign > 0 else 'up'}, or belong to another place; "
                "set its attribute 'positive', or its standard name"
            )
            raise RequestError([fault])


@lru_cache(maxsize=8)
def _hash(path: Path, size: int, changed_ns: int) -> str:
    """SHA-256 of a file; of its name, size and time of change where it is large."""
    if size <= _MAX_HASHED_BYTES:
        return file_hash(path)
    return hashlib.sha256(f"{path.name} {size} {changed_ns}".encode()).hexdigest()


def _cell_m(heights: Heights) -> float:
    """Return the longer side of a cell, true metres."""
    up = float(np.diff(heights.lat).max())
    across = float(np.diff(heights.lon).max() * np.cos(np.radians(np.abs(heights.lat).min())))
    return max(up, across) * METRES_PER_DEGREE


def _covered_share(heights: Heights, region: Polygon) -> float:
    """Return the share of a region's places at which the depth is known."""
    west, south, east, north = region.bounds
    steps = (np.arange(200) + 0.5) / 200
    lon, lat = np.meshgrid(west + steps * (east - west), south + steps * (north - south))
    inside = shapely.contains_xy(region, lon.ravel(), lat.ravel())
    points = np.stack([lon.ravel(), lat.ravel()], axis=-1)[inside]
    cells = KnownCells(heights.lon, heights.lat, np.isfinite(heights.height_m))
    return float(cells.at(points).mean()) if len(points) else 0.0


def _without_land(shallow: Geometries, land: Land) -> BaseGeometry:
    """Return the part of shallow polygons that is water, for maps."""
    ground = np.array(land.polygons, dtype=object)
    meets = np.unique(shapely.STRtree(ground).query(shallow, predicate="intersects")[1])
    dry = shapely.disjoint_subset_union_all(ground[meets])
    parts = shapely.get_parts(shapely.difference(shapely.multipolygons(shallow), dry))
    return shapely.multipolygons(parts[shapely.area(parts) > 0])
