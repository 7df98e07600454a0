"""Reading a region from the user's files: of a global file, no more than a window.

The window is cut out of each step before the steps are summed, some megabytes at a time.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from pipeline._types import FloatArray, IndexArray
from pipeline.sources.cf.axes import SAME_SHARE
from pipeline.sources.cf.contents import Component, Contents
from pipeline.sources.cf.dataset import open_dataset, reading
from pipeline.sources.quality import coverage
from pipeline.sources.quality.coverage import Bounds
from pipeline.sources.quality.field import Field

if TYPE_CHECKING:
    import xarray as xr

# Amount of data read at a time, bytes; but at least one step.
_CHUNK_BYTES = 32 << 20
# Largest number of nodes in a region: checks and planning take some 600 bytes for each.
_MAX_NODES = 2_000_000
# Spacing of neighbouring nodes in largest steps of the axis, above which there is a gap between.
_GAP_STEPS = 1.5
# Number of files that are open at a time: one for each component.
_MAX_OPEN = 2


@dataclass(frozen=True)
class Window:
    """Part of a grid: ascending lon (nx,), lat (ny,) in degrees, and their indices in the files.

    `columns` are contiguous runs in the file, from west to east: two where the window crosses the
    file's own seam. The slices descend where the file's axes do.
    """

    lon: FloatArray
    lat: FloatArray
    rows: slice
    columns: tuple[slice, ...]


def find_window(lon: FloatArray, lat: FloatArray, bounds: Bounds) -> Window:
    """Find the nodes of monotonic axes inside bounds, in the bounds' own longitudes, degrees."""
    west, south, east, north = bounds
    turns = range(int((west - lon.max()) // 360), int((east - lon.min()) // 360) + 1)
    all_lon = np.concatenate([lon + 360 * turn for turn in turns])
    all_columns = np.tile(np.arange(lon.size), len(turns))
    inside = np.flatnonzero((all_lon >= west) & (all_lon <= east))
    order = inside[np.argsort(all_lon[inside], kind="stable")]
    if order.size > 1:
        # A file may have both 0 and 360 degrees.
        is_distinct = np.diff(all_lon[order]) > SAME_SHARE * np.abs(np.diff(lon)).min()
        order = order[np.concatenate([[True], is_distinct])]
    rows = np.flatnonzero((lat >= south) & (lat <= north))
    rows = rows[np.argsort(lat[rows])]
    columns = _runs(all_columns[order], 1 if lon[-1] > lon[0] else -1)
    return Window(all_lon[order], lat[rows], _runs(rows, 1 if lat[-1] > lat[0] else -1)[0], columns)


def _runs(indices: IndexArray, step: int) -> tuple[slice, ...]:
    """Divide indices into runs that go on by a step of 1 or -1, as slices; one at least."""
    ends = np.flatnonzero(np.diff(indices) != step) + 1
    return tuple(
        slice(int(run[0]), stop if (stop := int(run[-1]) + step) >= 0 else None, step)
        for run in np.split(indices, ends)
        if run.size
    ) or (slice(0, 0),)


def read_window(variable: "xr.Variable", dims: tuple[str, str], window: Window) -> FloatArray:
    """Read a variable in a window (..., ny, nx); `dims` are its dimensions along lat and lon."""
    lat, lon = dims
    runs = [
        variable.isel({lat: window.rows, lon: run}).load().transpose(..., lat, lon).values
        for run in window.columns
    ]
    return np.concatenate(runs, axis=-1).astype(float)


def coverage_faults(contents: Contents, region: Bounds) -> list[str]:
    """Say how far a region reaches beyond the grid's cells."""
    cell = contents.largest_cell
    around = find_window(contents.lon, contents.lat, coverage.widened(region, *cell))
    lon, lat = around.lon, around.lat
    if lon.size * lat.size > _MAX_NODES:
        fault = (
            f"it has {lat.size:,} x {lon.size:,} nodes in the region, more than {_MAX_NODES:,}; "
            "shrink the region, or give a coarser file, as with `ncks -d` and a stride"
        )
        return [fault]
    if lon.size == 0 or lat.size == 0:
        return ["it has no data there at all; give a file of the region"]
    lacking = coverage.sides_beyond(region, coverage.cell_bounds(lon, lat, cell))
    gaps = np.diff(lon) > _GAP_STEPS * cell[0]
    if gaps.any():
        first = int(gaps.argmax())
        lacking.append(f"between {lon[first]:g} and {lon[first + 1]:g} E")
    if lon.size < 2 or lat.size < 2:
        lacking.append("at more than one node, too few for a field")
    if not lacking:
        return []
    return [f"it has no data {' nor '.join(lacking)}; shrink the region, or give another file"]


def covered_bounds(contents: Contents, region: Bounds) -> Bounds | None:
    """Return the bounds of the part of a region that the grid's cells cover; None where none is."""
    cell = contents.largest_cell
    around = find_window(contents.lon, contents.lat, coverage.widened(region, *cell))
    if around.lon.size < 2 or around.lat.size < 2:
        return None
    return coverage.common_bounds(region, coverage.cell_bounds(around.lon, around.lat, cell))


class FieldReader:
    """Reads fields of a window, one after the other; a context manager that closes the files.

    The files read last stay open, as most often they hold the next field as well.
    """

    def __init__(self, contents: Contents, window: Window) -> None:
        self._contents, self._window = contents, window
        self._open: dict[Path, xr.Dataset] = {}

    def __enter__(self) -> Self:
        """Return itself; files are opened when they are needed."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the files."""
        self._close_all_but(0)

    def field(self, weights: Mapping[int, float]) -> Field:
        """Read the weighted sum of steps, with a gap where any step or component has one.

        Raises
        ------
        ValueError
            The file is damaged.
        """
        contents, window = self._contents, self._window
        u = self._weighted_sum(contents.u, contents.u_index, weights)
        v = self._weighted_sum(contents.v, contents.v_index, weights)
        gap = ~(np.isfinite(u) & np.isfinite(v))
        u[gap] = v[gap] = np.nan
        return Field(window.lon, window.lat, u, v)

    def _weighted_sum(
        self,
        files: Sequence[Component],
        index: Sequence[tuple[int, int]],
        weights: Mapping[int, float],
    ) -> FloatArray:
        """Weighted sum (ny, nx) of a component's steps in m/s."""
        by_file: dict[int, dict[int, float]] = {}
        for step, weight in weights.items():
            file, step_in_file = index[step]
            by_file.setdefault(file, {})[step_in_file] = weight
        total = np.zeros((self._window.lat.size, self._window.lon.size))
        for file, steps in by_file.items():
            component = files[file]
            try:
                variable = component.lazy(self._dataset(component.file))
                with reading():
                    for times, values in self._blocks(component, variable, sorted(steps)):
                        shares = [steps[time] for time in times]
                        total += component.unit_m_s * np.tensordot(shares, values, axes=1)
            except ValueError as error:
                raise ValueError(f"{component.file.name}: {error}") from None
        return total

    def _blocks(
        self, component: Component, variable: "xr.Variable", steps: Sequence[int]
    ) -> Iterator[tuple[Sequence[int], FloatArray]]:
        """Read ascending steps some megabytes at a time: their numbers, values (nt, ny, nx)."""
        window, lat, lon = self._window, component.lat, component.lon
        shape = (window.lat.size, window.lon.size)
        most = max(1, _CHUNK_BYTES // max(1, math.prod(shape) * variable.dtype.itemsize))
        for first in range(0, len(steps), most):
            times = steps[first : first + most]
            part: dict[str, slice | list[int]] = {}
            if component.time:
                is_range = times[-1] - times[0] == len(times) - 1
                part[component.time] = slice(times[0], times[-1] + 1) if is_range else list(times)
            values = read_window(variable.isel(part), (lat, lon), window)
            yield times, values.reshape(-1, *shape)

    def _dataset(self, file: Path) -> "xr.Dataset":
        """Return an open file."""
        if file not in self._open:
            self._close_all_but(_MAX_OPEN - 1)
            self._open[file] = open_dataset(file)
        return self._open[file]

    def _close_all_but(self, count: int) -> None:
        """Close files, the longest open first, until so many are left."""
        while len(self._open) > count:
            self._open.pop(next(iter(self._open))).close()
