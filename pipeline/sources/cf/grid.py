"""Reading the user's files of currents: a window of each step.

The window is cut out of each step before the steps are summed, some megabytes at a time.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, islice
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from pipeline._types import FloatArray, IndexArray
from pipeline.geo.lonlat import Bounds, cell_bounds, common_bounds, sides_beyond, widened
from pipeline.sources.cf.axes import SAME_SHARE
from pipeline.sources.cf.component import Component
from pipeline.sources.cf.contents import Contents
from pipeline.sources.cf.dataset import open_dataset, reading
from pipeline.sources.current_field import Field

if TYPE_CHECKING:
    import xarray as xr

# Amount of data read at a time, bytes; but at least one step.
_CHUNK_BYTES, _VALUE_BYTES = 32 << 20, 8
# Largest number of nodes in a region: checks and planning take some 600 bytes for each.
_MAX_NODES = 2_000_000
# Neighbouring nodes further apart than this multiple of the axis's largest step have a gap between.
_GAP_STEPS = 1.5
_MAX_OPEN = 2  # files at a time: one for each component


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
    """Divide indices into runs with a step of 1 or -1; return them as slices, at least one."""
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
    around = find_window(contents.lon, contents.lat, widened(region, *cell))
    lon, lat = around.lon, around.lat
    if lon.size * lat.size > _MAX_NODES:
        fault = (
            f"it has {lat.size:,} x {lon.size:,} nodes in the region, more than {_MAX_NODES:,}; "
            "shrink the region, or give a coarser file, as with `ncks -d` and a stride"
        )
        return [fault]
    if lon.size == 0 or lat.size == 0:
        return ["it has no data there at all; give a file of the region"]
    lacking = sides_beyond(region, cell_bounds(lon, lat, cell))
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
    around = find_window(contents.lon, contents.lat, widened(region, *cell))
    if around.lon.size < 2 or around.lat.size < 2:
        return None
    return common_bounds(region, cell_bounds(around.lon, around.lat, cell))


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
        return next(self.fields([weights]))

    def fields(self, weights: Iterable[Mapping[int, float]]) -> Iterator[Field]:
        """Read the fields of several weights, as `field` does.

        Consecutive fields of the same steps are summed together, some megabytes of them at a time.
        """
        contents, window = self._contents, self._window
        most = max(1, _CHUNK_BYTES // max(1, window.lat.size * window.lon.size * _VALUE_BYTES))
        for _, same in groupby(weights, key=tuple):
            while some := list(islice(same, most)):
                east = self._weighted_sums(contents.u, contents.u_index, some)
                north = self._weighted_sums(contents.v, contents.v_index, some)
                for u, v in zip(east, north, strict=True):
                    gap = ~(np.isfinite(u) & np.isfinite(v))
                    u[gap] = v[gap] = np.nan
                    yield Field(window.lon, window.lat, u, v)

    def _weighted_sums(
        self,
        files: Sequence[Component],
        index: Sequence[tuple[int, int]],
        weights: Sequence[Mapping[int, float]],
    ) -> FloatArray:
        """Return weighted sums (n, ny, nx) of a component's steps in m/s, all of the same steps."""
        total = np.zeros((len(weights), self._window.lat.size, self._window.lon.size))
        for steps, values in self.blocks(files, index, weights[0]):
            shares = [[one[step] for step in steps] for one in weights]
            total += np.tensordot(shares, values, axes=1)
        return total

    def blocks(
        self, files: Sequence[Component], index: Sequence[tuple[int, int]], steps: Iterable[int]
    ) -> Iterator[tuple[list[int], FloatArray]]:
        """Yield numbers and values (nt, ny, nx), m/s, of some megabytes of steps at a time."""
        by_file: dict[int, dict[int, int]] = {}
        for step in steps:
            file, own = index[step]
            by_file.setdefault(file, {})[own] = step
        size = self._window.lat.size * self._window.lon.size
        most = max(1, _CHUNK_BYTES // max(1, size * _VALUE_BYTES))
        for file, numbers in by_file.items():
            for first in range(0, len(numbers), most):
                some = sorted(numbers)[first : first + most]
                yield [numbers[own] for own in some], self._values(files[file], some)

    def _values(self, component: Component, steps: Sequence[int]) -> FloatArray:
        """Read ascending steps of a file (nt, ny, nx), m/s."""
        window = self._window
        part = dict[str, slice | list[int]]()
        if component.time:
            is_range = steps[-1] - steps[0] == len(steps) - 1
            part[component.time] = slice(steps[0], steps[-1] + 1) if is_range else list(steps)
        try:
            variable = component.lazy(self._dataset(component.file))
            with reading():
                values = read_window(variable.isel(part), (component.lat, component.lon), window)
        except ValueError as error:
            raise ValueError(f"{component.file.name}: {error}") from None
        return component.unit_m_s * values.reshape(-1, window.lat.size, window.lon.size)

    def _dataset(self, file: Path) -> "xr.Dataset":
        """Return an open file."""
        if file not in self._open:
            self._close_all_but(_MAX_OPEN - 1)
            self._open[file] = open_dataset(file)
        return self._open[file]

    def _close_all_but(self, count: int) -> None:
        """Close files, the longest open first, until `count` are left."""
        while len(self._open) > count:
            self._open.pop(next(iter(self._open))).close()
