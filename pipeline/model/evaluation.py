"""Measurements of the routes."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from itertools import groupby
from typing import Literal

import renew
from pipeline.model.inputs import no_go_name

Side = Literal["north", "east", "south", "west", "between"]

RouteKey = tuple[str, int]
"""A route of a scenario: (season, rank); rank 1 is the route to take."""


@dataclass(frozen=True, slots=True)
class Passage:
    """How a route passes islands, given by names or numbers: on one side of all, or between two."""

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
    fuel, fuel_per_distance, length : in the planner's units, at the scenario's scale.
    length_m : geodesic length, true metres.
    clearance_m : least distance to the original land, true metres; inf where there is none.
    duration_s : seconds at true scale.
    speed_m_s : mean speed through water, over time.
    trials, collisions : simulated hard-over turns, and how many touch the original land.
    land_m : metres of the route over original land.
    passages : how it passes the islands that distinguish it from the season's other routes: the
        main island first, then the others in their order on the way.
    land_lon, land_lat : the middle of its longest part over land, degrees; NaN without.
    filled_share : share of its length in cells where the current's source has no figure.
    uncharted_share : share of its length where no depth is charted; NaN in a chart without depths.
    least_water_m, least_water_at : least water under the keel that can be relied on with the tide,
        m, and when it passes there; NaN and None without a tide.
    least_water_early_m, least_water_late_m : least water of a vessel that is early or late, m.
    members_share : share of the members of the current in which it is the season's best.
    members_mean_fuel, members_p90_fuel, members_cvar90_fuel, members_regret : mean, P90, mean of
        the worst tenth, and largest excess over a member's best route, of its fuel over the
        members; NaN without members, and where it can't be sailed in too many of them.
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
    speed_m_s: float
    optimality_gap: float
    trials: int
    collisions: int
    land_m: float
    passages: tuple[Passage, ...] = ()
    land_lon: float = math.nan
    land_lat: float = math.nan
    filled_share: float = 0.0
    uncharted_share: float = math.nan
    least_water_m: float = math.nan
    least_water_at: datetime | None = None
    least_water_early_m: float = math.nan
    least_water_late_m: float = math.nan
    members_share: float = math.nan
    members_mean_fuel: float = math.nan
    members_p90_fuel: float = math.nan
    members_cvar90_fuel: float = math.nan
    members_regret: float = math.nan

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
    def main_island(self) -> str:
        """The main island, or both islands of the strait; empty without islands."""
        return ", ".join(self.passages[0].islands) if self.passages else ""

    @property
    def main_side(self) -> str:
        """The side on which it passes the main island: "west"; with the names of a strait."""
        if not self.passages:
            return ""
        main = self.passages[0]
        return main.text if main.side == "between" else main.side

    @property
    def no_go_name(self) -> str:
        """Readers' word for the areas it avoids: only charts with depths have uncharted shares."""
        return no_go_name(has_depths=not math.isnan(self.uncharted_share))

    @property
    def has_land(self) -> bool:
        """Whether the chart has any land."""
        return math.isfinite(self.clearance_m)


@dataclass(frozen=True, slots=True)
class NumberedIsland:
    """An island that distinguishes ways: its number in homotopy classes, and a point on it.

    `name` is the chart's, or empty. The point is in planar metres; `place` gives it as text, as the
    scenario gives positions.
    """

    number: int
    name: str
    x: float
    y: float
    place: str

    @property
    def label(self) -> str:
        """Its name for readers, or else its number."""
        return self.name or str(self.number)


@dataclass(frozen=True, slots=True)
class GapShares:
    """The parts of the optimality gap of a season's best route, as shares of the bound on fuel.

    `chart` is the fuel that simplification, margin and offing cost, and `padding` the fuel that the
    room for hard-over turns costs. `tide` is the fuel that a tide costs by shutting water for some
    hours. `bound` is the fuel of the best route on the original land, with all tidal water open,
    less the bound.
    """

    season: str
    chart: float
    padding: float
    bound: float
    tide: float = 0.0


@dataclass(frozen=True, slots=True)
class ClockWorth:
    """The fuel that a season's best route saves by knowing how the current changes.

    Figures are fuel in the planner's units. `best` is the best route's; no route needs less than
    `bound`. The others are of plans made without that knowledge and sailed in the changing current:
    `frozen` was planned in the current at departure, `mean` in its mean over the best route's
    voyage, `shortest` in no current at all; inf where there is no plan, or it can't be sailed.
    Where speeds are chosen, all are sailed so that they arrive `in_time`.
    """

    season: str
    best: float
    frozen: float
    mean: float
    shortest: float
    bound: float
    in_time: bool = False


@dataclass(frozen=True, slots=True)
class SideBound:
    """A lower bound on the fuel of ways on the other side of a season's main island.

    The best route passes between the island and an edge of the chart. The bound, in the planner's
    units, holds for every way that does not cross the water between these two.
    """

    season: str
    fuel: float


@dataclass(frozen=True, slots=True)
class ShoreCrossing:
    """Where a route crosses land of the second shoreline: its middle (degrees), true metres.

    `inland_m` is how far from that shore it gets, where a plan may be refused for it.
    """

    season: str
    rank: int
    lon: float
    lat: float
    length_m: float
    inland_m: float = 0.0


@dataclass(frozen=True, slots=True)
class ShutStrait:
    """A strait of the original land that no route takes, as margin or padding shuts it.

    Attributes
    ----------
    lon, lat : the middle of its narrowest place, degrees.
    width_m : its width there, between the original coasts, true metres.
    needed_m : the width above which it would be open.
    by : the cause, margin or padding.
    seasons : the seasons in which it is shut; all if that does not depend on the current.
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

    All turns are counted; of the places where no turn touches land, about a thousand per route are
    stored. `shore_crossings` are of all routes. `islands` are the islands in the names of ways, the
    main island first; `class_islands` are other islands in the names of homotopy classes.
    `gap_shares` are of seasons for which they were asked, `clock_worths` of seasons whose currents
    change.
    """

    routes: tuple[RouteMetrics, ...]
    contingency: Mapping[RouteKey, renew.Contingency]
    shore_crossings: tuple[ShoreCrossing, ...] = ()
    islands: tuple[NumberedIsland, ...] = ()
    gap_shares: tuple[GapShares, ...] = ()
    clock_worths: tuple[ClockWorth, ...] = ()
    class_islands: tuple[NumberedIsland, ...] = ()

    def clock_worth_of(self, season: str) -> ClockWorth | None:
        """Return the worth of the clock in a season, if its current changes."""
        return next((worth for worth in self.clock_worths if worth.season == season), None)

    def gap_shares_of(self, season: str) -> GapShares | None:
        """Return the parts of a season's gap, if they were asked for."""
        return next((shares for shares in self.gap_shares if shares.season == season), None)
