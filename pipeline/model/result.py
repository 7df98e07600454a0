"""What planning a case gives: its plan, and the figures of the routes on the original land."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import groupby
from typing import Literal

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.model.case import Energy
from pipeline.model.inputs import no_go_name
from pipeline.scenario.season import Season
from renew.errors import Text
from renew.vary.ensemble import FEWEST, Statistic, statistic

Side = Literal["north", "east", "south", "west", "between"]

RouteKey = tuple[str, int]
"""A route of a scenario: (case, rank); rank 1 is the route to take."""


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
    """One route's figures, measured against the original land, as `columns.toml` describes them.

    What a table leaves empty is None or NaN; infinite are the clearance where there is no land, and
    the time adrift where none is reached within 72 h. `still_fuel` is the fuel of the same way in
    still water; where speeds are chosen, at its mean speed. `energy` is what a unit of fuel is;
    None where the vessel's power is not known. `passages` say how it passes the islands that
    distinguish it from the case's other routes: the main island first, then the others in their
    order on the way.
    """

    rank: int
    homotopy: str
    fuel: float
    fuel_per_distance: float
    length: float
    length_m: float
    clearance_m: float
    duration_s: float
    speed_m_s: float
    optimality_gap: float = math.nan
    trials: int = 0
    collisions: int = 0
    land_m: float = 0.0
    passages: tuple[Passage, ...] = ()
    land_lon: float = math.nan
    land_lat: float = math.nan
    filled_share: float = 0.0
    uncharted_share: float = math.nan
    adrift_s: float = math.nan
    adrift_lon: float = math.nan
    adrift_lat: float = math.nan
    adrift_share: float = math.nan
    ashore_share: float = math.nan
    least_water_m: float = math.nan
    least_water_at: datetime | None = None
    least_water_early_m: float = math.nan
    least_water_late_m: float = math.nan
    worst_wave_m: float = math.nan
    worst_wave_at: datetime | None = None
    worst_wave_lon: float = math.nan
    worst_wave_lat: float = math.nan
    wave_headroom_m: float = math.nan
    worst_wind_m_s: float = math.nan
    worst_wind_at: datetime | None = None
    worst_wind_lon: float = math.nan
    worst_wind_lat: float = math.nan
    wind_headroom_m_s: float = math.nan
    members_share: float = math.nan
    members_mean_fuel: float = math.nan
    members_p90_fuel: float = math.nan
    members_cvar90_fuel: float = math.nan
    members_regret: float = math.nan
    members_adrift_share: float = math.nan
    members_over_limit_share: float = math.nan
    still_fuel: float = math.nan
    energy: Energy | None = None

    @property
    def fuel_unit(self) -> tuple[float, str]:
        """A unit of fuel in the unit for readers, and that unit's name."""
        if self.energy is not None:
            return self.energy.units, self.energy.unit
        return 100 / self.still_fuel, "% of still water"

    @property
    def energy_wh(self) -> float:
        """Energy of its fuel, Wh; NaN where the vessel's power is not known."""
        return math.nan if self.energy is None else self.fuel * self.energy.wh

    @property
    def left(self) -> float:
        """Fuel left at the goal, over the reserve, planner's units; NaN where it is not known."""
        return math.nan if self.energy is None else self.energy.on_board - self.fuel

    @property
    def left_wh(self) -> float:
        """The same as energy, Wh."""
        return math.nan if self.energy is None else self.left * self.energy.wh

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
class ShoreCrossing:
    """Where a route crosses land of the second shoreline: its middle (degrees), true metres.

    `inland_m` is how far from that shore it gets, where a plan may be refused for it.
    """

    rank: int
    lon: float
    lat: float
    length_m: float
    inland_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class NarrowStretch:
    """A stretch of a route without room for a hard-over turn at its speed.

    Attributes
    ----------
    rank : the route's.
    line : (n, 2) planar metres, from its begin to its end.
    place : (2,) planar metres, its tightest place.
    begin_m, length_m : where it begins along the route, and how long it is, true metres.
    width_m : the width of the water at that place, true metres; inf where it is wide, beside
        an islet.
    needed_m : the room to a side that a turn needs, in still water the turning circle.
    kept_m : the largest turning circle that fits, in steps of 5 %; 0 if hardly any does.
    side : the side to which a turn meets land.
    """

    rank: int
    line: FloatArray
    place: FloatArray
    begin_m: float
    length_m: float
    width_m: float
    needed_m: float
    kept_m: float
    side: Literal["port", "starboard", "either side"]


@dataclass(frozen=True, slots=True)
class ShutStrait:
    """A strait of the original land that no route takes, as margin or padding shuts it.

    Attributes
    ----------
    lon, lat : the middle of its narrowest place, degrees.
    width_m : its width there, between the original coasts, true metres.
    needed_m : the width from which it would be open. That is the planner's figure for this strait
        if it has one, else that of hard-over turns in still water, or of a clearance if wider.
    padding_m : what of this is for turns or clearance, on both sides; the rest is for the chart's
        margin and tolerance.
    by : the cause, margin or padding.
    seasons : the seasons in which it is shut; all if that does not depend on the current.
    saves : the share of its time that the best way round shut straits is longer than the quickest
        way through this one, both without padding; 0 where none is quicker.
    way : the number of that way, from 1 on; 0 where none is quicker. The straits that share a
        number lie on one way: all of them would have to be passed.
    beside : the names of the land on its shores, as far as known.
    """

    lon: float
    lat: float
    width_m: float
    needed_m: float
    padding_m: float
    by: Literal["margin", "padding"]
    seasons: tuple[str, ...] = ()
    saves: float = 0.0
    way: int = 0
    beside: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class EnsembleFigures:
    """How a case's routes, by rank, do in the members of its current.

    Attributes
    ----------
    names, weights : (m,) the members, and how likely each is; the weights' sum is 1.
    fuels : (k, m) planner's units, of each route in each member; inf where it can't be sailed.
    best_in : (m,) rank of the route that is best in each member; 0 where none can be sailed.
    choose : the statistic by which the side was chosen.
    close : ranks of the routes that are not surely dearer, the first one's among them.
    shut : rank, member and reason of routes that can't be sailed in a member.
    bounds : of each statistic, the least that it can be for any one route.
    waiting_saves : mean fuel that is saved if the member is known before the side is chosen.
    """

    names: tuple[str, ...]
    weights: FloatArray
    fuels: FloatArray
    best_in: tuple[int, ...]
    choose: Statistic
    close: tuple[int, ...]
    shut: tuple[tuple[int, str, str], ...]
    bounds: Mapping[Statistic, float]
    waiting_saves: float

    @classmethod
    def of(cls, found: renew.EnsemblePlan, spelled: Callable[[Text], str]) -> "EnsembleFigures":
        """Return the figures of a plan, its reasons `spelled`; bounds take 0.5 s a member."""
        order = [found.plan.chosen]
        order += [at for at in range(len(found.routes)) if at != found.plan.chosen]
        rank = {at: number for number, at in enumerate(order, start=1)}
        by_name = {found.routes[at].homotopy: number for at, number in rank.items()}
        return cls(
            names=found.members.names,
            weights=found.members.weights,
            fuels=found.fuels[order],
            best_in=tuple(rank.get(at, 0) for at in found.best_in),
            choose=found.choose,
            close=tuple(sorted(rank[at] for at in found.close)),
            shut=tuple(
                (by_name[one.homotopy], one.member, spelled(one.cause.text)) for one in found.shut
            ),
            bounds={name: found.bound.of(name) for name in ("mean", "p90", "cvar90")},
            waiting_saves=found.waiting_saves,
        )

    @property
    def has_quantiles(self) -> bool:
        """Whether there are members enough for P90 and CVaR."""
        return len(self.names) >= FEWEST

    def share(self, rank: int) -> float:
        """Share of the members, by weight, in which a route is the best."""
        return float(self.weights[np.array(self.best_in) == rank].sum())

    def statistic(self, name: Statistic, rank: int) -> float:
        """Return a statistic of a route's fuel over the members, planner's units."""
        return float(statistic(name, self.fuels, self.weights)[rank - 1])

    def gap(self, name: Statistic) -> float:
        """Share by which the first route's statistic is above that of any one route, at most."""
        return max(0.0, self.statistic(name, 1) / self.bounds[name] - 1)


@dataclass(frozen=True, slots=True)
class ReplanFigures:
    """What `renew.replan` answered; fuel in the planner's units, distances in true metres.

    `kept_fuel` is the fuel ahead on the way that was planned, NaN if that can't be sailed, with the
    reason in `kept_reason`. The other fields are those of `renew.Replanned`.
    """

    answer: Literal["kept", "switched"]
    fuel: float
    kept_fuel: float
    kept_reason: str
    off_m: float
    moved_m: float
    late_s: float
    planned_fuel: float
    burnt: float
    by_drift: float
    by_forecast: float
    saved: float
    has_new_current: bool
    energy: Energy | None = None

    @property
    def fuel_unit(self) -> tuple[float, str]:
        """A unit of fuel in the unit for readers, and that unit's name."""
        if self.energy is not None:
            return self.energy.units, self.energy.unit
        return 100 / self.planned_fuel, "% of the plan's fuel"


@dataclass(frozen=True, slots=True, eq=False)
class DepartureChoice:
    """A season's departure, and the departures that it was chosen from.

    Attributes
    ----------
    first : the beginning of the clock, UTC.
    departures_s : (n,) the departures, ascending, in seconds after `first`.
    fuels, durations_s : (n,) fuel (planner's units) and time under way (seconds) of each
        departure's best route; inf where a departure has no route.
    homotopies, reasons : (n,) the class of each departure's best route, and the reason why a
        departure has no route. The one that does not apply is empty.
    chosen_s : the chosen departure, in seconds after `first`.
    unproven_s : the most time under way (seconds) that another departure in the window may still
        save, apart from the error of the paths; inf if no limit is known.
    arrive_by : the latest arrival at the goal, if the departure was chosen to keep it.
    asked : the season as the scenario states it, with its departure left open.
    has_speeds : whether speeds were chosen as well. Then each departure has speeds of its own, at
        which the vessel arrives in time.
    """

    season: str
    first: datetime
    departures_s: FloatArray
    fuels: FloatArray
    durations_s: FloatArray
    homotopies: tuple[str, ...]
    reasons: tuple[str, ...]
    chosen_s: float
    unproven_s: float = math.inf
    arrive_by: datetime | None = None
    asked: Season | None = None
    has_speeds: bool = False

    @property
    def chosen(self) -> datetime:
        """The departure that is taken, UTC, to the second."""
        return self.first + timedelta(seconds=round(self.chosen_s))

    @property
    def least_s(self) -> float:
        """Time under way of the departure that is taken, s."""
        return float(self.durations_s[np.abs(self.departures_s - self.chosen_s).argmin()])

    def good_window(self, share: float) -> tuple[float, float]:
        """Return the first and last departure around the chosen one, s, that need little more fuel.

        All departures planned between them need at most a share more than the least.
        """
        is_good = self.fuels <= self.fuels.min() * (1 + share)
        at = int(np.abs(self.departures_s - self.chosen_s).argmin())
        bad = np.flatnonzero(~is_good)
        begin = bad[bad < at].max(initial=-1) + 1
        end = bad[bad > at].min(initial=len(is_good)) - 1
        return float(self.departures_s[begin]), float(self.departures_s[end])


@dataclass(frozen=True, slots=True)
class Measures:
    """The figures of a case's routes, by rank, and their hard-over turns.

    All turns are counted; of the places where no turn touches land, about a thousand per route are
    stored. `adrift` is how long each route is from land without thrust; empty in a plane.
    `narrow` are the stretches without room for a turn, by rank and along each route. `near_best` is
    the water (planar m) outside which every route needs over 1 % more fuel than the best; None
    where it is not known.
    """

    routes: tuple[RouteMetrics, ...] = ()
    turns: tuple[renew.Contingency, ...] = ()
    shore_crossings: tuple[ShoreCrossing, ...] = ()
    adrift: tuple[renew.Adrift, ...] = ()
    narrow: tuple[NarrowStretch, ...] = ()
    near_best: shapely.Geometry | None = None


@dataclass(frozen=True, slots=True)
class CaseResult:
    """What planning a case gave; `failure` is empty if it has a plan, else the reason in one line.

    Attributes
    ----------
    name : the case's.
    seconds : that planning took.
    is_shut : whether the failure is that no way joins start and goal in the region; a wider region
        may have a way.
    arrive_by_s : where speeds are chosen, the latest arrival that the planner was asked for, in
        seconds on the planner's clock.
    ensemble : if the current has members.
    replanned : if the vessel is under way.
    kept_lanes : the traffic lanes that routes keep out of: others would sail against them.
    """

    name: str
    plan: renew.Plan | None
    failure: str
    seconds: float
    is_shut: bool = False
    arrive_by_s: float = math.inf
    ensemble: EnsembleFigures | None = None
    replanned: ReplanFigures | None = None
    kept_lanes: tuple[str, ...] = ()
    measures: Measures = Measures()

    @property
    def routes(self) -> tuple[renew.Route, ...]:
        """Routes by rank: the one to take, then the others by fuel; empty if not planned.

        This differs from the order of `plan.routes`, which is by fuel, where the sampled method
        chooses another route than that of least fuel.
        """
        if self.plan is None:
            return ()
        others = (route for i, route in enumerate(self.plan.routes) if i != self.plan.chosen)
        return (self.plan.best, *others)
