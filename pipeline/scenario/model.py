"""The scenario: one frozen model of everything that a run can be asked for.

There are two kinds. A *plane* scenario has a `plane`: extent, obstacles and current as numbers in
metres and m/s. Any other is a *chart* scenario: it takes land and currents from sources, in a
`region` in lon/lat that a run chooses where it is left out, and is planned at a `scale`.
"""

import os
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import (
    AfterValidator,
    AwareDatetime,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
)

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

    at: strict.Point = Field(
        examples=[[119.2, 11.9]], json_schema_extra=strict.unit("degrees, or m in a plane")
    )
    """The anchorage. Give [lon, lat] in degrees, or [x, y] in metres in a plane."""
    wait: Annotated[Span, AfterValidator(_short_wait)] = Field(examples=["6h"])
    """Longest time at anchor, where no fuel is burnt: the vessel goes on when the rest of the way
    needs least fuel. Give '30min' or '6h', at most '3d'; '0min' is a point without a wait."""


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
        min_length=1, max_length=100, examples=[["boston"], ["./boston.json"]]
    )
    """Tide stations. Each counts in its zone, or else in the waters to which it is the nearest by
    water, within 10 km. Give names of the catalogue (`renew list`), or paths of files with harmonic
    constants; or of official water levels (S-104), which count where and while they reach."""
    surge_m: strict.NonNegative = 0.3
    """Height by which the water may stand lower than predicted, by wind and air pressure, metres.
    Give metres, 0 or more."""
    lag: Span = "15min"
    """Time by which the tide may be early or late. Give '15min' or '1h', or '0min'."""

    @property
    def lag_s(self) -> float:
        """Time by which the tide may be early or late, s."""
        return span(self.lag).total_seconds()


class LimitsSpec(VesselLimits):
    """Wind and waves from files, and the limits beyond which the vessel does not go.

    Limits of the vessel in the catalogue count where none is given here.
    """

    waves: Annotated[tuple[strict.PathText, ...], BeforeValidator(as_files)] = Field(
        default=(), examples=[["waves.nc"]]
    )
    """Files of the significant wave height, NetCDF, Zarr or GRIB. Give paths, or leave it out."""
    wind: Annotated[tuple[strict.PathText, ...], BeforeValidator(as_files)] = Field(
        default=(), examples=[["wind.grib"]]
    )
    """Files of the wind at 10 m, and of its gusts, NetCDF, Zarr or GRIB. Give paths, or leave it
    out."""
    wait: Annotated[Span, AfterValidator(_short_wait)] = "0min"
    """Longest time for which the vessel may wait at its start, and wherever else it can hold its
    place, until water opens. Give '30min' or '6h', at most '3d'; with '0min' it never waits."""

    @property
    def wait_s(self) -> float:
        """Longest wait, s."""
        return span(self.wait).total_seconds()


class HavensSpec(StrictModel):
    """A list of havens, and the limits within which one of them must be reached."""

    path: strict.PathText = Field(examples=["./havens.geojson"])
    """File with the havens as points, with a column 'name'; relative paths start at the scenario's
    folder. Give a GeoJSON file, another vector file, or CSV with the columns name, lon and lat."""
    within: Interval | None = Field(default=None, examples=["6h"])
    """Longest time from a place of the route to a haven. Give '30min', '6h' or '1d', or leave it
    out where there is an endurance."""
    endurance: Interval | None = Field(default=None, examples=["2d"])
    """Time under way for which there is fuel at departure: what is left where the vessel turns off
    must do; by default what the battery or tank gives. Give '30min', '6h' or '2d', or leave it
    out."""

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

    results: Annotated[str, AfterValidator(_behind_link)] = Field(examples=["../crossing"])
    """Folder of the results that have the plan. Give the path of the folder of a finished run."""
    season: strict.Name = Field(examples=["summer"])
    """The season of those results that the vessel sails. Give its name."""
    departed: AwareDatetime = Field(examples=["2026-07-01T06:00:00Z"])
    """When the vessel left. Give a time with its zone, as 2026-07-01T06:00:00Z."""
    heading_deg: strict.Number | None = Field(
        default=None, ge=0, le=360, examples=[215.0], json_schema_extra=strict.unit("degrees true")
    )
    """The vessel's true heading, where the route begins with a turn; by default it begins on the
    best one. Give degrees from 0 to 360, clockwise from north."""
    same_currents: bool = False
    """Whether the plan's own currents still hold; otherwise those of the season are read. Give true
    or false."""
    switch_above: strict.Number = Field(default=0.02, ge=0, le=1)
    """Share of the fuel ahead that a way on another side has to save before the vessel changes to
    it. Give a share from 0 to 1, such as 0.02."""


class PublishedRow(StrictModel):
    """One published route, in the publication's own units."""

    label: str = Field(examples=["RENEW"])
    """Who planned it. Give any text."""
    season: str = Field(default="", examples=["summer"])
    """Season of this scenario that it belongs to. Give the season's name."""
    fuel: strict.Positive | None = Field(default=None, examples=[160.563])
    """Published fuel, in the publication's units. Give a number above 0."""
    clearance: strict.Positive | None = Field(
        default=None, examples=[9.153], json_schema_extra=strict.unit("scaled m")
    )
    """Published clearance from land, in metres of the publication's scale. Give a number above 0.
    """
    length: strict.Positive | None = Field(
        default=None, examples=[164.586], json_schema_extra=strict.unit("scaled m")
    )
    """Published length, in metres of the publication's scale. Give a number above 0."""
    fuel_per_distance: strict.Positive | None = Field(default=None, examples=[0.976])
    """Published F/D; if left out, fuel divided by length. Give a number above 0."""
    side: str = Field(default="", examples=["west"])
    """Compass side on which it passes the largest island. Give 'north', 'east', 'south' or 'west'.
    """


class Published(StrictModel):
    """Published figures that the report compares with this run's."""

    origin: str = Field(examples=["RENEW (AAAI 2026), Palawan"])
    """The publication. Give any text."""
    scale: strict.Positive = 1.0
    """The publication's scale: true metres per published metre. Give a number above 0: 1 is the
    true scale."""
    rows: tuple[PublishedRow, ...]
    """The published routes. Add a [[published.rows]] table for each."""


MAX_SEASONS = 1000
"""Largest number of seasons of a scenario."""


class PlannerOptions(StrictModel):
    """The options of `renew.plan`; its metres are planar ones, true metres divided by `scale`."""

    # A test compares ranges and defaults with renew.PlanOptions: to import them would load the
    # compiler for every `renew --help`.

    classes: strict.Integer = Field(default=16, ge=1, le=10_000)
    """Number of homotopy classes (ways round the islands) to find a route for; 'order' says which
    ones. Give a whole number from 1 to 10,000, such as 16."""
    risk: strict.Number = Field(default=0.05, ge=1e-9, lt=1)
    """Share of drawn hard-over turns that may reach beyond the padding of a triangle: a smaller
    share keeps routes further off land. Padding that is fitted to a route's turns begins with it.
    Give a share between 0 and 1, such as 0.05."""
    padding: Literal["adaptive", "triangle", "none"] | strict.NonNegative = Field(
        default="adaptive", json_schema_extra=strict.unit("planar m")
    )
    """Room for hard-over turns around land: adapted to the current and fitted to each route's own
    turns, only adapted triangle by triangle (as published), none, or the same number of planar
    metres everywhere. Give 'adaptive', 'triangle', 'none' or metres."""
    clearance: strict.NonNegative | None = Field(
        default=None, examples=[500], json_schema_extra=strict.unit("planar m")
    )
    """Least distance from land, planar metres; by default an offing for the vessel and the chart,
    which the notes of a run state, and 0 in a plane. Give metres, 0 or more."""
    snap: strict.Number = Field(default=0.0, ge=0, le=5000, json_schema_extra=strict.unit("m"))
    """Distance, true metres, up to which a start, goal or via point on land is moved to the nearest
    water that joins them all; the results say so. Renew go gives 500. Give metres from 0 to 5,000;
    with 0 a stop on land is refused."""
    lanes: bool | None = None
    """Whether no route sails against the traffic lanes of the chart (COLREGS rule 10); by default
    for a vessel of 20 m or more. Give true or false."""
    narrow_share: strict.Number = Field(default=1.0, ge=0.01, le=1)
    """In passages too narrow for the clearance, the clearance is reduced to this share of the
    distance from land to the passage's middle; 1: it is never reduced. Where a run chooses an
    offing, the share is at most 0.5. Give a share from 0.01 to 1."""
    distinct_by: Literal["auto"] | strict.NonNegative = Field(
        default="auto", json_schema_extra=strict.unit("planar m")
    )
    """Islands smaller than this distinguish no classes, planar metres; 'auto': only the few
    largest islands near the route do. Give 'auto', metres, or 0 to count every island."""
    method: Literal["optimal", "sampled"] = "optimal"
    """How the path inside a class is found: by dynamic programming, or as the best of random chains
    as in the paper. Give 'optimal' or 'sampled'."""
    samples: strict.Integer = Field(default=500, ge=1, le=1_000_000)
    """Number of random chains per class with method 'sampled'. Give a whole number from 1 to
    1,000,000, such as 500."""
    drift: Literal["projected", "crab"] = "projected"
    """Drift model of the fuel law: the current projected on the course, as in the paper, or a
    vessel that crabs to hold its course. Give 'projected' or 'crab'."""
    seed: strict.Integer = Field(default=0, ge=0, le=2**63 - 1)
    """Seed of all random numbers: the same seed gives the same plan. Give a whole number, 0 or
    more, below 2^63."""
    order: Literal["fuel", "length", "depth-first"] = "fuel"
    """Which classes are planned: the cheapest, the shortest, or the first ones of a depth-first
    search as in the paper. Give 'fuel', 'length' or 'depth-first'."""
    risk_at: Literal["route", "point"] = "route"
    """Where adaptive padding meets the risk: on the way through each triangle, as in the paper, or
    from every point of the route as well. Give 'route' or 'point'."""
    lateness: strict.Number = Field(default=0.05, ge=0, lt=1)
    """Share of the time since departure by which the vessel may be early or late in currents that
    change: its turns are simulated then, too. Give a share from 0 to below 1, such as 0.05."""
    gap_to: strict.Number = Field(default=0.0, ge=0, lt=1)
    """Optimality gap of the best route at which the lower bound on fuel is tight enough: until then
    its grid is refined. With 0 it is as tight as about half a second of work makes it. Give a
    share from 0 to below 1, such as 0.02."""
    shortfall: Literal["refuse", "least"] = "refuse"
    """What to do where no way keeps the padding, as in a harbour: refuse the voyage, or keep as
    much of adaptive padding as there is room for, and list each stretch without room for a
    hard-over turn.
    Renew go gives 'least'. Give 'refuse' or 'least'."""
    adrift: Interval | None = Field(default=None, examples=["6h"])
    """Least time that the current takes to carry a vessel without thrust to land, from anywhere on
    a route but near its two ends, in currents that do not change on the way. Classes that can't
    keep it are rejected. Give '30min', '6h' or '1d', or leave it out."""
    adrift_ends: strict.NonNegative = Field(
        default=20_000.0, json_schema_extra=strict.unit("planar m")
    )
    """Distance from start and goal, planar metres, within which 'adrift' must be kept from
    somewhere on; else the voyage is refused. Give metres, 0 or more."""


class OutputOptions(StrictModel):
    """Options of the output files."""

    rtz_version: Literal["1.0", "1.1", "1.2"] = "1.1"
    """Version of the RTZ files (IEC 61174). Give '1.0', '1.1' or '1.2', whichever the chart plotter
    reads."""
    explain_gap: bool = False
    """Whether to tell what the optimality gap is made of: the chart's share, the padding's, the
    bound's own. It may take as long as planning. Give true or false."""


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

    schema_version: Literal[1] = Field(examples=[1])
    """Version of this format. Write schema_version = 1."""
    name: strict.Name = Field(examples=["my-strait"])
    """Name of the scenario, and of its folder of results. Use up to 64 lower-case letters, digits,
    '-' and '_'."""
    title: str = Field(default="", examples=["Through my strait"])
    """Title of the report. Give any text."""
    description: str = Field(default="", examples=["North or south of the island?"])
    """What the scenario is about, printed in the report. Give any text."""
    region: Region | None = None
    """The region of a chart scenario; by default one that has the ways round the islands between
    start and goal. Add a [region] table, or leave it out."""
    plane: Plane | None = None
    """The area of a plane scenario. Add a [plane] table, or leave it out."""
    chart: ChartSpec = ChartSpec()
    """The land of a chart scenario. Add a [chart] table, or leave it out."""
    vessel: Annotated[
        VesselSpec, BeforeValidator(_known_vessel, json_schema_input_type=str | VesselSpec)
    ] = Field(examples=["usv-7m"])
    """The vessel. Give a name of the catalogue (`renew list`), or a [vessel] table."""
    # Below this limit memory grows as 1 / scale, as routes get longer in vessel lengths.
    scale: strict.Number = Field(
        default=1.0, ge=0.1, le=1e6, json_schema_extra=strict.unit("true m per planar m")
    )
    """True metres per planar metre: routes are planned in a plane shrunk by this, with speeds
    unchanged. Give true metres to a planar metre: 1 is the true scale."""
    start: strict.Point = Field(
        examples=[[120.3, 12.8]], json_schema_extra=strict.unit("degrees, or m in a plane")
    )
    """Where the routes start, in water. Give [lon, lat] in degrees, or [x, y] in metres in a plane.
    """
    goal: strict.Point = Field(
        examples=[[116.8, 7.7]], json_schema_extra=strict.unit("degrees, or m in a plane")
    )
    """Where the routes end, in water. Give [lon, lat] in degrees, or [x, y] in metres in a plane.
    """
    via: tuple[Via, ...] = Field(
        default=(),
        max_length=100,
        examples=[[[119.2, 11.9]]],
        json_schema_extra=strict.unit("degrees, or m in a plane"),
    )
    """Points that the routes pass in this order, in water and outside the padding. One of them may
    be an anchorage, { at = [119.2, 11.9], wait = '6h' }. Give a list of [lon, lat] in degrees, or
    of [x, y] in metres in a plane, or leave it out."""
    avoid: tuple[AvoidedArea, ...] = Field(default=(), max_length=1000)
    """Areas that are shut, always or for some hours: the vessel and its turns stay out of them
    then, even if it is early or late. Add an [[avoid]] table for each."""
    tide: TideSpec | None = None
    """The tide over charted depths: water that is too shallow for some hours is then passed in the
    others. Add a [tide] table, or leave it out."""
    limits: LimitsSpec | None = None
    """Wind and waves in which the vessel does not go: water is shut while they exceed a limit. Add
    a [limits] table, or leave it out."""
    havens: HavensSpec | None = None
    """Havens: from where along the best route one of them is reached in time. Add a [havens] table,
    or leave it out."""
    seasons: tuple[Season, ...] = Field(min_length=1, max_length=MAX_SEASONS)
    """The currents to plan in, each by itself. Add a [[seasons]] table for each."""
    under_way: UnderWay | None = None
    """The earlier plan that the vessel sails: it is at 'start' at the season's departure, and the
    rest of the voyage is planned again. Add an [under_way] table, or leave it out."""
    planner: PlannerOptions = PlannerOptions()
    """Options of the planner. Add a [planner] table, or leave it out."""
    outputs: OutputOptions = OutputOptions()
    """Options of the output files. Add an [outputs] table, or leave it out."""
    published: Published | None = None
    """Published figures to compare with. Add a [published] table, or leave it out."""

    def explaining_gap(self) -> Self:
        """Return the scenario with the option set that explains optimality gaps."""
        outputs = self.outputs.model_copy(update={"explain_gap": True})
        return self.model_copy(update={"outputs": outputs})

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
