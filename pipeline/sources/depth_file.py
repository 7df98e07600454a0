"""A grid of depths in a file by the CF conventions, as GEBCO and EMODnet publish them.

The variable is found by its standard name, else by its name. GEBCO's `elevation` is positive up,
in metres, and so is EMODnet's; a depth is positive down, unless its attribute `positive` says
otherwise.
"""

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.geo.lonlat import Bounds
from pipeline.machine.paths import require_readable, shown
from pipeline.sources.cf.axes import axis_role, coordinate_axis, grid_fault
from pipeline.sources.cf.dataset import check_values, fatal_files, open_dataset, reading
from pipeline.sources.cf.grid import find_window, read_window

if TYPE_CHECKING:
    import xarray as xr

# Standard names (CF table 85) of a depth, positive down, and the beginning of the names of a
# height; "altitude" is the height above the geoid.
_DEPTHS = {
    "sea_floor_depth_below_geoid",
    "sea_floor_depth_below_mean_sea_level",
    "sea_floor_depth_below_sea_surface",
    "sea_floor_depth",
    "depth",
}
_HEIGHTS = "height_above_"
_ALTITUDES = {"altitude", "surface_altitude", "sea_floor_altitude"}
# A height above the ellipsoid is up to 100 m off the sea's surface. GEBCO calls its heights so, but
# their long name says that they are above sea level.
_ELLIPSOID, _AT_SEA_LEVEL = "height_above_reference_ellipsoid", "sea level"
# Names of variables without such a standard name, and the sign by which they become heights.
_NAMES = {"elevation": 1.0, "depth": -1.0}
_SIGNS = {"up": 1.0, "down": -1.0}
_METRES = {"m", "meter", "meters", "metre", "metres"}
_REMEDY = (
    "give a GEBCO or EMODnet grid in NetCDF, with 'elevation' in m, positive up, or a depth by its "
    "CF standard name"
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


@dataclass(frozen=True)
class DepthFile:
    """A file's variable: its name, dimensions and axes, and the sign that makes it a height."""

    path: Path
    variable: str
    dims: tuple[str, str]
    lon: FloatArray
    lat: FloatArray
    sign: float
    title: str
    licence: str

    @classmethod
    def open(cls, path: Path) -> "DepthFile":
        """Read names, axes and attributes of a file, but no depths.

        Raises
        ------
        RequestError
            It can't be read, or has no depths in metres on a lon/lat grid: one line.
        """
        require_readable([path], "chart.depths")
        with _refused(path):
            if fatal := fatal_files([path]):
                raise ValueError(fatal[path])
            with open_dataset(path) as dataset:
                return _described(path, dataset)

    def heights(self, bounds: Bounds) -> Heights | None:
        """Read the part in bounds (west, south, east, north); None where there are no two nodes.

        Raises
        ------
        RequestError
            The file is damaged, or has too many cells there.
        """
        window = find_window(self.lon, self.lat, bounds)
        if min(window.lon.size, window.lat.size) < 2:
            return None
        shape = (window.lat.size, window.lon.size)
        with _refused(self.path):
            if math.prod(shape) > _MAX_CELLS:
                raise ValueError(
                    f"it has {shape[0]:,} x {shape[1]:,} cells in the region, more than "
                    f"{_MAX_CELLS:,}; shrink the region, or take the shallowest of several cells "
                    "each, as with `cdo gridboxmax,4,4`"
                )
            with open_dataset(self.path) as dataset, reading():
                variable = dataset.variables[self.variable]
                height_m = self.sign * read_window(variable, self.dims, window).reshape(shape)
        return Heights(window.lon, window.lat, np.where(np.isfinite(height_m), height_m, np.nan))


@contextlib.contextmanager
def _refused(path: Path) -> Iterator[None]:
    """Turn a ValueError about a file into a RequestError that names the file."""
    try:
        yield
    except ValueError as error:
        raise RequestError(f"chart.depths: {path.name}: {error}") from None


def _described(path: Path, dataset: "xr.Dataset") -> DepthFile:
    """Find the variable of an open file; ValueError where there is none that can be used."""
    name, sign = _variable(dataset)
    array = dataset[name]
    check_values(array)
    units = str(array.attrs.get("units", "")).strip()
    if units.lower() not in _METRES:
        raise ValueError(
            f"{name} is in {units!r}, not in m; convert it, or set its attribute 'units'"
            if units
            else f"{name} has no unit; set its attribute 'units' to m, if that is what it is in"
        )
    roles = {axis_role(dataset, str(dim)): str(dim) for dim in array.dims if array.sizes[dim] > 1}
    if set(roles) != {"lat", "lon"}:
        raise ValueError(grid_fault(dataset, array))
    attributes = {key.lower(): value for key, value in dataset.attrs.items()}
    return DepthFile(
        path=path,
        variable=name,
        dims=(roles["lat"], roles["lon"]),
        lon=coordinate_axis(dataset, roles["lon"], period=360.0),
        lat=coordinate_axis(dataset, roles["lat"]),
        sign=sign,
        title=attributes.get("title", ""),
        licence=attributes.get("license") or attributes.get("licence") or "",
    )


def _variable(dataset: "xr.Dataset") -> tuple[str, float]:
    """Return the name of the variable, and the sign by which it becomes a height."""
    grids = {str(name): array for name, array in dataset.data_vars.items() if array.ndim >= 2}
    found = {
        name: sign for name, array in grids.items() if (sign := _standard_sign(array)) is not None
    }
    if not found:
        found = {
            name: _SIGNS.get(array.attrs.get("positive", ""), _NAMES[name.lower()])
            for name, array in grids.items()
            if name.lower() in _NAMES and array.attrs.get("standard_name") != _ELLIPSOID
        }
    named = {name: sign for name, sign in found.items() if name.lower() in _NAMES}
    for candidates in (found, named):
        if len(candidates) == 1:
            return next(iter(candidates.items()))
    listed = ", ".join(
        f"{name} ({array.attrs.get('standard_name') or 'no standard name'})"
        for name, array in sorted(grids.items())
    )
    if found:
        raise ValueError(f"it has several grids of depths ({listed}); keep one of them")
    raise ValueError(f"it has no depths among {listed or 'no grids at all'}; {_REMEDY}")


def _standard_sign(array: "xr.DataArray") -> float | None:
    """Return the sign that a variable's standard name gives; None where it is another quantity."""
    standard = array.attrs.get("standard_name", "")
    if standard == _ELLIPSOID and _AT_SEA_LEVEL not in array.attrs.get("long_name", "").lower():
        return None
    if standard.startswith(_HEIGHTS) or standard in _ALTITUDES:
        return _SIGNS["up"]
    if standard in _DEPTHS:
        return _SIGNS.get(array.attrs.get("positive", ""), _SIGNS["down"])
    return None


def name_of(path: Path) -> str:
    """Name a file in a note."""
    return shown(path.name)
