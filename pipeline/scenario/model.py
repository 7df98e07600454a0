"""The scenario: one frozen model of what can be asked for, and nothing else is accepted.

Two kinds share it. A *chart* scenario has a `region` in lon/lat, takes its land and its currents
from sources, and is planned at a `scale`. A *plane* scenario gives extent, obstacles and current
as figures in metres.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import AfterValidator, AwareDatetime, BeforeValidator, Field, model_validator

from pipeline.scenario.period import Period, period
from pipeline.scenario.region import ChartSpec, Plane, Region
from pipeline.scenario.strict import (
    FAULT_SEPARATOR,
    Name,
    NotNegative,
    Number,
    Point,
    Positive,
    Strictly,
    Whole,
    looks_like_path,
)

if TYPE_CHECKING:
    from shapely.geometry import Polygon

    import renew


class VesselSpec(Strictly):
    """A vessel's figures, and where they come from."""

    name: Name = "vessel"
    title: str = ""
    origin: str = ""
    length_m: Positive = Field(description="give the length overall in metres")
    draught_m: Positive | None = Field(
        default=None, description="give the metres it reaches below the water line"
    )
    speed_m_s: Positive = Field(description="give the speed through water in m/s")
    turn_rate_deg_s: Positive = Field(description="give the hard-over turn rate in degrees/s")
    fuel_coefficient: Positive = Field(
        default=1.0, description="fuel a second is this × speed^exponent"
    )
    fuel_exponent: Positive = Field(
        default=2.0, description="fuel a second is coefficient × speed^this"
    )

    def vessel(self) -> renew.Vessel:
        """Build the planner's own vessel."""
        import math

        import renew

        return renew.Vessel(
            speed=self.speed_m_s,
            turn_rate=math.radians(self.turn_rate_deg_s),
            length=self.length_m,
            fuel_coefficient=self.fuel_coefficient,
            fuel_exponent=self.fuel_exponent,
        )


class Gyre(Strictly):
    """Gyres that fill a plane scenario's extent; see `renew.GyreCurrent`."""

    amplitude: Number = Field(description="give the strongest current in m/s")
    columns: Whole = Field(default=1, ge=1, description="give the number of gyres along x")
    rows: Whole = Field(default=1, ge=1, description="give the number of gyres along y")


class Uniform(Strictly):
    """One current everywhere in a plane scenario, m/s along x and y."""

    u: Number = 0.0
    v: Number = 0.0


def _a_period(valid: str) -> str:
    """Refuse what is no time; nothing is one where the current is given as figures."""
    try:
        if valid:
            period(valid)
    except ValueError as error:
        raise ValueError(f"= {error}") from None
    return valid


def _as_files(given: object) -> object:
    """Take a text that looks like a path for a file of currents by itself."""
    return (given,) if isinstance(given, str) and looks_like_path(given) else given


Valid = Annotated[str, AfterValidator(_a_period)]
# A source of the catalogue by its name; or files that belong together, by paths and patterns.
Files = Annotated[tuple[str, ...], Field(min_length=1)]
Currents = Annotated[str | Files, BeforeValidator(_as_files)]


class Season(Strictly):
    """One set of currents to plan in: from sources in order of preference, or as figures."""

    name: Name
    title: str = ""
    valid: Valid = Field(default="", description="give a month as 'YYYY-MM', or a day")
    time: Literal["mean", "nearest", "linear"] | None = Field(
        default=None,
        description="give 'mean', 'nearest' or 'linear', or leave it out: the mean of a month or a "
        "day, the field nearest to an instant",
    )
    currents: tuple[Currents, ...] = Field(
        default=(), description="give sources' names (`renew list`), and paths of files"
    )
    gyre: Gyre | None = None
    uniform: Uniform | None = None
    departure: AwareDatetime | None = Field(
        default=None,
        description="give a time with its zone, as 2026-07-01T06:00:00Z, or leave it out",
    )

    @model_validator(mode="after")
    def _one_current(self) -> Self:
        given = [bool(self.currents), self.gyre is not None, self.uniform is not None]
        if sum(given) != 1:
            raise ValueError(
                f"(season {self.name!r}) has {sum(given)} kinds of current; give one of "
                "'currents', 'gyre' and 'uniform'"
            )
        if self.currents and not self.valid:
            raise ValueError(f"(season {self.name!r}) lacks 'valid'; add the month as 'YYYY-MM'")
        return self

    @property
    def period(self) -> Period:
        """The time that its figures are to stand for."""
        return period(self.valid)

    @property
    def how(self) -> Literal["mean", "nearest", "linear"]:
        """How a source's time steps become the one field of the period."""
        return self.time or ("nearest" if self.period.is_instant else "mean")


class PlannerOptions(Strictly):
    """What `renew.plan` is told; metres are the planner's own (scaled)."""

    classes: Whole = Field(
        default=16, ge=1, description="give the number of route classes to examine, such as 16"
    )
    risk: Number = Field(
        default=0.05,
        gt=0,
        lt=1,
        description="give the share of turns that may exceed the padding, such as 0.05",
    )
    padding: Literal["adaptive", "none"] | NotNegative = Field(
        default="adaptive", description="give 'adaptive', 'none' or metres"
    )
    clearance: NotNegative = Field(
        default=0.0, description="give the least padding in metres, or 0"
    )
    distinct_by: NotNegative = Field(
        default=0.0, description="give the smallest island in metres that makes a choice, or 0"
    )
    method: Literal["optimal", "sampled"] = Field(
        default="optimal", description="give 'optimal' or 'sampled'"
    )
    samples: Whole = Field(default=500, ge=1, description="give the chains a class, such as 500")
    drift: Literal["projected", "crab"] = Field(
        default="projected", description="give 'projected' or 'crab'"
    )
    seed: Whole = Field(default=0, ge=0, description="give a whole number, 0 or more")
    order: Literal["fuel", "length", "depth-first"] = Field(
        default="fuel", description="give 'fuel', 'length' or 'depth-first'"
    )


class OutputOptions(Strictly):
    """How the files are written."""

    rtz: Literal["1.0", "1.1", "1.2"] = Field(
        default="1.1", description="give '1.0', '1.1' or '1.2', whichever the chart plotter reads"
    )


class PublishedRow(Strictly):
    """One published result, in the publication's own units."""

    label: str
    season: str = ""
    fuel: Positive | None = None
    clearance: Positive | None = None
    length: Positive | None = None
    fuel_per_distance: Positive | None = None
    side: str = ""


class Published(Strictly):
    """Published figures that the report sets beside ours; `scale` is the publication's own."""

    origin: str
    scale: Positive = 1.0
    rows: tuple[PublishedRow, ...]


class Scenario(Strictly):
    """What `renew run` runs; read it with :func:`pipeline.scenario.catalogue.load_scenario`."""

    schema_version: Literal[1] = Field(description="write schema_version = 1")
    name: Name
    title: str = ""
    description: str = ""
    region: Region | None = None
    plane: Plane | None = None
    chart: ChartSpec = ChartSpec()
    vessel: VesselSpec
    scale: Positive = Field(
        default=1.0, description="give true metres to a planar metre: 1 is the true scale"
    )
    start: Point = Field(description="give [lon, lat] in degrees, or [x, y] in metres in a plane")
    goal: Point = Field(description="give [lon, lat] in degrees, or [x, y] in metres in a plane")
    seasons: tuple[Season, ...] = Field(min_length=1, description="add a [[seasons]] table")
    planner: PlannerOptions = PlannerOptions()
    outputs: OutputOptions = OutputOptions()
    published: Published | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        faults = []
        if (self.region is None) == (self.plane is None):
            faults.append("must have either [region] or [plane]; give one of the two")
        names = [season.name for season in self.seasons]
        faults += [
            f"has {names.count(name)} seasons called {name!r}; rename all but one"
            for name in dict.fromkeys(names)
            if names.count(name) > 1
        ]
        for season in self.seasons:
            if self.region is not None and not season.currents:
                faults.append(
                    f"season {season.name!r} gives its current as figures, which belong to a "
                    "[plane]; name sources in 'currents'"
                )
            if self.plane is not None and season.currents:
                faults.append(
                    f"season {season.name!r} names sources, which need a [region]; give its "
                    "current as 'gyre' or 'uniform'"
                )
            if self.plane is not None and season.gyre and self.plane.extent[:2] != (0, 0):
                faults.append(
                    f"season {season.name!r} is a gyre, but the plane's extent begins at "
                    f"{list(self.plane.extent[:2])}; begin it at [0, 0]"
                )
        if faults:
            raise ValueError(FAULT_SEPARATOR.join(faults))
        return self

    @property
    def is_planar(self) -> bool:
        """Whether the waters are given in metres."""
        return self.plane is not None

    @property
    def waters(self) -> Polygon:
        """Region in lon/lat degrees, or extent in metres."""
        place = self.region if self.region is not None else self.plane
        if place is None:  # the validator saw to it
            raise ValueError("scenario without region and plane")
        return place.shape
