"""Points that a scenario's routes pass, and anchorages among them."""

from datetime import timedelta
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag

from pipeline.scenario import strict
from pipeline.scenario.strict import StrictModel
from pipeline.scenario.times import Span, span

# Longest wait at an anchorage: beyond it a plan would be for another week's weather.
_LONGEST = timedelta(days=3)


def _short(wait: str) -> str:
    """Refuse a wait of many days."""
    if span(wait) > _LONGEST:
        raise strict.RemediedError(
            f"= {wait!r} is longer than {_LONGEST.days} days; give at most "
            f"'{_LONGEST.days}d', or plan the way on by itself, with 'departures'"
        )
    return wait


class Anchorage(StrictModel):
    """A via point at which the vessel may lie at anchor before it goes on."""

    at: strict.Point = Field(
        examples=[[119.2, 11.9]], json_schema_extra=strict.unit("degrees, or m in a plane")
    )
    """The anchorage. Give [lon, lat] in degrees, or [x, y] in metres in a plane."""
    wait: Annotated[Span, AfterValidator(_short)] = Field(examples=["6h"])
    """Longest time at anchor, where no fuel is burnt: the vessel goes on when the rest of the way
    needs least fuel. Give '30min' or '6h', at most '3d'; '0min' is a point without a wait."""


def _kind(given: object) -> str:
    """Say which member of the union a value is meant to be; no key has such a name."""
    return "a table" if isinstance(given, dict | Anchorage) else "a point"


Via = Annotated[
    Annotated[strict.Point, Tag("a point")] | Annotated[Anchorage, Tag("a table")],
    Discriminator(_kind),
    BeforeValidator(lambda given: given, json_schema_input_type=strict.Point | Anchorage),
]


def place_of(via: strict.Point | Anchorage) -> strict.Point:
    """Return the place of a via point."""
    return via.at if isinstance(via, Anchorage) else via


def wait_at(via: strict.Point | Anchorage) -> timedelta:
    """Return the longest wait at a via point."""
    return span(via.wait) if isinstance(via, Anchorage) else timedelta()
