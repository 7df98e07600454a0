"""The scenario: one frozen model of everything that a run can be asked for.

There are two kinds. A *plane* scenario has a `plane`: extent, obstacles and current as numbers in
metres and m/s. Any other is a *chart* scenario: it takes land and currents from sources, in a
`region` in lon/lat that a run chooses where it is left out, and is planned at a `scale`.
"""

import os
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, ValidationInfo

from pipeline.scenario import catalogue, strict
from pipeline.scenario.catalogue import VesselLimits, VesselSpec
from pipeline.scenario.region import AvoidedArea, ChartSpec, Plane, Region
from pipeline.scenario.season import Interval, Season, Span, as_files, interval, span
from pipeline.scenario.strict import StrictModel

if TYPE_CHECKING:
    from shapely.geometry import Polygon


# Longest wait at an anchorage: after it, currents and tide are better planned anew.
_LONGEST_WAIT = timedelta(days=3)


def _short_wait(wait: str) -> str:
    """Refuse a wait of many days."""
    if span(wait) > _LONGEST_WAIT:
        raise strict.RemediedError(
            f"= {wait!r} is longer than {_LONGEST_WAIT.days} days; give at most "
            f"'{_LONGEST_WAIT.days}d', or plan the way on by itself, with 'departures'"
        )
    return wait


class Anchorage(StrictModel):
    """A via point at which the vessel may lie at anchor before it goes on."""

    at: strict.Point
    wait: Annotated[Span, AfterValidator(_short_wait)]


def _kind_of_via(given: object) -> str:
    """Return the tag of the kind of via point that is meant; messages leave tags out."""
    return "a table" if isinstance(given, dict | Anchorage) else "a point"


Via = Annotated[
    Annotated[strict.Point, Tag("a point")] | Annotated[Anchorage, Tag("a table")],
    Discriminator(_kind_of_via),
    BeforeValidator(lambda given: given, json_schema_input_type=strict.Point | Anchorage),
]


def place_of(via: strict.Point | Anchorage) -> strict.Point:
    """Return the place of a via point."""
    return via.at if isinstance(via, Anchorage) else via


def wait_at(via: strict.Point | Anchorage) -> timedelta:
    """Return the longest wait at a via point."""
    return span(via.wait) if isinstance(via, Anchorage) else timedelta()


def _as_path(station: str, info: ValidationInfo) -> str:
    """Make the path of a station's file absolute; keep a name of the catalogue."""
    return strict.usable_path(station, info) if strict.looks_like_path(station) else station


class TideSpec(StrictModel):
    """Stations that predict the tide over the chart datum, and how far the vessel relies on it."""

    stations: tuple[Annotated[str, AfterValidator(_as_path)], ...] = Field(
        min_length=1, max_length=100
    )
    surge_m: strict.NonNegative = 0.3
    lag: Span = "15min"

    @property
    def lag_s(self) -> float:
        """Time by which the tide may be early or late, s."""
        return span(self.lag).total_seconds()


class LimitsSpec(VesselLimits):
    """Wind and waves from files, and the limits beyond which the vessel does not go.

    Limits of the vessel in the catalogue count where none is given here.
    """

    waves: Annotated[tuple[strict.PathText, ...], BeforeValidator(as_files)] = ()
    wind: Annotated[tuple[strict.PathText, ...], BeforeValidator(as_files)] = ()


class HavensSpec(StrictModel):
    """A list of havens, and the limits within which one of them must be reached."""

    path: strict.PathText
    within: Interval | None = None
    endurance: Interval | None = None

    @property
    def text(self) -> str:
        """The limits for readers: "within 6h and with fuel for 2d at departure"."""
        fuel = self.endurance and f"with fuel for {self.endurance} at departure"
        if not self.within and not self.endurance:
            return "with what is on board"
        return " and ".join(filter(None, (self.within and f"within {self.within}", fuel)))

    @property
    def within_s(self) -> float | None:
        """Longest time to a haven, s."""
        return None if self.within is None else interval(self.within).total_seconds()

    @property
    def endurance_s(self) -> float | None:
        """Time under way for which there is fuel at departure, s."""
        return None if self.endurance is None else interval(self.endurance).total_seconds()


def _behind_link(text: str, info: ValidationInfo) -> str:
    """Make a folder's path absolute; links stay, because one leads to the newest results."""
    strict.usable_path(text, info)
    folder = str(info.context["folder"]) if text and info.context else ""
    whole = os.path.normpath(os.path.join(folder, os.path.expanduser(text))) if folder else text  # noqa: PTH111, PTH118 - a Path does not drop ".."
    return strict.DiskPath(whole)


class UnderWay(StrictModel):
    """The plan that the vessel sails, and its heading: it is at the scenario's start now."""

    results: Annotated[str, AfterValidator(_behind_link)]
    season: strict.Name
    departed: strict.Moment
    heading_deg: strict.Number | None = Field(default=None, ge=0, le=360)
    same_currents: bool = False
    switch_above: strict.Number = Field(default=0.02, ge=0, le=1)


MAX_SEASONS = 1000
"""Largest number of seasons of a scenario."""


class PlannerOptions(StrictModel):
    """The options of `renew.plan`; its metres are planar ones, true metres divided by `scale`."""

    # A test compares ranges and defaults with renew.PlanOptions: to import them would load the
    # compiler for every `renew --help`.

    classes: strict.Integer = Field(default=16, ge=1, le=10_000)
    risk: strict.Number = Field(default=0.05, ge=1e-9, lt=1)
    padding: Literal["adaptive", "triangle", "none"] | strict.NonNegative = "adaptive"
    clearance: strict.NonNegative | None = None
    snap: strict.Number = Field(default=0.0, ge=0, le=5000)
    lanes: bool | None = None
    narrow_share: strict.Number = Field(default=1.0, ge=0.01, le=1)
    distinct_by: Literal["auto"] | strict.NonNegative = "auto"
    method: Literal["optimal", "sampled"] = "optimal"
    samples: strict.Integer = Field(default=500, ge=1, le=1_000_000)
    drift: Literal["projected", "crab"] = "projected"
    seed: strict.Integer = Field(default=0, ge=0, le=2**63 - 1)
    order: Literal["fuel", "length", "depth-first"] = "fuel"
    risk_at: Literal["route", "point"] = "route"
    lateness: strict.Number = Field(default=0.05, ge=0, lt=1)
    gap_to: strict.Number = Field(default=0.0, ge=0, lt=1)
    shortfall: Literal["refuse", "least"] = "refuse"
    adrift: Interval | None = None
    adrift_ends: strict.NonNegative = 20_000.0


class OutputOptions(StrictModel):
    """Options of the output files."""

    rtz_version: Literal["1.0", "1.1", "1.2"] = "1.1"


def _known_vessel(given: object) -> object:
    """Replace a vessel's name by its entry of the catalogue; ValueError where it has none."""
    if not isinstance(given, str):
        return given
    known = catalogue.names("vessels")
    if given not in known:
        raise ValueError(catalogue.unknown("vessel", given, known))
    return catalogue.vessel(given)


class Scenario(StrictModel):
    """What `renew run` plans: from where to where, with which vessel, in which currents."""

    schema_version: Literal[1]
    name: strict.Name
    title: str = ""
    description: str = ""
    region: Region | None = None
    plane: Plane | None = None
    chart: ChartSpec = ChartSpec()
    vessel: Annotated[
        VesselSpec, BeforeValidator(_known_vessel, json_schema_input_type=str | VesselSpec)
    ]
    # Below this limit memory grows as 1 / scale, as routes get longer in vessel lengths.
    scale: strict.Number = Field(default=1.0, ge=0.1, le=1e6)
    start: strict.Point
    goal: strict.Point
    via: tuple[Via, ...] = Field(default=(), max_length=100)
    avoid: tuple[AvoidedArea, ...] = Field(default=(), max_length=1000)
    tide: TideSpec | None = None
    limits: LimitsSpec | None = None
    havens: HavensSpec | None = None
    seasons: tuple[Season, ...] = Field(min_length=1, max_length=MAX_SEASONS)
    under_way: UnderWay | None = None
    planner: PlannerOptions = PlannerOptions()
    outputs: OutputOptions = OutputOptions()

    def vessel_in(self, season: Season) -> VesselSpec:
        """Return the vessel with the highest speed that it has in a season."""
        if season.speed is None:
            return self.vessel
        return self.vessel.model_copy(update={"speed_m_s": season.speed.most})

    @property
    def weather_limits(self) -> VesselLimits:
        """The limits of [limits], and of those that it leaves out the vessel's own."""
        own, given = self.vessel.limits or VesselLimits(), self.limits or VesselLimits()
        names = VesselLimits.model_fields
        asked = {name: getattr(given, name) or getattr(own, name) for name in names}
        return VesselLimits.model_construct(**asked)

    @property
    def fastest_vessel(self) -> VesselSpec:
        """The vessel with the highest speed that it has in any season."""
        return max(map(self.vessel_in, self.seasons), key=lambda vessel: vessel.speed_m_s)

    @property
    def stops(self) -> dict[str, strict.Point]:
        """Start, via points and goal as given, by their keys."""
        via = {f"via[{at}]": place_of(point) for at, point in enumerate(self.via)}
        start = "start" if self.under_way is None else "start (--at)"
        return {start: self.start, **via, "goal": self.goal}

    @property
    def anchorage(self) -> tuple[int, timedelta] | None:
        """Which via point is the anchorage, and the longest wait there; None without a wait."""
        return next(((at, wait) for at, wait in enumerate(map(wait_at, self.via)) if wait), None)

    def departing(self, season: str, departure: datetime, label: str) -> Self:
        """Return the scenario with a season's departure chosen, and the season's new name."""
        seasons = tuple(
            given.departing(departure, label) if given.name == season else given
            for given in self.seasons
        )
        return self.model_copy(update={"seasons": seasons})

    def season_if_several(self, season: str) -> tuple[str, ...]:
        """Return a season that a note has to name: none where it is the only one."""
        return (season,) if len(self.seasons) > 1 else ()

    def passage(self, season: str, duration_s: float) -> tuple[datetime, datetime] | None:
        """Return departure and arrival, UTC, of a voyage in a season; None without a departure."""
        departure = next((given.departure for given in self.seasons if given.name == season), None)
        if departure is None:
            return None
        return departure.astimezone(UTC), departure.astimezone(UTC) + timedelta(seconds=duration_s)

    @property
    def is_planar(self) -> bool:
        """Whether positions are in metres of a plane, not in degrees."""
        return self.plane is not None

    @property
    def area(self) -> "Polygon":
        """The region in lon/lat degrees, or the plane's extent in metres."""
        place = self.region if self.region is not None else self.plane
        if place is None:
            raise ValueError("the scenario's region is yet to be chosen")
        return place.shape
