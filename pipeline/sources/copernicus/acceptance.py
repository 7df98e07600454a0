"""Acceptance check of downloaded fields: they are used only if they are the requested ones.

A chunk that fails to download arrives as NaN without an error, a truncated file may still open, and
a field shifted by half a degree looks like any other. So the axes are compared with the request,
the speeds with the sea's, and the gaps with the land and between time steps.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from shapely.geometry import Polygon

from pipeline._types import FloatArray
from pipeline.errors import StageError
from pipeline.geo.lonlat import Bounds, cell_bounds, sides_beyond, widened
from pipeline.model import Land, Note
from pipeline.scenario.catalogue import CopernicusSpec
from pipeline.sources.cf.axes import coordinate_axis, decoded_times
from pipeline.sources.cf.dataset import coordinate_values, open_dataset, reading
from pipeline.sources.cf.fields import Window, find_window, read_window
from pipeline.sources.copernicus.client import around_missing
from pipeline.sources.current_field import SURFACE_DEPTH_M, Field, LandMask, water_without_data
from pipeline.sources.plausibility import assess_series, count_misplaced, dilated

if TYPE_CHECKING:
    import xarray as xr

_UNITS = {"m s-1", "m/s", "m.s-1", "m s**-1", "m s^-1", "meter second-1", "metre second-1"}
_STANDARD_NAMES = {
    "eastward": ("eastward", "_x_velocity"),
    "northward": ("northward", "_y_velocity"),
}
# Deviation of an axis's steps from the cell size, as a share of it, that rounding to float32 may
# cause: 6e-6 degrees at 122 degrees.
_STEP_TOLERANCE = 1e-3
# Limit of the difference between a cell and all its neighbours, to find flipped bits. It is the
# larger of a speed (the first, m/s) and a multiple (the second) of the differences among the
# neighbours, and at most a share (the third) of the speed limit. Of 1.7 million cells of real
# fields (GLO12, DUACS, OCM at 1, 1/4 and 1/10 degree) none exceeds 0.2 m/s and 3 times at once, and
# none 0.6 m/s.
_SPIKE_M_S, _SPIKE_RATIO, _SPIKE_SHARE = 0.3, 4.0, 0.25
# Least number of neighbours with data that a cell is compared with.
_MIN_NEIGHBOURS = 5
# Largest share of open water without data, and of cells far inland with data: models leave out
# straits and shallows.
_MAX_MISPLACED_SHARE = 0.02


# Dimensions of the service's files along the axes, and cells that are kept around the region.
_DIMS, _KEPT_CELLS = ("latitude", "longitude"), 5


@dataclass(frozen=True, slots=True)
class Expected:
    """A request of a dataset: time steps, and a region in lon/lat degrees.

    The field is the sum of the steps times their `weights`; without any each step is a field of
    its own. `labels` are the steps' times in `label_format` (strftime). `missing_boxes` hold the
    centres of the cells for which the service has no chunk, which should be land.
    """

    spec: CopernicusSpec
    labels: tuple[str, ...]
    weights: tuple[float, ...]
    label_format: str
    region: Polygon
    missing_boxes: tuple[Bounds, ...] = ()


@dataclass(frozen=True, slots=True)
class AcceptedFields:
    """Ascending lon (nx,) and lat (ny,) in degrees; u, v (nt, ny, nx) in m/s, NaN where no data.

    All times have the same gaps. `notes` are suspicions about the fields that do not suffice to
    refuse them.
    """

    lon: FloatArray
    lat: FloatArray
    u: FloatArray
    v: FloatArray
    notes: tuple[Note, ...] = ()

    def at_each_time(self) -> Iterator[Field]:
        """Yield the fields one by one."""
        for u, v in zip(self.u, self.v, strict=True):
            yield Field(self.lon, self.lat, u, v)


def accept(path: Path, expected: Expected, land: Land) -> AcceptedFields:
    """Read a NetCDF file and return its fields, or refuse it with all reasons.

    Raises
    ------
    StageError
        The file can't be read, or does not have the requested content.
    """
    try:
        with open_dataset(path) as dataset, reading():
            faults, fields = _read(dataset, expected)
    except ValueError as error:
        raise StageError(f"{path.name}: {error}") from None
    if fields is not None:
        mask = LandMask.of(land.polygons, expected.region.bounds)
        first = next(fields.at_each_time())
        faults = _missing_chunk_faults(first, expected, mask) + faults + _gap_faults(first, mask)
        if not faults:
            labels = expected.labels[: len(fields.u)]
            limit_m_s = expected.spec.speed_limit_m_s
            assessment = assess_series(fields.at_each_time(), labels, mask, limit_m_s)
            faults = list(assessment.faults)
            lacking = water_without_data(first, mask, expected.region)
            doubts = [
                Note.of("current-doubtful", source=expected.spec.dataset, warning=warning)
                for warning in assessment.warnings
            ]
            fields = replace(fields, notes=(*doubts, *((lacking.note,) if lacking else ())))
    if faults or fields is None:
        raise StageError(f"{path.name} is not what was requested: {'; '.join(faults)}")
    return fields


def _read(dataset: "xr.Dataset", expected: Expected) -> tuple[list[str], AcceptedFields | None]:
    """Read axes and fields, with the faults of both; no fields where the axes are wrong."""
    wanted = {"eastward": expected.spec.eastward, "northward": expected.spec.northward}
    needed = (*wanted.values(), "longitude", "latitude", "time")
    if absent := [name for name in needed if name not in dataset.variables]:
        return [f"no variable {name!r}" for name in absent], None
    lon = coordinate_axis(dataset, "longitude", period=360.0)
    lat = coordinate_axis(dataset, "latitude")
    faults = [
        *(
            fault
            for direction, name in wanted.items()
            for fault in _variable_faults(dataset[name], direction)
        ),
        *_step_faults("longitude", lon, expected.spec.cell_deg),
        *_step_faults("latitude", lat, expected.spec.cell_deg),
        *_time_faults(dataset, expected),
        *_depth_faults(dataset),
    ]
    if faults:
        return faults, None
    margin = _KEPT_CELLS * expected.spec.cell_deg
    window = find_window(lon, lat, widened(expected.region.bounds, margin, margin))
    if not (window.lon.size and window.lat.size):
        return ["it has no data in the region"], None
    faults, u, v = _read_fields(dataset, expected, window)
    faults += _extent_faults(window, expected)
    return faults, AcceptedFields(window.lon, window.lat, u, v)


def _read_fields(
    dataset: "xr.Dataset", expected: Expected, window: Window
) -> tuple[list[str], FloatArray, FloatArray]:
    """Return both components of the fields (nt, ny, nx), and the first faulty step's faults.

    Step by step, so that a month of hours need not fit in memory where its mean is the field.
    """
    shape = (window.lat.size, window.lon.size)
    count = 1 if expected.weights else len(expected.labels)
    u_fields, v_fields = np.zeros((count, *shape)), np.zeros((count, *shape))
    first_gap, fastest_m_s = None, expected.spec.speed_limit_m_s
    for step, label in enumerate(expected.labels):
        u, v = (
            read_window(dataset.variables[name].isel(time=step), _DIMS, window).reshape(shape)
            for name in (expected.spec.eastward, expected.spec.northward)
        )
        gap = ~np.isfinite(u)
        first_gap = gap if first_gap is None else first_gap
        faults = []
        if (gap == np.isfinite(v)).any():
            faults.append("one component has gaps where the other has none")
        if not expected.spec.gaps_vary and (changed := int((gap != first_gap).sum())):
            faults.append(
                f"{changed} cells have gaps either at {label} or at {expected.labels[0]}, not at "
                "both: a part was not delivered"
            )
        strongest = float(np.max(np.hypot(u, v), initial=0.0, where=np.isfinite(u * v)))
        if strongest > fastest_m_s:
            faults.append(
                f"at {label} speeds reach {strongest:.3g} m/s, above {fastest_m_s:g}: another "
                "unit, or damaged"
            )
        limit_m_s = _SPIKE_SHARE * fastest_m_s
        if spike := max(largest_spike(u, limit_m_s), largest_spike(v, limit_m_s)):
            faults.append(
                f"at {label} a cell stands out from its neighbours by {spike:.3g} m/s: damaged"
            )
        if faults:
            return faults, u[None], v[None]
        field, weight = (0, expected.weights[step]) if expected.weights else (step, 1.0)
        u_fields[field] += weight * u
        v_fields[field] += weight * v
    # In fields that change, a gap at one time becomes a gap at all times, as it does in a mean.
    gap = np.logical_not(np.isfinite(u_fields).all(axis=0))
    u_fields[:, gap] = v_fields[:, gap] = np.nan
    return [], u_fields, v_fields


def largest_spike(values: FloatArray, limit_m_s: float) -> float:
    """Return how far any cell stands out from all its neighbours, m/s; 0 within the limits."""
    from scipy.ndimage import convolve, maximum_filter

    neighbours = np.ones((3, 3), dtype=int)
    neighbours[1, 1] = 0
    known = np.isfinite(values)
    counts = convolve(known.astype(int), neighbours, mode="constant")
    is_judged = known & (counts >= _MIN_NEIGHBOURS)

    def highest_neighbour(values: FloatArray) -> FloatArray:
        filled = np.where(known, values, -np.inf)
        found = maximum_filter(filled, footprint=neighbours, mode="constant", cval=-np.inf)
        return np.asarray(found, dtype=float)

    highest, negated_lowest = highest_neighbour(values), highest_neighbour(-values)
    spike = np.maximum(values - highest, -values - negated_lowest)
    allowed = np.maximum(_SPIKE_M_S, _SPIKE_RATIO * (highest + negated_lowest))
    is_spike = is_judged & (spike > np.minimum(allowed, limit_m_s))
    return float(np.max(spike, initial=0.0, where=is_spike))


def _variable_faults(variable: "xr.DataArray", direction: str) -> Iterator[str]:
    """Say if a component has a wrong unit or standard name."""
    units = variable.attrs.get("units", "")
    if units.strip() not in _UNITS:
        yield f"{variable.name} is in {units!r}, not m/s"
    standard = variable.attrs.get("standard_name", "")
    if standard and not any(part in standard for part in _STANDARD_NAMES[direction]):
        yield f"{variable.name} is {standard!r}, not the {direction} velocity"


def _step_faults(name: str, axis: FloatArray, cell_deg: float) -> Iterator[str]:
    """Find steps of an axis that are not of a cell's size."""
    steps = np.abs(np.diff(axis))
    if np.abs(steps - cell_deg).max() > _STEP_TOLERANCE * cell_deg:
        yield f"{name} steps by {steps.min():.5g} to {steps.max():.5g} degrees, not {cell_deg:.5g}"


def _time_faults(dataset: "xr.Dataset", expected: Expected) -> list[str]:
    """Find whether the file lacks time steps, or has others than requested."""
    time, values = dataset["time"], coordinate_values(dataset, "time").reshape(-1)
    stamps = decoded_times(time, values, time.attrs.get("units", ""))
    labels = tuple(stamp.strftime(expected.label_format) for stamp in stamps)
    if labels == expected.labels:
        return []
    lacking = [label for label in expected.labels if label not in labels]
    first = f"; {lacking[0]} is missing{around_missing(labels, lacking[0])}" if lacking else ""
    return [f"its times are {_shortened(labels)}, not {_shortened(expected.labels)}{first}"]


def _shortened(labels: tuple[str, ...]) -> str:
    """List labels, but only the first and the last where there are many."""
    if len(labels) <= 3:
        return str(list(labels))
    return f"[{labels[0]!r} … {labels[-1]!r}] ({len(labels)})"


def _depth_faults(dataset: "xr.Dataset") -> list[str]:
    """Find levels other than one at the surface."""
    for name in {"depth", "elevation"} & dataset.variables.keys():
        levels = np.abs(coordinate_values(dataset, name).reshape(-1))
        if levels.size != 1 or not levels[0] < SURFACE_DEPTH_M:
            return [f"its levels are {levels[:4].tolist()} m, not the surface alone"]
    return []


def _extent_faults(window: Window, expected: Expected) -> list[str]:
    """Find sides of the region that the cells don't cover."""
    cell_deg = expected.spec.cell_deg
    cells = cell_bounds(window.lon, window.lat, (cell_deg, cell_deg))
    lacking = sides_beyond(expected.region.bounds, cells)
    return [f"it has no data {' nor '.join(lacking)}"] if lacking else []


def _gap_faults(field: Field, mask: LandMask) -> list[str]:
    """Find gaps in open water, and data far inland."""
    messages = (
        "in open water have no data: a part was not delivered",
        "far inland have data: the field is shifted",
    )
    return [
        f"{wrong} of {cells} cells {message}"
        for (wrong, cells), message in zip(count_misplaced(field, mask), messages, strict=True)
        if wrong > _MAX_MISPLACED_SHARE * max(cells, 1)
    ]


def _missing_chunk_faults(field: Field, expected: Expected, mask: LandMask) -> list[str]:
    """Find water in chunks that the service does not have.

    It stores no chunk without data, and gives the same answer when it fails. Cells beside land may
    be land to a coarse model; there the gap is filled from the water beside it anyway.
    """
    if not expected.missing_boxes:
        return []
    cell = expected.spec.cell_deg
    missing = np.zeros(field.u.shape, dtype=bool)
    for west, south, east, north in expected.missing_boxes:
        # Counted eastward from the box's west edge, as both may be whole turns apart.
        column = (field.lon - west + cell / 2) % 360 <= east - west + cell
        row = (field.lat >= south - cell / 2) & (field.lat <= north + cell / 2)
        missing |= row[:, None] & column[None, :]
    # Further out the field is not used, and the land is not known.
    west, south, east, north = widened(expected.region.bounds, cell, cell)
    column = (field.lon > west) & (field.lon < east)
    row = (field.lat > south) & (field.lat < north)
    wet = missing & row[:, None] & column[None, :]
    wet &= ~dilated(mask.on_grid(field.lon, field.lat), 1, edge_counts=False)
    if not wet.any():
        return []
    return [
        f"the service had no data for {int(wet.sum())} cells of water: a part was not delivered"
    ]
