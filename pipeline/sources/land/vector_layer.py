"""One layer of a vector file, in any CRS, brought to lon/lat near a region."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.errors import RequestError
from pipeline.scenario.messages import near_miss
from pipeline.sources.land.polygons import mended

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import numpy.typing as npt
    import pyproj
    from shapely.geometry import Polygon

    FloatArray = npt.NDArray[np.float64]
    Geometries = npt.NDArray[np.object_]

_LONLAT = "OGC:CRS84"
_METRES_PER_DEGREE = 111_195.0
# An edge that is straight in a plane is bent in lon/lat: it is cut to this share of the region, and
# so is the region's outline, by which the file is searched.
_PIECES = 200


@dataclass(frozen=True)
class VectorLayer:
    """A layer of a file, and its CRS; :func:`open_layer` finds both."""

    path: Path
    name: str
    crs: pyproj.CRS

    def near(self, box: Polygon) -> tuple[Geometries, int]:
        """Return sound geometries near a box, in its longitudes; count those that were mended."""
        found: list[Geometries] = [np.empty(0, dtype=object)]
        total = 0
        for window in self._windows(box):
            sound, count = mended(self._read(window))
            total += count
            shapely.prepare(window)
            over = ~shapely.covers(window, sound)
            sound[over] = shapely.intersection(sound[over], window)
            found.append(self._to_lonlat(sound[~shapely.is_empty(sound)], box))
        return np.concatenate(found), total

    def bounds(self) -> tuple[float, float, float, float]:
        """Bounds of all that the layer holds, in its own CRS."""
        import pyogrio

        info = pyogrio.read_info(self.path, layer=self.name, force_total_bounds=True)
        west, south, east, north = info["total_bounds"]
        return west, south, east, north

    def _windows(self, box: Polygon) -> Iterator[Polygon]:
        """Where the box lies in the file's CRS.

        A file's longitudes may go from -180 to 180 or from 0 to 360; a region's go on at 180.
        """
        if self.crs.is_geographic:
            west, south, east, north = box.bounds
            for turn in (-360.0, 0.0, 360.0):
                yield shapely.box(west + turn, south, east + turn, north)
            return
        import pyproj

        there = pyproj.Transformer.from_crs(_LONLAT, self.crs, always_xy=True)
        west, south, east, north = box.bounds
        bounds = there.transform_bounds(west, south, east, north, densify_pts=_PIECES)
        self._check(np.array(bounds))
        yield shapely.box(*bounds)

    def _read(self, window: Polygon) -> Geometries:
        """Read the geometries whose bounds meet a window, as they are."""
        import pyogrio

        _, _, wkb, _ = pyogrio.raw.read(self.path, layer=self.name, columns=[], bbox=window.bounds)
        geometry = shapely.force_2d(shapely.from_wkb(wkb))
        there: Geometries = geometry[~shapely.is_missing(geometry) & ~shapely.is_empty(geometry)]
        return there

    def _check(self, coordinates: FloatArray) -> None:
        """Refuse coordinates that a CRS has no place for."""
        if not np.isfinite(coordinates).all():
            raise fault(
                self.path,
                f"is in a CRS ({self.crs.name}) that does not reach over the region: name the "
                'right one with crs = "EPSG:…"',
            )

    def _to_lonlat(self, geometry: Geometries, box: Polygon) -> Geometries:
        """Bring geometries to lon/lat degrees, continuous around the middle of a box."""
        import pyproj

        there = pyproj.Transformer.from_crs(self.crs, _LONLAT, always_xy=True)
        west, south, east, north = box.bounds

        def transform(points: FloatArray) -> FloatArray:
            lon, lat = there.transform(points[:, 0], points[:, 1])
            turns = np.round((np.asarray(lon) - (west + east) / 2) / 360)
            lonlat = np.stack([lon - 360 * turns, lat], axis=-1)
            self._check(lonlat)
            return lonlat

        if not self.crs.is_geographic:
            longest_m = _METRES_PER_DEGREE * max(east - west, north - south) / _PIECES
            unit_m = self.crs.axis_info[0].unit_conversion_factor
            geometry = shapely.segmentize(geometry, longest_m / unit_m)
        return np.asarray(shapely.transform(geometry, transform))


def open_layer(path: Path, name: str, crs: str) -> VectorLayer:
    """Find a layer, the only one where no name is given, and its CRS where that is not given.

    Raises
    ------
    RequestError
        No vector file; no such layer, or several to choose from; no CRS, or an unknown one.
    """
    layer = _layer(path, name)
    return VectorLayer(path, layer, _crs(path, layer, crs))


def fault(path: Path, what: str) -> RequestError:
    """Say what is wrong with a file."""
    return RequestError([f"chart.source: {path} {what}"])


def _layer(path: Path, name: str) -> str:
    """Name of the layer to read."""
    import pyogrio

    try:
        names = [str(layer) for layer, kind in pyogrio.list_layers(path) if kind is not None]
    except pyogrio.errors.DataSourceError as error:
        raise fault(
            path,
            f"can't be read ({error}); give a GeoPackage, GeoJSON or Shapefile, or a folder of "
            "S-57 cells",
        ) from error
    if name and name not in names:
        raise fault(path, f"has no layer {name!r}: {near_miss(name, names)}")
    if not name and len(names) != 1:
        raise fault(
            path,
            f"has {len(names)} layers with geometries ({', '.join(names)}); name one: "
            f'{{ path = "{path.name}", layer = "…" }}',
        )
    return name or names[0]


def _crs(path: Path, layer: str, crs: str) -> pyproj.CRS:
    """CRS of a layer: the one given, or the file's own."""
    import pyogrio
    import pyproj

    given = crs or pyogrio.read_info(path, layer=layer)["crs"]
    if not given:
        raise fault(
            path,
            "does not say its CRS: add the .prj file that belongs to it, or name the CRS: "
            f'{{ path = "{path.name}", crs = "EPSG:4326" }} if it is in degrees',
        )
    try:
        return pyproj.CRS.from_user_input(given)
    except pyproj.exceptions.CRSError as error:
        raise fault(path, f"has a CRS that pyproj does not know ({error})") from error
