"""Departures of a night: times of day, counted from the reference time of its currents."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Annotated

from pydantic import AfterValidator, Field

from pipeline.scenario.strict import StrictModel
from pipeline.scenario.times import Count, Every, interval

_TIME = re.compile(r"([01]\d|2[0-3]):([0-5]\d)Z", re.ASCII)
_DAY = timedelta(days=1)


def _time_of_day(text: str) -> str:
    """Return the text, or raise ValueError if it is not a time of day in UTC."""
    if not _TIME.fullmatch(text):
        raise ValueError(f"= {text!r} is not a time of day in UTC; give it as '06:00Z'")
    return text


class DepartureSpec(StrictModel):
    """`count` departures, the first at `first`, with the interval `every` between them."""

    first: Annotated[str, AfterValidator(_time_of_day)] = Field(
        description="First departure: the first such time at or after the reference time of the "
        "currents. Give a time of day in UTC, as '06:00Z'."
    )
    every: Every = "1d"
    count: Count = 1

    def departures(self) -> tuple[Departure, ...]:
        """Return all departures."""
        found = _TIME.fullmatch(self.first)
        if found is None:
            raise ValueError("validated when the table was read")
        first = timedelta(hours=int(found[1]), minutes=int(found[2]))
        step = interval(self.every)
        return tuple(Departure(first, i * step) for i in range(self.count))


@dataclass(frozen=True, slots=True)
class Departure:
    """A departure: the time of day of the first one, and the time between that and this one."""

    time_of_day: timedelta
    later: timedelta

    @property
    def name(self) -> str:
        """Name, equal every night: 0600Z, or 0000Z+1 on the day after the first departure."""
        days, rest = divmod(self.time_of_day + self.later, _DAY)
        minutes = rest // timedelta(minutes=1)
        return f"{minutes // 60:02}{minutes % 60:02}Z" + (f"+{days}" if days else "")

    def after(self, reference: datetime) -> datetime:
        """Return the departure, given the reference time (aware, UTC) of the night's currents."""
        midnight = reference.replace(hour=0, minute=0, second=0, microsecond=0)
        first = midnight + self.time_of_day
        return (first if first >= reference else first + _DAY) + self.later
