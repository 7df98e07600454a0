"""The axes of a variable by the CF conventions: what each is, whether they make a grid, time steps.

Not by cf-xarray (0.11), which was tried: it would replace `axis_role` alone, 25 lines, for 50 ms of
import. It does not recognise a time by its units until it is decoded, which fails for damaged
files. It names an axis twice if attributes contradict each other, and takes the name `latent` for a
latitude. As with cf-xarray, xarray decodes scale, offset and fill values here, and cftime decodes
times; units of speed would need pint in addition.
"""

import calendar
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline._types import FloatArray
from pipeline.model import Note
from pipeline.sources.cf.dataset import coordinate_values, reading
from pipeline.sources.cf.overlaps import Step, latest_steps
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
    for kind, long in (("lon", "longitude"), ("lat", "latitude")):
        if standard == long or units in _DEGREES[kind]:
            return kind
    if standard == "time" or " since " in units or attributes.get("axis") == "T":
        return "time"
    is_vertical = standard in {"depth", "height", "altitude"} or standard.startswith("ocean_")
    if is_vertical or "positive" in attributes or attributes.get("axis") == "Z":
        return "level"
    for kind, names in _AXIS_NAMES.items():
        if dim.lower() in names and not standard:
            return kind
    return ""


def grid_fault(dataset: "xr.Dataset", array: "xr.DataArray") -> str:
    """Say what kind of grid a variable has that is not along longitude and latitude."""
    dims = ", ".join(f"{dim} ({size})" for dim, size in array.sizes.items())
    remedy = "put it on a regular grid first, as with `cdo remapbil,r1440x720 in.nc out.nc`"
    for name, other in dataset.variables.items():
        is_lon = other.attrs.get("standard_name") == "longitude" or "lon" in str(name).lower()
        if is_lon and other.ndim == 2 and set(other.dims) <= set(array.dims):
            along = ", ".join(map(str, other.dims))
            return f"{array.name}'s grid is curvilinear ({name} is along {along}); {remedy}"
    return f"{array.name} is along {dims}, not along a latitude and a longitude; {remedy}"


def surface_level(dataset: "xr.Dataset", dim: str) -> tuple[int, list[Note]]:
    """Return the index of the uppermost level, and notes; ValueError where it is too deep."""
    attributes, levels = {}, np.arange(dataset.sizes[dim], dtype=float)
    if dim in dataset.variables:
        attributes = dataset[dim].attrs
        levels = np.abs(np.atleast_1d(coordinate_values(dataset, dim)))
    if not np.isfinite(levels).all():
        raise ValueError(f"{dim} has levels that are no finite numbers; correct them")
    if levels.size > 1 and not {"units", "positive", "standard_name"} & attributes.keys():
        raise ValueError(f"{dim} has neither unit nor direction; keep the surface level alone")
    index = int(levels.argmin())
    if str(attributes.get("units", "m")).lower() not in {"m", "meter", "meters", "metre", "metres"}:
        return index, []
    if levels[index] > _MAX_DEPTH_M:
        raise ValueError(
            f"its uppermost level ({dim}) is {levels[index]:g} m deep; give currents of the surface"
        )
    is_deep = levels[index] > SURFACE_DEPTH_M
    return index, [Note.of("current-at-depth", depth_m=float(levels[index]))] if is_deep else []


def time_axis(dataset: "xr.Dataset", dim: str) -> "tuple[xr.DataArray | None, FloatArray | None]":
    """Return the time coordinate and its bounds (n, 2); neither for a single step without time."""
    if dim not in dataset.variables:
        if dataset.sizes[dim] == 1:
            return None, None
        raise ValueError(f"{dim} has {dataset.sizes[dim]} steps without times; add the coordinate")
    values = np.atleast_1d(coordinate_values(dataset, dim))
    time = dataset[dim].copy(deep=False, data=values.reshape(dataset[dim].shape))
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
        raise ValueError(f"{dim} has no values; add the coordinate")
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


# Time that a field stands for if it is the only one in its file.
_SINGLE_STEP = timedelta(days=1)
# A step may be longer than the median step by this factor: a month has up to 31 days, the median
# month 30.4.
_LONG_STEP = 1.04
# Calendars with the days of the real one.
_CALENDARS = ("standard", "gregorian", "proleptic_gregorian")
# Latest year of a step: near Python's last year, 9999, times can't be calculated with.
_MAX_YEAR = 9000
# Reference year that marks a climatology: "days since 0001-01-15" names no real year.
_SINCE = re.compile(r"\bsince\s+(-?\d+)-")
_STANDARD_NAME = "forecast_reference_time"
# Global attributes that hold the reference time: CF's name for it, Copernicus Marine's, and others.
_ATTRIBUTES = ("forecast_reference_time", "bulletin_date", "forecast_reference", "reference_time")
_DIGITS = re.compile(r"(\d{4})-?(\d{2})-?(\d{2})(?:[T ]?(\d{2}):?(\d{2})?)?")


@dataclass(frozen=True, slots=True)
class TimeSteps:
    """The steps of a file: their valid times (UTC, ascending), or a climatology's months.

    A file that gives no time has one step, with neither a time nor a month. `labels` are the steps
    as text, `width` is the length of a step, if the file has bounds.
    """

    moments: tuple[datetime, ...] = ()
    months: tuple[int, ...] = ()
    labels: tuple[str, ...] = ()
    width: timedelta | None = None

    @property
    def interval(self) -> timedelta:
        """Median time from one step to the next."""
        if len(self.moments) < 2:
            return self.width or _SINGLE_STEP
        seconds = np.diff([moment.timestamp() for moment in self.moments])
        return timedelta(seconds=float(np.median(seconds)))

    def nearest(self, moment: datetime) -> tuple[int, timedelta]:
        """Return the index of the step nearest to a moment, and its distance in time."""
        distances = [abs(own - moment) for own in self.moments]
        index = min(range(len(distances)), key=distances.__getitem__)
        return index, distances[index]

    def is_near(self, distance: timedelta) -> bool:
        """Whether a step may stand for a moment at this distance: up to half an interval."""
        return distance <= self.interval / 2 * _LONG_STEP

    @property
    def span(self) -> str:
        """The steps in words."""
        if self.months:
            return "a climatology of " + ", ".join(calendar.month_name[m] for m in self.months)
        if not self.labels:
            return "no time"
        if len(self.labels) == 1:
            return f"one time step, {self.labels[0]}"
        return f"{len(self.labels)} time steps, {self.labels[0]} to {self.labels[-1]}"


def read_steps(time: "xr.DataArray | None", bounds: FloatArray | None) -> TimeSteps:
    """Read a file's time coordinate, not yet decoded, with its bounds (n, 2) where it has them.

    Raises
    ------
    ValueError
        It is no time, or in another calendar than the real one.
    """
    if time is None:
        return TimeSteps()
    values = np.atleast_1d(np.asarray(time.values, dtype=float))
    if not np.isfinite(values).all():
        raise ValueError(f"{time.name} has values that are not finite; correct them")
    units = str(time.attrs.get("units", ""))
    months = _months(time, values, units)
    if months:
        return TimeSteps(months=months, labels=_month_names(months))
    stamps = decoded_times(time, values, units)
    if "climatology" in time.attrs:
        months = tuple(stamp.month for stamp in stamps)
        return TimeSteps(months=months, labels=_month_names(months))
    labels = tuple(label(stamp) for stamp in stamps)
    if bounds is not None:
        begins, ends = (decoded_times(time, side, units) for side in bounds.T)
        widths = [end - begin for begin, end in zip(begins, ends, strict=True)]
        middles = [begin + width / 2 for begin, width in zip(begins, widths, strict=True)]
        if all(abs(m - s) <= w for m, s, w in zip(middles, stamps, widths, strict=True)):
            return TimeSteps(tuple(middles), labels=labels, width=sorted(widths)[len(widths) // 2])
    return TimeSteps(tuple(stamps), labels=labels)


def merge_steps(
    files: Sequence[TimeSteps], references: Sequence[datetime | None] = ()
) -> tuple[TimeSteps, tuple[Step, ...]]:
    """Merge the steps of several files in their order in time; see `latest_steps`.

    Also returns for each step the number of its file, and its index there.

    Raises
    ------
    ValueError
        Some have years and some not, or two steps have the same time.
    """
    index = [(file, i) for file, own in enumerate(files) for i in range(max(len(own.labels), 1))]
    kinds = {(bool(own.moments), bool(own.months)) for own in files}
    if len(kinds) > 1:
        raise ValueError("some of its files have years and some not; give files of one kind")
    if kinds == {(False, False)}:
        if len(index) > 1:
            raise ValueError("its files give no time, so their order is unknown; add their times")
        return TimeSteps(), tuple(index)
    times: dict[Step, Any] = {
        (file, i): (files[file].months or files[file].moments)[i] for file, i in index
    }
    index = latest_steps(sorted(index, key=times.__getitem__), times, references or [None])
    repeated = [
        files[file].labels[i]
        for (file, i), following in itertools.pairwise(index)
        if times[file, i] == times[following]
    ]
    if repeated:
        raise ValueError(f"it has two steps of {repeated[0]}; leave one out")
    labels = tuple(files[file].labels[i] for file, i in index)
    merged = tuple(times[place] for place in index)
    if files[0].months:
        return TimeSteps(months=merged, labels=labels), tuple(index)
    if files[0].width is None and len(merged) > 1 and all(m == _month_start(m) for m in merged):
        # Monthly means are usually labelled with the first moment of the month.
        labels = tuple(moment.strftime("%Y-%m") for moment in merged)
        merged = tuple(
            moment + (_month_start(moment + timedelta(days=31)) - moment) / 2 for moment in merged
        )
    return TimeSteps(merged, labels=labels, width=files[0].width), tuple(index)


def label(moment: datetime) -> str:
    """Write a moment as a date, with its time unless that is midnight."""
    is_day = (moment.hour, moment.minute, moment.second) == (0, 0, 0)
    # Not by strftime, which takes seconds for a file of some 100,000 steps.
    return moment.isoformat()[:10] if is_day else f"{moment.isoformat()[:16]}Z"


def _months(time: "xr.DataArray", values: FloatArray, units: str) -> tuple[int, ...]:
    """Return months of a climatology; empty where the time has real years."""
    if " since " not in units:
        numbers = tuple(round(value) for value in values)
        is_month = "month" in f"{time.name} {units}".lower() and set(numbers) <= set(range(1, 13))
        return numbers if is_month or numbers == tuple(range(1, 13)) else ()
    year = _SINCE.search(units)
    if year is not None and int(year[1]) <= 1 and len(values) == 12 and (np.diff(values) > 0).all():
        return tuple(range(1, 13))
    return ()


def decoded_times(time: "xr.DataArray", values: FloatArray, units: str) -> list[datetime]:
    """Return moments in UTC, rounded to the second: days in float32 are not more exact."""
    import netCDF4

    name = str(time.attrs.get("calendar", "standard")).lower()
    if name not in _CALENDARS:
        raise ValueError(
            f"its calendar is {name!r}, which is not the real one; convert it, as with "
            "`cdo setcalendar,standard`"
        )
    half = timedelta(microseconds=500_000)
    try:
        found = netCDF4.num2date(
            values,
            units,
            name,
            only_use_cftime_datetimes=False,
            only_use_python_datetimes=True,
        )
        stamps: list[datetime] = np.atleast_1d(np.asarray(found, dtype=object)).tolist()
        moments = [(stamp + half).replace(microsecond=0, tzinfo=UTC) for stamp in stamps]
    except (ValueError, ArithmeticError, TypeError, LookupError) as error:
        raise ValueError(
            f"{time.name} is no time: units {units!r} ({error}); give them as 'hours since …'"
        ) from None
    if moments and max(moments).year > _MAX_YEAR:
        raise ValueError(f"{time.name} reaches the year {max(moments).year}; correct it")
    return moments


def _month_names(months: Sequence[int]) -> tuple[str, ...]:
    """Return names of months by their numbers."""
    return tuple(calendar.month_name[month] for month in months)


def _month_start(moment: datetime) -> datetime:
    """Return the first moment of a moment's month."""
    return moment.replace(day=1, hour=0, minute=0, second=0, microsecond=0)


def reference_time(dataset: "xr.Dataset") -> datetime | None:
    """Return the reference time (aware, UTC) of an open file; None if it has none."""
    return _from_variable(dataset) or _from_attributes(dataset)


def _from_variable(dataset: "xr.Dataset") -> datetime | None:
    """Read the variable of CF; None where there is none that can be read."""
    for name, variable in dataset.variables.items():
        if variable.attrs.get("standard_name") == _STANDARD_NAME:
            try:
                values = coordinate_values(dataset, str(name)).reshape(-1)
                times = decoded_times(dataset[name], values, str(variable.attrs.get("units", "")))
            except ValueError:
                return None
            return max(times, default=None)
    return None


def _from_attributes(dataset: "xr.Dataset") -> datetime | None:
    """Read a global attribute; None where none holds a time."""
    for name in _ATTRIBUTES:
        found = _DIGITS.search(str(dataset.attrs.get(name, "")))
        if found:
            year, month, day, hour, minute = (int(digits or 0) for digits in found.groups())
            try:
                return datetime(year, month, day, hour, minute, tzinfo=UTC)
            except ValueError:
                continue
    return None
