"""Departures of a season, among which the best is looked for."""

from datetime import UTC, datetime, timedelta
from typing import Annotated

from pydantic import AwareDatetime, Field

from pipeline.scenario.interval import Interval, interval
from pipeline.scenario.strict import Integer, StrictModel

Every = Annotated[
    Interval,
    Field(description="Time from one departure to the next. Give '30min', '6h' or '1d'."),
]
Count = Annotated[
    Integer,
    Field(
        ge=1,
        le=10_000,
        description="Number of departures. Give a whole number from 1 to 10,000.",
    ),
]


class DepartureTimes(StrictModel):
    """Times at which the vessel may leave: `count` of them from `first` on, `every` apart."""

    first: AwareDatetime = Field(
        description="First departure. Give a time with its zone, as 2026-07-01T06:00:00Z.",
        examples=["2026-07-01T06:00:00Z"],
    )
    every: Every = "1h"
    count: Count = Field(examples=[24])

    @property
    def begin(self) -> datetime:
        """The first departure, UTC."""
        return self.first.astimezone(UTC)

    @property
    def window(self) -> timedelta:
        """Time from the first departure to the last."""
        return (self.count - 1) * interval(self.every)

    @property
    def seconds(self) -> tuple[float, ...]:
        """All departures, in seconds after the first."""
        return tuple((i * interval(self.every)).total_seconds() for i in range(self.count))


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
