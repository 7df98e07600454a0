"""Time steps of a file by the CF conventions, and which of them make up a period's field."""

from __future__ import annotations

import calendar
import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline._types import FloatArray
from pipeline.scenario.period import Period
from pipeline.sources.interfaces import TimeMethod

if TYPE_CHECKING:
    import xarray as xr

# Time that a field stands for if it is the only one in its file.
_SINGLE_STEP = timedelta(days=1)
# Distance between steps, in median distances, from which one is missing between them.
MISSING_STEP = 1.5
# Length of a long step in median ones: a long month has 31 days, the median one 30.4.
_LONG_STEP = 1.04
# Calendars with the days of the real one.
_CALENDARS = ("standard", "gregorian", "proleptic_gregorian")
# Last year of a step; times near the last year of all can't be calculated with.
_MAX_YEAR = 9000
# Reference year of a time's units: "days since 0001-01-15" are a climatology's, of no real year.
_SINCE = re.compile(r"\bsince\s+(-?\d+)-")


@dataclass(frozen=True, slots=True)
class TimeSteps:
    """The steps of a file: their valid times (UTC, ascending), or a climatology's months.

    Neither where the file gives no time; then there is one step. `labels` are the steps in writing,
    `width` is how long one lasts, where the file has bounds.
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
        """Index of the step nearest to a moment, and its distance in time."""
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


@dataclass(frozen=True, slots=True)
class SelectedSteps:
    """Weights (sum 1) of the selected steps by their index, and the time that they stand for."""

    weights: Mapping[int, float]
    valid: str
    notes: tuple[str, ...] = ()
    is_climatology: bool = False


def read_steps(time: xr.DataArray | None, bounds: FloatArray | None) -> TimeSteps:
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


def merge_steps(files: Sequence[TimeSteps]) -> tuple[TimeSteps, tuple[tuple[int, int], ...]]:
    """Merge the steps of several files in their order in time.

    Also returns for each of them the number of its file, and its index there.

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
    times: dict[tuple[int, int], Any] = {
        (file, i): (files[file].months or files[file].moments)[i] for file, i in index
    }
    index.sort(key=times.__getitem__)
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
        merged = tuple(moment + (_next_month(moment) - moment) / 2 for moment in merged)
    return TimeSteps(merged, labels=labels, width=files[0].width), tuple(index)


def label(moment: datetime) -> str:
    """Write a moment as a date, with its time unless that is midnight."""
    is_day = (moment.hour, moment.minute, moment.second) == (0, 0, 0)
    # Not by strftime, which takes seconds for a file of some 100,000 steps.
    return moment.isoformat()[:10] if is_day else f"{moment.isoformat()[:16]}Z"


def _months(time: xr.DataArray, values: FloatArray, units: str) -> tuple[int, ...]:
    """Months of a climatology; empty where the time has real years."""
    if " since " not in units:
        numbers = tuple(round(value) for value in values)
        is_month = "month" in f"{time.name} {units}".lower() and set(numbers) <= set(range(1, 13))
        return numbers if is_month or numbers == tuple(range(1, 13)) else ()
    year = _SINCE.search(units)
    if year is not None and int(year[1]) <= 1 and len(values) == 12 and (np.diff(values) > 0).all():
        return tuple(range(1, 13))
    return ()


def decoded_times(time: xr.DataArray, values: FloatArray, units: str) -> list[datetime]:
    """Moments in UTC, rounded to the second: days in float32 are not more exact."""
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


def select_steps(steps: TimeSteps, period: Period, method: TimeMethod) -> SelectedSteps:
    """Select the steps that make up a period's field.

    Raises
    ------
    ValueError
        There are none; the message says which there are.
    """
    middle = period.begin + (period.end - period.begin) / 2
    if steps.months:
        return _month_of_climatology(steps, middle, method)
    if not steps.moments:
        note = "the file gives no time: it is assumed to be for the time asked for"
        return SelectedSteps({0: 1.0}, "", (note,))
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
    return SelectedSteps({index: 1.0}, f"{name} of a climatology", is_climatology=True)


def _mean(steps: TimeSteps, period: Period) -> SelectedSteps:
    """Select all steps in the period, with equal weights."""
    inside = [i for i, moment in enumerate(steps.moments) if period.begin <= moment < period.end]
    if not inside:
        _, distance = steps.nearest(period.begin + (period.end - period.begin) / 2)
        is_near = steps.is_near(distance)
        other = ', or time_method = "nearest" for the one around it' if is_near else ""
        raise ValueError(
            f"it has {steps.span}, none inside {label(period.begin)} to {label(period.end)}; set "
            f"the season's 'valid' to what it has{other}"
        )
    first, last = inside[0], inside[-1]
    valid = steps.labels[first]
    if last > first:
        valid += f"/{steps.labels[last]}"
    weights = dict.fromkeys(inside, 1 / len(inside))
    return SelectedSteps(weights, valid, tuple(_sparse_notes(steps, inside, period)))


def _sparse_notes(steps: TimeSteps, inside: Sequence[int], period: Period) -> list[str]:
    """Say that the steps do not fill the period, if so."""
    interval = steps.interval
    # A step stands for the time around it, or after it.
    times = [period.begin - interval / 2, *(steps.moments[i] for i in inside), period.end]
    largest = max(later - earlier for earlier, later in itertools.pairwise(times))
    if largest <= MISSING_STEP * interval:
        return []
    count, verb = ("one time step", "stands")
    if len(inside) > 1:
        count, verb = f"{len(inside)} time steps", "stand"
    span = " to ".join(dict.fromkeys((steps.labels[inside[0]], steps.labels[inside[-1]])))
    return [f"{count} ({span}) {verb} for all of {label(period.begin)} to {label(period.end)}"]


def _nearest(steps: TimeSteps, moment: datetime) -> SelectedSteps:
    """Select the nearest step, at most half an interval away."""
    index, distance = steps.nearest(moment)
    if not steps.is_near(distance):
        raise ValueError(
            f"it has {steps.span}, none within {_duration(steps.interval / 2)} of {label(moment)}; "
            "set the season's 'valid' to what it has"
        )
    return SelectedSteps({index: 1.0}, steps.labels[index])


def _linear(steps: TimeSteps, moment: datetime) -> SelectedSteps:
    """Select the two steps around a moment, with the weights of linear interpolation."""
    after = int(np.searchsorted([own.timestamp() for own in steps.moments], moment.timestamp()))
    if after < len(steps.moments) and steps.moments[after] == moment:
        return SelectedSteps({after: 1.0}, steps.labels[after])
    if not 0 < after < len(steps.moments):
        raise ValueError(
            f"it has {steps.span}, which do not lie on both sides of {label(moment)}; set the "
            "season's 'valid' to a time between them"
        )
    earlier, later = steps.moments[after - 1], steps.moments[after]
    if later - earlier > MISSING_STEP * steps.interval:
        raise ValueError(
            f"it has no steps between {label(earlier)} and {label(later)}; give a file that has"
        )
    share = (moment - earlier) / (later - earlier)
    return SelectedSteps({after - 1: 1 - share, after: share}, label(moment))


def _duration(time: timedelta) -> str:
    """Write a duration: "12 hours", "15.2 days"."""
    hours = time.total_seconds() / 3600
    return f"{hours:.3g} hours" if hours < 48 else f"{hours / 24:.3g} days"


def _month_names(months: Sequence[int]) -> tuple[str, ...]:
    """Names of months by their numbers."""
    return tuple(calendar.month_name[month] for month in months)


def _month_start(moment: datetime) -> datetime:
    """First moment of a moment's month."""
    return moment.replace(day=1, hour=0, minute=0, second=0, microsecond=0)


def _next_month(month: datetime) -> datetime:
    """First moment of the month that follows."""
    return _month_start(month + timedelta(days=31))
