"""A season of a scenario: the current to plan in, its times, its members and its speeds.

A period is a month, a day or an instant, always UTC. An interval is written as '30min', '6h' or
'1d'.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import (
    AfterValidator,
    AwareDatetime,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    model_validator,
)

from pipeline.scenario import strict
from pipeline.scenario.strict import StrictModel

# Forms of a season's `valid`; whether the date exists is checked by `datetime`.
_INSTANT = re.compile(r"\d{4}-\d{2}-\d{2}T\d{2}:\d{2}Z", re.ASCII)
_DAY = re.compile(r"\d{4}-\d{2}-\d{2}", re.ASCII)
_MONTH = re.compile(r"\d{4}-\d{2}", re.ASCII)


@dataclass(frozen=True, slots=True)
class Period:
    """The time from `begin` up to `end`, aware UTC datetimes; an instant where they are equal."""

    begin: datetime
    end: datetime

    @property
    def is_instant(self) -> bool:
        """Whether it is a single moment, without duration."""
        return self.begin == self.end


def period(valid: str) -> Period:
    """Read 'YYYY-MM', 'YYYY-MM-DD' or 'YYYY-MM-DDTHH:MMZ'; else ValueError with the remedy."""
    try:
        if _INSTANT.fullmatch(valid):
            moment = datetime.strptime(valid, "%Y-%m-%dT%H:%MZ").replace(tzinfo=UTC)
            return Period(moment, moment)
        if _DAY.fullmatch(valid):
            begin = datetime.strptime(valid, "%Y-%m-%d").replace(tzinfo=UTC)
            return Period(begin, begin + timedelta(days=1))
        if _MONTH.fullmatch(valid):
            begin = datetime.strptime(valid, "%Y-%m").replace(tzinfo=UTC)
            return Period(begin, (begin + timedelta(days=31)).replace(day=1))
        reason = "it has another form"
    except (ValueError, OverflowError) as error:
        reason = str(error)
    raise ValueError(
        f"{valid!r} is not a time ({reason}): give a month 'YYYY-MM', a day 'YYYY-MM-DD' or an "
        "instant 'YYYY-MM-DDTHH:MMZ', in UTC"
    )


_INTERVAL = re.compile(r"(\d{1,4})(min|h|d)", re.ASCII)
_UNITS = {"min": timedelta(minutes=1), "h": timedelta(hours=1), "d": timedelta(days=1)}


def interval(text: str) -> timedelta:
    """Read an interval; ValueError if the text is no interval, or 0."""
    parts = _INTERVAL.fullmatch(text)
    if not parts:
        raise strict.RemediedError(
            f"= {text!r} is not an interval; give it as '30min', '6h' or '1d'"
        )
    if not int(parts[1]):
        raise strict.RemediedError(f"= {text!r} is no time at all; give one above 0, such as '6h'")
    return int(parts[1]) * _UNITS[parts[2]]


def span(text: str) -> timedelta:
    """Read an interval that may be zero, '0min'; else ValueError with the remedy."""
    return timedelta() if text == "0min" else interval(text)


def _readable_by(read: Callable[[str], timedelta]) -> AfterValidator:
    """Return the validator that refuses a text which `read` refuses."""

    def checked(text: str) -> str:
        read(text)
        return text

    return AfterValidator(checked)


Interval = Annotated[str, _readable_by(interval)]
Span = Annotated[str, _readable_by(span)]
Count = Annotated[strict.Integer, Field(ge=1, le=10_000)]


class DepartureTimes(StrictModel):
    """Times at which the vessel may leave: `count` of them from `first` on, `every` apart.

    The end of a window, `last`, is one of them too, even if `every` does not lead to it.
    """

    first: AwareDatetime = Field(examples=["2026-07-01T06:00:00Z"])
    """First departure. Give a time with its zone, as 2026-07-01T06:00:00Z."""
    every: Interval = "1h"
    """Time from one departure to the next. Give '30min', '6h' or '1d'."""
    count: Count = Field(examples=[24])
    """Number of departures. Give a whole number from 1 to 10,000."""
    last: AwareDatetime | None = Field(default=None, examples=["2026-07-02T05:50:00Z"])
    """Last departure, after the others: the end of a window that 'every' does not divide. Give a
    time with its zone, as 2026-07-02T05:50:00Z, or leave it out."""

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        if self.last is not None and self.last <= self.begin + self._sampled:
            latest = (self.begin + self._sampled).isoformat()
            raise strict.RemediedError(
                f"last = {self.last.isoformat()} is not after the others, which go on to {latest}; "
                "lower 'count', or leave it out"
            )
        return self

    @property
    def begin(self) -> datetime:
        """The first departure, UTC."""
        return self.first.astimezone(UTC)

    @property
    def window(self) -> timedelta:
        """Time from the first departure to the last."""
        return self._sampled if self.last is None else self.last.astimezone(UTC) - self.begin

    @property
    def seconds(self) -> tuple[float, ...]:
        """All departures, in seconds after the first."""
        evenly = tuple((i * interval(self.every)).total_seconds() for i in range(self.count))
        return evenly if self.last is None else (*evenly, self.window.total_seconds())

    @property
    def _sampled(self) -> timedelta:
        """Time from the first departure to the last that 'every' leads to."""
        return (self.count - 1) * interval(self.every)


# Form of a season's name where only its departure was given.
_NAME = "%Y-%m-%dt%H%Mz"


def departure_name(departure: datetime) -> str:
    """Return the name of the season of a departure, UTC: 2026-11-22t0600z."""
    return departure.strftime(_NAME)


def named_departure(season: str) -> datetime | None:
    """Return the departure, UTC, in a season's name; None if the name has another form."""
    try:
        return datetime.strptime(season, _NAME).replace(tzinfo=UTC)
    except ValueError:
        return None


FILES = "files"
"""`members.along` where each file is a member."""
CYCLES = "cycles"
"""`members.along` where the files of each folder are one forecast, and a member."""


class MembersSpec(StrictModel):
    """Currents that may each come true, and what the side is chosen by.

    Turns are clear in every member, and results say in how many of them each side is best.
    """

    along: str = Field(default="", examples=["member"])
    """Where the members are: 'files', if each file of the season's source is one; 'cycles', if the
    files of each folder are one forecast, the newest in the folder whose name is the last; or the
    name of a dimension of its files. Give 'files', 'cycles' or a name such as 'realization', or
    leave it out for 'spread', and in a night for the forecasts that it has kept."""
    spread: strict.Positive | None = Field(
        default=None, le=10, examples=[0.2], json_schema_extra=strict.unit("m/s")
    )
    """Typical error of the current, rms: members are then the current with random eddies of this
    speed. Give m/s, such as 0.2, or leave it out for 'along'."""
    eddy_km: strict.Positive = Field(default=80.0, le=1e4, json_schema_extra=strict.unit("km"))
    """Wave length of the eddies of 'spread', about, true km. Give km, such as 80."""
    count: strict.Integer = Field(default=20, ge=2, le=200)
    """Number of members with 'spread'; of forecasts that a night keeps, the most. Give a whole
    number from 2 to 200."""
    weights: tuple[strict.NonNegative, ...] = Field(default=(), examples=[[2.0, 1.0, 1.0]])
    """How likely each member is, in their order; by default all are equally likely. Give numbers,
    0 or more, or leave it out."""
    choose: Literal["mean", "p90", "cvar90", "regret"] = "mean"
    """What the side is chosen by: the mean fuel over the members, the fuel that nine in ten don't
    exceed, the mean of the worst tenth, or the largest excess over a member's best side. Give
    'mean', 'p90', 'cvar90' or 'regret'."""

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if self.along and self.spread is not None:
            raise ValueError("has both 'along' and 'spread'; give one of the two")
        if self.weights and not self.along:
            which = "forecasts that a night keeps" if self.are_kept else "random members"
            raise ValueError(f"has 'weights' for {which}; leave them out, or give 'along'")
        return self

    @property
    def are_kept(self) -> bool:
        """Whether the members are the forecasts that a night keeps."""
        return not self.along and self.spread is None


# The limit of a vessel's own speed.
_Speed = Annotated[strict.Positive, Field(le=1e6)]


class SpeedRange(StrictModel):
    """Lowest and highest speed through water, in place of the vessel's own speed."""

    least: _Speed = Field(examples=[2.5], json_schema_extra=strict.unit("m/s"))
    """Lowest speed through water, m/s. Give a speed in m/s, above 0."""
    most: _Speed = Field(examples=[6.0], json_schema_extra=strict.unit("m/s"))
    """Highest speed through water, m/s, for which land is padded. Give a speed in m/s, not below
    'least'."""


TimeMethod = Literal["mean", "nearest", "linear"]
"""How a season's field is made of time steps: the mean of its period's steps, the step nearest to
the middle of the period, or linear interpolation between the two around that middle."""
STILL = "still"
"""The source of the catalogue that has no current at all, at any time."""


# Speed that no current on earth reaches, m/s: a larger figure is a typing error.
MAX_CURRENT_M_S = 100.0
# Longest voyage in changing currents, hours: a year.
MAX_HOURS = 8784.0
Velocity = Annotated[strict.Number, Field(ge=-MAX_CURRENT_M_S, le=MAX_CURRENT_M_S)]


class Gyre(StrictModel):
    """Gyres that fill the extent of a plane scenario; see `renew.GyreCurrent`."""

    amplitude: Velocity = Field(examples=[0.8], json_schema_extra=strict.unit("m/s"))
    """Maximum speed of the current, m/s; negative values turn the other way. Give the strongest
    current in m/s, at most 100."""
    columns: strict.Integer = Field(default=1, ge=1)
    """Number of gyres along x. Give a whole number, 1 or more."""
    rows: strict.Integer = Field(default=1, ge=1)
    """Number of gyres along y. Give a whole number, 1 or more."""


class Uniform(StrictModel):
    """A uniform current in a plane scenario."""

    u: Velocity = Field(default=0.0, json_schema_extra=strict.unit("m/s"))
    """Velocity along x, m/s. Give m/s, at most 100."""
    v: Velocity = Field(default=0.0, json_schema_extra=strict.unit("m/s"))
    """Velocity along y, m/s. Give m/s, at most 100."""


def _valid_period(valid: str) -> str:
    """Refuse a text that is no period; the empty text is for currents given as numbers."""
    try:
        if valid:
            period(valid)
    except ValueError as error:
        raise ValueError(f"= {error}") from None
    return valid


def as_files(given: object) -> object:
    """Turn a text that looks like a path into a group of one file."""
    return (given,) if isinstance(given, str) and strict.looks_like_path(given) else given


def _kind(given: object) -> str:
    """Return the tag of the kind of source that is meant; messages leave tags out."""
    if isinstance(given, dict | StreamConstants):
        return "a table"
    return "a list" if isinstance(given, list | tuple) else "a name"


Valid = Annotated[str, AfterValidator(_valid_period)]
Files = Annotated[tuple[strict.PathText, ...], Field(min_length=1)]


class StreamConstants(StrictModel):
    """Tidal streams from harmonic constants, and the current on which they run."""

    constants: strict.PathText = Field(examples=["pass.nc"])
    """Harmonic constants of tidal streams on a grid. Give the path of a NetCDF file as `renew tide
    fit` writes it."""
    residual: Annotated[
        Literal["still"] | Files | None,
        BeforeValidator(as_files, json_schema_input_type=str | list[str] | None),
    ] = Field(default=None, examples=["daily.nc"])
    """Current on which the streams run: files of currents without tide, such as daily means, or
    'still'; by default the mean that the file has. Give files, 'still', or leave it out."""


# A source by its name in the catalogue, files that belong together by their paths or patterns, or
# constants of tidal streams.
Currents = Annotated[
    Annotated[str, Tag("a name")]
    | Annotated[Files, Tag("a list")]
    | Annotated[StreamConstants, Tag("a table")],
    Discriminator(_kind),
    BeforeValidator(as_files, json_schema_input_type=str | list[str] | StreamConstants),
]


def source_name(named: Currents) -> str:
    """Name a source in a message: as the catalogue does, or by its files."""
    if isinstance(named, str):
        return named
    paths = (named.constants,) if isinstance(named, StreamConstants) else named
    return ", ".join(Path(path).name for path in paths)


class Season(StrictModel):
    """One current to plan in: from sources in order of preference, or given as numbers."""

    name: strict.Name = Field(examples=["summer"])
    """Name of the season, and of its files. Use up to 64 lower-case letters, digits, '-' and '_'.
    """
    title: str = Field(default="", examples=["July 2024"])
    """Name of the season for readers. Give any text."""
    valid: Valid = Field(default="", examples=["2024-07"])
    """Time that the current is valid for, in UTC: a month 'YYYY-MM', a day 'YYYY-MM-DD' or an
    instant 'YYYY-MM-DDTHH:MMZ'; needed with all 'currents' but 'still', unless they change. Give a
    month as 'YYYY-MM', or a day."""
    time_method: TimeMethod | Literal["changing"] | None = Field(default=None, examples=["linear"])
    """How one field is made from a source's time steps: their mean, the nearest step, or linear in
    time; by default the mean for a month or a day, the nearest for an instant. With 'changing' no
    single field is made: the current changes during the voyage, with all time steps from
    'departure' on. Give 'mean', 'nearest', 'linear' or 'changing', or leave it out."""
    currents: tuple[Currents, ...] = Field(
        default=(), examples=[["daily/*.nc", "copernicus-glorys-monthly"]]
    )
    """Sources of the current in order of preference; files that belong together form a list of
    their own; 'still' is no current at all; a table { constants = 'pass.nc', residual = 'still' }
    is tidal streams. Give sources' names (`renew list`), and paths of files."""
    current_variables: tuple[str, str] | None = Field(
        default=None, examples=[["water_u", "water_v"]]
    )
    """The two variables of files in 'currents' that are the current, east and north, or speed and
    direction; by default they are found by their names. Give two names, or leave it out."""
    gyre: Gyre | None = Field(default=None, examples=[{"amplitude": 0.8}])
    """Gyres as the current of a plane scenario. Give a table with its amplitude."""
    uniform: Uniform | None = Field(default=None, examples=[{"u": 0.1, "v": 0.0}])
    """A uniform current of a plane scenario. Give a table with u and v."""
    departure: AwareDatetime | None = Field(default=None, examples=["2026-07-01T06:00:00Z"])
    """Time of departure, which dates the times in RTZ and GPX files; changing currents
    are counted from it. Give a time with its zone, as 2026-07-01T06:00:00Z, or leave it out."""
    departures: DepartureTimes | None = None
    """Departures from which the best is chosen, in place of 'departure', in currents that change.
    Give a table as { first = 2026-07-01T06:00:00Z, every = '1h', count = 24 }, or leave it out."""
    to_within: Interval | None = Field(default=None, examples=["1h"])
    """Largest time that another departure of the window may still save: departures between those
    given are added until no path found saves more; by default none are added. Give an interval,
    such as '1h', or leave it out."""
    arrive_by: AwareDatetime | None = Field(default=None, examples=["2026-07-02T18:00:00Z"])
    """Latest arrival at the goal, in currents that change or with 'speed'. Without 'speed' the
    latest departure is chosen, not before 'departure', that still arrives in time, or the best of
    'departures' that does; with it the vessel leaves at 'departure', or at the best of
    'departures', and chooses speeds that arrive in time. Give a time with its zone, as
    2026-07-02T18:00:00Z, or leave it out."""
    speed: SpeedRange | None = None
    """Range of speeds through water, in place of the vessel's own: it chooses a speed for each leg,
    for least fuel from 'departure', or the best of 'departures', to 'arrive_by'. Give a table as {
    least = 2.5, most = 6.0 } in m/s, or leave it out."""
    members: MembersSpec | None = None
    """Currents that may each come true, in place of one. Give a table as { along = 'files' } or {
    spread = 0.2 }, in a night {} for the forecasts that it has kept, or leave it out."""
    max_hours: strict.Positive | None = Field(
        default=None, le=MAX_HOURS, examples=[240], json_schema_extra=strict.unit("hours")
    )
    """Longest voyage in changing currents: later time steps, counted from the last departure, are
    not read; by default a day more than three times the time of the straight way from start to
    goal. Give hours, such as 240, or leave it out."""

    @model_validator(mode="after")
    def _one_current(self) -> Self:
        given = [bool(self.currents), self.gyre is not None, self.uniform is not None]
        if sum(given) != 1:
            raise strict.RemediedError(
                f"(season {self.name!r}) has {sum(given)} kinds of current; give one of "
                "'currents', 'gyre' and 'uniform'"
            )
        faults = [*self._time_faults(), *self._current_faults(), *self.member_faults()]
        if faults:
            how = "has time_method = 'changing' and " if self.is_changing else ""
            raise strict.RemediedError(f"(season {self.name!r}) {how}{'; it '.join(faults)}")
        return self

    def _current_faults(self) -> Iterator[str]:
        """Find that the current lacks a departure if it changes, or else a period."""
        if self.is_changing:
            if self.first_departure is None:
                yield "lacks 'departure'; add it with its zone, as 2026-07-01T06:00:00Z"
            if self.valid:
                yield "has 'valid', which its departure says already; leave it out"
        elif any(isinstance(named, StreamConstants) for named in self.currents):
            yield (
                "has harmonic constants, which need a clock; add time_method = 'changing', and a "
                "'departure'"
            )
        elif not self.valid and any(named != STILL for named in self.currents):
            yield "lacks 'valid'; add the month as 'YYYY-MM'"

    def member_faults(self) -> Iterator[str]:
        """Find members in currents that are not given as files."""
        if self.members is None or self.members.spread is not None:
            return
        along = self.members.along
        others = [source_name(named) for named in self.currents if not isinstance(named, tuple)]
        if others or not self.currents:
            kind = "files" if along in {"", FILES, CYCLES} else "files with that dimension"
            given = f"members.along = {along!r}" if along else "'members' of earlier forecasts"
            without = f", not {', '.join(others)}" if others else ""
            yield f"has {given}, which needs {kind} in 'currents'{without}"

    def _time_faults(self) -> Iterator[str]:
        """Find times and speeds that contradict each other, and what a choice of them lacks."""
        window, speed, first = self.departures, self.speed, self.first_departure
        longest = timedelta(hours=MAX_HOURS)
        if window is not None and self.departure is not None:
            yield "has both 'departure' and 'departures'; leave one out"
        if window is not None and window.window > longest:
            yield (
                f"has departures over {window.window.total_seconds() / 3600:,.0f} hours; "
                f"{MAX_HOURS:,.0f} are the most: lower their count, or 'every'"
            )
        if window is None and self.to_within is not None:
            yield "has 'to_within', but no 'departures' to choose from; add them"
        if speed is not None and speed.least > speed.most:
            yield (
                f"has speed.least = {speed.least:g} m/s above speed.most = {speed.most:g} m/s; "
                "exchange them"
            )
        if speed is not None and first is None and not self.is_changing:
            yield "has 'speed', but no 'departure', from which its time counts; add it"
        if speed is not None and self.arrive_by is None:
            yield "has 'speed', but no 'arrive_by', for which its speed is chosen; add it"
        if self.arrive_by is not None and first is not None:
            if self.arrive_by <= first:
                yield (
                    f"is to arrive_by {self.arrive_by.isoformat()}, not after its departure, "
                    f"{first.isoformat()}; give a later time"
                )
            elif self.arrive_by - first > longest:
                yield f"may be under way for more than {MAX_HOURS:,.0f} hours; depart later"

    @property
    def is_changing(self) -> bool:
        """Whether the current changes on the way."""
        return self.time_method == "changing"

    @property
    def leaves_departure_open(self) -> bool:
        """Whether the departure is to be chosen; with 'speed' and 'departure' it is given."""
        return self.departures is not None or (self.arrive_by is not None and self.speed is None)

    @property
    def first_departure(self) -> datetime | None:
        """The departure, or the first one to choose from; UTC."""
        if self.departures is not None:
            return self.departures.begin
        return self.departure and self.departure.astimezone(UTC)

    @property
    def period(self) -> Period:
        """The period that the current is to be valid for.

        A current that changes is needed from the first departure until `max_hours` after the last
        one, and at least until the arrival asked for.
        """
        begin = self.first_departure
        if self.is_changing and begin is not None:
            end = begin + timedelta(hours=self.max_hours or 0.0)
            if self.departures is not None:
                end += self.departures.window
            return Period(begin, max(end, (self.arrive_by or end).astimezone(UTC)))
        return period(self.valid)

    def departing(self, departure: datetime, label: str) -> Self:
        """Return the season, by another name, with its departure chosen."""
        chosen = {"name": label, "departure": departure, "departures": None, "to_within": None}
        if label != self.name:  # the title is that of the window of departures
            chosen["title"] = ""
        if self.speed is None:
            chosen["arrive_by"] = None
        return self.model_copy(update=chosen)

    @property
    def resolved_time_method(self) -> TimeMethod:
        """The method by which one field is made, as given or the default for the period."""
        if self.time_method is None or self.time_method == "changing":
            return "nearest" if self.period.is_instant else "mean"
        return self.time_method
