"""Times of a scenario: periods that currents are valid for, intervals, departures to choose from.

A period is a month, a day or an instant, always UTC. An interval is written as '30min', '6h' or
'1d'.
"""

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Annotated, Self

from pydantic import AfterValidator, AwareDatetime, Field, model_validator

from pipeline.scenario.strict import Integer, RemediedError, StrictModel

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
    """Read an interval.

    Raises
    ------
    ValueError
        The text is no interval, or 0.
    """
    found = _INTERVAL.fullmatch(text)
    if not found:
        raise RemediedError(f"= {text!r} is not an interval; give it as '30min', '6h' or '1d'")
    if not int(found[1]):
        raise RemediedError(f"= {text!r} is no time at all; give one above 0, such as '6h'")
    return int(found[1]) * _UNITS[found[2]]


def _checked(text: str) -> str:
    """Refuse a text that is no interval."""
    interval(text)
    return text


Interval = Annotated[str, AfterValidator(_checked)]

_NO_TIME = "0min"


def span(text: str) -> timedelta:
    """Read an interval that may be no time at all, '0min'; else ValueError with the remedy."""
    return timedelta() if text == _NO_TIME else interval(text)


def _spanned(text: str) -> str:
    """Refuse a text that is neither an interval nor no time."""
    span(text)
    return text


Span = Annotated[str, AfterValidator(_spanned)]


Count = Annotated[Integer, Field(ge=1, le=10_000)]


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
            raise RemediedError(
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


# Name of the season of a departure that nobody named.
_NAME = "%Y-%m-%dt%H%Mz"


def departure_name(departure: datetime) -> str:
    """Name the season of a departure, UTC: 2026-11-22t0600z."""
    return departure.strftime(_NAME)


def named_departure(season: str) -> datetime | None:
    """Return the departure, UTC, that a season is named by; None where it has a name of its own."""
    try:
        return datetime.strptime(season, _NAME).replace(tzinfo=UTC)
    except ValueError:
        return None
