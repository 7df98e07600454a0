"""Is a downloaded field what was asked for? Nothing is planned on before it has passed here.

A chunk that fails to download comes as NaN with success, a file cut short may open, and a field
shifted by half a degree looks like any other. So the axes are compared with the request, the
speeds with what the sea does, and the gaps with the land and with every other time step's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.errors import StageError
from pipeline.sources.quality import plausibility as plausible
from pipeline.sources.quality.field import Field, Shore

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from pipeline.model import Land

    FloatArray = npt.NDArray[np.float64]

_UNITS = {"m s-1", "m/s", "m.s-1", "m s**-1", "m s^-1", "meter second-1", "metre second-1"}
_STANDARD_NAMES = {
    "eastward": ("eastward", "_x_velocity"),
    "northward": ("northward", "_y_velocity"),
}
# Steps of an axis kept in float32 (6e-6 degrees at 122) may differ by this share of a cell.
_STEP_TOLERANCE = 1e-3
# Surface levels lie above this depth.
_SURFACE_M = 2.0
# How far a cell may stand out from all of its neighbours, as a bit that has flipped makes it: so
# many m/s and so many times what these differ by among themselves, and in any case no more than
# that share of the strongest current. Of 1.7 million cells of real fields (GLO12, DUACS, OCM at 1,
# 1/4 and 1/10 degree) none does by 0.2 m/s and 3 times, and none by 0.6 m/s.
_SPIKE_M_S, _SPIKE_TIMES, _SPIKE_SHARE = 0.3, 4.0, 0.25
_FEWEST_NEIGHBOURS = 5
# Share of the cells far from any land that may lack figures, and of those far inland that may not:
# straits and shallows that the model leaves out.
_MOST_MISPLACED = 0.02


@dataclass(frozen=True, slots=True)
class Expected:
    """What was asked for: time steps, a region (west, south, east, north) and the field's ways.

    The field is the sum of the steps by their `weights`; a step's time, written by `form`
    (strftime), is its label. `missing` are boxes of cells (centres, west, south, east, north) that
    the service had nothing for, as it has it for land. `gaps_vary` where ice comes and goes.
    """

    labels: tuple[str, ...]
    weights: tuple[float, ...]
    form: str
    region: tuple[float, float, float, float]
    cell_deg: float
    eastward: str
    northward: str
    speed_limit_m_s: float
    missing: tuple[tuple[float, float, float, float], ...] = ()
    gaps_vary: bool = False


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
        shore = Shore.of(land, expected.region)
        faults = _missing_faults(field, expected, shore) + faults + _gap_faults(field, shore)
        if not faults:
            verdict = plausible.judged(field, shore, expected.speed_limit_m_s)
            faults = list(verdict.faults)
            field = replace(field, doubts=verdict.doubts)
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
    faults += lon_faults + lat_faults + _time_faults(dataset, expected)
    faults += _depth_faults(dataset)
    if faults:
        return faults, None
    faults, u, v = _sum(dataset, expected, (lat.size, lon.size))
    # Longitudes of whole turns away are the same place.
    west, _, east, _ = expected.region
    centre = (west + east) / 2
    lon = lon + 360 * np.round((centre - lon.mean()) / 360)
    faults += _extent_faults(lon, lat, expected)
    order = (slice(None, None, flip_y), slice(None, None, flip_x))
    return faults, Field(lon, lat, u[order], v[order])


def _sum(
    dataset: Any, expected: Expected, shape: tuple[int, int]
) -> tuple[list[str], FloatArray, FloatArray]:
    """Both components, the steps weighted, as they lie in the file; the faults of any step.

    One step after the other: a month of hours need not lie in memory.
    """
    u_sum, v_sum = np.zeros(shape), np.zeros(shape)
    gaps = None
    for place, (label, weight) in enumerate(zip(expected.labels, expected.weights, strict=True)):
        u, v = (
            _layer(dataset[name], place, shape) for name in (expected.eastward, expected.northward)
        )
        gap = ~np.isfinite(u)
        gaps = gap if gaps is None else gaps
        faults = []
        if (gap == np.isfinite(v)).any():
            faults.append("one component has gaps where the other has none")
        if not expected.gaps_vary and (differ := int((gap != gaps).sum())):
            faults.append(
                f"at {label} {differ} cells have gaps and at {expected.labels[0]} have none, or "
                "the other way round: a part was not delivered"
            )
        strongest = float(np.max(np.hypot(u, v), initial=0.0, where=np.isfinite(u * v)))
        if strongest > expected.speed_limit_m_s:
            faults.append(
                f"at {label} speeds reach {strongest:.3g} m/s, above {expected.speed_limit_m_s:g}: "
                "another unit, or damaged"
            )
        most = _SPIKE_SHARE * expected.speed_limit_m_s
        if spike := max(_spike(u, most), _spike(v, most)):
            faults.append(
                f"at {label} a cell stands out from its neighbours by {spike:.3g} m/s: damaged"
            )
        if faults:
            return faults, u, v
        u_sum += weight * u
        v_sum += weight * v
    return [], u_sum, v_sum


def _spike(values: FloatArray, most_m_s: float) -> float:
    """How far the worst cell stands out from its neighbours where it does by too much, else 0."""
    from scipy.ndimage import convolve, maximum_filter

    around = np.ones((3, 3), dtype=int)
    around[1, 1] = 0
    known = np.isfinite(values)
    judged = known & (convolve(known.astype(int), around, mode="constant") >= _FEWEST_NEIGHBOURS)

    def highest(side: FloatArray) -> FloatArray:
        filled = np.where(known, side, -np.inf)
        found = maximum_filter(filled, footprint=around, mode="constant", cval=-np.inf)
        return np.asarray(found, dtype=float)

    above, below = highest(values), highest(-values)
    out = np.maximum(values - above, -values - below)
    allowed = np.maximum(_SPIKE_M_S, _SPIKE_TIMES * (above + below))
    return float(np.max(out, initial=0.0, where=judged & (out > np.minimum(allowed, most_m_s))))


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


def _time_faults(dataset: Any, expected: Expected) -> list[str]:
    """Exactly the time steps that were asked for."""
    import netCDF4

    if "time" not in dataset.variables:
        return ["no time axis"]
    time = dataset["time"]
    calendar = getattr(time, "calendar", "standard")
    stamps = np.atleast_1d(np.asarray(netCDF4.num2date(time[:], time.units, calendar)))
    labels = tuple(stamp.strftime(expected.form) for stamp in stamps)
    if labels == expected.labels:
        return []
    return [f"its times are {_listed(labels)}, not {_listed(expected.labels)}"]


def _listed(labels: tuple[str, ...]) -> str:
    """Spell labels out, the first and the last where they are many."""
    if len(labels) <= 3:
        return str(list(labels))
    return f"[{labels[0]!r} … {labels[-1]!r}] ({len(labels)})"


def _depth_faults(dataset: Any) -> list[str]:
    """At most one level, at the surface."""
    for name in ("depth", "elevation"):
        if name in dataset.variables:
            levels = np.abs(np.atleast_1d(np.ma.filled(dataset[name][:], np.nan)))
            if levels.size != 1 or not levels[0] < _SURFACE_M:
                return [f"its levels are {levels[:4].tolist()} m, not the surface alone"]
    return []


def _layer(variable: Any, place: int, shape: tuple[int, int]) -> FloatArray:
    """The variable's layer (ny, nx) at a time step, NaN where masked; ValueError where it is none.

    A level of depth may lie between, as long as it is the only one.
    """
    if variable.dimensions[0] != "time" or variable.shape[-2:] != shape:
        raise ValueError(f"{variable.name} has {variable.dimensions} of {variable.shape}")
    values = np.ma.filled(np.ma.asarray(variable[place]).astype(float), np.nan)
    return np.asarray(values, dtype=float).reshape(shape)


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


def _gap_faults(field: Field, shore: Shore) -> list[str]:
    """Gaps lie where the land is: neither in open water, nor figures far inland."""
    counts = plausible.misplaced(field, shore)
    said = (
        "in open water have no figures: a part was not delivered",
        "far inland have figures: the field is shifted",
    )
    return [
        f"{wrong} of {cells} cells {what}"
        for (wrong, cells), what in zip(counts, said, strict=True)
        if wrong > _MOST_MISPLACED * max(cells, 1)
    ]


def _missing_faults(field: Field, expected: Expected, shore: Shore) -> list[str]:
    """What the service had nothing for is land: so it keeps it, and so it answers when it fails.

    Cells beside land may be land to a coarse model; there the water beside them fills in anyway.
    """
    if not expected.missing:
        return []
    half = expected.cell_deg / 2
    west, south, east, north = expected.region
    missing = np.zeros(field.u.shape, dtype=bool)
    for box_west, box_south, box_east, box_north in expected.missing:
        # Counted eastward from the box's own west, whatever turn either is in.
        column = (field.lon - box_west + half) % 360 <= box_east - box_west + 2 * half
        row = (field.lat >= box_south - half) & (field.lat <= box_north + half)
        missing |= row[:, None] & column[None, :]
    # Further out nothing is read of the field, and the land is not known.
    column = (field.lon > west - 2 * half) & (field.lon < east + 2 * half)
    row = (field.lat > south - 2 * half) & (field.lat < north + 2 * half)
    wet = missing & row[:, None] & column[None, :]
    wet &= ~plausible.grown(shore.cells(field.lon, field.lat), 1, at_edge=False)
    if not wet.any():
        return []
    return [
        f"the service had no data for {int(wet.sum())} cells of water: a part was not delivered"
    ]
