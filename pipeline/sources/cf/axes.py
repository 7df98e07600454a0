"""The axes of a variable by the CF conventions: what each is, whether they make a grid; times.

Time steps are moments, or months of a climatology; a file may have a reference time beside them.

cf-xarray (0.11) was tried and is not used: it would replace `axis_role` alone, 25 lines, for 50 ms
of import. It recognises a time by its units only once it is decoded, which fails for damaged files.
It names an axis twice if attributes contradict each other, and takes the name `latent` for a
latitude. For units of speed it would need pint.
"""

import bisect
import calendar
import contextlib
import itertools
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from pipeline._types import DataArray, Dataset, FloatArray
from pipeline.model import Note
from pipeline.sources.cf.dataset import coordinate_values, reading
from pipeline.sources.cf.mesh import SAME_SHARE
from pipeline.texts import clean

# Units of longitude and latitude as CF 4.1 and 4.2 spell them, in lower case.
_DEGREES = {
    kind: tuple(f"degree{s}{direction}" for s in ("", "s") for direction in directions)
    for kind, directions in (("lon", ("_east", "_e", "e")), ("lat", ("_north", "_n", "n")))
}
_AXIS_NAMES = {
    "lon": {"lon", "longitude"},
    "lat": {"lat", "latitude"},
    "time": {"time", "month", "time_counter", "valid_time"},
    "level": {"depth", "deptht", "lev", "level", "elevation", "z", "zlev"},
}
SURFACE_DEPTH_M = 2.0
"""Depth above which a level counts as the surface, m: the uppermost level of ocean models is 0.5 to
1.5 m deep."""
# Depth down to which the uppermost level stands for the surface with a note, m.
_MAX_DEPTH_M = 20.0
# Units of a depth.
_METRES = ("m", "meter", "meters", "metre", "metres", "dbar", "decibar")
# Units of levels that are numbers, or shares of the depth.
_NUMBERS = ("", "1", "level", "levels", "layer", "sigma_level")
# Beginnings of the standard names of levels whose values grow upwards.
_UPWARD = ("ocean_", "height", "altitude")
# Largest longitude, degrees: an axis is unwrapped, and so may go on beyond 360.
_MAX_LON = 720.0
# Largest latitude, degrees: some files end half a cell beyond a pole.
_MAX_LAT = 91.0
# Largest span of an axis as a share of the whole: some files repeat a meridian.
_MAX_TURN = 1.02


def axis_role(dataset: Dataset, dim: str) -> str:
    """Return a dimension's role: "lon", "lat", "time", "level", or "" where it is unknown."""
    attributes = dataset[dim].attrs if dim in dataset.variables else {}
    standard = str(attributes.get("standard_name", ""))
    units = str(attributes.get("units", ""))
    if standard.startswith(("grid_", "projection_")):
        return ""  # of a turned grid, or in metres
    for kind, long in (("lon", "longitude"), ("lat", "latitude")):
        if standard == long or units.lower() in _DEGREES[kind]:
            return kind
    if standard == "time" or " since " in units or attributes.get("axis") == "T":
        return "time"
    is_vertical = standard.startswith(("depth", "model_level", *_UPWARD))
    if is_vertical or "positive" in attributes or attributes.get("axis") == "Z":
        return "level"
    for kind, names in _AXIS_NAMES.items():
        if dim.lower() in names and not standard:
            return kind
    return ""


def grid_fault(array: DataArray, pole: str = "") -> str:
    """Say that a variable's grid is not known; `pole` is a mapping with a pole of its own."""
    dims = ", ".join(f"{dim} ({size})" for dim, size in array.sizes.items())
    return (
        f"{array.name} is along {dims}, and nothing says at which longitude and latitude its "
        "values are; give the file with its lon and lat, on axes or for each point, or the file "
        "of its grid beside it"
        + (
            f"; or take {pole} away, a mapping with a pole of its own, if it is none"
            if pole
            else ""
        )
    )


def level_of(dataset: Dataset, dim: str, along: str, height_m: float) -> tuple[int, list[Note]]:
    """Return the index of a height over ground, m, or of the uppermost level of the sea for 0."""
    if not height_m:
        return surface_level(dataset, dim, along)
    levels = np.atleast_1d(coordinate_values(dataset, dim))
    index = int(np.abs(levels - height_m).argmin())
    if levels.size > 1 and levels[index] != height_m:
        raise ValueError(
            f"{dim} has no level of {height_m:g} m over ground ({levels[0]:g} to {levels[-1]:g}); "
            "give the field at that height"
        )
    return index, []


def surface_level(dataset: Dataset, dim: str, along: str = "") -> tuple[int, list[Note]]:
    """Return the index of the uppermost level, and notes; ValueError if it can't be told.

    `dim` is the levels' coordinate, and `along` their dimension, if it has another name.
    """
    attributes, levels = {}, np.arange(dataset.sizes.get(dim, 1), dtype=float)
    if dim in dataset.variables:
        attributes = dataset.variables[dim].attrs
        levels = np.atleast_1d(coordinate_values(dataset, dim))
        if levels.ndim > 1:  # FVCOM has its shares of the depth at each node
            level = dataset.variables[dim].dims.index(along or dim)
            levels = np.moveaxis(levels, level, 0).reshape(levels.shape[level], -1).mean(axis=1)
    if not np.isfinite(levels).all():
        raise ValueError(f"{dim} has levels that are no finite numbers; correct them")
    keys = ("standard_name", "units", "positive")
    standard, unit, up = (str(attributes.get(key, "")).strip().lower() for key in keys)
    is_depth = unit in _METRES or (not unit and standard == "depth")
    is_named_depth = is_depth and "depth" in (standard, dim[:5].lower())
    if not up and (standard.startswith(_UPWARD[1:]) or levels.max() <= 0):
        up = "up"
    elif not up and (is_named_depth or levels.size == 1):
        up = "down"
    is_wrong = {"up": is_depth and levels.max() > 0, "down": levels.min() < 0}.get(up, True)
    if is_wrong or not (is_depth or unit in _NUMBERS):
        raise ValueError(
            f"{dim} ({levels[0]:g} to {levels[-1]:g} {unit}) does not say which is the surface: "
            f"keep that alone, without {dim}, as with xarray's `isel({dim}=…, drop=True)`"
        )
    index = int(levels.argmax() if up == "up" else levels.argmin())
    depth_m = abs(float(levels[index]))
    if not is_depth:
        assumed = Note.of("level-assumed", level=dim, value=float(levels[index]))
        return index, [assumed] * (levels.size == 1)
    if depth_m > _MAX_DEPTH_M:
        raise ValueError(
            f"its uppermost level ({dim}) is {depth_m:g} m deep; give currents of the surface"
        )
    return index, [Note.of("current-at-depth", depth_m=depth_m)] * (depth_m > SURFACE_DEPTH_M)


def time_axis(dataset: Dataset, dim: str) -> tuple[DataArray | None, FloatArray | None]:
    """Return the time coordinate and its bounds (n, 2); None twice for one step without a time."""
    if dim not in dataset.variables:
        if dataset.sizes[dim] == 1:
            return None, None
        raise ValueError(f"{dim} has {dataset.sizes[dim]} steps without times; add the coordinate")
    values = np.atleast_1d(coordinate_values(dataset, dim))
    time = dataset[dim].copy(deep=False, data=values.reshape(dataset[dim].shape))
    time.attrs = {key: dataset.attrs[key] for key in ZONES if key in dataset.attrs} | time.attrs
    return time, _bounds(dataset, dim, values.size)


def _bounds(dataset: Dataset, dim: str, size: int) -> FloatArray | None:
    """Return bounds (n, 2) of a coordinate; None where it has none."""
    name = dataset[dim].attrs.get("bounds", "")
    bounds = dataset.variables.get(name)
    if bounds is None or bounds.shape != (size, 2):
        return None
    values = coordinate_values(dataset, name)
    if not np.isfinite(values).all():
        raise ValueError(f"{name} has values that are no finite numbers; correct or remove it")
    return values


def coordinate_axis(dataset: Dataset, dim: str, period: float = 0.0) -> FloatArray:
    """Return an axis in degrees, which ascends or descends; ValueError if it is none.

    An axis with a period is unwrapped: its values may go on beyond 360 degrees.
    """
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


def coordinate_names(dataset: Dataset, dim: str) -> tuple[str, ...]:
    """Read the names along a dimension; ValueError where it has none, or has one twice."""
    values: list[Any] = []
    if dim in dataset.variables and dataset.variables[dim].ndim == 1:
        with reading():
            values = dataset.variables[dim].values.tolist()
    texts = [one.decode(errors="replace") if isinstance(one, bytes) else one for one in values]
    names = [clean(text) if isinstance(text, str) else text for text in texts]
    if not names or not all(isinstance(name, str) for name in names):
        raise ValueError(f"{dim} has no names; add the coordinate: ['M2', 'S2', …]")
    if len({name.upper() for name in names}) < len(names):
        raise ValueError(f"{dim} has a name twice ({', '.join(names)}); leave one out")
    return tuple(names)


# Time that a field stands for if it is the only one in its file.
_SINGLE_STEP = timedelta(days=1)
# Factor by which a step may be longer than the median step: a month has up to 31 days, the median
# step of months 30.4.
_LONG_STEP = 1.04
# Calendars with the days of the real one.
_CALENDARS = ("standard", "gregorian", "proleptic_gregorian")
# Years in which the Julian calendar counts the same days as the real one, 13 days apart: OSCAR says
# julian, and means the real dates.
_SAME_DAYS = range(1901, 2100)
_JULIAN = "julian"
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
"""Attributes that hold a time zone."""
# Words in any attribute that name another clock than UTC.
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
    as text, `width` is the length of a step, if the file says it. If the file says that the steps
    are means, `by` quotes its words; it is "point" for instants, and "" where the file says
    neither. `notes` say how the moments were read.
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

    def only(self, chosen: Iterable[int]) -> "TimeSteps":
        """Return some of the steps that have moments."""
        places = tuple(chosen)
        return replace(
            self,
            moments=tuple(self.moments[i] for i in places),
            labels=tuple(self.labels[i] for i in places),
        )

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
    time: DataArray | None,
    bounds: FloatArray | None,
    **about: Any,
) -> TimeSteps:
    """Read a file's time coordinate, not yet decoded, with its bounds (n, 2) where it has them.

    `about` is what `step_method` returns. Raises ValueError if it is no time, or in another
    calendar than the real one.
    """
    if time is None:
        return TimeSteps()
    values = np.atleast_1d(np.asarray(time.values, dtype=float))
    if not np.isfinite(values).all():
        raise ValueError(f"{time.name} has values that are not finite; correct them")
    units = str(time.attrs.get("units", ""))
    months = _months(time, values, units)
    stamps = [] if months else decoded_times(time, values, units)
    months = months or tuple(stamp.month for stamp in stamps if "climatology" in time.attrs)
    if months:
        return TimeSteps(
            months=months, labels=tuple(calendar.month_name[month] for month in months)
        )
    labels = tuple(label(stamp) for stamp in stamps)
    if bounds is not None and about.get("by") != "point":
        begins, ends = (decoded_times(time, side, units) for side in bounds.T)
        widths = [end - begin for begin, end in zip(begins, ends, strict=True)]
        middles = [begin + width / 2 for begin, width in zip(begins, widths, strict=True)]
        if all(abs(m - s) <= w for m, s, w in zip(middles, stamps, widths, strict=True)):
            width = sorted(widths)[len(widths) // 2]
            return TimeSteps(tuple(middles), labels=labels, width=width, by="point")
    return TimeSteps(tuple(stamps), labels=labels, **about)


def calendar_notes(dataset: Dataset, clock: str) -> list[Note]:
    """Note that the dates of a time coordinate are not of the calendar that it states."""
    if clock not in dataset.variables or dataset[clock].attrs.get("calendar") != _JULIAN:
        return []
    how = "dates of the real calendar, though the file calls it julian"
    return [Note.of("steps-read", how=how)]


def step_method(
    array: DataArray, dim: str, names: Iterable[str], *, has_maxima: bool = False
) -> dict[str, Any]:
    """Return `by` and `width` of a variable's TimeSteps, by its attributes or its file's names.

    A quantity that `has_maxima` may be the maximum of a step, too.
    """
    methods = array.attrs.get("cell_methods", "")
    said = re.search(rf"\b(?:time|{re.escape(dim)}):(?:\s*\w+:)*\s*(\w+)", methods)
    # What is a spread or a maximum along any axis is no field; parentheses hold comments.
    allowed = {"mean", "point", *(["maximum"] if has_maxima else [])}
    if set(re.findall(r":\s*(\w+)\b(?!:)", re.sub(r"\(.*?\)", "", methods))) - allowed:
        raise ValueError(f"{array.name} is neither of a time nor a mean ({methods}); give such")
    by = "" if said is None else "point" if said[1] == "point" else said[0]
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
    elif by and all(abs(lead) <= slack for lead in early):
        return replace(steps, width=length)
    elif not by or timedelta(1) % length or any(abs(lead - length / 2) > slack for lead in early):
        why = f"means ({by}) at odd stamps" if by else "no name and no cell_methods call them means"
        return replace(steps, notes=(Note.of("steps-read", how=f"instants: {why}"),))
    how = f"means ({by}), each for the middle of the time that begins at its stamp"
    notes = (Note.of("steps-read", how=how),)
    return replace(steps, moments=middles, labels=labels, width=length or None, notes=notes)


def merge_steps(
    files: Sequence[TimeSteps], references: Sequence[datetime | None] = ()
) -> tuple[TimeSteps, tuple[Step, ...]]:
    """Merge the steps of several files in their order in time; see `latest_steps`.

    Also returns for each step the number of its file, and its index there. Raises ValueError if
    some have years and some not, or two steps have the same time.
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
    twice = any(times[step] == times[after] for step, after in itertools.pairwise(index))
    if not twice or not all(references):
        return index
    own: dict[Any, list[Any]] = {}
    for step in index:
        own.setdefault(references[step[0]], []).append(times[step])
    ascending = sorted(own)

    def is_covered(step: Step) -> bool:
        later = ascending[bisect.bisect(ascending, references[step[0]]) :]
        return any(own[reference][0] <= times[step] <= own[reference][-1] for reference in later)

    return [step for step in index if not is_covered(step)]


def label(moment: datetime) -> str:
    """Write a moment as a date, with its time unless that is midnight."""
    is_day = (moment.hour, moment.minute, moment.second) == (0, 0, 0)
    # Not by strftime, which takes seconds for a file of some 100,000 steps.
    return moment.isoformat()[:10] if is_day else f"{moment.isoformat()[:16]}Z"


def _months(time: DataArray, values: FloatArray, units: str) -> tuple[int, ...]:
    """Return months of a climatology; empty where the time has real years."""
    if " since " not in units:
        numbers = tuple(round(value) for value in values)
        is_month = "month" in f"{time.name} {units}".lower() and set(numbers) <= set(range(1, 13))
        return numbers if is_month or numbers == tuple(range(1, 13)) else ()
    year = _SINCE.search(units)
    if year is not None and int(year[1]) <= 1 and len(values) == 12 and (np.diff(values) > 0).all():
        return tuple(range(1, 13))
    return ()


def decoded_times(time: DataArray, values: FloatArray, units: str) -> list[datetime]:
    """Return moments in UTC, rounded to the second: days in float32 are not more exact."""
    import netCDF4

    name = str(time.attrs.get("calendar", "standard")).lower()
    since = _SINCE.search(units)
    if name == _JULIAN and since is not None and int(since[1]) in _SAME_DAYS:
        name = _CALENDARS[0]
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
        with warnings.catch_warnings(action="ignore"):  # of years that no file of currents has
            decoded = netCDF4.num2date(
                values, said["local"], name,
                only_use_cftime_datetimes=False, only_use_python_datetimes=True,
            )  # fmt: skip
        stamps: list[datetime] = np.atleast_1d(np.asarray(decoded, dtype=object)).tolist()
        # Plain datetimes: a store holds none of netCDF4's own kind.
        plain = [datetime.combine(stamp.date(), stamp.time(), UTC) for stamp in stamps]
        moments = [(moment + half - offset).replace(microsecond=0) for moment in plain]
    except (ValueError, ArithmeticError, TypeError, LookupError) as error:
        raise ValueError(
            f"{time.name} is no time: units {units!r} ({error}); give them as 'hours since "
            "2024-03-15 00:00:00', in UTC"
        ) from None
    if moments and max(moments).year > _MAX_YEAR:
        raise ValueError(f"{time.name} reaches the year {max(moments).year}; correct it")
    return moments


def reference_time(dataset: Dataset) -> datetime | None:
    """Return the reference time (aware, UTC) of an open file: of its variable, or an attribute."""
    for name, variable in dataset.variables.items():
        if variable.attrs.get("standard_name") == _ATTRIBUTES[0]:
            with contextlib.suppress(ValueError):
                values = coordinate_values(dataset, str(name)).reshape(-1)
                units = str(variable.attrs.get("units", ""))
                return max(decoded_times(dataset[name], values, units))
    for name in _ATTRIBUTES:
        with contextlib.suppress(ValueError):
            moment = datetime.fromisoformat(str(dataset.attrs.get(name, "")).removesuffix(" UTC"))
            return moment.astimezone(UTC) if moment.tzinfo else moment.replace(tzinfo=UTC)
    return None
