"""The user's own vector files: land as GeoPackage, GeoJSON, Shapefile and a few others; havens.

Land may be in any CRS; invalid rings are repaired, and points and lines (rocks, breakwaters, a
coast given as lines) are buffered by a radius that the user gives. Facts that the file does not
state (which of several layers, the CRS, that radius) are asked for, not guessed. Havens are points
with names, in any format that GDAL reads, or in CSV.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import pyproj
import shapely

from pipeline._types import BoolArray, FloatArray, Geometries, IndexArray
from pipeline.errors import RequestError
from pipeline.geo.projection import METRES_PER_DEGREE
from pipeline.machine.paths import require_readable
from pipeline.model import Credit, Land, Note, Place, PlaceName
from pipeline.scenario.catalogue import VectorSpec
from pipeline.scenario.region import ChartSource
from pipeline.sources.land import shapes
from pipeline.texts import clean

_LONLAT = "OGC:CRS84"
# Pieces per side of the region into which longer edges are cut before they are transformed, as an
# edge that is straight in a plane is curved in lon/lat. The region's own outline is cut likewise.
_PIECES_PER_SIDE = 200
# Largest planar coordinate, in units of the CRS: 25 times round the earth in metres.
_MAX_PLANAR = 1e9
# Bounds that contain any coordinate.
_EVERYWHERE = (-1e300, -1e300, 1e300, 1e300)
# A file with more features than this is not read again to see why some have no bounds.
_MAX_REREAD = 100_000
# Number of features that a message names.
_MAX_NUMBERS = 3


@dataclass(frozen=True)
class VectorLayer:
    """A layer of a file, and its CRS; made by :func:`open_layer`.

    `numbers` (n,) are the numbers of the features in the file. `extents` (4, n) are the bounds of
    the features in the layer's CRS, and NaN for features without a geometry. `warnings` are GDAL's.
    `fields` are names of columns.
    """

    path: Path
    name: str
    crs: pyproj.CRS
    numbers: IndexArray
    extents: FloatArray
    warnings: tuple[str, ...]
    fields: tuple[str, ...] = ()

    def near(self, box: shapely.Polygon) -> tuple[Geometries, tuple[Note, ...]]:
        """Return valid parts of geometries near a box, in its longitudes, and notes."""
        near: list[Geometries] = [np.empty(0, dtype=object)]
        total, notes = 0, list[Note]()
        with shapes.reading_chart(self.path) as issued:
            for window, parts in self._parts(box, notes):
                valid, count = shapes.repaired(parts)
                total += count
                shapely.prepare(window)
                crosses = ~shapely.covers(window, valid)
                valid[crosses] = shapely.intersection(valid[crosses], window)
                near.append(self._to_lonlat(valid[~shapely.is_empty(valid)], box))
        repairs = shapes.repair_note(self.path.name, total)
        return np.concatenate(near), (*repairs, *notes, *self._notes(issued))

    def _parts(
        self, box: shapely.Polygon, notes: list[Note]
    ) -> Iterator[tuple[shapely.Polygon, Geometries]]:
        """Yield each window in the file's CRS with the parts near it; add notes on those joined."""
        # A feature across 180 degrees that is not split there has bounds round the earth.
        left, bottom, right, top = self.extents
        is_wide = self._is_lonlat & (right - left > shapes.HALF_TURN)
        wide = self.numbers[is_wide & (bottom <= box.bounds[3]) & (top >= box.bounds[1])]
        for window in self._windows(box):
            west, south, east, north = window.bounds
            meets = (left <= east) & (right >= west) & (bottom <= north) & (top >= south)
            if meets.any():
                yield window, self._read(wide, bbox=window.bounds)
        if wide.size:
            parts, is_joined = shapes.joined_at_180(self._read(wide[:0], fids=wide))
            near, index = shapes.near_box(parts, box)
            if count := np.unique(index[is_joined[index]]).size:
                notes.append(Note.of("joined-at-180", source=self.path.name, count=count))
            yield box, near

    def places(self, box: shapely.Polygon) -> tuple[PlaceName, ...]:
        """Return the names of areas near a box, where the layer has a column of names."""
        pyogrio = shapes.vector_library()
        places: list[PlaceName] = []
        # Its warnings were already given when the areas themselves were read.
        with shapes.reading_chart(self.path):
            named = (field for field in self.fields if field.casefold() in shapes.NAME_COLUMNS)
            column = next(named, None)
            for window in self._windows(box) if column is not None else ():
                _, _, wkb, (names,) = pyogrio.raw.read(
                    self.path, layer=self.name, columns=[column], bbox=window.bounds
                )
                geometry = shapes.repaired(
                    shapely.force_2d(shapely.from_wkb(wkb, on_invalid="ignore"))
                )[0]
                places += shapes.named_places(names, self._to_lonlat(geometry, box))
        return tuple(places)

    def bounds(self) -> tuple[float, float, float, float] | None:
        """Return the layer's bounds in its own CRS; None if no feature has a geometry."""
        extents = self.extents[:, ~self._is_blank]
        if not extents.size:
            return None
        (west, south), (east, north) = extents[:2].min(axis=1), extents[2:].max(axis=1)
        return float(west), float(south), float(east), float(north)

    def check(self) -> None:
        """Refuse coordinates beyond the CRS, and features that GDAL can't read."""
        if reason := self._unread_reason():
            listed = ", ".join(map(str, self.numbers[self._is_suspect][:_MAX_NUMBERS]))
            raise RequestError(
                f"{self.path} has a geometry that can't be read ({reason}), in feature {listed}; "
                "correct or remove it"
            )
        limits = np.array(shapes.MAX_LONLAT * 2 if self._is_lonlat else (_MAX_PLANAR,) * 4)[:, None]
        with np.errstate(invalid="ignore"):
            beyond = (np.abs(self.extents) > limits).any(axis=0)
        if beyond.any():
            first = int(beyond.argmax())
            west, south, east, north = self.extents[:, first]
            remedy = f"correct it, or name its right CRS, as {self.path.name},crs=EPSG:…"
            if self._is_lonlat and (np.abs(self.extents[[1, 0, 3, 2]]) <= limits).all():
                remedy = "latitude stands before longitude: exchange them"
            raise RequestError(
                f"{self.path} has coordinates that are impossible in its CRS ({self.crs.name}): "
                f"feature {self.numbers[first]} lies in {west:g} to {east:g}, {south:g} to "
                f"{north:g}; {remedy}"
            )

    @cached_property
    def _is_blank(self) -> BoolArray:
        """Which features (n,) have no geometry."""
        return np.asarray(np.isnan(self.extents).any(axis=0))

    @cached_property
    def _is_suspect(self) -> BoolArray:
        """Which features (n,) have no geometry or an empty one; unreadable ones look so, too."""
        return np.asarray(self._is_blank | (self.extents == 0).all(axis=0))

    def _unread_reason(self) -> str:
        """Say why features can't be read; empty if no geometry was lost in reading."""
        pyogrio = shapes.vector_library()
        if not self._is_suspect.any() or self.numbers.size > _MAX_REREAD:
            return ""
        try:
            # If no bounding box is given, pyogrio raises no error for a feature that it can't read:
            # it returns the feature without a geometry.
            pyogrio.raw.read(self.path, layer=self.name, columns=[], bbox=_EVERYWHERE)
        except pyogrio.errors.FeatureError as error:
            return shapes.one_line(error)
        # GDAL gives some damaged geometries as none, with a warning.
        return self.warnings[0] if self.warnings and self._is_blank.any() else ""

    @cached_property
    def _is_lonlat(self) -> bool:
        """Whether the CRS counts degrees from Greenwich: some count grads, or from Paris."""
        units = [axis.unit_conversion_factor for axis in self.crs.axis_info[:2]]
        meridian = self.crs.prime_meridian
        return (
            self.crs.is_geographic
            and np.allclose(units, math.radians(1.0))
            and (meridian is None or meridian.longitude == 0)
        )

    def _notes(self, issued: list[str]) -> Iterator[Note]:
        """Yield notes on features without a geometry, and on GDAL's warnings."""
        for text in dict.fromkeys((*self.warnings, *issued)):
            yield Note.of("gdal-warning", source=self.path.name, warning=text)
        if count := int(self._is_blank.sum()):
            yield Note.of("features-without-geometry", source=self.path.name, count=count)

    def _windows(self, box: shapely.Polygon) -> Iterator[shapely.Polygon]:
        """Yield the box in the file's CRS.

        A file's longitudes may go from -180 to 180 or from 0 to 360; a region's continue past 180.
        """
        if self._is_lonlat:
            west, south, east, north = box.bounds
            for turn in (-360.0, 0.0, 360.0):
                yield shapely.box(west + turn, south, east + turn, north)
            return
        to_crs = pyproj.Transformer.from_crs(_LONLAT, self.crs, always_xy=True)
        west, south, east, north = box.bounds
        bounds = to_crs.transform_bounds(west, south, east, north, densify_pts=_PIECES_PER_SIDE)
        self._check_covered(np.array(bounds))
        yield shapely.box(*bounds)

    def _read(self, but: IndexArray, **which: object) -> Geometries:
        """Read geometries, unchanged but taken out of collections; leave out some features."""
        _, numbers, wkb, _ = shapes.vector_library().raw.read(
            self.path, layer=self.name, columns=[], return_fids=True, **which
        )
        is_there = np.array([geometry is not None for geometry in wkb], dtype=bool)
        present = np.flatnonzero(is_there & ~np.isin(numbers, but))
        numbers, wkb = np.asarray(numbers)[present], wkb[present]
        with np.errstate(invalid="ignore"):
            geometry = shapely.from_wkb(wkb, on_invalid="ignore")
        unread = shapely.is_missing(geometry)
        if unread.any():
            first, fault = int(unread.argmax()), "a geometry that can't be built"
            try:
                shapely.from_wkb(wkb[first])
            except shapely.errors.ShapelyError as error:
                fault += f": {shapes.one_line(error)}"
            raise self._damaged(int(numbers[first]), fault)
        coordinates, index = shapely.get_coordinates(geometry, return_index=True)
        if not np.isfinite(coordinates).all():
            first = int(index[~np.isfinite(coordinates).all(axis=1)][0])
            raise self._damaged(int(numbers[first]), "a coordinate that is no finite number")
        parts = shapes.flattened(shapely.force_2d(geometry))
        return np.asarray(parts[~shapely.is_empty(parts)])

    def _damaged(self, number: int, fault: str) -> RequestError:
        """Say which feature is damaged, where it lies, and how."""
        place = self.extents[:2, self.numbers == number].ravel()
        near = f", near {place[0]:g}, {place[1]:g}" if place.size == 2 else ""
        return RequestError(
            f"{self.path} has {fault} (feature {number}{near}); correct or remove the feature"
        )

    def _check_covered(self, coordinates: FloatArray) -> None:
        """Refuse coordinates that lie outside the CRS."""
        if not np.isfinite(coordinates).all():
            raise RequestError(
                f"{self.path} is in a CRS ({self.crs.name}) that does not cover the region: name "
                f"the right one, as {self.path.name},crs=EPSG:…"
            )

    def _to_lonlat(self, geometry: Geometries, box: shapely.Polygon) -> Geometries:
        """Transform geometries to lon/lat degrees, within 180 degrees of the middle of a box."""
        to_lonlat = pyproj.Transformer.from_crs(self.crs, _LONLAT, always_xy=True)
        west, south, east, north = box.bounds

        def transform(points: FloatArray) -> FloatArray:
            lon, lat = to_lonlat.transform(points[:, 0], points[:, 1])
            turns = np.round((np.asarray(lon) - (west + east) / 2) / 360)
            lonlat = np.stack([lon - 360 * turns, lat], axis=-1)
            self._check_covered(lonlat)
            return lonlat

        if not self._is_lonlat:
            longest_m = METRES_PER_DEGREE * max(east - west, north - south) / _PIECES_PER_SIDE
            unit_m = self.crs.axis_info[0].unit_conversion_factor
            geometry = shapely.segmentize(geometry, longest_m / unit_m)
        return np.asarray(shapely.transform(geometry, transform))


@lru_cache(maxsize=4)
def open_layer(path: Path, name: str, crs: str, version: tuple[int, ...]) -> VectorLayer:
    """Open a layer by its name, or the only one; in the CRS given, or else the file's own.

    RequestError where file, layer, CRS or coordinates can't be used. A version of the file is
    opened once, as GDAL reads all of some formats each time.
    """
    del version
    pyogrio = shapes.vector_library()
    with shapes.reading_chart(path) as issued:
        shapes.require_self_contained(path)
        name = shapes.layer_name(path, name)
        info = pyogrio.read_info(path, layer=name)
        known = shapes.crs_of(path, crs or info["crs"])
        numbers, extents = map(np.asarray, pyogrio.read_bounds(path, layer=name))
    fields = tuple(map(str, info["fields"]))
    layer = VectorLayer(path, name, known, numbers, extents, tuple(issued), fields)
    with shapes.reading_chart(path):
        layer.check()
    return layer


# Dimensions of geometries.
_POINT = 0
_LINE = 1
_AREA = 2
# Accuracy of the coast where it is not given, m: that of a chart of 1:100,000.
_ASSUMED_ACCURACY_M = 50.0


@dataclass(frozen=True)
class VectorFile:
    """One layer of a vector file; `source` is the scenario's table about it.

    `entry` is the catalogue's entry for such files, where the scenario names one. A file that adds
    to another chart need not have anything near the region.
    """

    path: Path
    source: ChartSource
    entry: VectorSpec | None = None
    is_addition: bool = False

    @cached_property
    def identity(self) -> tuple[str, ...]:
        """The scenario's table about the file, and a hash of it and its sidecar files."""
        files = self._files
        with shapes.reading_chart(self.path):
            digest = shapes.hash_of(files)
        entry = self.entry.model_dump_json() if self.entry else ""
        return ("vector", self.source.model_dump_json(), entry, digest)

    @cached_property
    def _files(self) -> tuple[Path, ...]:
        """The files that were hashed: each has to be there still when the land is read."""
        return shapes.files_of(self.path)

    @property
    def credit(self) -> Credit:
        """The credit that the scenario gives, else the catalogue's."""
        entry, source = self.entry, self.source
        return Credit(
            name=entry.title if entry else self.path.name,
            kind="land",
            text=source.credit or (entry.credit if entry else f"{self.path.name}, user's file"),
            licence=source.licence or (entry.licence if entry else "not given"),
            url=entry.url if entry else "",
        )

    @property
    def accuracy_m(self) -> float:
        """How far the file's coast may be off, m."""
        if self.source.accuracy_m is not None:
            return self.source.accuracy_m
        return self.entry.accuracy_m if self.entry else _ASSUMED_ACCURACY_M

    def land(self, region: shapely.Polygon) -> Land:
        """Return the land near a region (lon/lat degrees)."""
        box = shapes.box_around(region)
        require_readable(self._files, self.path.name)
        version = tuple(file.stat().st_mtime_ns for file in self._files)
        layer = open_layer(self.path, self.source.layer, self.source.crs, version)
        near, notes = layer.near(box)
        if len(near) == 0 and self.is_addition:
            notes = (*notes, Note.of("chart-not-near", source=self.path.name))
        elif len(near) == 0:
            raise self._nothing_near(layer)
        is_given = self.entry or self.source.accuracy_m is not None
        name, accuracy_m = self.path.name, _ASSUMED_ACCURACY_M
        assumed = Note.of("accuracy-assumed", source=name, accuracy_m=accuracy_m)
        return Land(
            polygons=tuple(self._areas(near).tolist()),
            credits=(self.credit,),
            accuracy_m=self.accuracy_m,
            notes=notes if is_given else (*notes, assumed),
            places=layer.places(box),
        )

    def _areas(self, geometry: Geometries) -> Geometries:
        """Return areas as they are, and points and lines buffered by the radius given."""
        # Clipping to the region makes collections again.
        parts = shapes.flattened(geometry)
        dimension = shapely.get_dimensions(parts)
        thin = parts[dimension < _AREA]
        if len(thin) and self.source.radius_m is None:
            counts = [
                f"{count:,} {name}{'s' * (count > 1)}"
                for kind, name in ((_POINT, "point"), (_LINE, "line"))
                if (count := int((dimension == kind).sum()))
            ]
            raise RequestError(
                f"{self.path} has {' and '.join(counts)} near the region, where areas are needed: "
                "make polygons of them, or give the radius that is no-go around them, as "
                f'{self.path.name},radius=20m or in a scenario {{ path = "{self.path.name}", '
                "radius_m = 20 }"
            )
        grown = shapes.buffered(thin, self.source.radius_m or 0.0)
        return shapes.extract_polygons(np.concatenate([parts[dimension == _AREA], grown]))

    def _nothing_near(self, layer: VectorLayer) -> RequestError:
        """Say where the file's land is, when none is near the region."""
        bounds = layer.bounds()
        if bounds is None:
            return RequestError(
                f"{self.path} has no feature with a geometry; give a file that has, or leave it out"
            )
        listed = ", ".join(f"{bound:g}" for bound in bounds)
        return RequestError(
            f"{self.path} has nothing near the region (its bounds in {layer.crs.name}: {listed}): "
            f"leave it out, or if that is wrong, name its right CRS, as {self.path.name},crs=EPSG:…"
        )


# Largest number of havens: a bound on the time to each is worked out on a grid.
_MOST = 100
# Names of columns of a CSV file; GDAL ignores the options for other formats.
_CSV_COLUMNS = {"X_POSSIBLE_NAMES": "lon,longitude,x", "Y_POSSIBLE_NAMES": "lat,latitude,y"}
_REMEDY = "give points, as GeoJSON, GeoPackage, or CSV with the columns name, lon and lat"


def read_havens(path: Path) -> dict[str, Place]:
    """Return the havens of a file by name, in its order; those without a name are numbered.

    Raises RequestError for no such file; no points, other geometries, or too many; a place that is
    not on earth; two havens of one name.
    """
    require_readable([path], "havens.path")
    pyogrio = shapes.vector_library()
    with shapes.reading(f"havens.path: {path}", _REMEDY):
        shapes.require_self_contained(path)
        layers = [str(name) for name, _ in pyogrio.list_layers(path)]
        if len(layers) != 1:
            raise _fault(path, f"has {len(layers)} layers ({', '.join(layers)}); give one alone")
        meta, _, wkb, values = pyogrio.raw.read(path, **_CSV_COLUMNS)
        fields = [str(field).casefold() for field in meta["fields"]]
        points = [
            None if geometry is None else shapely.from_wkb(geometry)
            for geometry in ([] if wkb is None else wkb)
        ]
        lonlat = _lonlat(path, points, meta["crs"])
    column = next((at for at, field in enumerate(fields) if field in shapes.NAME_COLUMNS), None)
    names = [None] * len(points) if column is None else list(values[column])
    havens = dict[str, Place]()
    for number, (given, place) in enumerate(zip(names, lonlat.tolist(), strict=True), start=1):
        name = clean(str(given or ""), shapes.MAX_NAME) or f"haven {number}"
        if name in havens:
            raise _fault(path, f"has several havens called {name!r}; rename all but one")
        havens[name] = Place(*place)
    return havens


def _lonlat(path: Path, points: Sequence[shapely.Geometry | None], crs: str | None) -> FloatArray:
    """Return places (n, 2), degrees; a file that states no CRS is in degrees."""
    kinds = {"nothing" if point is None or point.is_empty else point.geom_type for point in points}
    if not points or kinds != {"Point"}:
        listed = ", ".join(sorted(kinds - {"Point"}))
        what = f"has {listed} in place of points" if listed else "has no points"
        raise _fault(path, f"{what}; {_REMEDY}")
    if len(points) > _MOST:
        raise _fault(path, f"has {len(points):,} havens; give at most {_MOST}")
    places = shapely.get_coordinates(np.array(points, dtype=object))
    if crs:
        to_lonlat = pyproj.Transformer.from_crs(crs, _LONLAT, always_xy=True)
        places = np.stack(to_lonlat.transform(*places.T), axis=-1)
    beyond = ~((np.abs(places[:, 0]) <= 360) & (np.abs(places[:, 1]) <= 90))
    if beyond.any():
        x, y = places[beyond][0].tolist()
        raise _fault(path, f"has a haven at [{x:g}, {y:g}], which is not on earth: give lon, lat")
    return np.asarray(places)


def _fault(path: Path, fault: str) -> RequestError:
    return RequestError(f"havens.path: {path} {fault}")
