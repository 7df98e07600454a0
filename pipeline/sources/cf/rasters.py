"""Depths as rasters: GeoTIFF, and BAG of the Open Navigation Surface; they become CF datasets.

GeoTIFF 1.1 (OGC 19-008) is read by Pillow, which matplotlib brings, and its CRS is looked up by its
EPSG code. A BAG (format specification 2.0) is HDF5, heights positive up in metres; its metadata say
where it lies, and over which datum.

rasterio (1.4.4) was weighed: it would replace `_geotiff`, 45 lines, and read parts of a file, CRS
without a code and LERC. But it is 108 MB, with a GDAL and a PROJ of its own beside those of pyogrio
and pyproj. What is not read here is named with the command of GDAL that makes it readable.
"""

import re
import shlex
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from pipeline._types import FloatArray
from pipeline.sources.cf.s100 import UnusableError, placed

if TYPE_CHECKING:
    import xarray as xr
    from PIL.ImageFile import ImageFile

_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_HDF5 = b"\x89HDF"
# Tags of a TIFF: its bands; its position, by a scale and a point or by a matrix; its keys.
_BANDS = 277
_SCALE = 33550
_POINT = 33922
_MATRIX = 34264
_KEYS = 34735
# GDAL's own tags: remarks, and the value that stands for none.
_REMARKS = 42112
_NO_DATA = 42113
# Keys: whether a value is that of a point, and EPSG codes.
_RASTER_TYPE = 1025
_GEOGRAPHIC = 2048
_PROJECTED = 3072
_VERTICAL = 4096
_IS_POINT = 2
_OWN_CRS = 32767
# Largest number of values: 0.5 GB.
_MAX_VALUES = 1 << 26
_PLAIN = "gdal_translate -b 1 -ot Float32 -co COMPRESS=DEFLATE"
_CUT = "gdal_translate -projwin WEST NORTH EAST SOUTH"
# Value of a BAG where nothing was measured.
_BAG_NONE = 1e6
_DATUMS = {"mean lower low water": "MLLW", "lowest astronomical tide": "LAT"}
_NAMED = re.compile(r"\b(MLLW|MLLWS|MLWS|MLW|LAT|MSL|ISLW)\b")


def is_raster(path: Path) -> bool:
    """Whether a file is a TIFF or a BAG."""
    import h5py

    with path.open("rb") as file:
        begin = file.read(4)
    if begin != _HDF5:
        return begin in _TIFF
    with h5py.File(path) as opened:
        return "BAG_root" in opened


def as_dataset(path: Path) -> "xr.Dataset":
    """Read a raster as a dataset.

    Raises UnusableError if it lies nowhere, or is of a kind that is not read; the message has the
    command that helps.
    """
    import xarray as xr

    with path.open("rb") as file:
        is_bag = file.read(4) == _HDF5
    values, (x, y), crs, about = _bag(path) if is_bag else _geotiff(path)
    dims, coordinates = placed(x, y, crs)
    datum = about.pop("verticalDatum", "")
    named = {"elevation" if is_bag else "Band1": (dims, values, about)}
    return xr.Dataset(named, coordinates, {"verticalDatum": datum})


_Raster: TypeAlias = tuple[FloatArray, tuple[FloatArray, FloatArray], Any, dict[str, str]]


def _geotiff(path: Path) -> _Raster:
    """Return the values (ny, nx) of a GeoTIFF, its axes x and y, its CRS, and what it says."""
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its size, which is limited here
        try:
            image = Image.open(path, formats=["TIFF"])
        except OSError:
            raise _unusable(
                path, "of bands, numbers or packing that are not read", _PLAIN
            ) from None
        with image:
            return _of_image(path, image)


def _of_image(path: Path, image: "ImageFile") -> _Raster:
    """Return the same of an open image."""
    tags: Any = image.tag_v2  # type: ignore[attr-defined]
    if tags.get(_BANDS, 1) != 1:
        raise _unusable(path, "of several bands", _PLAIN)
    if image.width * image.height > _MAX_VALUES:
        size = f"of {image.width:,} x {image.height:,} values"
        raise _unusable(
            path, f"{size}, more than {_MAX_VALUES:,}", "gdal_translate -projwin W N E S"
        )
    directory = np.reshape(tags.get(_KEYS, ()), (-1, 4)).tolist()
    keys = {key: value for key, place, _, value in directory if not place}
    code = keys.get(_PROJECTED, keys.get(_GEOGRAPHIC, _OWN_CRS))
    matrix = _matrix(tags)
    if code == _OWN_CRS or matrix is None:
        raise _unusable(path, "without a CRS by code, or turned", "gdalwarp -t_srs EPSG:4326")
    (left, across), (top, down) = matrix
    middle = 0.0 if keys.get(_RASTER_TYPE) == _IS_POINT else 0.5
    x: FloatArray = left + across * (np.arange(float(image.width)) + middle)
    y: FloatArray = top + down * (np.arange(float(image.height)) + middle)
    values = np.asarray(image, dtype=float)
    if none := str(tags.get(_NO_DATA, "")).strip("\0 "):
        values = np.where(values == float(none), np.nan, values)
    items = re.findall(r'role="(\w+)"[^>]*>([^<]*)<', str(tags.get(_REMARKS, "")))
    said = dict(items)
    values = values * float(said.get("scale", 1)) + float(said.get("offset", 0))
    about = {"units": said["unittype"]} if said.get("unittype") else {}
    return values, (x, y), code, about | _vertical(keys.get(_VERTICAL, _OWN_CRS))


def _matrix(tags: Any) -> tuple[tuple[float, float], ...] | None:  # noqa: ANN401 - of Pillow
    """Return (origin, step) of x and of y of a raster's corners; None if it is turned."""
    if _MATRIX in tags:
        a, b, _, left, c, d, _, top = tags[_MATRIX][:8]
        return ((left, a), (top, d)) if b == c == 0 else None
    if _SCALE not in tags or len(tags.get(_POINT, ())) != 6:
        return None
    i, j, _, x, y, _ = tags[_POINT]
    across, down = tags[_SCALE][0], -tags[_SCALE][1]
    return (x - i * across, across), (y - j * down, down)


def _vertical(code: int) -> dict[str, str]:
    """Return what a vertical CRS says: unit, direction, and datum."""
    import pyproj

    if code == _OWN_CRS:
        return {}
    try:
        crs = pyproj.CRS.from_epsg(code)
    except pyproj.exceptions.CRSError:
        return {}
    (axis,) = crs.axis_info
    return {"units": axis.unit_name, "positive": axis.direction, "verticalDatum": _datum(crs.name)}


def _datum(name: str) -> str:
    """Return the short name of a chart datum that a name has; "" for another."""
    known = _DATUMS.get(name.lower(), "")
    found = _NAMED.search(name)
    return known or (found[0] if found else "")


def _bag(path: Path) -> _Raster:
    """Return the same of a BAG, whose rows run from south to north."""
    import h5py
    import pyproj

    with h5py.File(path) as file:
        root = file["BAG_root"]
        if "varres_refinements" in root:
            raise _unusable(
                path, "a BAG of several resolutions", "gdal_translate -oo MODE=RESAMPLED_GRID"
            )
        if root["elevation"].size > _MAX_VALUES:
            raise _unusable(
                path, f"above {_MAX_VALUES:,} values", "gdal_translate -projwin W N E S"
            )
        values = np.asarray(root["elevation"][:], dtype=float)
        text = root["metadata"][:].tobytes().decode("utf-8", "replace")
    corners = re.search(r"coordinates[^>]*>\s*([-\d.eE+]+),(\S+)\s+([-\d.eE+]+),([^<\s]+)", text)
    codes = re.findall(
        r"<gmd:code>\s*<gco:CharacterString>(.*?)</gco:CharacterString>", text, re.DOTALL
    )
    if corners is None or not codes:
        raise _unusable(path, "a BAG without its position", "gdal_translate")
    west, south, east, north = map(float, corners.groups())
    crs = pyproj.CRS.from_user_input(codes[0].replace("&quot;", '"'))
    named = re.search(r'VERT\w*\["([^"]*)', codes[1].replace("&quot;", '"')) if codes[1:] else None
    rows, columns = values.shape
    about = {"units": "m", "positive": "up", "verticalDatum": _datum(named[1]) if named else ""}
    values = np.where(values >= _BAG_NONE, np.nan, values)
    return values, (np.linspace(west, east, columns), np.linspace(south, north, rows)), crs, about


def _unusable(path: Path, what: str, command: str) -> UnusableError:
    """Return an error with the command that makes a file that is read."""
    done = f"{command} {shlex.quote(path.name)} {shlex.quote(path.stem)}_read.tif"
    return UnusableError(f"it is {what}; give the file that `{done}` makes of it")
