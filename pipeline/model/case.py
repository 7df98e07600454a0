"""A case: one voyage to plan, with all that its plan depends on, in the planner's plane.

The planner computes durations in the plane. In a steady current the true duration differs a little,
according to the plane's point scale along the route. The planner's latest arrival is therefore set
so early that all routes arrive in time.
"""

import math
import pickle
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from typing import Any, NamedTuple, TypeVar

import numpy as np
from shapely.geometry import Polygon

import renew
from pipeline._types import ArrayLike, FloatArray
from pipeline.errors import RequestError
from pipeline.geo.coast import shore_to_shore
from pipeline.geo.projection import DepthCover, KnownCells, Projection
from pipeline.model.inputs import LimitedField, Note, Place, Zone
from pipeline.scenario.catalogue import PowerSpec, VesselSpec
from pipeline.scenario.model import PlannerOptions
from pipeline.scenario.season import Season, interval
from renew.errors import Length
from renew.vary.ensemble import Statistic

Current = renew.GriddedCurrent | renew.GyreCurrent | renew.UniformCurrent | renew.VaryingCurrent
CurrentT = TypeVar("CurrentT", bound=renew.CurrentField)


@dataclass(frozen=True, slots=True)
class SimplifiedLand:
    """The hard no-go zone of the planner (lon/lat degrees), which covers all of the land.

    `inner_polygons` lie inside the land: every route that avoids the land avoids them too. `notes`
    tell of a raised margin or an opened passage.
    """

    polygons: tuple[Polygon, ...]
    inner_polygons: tuple[Polygon, ...]
    original_vertices: int
    vertices: int
    tolerance_m: float
    margin_m: float
    notes: tuple[Note, ...] = ()


# Largest distance between a gap's bank and the original land, as a multiple of margin and
# tolerance: the excess allows for the errors of both and of the projection.
_AT_LAND = 1.1
# The same where there is neither, planar metres: rounding.
_ON_LAND = 1e-3


@dataclass(frozen=True, slots=True)
class Water:
    """A chart that the cases of a run share, in projected metres divided by the scale.

    `chart` has the simplified no-go zone, `land` is the original, unsimplified land; `added_m` is
    how far the zone extends beyond it, at most (margin and tolerance, true metres).
    `second_shore`, `refused_m` and `depths` are as in Land. `is_planar` is True if the scenario
    gives its places in metres, and not on a chart.
    """

    chart: renew.Chart
    land: tuple[Polygon, ...]
    projection: Projection
    is_planar: bool = False
    second_shore: tuple[Polygon, ...] = ()
    refused_m: float = math.inf
    depths: DepthCover | None = None
    added_m: float = 0.0

    def shores(self, gap: FloatArray) -> FloatArray | None:
        """Return the line (2, 2) across a gap (2, 2) of the chart from shore to shore, planar m.

        It is where the original land is closest; None if a bank of the gap is not land, and in a
        plane, whose chart is the original land.
        """
        if self.is_planar:
            return None
        land = np.array(self.land, dtype=object)
        return shore_to_shore(land, gap, _AT_LAND * self.added_m / self.projection.scale + _ON_LAND)

    def width_m(self, gap: FloatArray) -> float:
        """Return the width of a gap (2, 2) of the chart from shore to shore, true metres."""
        shores = self.shores(gap)
        return self.projection.geodesic_length_m(gap if shores is None else shores)

    def true_m(self, length: Length) -> float:
        """Return a length of a message in true metres; one across a gap has the margins there."""
        if length.across is None:
            return self.projection.scale * length.metres
        margins_m = self.width_m(length.across) - self.projection.geodesic_length_m(length.across)
        # Of a gap along a strait the land is nearest across it: that is no margin.
        return self.projection.scale * length.metres + max(0.0, margins_m)

    def to_plane(self, given: ArrayLike) -> FloatArray:
        """Return places (n, 2) as a scenario gives them in planar metres."""
        places = np.array(given, dtype=float)
        return places if self.is_planar else self.projection.to_plane(places)

    def place(self, place: FloatArray) -> Place:
        """Return a place (2,), planar metres, in degrees; in a plane it stays in metres."""
        x, y = (place if self.is_planar else self.projection.to_lonlat(place)).tolist()
        return Place(x, y, self.is_planar)

    def place_text(self, place: FloatArray) -> str:
        """Name a place (2,), planar metres, for a message: in degrees, or in metres of a plane."""
        return self.place(place).text


@dataclass(frozen=True, slots=True)
class SpeedChoice:
    """Speeds through water, m/s, among which a vessel chooses from leg to leg.

    The vessel has `within_s` true seconds from its departure to the goal.
    """

    least: float
    most: float
    within_s: float

    @classmethod
    def of(cls, season: Season) -> "SpeedChoice | None":
        """Return the choice of speeds of a season, or None; time counts from its departure."""
        begin, end = season.first_departure, season.arrive_by
        if season.speed is None or begin is None or end is None:
            return None
        return cls(season.speed.least, season.speed.most, (end - begin).total_seconds())


@dataclass(frozen=True, slots=True, eq=False)
class MemberCurrents:
    """The members of a current in the plane; `weights` (m,) is None if all are alike."""

    names: tuple[str, ...]
    currents: tuple[renew.CurrentField, ...]
    weights: FloatArray | None
    choose: Statistic


@dataclass(frozen=True, slots=True, eq=False)
class VoyageBefore:
    """The plan that the vessel is sailing, timed by the clock of the case that is planned now.

    Attributes
    ----------
    plan : its best route alone; times (s) are below 0 before the case's departure.
    current : the current that it was planned in; None if that is the case's own.
    start, via : where it began, planar metres (2,), and all its via points (n, 2).
    heading_rad : the vessel's heading in the plane, anticlockwise from the x axis, or None.
    switch_above : see `renew.replan`.
    """

    plan: renew.Plan
    current: renew.CurrentField | None
    start: FloatArray
    via: FloatArray
    heading_rad: float | None
    switch_above: float


# A path may come near a via point several times. It passes the point each time that its distance
# exceeds its least distance by no more than this share of the turning radius.
_AS_CLOSE = 0.01


class Energy(NamedTuple):
    """What a unit of the planner's fuel is where the vessel's power is known, and what is on board.

    `unit` is "Wh", or "L" of fuel from a tank; a unit of the planner's fuel is `units` of it, and
    `wh` Wh. `on_board`, planner's units, is what a plan may use, NaN if it is not known.
    """

    unit: str
    units: float
    wh: float
    on_board: float


@dataclass(frozen=True, slots=True)
class Case:
    """One voyage to plan. Its plan depends only on what the case holds.

    Attributes
    ----------
    name : the name of its season in the scenario, which differs for each case of a run.
    water : where it is sailed.
    vessel : at the highest speed that it may choose, speeds unscaled.
    start, goal, via : planar metres (2,), (2,) and (n, 2); routes pass the points `via` in order.
    current : if it changes with time, its clock, in seconds, is 0 at the departure.
    current_cells : where the current's source has figures; None if it has no source.
    departure : beginning of the clock; None if the plan does not depend on the date.
    areas, tidal_depth : areas and tidal water that are shut at times of the clock; the height of
        tide that tidal water needs includes the `under_keel_clearance_m`.
    weather : wind and waves with a limit; water over it is among the `areas`.
    leeway : how the wind carries a vessel without thrust, m/s, beside the current.
    speeds : the speeds from which the vessel chooses; the choice replaces its own speed.
    members : the currents whose mean is the current.
    lanes : traffic lanes that no route may sail against.
    before : the plan that the vessel sails, if it is planned again under way, from `start` on.
    follows : name of the case that ends at the anchorage where this one begins; or "".
    power : the vessel's power and what is on board, of which `spent_j` (joules) is used up before.
    """

    name: str
    water: Water
    vessel: renew.Vessel
    start: FloatArray
    goal: FloatArray
    current: Current
    via: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    current_cells: KnownCells | None = None
    departure: datetime | None = None
    areas: tuple[renew.ShutArea, ...] = ()
    weather: tuple[LimitedField, ...] = ()
    leeway: Current | None = None
    tidal_depth: renew.TidalDepth | None = None
    under_keel_clearance_m: float = 0.0
    speeds: SpeedChoice | None = None
    members: MemberCurrents | None = None
    lanes: tuple[Zone, ...] = ()
    before: VoyageBefore | None = None
    follows: str = ""
    power: PowerSpec | None = None
    spent_j: float = 0.0

    @property
    def chart(self) -> renew.Chart:
        """The planner's chart."""
        return self.water.chart

    @property
    def projection(self) -> Projection:
        """The plane."""
        return self.water.projection

    @property
    def energy(self) -> Energy | None:
        """What a unit of the planner's fuel is; None where the vessel has no power."""
        power, scale = self.power, self.projection.scale
        if power is None:
            return None
        usable = math.nan if power.usable_j is None else power.usable_j - self.spent_j
        if self.before is not None:
            usable += scale * self.vessel.fuel_rate * float(self.before.plan.best.times[0])
        unit = "Wh" if power.tank_l is None else "L"
        return Energy(unit, scale / power.unit_j, scale / 3600, usable / scale)

    @property
    def stops(self) -> FloatArray:
        """Start, via points and goal (n + 2, 2)."""
        return np.vstack([self.start, self.via, self.goal])

    def pieces(self, path: FloatArray) -> list[FloatArray]:
        """Return pieces (n, 2) of a path between the via points."""
        from renew.voyage.voyage import cut_at

        return cut_at(path, self.via, _AS_CLOSE * self.vessel.turning_radius)[0]

    def moment(self, seconds: float) -> datetime | float | None:
        """Return a moment on the clock, s, as a date if possible; None if infinite."""
        if not math.isfinite(seconds):
            return None
        begin = self.departure
        return seconds if begin is None else begin + timedelta(seconds=round(seconds))

    def itinerary(self, arrive_by_s: float = math.inf) -> dict[str, Any]:
        """Return via points and what is shut as `renew.plan` takes them.

        If the vessel chooses its speeds, their limits and the latest arrival (s, clock) are added.
        """
        choice = self.speeds
        return {
            "via": self.via,
            "avoid": self.areas,
            "depth": self.tidal_depth,
            "speed": None if choice is None else (choice.least, choice.most),
            "arrive_by": None if choice is None else arrive_by_s,
        }

    def planned(self, options: renew.PlanOptions, arrive_by_s: float = math.inf) -> renew.Plan:
        """Plan the case in its current."""
        return renew.plan(
            self.chart,
            self.current,
            self.vessel,
            self.start,
            self.goal,
            options=options,
            **self.itinerary(arrive_by_s),
        )

    def planned_ensemble(
        self, members: MemberCurrents, options: renew.PlanOptions
    ) -> renew.EnsemblePlan:
        """Plan the case in the members of its current."""
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
            avoid=self.areas,
        )

    def adrift_in(self, current: renew.CurrentField) -> renew.CurrentField:
        """Return what carries a vessel without thrust in a current: that, and leeway if known."""
        leeway = self.leeway
        grid = current.slices[0] if isinstance(current, renew.VaryingCurrent) else current
        if leeway is None or not isinstance(grid, renew.GriddedCurrent):
            return current
        times = np.union1d(leeway.slice_times, [] if current.is_steady else current.slice_times)
        begin, end = np.clip(current.span, *leeway.span)
        nodes, slices = np.stack(np.meshgrid(grid.x, grid.y), axis=-1), list[renew.CurrentField]()
        times = times[(times >= begin) & (times <= end)]
        for time in times.tolist():
            velocity = current.velocity(nodes, time) + leeway.velocity(nodes, time)
            slices.append(renew.GriddedCurrent(grid.x, grid.y, *np.moveaxis(velocity, -1, 0)))
        return renew.VaryingCurrent(times, slices)

    def later(self, shift_s: float, name: str) -> "Case":
        """Return the case called `name` whose clock begins `shift_s` seconds later."""
        depth, begin, members = self.tidal_depth, self.departure, self.members
        if members is not None:
            currents = tuple(_later_current(one, shift_s) for one in members.currents)
            members = replace(members, currents=currents)
        return replace(
            self,
            name=name,
            current=_later_current(self.current, shift_s),
            members=members,
            leeway=None if self.leeway is None else _later_current(self.leeway, shift_s),
            areas=tuple(
                replace(one, begin=one.begin - shift_s, end=one.end - shift_s) for one in self.areas
            ),
            weather=tuple(replace(one, times_s=one.times_s - shift_s) for one in self.weather),
            tidal_depth=None if depth is None else _later_tides(depth, shift_s),
            departure=None if begin is None else begin + timedelta(seconds=shift_s),
        )

    def copy(self) -> "Case":
        """Return a copy that shares no geometry: two threads must not use one prepared geometry."""
        copied: Case = pickle.loads(pickle.dumps(self, pickle.HIGHEST_PROTOCOL))  # noqa: S301 - own
        return copied


def _later_current(current: CurrentT, shift_s: float) -> CurrentT | renew.VaryingCurrent:
    """Return a current on a clock that begins `shift_s` seconds later."""
    if isinstance(current, renew.VaryingCurrent):
        return renew.VaryingCurrent(current.slice_times - shift_s, current.slices)
    return current


def _later_tides(depth: renew.TidalDepth, shift_s: float) -> renew.TidalDepth:
    """Return tidal water on a clock that begins `shift_s` seconds later."""
    given = [depth.tide] if isinstance(depth.tide, renew.Tide) else depth.tide
    shift = np.timedelta64(round(shift_s * 1e6), "us")
    later = {tide: replace(tide, epoch=np.datetime64(tide.epoch) + shift) for tide in given}
    if isinstance(depth.tide, renew.Tide):
        return replace(depth, tide=later[depth.tide])
    return replace(depth, tide=[later[tide] for tide in depth.tide])


def planner_vessel(spec: VesselSpec) -> renew.Vessel:
    """Return the planner's vessel, in m, m/s and radians/s; RequestError for a power unlike one."""
    power = spec.power
    try:
        return renew.Vessel(
            speed=spec.speed_m_s,
            turn_rate=math.radians(spec.turn_rate_deg_s),
            length=spec.length_m,
            fuel_coefficient=(power and power.coefficient) or spec.fuel_coefficient,
            fuel_exponent=(power and power.exponent) or spec.fuel_exponent,
            hotel=power.hotel_w if power else 0.0,
            power=(power and power.w_at_m_s) or None,
        )
    except renew.ParameterError as error:
        raise RequestError(str(error)) from None


MIN_LATENESS_S = 3600.0
"""In changing currents turns are checked for a vessel at least this early, and this late, s."""


def plan_options(
    options: PlannerOptions, scale: float = 1.0, *, min_lateness: float = 0.0
) -> renew.PlanOptions:
    """Return the planner's options, to check turns at least `min_lateness` (s) early and late.

    In a plane shrunk by a `scale`, a vessel adrift reaches land by as much sooner.
    On a chart, a run has chosen the clearance before this call. In a planar scenario, a clearance
    that the options leave out is 0.
    """
    given = {**options.model_dump(exclude={"snap", "lanes"}), "clearance": options.clearance or 0.0}
    if options.adrift is not None:
        given["adrift"] = interval(options.adrift).total_seconds() / scale
    return renew.PlanOptions(**given, min_lateness=min_lateness)
