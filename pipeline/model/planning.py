"""The planner's input, including a scenario's vessel, speeds and options, and its results.

The planner computes durations in the plane. In a steady current the true duration differs a little,
according to the plane's point scale along the route. The planner's latest arrival is therefore set
so early that all routes arrive in time.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Polygon

import renew
from pipeline._types import FloatArray
from pipeline.geo.lonlat import DepthCover, KnownCells
from pipeline.geo.projection import Projection
from pipeline.model.ensemble import EnsembleFigures, MemberCurrents
from pipeline.model.inputs import Place
from pipeline.model.under_way import Replanned, VoyageBefore
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.model import PlannerOptions, Scenario
from pipeline.scenario.season import Season

Current = renew.GriddedCurrent | renew.GyreCurrent | renew.UniformCurrent | renew.VaryingCurrent


@dataclass(frozen=True, slots=True)
class Simplified:
    """The hard no-go zone of the planner (lon/lat degrees), which covers all of the land.

    `inner_polygons` lie inside the land: every route that avoids the land avoids them too.
    """

    polygons: tuple[Polygon, ...]
    inner_polygons: tuple[Polygon, ...]
    original_vertices: int
    vertices: int
    tolerance_m: float
    margin_m: float


# A path may come near a via point several times. It passes the point each time that its distance
# exceeds its least distance by no more than this share of the turning radius.
_AS_CLOSE = 0.01


@dataclass(frozen=True, slots=True)
class SpeedChoice:
    """Speeds through water, m/s, among which a season's vessel chooses from leg to leg.

    The vessel has `within_s` true seconds from its departure to the goal.
    """

    least: float
    most: float
    within_s: float


@dataclass(frozen=True, slots=True)
class Scene:
    """The planner's input: planar metres divided by the scenario's scale, speeds unscaled.

    `land` is the original, unsimplified land. `second_shore`, `refused_m` and `depths` are as in
    Land. `start` and `goal` have shape (2,). Routes pass the points `via` (n, 2). `is_planar` is
    True if the scenario gives its places in metres, and not on a chart.

    The mappings are keyed by season. `current_cells` states where the source of a season's current
    has figures. `departures` has the seasons whose currents change; the clock of such a current, in
    seconds, is 0 at the departure. Routes keep out of their season's `areas`, whose hours are on
    the same clock, and out of its `tidal_depths` while the tide is too low there; their needs
    include the `under_keel_clearance_m`. `speeds` has the seasons in which the vessel chooses its
    speed. There the choice replaces the speed of `vessel`.

    With an `anchorage`, the index of a via point, each season is planned as far as there. Seasons
    named `onward` go on from there; each has the name of the season before it. `members` has the
    seasons whose current is the mean of several. With a voyage `before`, the vessel is under way on
    it, and the single season is planned again from `start`.
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
    refused_m: float = math.inf
    depths: DepthCover | None = None
    current_cells: Mapping[str, KnownCells] = field(default_factory=dict)
    departures: Mapping[str, datetime] = field(default_factory=dict)
    via: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    areas: Mapping[str, tuple[renew.ShutArea, ...]] = field(default_factory=dict)
    tidal_depths: Mapping[str, renew.TidalDepth] = field(default_factory=dict)
    under_keel_clearance_m: float = 0.0
    speeds: Mapping[str, SpeedChoice] = field(default_factory=dict)
    anchorage: int | None = None
    onward: Mapping[str, str] = field(default_factory=dict)
    members: Mapping[str, MemberCurrents] = field(default_factory=dict)
    before: VoyageBefore | None = None

    def leg(self, season: str) -> "Scene":
        """Return the scene with the stops of a season: those before or after the anchorage."""
        at = self.anchorage
        if at is None:
            return self
        if season in self.onward:
            return replace(self, start=self.via[at], via=self.via[at + 1 :], anchorage=None)
        return replace(self, goal=self.via[at], via=self.via[:at], anchorage=None)

    def vessel_in(self, season: str) -> renew.Vessel:
        """Return the vessel at the highest speed that it has in a season."""
        choice = self.speeds.get(season)
        return self.vessel if choice is None else replace(self.vessel, speed=choice.most)

    @property
    def stops(self) -> FloatArray:
        """Start, via points and goal (n + 2, 2)."""
        return np.vstack([self.start, self.via, self.goal])

    def pieces(self, path: FloatArray) -> list[FloatArray]:
        """Return pieces (n, 2) of a path between the via points."""
        from renew.voyage.voyage import cut_at

        return cut_at(path, self.via, _AS_CLOSE * self.vessel.turning_radius)[0]

    def itinerary(self, season: str, arrive_by_s: float = math.inf) -> dict[str, Any]:
        """Return via points and shut areas as `renew.plan` takes them.

        If speeds are to be chosen, they are there, too, and the latest arrival (s, clock).
        """
        choice = self.speeds.get(season)
        return {
            "via": self.leg(season).via,
            "avoid": self.areas.get(season, ()),
            "depth": self.tidal_depths.get(season),
            "speed": None if choice is None else (choice.least, choice.most),
            "arrive_by": None if choice is None else arrive_by_s,
        }

    def planned(
        self, season: str, options: renew.PlanOptions, arrive_by_s: float = math.inf
    ) -> renew.Plan:
        """Plan a season."""
        leg = self.leg(season)
        return renew.plan(
            self.chart,
            self.currents[season],
            self.vessel_in(season),
            leg.start,
            leg.goal,
            options=options,
            **self.itinerary(season, arrive_by_s),
        )

    def planned_ensemble(self, season: str, options: renew.PlanOptions) -> renew.EnsemblePlan:
        """Plan a season whose current has members."""
        members = self.members[season]
        return renew.plan_ensemble(
            self.chart,
            members.currents,
            self.vessel,
            self.start,
            self.goal,
            weights=members.weights,
            names=members.names,
            choose=members.choose,
            options=options,
            via=self.via,
            avoid=self.areas.get(season, ()),
        )

    def place_text(self, place: FloatArray) -> str:
        """Name a place (2,), planar metres, for a message: in degrees, or metres if planar."""
        return self.place(place).text

    def place(self, place: FloatArray) -> Place:
        """Return a place (2,), planar metres, in degrees; in a planar scene it stays in metres."""
        x, y = (place if self.is_planar else self.projection.to_lonlat(place)).tolist()
        return Place(x, y, self.is_planar)

    def moment(self, season: str, seconds: float) -> datetime | float | None:
        """Return a moment on a season's clock, s, as a date if possible; None if infinite."""
        if not math.isfinite(seconds):
            return None
        departure = self.departures.get(season)
        return seconds if departure is None else departure + timedelta(seconds=round(seconds))


@dataclass(frozen=True, slots=True)
class SeasonPlan:
    """One season's plan; `failure` is empty when it was planned, else the reason in one line.

    `class_names` are the names of homotopy classes in the reason. `is_shut` is True if the failure
    is that no way joins start and goal in the region; a wider region may have a way. Where speeds
    are chosen, `arrive_by_s` is the latest arrival that the planner was asked for, in seconds on
    the planner's clock. `ensemble` is there if the season's current has members, and `replanned` if
    the vessel is under way.
    """

    season: str
    plan: renew.Plan | None
    failure: str
    seconds: float
    is_shut: bool = False
    arrive_by_s: float = math.inf
    class_names: tuple[str, ...] = ()
    ensemble: EnsembleFigures | None = None
    replanned: Replanned | None = None

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


def planner_vessel(spec: VesselSpec) -> renew.Vessel:
    """Return the planner's vessel, in m, m/s and radians/s."""
    return renew.Vessel(
        speed=spec.speed_m_s,
        turn_rate=math.radians(spec.turn_rate_deg_s),
        length=spec.length_m,
        fuel_coefficient=spec.fuel_coefficient,
        fuel_exponent=spec.fuel_exponent,
    )


def plan_options(options: PlannerOptions, *, min_lateness: float = 0.0) -> renew.PlanOptions:
    """Return the planner's options; the vessel is early or late by `min_lateness` (s) at least.

    On a chart, a run has chosen the clearance before this call. In a planar scenario, a clearance
    that the options leave out is 0.
    """
    given = {**options.model_dump(), "clearance": options.clearance or 0.0}
    return renew.PlanOptions(**given, min_lateness=min_lateness)


# If the best route is early by more than the first share of its duration, it is planned again with
# the second share as a reserve, because routes shift a little.
_EARLY, _RESERVE = 1e-3, 2e-5
# Number of points at which the point scale is computed: along the chart's edge, and per side of a
# lattice.
_EDGE_POINTS, _LATTICE = 400, 40


def speed_choices(scenario: Scenario) -> Mapping[str, SpeedChoice]:
    """Return each season's choice of speeds, if any; its times count from the first departure."""
    found = {season.name: _speed_choice(season) for season in scenario.seasons}
    return {name: choice for name, choice in found.items() if choice is not None}


def _speed_choice(season: Season) -> SpeedChoice | None:
    """Return the choice of speeds of a season, or None."""
    begin, end = season.first_departure, season.arrive_by
    if season.speed is None or begin is None or end is None:
        return None
    return SpeedChoice(season.speed.least, season.speed.most, (end - begin).total_seconds())


def true_duration_s(route: renew.Route, scene: Scene, season: str) -> float:
    """Return a route's true duration, s, corrected for the plane's point scale along it.

    In a changing current it is the planner's duration: the current was read at the planner's times.
    """
    if not scene.currents[season].is_steady:
        return route.duration
    projection = scene.projection
    time, track = route.trajectory[:, 0], route.trajectory[:, 1:3]
    steps = np.diff(time)
    middles = projection.to_lonlat((track[:-1] + track[1:]) / 2)
    true = steps / projection.point_scale(middles)
    return float(route.duration * projection.scale * true.sum() / steps.sum())


def planned_in_time(
    planned: Callable[[float], renew.Plan], scene: Scene, season: str
) -> tuple[renew.Plan, float]:
    """Plan a season with a choice of speeds; return the plan and the planner's latest arrival, s.

    All routes arrive in time at true scale. The best is early by less than a thousandth of its
    duration, unless fuel is least even earlier or the second plan has another best route.
    """
    within_s = scene.speeds[season].within_s
    by = within_s / largest_stretch(scene, season)
    plan = planned(by)
    if not scene.currents[season].is_steady:
        return plan, by
    stretch = [true_duration_s(route, scene, season) / route.duration for route in plan.routes]
    is_free = plan.best.duration < (1 - _EARLY) * by
    if is_free or by * stretch[plan.chosen] >= (1 - _EARLY) * within_s:
        return plan, by
    later = within_s / max(stretch) * (1 - _RESERVE)
    closer = planned(later)
    durations = [true_duration_s(route, scene, season) for route in closer.routes]
    return (closer, later) if max(durations) <= within_s else (plan, by)


def largest_stretch(scene: Scene, season: str) -> float:
    """Return an upper bound of true duration divided by planned duration on the chart.

    In a changing current it is 1, because the planner's times are those of the current.
    """
    if not scene.currents[season].is_steady:
        return 1.0
    projection, extent = scene.projection, scene.chart.extent
    edge = shapely.get_coordinates(shapely.segmentize(extent, extent.length / _EDGE_POINTS))
    west, south, east, north = extent.bounds
    x, y = np.linspace(west, east, _LATTICE), np.linspace(south, north, _LATTICE)
    points = np.concatenate([edge, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)])
    least = float(projection.point_scale(projection.to_lonlat(points)).min())
    return projection.scale / least * (1 + _RESERVE)
