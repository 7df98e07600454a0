"""A region's part of a user's files, read lazily: of a global file no more than a window.

A window is cut out of each step before Dask sums the steps, some megabytes at a time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.sources.quality.field import Field

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt
    import xarray as xr

    from pipeline.sources.currents.cf.contents import Component, Contents

    FloatArray = npt.NDArray[np.float64]

Bounds = tuple[float, float, float, float]

# Steps are read this much at a time, or one by one where a step is more.
_CHUNK_BYTES = 32 << 20
# Coordinates that are nearer than this share of a cell are one: 0 and 360 degrees.
_SAME = 1e-3


@dataclass(frozen=True)
class Window:
    """Part of a grid: ascending lon (nx,), lat (ny,) in degrees, and where they lie in the files.

    `columns` are runs of neighbours in the file, from west to east: two across the file's own seam.
    Rows and columns descend where the file's do.
    """

    lon: FloatArray
    lat: FloatArray
    rows: slice
    columns: tuple[slice, ...]


def window(contents: Contents, bounds: Bounds) -> Window:
    """Cut out the nodes inside (west, south, east, north), in the bounds' own longitudes."""
    west, south, east, north = bounds
    lon, lat = contents.lon, contents.lat
    turns = range(int((west - lon.max()) // 360), int((east - lon.min()) // 360) + 1)
    places = np.concatenate([lon + 360 * turn for turn in turns])
    numbers = np.tile(np.arange(lon.size), len(turns))
    inside = np.flatnonzero((places >= west) & (places <= east))
    order = inside[np.argsort(places[inside], kind="stable")]
    if order.size > 1:
        apart = np.diff(places[order]) > _SAME * np.abs(np.diff(lon)).min()
        order = order[np.concatenate([[True], apart])]
    rows = np.flatnonzero((lat >= south) & (lat <= north))
    rows = rows[np.argsort(lat[rows])]
    return Window(places[order], lat[rows], _runs(rows)[0], tuple(_runs(numbers[order])))


def _runs(numbers: npt.NDArray[np.intp]) -> list[slice]:
    """Part numbers into runs that go up or down by one, as slices."""
    if numbers.size == 0:
        return [slice(0, 0)]
    step = np.diff(numbers)
    runs, begin = [], 0
    for i in range(1, numbers.size + 1):
        goes_on = i < numbers.size and abs(step[i - 1]) == 1 and step[i - 1] == step[begin]
        if not goes_on:
            first, last = int(numbers[begin]), int(numbers[i - 1])
            down = last < first
            end = last - 1 if down else last + 1
            runs.append(slice(first, end if end >= 0 else None, -1 if down else 1))
            begin = i
    return runs


def uncovered(contents: Contents, bounds: Bounds) -> list[str]:
    """Say how far a region (west, south, east, north) reaches beyond the grid's cells."""
    across, up = (float(np.abs(np.diff(axis)).max()) for axis in (contents.lon, contents.lat))
    wide = window(contents, _widened(bounds, across, up))
    if wide.lon.size == 0 or wide.lat.size == 0:
        return ["it has no figures there at all"]
    west, south, east, north = bounds
    lacking = [
        f"{side} of {end:g} (the region reaches {limit:g})"
        for side, end, limit, is_beyond in (
            ("west", wide.lon[0] - across / 2, west, wide.lon[0] - across / 2 > west),
            ("south", wide.lat[0] - up / 2, south, wide.lat[0] - up / 2 > south),
            ("east", wide.lon[-1] + across / 2, east, wide.lon[-1] + across / 2 < east),
            ("north", wide.lat[-1] + up / 2, north, wide.lat[-1] + up / 2 < north),
        )
        if is_beyond
    ]
    gaps = np.diff(wide.lon) > 1.5 * across
    if gaps.any():
        first = int(gaps.argmax())
        lacking.append(f"between {wide.lon[first]:g} and {wide.lon[first + 1]:g} E")
    if wide.lon.size < 2 or wide.lat.size < 2:
        lacking.append("at more than one node, too few for a field")
    return [f"it has no figures {' nor '.join(lacking)}"] if lacking else []


def _widened(bounds: Bounds, across: float, up: float) -> Bounds:
    """Bounds with so many degrees more on each side."""
    west, south, east, north = bounds
    return west - across, south - up, east + across, north + up


def field(contents: Contents, weights: Mapping[int, float], cut: Window) -> Field:
    """Read a window's field: steps by their weights, gaps where a step or a component has one."""
    u = _component(contents.u, contents.u_places, weights, cut)
    v = _component(contents.v, contents.v_places, weights, cut)
    gap = ~(np.isfinite(u) & np.isfinite(v))
    u[gap] = v[gap] = np.nan
    return Field(cut.lon, cut.lat, u, v)


def _component(
    parts: Sequence[Component],
    places: Sequence[tuple[int, int]],
    weights: Mapping[int, float],
    cut: Window,
) -> FloatArray:
    """Weighted sum (ny, nx) of a component's steps in m/s."""
    steps: dict[int, list[tuple[int, float]]] = {}
    for step, weight in weights.items():
        part, index = places[step]
        steps.setdefault(part, []).append((index, weight))
    total = np.zeros((cut.lat.size, cut.lon.size))
    for part, wanted in steps.items():
        total += _part(parts[part], sorted(wanted), cut)
    return total


def _part(part: Component, wanted: Sequence[tuple[int, float]], cut: Window) -> FloatArray:
    """Weighted sum (ny, nx) of some steps of one file, in m/s."""
    import xarray as xr

    with part.lazy() as array:
        columns = [
            _lazy(array.isel({part.lat: cut.rows, part.lon: run}), part, wanted)
            for run in cut.columns
        ]
        joined = xr.concat(columns, part.lon, coords="minimal", compat="override", join="override")
        # Threads of this process, whatever scheduler is about: the file may be here only.
        values: Any = joined.compute(scheduler="threads").transpose(part.lat, part.lon).values
    return np.asarray(values, dtype=float) * part.factor


def _lazy(run: xr.DataArray, part: Component, wanted: Sequence[tuple[int, float]]) -> xr.DataArray:
    """Weighted sum of some steps, not yet read."""
    import xarray as xr

    run = run.drop_vars(list(run.coords))
    if not part.time:
        return run.chunk().astype(float)
    indices = [index for index, _ in wanted]
    regular = indices == list(range(indices[0], indices[-1] + 1))
    chosen = run.isel({part.time: slice(indices[0], indices[-1] + 1) if regular else indices})
    step = max(1, chosen.nbytes // len(indices))
    chosen = chosen.chunk({part.time: max(1, _CHUNK_BYTES // step)}).astype(float)
    weights = xr.DataArray([weight for _, weight in wanted], dims=part.time)
    return (chosen * weights).sum(part.time, skipna=False)
