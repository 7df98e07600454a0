"""The fields of a case: which steps of the files make them up, with which weights; reading them.

Only a window is read. It is cut out of each step before the steps are summed, some megabytes at a
time. The fields of tidal streams are sums of harmonic constants. How far apart in time these fields
are is decided here, and so is where the constants are too weak to rely on.
"""

import calendar
import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import cached_property
from itertools import groupby, islice
from pathlib import Path
from typing import TypeAlias

import numpy as np

import renew
from pipeline._types import BoolArray, Dataset, FloatArray, IndexArray, Variable
from pipeline.errors import naming
from pipeline.geo.projection import Bounds, cell_bounds, common_bounds, sides_beyond, widened
from pipeline.model import Note
from pipeline.scenario.season import Period, Season, TimeMethod
from pipeline.sources.cf.axes import TimeSteps, label
from pipeline.sources.cf.contents import Component, Contents
from pipeline.sources.cf.dataset import open_dataset, open_together, reading
from pipeline.sources.cf.mesh import SAME_SHARE, Axes, SourceMesh, Table
from pipeline.sources.current_field import Field, LandMask
from renew.inputs.tide import arguments, speeds

# Steps that are further apart than this multiple of the median interval have a hole between them.
_MISSING_STEP = 1.5
# Number of faults of one kind that a message names.
_MAX_FAULTS = 3


@dataclass(frozen=True, slots=True)
class SelectedSteps:
    """A case's fields: each is a weighted sum of steps, whose weights are given by index.

    Weights of time steps sum to 1; those of harmonic constants are factors of their real and
    imaginary parts. `valid` is the time that the fields stand for. `times_s` are seconds since
    departure, and `labels` the times as text, one for each field; 0 and "" for a single one.
    """

    weights: tuple[Mapping[int, float], ...]
    valid: str
    notes: tuple[Note, ...] = ()
    is_climatology: bool = False
    times_s: tuple[float, ...] = (0.0,)
    labels: tuple[str, ...] = ("",)


LONGEST_STEP = timedelta(hours=1)
"""Longest time between the fields of tidal streams."""
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def steps_of_season(
    contents: Contents, case: Season, step: timedelta = LONGEST_STEP, *, with_mean: bool = True
) -> SelectedSteps:
    """Select the steps of files, or the harmonic constants, that make up a case's fields.

    `step` is the time between fields that are computed from harmonic constants, at its whole
    multiples in UTC; `with_mean` says whether they include the constants' mean, if there is one.
    Raises ValueError if there are no steps, or some are missing during the voyage.
    """
    if contents.constituents:
        return _of_constants(contents, case, step, with_mean=with_mean)
    if case.is_changing:
        return select_all_steps(contents.steps, case.period)
    return select_steps(contents.steps, case.period, case.resolved_time_method)


def select_steps(steps: TimeSteps, period: Period, method: TimeMethod) -> SelectedSteps:
    """Select the steps that make up a period's one field.

    Raises ValueError if no step fits the period; the message says which steps there are.
    """
    middle = period.begin + (period.end - period.begin) / 2
    if steps.months:
        return _month_of_climatology(steps, middle, method)
    if not steps.moments:
        return SelectedSteps(({0: 1.0},), "", (Note.of("time-assumed"),))
    if method == "mean":
        return _mean(steps, period)
    return (_linear if method == "linear" else _nearest)(steps, middle)


def _month_of_climatology(steps: TimeSteps, moment: datetime, method: TimeMethod) -> SelectedSteps:
    """Select the step of the moment's month, whatever the year."""
    if method == "linear":
        raise ValueError(
            "it is a climatology, one field per month: leave 'time_method' out, or use 'nearest'"
        )
    name = calendar.month_name[moment.month]
    if moment.month not in steps.months:
        raise ValueError(f"it is {steps.span}, not of {name}; give a file of that month")
    index = steps.months.index(moment.month)
    return SelectedSteps(({index: 1.0},), f"{name} of a climatology", is_climatology=True)


def _mean(steps: TimeSteps, period: Period) -> SelectedSteps:
    """Select all steps in the period, with equal weights."""
    inside = [i for i, moment in enumerate(steps.moments) if period.begin <= moment < period.end]
    if not inside:
        _, distance = steps.nearest(period.begin + (period.end - period.begin) / 2)
        is_near = steps.is_near(distance)
        other = ', or in a scenario time_method = "nearest"' if is_near else ""
        raise ValueError(
            f"it has {steps.span}, none inside {label(period.begin)} to {label(period.end)}; ask "
            f"for what it has (--month, or the season's 'valid'){other}"
        )
    first, last = inside[0], inside[-1]
    valid = "/".join(steps.labels[i] for i in dict.fromkeys((first, last)))
    weights = dict.fromkeys(inside, 1 / len(inside))
    return SelectedSteps((weights,), valid, _sparse_notes(steps, inside, period))


def _sparse_notes(steps: TimeSteps, inside: Sequence[int], period: Period) -> tuple[Note, ...]:
    """Return a note if the steps do not fill the period."""
    interval = steps.interval
    # Half a step before the begin is allowed: a step may stand for the time around it.
    times = [period.begin - interval / 2, *(steps.moments[i] for i in inside), period.end]
    largest = max(later - earlier for earlier, later in itertools.pairwise(times))
    if largest <= _MISSING_STEP * interval:
        return ()
    span = tuple(dict.fromkeys((steps.labels[inside[0]], steps.labels[inside[-1]])))
    asked = (label(period.begin), label(period.end))
    return (Note.of("steps-sparse", count=len(inside), steps=span, asked=asked),)


def _nearest(steps: TimeSteps, moment: datetime) -> SelectedSteps:
    """Select the nearest step, at most half an interval away."""
    index, distance = steps.nearest(moment)
    if not steps.is_near(distance):
        hours = steps.interval.total_seconds() / 2 / 3600
        within = f"{hours:.3g} hours" if hours < 48 else f"{hours / 24:.3g} days"
        raise ValueError(
            f"it has {steps.span}, none within {within} of {label(moment)}; "
            "set the season's 'valid' to what it has"
        )
    return SelectedSteps(({index: 1.0},), steps.labels[index], steps.notes)


def _linear(steps: TimeSteps, moment: datetime) -> SelectedSteps:
    """Select the two steps around a moment, with the weights of linear interpolation."""
    after = int(np.searchsorted([own.timestamp() for own in steps.moments], moment.timestamp()))
    if after < len(steps.moments) and steps.moments[after] == moment:
        return SelectedSteps(({after: 1.0},), steps.labels[after], steps.notes)
    if not 0 < after < len(steps.moments):
        raise ValueError(
            f"it has {steps.span}, which do not lie on both sides of {label(moment)}; set the "
            "season's 'valid' to a time between them"
        )
    earlier, later = steps.moments[after - 1], steps.moments[after]
    if later - earlier > _MISSING_STEP * steps.interval:
        raise ValueError(
            f"it has no steps between {label(earlier)} and {label(later)}; give a file that has"
        )
    share = (moment - earlier) / (later - earlier)
    return SelectedSteps(({after - 1: 1 - share, after: share},), label(moment), steps.notes)


def _of_constants(
    contents: Contents, case: Season, step: timedelta, *, with_mean: bool
) -> SelectedSteps:
    """Return fields from an hour before a period, as a vessel may be early, to the period's end.

    Linear interpolation between fields damps a constituent by sinc² of half its change of phase in
    a step. The fields are divided by this factor, so that no error adds up on the way.
    """
    if not case.is_changing:
        raise ValueError(
            "it has harmonic constants, which need a clock: give the season time_method = "
            "'changing' and a 'departure', as --depart does"
        )
    period, names = case.period, contents.constituents
    first = math.floor((period.begin - LONGEST_STEP - _EPOCH) / step)
    last = math.ceil((period.end - _EPOCH) / step)
    moments = [_EPOCH + number * step for number in range(first, last + 1)]
    instants = np.array([moment.replace(tzinfo=None) for moment in moments], "datetime64[us]")
    try:
        factors, angles = arguments(names, instants)
    except renew.ParameterError as error:
        raise ValueError(str(error)) from None
    factors = factors / np.sinc(speeds(names)[:, None] * (step / timedelta(hours=1)) / 360) ** 2
    shares = [*factors * np.cos(angles), *-factors * np.sin(angles)]
    if contents.has_mean and with_mean:
        shares.append(np.ones(len(moments)))
    labels = tuple(map(label, moments))
    return SelectedSteps(
        weights=tuple(dict(enumerate(column)) for column in np.array(shares).T.tolist()),
        times_s=tuple((moment - period.begin).total_seconds() for moment in moments),
        labels=labels,
        valid=f"{labels[0]}/{labels[-1]}",
    )


def select_all_steps(steps: TimeSteps, period: Period) -> SelectedSteps:
    """Select all steps from the one before a period's begin to the one after its end.

    Each is a field of its own. Raises ValueError if the period does not begin between two steps, or
    steps are missing in it.
    """
    moments, departure = steps.moments, period.begin
    if len(moments) < 2:
        raise ValueError(
            f"it has {steps.span}, which do not show how the current changes; give a file with "
            "two time steps or more, or plan in a month's mean"
        )
    if not moments[0] <= departure < moments[-1]:
        order = f"{label(departure)}, is not before its last step, {label(moments[-1])}"
        if departure < moments[0]:
            order = f"{label(departure)}, is before its first step, {label(moments[0])}"
        raise ValueError(f"the departure, {order}; depart between them, or give another file")
    times = np.array([(moment - departure).total_seconds() for moment in moments])
    first = int(np.searchsorted(times, 0.0, side="right")) - 1
    end_s = (period.end - departure).total_seconds()
    last = min(max(int(np.searchsorted(times, end_s)), first + 1), len(times) - 1)
    chosen = range(first, last + 1)
    if faults := list(_holes(steps, chosen)):
        raise ValueError("; ".join(faults))
    labels = tuple(label(moments[i]) for i in chosen)
    return SelectedSteps(
        weights=tuple({i: 1.0} for i in chosen),
        times_s=tuple(times[first : last + 1].tolist()),
        labels=labels,
        valid=f"{labels[0]}/{labels[-1]}",
        notes=steps.notes,
    )


def _holes(steps: TimeSteps, chosen: Sequence[int]) -> Iterator[str]:
    """Find steps that are missing between others."""
    moments = [steps.moments[i] for i in chosen]
    gaps = [later - earlier for earlier, later in itertools.pairwise(moments)]
    usual = min(sorted(gaps)[(len(gaps) - 1) // 2], steps.interval)
    holes = [i for i, gap in enumerate(gaps) if gap > _MISSING_STEP * usual]
    for i in holes[:_MAX_FAULTS]:
        yield (
            f"it has no step between {label(moments[i])} and {label(moments[i + 1])}, and others "
            f"every {usual.total_seconds() / 3600:g} hours; give a file without holes"
        )


# Number of values read at a time, 32 MB; but at least one step.
_CHUNK_VALUES = 4 << 20
# Time over which a gap is filled from one side, s: a quarter of a tide.
_FILLED_S = 3 * 3600.0
# Share of its steps from which a mean has a value: below it would be of the high tides only.
_LEAST_KNOWN = 0.5
# Share of the points on land from which their zeros stand for land.
_ZERO_LAND = 0.9
# Names of masks: ROMS's mask_rho, mask_u, NEMO's umask; a land mask is 1 on land.
_MASK = re.compile(r"(?<![a-z])land|mask")
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
    outside: None = None

    def read(self, variable: Variable, dims: tuple[str, ...]) -> FloatArray:
        """Read a variable in the window (..., ny, nx); `dims` are those along lat and lon."""
        lat, lon = dims
        runs = [
            variable.isel({lat: self.rows, lon: run}).load().transpose(..., lat, lon).values
            for run in self.columns
        ]
        return np.concatenate(runs, axis=-1).astype(float)

    def interpolated(self, values: FloatArray) -> FloatArray:
        """Return values as they are: the points are the nodes."""
        return values


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


def coverage_faults(contents: Contents, region: Bounds) -> list[str]:
    """Say how far a region reaches beyond the grid's cells."""
    cell = contents.largest_cell
    if not all(cell):
        return [f"it has no data there at all{_where(contents)}; give a file of the region"]
    around = find_window(contents.lon, contents.lat, widened(region, *cell))
    lon, lat = around.lon, around.lat
    if lon.size * lat.size > _MAX_NODES:
        fault = (
            f"it has {lat.size:,} x {lon.size:,} nodes in the region, more than {_MAX_NODES:,}; "
            "give a coarser file, as with `ncks -d` and a stride, or in a scenario a smaller region"
        )
        return [fault]
    if lon.size == 0 or lat.size == 0:
        return [f"it has no data there at all{_where(contents)}; give a file of the region"]
    lacking = sides_beyond(region, cell_bounds(lon, lat, cell))
    gaps = np.diff(lon) > _GAP_STEPS * cell[0]
    if gaps.any():
        first = int(gaps.argmax())
        lacking.append(f"between {lon[first]:g} and {lon[first + 1]:g} E")
    if lon.size < 2 or lat.size < 2:
        lacking.append("at more than one node, too few for a field")
    if not lacking:
        return []
    remedy = "give another file, or in a scenario a smaller region"
    return [f"it has no data {' nor '.join(lacking)}; {remedy}"]


def _where(contents: Contents) -> str:
    """Say where the data of a source are."""
    west, south, east, north = contents.bounds
    return f", but from {west:g} to {east:g} E and from {south:g} to {north:g} N"


def covered_bounds(contents: Contents, region: Bounds) -> Bounds | None:
    """Return the bounds of the part of a region that the grid's cells cover; None where none is."""
    cell = contents.largest_cell
    if not all(cell):
        return None
    around = find_window(contents.lon, contents.lat, widened(region, *cell))
    if around.lon.size < 2 or around.lat.size < 2:
        return None
    return common_bounds(region, cell_bounds(around.lon, around.lat, cell))


Fills: TypeAlias = Mapping[tuple[str, float], float]
"""Values of variables that mean "no data", each with the largest share of a field that has it."""
Shores: TypeAlias = tuple[BoolArray, BoolArray]
"""Which nodes (ny, nx) of a window are land, and which open water."""

# A value other than 0 means "no data" if at least this share of the land has it,
_FILL_LAND_SHARE = 0.9
# and no more than this share of the open water,
_FILL_WATER_SHARE = 0.5
# or if it is large, and at least this share of all points has it,
_FILL_SHARE = 0.01
# and so many times as many as have any other large value.
_FILL_COUNTS = 10
# Values are large above so many times the lower quartile.
_FILL_SIZE = 6.0
# Least number of points, of land in the first case, from which this holds,
_FILL_POINTS = 20
# and of different values in the second: a field by formula may have few.
_LEAST_VALUES = 100


def _fill_value(values: FloatArray, shores: Shores | None) -> float:
    """Return the value that means "no data" in a field, as nothing else explains it; NaN for none.

    As a current it would move water.
    """
    if shores is not None and shores[0].sum() >= _FILL_POINTS and shores[1].any():
        is_land, water = shores
        # What nearly all land has is the middle one's.
        has_it = values == (middle := np.sort(values[is_land])[is_land.sum() // 2])
        shares = has_it[is_land].mean(), has_it[water].mean()
        if middle and shares[0] >= _FILL_LAND_SHARE and shares[1] <= _FILL_WATER_SHARE:
            return float(middle)
    known, least = values[np.isfinite(values)], max(_FILL_POINTS, _FILL_SHARE * values.size)
    if known.size < least:
        return np.nan
    large = np.abs(known) > _FILL_SIZE * np.quantile(np.abs(known), 0.25)
    found, counts = np.unique(known[large], return_counts=True)
    *_, second, most = (0, 0, *np.sort(counts))
    is_odd = most >= max(least, _FILL_COUNTS * second) and np.unique(known).size >= _LEAST_VALUES
    return float(found[counts.argmax()]) if is_odd else np.nan


class FieldReader(AbstractContextManager["FieldReader"]):
    """Reads fields of a window, one after the other; a context manager that closes the files.

    The files read last stay open, as most often they hold the next field as well. `fills` are
    values that mean "no data", to which those are added that are found on the way.
    """

    def __init__(
        self,
        contents: Contents,
        window: Window,
        shores: Shores | None = None,
        fills: Fills | None = None,
    ) -> None:
        self._contents, self._window, self._shores = contents, window, shores
        self.fills = dict(fills or {})
        self._open: dict[Path, Dataset] = {}
        self._dry: dict[Component, BoolArray] = {}
        # Largest share of the nodes of which a mean lacks some of its steps.
        self.partly = 0.0

    def __exit__(self, *_: object) -> None:
        """Close the files."""
        self._close_all_but(0)

    def field(self, weights: Mapping[int, float]) -> Field:
        """Read the weighted sum of steps; ValueError if the file is damaged."""
        return next(self.fields([weights]))

    def fields(self, weights: Iterable[Mapping[int, float]]) -> Iterator[Field]:
        """Read the fields of several weights, as `field` does.

        A field has a gap where a component has one at any step; means, of equal weights, only where
        one has gaps at more than half of the steps. Consecutive fields of the same steps are summed
        together, some megabytes of them at a time.
        """
        for _, same in groupby(weights, key=tuple):
            while some := list(islice(same, self._most)):
                for u, v in self._weighted_sums(some):
                    gap = ~(np.isfinite(u) & np.isfinite(v))
                    u[gap] = v[gap] = np.nan
                    yield Field(self._window.lon, self._window.lat, u, v, self._outside)

    @property
    def _most(self) -> int:
        """Number of fields that are in memory at a time."""
        sizes = [self._window.lat.size * self._window.lon.size, 1]
        sizes += [grid.lon.size for grid in self._grids if isinstance(grid, SourceMesh)]
        return max(1, _CHUNK_VALUES // max(sizes))

    def _weighted_sums(self, weights: Sequence[Mapping[int, float]]) -> FloatArray:
        """Return both components' sums (n, 2, ny, nx), m/s, for n sets of weights of some steps."""
        shape = (self._window.lat.size, self._window.lon.size)
        total, known = np.zeros((len(weights), 2, *shape)), np.zeros((2, *shape))
        equal = len(weights[0]) > 1 and len({*weights[0].values()}) == 1
        for steps, values in self.blocks(weights[0]):
            is_known = np.isfinite(values)
            known += is_known.sum(axis=0)
            shares = [[share_of[step] for step in steps] for share_of in weights]
            total += np.tensordot(shares, np.where(is_known, values, 0.0), axes=1)
        share = known / len(weights[0])
        self.partly = max(
            self.partly, float(((share < 1) & (share >= _LEAST_KNOWN)).mean()) * equal
        )
        share[share < (_LEAST_KNOWN if equal else 1.0)] = np.nan
        return np.asarray(total / share)

    def blocks(self, steps: Iterable[int]) -> Iterator[tuple[list[int], FloatArray]]:
        """Yield numbers and values (nt, 2, ny, nx), m/s, of some megabytes of steps at a time.

        The components are east and north, at the window's nodes.
        """
        by_parts: dict[tuple[Component, Component], list[tuple[int, int, int]]] = {}
        for step in steps:
            (u, u_step), (v, v_step) = self._contents.u[step], self._contents.v[step]
            by_parts.setdefault((u, v), []).append((u_step, v_step, step))
        for parts, numbers in by_parts.items():
            numbers.sort()
            for begin in range(0, len(numbers), self._most):
                some = numbers[begin : begin + self._most]
                u_steps, v_steps, numbered = zip(*some, strict=True)
                first = self._source_values(parts[0], u_steps)
                is_one = parts[0].name == parts[1].name  # a quantity without direction
                second = np.zeros_like(first) if is_one else self._source_values(parts[1], v_steps)
                yield list(numbered), np.stack(self._east_and_north(first, second), axis=1)

    def _east_and_north(self, first: FloatArray, second: FloatArray) -> list[FloatArray]:
        """Return both components of sources as those at the window's nodes (nt, ny, nx), m/s."""
        frame = self._contents.frame
        if frame in {"to", "from"}:
            bearing = np.radians(second + 180.0 * (frame == "from"))
            first, second = first * np.sin(bearing), first * np.cos(bearing)
        east, north = (
            table.interpolated(part)
            for table, part in zip(self._tables, (first, second), strict=True)
        )
        if frame == "lines" and isinstance(table := self._tables[0], Table):
            return list(table.turned(east, north))
        return [east, north]

    @property
    def _grids(self) -> tuple[Axes | SourceMesh, Axes | SourceMesh]:
        """The points of the two components."""
        return self._contents.u[0][0].grid, self._contents.v[0][0].grid

    @cached_property
    def _outside(self) -> BoolArray | None:
        """Nodes (ny, nx) of the window outside the meshes; None on axes."""
        first, second = (table.outside for table in self._tables)
        return None if first is None or second is None else first | second

    @cached_property
    def _tables(self) -> tuple[Window | Table, Window | Table]:
        """How values at the points of the two components become those at the window's nodes."""
        first, second = self._grids
        if isinstance(first, Axes) or isinstance(second, Axes):
            return self._window, self._window
        table = first.table(self._window.lon, self._window.lat)
        is_one = second is first
        return table, table if is_one else second.table(self._window.lon, self._window.lat)

    def _table_of(self, component: Component) -> Window | Table:
        return self._tables[component.grid is not self._grids[0]]

    def _source_values(self, component: Component, steps: Sequence[int]) -> FloatArray:
        """Read steps of a file (nt, ...), in m/s or degrees, at its own points; NaN on land."""
        values = self._as_stored(component, steps)
        if isinstance(component.grid, SourceMesh) and len(component.grid.dims) == 2:
            if component not in self._dry:
                self._dry[component] = self._dry_points(component, component.grid)
            values[:, self._dry[component]] = np.nan
        if self._contents.frame in {"to", "from"} and component.name == self._contents.v[0][0].name:
            return values
        shores = self._shores if isinstance(component.grid, Axes) else None
        for field in values:
            if np.isfinite(fill := _fill_value(field, shores)):
                key, share = (component.name, fill), float((field == fill).mean())
                self.fills[key] = max(share, self.fills.get(key, 0.0))
        fills = [value for name, value in self.fills if name == component.name]
        values[np.isin(values, fills)] = np.nan
        return values

    def _as_stored(self, component: Component, steps: Sequence[int]) -> FloatArray:
        """Read steps of a file (nt, ...), in m/s or degrees, at its own points."""
        part = dict[str, slice | list[int]]()
        if component.time:
            is_range = list(steps) == list(range(steps[0], steps[-1] + 1))
            part[component.time] = slice(steps[0], steps[-1] + 1) if is_range else list(steps)
        with naming(component.file.name, ValueError):
            variable = self._dataset(component).variables[component.name]
            with reading():
                variable = variable.isel(component.fixed).isel(part)
                values = self._table_of(component).read(variable, component.grid.dims)
        spatial = values.shape[1:] if component.time else values.shape
        return np.asarray(component.unit * values.reshape(-1, *spatial))

    def _dry_points(self, component: Component, mesh: SourceMesh) -> BoolArray:
        """Return which points of curved lines are on land, though they have a value there: 0.

        They are 0 at the first and the last step, and a mask of the file says so. Without one, nine
        in ten points on the world's land must be 0, and few points of water.
        """
        steps = {0, max(0, len(component.steps.labels) - 1)}
        zero = np.asarray((self._as_stored(component, sorted(steps)) == 0).all(axis=0))
        if not zero.any():
            return zero
        for name, variable in self._dataset(component).variables.items():
            if set(variable.dims) == set(mesh.dims) and (said := _MASK.search(str(name).lower())):
                with reading():
                    mask = self._table_of(component).read(variable, mesh.dims)
                return np.asarray(zero & (mask == (said[0] == "land")))
        table = self._table_of(component)
        part = table.part if isinstance(table, Table) else ()
        lon, lat = mesh.lon[part], mesh.lat[part]
        placed, is_land = np.isfinite(lon + lat), np.zeros(lon.shape, dtype=bool)
        is_land[placed] = LandMask.world().is_land(lon[placed], lat[placed])
        stands_for_land = is_land.any() and zero[is_land].mean() >= _ZERO_LAND
        is_meant = bool(stands_for_land and zero[~is_land].mean() <= 1 - _ZERO_LAND)
        return zero & is_meant

    def _dataset(self, component: Component) -> Dataset:
        file = component.file
        if file not in self._open:
            self._close_all_but(_MAX_OPEN - 1)
            self._open[file] = open_together(file, component.beside, component.quantity)
        return self._open[file]

    def _close_all_but(self, count: int) -> None:
        """Close files, the longest open first, until `count` are left."""
        while len(self._open) > count:
            self._open.pop(next(iter(self._open))).close()


def filled_in_time(field: Field, times_s: Sequence[float]) -> tuple[Field, tuple[Note, ...]]:
    """Fill gaps that a field (nt, ny, nx) has at some times only, linearly in time, with a note.

    Each value that is filled is at most three hours or one step from one that is there. A node with
    a longer gap becomes a gap at all times.
    """
    import xarray as xr

    gap = field.gap
    changing = gap.any(axis=0) & ~gap.all(axis=0)
    if not changing.any():
        return field, ()
    step_s = float(np.median(np.diff(times_s)))
    most, nodes = max(1, int(_FILLED_S // step_s)), np.flatnonzero(changing)
    parts = []
    for part in (field.u, field.v):
        series = xr.DataArray(part[:, changing], [("time", list(times_s)), ("node", nodes)])
        # pandas' interpolation, as xarray's own can't be limited to some steps.
        filled = series.to_pandas().interpolate("index", limit=most, limit_direction="both")
        parts.append(filled.to_numpy())
    lost = np.isnan(parts[0] + parts[1]).any(axis=0)
    u, v = field.u.copy(), field.v.copy()
    u[:, changing], v[:, changing] = (np.where(lost, np.nan, part) for part in parts)
    told = Note.of(
        "current-gaps-filled",
        hours=most * step_s / 3600,
        share=float(changing.mean()),
        lost=float(lost.sum() / changing.size),
    )
    return replace(field, u=u, v=v), (told,)


WEAK_SHARE = 0.7
"""Share of the variance below which the constants of a node count as unreliable."""
# Largest difference between the streams and straight lines in time between their fields, m/s.
_ERROR_M_S = 0.03
# Times between fields, minutes: each divides an hour, so that every full hour has a field.
_STEPS_MIN = (60, 30, 20, 15, 12, 10, 6, 5)
# Number of values in all fields together above which a longer time between them is taken: 160 MB a
# component.
_MAX_VALUES = 20_000_000
# Years beyond the series of a fit after which its constants are called old.
_OLD_YEARS = 5.0


def stream_steps(
    contents: Contents, case: Season, bounds: Bounds, *, with_mean: bool
) -> SelectedSteps:
    """Return the fields of a case inside bounds, with notes on them.

    Raises ValueError if the file is damaged.
    """
    window = find_window(contents.lon, contents.lat, bounds)
    step, error_m_s = _time_step(contents, window, case)
    selected = steps_of_season(contents, case, step, with_mean=with_mean)
    notes = [
        Note.of(
            "tidal-streams",
            names=contents.constituents,
            step_min=step / timedelta(minutes=1),
            error_m_s=error_m_s,
            has_mean=contents.has_mean and with_mean,
        ),
        *_age_notes(contents, case.period.begin),
    ]
    return replace(selected, notes=tuple(notes))


def _time_step(contents: Contents, window: Window, case: Season) -> tuple[timedelta, float]:
    """Return the time between fields, and the largest error of interpolation between them, m/s.

    A constituent of amplitude A is too large by A (ω h)² / 12 in its fields, which
    :func:`steps_of_season` enlarges, and too small by half of that midway between two fields. A is
    bounded by the largest of its parts at any node.
    """
    names, count = contents.constituents, len(contents.constituents)
    peaks = np.zeros((2, len(contents.u)))
    with FieldReader(contents, window) as reader:
        for steps, values in reader.blocks(range(2 * count)):
            sizes = np.where(np.isfinite(values), np.abs(values), 0.0)
            peaks[:, steps] = sizes.max(axis=(2, 3), initial=0.0).T
    amplitudes = np.sqrt((peaks[:, : 2 * count] ** 2).reshape(2, 2, count).sum(axis=(0, 1)))
    at = np.array([case.period.begin.replace(tzinfo=None)], "datetime64[us]")
    factors, _ = arguments(names, at)
    turns_h = np.radians(speeds(names))
    bend = float((factors[:, 0] * amplitudes * turns_h**2).sum()) / 12  # m/s for an hour's step

    hours = (case.period.end - case.period.begin + LONGEST_STEP) / timedelta(hours=1)
    nodes = window.lon.size * window.lat.size
    fitting = [
        minutes
        for minutes in _STEPS_MIN
        if bend * (minutes / 60) ** 2 <= _ERROR_M_S or minutes == _STEPS_MIN[-1]
    ]
    small = [minutes for minutes in _STEPS_MIN if nodes * hours * 60 / minutes <= _MAX_VALUES]
    minutes = max(fitting[0], small[-1] if small else _STEPS_MIN[0])
    return timedelta(minutes=minutes), bend * (minutes / 60) ** 2


def _age_notes(contents: Contents, departure: datetime) -> list[Note]:
    """Return a note where the departure is years from the series that gave the constants."""
    series = []
    for side in ("start", "end"):
        try:
            moment = datetime.fromisoformat(contents.attributes[f"time_coverage_{side}"])
        except (KeyError, ValueError):
            return []
        series.append(moment if moment.tzinfo else moment.replace(tzinfo=UTC))
    years = max(series[0] - departure, departure - series[1]) / timedelta(days=365.25)
    if years <= _OLD_YEARS:
        return []
    return [Note.of("constants-old", begin=series[0], end=series[1], years=years)]


def weak_cells(contents: Contents, bounds: Bounds) -> BoolArray | None:
    """Return where constants explain too little variance (ny, nx); None if the file doesn't say.

    Raises ValueError if the file is damaged.
    """
    part, _ = contents.u[0]
    window = find_window(contents.lon, contents.lat, bounds)
    with open_dataset(part.file) as dataset:
        share = dataset.variables.get("variance_share")
        if share is None or share.dims != part.grid.dims:
            return None
        with reading():
            return np.asarray(window.read(share, part.grid.dims) < WEAK_SHARE)
