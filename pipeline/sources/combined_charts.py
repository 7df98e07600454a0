"""Charts made of other charts: several as one, or one with a grid of depths from a file.

An area that any of several charts forbids is no-go. With depths, water too shallow for the vessel
is no-go as well: the grid's cells that are too shallow, and one cell around them, as polygons.

A file of depths follows the CF conventions, as those of GEBCO and EMODnet do, or is S-102.
The variable is found by its standard name, else by its name. GEBCO's `elevation` is
positive up, in metres, and so is EMODnet's; a depth is positive down, unless its attribute
`positive` says otherwise. Of points on curved lines, as those of S-102 in UTM, the highest around
each node of a table counts.
"""

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from pathlib import Path

import numpy as np
import shapely
from contourpy import FillType, contour_generator
from scipy import ndimage

from pipeline._types import BoolArray, DataArray, Dataset, FloatArray, Geometries
from pipeline.errors import RequestError, naming
from pipeline.geo.projection import METRES_PER_DEGREE, Bounds, DepthCover, KnownCells
from pipeline.machine.paths import require_readable, shown
from pipeline.machine.store import file_hash
from pipeline.model import Credit, Land, Note, Zone
from pipeline.model.inputs import DepthRule, LandSource, TidalWater
from pipeline.sources.cf import grids
from pipeline.sources.cf.axes import grid_fault
from pipeline.sources.cf.dataset import check_values, fatal_files, open_dataset, reading
from pipeline.sources.cf.fields import find_window
from pipeline.sources.cf.mesh import Axes, SourceMesh
from pipeline.sources.cf.s100 import option_of
from pipeline.sources.current_field import LandMask
from pipeline.sources.land import osm
from pipeline.sources.land.s57 import DATUMS
from pipeline.sources.land.shapes import box_around, extract_polygons, repaired

# Standard names (CF table 85) of a depth, positive down.
_DEPTHS = {
    "sea_floor_depth_below_geoid",
    "sea_floor_depth_below_mean_sea_level",
    "sea_floor_depth_below_sea_surface",
    "sea_floor_depth",
    "depth",
}
# Beginning of the standard names of a height.
_HEIGHTS = "height_above_"
# Standard names of the height above the geoid.
_ALTITUDES = {"altitude", "surface_altitude", "sea_floor_altitude"}
# Standard name of a height above the ellipsoid, which is up to 100 m off the sea's surface.
_ELLIPSOID = "height_above_reference_ellipsoid"
# GEBCO's heights have that standard name, but are above sea level: their long name says so.
_AT_SEA_LEVEL = "sea level"
# Names of variables without such a standard name, and the sign by which they become heights: of
# those of ROMS, GMT and GDAL the attribute `positive` must tell it.
_NAMES = {"elevation": 1.0, "depth": -1.0, "h": None, "z": None, "band1": None}
_SIGNS = {"up": 1.0, "down": -1.0}
_METRES = {"m", "meter", "meters", "metre", "metres"}
_REMEDY = (
    "give a GEBCO, EMODnet or ETOPO grid in NetCDF, or S-102; or name it 'elevation', in m, "
    "positive up, or a depth by its CF standard name; of a BAG give what "
    "`gdalwarp -t_srs EPSG:4326 -of netCDF` makes"
)
# Largest number of cells in a region and around it: some 300 MB while they are read.
_MAX_CELLS = 20_000_000


@dataclass(frozen=True, slots=True)
class Heights:
    """Height of the ground above the sea on a grid: `lon` (nx,), `lat` (ny,), ascending degrees.

    `height_m` (ny, nx) is in metres, NaN where the file has no figure.
    """

    lon: FloatArray
    lat: FloatArray
    height_m: FloatArray

    @property
    def cells(self) -> KnownCells:
        """Which of its cells have a figure."""
        return KnownCells(self.lon, self.lat, np.isfinite(self.height_m))


@dataclass(frozen=True)
class DepthFile:
    """A file's variable: its name and points, and the sign that makes it a height."""

    path: Path
    variable: str
    grid: Axes | SourceMesh
    sign: float
    title: str
    licence: str
    datum: str = ""

    @property
    def name(self) -> str:
        """The file's name in a note."""
        return shown(self.path.name)

    @classmethod
    def open(cls, path: Path, positive: str = "") -> "DepthFile":
        """Read names, axes and attributes of a file, but no depths.

        `positive` is "up" or "down" where the user says what the file does not. Raises RequestError
        if it can't be read, or has no depths in metres on a lon/lat grid: one line.
        """
        require_readable([path], "chart.depths")
        with naming(f"chart.depths: {path.name}"):
            if fatal := fatal_files([path]):
                raise ValueError(fatal[path])
            with open_dataset(path) as dataset:
                return _described(path, dataset, positive)

    def heights(self, bounds: Bounds) -> Heights | None:
        """Read the part in bounds (west, south, east, north); None where there are no two nodes.

        Raises RequestError if the file is damaged, or has too many cells there.
        """
        if isinstance(self.grid, SourceMesh):
            return self._highest(self.grid, bounds)
        window = find_window(self.grid.lon, self.grid.lat, bounds)
        if min(window.lon.size, window.lat.size) < 2:
            return None
        shape = (window.lat.size, window.lon.size)
        with naming(f"chart.depths: {self.path.name}"):
            if math.prod(shape) > _MAX_CELLS:
                raise ValueError(
                    f"it has {shape[0]:,} x {shape[1]:,} cells in the region, more than "
                    f"{_MAX_CELLS:,}; shrink the region, or take the shallowest of several cells "
                    "each, as with `cdo gridboxmax,4,4`"
                )
            with open_dataset(self.path) as dataset, reading():
                variable = dataset.variables[self.variable]
                height_m = self.sign * window.read(variable, self.grid.dims).reshape(shape)
        return Heights(window.lon, window.lat, np.where(np.isfinite(height_m), height_m, np.nan))

    def _highest(self, mesh: SourceMesh, bounds: Bounds) -> Heights | None:
        """Return the heights of a mesh on axes: at each node the highest around, for safety."""
        lon, lat, _, _ = mesh.axes(bounds)
        window = find_window(lon, lat, bounds) if min(lon.size, lat.size) > 1 else None
        if window is None or min(window.lon.size, window.lat.size) < 2:
            return None

        def read(part: tuple[slice, ...]) -> FloatArray:
            own = dataset.variables[self.variable]
            places = dict.fromkeys(own.dims, 0) | dict(zip(mesh.dims, part, strict=True))
            values = own.isel(places).transpose(*mesh.dims).values
            return self.sign * np.asarray(values, dtype=float)

        place = f"chart.depths: {self.path.name}"
        with naming(place), open_dataset(self.path) as dataset, reading():
            return Heights(window.lon, window.lat, mesh.highest(window.lon, window.lat, read))


def _described(path: Path, dataset: Dataset, positive: str) -> DepthFile:
    """Find the variable of an open file; ValueError where there is none that can be used."""
    name, sign = _variable(dataset)
    given = _SIGNS.get(positive)
    if sign is None:
        sign = given
    elif given not in {None, sign}:
        said = f"{name} is positive {'up' if sign > 0 else 'down'} by its name or what it says"
        raise ValueError(f"{said}, not {positive}; leave that out")
    if sign is None:
        raise ValueError(
            f"{name} does not say whether it counts up, as heights, or down, as depths; say it: "
            f"{shown(path.name)},positive=up for heights in metres (depths_positive = 'up' in a "
            "scenario's [chart]), positive=down for depths"
        )
    array = dataset[name]
    check_values(array)
    units = str(array.attrs.get("units", "m" if given else "")).strip()
    if units.lower() not in _METRES:
        raise ValueError(
            f"{name} is in {units!r}, not in m; convert it, or set its attribute 'units'"
            if units
            else f"{name} has no unit; if it is in metres, say so and which way it counts: "
            f"{shown(path.name)},positive={'up' if sign > 0 else 'down'}"
        )
    array = array.isel({dim: 0 for dim, size in array.sizes.items() if size == 1})
    grid = grids.grid_of(dataset, array, grids.coordinates(dataset, array))
    if set(array.dims) != set(grid.dims):
        raise ValueError(grid_fault(array))
    attributes = {key.lower(): value for key, value in dataset.attrs.items()}
    datum = attributes.get("verticaldatum", "")  # by its name, or its number in S-57
    return DepthFile(
        path=path,
        variable=name,
        grid=grid,
        sign=sign,
        title=attributes.get("title", ""),
        licence=attributes.get("license") or attributes.get("licence") or "",
        datum=DATUMS.get(datum, datum if datum in DATUMS.values() else ""),
    )


def _variable(dataset: Dataset) -> tuple[str, float | None]:
    """Return the name of the variable, and the sign by which it becomes a height, if it is said."""
    there = {str(name): array for name, array in dataset.data_vars.items() if array.ndim >= 2}
    signs: dict[str, float | None] = {
        name: sign for name, array in there.items() if (sign := _standard_sign(array)) is not None
    } or {
        name: _named_sign(name, array)
        for name, array in there.items()
        if name.lower() in _NAMES and array.attrs.get("standard_name") != _ELLIPSOID
    }
    named = {name: sign for name, sign in signs.items() if name.lower() in _NAMES}
    for candidates in (signs, named):
        if len(candidates) == 1:
            return next(iter(candidates.items()))
    listed = ", ".join(
        f"{name} ({array.attrs.get('standard_name') or 'no standard name'})"
        for name, array in sorted(there.items())
    )
    if signs:
        raise ValueError(f"it has several grids of depths ({listed}); keep one of them")
    hint = option_of(dataset)
    raise ValueError(f"it has no depths among {listed or 'no grids at all'}; {_REMEDY}{hint}")


def _named_sign(name: str, array: DataArray) -> float | None:
    """Return the sign of a variable by its usual name; None where nothing says it."""
    said = " ".join((name, array.attrs.get("long_name", ""))).lower()
    is_of_roms = said.startswith("h bathymetry")  # ROMS, CROCO
    usual = _SIGNS["down"] if is_of_roms else _NAMES[name.lower()]
    return _SIGNS.get(array.attrs.get("positive", "").lower(), usual)


def _standard_sign(array: DataArray) -> float | None:
    """Return the sign that a variable's standard name gives; None where it is another quantity."""
    standard = array.attrs.get("standard_name", "")
    if standard == _ELLIPSOID and _AT_SEA_LEVEL not in array.attrs.get("long_name", "").lower():
        return None
    if standard.startswith(_HEIGHTS) or standard in _ALTITUDES:
        return _SIGNS["up"]
    if standard in _DEPTHS:
        return _SIGNS.get(array.attrs.get("positive", "").lower(), _SIGNS["down"])
    return None


@dataclass(frozen=True)
class Overlay:
    """One or more sources of land as one.

    If `refused_m` is given, the world's land is the second shoreline: a route that gets further
    inside it than `refused_m` plus the accuracy of the sources, m, is refused.
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
    covers = [land.depths for land in lands if land.depths is not None]
    return Land(
        polygons=(*(polygon for land in lands for polygon in land.polygons), *uncharted.tolist()),
        credits=tuple(dict.fromkeys(credit for land in lands for credit in land.credits)),
        accuracy_m=max(land.accuracy_m for land in lands),
        notes=tuple(dict.fromkeys(note for land in lands for note in land.notes)),
        zones=tuple(zones),
        second_shore=tuple(polygon for land in lands for polygon in land.second_shore),
        places=tuple(place for land in lands for place in land.places),
        depths=DepthCover(tuple(area for cover in covers for area in cover.areas))
        if covers
        else None,
        depth_areas=tuple(area for land in lands for area in land.depth_areas),
        tidal_water=tuple(area for land in lands for area in land.tidal_water),
        datum=" and ".join(sorted({land.datum for land in lands if land.datum})),
    )


# Size in bytes above which a file is identified by its name, size and time of change, not by its
# content: reading the whole of GEBCO, 7 GB, takes half a minute.
_MAX_HASHED_BYTES = 500 << 20
# Number of places along each side of the region at which heights are compared with the land.
_PLACES = 60
# Least number of places in the chart's water by which the sign of heights is judged.
_MIN_PLACES = 30
# Height below which no sea floor lies, m.
_LOWEST_M = -11_000.0
# Values that stand for "no data", m: they do if no other is nearer than a tenth of them.
_FILLS_M = {-999.0, -9999.0}
# Largest share of the places in water that may lie above the sea.
_MAX_DRY_SHARE = 0.5
# Depth range of a band of tidal water, m; all of a band needs the tide of its shallowest water.
_BAND_M = 0.25
# A note is given if more than this share of the region has no depths.
_MIN_NOTED_SHARE = 0.005


@dataclass(frozen=True)
class SoundedChart:
    """Land of any source, with depths from a file; `rule` says which are deep enough.

    `datum` is that of the file's depths, "" if neither the file nor the scenario says it.
    """

    chart: LandSource
    file: DepthFile
    rule: DepthRule
    datum: str

    @property
    def identity(self) -> tuple[str, ...]:
        """The land's identity, the rule of depths, and the file's hash."""
        path = self.file.path
        status = path.stat()
        digest = _hash(path, status.st_size, status.st_mtime_ns)
        said = f"{self.file.sign:g} {self.datum}"
        return (*self.chart.identity, "depths", f"{self.rule!r}", said, digest)

    def land(self, region: shapely.Polygon) -> Land:
        """Return the land near a region (lon/lat degrees), and the water that is too shallow.

        Raises RequestError if the source of the land is at fault; or the file of depths covers
        nothing of the region, is damaged, or has depths that can't be.
        """
        land = self.chart.land(region)
        heights = self.file.heights(box_around(region).bounds)
        name = self.file.name
        if heights is None or not _covered_share(heights, region):
            raise RequestError(
                f"chart.depths: {name} covers nothing of the region; give a grid of the region, or "
                "leave depths out"
            )
        self._check_lowest(heights.height_m)
        self._check_sign(heights, land, region)
        shallow = shallow_polygons(heights, self.rule.least_m)
        text = f"shallower than {self.rule.least_m:.3g} m"
        shoal = Zone("shoal", name, text, _without_land(shallow, land))
        areas = land.depths.areas if land.depths else ()
        title = self.file.title or f"{name}, user's file"
        return replace(
            land,
            polygons=(*land.polygons, *shallow.tolist()),
            credits=(*land.credits, Credit(title, "land", f"Depths: {title}", self.file.licence)),
            notes=(*land.notes, *self._notes(heights, region)),
            zones=(*land.zones, shoal),
            depths=DepthCover(areas, heights.cells),
            datum=" and ".join(sorted({land.datum or self.datum, self.datum}))
            if self.datum
            else "",
            tidal_water=(*land.tidal_water, *_tidal_bands(heights, self.rule)),
        )

    def _notes(self, heights: Heights, region: shapely.Polygon) -> Iterator[Note]:
        """Yield a note on too shallow water, and one if part of the region has no depths."""
        name, depth_m = self.file.name, self.rule.safety_depth_m
        up_deg = float(np.diff(heights.lat).max())
        cosine = np.cos(np.radians(np.abs(heights.lat).min()))
        cell_m = max(up_deg, float(np.diff(heights.lon).max() * cosine)) * METRES_PER_DEGREE
        yield Note.of("depths-no-go", source=name, safety_depth_m=depth_m, cell_m=cell_m)
        lacking = 1 - _covered_share(heights, region)
        if lacking > _MIN_NOTED_SHARE:
            yield Note.of("depths-lacking", source=name, share=lacking)

    def _check_lowest(self, height_m: FloatArray) -> None:
        """Refuse a fill value that the file does not declare: it would be deep water."""
        lowest = float(np.nanmin(height_m))
        others = height_m[height_m > lowest]
        is_fill = lowest in _FILLS_M and others.min(initial=0.0) > 0.9 * lowest
        if is_fill or lowest < _LOWEST_M:
            value = f"{self.file.sign * lowest:g}"
            raise RequestError(
                f"chart.depths: {self.file.variable} of {self.file.name} has the value {value} m, "
                "which is no depth but stands for none, or is in another unit; declare it, as with "
                f"`cdo setctomiss,{value}`, or correct the unit"
            )

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
                f"chart.depths: by {self.file.name}, {dry:.0%} of the region's water lies "
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


def _covered_share(heights: Heights, region: shapely.Polygon) -> float:
    """Return the share of a region's places at which the depth is known."""
    west, south, east, north = region.bounds
    steps = (np.arange(200) + 0.5) / 200
    lon, lat = np.meshgrid(west + steps * (east - west), south + steps * (north - south))
    inside = shapely.contains_xy(region, lon.ravel(), lat.ravel())
    points = np.stack([lon.ravel(), lat.ravel()], axis=-1)[inside]
    return float(heights.cells.at(points).mean()) if len(points) else 0.0


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
    # One ring has room for the cells around shallow ones at the edge, the other closes outlines.
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
    return np.asarray(shapely.get_parts(repaired(polygons)[0]))


def _extended(axis: FloatArray) -> FloatArray:
    """Continue an axis beyond both ends."""
    steps = np.arange(1, _RINGS + 1)
    before = axis[0] - (axis[1] - axis[0]) * steps[::-1]
    return np.concatenate([before, axis, axis[-1] + (axis[-1] - axis[-2]) * steps])
