"""A season of a scenario: the current to plan in, and the period it is valid for."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, AwareDatetime, BeforeValidator, Field, model_validator

from pipeline.scenario.period import Period, period
from pipeline.scenario.strict import (
    Integer,
    Name,
    Number,
    StrictModel,
    looks_like_path,
    usable_path,
)

TimeMethod = Literal["mean", "nearest", "linear"]
STILL = "still"
"""The source of the catalogue that has no current at all, at any time."""


# Speed that no current on earth reaches, m/s: a larger figure has a slip of the pen in it.
MAX_CURRENT_M_S = 100.0
Velocity = Annotated[Number, Field(ge=-MAX_CURRENT_M_S, le=MAX_CURRENT_M_S)]


class Gyre(StrictModel):
    """Gyres that fill the extent of a plane scenario; see `renew.GyreCurrent`."""

    amplitude: Velocity = Field(
        description="Maximum speed of the current, m/s; negative values turn the other way. Give "
        "the strongest current in m/s, at most 100.",
        examples=[0.8],
        json_schema_extra={"unit": "m/s"},
    )
    columns: Integer = Field(
        default=1, ge=1, description="Number of gyres along x. Give a whole number, 1 or more."
    )
    rows: Integer = Field(
        default=1, ge=1, description="Number of gyres along y. Give a whole number, 1 or more."
    )


class Uniform(StrictModel):
    """The same current everywhere in a plane scenario."""

    u: Velocity = Field(
        default=0.0,
        description="Velocity along x, m/s. Give m/s, at most 100.",
        json_schema_extra={"unit": "m/s"},
    )
    v: Velocity = Field(
        default=0.0,
        description="Velocity along y, m/s. Give m/s, at most 100.",
        json_schema_extra={"unit": "m/s"},
    )


def _valid_period(valid: str) -> str:
    """Refuse a text that is no period; the empty text is for currents given as numbers."""
    try:
        if valid:
            period(valid)
    except ValueError as error:
        raise ValueError(f"= {error}") from None
    return valid


def _as_files(given: object) -> object:
    """Turn a text that looks like a path into a group of one file of currents."""
    return (given,) if isinstance(given, str) and looks_like_path(given) else given


def _usable_files(given: str | tuple[str, ...]) -> str | tuple[str, ...]:
    """Refuse texts that can't be paths; not inside the union, which adds a fault per member."""
    return given if isinstance(given, str) else tuple(usable_path(text) for text in given)


Valid = Annotated[str, AfterValidator(_valid_period)]
Files = Annotated[tuple[str, ...], Field(min_length=1)]
# A source by its name in the catalogue, or files that belong together by their paths or patterns.
Currents = Annotated[
    str | Files,
    BeforeValidator(_as_files, json_schema_input_type=str | list[str]),
    AfterValidator(_usable_files),
]


class Season(StrictModel):
    """One current to plan in: from sources in order of preference, or given as numbers."""

    name: Name = Field(
        description="Name of the season, and of its files. Use up to 64 lower-case letters, "
        "digits, '-' and '_'.",
        examples=["summer"],
    )
    title: str = Field(
        default="",
        description="Name of the season for readers. Give any text.",
        examples=["July 2024"],
    )
    valid: Valid = Field(
        default="",
        description="Time that the current is valid for, in UTC: a month 'YYYY-MM', a day "
        "'YYYY-MM-DD' or an instant 'YYYY-MM-DDTHH:MMZ'; needed with all 'currents' but 'still'. "
        "Give a month as "
        "'YYYY-MM', or a day.",
        examples=["2024-07"],
    )
    time_method: TimeMethod | None = Field(
        default=None,
        description="How one field is made from a source's time steps: their mean, the nearest "
        "step, or linear in time; left out, the mean for a month or a day, the nearest for an "
        "instant. Give 'mean', 'nearest' or 'linear', or leave it out.",
        examples=["linear"],
    )
    currents: tuple[Currents, ...] = Field(
        default=(),
        description="Sources of the current in order of preference; files that belong together "
        "form a list of their own; 'still' is no current at all. Give sources' names (`renew "
        "list`), and paths of files.",
        examples=[["daily/*.nc", "copernicus-glorys-monthly"]],
    )
    gyre: Gyre | None = Field(
        default=None,
        description="Gyres as the current of a plane scenario. Give a table with its amplitude.",
        examples=[{"amplitude": 0.8}],
    )
    uniform: Uniform | None = Field(
        default=None,
        description="A uniform current of a plane scenario. Give a table with u and v.",
        examples=[{"u": 0.1, "v": 0.0}],
    )
    departure: AwareDatetime | None = Field(
        default=None,
        description="Time of departure, which dates the times in RTZ and GPX files. Give a time "
        "with its zone, as 2026-07-01T06:00:00Z, or leave it out.",
        examples=["2026-07-01T06:00:00Z"],
    )

    @model_validator(mode="after")
    def _one_current(self) -> Self:
        given = [bool(self.currents), self.gyre is not None, self.uniform is not None]
        if sum(given) != 1:
            raise ValueError(
                f"(season {self.name!r}) has {sum(given)} kinds of current; give one of "
                "'currents', 'gyre' and 'uniform'"
            )
        if not self.valid and any(named != STILL for named in self.currents):
            raise ValueError(f"(season {self.name!r}) lacks 'valid'; add the month as 'YYYY-MM'")
        return self

    @property
    def period(self) -> Period:
        """The period that the current is to be valid for."""
        return period(self.valid)

    @property
    def resolved_time_method(self) -> TimeMethod:
        """The method as given, or the default for the period."""
        return self.time_method or ("nearest" if self.period.is_instant else "mean")
