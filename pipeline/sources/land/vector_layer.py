"""One layer of a vector file in any CRS, transformed to lon/lat near a region."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.errors import RequestError
from pipeline.geo.earth import METRES_PER_DEGREE
from pipeline.scenario.messages import near_miss
from pipeline.sources.land.polygons import repaired

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import numpy.typing as npt
    import pyproj
    from shapely.geometry import Polygon

    FloatArray = npt.NDArray[np.float64]
    Geometries = npt.NDArray[np.object_]

_LONLAT = "OGC:CRS84"
# Pieces per side of the region into which longer edges are cut before they are transformed, as an
# edge that is straight in a plane is curved in lon/lat; and so is the region's own outline.
_PIECES_PER_SIDE = 200


@dataclass(frozen=True)
class VectorLayer:
    """A layer of a file, and its CRS; made by :func:`open_layer`."""

    path: Path
    name: str
    crs: pyproj.CRS

    def near(self, box: Polygon) -> tuple[Geometries, int]:
        """Return valid geometries near a box, in its longitudes; count those repaired."""
        found: list[Geometries] = [np.empty(0, dtype=object)]
        total = 0
        for window in self._windows(box):
            valid, count = repaired(self._read(window))
            total += count
            shapely.prepare(window)
            crosses = ~shapely.covers(window, valid)
            valid[crosses] = shapely.intersection(valid[crosses], window)
            found.append(self._to_lonlat(valid[~shapely.is_empty(valid)], box))
        return np.concatenate(found), total

    def bounds(self) -> tuple[float, float, float, float]:
        """Bounds of the whole layer, in its own CRS."""
        import pyogrio

        info = pyogrio.read_info(self.path, layer=self.name, force_total_bounds=True)
        west, south, east, north = info["total_bounds"]
        return west, south, east, north

    def _windows(self, box: Polygon) -> Iterator[Polygon]:
        """Yield the box in the file's CRS.

        A file's longitudes may go from -180 to 180 or from 0 to 360; a region's continue past 180.
        """
        if self.crs.is_geographic:
            west, south, east, north = box.bounds
            for turn in (-360.0, 0.0, 360.0):
                yield shapely.box(west + turn, south, east + turn, north)
            return
        import pyproj

        to_crs = pyproj.Transformer.from_crs(_LONLAT, self.crs, always_xy=True)
        west, south, east, north = box.bounds
        bounds = to_crs.transform_bounds(west, south, east, north, densify_pts=_PIECES_PER_SIDE)
        self._check(np.array(bounds))
        yield shapely.box(*bounds)

    def _read(self, window: Polygon) -> Geometries:
        """Read the geometries whose bounds meet a window, unchanged."""
        import pyogrio

        _, _, wkb, _ = pyogrio.raw.read(self.path, layer=self.name, columns=[], bbox=window.bounds)
        geometry = shapely.force_2d(shapely.from_wkb(wkb))
        is_present = ~shapely.is_missing(geometry) & ~shapely.is_empty(geometry)
        present: Geometries = geometry[is_present]
        return present

    def _check(self, coordinates: FloatArray) -> None:
        """Refuse coordinates that lie outside the CRS."""
        if not np.isfinite(coordinates).all():
            raise chart_fault(
                self.path,
                f"is in a CRS ({self.crs.name}) that does not cover the region: name the right one "
                'with crs = "EPSG:…"',
            )

    def _to_lonlat(self, geometry: Geometries, box: Polygon) -> Geometries:
        """Transform geometries to lon/lat degrees, within 180 degrees of the middle of a box."""
        import pyproj

        to_lonlat = pyproj.Transformer.from_crs(self.crs, _LONLAT, always_xy=True)
        west, south, east, north = box.bounds

        def transform(points: FloatArray) -> FloatArray:
            lon, lat = to_lonlat.transform(points[:, 0], points[:, 1])
            turns = np.round((np.asarray(lon) - (west + east) / 2) / 360)
            lonlat = np.stack([lon - 360 * turns, lat], axis=-1)
            self._check(lonlat)
            return lonlat

        if not self.crs.is_geographic:
            longest_m = METRES_PER_DEGREE * max(east - west, north - south) / _PIECES_PER_SIDE
            unit_m = self.crs.axis_info[0].unit_conversion_factor
            geometry = shapely.segmentize(geometry, longest_m / unit_m)
        return np.asarray(shapely.transform(geometry, transform))


def open_layer(path: Path, name: str, crs: str) -> VectorLayer:
    """Open a layer by its name, or the only one; in the CRS given, or else the file's own.

    Raises
    ------
    RequestError
        No vector file; no such layer, or several to choose from; no CRS, or an unknown one.
    """
    layer = _layer(path, name)
    return VectorLayer(path, layer, _crs(path, layer, crs))


def chart_fault(path: Path, fault: str) -> RequestError:
    """Say what is wrong with a chart's file."""
    return RequestError([f"chart.source: {path} {fault}"])


def _layer(path: Path, name: str) -> str:
    """Name of the layer to read."""
    import pyogrio

    try:
        names = [str(layer) for layer, kind in pyogrio.list_layers(path) if kind is not None]
    except pyogrio.errors.DataSourceError as error:
        raise chart_fault(
            path,
            f"can't be read ({error}); give a GeoPackage, GeoJSON or Shapefile, or a folder of "
            "S-57 cells",
        ) from error
    if name and name not in names:
        raise chart_fault(path, f"has no layer {name!r}: {near_miss(name, names)}")
    if not name and len(names) != 1:
        raise chart_fault(
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
        raise chart_fault(
            path,
            "does not give its CRS: add its .prj file, or name the CRS, as in "
            f'{{ path = "{path.name}", crs = "EPSG:4326" }} for degrees',
        )
    try:
        return pyproj.CRS.from_user_input(given)
    except pyproj.exceptions.CRSError as error:
        raise chart_fault(path, f"has a CRS that pyproj does not know ({error})") from error
