"""The time steps of a file by the CF conventions, and which of them make up a period's field."""

from __future__ import annotations

import calendar
import itertools
import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt
    import xarray as xr

    from pipeline.scenario.period import Period

    FloatArray = npt.NDArray[np.float64]

How = Literal["mean", "nearest", "linear"]

# A field that is alone in its file stands for its own day.
_LONE_STEP = timedelta(days=1)
# Steps that are further apart than so many usual ones have a hole between them.
_HOLE = 1.5
# A long month has 31 days, the usual one 30.4.
_LONG_STEP = 1.04
# Calendars whose days are those of the real one.
_CALENDARS = ("standard", "gregorian", "proleptic_gregorian")
# "days since 0001-01-15": such a year means nothing.
_SINCE = re.compile(r"\bsince\s+(-?\d+)-")


@dataclass(frozen=True, slots=True)
class Steps:
    """The steps of a file: moments (UTC, ascending) that they stand for, or months of no year.

    Neither where the file says no time; then there is one step. `labels` are how to write them,
    `width` is how long one lasts, where the file has bounds that say so.
    """

    moments: tuple[datetime, ...] = ()
    months: tuple[int, ...] = ()
    labels: tuple[str, ...] = ()
    width: timedelta | None = None

    @property
    def usual(self) -> timedelta:
        """Median time from one step to the next."""
        if len(self.moments) < 2:
            return self.width or _LONE_STEP
        seconds = np.diff([moment.timestamp() for moment in self.moments])
        return timedelta(seconds=float(np.median(seconds)))

    def nearest(self, moment: datetime) -> tuple[int, timedelta]:
        """Number of the step nearest to a moment, and how far away it is."""
        away = [abs(known - moment) for known in self.moments]
        place = min(range(len(away)), key=away.__getitem__)
        return place, away[place]

    def reaches(self, away: timedelta) -> bool:
        """Whether a step may stand for a moment so far away: half a usual step."""
        return away <= self.usual / 2 * _LONG_STEP

    @property
    def span(self) -> str:
        """What there is, in words."""
        if self.months:
            return "a climatology of " + ", ".join(calendar.month_name[m] for m in self.months)
        if not self.labels:
            return "no time"
        if len(self.labels) == 1:
            return f"one time step, {self.labels[0]}"
        return f"{len(self.labels)} time steps, {self.labels[0]} to {self.labels[-1]}"


@dataclass(frozen=True, slots=True)
class Chosen:
    """Weights of the wanted steps by their number, adding up to 1; the time they stand for."""

    weights: Mapping[int, float]
    valid: str
    notes: tuple[str, ...] = ()
    is_climatology: bool = False


def steps(time: xr.DataArray | None, bounds: FloatArray | None) -> Steps:
    """Read a file's time as it stands there, with its bounds (n, 2) where it has them.

    Raises
    ------
    ValueError
        It is no time, or of another calendar than the real one.
    """
    if time is None:
        return Steps()
    values = np.atleast_1d(np.asarray(time.values, dtype=float))
    if not np.isfinite(values).all():
        raise ValueError(f"{time.name} has values that are not finite")
    units = str(time.attrs.get("units", ""))
    months = _months(time, values, units)
    if months:
        return Steps(months=months, labels=tuple(calendar.month_name[month] for month in months))
    stamps = _decoded(time, values, units)
    if "climatology" in time.attrs:
        found = tuple(stamp.month for stamp in stamps)
        return Steps(months=found, labels=tuple(calendar.month_name[month] for month in found))
    labels = tuple(label(stamp) for stamp in stamps)
    if bounds is not None:
        begins, ends = (_decoded(time, side, units) for side in bounds.T)
        widths = [end - begin for begin, end in zip(begins, ends, strict=True)]
        middles = [begin + width / 2 for begin, width in zip(begins, widths, strict=True)]
        if all(abs(m - s) <= w for m, s, w in zip(middles, stamps, widths, strict=True)):
            return Steps(tuple(middles), labels=labels, width=sorted(widths)[len(widths) // 2])
    return Steps(tuple(stamps), labels=labels)


def joined(parts: Sequence[Steps]) -> tuple[Steps, tuple[tuple[int, int], ...]]:
    """Put the steps of several files in their order; which file, and which step of it, each is.

    Raises
    ------
    ValueError
        Some have years and some not, or two steps are of the same time.
    """
    places = [
        (part, i) for part, steps in enumerate(parts) for i in range(max(len(steps.labels), 1))
    ]
    kinds = {(bool(steps.moments), bool(steps.months)) for steps in parts}
    if len(kinds) > 1:
        raise ValueError("some of its files say another kind of time than others")
    if kinds == {(False, False)}:
        if len(places) > 1:
            raise ValueError("its files say no time, so that there is no telling them apart")
        return Steps(), tuple(places)
    times: dict[tuple[int, int], Any] = {
        (part, i): (parts[part].months or parts[part].moments)[i] for part, i in places
    }
    places.sort(key=times.__getitem__)
    twice = [
        parts[part].labels[i]
        for (part, i), after in itertools.pairwise(places)
        if times[part, i] == times[after]
    ]
    if twice:
        raise ValueError(f"it has two steps of {twice[0]}; leave one out")
    labels = tuple(parts[part].labels[i] for part, i in places)
    if parts[0].months:
        return Steps(months=tuple(times[place] for place in places), labels=labels), tuple(places)
    moments = tuple(times[place] for place in places)
    if parts[0].width is None and len(moments) > 1 and all(m == _month(m) for m in moments):
        # Means of months are labelled with their first moment where nothing else is said.
        labels = tuple(moment.strftime("%Y-%m") for moment in moments)
        moments = tuple(moment + (_after(moment) - moment) / 2 for moment in moments)
    return Steps(moments, labels=labels, width=parts[0].width), tuple(places)


def label(moment: datetime) -> str:
    """Write a moment as short as it is exact."""
    is_day = (moment.hour, moment.minute, moment.second) == (0, 0, 0)
    return moment.strftime("%Y-%m-%d" if is_day else "%Y-%m-%dT%H:%MZ")


def _months(time: xr.DataArray, values: FloatArray, units: str) -> tuple[int, ...]:
    """Months of a year that means nothing; empty where the years do."""
    numbers = tuple(round(value) for value in values)
    is_plain = " since " not in units
    if is_plain and numbers == tuple(range(1, 13)):
        return numbers
    if is_plain and "month" in f"{time.name} {units}".lower() and set(numbers) <= set(range(1, 13)):
        return numbers
    year = _SINCE.search(units)
    if year is not None and int(year[1]) <= 1 and len(values) == 12 and (np.diff(values) > 0).all():
        return tuple(range(1, 13))
    return ()


def _decoded(time: xr.DataArray, values: FloatArray, units: str) -> list[datetime]:
    """Moments in UTC, to the second: a float32 of days is off by more than it says."""
    import netCDF4

    name = str(time.attrs.get("calendar", "standard")).lower()
    if name not in _CALENDARS:
        raise ValueError(
            f"its calendar is {name!r}, whose days are not the real ones; convert it, as with "
            "`cdo setcalendar,standard`"
        )
    try:
        found = netCDF4.num2date(
            values,
            units,
            name,
            only_use_cftime_datetimes=False,
            only_use_python_datetimes=True,
        )
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{time.name} is no time: units {units!r} ({error})") from None
    half = timedelta(microseconds=500_000)
    stamps: list[datetime] = np.atleast_1d(np.asarray(found, dtype=object)).tolist()
    return [(stamp + half).replace(microsecond=0, tzinfo=UTC) for stamp in stamps]


def choose(steps: Steps, period: Period, how: How) -> Chosen:
    """Choose the steps that make up a period's field.

    Raises
    ------
    ValueError
        There are none; the message says which there are.
    """
    middle = period.begin + (period.end - period.begin) / 2
    if steps.months:
        return _of_the_month(steps, middle, how)
    if not steps.moments:
        return Chosen({0: 1.0}, "", ("the file says no time: it is taken for the one asked for",))
    if how == "mean":
        return _mean(steps, period)
    return (_linear if how == "linear" else _nearest)(steps, middle)


def _of_the_month(steps: Steps, moment: datetime, how: How) -> Chosen:
    """Take the step of the calendar's month, whatever the year."""
    if how == "linear":
        raise ValueError("it is a climatology, one field a month: leave 'time' out, or 'nearest'")
    if moment.month not in steps.months:
        raise ValueError(f"it is {steps.span}, not of {calendar.month_name[moment.month]}")
    name = calendar.month_name[moment.month]
    place = steps.months.index(moment.month)
    return Chosen({place: 1.0}, f"{name} of a climatology", is_climatology=True)


def _mean(steps: Steps, period: Period) -> Chosen:
    """Take all steps in the period alike."""
    inside = [i for i, moment in enumerate(steps.moments) if period.begin <= moment < period.end]
    if not inside:
        _, away = steps.nearest(period.begin + (period.end - period.begin) / 2)
        other = ', or time = "nearest" for the one around it' if steps.reaches(away) else ""
        raise ValueError(
            f"it has {steps.span}, none inside {label(period.begin)} to {label(period.end)}; set "
            f"the season's 'valid' to what it has{other}"
        )
    first, last = inside[0], inside[-1]
    valid = steps.labels[first]
    if last > first:
        valid += f"/{steps.labels[last]}"
    weights = dict.fromkeys(inside, 1 / len(inside))
    return Chosen(weights, valid, tuple(_thin(steps, inside, period)))


def _thin(steps: Steps, inside: Sequence[int], period: Period) -> list[str]:
    """Say where the steps do not fill the period that they are to stand for."""
    usual = steps.usual
    known = [steps.moments[i] for i in inside]
    # A step stands for the time around it, or after it.
    edges = [period.begin - usual / 2, *known, period.end]
    if all(later - earlier <= _HOLE * usual for earlier, later in itertools.pairwise(edges)):
        return []
    count, verb = ("one time step", "stands")
    if len(inside) > 1:
        count, verb = f"{len(inside)} time steps", "stand"
    span = " to ".join(dict.fromkeys((steps.labels[inside[0]], steps.labels[inside[-1]])))
    return [f"{count} ({span}) {verb} for all of {label(period.begin)} to {label(period.end)}"]


def _nearest(steps: Steps, moment: datetime) -> Chosen:
    """Take the nearest step, half a usual one away at most."""
    place, away = steps.nearest(moment)
    usual = steps.usual
    if not steps.reaches(away):
        raise ValueError(
            f"it has {steps.span}, none within {_length(usual / 2)} of {label(moment)}; set the "
            "season's 'valid' to what it has"
        )
    return Chosen({place: 1.0}, steps.labels[place])


def _linear(steps: Steps, moment: datetime) -> Chosen:
    """Take the two steps around a moment, the nearer one more."""
    after = int(np.searchsorted([known.timestamp() for known in steps.moments], moment.timestamp()))
    if after < len(steps.moments) and steps.moments[after] == moment:
        return Chosen({after: 1.0}, steps.labels[after])
    if not 0 < after < len(steps.moments):
        raise ValueError(f"it has {steps.span}, which do not lie on both sides of {label(moment)}")
    earlier, later = steps.moments[after - 1], steps.moments[after]
    if later - earlier > _HOLE * steps.usual:
        raise ValueError(f"it has no steps between {label(earlier)} and {label(later)}")
    share = (moment - earlier) / (later - earlier)
    return Chosen({after - 1: 1 - share, after: share}, label(moment))


def _length(time: timedelta) -> str:
    """Spell a length of time: "12 hours", "15.2 days"."""
    hours = time.total_seconds() / 3600
    return f"{hours:.3g} hours" if hours < 48 else f"{hours / 24:.3g} days"


def _month(moment: datetime) -> datetime:
    """First moment of a moment's month."""
    return moment.replace(day=1, hour=0, minute=0, second=0, microsecond=0)


def _after(month: datetime) -> datetime:
    """First moment of the month that follows."""
    return _month(month + timedelta(days=31))
