"""Havens from the user's file: points with names, in any format that GDAL reads, or in CSV."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyproj
import shapely

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.machine.paths import require_readable
from pipeline.sources.land import shapes
from pipeline.sources.land.self_contained import require_self_contained
from pipeline.texts import clean

_LONLAT = "OGC:CRS84"
# Largest number of havens: a bound on the time to each is worked out on a grid.
_MOST = 100
# Names of columns of a CSV file; GDAL ignores the options for other formats.
_CSV_COLUMNS = {"X_POSSIBLE_NAMES": "lon,longitude,x", "Y_POSSIBLE_NAMES": "lat,latitude,y"}
_REMEDY = "give points, as GeoJSON, GeoPackage, or CSV with the columns name, lon and lat"


class HavenPoint(NamedTuple):
    """A haven of the file: its name, and its place in degrees."""

    name: str
    lon: float
    lat: float


def read_havens(path: Path) -> tuple[HavenPoint, ...]:
    """Return the havens of a file, in its order; those without a name are numbered.

    Raises
    ------
    RequestError
        No such file; no points, other geometries, or too many; a place that is not on earth; two
        havens of one name.
    """
    require_readable([path], "havens.path")
    pyogrio = shapes.vector_library()
    with shapes.reading(f"havens.path: {path}", _REMEDY):
        require_self_contained(path)
        layers = [str(name) for name, _ in pyogrio.list_layers(path)]
        if len(layers) != 1:
            raise _fault(path, f"has {len(layers)} layers ({', '.join(layers)}); give one alone")
        meta, _, wkb, values = pyogrio.raw.read(path, **_CSV_COLUMNS)
        fields = [str(one).casefold() for one in meta["fields"]]
        points = [
            None if one is None else shapely.from_wkb(one) for one in ([] if wkb is None else wkb)
        ]
        lonlat = _lonlat(path, points, meta["crs"])
    column = next((at for at, one in enumerate(fields) if one in shapes.NAME_COLUMNS), None)
    names = [None] * len(points) if column is None else list(values[column])
    found = tuple(
        HavenPoint(clean(str(name or ""), shapes.MAX_NAME) or f"haven {number}", lon, lat)
        for number, (name, (lon, lat)) in enumerate(
            zip(names, lonlat.tolist(), strict=True), start=1
        )
    )
    if twice := _twice([one.name for one in found]):
        raise _fault(path, f"has several havens called {twice!r}; rename all but one")
    return found


def _lonlat(path: Path, points: Sequence[shapely.Geometry | None], crs: str | None) -> FloatArray:
    """Return places (n, 2), degrees; a file that states no CRS is in degrees."""
    kinds = {"nothing" if one is None or one.is_empty else one.geom_type for one in points}
    if not points or kinds != {"Point"}:
        listed = ", ".join(sorted(kinds - {"Point"})) or "no feature"
        raise _fault(path, f"has {listed} in place of points; {_REMEDY}")
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


def _twice(names: Sequence[str]) -> str:
    """Return the first name that is given twice, or ""."""
    return next((one for at, one in enumerate(names) if one in names[:at]), "")


def _fault(path: Path, fault: str) -> RequestError:
    """Return an error about the file."""
    return RequestError(f"havens.path: {path} {fault}")
