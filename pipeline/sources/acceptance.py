"""Is a downloaded field what was asked for? Nothing is planned on before it has passed here.

A chunk that fails to download comes as NaN with success, a file cut short may open, and a field
shifted by half a degree looks like any other. So the axes are compared with the request, the
speeds with what the sea does, and the gaps with the land.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from pipeline.errors import StageError

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from pipeline.model import Land

    FloatArray = npt.NDArray[np.float64]
    BoolArray = npt.NDArray[np.bool_]

_UNITS = {"m s-1", "m/s", "m.s-1", "m s**-1", "m s^-1", "meter second-1", "metre second-1"}
_STANDARD_NAMES = {
    "eastward": ("eastward", "_x_velocity"),
    "northward": ("northward", "_y_velocity"),
}
# Steps of an axis kept in float32 (6e-6 degrees at 122) may differ by this share of a cell.
_STEP_TOLERANCE = 1e-3
# Surface levels lie above this depth.
_SURFACE_M = 2.0
# Cells this many cells or more from any land on every side should have figures, and cells as far
# inland none. Straits and shallows that the model leaves out make up for some.
_FAR_CELLS = 3
_MOST_MISPLACED = 0.02


@dataclass(frozen=True, slots=True)
class Expected:
    """What was asked for: a month, a region (west, south, east, north) and the field's ways."""

    month: str
    region: tuple[float, float, float, float]
    cell_deg: float
    eastward: str
    northward: str
    speed_limit_m_s: float


@dataclass(frozen=True, slots=True)
class Field:
    """Ascending lon (nx,) and lat (ny,) in degrees; u, v (ny, nx) m/s, NaN where no water."""

    lon: FloatArray
    lat: FloatArray
    u: FloatArray
    v: FloatArray


def accept(path: Path, expected: Expected, land: Land) -> Field:
    """Read a NetCDF file and return its field, or refuse it with every reason.

    Raises
    ------
    StageError
        The file can't be read, or is not what was asked for.
    """
    import netCDF4

    try:
        with netCDF4.Dataset(path) as dataset:
            faults, field = _read(dataset, expected)
    except (OSError, RuntimeError, KeyError, ValueError, IndexError) as error:
        raise StageError(f"{path.name} can't be read as NetCDF: {error}") from None
    if field is not None:
        faults += _speed_faults(field, expected) + _gap_faults(field, land)
    if faults or field is None:
        raise StageError(f"{path.name} is not what was asked for: {'; '.join(faults)}")
    return field


def _read(dataset: Any, expected: Expected) -> tuple[list[str], Field | None]:
    """Read axes and field, with the faults of both; no field where it makes no sense."""
    wanted = {"eastward": expected.eastward, "northward": expected.northward}
    absent = [name for name in wanted.values() if name not in dataset.variables]
    if absent:
        return [f"no variable {name!r}" for name in absent], None
    faults = [
        fault
        for direction, name in wanted.items()
        for fault in _variable_faults(dataset[name], direction)
    ]
    lon, flip_x, lon_faults = _axis(dataset, "longitude", expected.cell_deg)
    lat, flip_y, lat_faults = _axis(dataset, "latitude", expected.cell_deg)
    faults += lon_faults + lat_faults + _time_faults(dataset, expected.month)
    faults += _depth_faults(dataset)
    layers = [_layer(dataset[name], lat.size, lon.size) for name in wanted.values()]
    if any(layer is None for layer in layers):
        shapes = [tuple(dataset[name].shape) for name in wanted.values()]
        return [*faults, f"{shapes} is not one time step on {lat.size} × {lon.size} points"], None
    if faults:
        return faults, None
    # Longitudes of whole turns away are the same place.
    west, _, east, _ = expected.region
    centre = (west + east) / 2
    lon = lon + 360 * np.round((centre - lon.mean()) / 360)
    faults += _extent_faults(lon, lat, expected)
    order = (slice(None, None, flip_y), slice(None, None, flip_x))
    u, v = (np.asarray(layer)[order] for layer in layers)
    if (np.isfinite(u) != np.isfinite(v)).any():
        faults.append("one component has gaps where the other has none")
    return faults, Field(lon, lat, u, v)


def _variable_faults(variable: Any, direction: str) -> list[str]:
    """Units and standard name of a component."""
    faults = []
    units = getattr(variable, "units", "")
    if units.strip() not in _UNITS:
        faults.append(f"{variable.name} is in {units!r}, not m/s")
    standard = getattr(variable, "standard_name", "")
    if standard and not any(part in standard for part in _STANDARD_NAMES[direction]):
        faults.append(f"{variable.name} is {standard!r}, not the {direction} velocity")
    return faults


def _axis(dataset: Any, name: str, cell_deg: float) -> tuple[FloatArray, int, list[str]]:
    """Ascending axis, the step (1 or -1) that its data are to be read with, and its faults."""
    values = np.ma.filled(dataset[name][:], np.nan).astype(float)
    if values.ndim != 1 or values.size < 2 or not np.isfinite(values).all():
        return values.ravel(), 1, [f"{name} is no axis: shape {values.shape}"]
    flip = 1 if values[-1] > values[0] else -1
    values = values[::flip]
    step = np.diff(values)
    if np.abs(step - cell_deg).max() > _STEP_TOLERANCE * cell_deg:
        return (
            values,
            flip,
            [f"{name} steps by {step.min():.5g} to {step.max():.5g} degrees, not {cell_deg:.5g}"],
        )
    return values, flip, []


def _time_faults(dataset: Any, month: str) -> list[str]:
    """Exactly one time step, inside the month."""
    import netCDF4

    if "time" not in dataset.variables:
        return ["no time axis"]
    time = dataset["time"]
    calendar = getattr(time, "calendar", "standard")
    stamps = np.atleast_1d(np.asarray(netCDF4.num2date(time[:], time.units, calendar)))
    months = [stamp.strftime("%Y-%m") for stamp in stamps]
    return [] if months == [month] else [f"its months are {months}, not [{month!r}]"]


def _depth_faults(dataset: Any) -> list[str]:
    """At most one level, at the surface."""
    for name in ("depth", "elevation"):
        if name in dataset.variables:
            levels = np.abs(np.atleast_1d(np.ma.filled(dataset[name][:], np.nan)))
            if levels.size != 1 or not levels[0] < _SURFACE_M:
                return [f"its levels are {levels[:4].tolist()} m, not the surface alone"]
    return []


def _layer(variable: Any, ny: int, nx: int) -> FloatArray | None:
    """The variable's only layer (ny, nx), NaN where masked; None where it has another shape."""
    values = np.ma.filled(np.ma.asarray(variable[:]).astype(float), np.nan)
    if values.size != ny * nx or values.shape[-2:] != (ny, nx):
        return None
    return np.asarray(values, dtype=float).reshape(ny, nx)


def _extent_faults(lon: FloatArray, lat: FloatArray, expected: Expected) -> list[str]:
    """The axes reach over the region: to its edge, or half a cell short at the grid's own end."""
    half = expected.cell_deg / 2
    west, south, east, north = expected.region
    return [
        f"{name} ends at {end:.4f}; the region reaches {limit:g}"
        for name, end, limit, is_short in (
            ("longitude", lon[0], west, lon[0] > west + half),
            ("longitude", lon[-1], east, lon[-1] < east - half),
            ("latitude", lat[0], south, lat[0] > south + half),
            ("latitude", lat[-1], north, lat[-1] < north - half),
        )
        if is_short
    ]


def _speed_faults(field: Field, expected: Expected) -> list[str]:
    """Some water, some movement, no speed that the sea does not know."""
    speed = np.hypot(field.u, field.v)
    if not np.isfinite(speed).any():
        return ["it has no figures at all"]
    strongest = float(np.nanmax(speed))
    if strongest > expected.speed_limit_m_s:
        limit = expected.speed_limit_m_s
        return [f"speeds reach {strongest:.3g} m/s, above {limit:g}: another unit, or damaged"]
    return [] if strongest > 0 else ["every speed is 0"]


def _gap_faults(field: Field, land: Land) -> list[str]:
    """Gaps lie where the land is: neither in open water, nor figures far inland."""
    is_land = _on_land(field, land)
    gap = ~np.isfinite(field.u)
    faults = []
    open_water, inland = ~_grown(is_land), ~_grown(~is_land)
    for where, wrong, what in (
        (open_water, gap, "in open water have no figures: a part was not delivered"),
        (inland, ~gap, "far inland have figures: the field is shifted"),
    ):
        count = int((where & wrong).sum())
        if count > _MOST_MISPLACED * max(int(where.sum()), 1):
            faults.append(f"{count} of {int(where.sum())} cells {what}")
    return faults


def _on_land(field: Field, land: Land) -> BoolArray:
    """Which cells' centres lie on land: (ny, nx)."""
    x, y = np.meshgrid(field.lon, field.lat)
    on_land = np.zeros(x.size, dtype=bool)
    if land.polygons:
        tree = shapely.STRtree(land.polygons)
        points = shapely.points(x.ravel(), y.ravel())
        on_land[np.unique(tree.query(points, predicate="intersects")[0])] = True
    return on_land.reshape(x.shape)


def _grown(cells: BoolArray) -> BoolArray:
    """Cells within `_FAR_CELLS` of a marked one, or of the grid's edge: outside is not known."""
    from scipy.ndimage import binary_dilation

    square = np.ones((2 * _FAR_CELLS + 1,) * 2, dtype=bool)
    return np.asarray(binary_dilation(cells, square, border_value=1), dtype=bool)
