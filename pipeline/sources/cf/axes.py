"""The axes of a variable by the CF conventions: what each is, whether they make a grid.

Not by cf-xarray (0.11), which was tried: it would replace `axis_role` alone, 25 lines, for 50 ms of
import. It does not recognise a time by its units until it is decoded, which fails for damaged
files. It names an axis twice if attributes contradict each other, and takes the name `latent` for a
latitude. As with cf-xarray, xarray decodes scale, offset and fill values here, and cftime decodes
times; units of speed would need pint in addition.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline._types import FloatArray
from pipeline.model import Note
from pipeline.sources.cf.dataset import coordinate_values, reading
from pipeline.sources.cf.times import ZONES
from pipeline.sources.current_field import SURFACE_DEPTH_M
from pipeline.texts import clean

if TYPE_CHECKING:
    import xarray as xr

_DEGREES = {"lon": ("degrees_east", "degree_east"), "lat": ("degrees_north", "degree_north")}
_AXIS_NAMES = {
    "lon": {"lon", "longitude"},
    "lat": {"lat", "latitude"},
    "time": {"time", "month", "time_counter", "valid_time"},
    "level": {"depth", "deptht", "lev", "level", "elevation", "z", "zlev"},
}
# Depth down to which the uppermost level is used for the surface, m; with a note if it is deeper
# than the surface proper.
_MAX_DEPTH_M = 20.0
# Units of a depth, and of levels that are numbers or shares of it; and beginnings of standard names
# of levels that are counted upwards.
_METRES = ("m", "meter", "meters", "metre", "metres", "dbar", "decibar")
_NUMBERS = ("", "1", "level", "levels", "layer", "sigma_level")
_UPWARD = ("ocean_", "height", "altitude")
SWAP = "make its coordinate the axis, if it has one, as with xarray's `swap_dims({'x': 'lon'})`"
"""The remedy where an axis may have its values under another name."""
# Largest longitude and latitude, degrees, and the largest span as a share of the whole: some files
# repeat a meridian, or end half a cell beyond a pole.
_MAX_LON, _MAX_LAT, _MAX_TURN = 720.0, 91.0, 1.02
# Difference below which coordinates are equal, as a share of a cell: rounding to float32.
SAME_SHARE = 1e-3


def axis_role(dataset: "xr.Dataset", dim: str) -> str:
    """Return a dimension's role: "lon", "lat", "time", "level", or "" where it is unknown."""
    attributes = dataset[dim].attrs if dim in dataset.variables else {}
    standard = str(attributes.get("standard_name", ""))
    units = str(attributes.get("units", ""))
    if standard.startswith(("grid_", "projection_")):
        return ""  # of a turned grid, or in metres
    for kind, long in (("lon", "longitude"), ("lat", "latitude")):
        if standard == long or units in _DEGREES[kind]:
            return kind
    if standard == "time" or " since " in units or attributes.get("axis") == "T":
        return "time"
    is_vertical = standard.startswith(("depth", "model_level", *_UPWARD))
    if is_vertical or "positive" in attributes or attributes.get("axis") == "Z":
        return "level"
    for kind, names in _AXIS_NAMES.items():
        if dim.lower() in names and not standard:
            return kind
    return ""


def grid_fault(dataset: "xr.Dataset", array: "xr.DataArray") -> str:
    """Say what kind of grid a variable has that is not along longitude and latitude."""
    dims = ", ".join(f"{dim} ({size})" for dim, size in array.sizes.items())
    remedy = (
        "turn components that are along its lines to east and north first, and then put them on a "
        "regular grid, as in docs/how-to/own-currents.md, 'A turned grid'"
    )
    for name, other in dataset.variables.items():
        is_lon = other.attrs.get("standard_name") == "longitude" or "lon" in str(name).lower()
        if is_lon and other.ndim == 2 and set(other.dims) <= set(array.dims):
            along = ", ".join(map(str, other.dims))
            return f"{array.name}'s grid is curvilinear ({name} is along {along}); {remedy}"
    return (
        f"{array.name} is along {dims}, not along a latitude and a longitude; {SWAP}, or {remedy}"
    )


def surface_level(dataset: "xr.Dataset", dim: str) -> tuple[int, list[Note]]:
    """Return the index of the uppermost level, and notes; ValueError where none can be told."""
    attributes, levels = {}, np.arange(dataset.sizes.get(dim, 1), dtype=float)
    if dim in dataset.variables:
        attributes = dataset[dim].attrs
        levels = np.atleast_1d(coordinate_values(dataset, dim))
    if not np.isfinite(levels).all():
        raise ValueError(f"{dim} has levels that are no finite numbers; correct them")
    keys = ("standard_name", "units", "positive")
    standard, unit, up = (str(attributes.get(key, "")).strip().lower() for key in keys)
    is_depth = unit in _METRES or (not unit and standard == "depth")
    is_named_depth = is_depth and "depth" in (standard, dim[:5].lower())
    if not up and (standard.startswith(_UPWARD[1:]) or levels.max() <= 0):
        up = "up"
    elif not up and (is_named_depth or levels.size == 1):
        up = "down"
    is_wrong = {"up": is_depth and levels.max() > 0, "down": levels.min() < 0}.get(up, True)
    if is_wrong or not (is_depth or unit in _NUMBERS):
        raise ValueError(
            f"{dim} ({levels[0]:g} to {levels[-1]:g} {unit}) does not say which is the surface: "
            f"keep that alone, without {dim}, as with xarray's `isel({dim}=…, drop=True)`"
        )
    index = int(levels.argmax() if up == "up" else levels.argmin())
    depth_m = abs(float(levels[index]))
    if not is_depth:
        assumed = Note.of("level-assumed", level=dim, value=float(levels[index]))
        return index, [assumed] * (levels.size == 1)
    if depth_m > _MAX_DEPTH_M:
        raise ValueError(
            f"its uppermost level ({dim}) is {depth_m:g} m deep; give currents of the surface"
        )
    return index, [Note.of("current-at-depth", depth_m=depth_m)] * (depth_m > SURFACE_DEPTH_M)


def time_axis(dataset: "xr.Dataset", dim: str) -> "tuple[xr.DataArray | None, FloatArray | None]":
    """Return the time coordinate and its bounds (n, 2); neither for a single step without time."""
    if dim not in dataset.variables:
        if dataset.sizes[dim] == 1:
            return None, None
        raise ValueError(f"{dim} has {dataset.sizes[dim]} steps without times; add the coordinate")
    values = np.atleast_1d(coordinate_values(dataset, dim))
    time = dataset[dim].copy(deep=False, data=values.reshape(dataset[dim].shape))
    time.attrs = {key: dataset.attrs[key] for key in ZONES if key in dataset.attrs} | time.attrs
    return time, _bounds(dataset, dim, values.size)


def _bounds(dataset: "xr.Dataset", dim: str, size: int) -> FloatArray | None:
    """Return bounds (n, 2) of a coordinate; None where it has none."""
    name = dataset[dim].attrs.get("bounds", "")
    bounds = dataset.variables.get(name)
    if bounds is None or bounds.shape != (size, 2):
        return None
    values = coordinate_values(dataset, name)
    if not np.isfinite(values).all():
        raise ValueError(f"{name} has values that are no finite numbers; correct or remove it")
    return values


def coordinate_axis(dataset: "xr.Dataset", dim: str, period: float = 0.0) -> FloatArray:
    """Return a monotonic axis in degrees, unwrapped where it has a period; else ValueError."""
    if dim not in dataset.variables:
        raise ValueError(f"{dim} has no values; {SWAP}, or add the coordinate")
    values = coordinate_values(dataset, dim)
    if values.ndim != 1 or values.size < 2 or not np.isfinite(values).all():
        raise ValueError(f"{dim} is no axis of a grid: {values.size} values, or some not finite")
    if period:
        values = np.unwrap(values, period=period)
    limit, span = (_MAX_LON, 360.0) if period else (_MAX_LAT, 180.0)
    if np.abs(values).max() > limit or np.ptp(values) > span * _MAX_TURN:
        raise ValueError(
            f"{dim} reaches from {values.min():g} to {values.max():g}, which are no degrees of "
            f"{'longitude' if period else 'latitude'}; correct it"
        )
    step = np.diff(values)
    if not ((step > 0).all() or (step < 0).all()):
        raise ValueError(f"{dim} neither ascends nor descends, or has values twice; sort it")
    bounds = _bounds(dataset, dim, values.size)
    if bounds is not None:
        offset = bounds - values[:, None]
        if period:
            offset = (offset + period / 2) % period - period / 2
        slack = SAME_SHARE * float(np.abs(step).min())
        if (offset.min(axis=1) > slack).any() or (offset.max(axis=1) < -slack).any():
            name = dataset[dim].attrs["bounds"]
            raise ValueError(
                f"{dim} lies outside its own bounds ({name}), so it was shifted; correct it"
            )
    return values


def coordinate_names(dataset: "xr.Dataset", dim: str) -> tuple[str, ...]:
    """Read the names along a dimension; ValueError where it has none, or has one twice."""
    values: list[Any] = []
    if dim in dataset.variables and dataset.variables[dim].ndim == 1:
        with reading():
            values = dataset.variables[dim].values.tolist()
    texts = [one.decode(errors="replace") if isinstance(one, bytes) else one for one in values]
    names = [clean(one) if isinstance(one, str) else one for one in texts]
    if not names or not all(isinstance(one, str) for one in names):
        raise ValueError(f"{dim} has no names; add the coordinate: ['M2', 'S2', …]")
    if len({one.upper() for one in names}) < len(names):
        raise ValueError(f"{dim} has a name twice ({', '.join(names)}); leave one out")
    return tuple(names)


def is_same_axis(own: FloatArray, other: FloatArray) -> bool:
    """Whether two axes have the same values, except for rounding."""
    if own.shape != other.shape:
        return False
    return bool(np.abs(own - other).max() <= SAME_SHARE * np.abs(np.diff(other)).min())
