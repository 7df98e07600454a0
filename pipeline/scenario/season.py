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

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from pipeline.scenario import strict
from pipeline.scenario.strict import StrictModel

# Forms of a season's `valid`; whether the date exists is checked by `datetime`.
# The years are those of `in_years`.
_MONTH = re.compile(r"(?:1[7-9]|2[01])\d{2}-\d{2}", re.ASCII)
_DAY = re.compile(rf"{_MONTH.pattern}-\d{{2}}", re.ASCII)
_INSTANT = re.compile(rf"{_DAY.pattern}T\d{{2}}:\d{{2}}Z", re.ASCII)


@dataclass(frozen=True, slots=True)
class Period:
    """The time from `begin` up to `end`, aware UTC datetimes; an instant where they are equal."""

    begin: datetime
    end: datetime


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
        reason = "it has another form, or a year before 1700 or after 2199"
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

    first: strict.Moment
    every: Interval = "1h"
    count: Count
    last: strict.Moment | None = None

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


class MembersSpec(StrictModel):
    """Currents that may each come true, and what the side is chosen by.

    Turns are clear in every member, and results say in how many of them each side is best.
    """

    along: str = ""
    spread: strict.Positive | None = Field(default=None, le=10)
    eddy_km: strict.Positive = Field(default=80.0, le=1e4)
    count: strict.Integer = Field(default=20, ge=2, le=200)
    weights: tuple[strict.NonNegative, ...] = ()
    choose: Literal["mean", "p90", "cvar90", "regret"] = "mean"

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if bool(self.along) == (self.spread is not None):
            which = "both" if self.along else "neither"
            raise ValueError(f"has {which} of 'along' and 'spread'; give one of the two")
        if self.weights and not self.along:
            raise ValueError("has 'weights' for random members; leave them out, or give 'along'")
        return self


Speed = Annotated[strict.Positive, Field(le=42)]
"""A vessel's own speed, m/s: only boats that are built for records pass 82 knots."""


class SpeedRange(StrictModel):
    """Lowest and highest speed through water, in place of the vessel's own speed."""

    least: Speed
    most: Speed


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

    amplitude: Velocity
    columns: strict.Integer = Field(default=1, ge=1)
    rows: strict.Integer = Field(default=1, ge=1)


class Uniform(StrictModel):
    """A uniform current in a plane scenario."""

    u: Velocity = 0.0
    v: Velocity = 0.0


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

    constants: strict.PathText
    residual: Annotated[
        Literal["still"] | Files | None,
        BeforeValidator(as_files, json_schema_input_type=str | list[str] | None),
    ] = None


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

    name: strict.Name
    title: str = ""
    valid: Valid = ""
    time_method: TimeMethod | Literal["changing"] | None = None
    currents: tuple[Currents, ...] = ()
    current_variables: tuple[str, str] | None = None
    gyre: Gyre | None = None
    uniform: Uniform | None = None
    departure: strict.Moment | None = None
    departures: DepartureTimes | None = None
    to_within: Interval | None = None
    arrive_by: strict.Moment | None = None
    speed: SpeedRange | None = None
    members: MembersSpec | None = None
    max_hours: strict.Positive | None = Field(default=None, le=MAX_HOURS)

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
        if self.current_variables and all(isinstance(named, str) for named in self.currents):
            yield "has 'current_variables', which are those of files; add a file, or leave them"
        if STILL in self.currents[:-1]:
            yield "names other currents after 'still', which would never be used; put 'still' last"

    def member_faults(self) -> Iterator[str]:
        """Find members in currents that are not given as files."""
        if self.members is None or self.members.spread is not None:
            return
        along = self.members.along
        others = [source_name(named) for named in self.currents if not isinstance(named, tuple)]
        if others or not self.currents:
            kind = "files" if along == FILES else "files with that dimension"
            without = f", not {', '.join(others)}" if others else ""
            yield f"has members.along = {along!r}, which needs {kind} in 'currents'{without}"

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
            return "nearest" if self.period.begin == self.period.end else "mean"
        return self.time_method
