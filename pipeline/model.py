"""The frozen dataclasses that stages take and return: nothing else passes between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING, Literal

import numpy as np

from pipeline.geo.known_cells import KnownCells

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from datetime import datetime

    import numpy.typing as npt
    from shapely.geometry import Polygon
    from shapely.geometry.base import BaseGeometry

    import renew
    from pipeline.geo.known_cells import DepthCover
    from pipeline.geo.projection import Projection

    FloatArray = npt.NDArray[np.float64]
    Current = renew.GriddedCurrent | renew.GyreCurrent | renew.UniformCurrent | renew.VaryingCurrent

Side = Literal["north", "east", "south", "west", "between"]

RouteKey = tuple[str, int]
"""A route of a scenario: (season, rank); rank 1 is the route to take."""


@dataclass(frozen=True, slots=True)
class Credit:
    """A source that was used, and the credit line that its licence requires."""

    name: str
    kind: Literal["land", "current"]
    text: str
    licence: str
    url: str = ""
    retrieved: str = ""


@dataclass(frozen=True, slots=True)
class Zone:
    """An area of a chart to be shown on maps (lon/lat degrees).

    A `shoal` is too shallow for the vessel, an `uncharted` area is covered by no source: both are
    no-go, and so also among the polygons of their Land. A `restricted` area and a `traffic` scheme
    may be entered; `rule` is what the chart prescribes there for a passing vessel, if anything.
    """

    kind: Literal["shoal", "uncharted", "restricted", "traffic"]
    name: str
    rule: str
    area: BaseGeometry


@dataclass(frozen=True, slots=True)
class PlaceName:
    """A chart's name for some land: a point on it (degrees), and how large it is (square degrees).

    Areas are compared with each other only.
    """

    name: str
    lon: float
    lat: float
    area_deg2: float


@dataclass(frozen=True, slots=True)
class Land:
    """All that no route may enter (lon/lat degrees), in the region and a little beyond.

    Land; from charts with depths, also shallow water, hazards and uncharted areas. `accuracy_m` is
    how far the source's coast may lie from the true one, in metres. `credits` has one entry per
    source, `notes` is what a reader should know about the chart, `zones` are areas to be shown.
    `second_shore` is the land of an independent shoreline, where there is one: no route need avoid
    it, but a route that crosses it does so where the two disagree. `places` are the chart's names
    of land, where it has any. `depths` says where the chart has depths; None where it has none at
    all.
    """

    polygons: tuple[Polygon, ...]
    credits: tuple[Credit, ...]
    accuracy_m: float
    notes: tuple[str, ...] = ()
    zones: tuple[Zone, ...] = ()
    second_shore: tuple[Polygon, ...] = ()
    places: tuple[PlaceName, ...] = ()
    depths: DepthCover | None = None


@dataclass(frozen=True, slots=True)
class PassedOver:
    """A source of currents that was preferred but could not be used, and why, in one line."""

    source: str
    reason: str


@dataclass(frozen=True, slots=True)
class CurrentGrid:
    """A season's surface current on a lon/lat grid, at one or several times.

    Attributes
    ----------
    lon, lat : (nx,) and (ny,), ascending, degrees.
    u, v : (nt, ny, nx), m/s to east and to north; NaN where the source has no water, which is the
        same at all times.
    times_s : (nt,), ascending, seconds since the season's departure; of a steady current one.
    valid : the time that the field is valid for, as the source names it.
    notes : what a reader should know about the field.
    files : names and hashes of the files it came from.
    climatology_for : the season's own time where the field is a climatology in its place, or "".
    passed_over : the sources that the scenario prefers to this one, in its order.
    """

    season: str
    lon: FloatArray
    lat: FloatArray
    u: FloatArray
    v: FloatArray
    valid: str
    credit: Credit
    notes: tuple[str, ...] = ()
    files: tuple[tuple[str, str], ...] = ()
    climatology_for: str = ""
    passed_over: tuple[PassedOver, ...] = ()
    times_s: FloatArray = field(default_factory=lambda: np.zeros(1))

    @property
    def cells(self) -> KnownCells:
        """Which of its cells have a figure."""
        return KnownCells(self.lon, self.lat, np.isfinite(self.u[0]) & np.isfinite(self.v[0]))

    @property
    def changes(self) -> bool:
        """Whether it changes during the voyage."""
        return len(self.times_s) > 1

    @property
    def at_departure(self) -> tuple[FloatArray, FloatArray]:
        """The components (ny, nx) at departure, linear between the times around it."""
        if not self.changes:
            return self.u[0], self.v[0]
        after = int(np.clip(np.searchsorted(self.times_s, 0.0), 1, len(self.times_s) - 1))
        begin, end = self.times_s[after - 1 : after + 1]
        share = float(np.clip(-begin / (end - begin), 0.0, 1.0))
        u, v = ((1 - share) * part[after - 1] + share * part[after] for part in (self.u, self.v))
        return u, v

    @property
    def is_stand_in(self) -> bool:
        """Whether this is not the current that the scenario asks for first."""
        return bool(self.passed_over or self.climatology_for)

    @property
    def stand_in_notes(self) -> tuple[str, ...]:
        """What the season was planned on in place of its first choice; empty where it is that."""
        if self.climatology_for:
            used = f"planned on {self.credit.name}: {self.valid} stands for {self.climatology_for}"
        else:
            used = f"planned on {self.credit.name}, valid {self.valid}"
        return (used,) if self.is_stand_in else ()


@dataclass(frozen=True, slots=True)
class Fetched:
    """Data from the sources: land, and one current grid per season.

    `currents` is empty for a plane scenario, which gives its current as numbers. `notes` says in
    plain words which preferred sources were passed over and why, and what to know about the others.
    """

    land: Land
    currents: tuple[CurrentGrid, ...]
    notes: tuple[str, ...] = ()

    @property
    def stand_in_notes(self) -> tuple[str, ...]:
        """Those of the notes that only name what was used in place of a first choice."""
        used = {grid.season: grid.stand_in_notes for grid in self.currents}
        return tuple(season_notes(used))


def current_notes(currents: Iterable[CurrentGrid]) -> tuple[str, ...]:
    """Notes on the currents of all seasons, and on the sources passed over for them."""
    return tuple(
        season_notes(
            {
                grid.season: (
                    *grid.notes,
                    *(passed.reason for passed in grid.passed_over),
                    *grid.stand_in_notes,
                )
                for grid in currents
            }
        )
    )


def season_notes(notes: Mapping[str, Iterable[str]]) -> Iterator[str]:
    """Spell notes by season as "summer, winter: note", each text once."""
    seasons: dict[str, list[str]] = {}
    for season, texts in notes.items():
        for text in dict.fromkeys(texts):
            seasons.setdefault(text, []).append(season)
    return (f"{', '.join(names)}: {text}" for text, names in seasons.items())


@dataclass(frozen=True, slots=True)
class Simplified:
    """The hard no-go zone of the planner (lon/lat degrees), which covers all of the land.

    `inner_polygons` lie inside the land: what a route that stays off the land must stay off at
    least.
    """

    polygons: tuple[Polygon, ...]
    inner_polygons: tuple[Polygon, ...]
    original_vertices: int
    vertices: int
    tolerance_m: float
    margin_m: float


@dataclass(frozen=True, slots=True)
class Scene:
    """The planner's input: planar metres divided by the scenario's scale, speeds unscaled.

    `land` is the original, unsimplified land; `second_shore` and `depths` are as in Land;
    `currents` is keyed by season, and so is `current_cells`, where its source has figures; `start`
    and `goal` have shape (2,). A scene `is_planar` where it was given in metres, and not on a
    chart. `departures` are those of the seasons whose currents change: on the clock of these
    currents, in seconds, they are 0.
    """

    chart: renew.Chart
    land: tuple[Polygon, ...]
    currents: Mapping[str, Current]
    start: FloatArray
    goal: FloatArray
    projection: Projection
    vessel: renew.Vessel
    is_planar: bool = False
    second_shore: tuple[Polygon, ...] = ()
    depths: DepthCover | None = None
    current_cells: Mapping[str, KnownCells] = field(default_factory=dict)
    departures: Mapping[str, datetime] = field(default_factory=dict)

    def place_text(self, place: FloatArray) -> str:
        """Name a place (2,), planar metres, for a message: as a scenario would give it."""
        if self.is_planar:
            return f"({place[0]:.6g}, {place[1]:.6g}) m"
        lon, lat = self.projection.to_lonlat(place)
        return f"{lon:.4f} E {lat:.4f} N"


@dataclass(frozen=True, slots=True)
class SeasonPlan:
    """One season's plan; `failure` is empty when it was planned, else the reason in one line.

    It `is_shut` where the reason is that no way joins start and goal in the region.
    """

    season: str
    plan: renew.Plan | None
    failure: str
    seconds: float
    is_shut: bool = False

    @property
    def ranked_routes(self) -> tuple[renew.Route, ...]:
        """Routes by rank: the one to take, then the others by fuel; empty if not planned.

        This differs from the order of `plan.routes`, which is by fuel, where the sampled method
        chooses another route than that of least fuel.
        """
        if self.plan is None:
            return ()
        others = (route for i, route in enumerate(self.plan.routes) if i != self.plan.chosen)
        return (self.plan.best, *others)


@dataclass(frozen=True, slots=True)
class Passage:
    """How a route passes islands, which are given by names or numbers: on a side of all of them.

    Or between two.
    """

    side: Side
    islands: tuple[str, ...]

    @property
    def text(self) -> str:
        """For readers: "west of island 1", "east of Cebu", "between islands 2 and 5"."""
        numbered = all(island.isdigit() for island in self.islands)
        names = [f"island {name}" if name.isdigit() else name for name in self.islands]
        *first, last = self.islands if numbered and len(names) > 1 else names
        together = f"{', '.join(first)} and {last}" if first else last
        if numbered and first:
            together = f"islands {together}"
        return f"between {together}" if self.side == "between" else f"{self.side} of {together}"


def _alike(passages: Iterable[Passage]) -> Iterator[tuple[Side, list[Passage]]]:
    """Group neighbours on the same side of their islands; a strait stays by itself."""
    for (side, _), alike in groupby(
        enumerate(passages), key=lambda item: (item[1].side, item[1].side == "between" and item[0])
    ):
        yield side, [passage for _, passage in alike]


@dataclass(frozen=True, slots=True)
class RouteMetrics:
    """One route's figures, measured against the original land.

    Attributes
    ----------
    fuel, fuel_per_distance, length : the planner's own, scaled.
    length_m : geodesic length, true metres.
    clearance_m : least distance to the original land, true metres; inf where there is none.
    duration_s : seconds at true scale.
    trials, collisions : simulated hard-over turns, and those that touch the original land.
    land_m : metres of the route over original land.
    passages : what tells it from the season's other routes; how it passes the main island first,
        and then the others in their order on the way.
    land_lon, land_lat : the middle of its longest part over land, degrees; NaN without.
    filled_share : share of its length in cells where the current's source has no figure.
    uncharted_share : share of its length where no depth is charted; NaN in a chart without depths.
    """

    season: str
    rank: int
    homotopy: str
    fuel: float
    fuel_per_distance: float
    length: float
    length_m: float
    clearance_m: float
    duration_s: float
    optimality_gap: float
    trials: int
    collisions: int
    land_m: float
    passages: tuple[Passage, ...] = ()
    land_lon: float = math.nan
    land_lat: float = math.nan
    filled_share: float = 0.0
    uncharted_share: float = math.nan

    @property
    def way(self) -> str:
        """The way round, for readers: "west of islands 1 and 4, between 2 and Cebu"; or empty."""
        return ", ".join(
            Passage(side, tuple(name for one in alike for name in one.islands)).text
            for side, alike in _alike(self.passages)
        )

    @property
    def main_passage(self) -> str:
        """How it passes the main island; empty without islands."""
        return self.passages[0].text if self.passages else ""

    @property
    def has_land(self) -> bool:
        """Whether there is land at all, to keep clear of and to turn away from."""
        return math.isfinite(self.clearance_m)


@dataclass(frozen=True, slots=True)
class NumberedIsland:
    """An island that tells ways apart: its number in homotopy classes, and a point on it.

    `name` is the chart's, or empty. The point is in planar metres.
    """

    number: int
    name: str
    x: float
    y: float

    @property
    def label(self) -> str:
        """What readers call it: its name, or else its number."""
        return self.name or str(self.number)


@dataclass(frozen=True, slots=True)
class GapShares:
    """The parts of the optimality gap of a season's best route, as shares of the bound on fuel.

    `chart` is what simplification, margin and offing cost, `padding` what room for hard-over turns
    costs, `bound` how far even the best route off the land itself is above the bound.
    """

    season: str
    chart: float
    padding: float
    bound: float


@dataclass(frozen=True, slots=True)
class ClockWorth:
    """What a season's best route saves by knowing how the current changes.

    Fuel, in the planner's units, of other plans when they are sailed in the changing current:
    `frozen` on the current at departure, `mean` on its mean over the best route's voyage,
    `shortest` on no current at all; inf where a plan can't be sailed, or none was found. `best` is
    the best route's own, and no route stays below `bound`.
    """

    season: str
    best: float
    frozen: float
    mean: float
    shortest: float
    bound: float


@dataclass(frozen=True, slots=True)
class ShoreCrossing:
    """Where a route crosses land of the second shoreline: its middle (degrees), true metres."""

    season: str
    rank: int
    lon: float
    lat: float
    length_m: float


@dataclass(frozen=True, slots=True)
class ShutStrait:
    """A strait of the original land that no route takes, as margin or padding shuts it.

    Attributes
    ----------
    lon, lat : the middle of its narrowest place, degrees.
    width_m : its width there, between the original coasts, true metres.
    needed_m : the width from which on it would be open.
    by : what shuts it.
    seasons : those in which it is so; all where it does not depend on the current.
    """

    lon: float
    lat: float
    width_m: float
    needed_m: float
    by: Literal["margin", "padding"]
    seasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Every planned route's figures, and its hard-over turns by (season, rank).

    All turns are counted; of the places where none touches land, about a thousand per route are
    stored. `shore_crossings` are those of all routes, `islands` those that name their ways,
    `gap_shares` those of the seasons for which they were asked, `clock_worths` those of the seasons
    whose currents change.
    """

    routes: tuple[RouteMetrics, ...]
    contingency: Mapping[RouteKey, renew.Contingency]
    shore_crossings: tuple[ShoreCrossing, ...] = ()
    islands: tuple[NumberedIsland, ...] = ()
    gap_shares: tuple[GapShares, ...] = ()
    clock_worths: tuple[ClockWorth, ...] = ()

    def clock_worth_of(self, season: str) -> ClockWorth | None:
        """What the clock is worth in a season, if its current changes."""
        return next((worth for worth in self.clock_worths if worth.season == season), None)

    def gap_shares_of(self, season: str) -> GapShares | None:
        """The parts of a season's gap, if they were asked for."""
        return next((shares for shares in self.gap_shares if shares.season == season), None)
