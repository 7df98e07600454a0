"""Time steps of files: their moments, or months of a climatology, and the reference time."""

import bisect
import calendar
import contextlib
import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline._types import FloatArray
from pipeline.model import Note
from pipeline.sources.cf.dataset import coordinate_values

if TYPE_CHECKING:
    import xarray as xr

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
# The tail of a dataset's name at Copernicus, for means or instants: "P1D-m", "PT1H-i", "P1M-m".
_ID = re.compile(r"(?<![A-Za-z0-9])P(T?)(\d+)([DHM])-([mi])(?![A-Za-z0-9])")
MONTH = timedelta(0)
"""Stands for the length of a step that is a calendar month."""
_LENGTHS = {"D": timedelta(1), "TH": timedelta(hours=1), "TM": timedelta(minutes=1), "M": MONTH}
# Units of a time: a date, a clock, and the zone, which cftime drops in some spellings.
_UNITS = re.compile(
    r"(?P<local>\w+ since -?\d+-\d+-\d+(?P<clock>[T ]\d+:\d+(:\d+(\.\d*)?)?)?) ?"
    r"(?(clock)((?P<sign>[+-])(?P<h>\d{1,2})(:?(?P<min>\d{2}))?)?) ?(Z|UTC|GMT|UT)?",
    re.IGNORECASE,
)
_UTC = ("utc", "gmt", "ut", "etc/utc", "utc+0", "+00:00", "z", "zulu", "none", "")
ZONES = ("time_zone", "timezone", "tz")
"""Attributes that hold a zone."""
# Words of any attribute for another clock.
_OTHER_CLOCK = re.compile(
    r"(?i:\b(local|ship'?s?) (\w+ )?time|\b(UTC|GMT) ?[+-] ?0?[1-9])|"
    r"\b([AECMPHJKL]|AE|AC|AW|NZ)[SD]T\b|\bCES?T\b"
)
# Global attributes that hold the reference time: CF's name for it, Copernicus Marine's, and others.
_ATTRIBUTES = ("forecast_reference_time", "bulletin_date", "forecast_reference", "reference_time")

Step = tuple[int, int]
"""A step: the number of its file, and its index there."""


@dataclass(frozen=True, slots=True)
class TimeSteps:
    """The steps of a file: their valid times (UTC, ascending), or a climatology's months.

    A file that gives no time has one step, with neither a time nor a month. `labels` are the steps
    as text, `width` is the length of a step, if the file says it. `by` is what calls them means,
    "point" for steps of their very moments, or "". `notes` say how the moments were read.
    """

    moments: tuple[datetime, ...] = ()
    months: tuple[int, ...] = ()
    labels: tuple[str, ...] = ()
    width: timedelta | None = None
    by: str = ""
    notes: tuple[Note, ...] = ()

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


def read_steps(
    time: "xr.DataArray | None",
    bounds: FloatArray | None,
    **about: Any,  # noqa: ANN401 - as below
) -> TimeSteps:
    """Read a file's time coordinate, not yet decoded, with its bounds (n, 2) where it has them.

    `about` is what `step_method` returns.

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
    stamps = [] if months else decoded_times(time, values, units)
    months = months or tuple(one.month for one in stamps if "climatology" in time.attrs)
    if months:
        return TimeSteps(months=months, labels=tuple(calendar.month_name[one] for one in months))
    labels = tuple(label(stamp) for stamp in stamps)
    if bounds is not None and about.get("by") != "point":
        begins, ends = (decoded_times(time, side, units) for side in bounds.T)
        widths = [end - begin for begin, end in zip(begins, ends, strict=True)]
        middles = [begin + width / 2 for begin, width in zip(begins, widths, strict=True)]
        if all(abs(m - s) <= w for m, s, w in zip(middles, stamps, widths, strict=True)):
            width = sorted(widths)[len(widths) // 2]
            return TimeSteps(tuple(middles), labels=labels, width=width, by="point")
    return TimeSteps(tuple(stamps), labels=labels, **about)


def step_method(array: "xr.DataArray", dim: str, names: Iterable[str]) -> dict[str, Any]:
    """Return what a variable, or else its file's names, say of a step: arguments of TimeSteps."""
    methods = array.attrs.get("cell_methods", "")
    said = re.search(rf"\b(?:time|{re.escape(dim)}):(?:\s*\w+:)*\s*(\w+)", methods)
    # A spread or a largest one, along whatever axis, is no current; parentheses hold comments.
    if set(re.findall(r":\s*(\w+)\b(?!:)", re.sub(r"\(.*?\)", "", methods))) - {"mean", "point"}:
        raise ValueError(f"{array.name} is neither of a time nor a mean ({methods}); give such")
    by = "" if said is None else {"mean": said[0], "point": "point"}[said[1]]
    for name in filter(None, map(_ID.search, names)):
        by = by or {"m": name[0], "i": "point"}[name[4]]
        width = int(name[2]) * _LENGTHS[name[1] + name[3]]
        return {"by": by, "width": None if by == "point" else width}
    return {"by": by}


def step_around(moment: datetime, length: timedelta) -> tuple[datetime, datetime]:
    """Return begin and end of the step that a moment lies in; steps are counted from midnight."""
    day = moment.replace(hour=0, minute=0, second=0, microsecond=0)
    if length == MONTH:
        begin = day.replace(day=1)
        return begin, (begin + timedelta(days=31)).replace(day=1)
    begin = day + (moment - day) // length * length
    return begin, begin + length


def middle_of_step(moment: datetime, length: timedelta) -> datetime:
    """Return the middle of the step that a moment lies in, for which a mean stands."""
    begin, end = step_around(moment, length)
    return begin + (end - begin) / 2


def _placed(steps: TimeSteps) -> TimeSteps:
    """Place means at the middle of their steps, and note how the moments are read."""
    moments, labels, by, length = steps.moments, steps.labels, steps.by, steps.width
    if by == "point" or (len(moments) < 2 and length is None):
        return steps
    length = steps.interval if length is None else length
    if not by and all(moment == step_around(moment, MONTH)[0] for moment in moments):
        by, length = "the first of each month", MONTH
    slack = length / 20  # days in float32 are not exact
    middles = tuple(middle_of_step(moment + slack, length) for moment in moments)
    early = [middle - moment for middle, moment in zip(middles, moments, strict=True)]
    if length == MONTH:
        labels = tuple(moment.strftime("%Y-%m") for moment in moments)
    elif by and all(abs(one) <= slack for one in early):
        return replace(steps, width=length)
    elif not by or timedelta(1) % length or any(abs(one - length / 2) > slack for one in early):
        why = f"means ({by}) at odd stamps" if by else "no name and no cell_methods call them means"
        return replace(steps, notes=(Note.of("steps-read", how=f"instants: {why}"),))
    how = f"means ({by}), each for the middle of the time that begins at its stamp"
    notes = (Note.of("steps-read", how=how),)
    return replace(steps, moments=middles, labels=labels, width=length or None, notes=notes)


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
    return _placed(replace(files[0], moments=merged, labels=labels)), tuple(index)


def latest_steps(
    index: list[Step], times: Mapping[Step, Any], references: Sequence[Any]
) -> list[Step]:
    """Return steps in their order in time, without those in the span of a later forecast.

    All stay where no two have the same time, or a file has no reference time.
    """
    twice = any(times[one] == times[after] for one, after in itertools.pairwise(index))
    if not twice or not all(references):
        return index
    own: dict[Any, list[Any]] = {}
    for step in index:
        own.setdefault(references[step[0]], []).append(times[step])
    ascending = sorted(own)

    def is_covered(step: Step) -> bool:
        later = ascending[bisect.bisect(ascending, references[step[0]]) :]
        return any(own[one][0] <= times[step] <= own[one][-1] for one in later)

    return [step for step in index if not is_covered(step)]


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
            "xarray's `convert_calendar('standard')`"
        )
    for key, zone in ((key, str(value)) for key, value in time.attrs.items() if key != "units"):
        if _OTHER_CLOCK.search(zone) or (key in ZONES and zone.lower() not in _UTC):
            raise ValueError(
                f"{time.name} is in the zone {zone!r}; give its times in UTC, and {key} as 'UTC'"
            )
    half = timedelta(microseconds=500_000)
    try:
        said = _UNITS.fullmatch(" ".join(units.split()))
        if said is None:
            raise ValueError("no date with a clock, in UTC or a zone as -6:00")  # noqa: TRY301
        hours, minutes = (int(f"{said['sign'] or ''}{said[part] or 0}") for part in ("h", "min"))
        offset = timedelta(hours=hours, minutes=minutes)
        found = netCDF4.num2date(
            values,
            said["local"],
            name,
            only_use_cftime_datetimes=False,
            only_use_python_datetimes=True,
        )
        stamps: list[datetime] = np.atleast_1d(np.asarray(found, dtype=object)).tolist()
        moments = [(stamp + half - offset).replace(microsecond=0, tzinfo=UTC) for stamp in stamps]
    except (ValueError, ArithmeticError, TypeError, LookupError) as error:
        raise ValueError(
            f"{time.name} is no time: units {units!r} ({error}); give them as 'hours since "
            "2024-03-15 00:00:00', in UTC"
        ) from None
    if moments and max(moments).year > _MAX_YEAR:
        raise ValueError(f"{time.name} reaches the year {max(moments).year}; correct it")
    return moments


def reference_time(dataset: "xr.Dataset") -> datetime | None:
    """Return the reference time (aware, UTC) of an open file: of its variable, or an attribute."""
    for name, variable in dataset.variables.items():
        if variable.attrs.get("standard_name") == _ATTRIBUTES[0]:
            with contextlib.suppress(ValueError):
                values = coordinate_values(dataset, str(name)).reshape(-1)
                units = str(variable.attrs.get("units", ""))
                return max(decoded_times(dataset[name], values, units))
    for name in _ATTRIBUTES:
        with contextlib.suppress(ValueError):
            found = datetime.fromisoformat(str(dataset.attrs.get(name, "")).removesuffix(" UTC"))
            return found.astimezone(UTC) if found.tzinfo else found.replace(tzinfo=UTC)
    return None
