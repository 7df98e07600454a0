"""What the classes of a plan share, whatever their padding; each item is computed once."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from renew import errors
from renew._types import FloatArray
from renew.bounds.fuel_lower_bound import FuelBound
from renew.classes.class_enumerator import ClassEnumerator
from renew.classes.dual_graph import Channel, RoughPath, visits
from renew.classes.h_signature import VIA, Rays, Word, rays_that_matter
from renew.classes.triangulation import (
    Triangulation,
    overpowered_water,
    triangulate,
    triangulation_of,
)
from renew.inputs.chart_and_vessel import Chart
from renew.inputs.current import CurrentField
from renew.inputs.options import PlanOptions
from renew.kernels.current_table import changes, overpowered_spells
from renew.paths.corridor import SLACK
from renew.planner.adrift_water import AdriftWater
from renew.planner.hindrances import overpowered_error
from renew.turns.turn_reach import TurnReach
from renew.voyage.voyage import Voyage

# Room that a hard-over turn takes in still water, in v/ω.
NEEDED = 2.0
# Ratio to the least fuel up to which a way is taken for more room to turn.
MUCH_MORE = 1.2
# How many times as much a leg without any room may cost beside its own cost, tried in this order.
_DEARER = 0.3, 1.0, 3.0
# Ratio to the reach of turns at which edges are cut: beyond it, for a circle of eight corners.
_BEYOND = 1.1
# Number of steps in which the padding yields where no way keeps it.
_STEPS = 20


@dataclass(frozen=True, eq=False)
class Problem:
    """A voyage, and which of its classes to search.

    Parts that depend on neither departure nor speeds are taken from the `first` problem, so that
    classes keep their names. Roadmaps are taken from `base`, a problem at another departure. Where
    no way keeps the padding, `kept` is the share that one can keep everywhere, and legs without
    room cost `dearer` times as much beside their own cost on the roadmaps of `plain`.
    """

    voyage: Voyage
    options: PlanOptions
    first: "Problem | None" = None
    base: "Problem | None" = None
    kept: float = 1.0
    dearer: float = 0.0
    plain: "Problem | None" = None

    @property
    def _shared(self) -> "Problem | None":
        """The problem whose water is this one's, if there is one."""
        return self.first or self.plain

    @cached_property
    def overpowered_water(self) -> BaseGeometry:
        """Water where the current is as strong as the vessel."""
        return self._shared.overpowered_water if self._shared else overpowered_water(self.voyage)

    @cached_property
    def adrift_water(self) -> AdriftWater | None:
        """Water from which a vessel without thrust is on land too soon; None without a limit."""
        if self._shared:
            return self._shared.adrift_water
        if not self.options.adrift:
            return None
        water = AdriftWater.of(self.voyage, self.options.adrift, self.options.adrift_ends)
        if water.cramped is not None:
            raise water.no_way(np.stack([water.cramped[0]] * 2))
        return water

    @cached_property
    def triangulation(self) -> Triangulation:
        """Triangles of the water that is neither overpowered nor too close to land adrift."""
        if self._shared:
            return self._shared.triangulation
        chart, shut, adrift = self.voyage.chart, self.overpowered_water, self.adrift_water
        if adrift is None or adrift.closed.is_empty:
            return triangulation_of(chart) if shut.is_empty else triangulate(chart, closed=shut)
        # A turn begun beside this water may reach land across it: there its edges, cut where that
        # begins, are hazards, too.
        reach = float(self.reach.furthest.max())
        near = shapely.buffer(chart.hard_no_go, _BEYOND * reach, quad_segs=2)
        every = shapely.union(shut, adrift.closed, grid_size=chart.precision)
        parts = [shapely.difference(every, near), shapely.intersection(every, near)]
        shut = shapely.union_all(parts, grid_size=chart.precision)
        return triangulate(chart, closed=shut, beside=reach)

    @cached_property
    def rays(self) -> Rays:
        """Rays that define the classes."""
        if self.first:
            return self.first.rays
        rays, options = self.all_rays, self.options
        if options.distinct_by != "auto":
            return rays.only(rays.size >= options.distinct_by)
        start, goal = self.voyage.start, self.voyage.goal
        # If padding shuts every channel, take the best one without padding.
        found = self.scout(self.likely_width).channels(1) or self.scout(0.0).channels(1)
        path = found[0].midline(start, goal) if found else np.stack([start, goal])
        return rays_that_matter(rays, path, options.classes)

    @cached_property
    def all_rays(self) -> Rays:
        """Rays of all islands."""
        if self._shared:
            return self._shared.all_rays
        return Rays.of(self.voyage.chart, self.overpowered_water)

    @cached_property
    def reach(self) -> TurnReach:
        """Upper bound on the reach of hard-over turns."""
        if self._shared:
            return self._shared.reach
        tables = [one.table for one in self.voyage.in_members]
        return TurnReach.of_all(tables, self.voyage.vessel)

    @cached_property
    def fuel_bound(self) -> FuelBound:
        """Lower bound on the fuel of any route."""
        return FuelBound(self.voyage)

    @property
    def likely_width(self) -> float:
        """Width (m) below which hardly any padding is."""
        return self.options.likely_width(self.voyage.vessel.turning_radius, self.kept)

    @property
    def falls_short(self) -> bool:
        """Whether padding keeps only as much as there is room for."""
        return self.kept < 1.0

    def falling_short(self) -> "Problem":
        """Return the problem with the largest share of padding that some way keeps everywhere.

        The way may not be much dearer than the best without padding, nor may the best way be if
        legs without room cost more.
        """

        def least_time(steps: int) -> float:
            radius = self.voyage.vessel.turning_radius
            # Roadmaps are large: none of these is kept.
            return self._new_scout(self.options.likely_width(radius, steps / _STEPS)).least_time

        low, high, latest = 0, _STEPS, MUCH_MORE * least_time(0)
        while high - low > 1:
            middle = (low + high) // 2
            has_way = least_time(middle) <= latest < math.inf
            low, high = (middle, high) if has_way else (low, middle)
        short = plain = replace(self, kept=low / _STEPS)
        most = math.inf
        for dearer in (0.0, *_DEARER):
            tried = replace(plain, dearer=dearer, plain=plain) if dearer else plain
            ways = tried.scout(tried.likely_width).channels(1)
            rough = [one.found_by.points for one in ways if one.found_by is not None]
            fuel = min(map(self.voyage.fuel, rough), default=math.inf)
            if not fuel <= most:
                break
            most, short = min(most, MUCH_MORE * fuel), tried
        return short

    def leaving(self, departure: float) -> "Problem":
        """Return the problem at another departure (s)."""
        return replace(self.with_voyage(self.voyage.leaving(departure)), base=self)

    def with_options(self, options: PlanOptions) -> "Problem":
        """Return the problem with other padding, risk or clearance, and the same classes."""
        if options is self.options:
            return self
        return replace(self, options=options, first=self.first or self)

    def with_voyage(self, voyage: Voyage) -> "Problem":
        """Return the problem of another voyage in the same water."""
        return replace(self, voyage=voyage, first=self.first or self, base=None, plain=None)

    @cached_property
    def without_adrift(self) -> "Problem":
        """The problem with the same classes, and more: as if no vessel lost its thrust."""
        return Problem(self.voyage, replace(self.options, adrift=None))

    def word(self, path: FloatArray) -> Word:
        """Return the word of a path's class."""
        word, *others = (self.rays.word(piece) for piece in self.voyage.cut(path))
        for other in others:
            word = (*word, VIA, *other)
        return word

    def enumerator(self, clearance: float) -> ClassEnumerator:
        """Return the enumerator of classes, by paths that keep about `clearance` m off land."""
        return self.scout(clearance).by_rays(self.rays)

    def scout(self, clearance: float) -> ClassEnumerator:
        """Return the enumerator of the classes that all islands distinguish."""
        if clearance not in self._scouts:
            if self.base is not None:
                self._scouts[clearance] = self.base.scout(clearance).leaving(self.voyage)
            else:
                self._scouts[clearance] = self._new_scout(clearance)
        return self._scouts[clearance]

    def _new_scout(self, clearance: float) -> ClassEnumerator:
        """Return an enumerator with a roadmap of its own, or with that of the plain problem."""
        voyage = self.voyage
        if self.plain is not None:
            found = self.plain.scout(clearance)
        else:
            stops = range(len(voyage.stops) - 1)
            scouts = [self._scout(voyage.part(at, voyage.departure), clearance) for at in stops]
            found = ClassEnumerator.through(voyage, scouts)
        room = NEEDED * voyage.vessel.turning_radius
        return found.dearer_in_narrows(room, self.dearer) if self.dearer else found

    def _scout(self, voyage: Voyage, clearance: float) -> ClassEnumerator:
        """Return the enumerator of a voyage, or a part of it, without via points."""
        # Where no share of the padding can be kept, a way may lead through any gap.
        slack = SLACK * voyage.vessel.turning_radius if self.kept else 0.0
        rays = self.all_rays
        order, water = self.options.order, self.triangulation
        try:
            return ClassEnumerator.of(voyage, water, rays, order, clearance + slack)
        except errors.UnreachableError:
            if self.adrift_water is not None:
                way = self.without_adrift.scout(0.0).channels(1)[0]
                raise self.adrift_water.no_way(way.rough_path(voyage.start, voyage.goal)) from None
            if not self.overpowered_water.is_empty:
                # Where land separates the two, this raises the same error.
                open_water = triangulation_of(voyage.chart)
                ways = ClassEnumerator.of(voyage, open_water, rays, "length").channels(1)
                for way in ways:
                    raise overpowered_error(way, voyage) from None
            raise

    @cached_property
    def _scouts(self) -> dict[float, ClassEnumerator]:
        """Enumerators by clearance; each has its own roadmap."""
        return {}


def channel_along(path: FloatArray, problem: Problem) -> Channel | None:
    """Return the channel of the class of a path (n, 2); None if the path leaves the water."""
    pieces = problem.voyage.cut(path)
    parts = [part for piece in pieces if (part := _along(piece, problem)) is not None]
    if len(parts) < len(pieces):
        return None
    return Channel.joined(parts, problem.voyage.via) if len(pieces) > 1 else parts[0]


def _along(path: FloatArray, problem: Problem) -> Channel | None:
    """Return the channel of a path between two stops, a row of triangles without repeats."""
    mesh = problem.triangulation
    crossed = visits(path, mesh.corners).triangle
    row = list[int]()
    for triangle in crossed.tolist():
        # The triangles between two visits of the same triangle are left out.
        row = row[: row.index(triangle)] if triangle in row else row
        row.append(triangle)
    if not row or any(b not in mesh.neighbours[a] for a, b in itertools.pairwise(row)):
        return None
    word = problem.rays.word(path)
    channel = Channel.of(mesh, np.array(row), word)
    # A loop that was left out may have led round an island.
    if problem.rays.word(channel.midline(path[0], path[-1])) != word:
        return None
    return Channel(channel.triangles, channel.left, channel.right, word, RoughPath(path, crossed))


# Largest change of the current while the vessel turns by 1 rad, as a share of its speed. On a chart
# of 100 m a plan takes 1 s up to this change, and half a minute above it.
_MAX_PACE = 0.5


def off_water(point: FloatArray, chart: Chart) -> tuple[str, FloatArray] | None:
    """Say where a point (2,) lies that is not in the water, and the nearest one that is; or None.

    Water is snapped to the chart's grid: a point on its edge may lie just outside.
    """
    here = shapely.Point(point)
    if shapely.dwithin(chart.water, here, 4 * chart.precision):
        return None
    nearest = shapely.get_coordinates(shapely.shortest_line(here, chart.water))[-1]
    where = "in the no-go zone" if shapely.covers(chart.extent, here) else "off the chart"
    return where, nearest


def check_endpoints(voyage: Voyage) -> None:
    """Refuse stops that are not in the water, all at once, and a departure without a current."""
    chart, stops = voyage.chart, voyage.stops
    names = ["start", *(f"via[{at}]" for at in range(len(voyage.via))), "goal"]
    kinds = [
        errors.StartInNoGoError,
        *[errors.ViaInNoGoError] * len(voyage.via),
        errors.GoalInNoGoError,
    ]
    faults, places = list[str](), list[FloatArray]()
    error: type[errors.PlanningError] | None = None
    for name, kind, point in zip(names, kinds, stops, strict=True):
        if off := off_water(point, chart):
            where, nearest = off[0], off[1].round(3)
            faults.append(
                f"{name} {{{len(places)}}} lies {where}, {math.dist(point, nearest):.4g} m from "
                f"the nearest water at {{{len(places) + 1}}}; move it there or beyond"
            )
            places += [point, nearest]
            error = error or kind
    for (before, point), (after, following) in itertools.pairwise(zip(names, stops, strict=True)):
        if math.dist(point, following) <= chart.precision:
            faults.append(f"{before} and {after} are the same point {{{len(places)}}}; move one")
            places.append(point)
            error = error or errors.ParameterError
    if error is not None:
        raise error("; ".join(faults), *places)
    check_departures(voyage.current, (voyage.departure,))


def check_departures(current: CurrentField, departures: Sequence[float]) -> None:
    """Refuse departures (s) outside the times for which the current is known."""
    first, last = current.span
    for departure in departures:
        if not first <= departure < last:
            raise errors.ParameterError(
                "departure = {0} lies outside the times for which the current is known, {1} to {2}",
                *(errors.Moment(float(one)) for one in (departure, first, last)),
            )


def check_pace(voyage: Voyage) -> None:
    """Refuse a current that changes faster than the vessel can turn.

    It would have to be followed in steps so short that a plan takes minutes, and finds nothing that
    can be steered. A single jump is let through.
    """
    vessel = voyage.vessel
    limit = _MAX_PACE * vessel.speed * vessel.turn_rate
    # The table is made for the plan anyway; most currents never change that fast.
    if voyage.current.is_steady or voyage.waters.current_change <= limit:
        return
    change = float(np.quantile(changes(voyage.table), 0.5, method="lower"))
    if change > limit:
        raise errors.ParameterError(
            f"the current changes by {change:.3g} m/s each second; more than {limit:.3g} m/s a "
            f"second can't be followed by a vessel of {vessel.speed:.3g} m/s that turns by "
            f"{math.degrees(vessel.turn_rate):.3g}° a second. Give the current's mean over "
            f"{vessel.turn_period:.3g} s or more, or a vessel that turns faster"
        )


def check_current_at_endpoints(voyage: Voyage) -> None:
    """Refuse a departure at which the current at a stop is as strong as the vessel."""
    # In a current that changes it is not known yet when the vessel comes to the goal.
    names = ["start", *(f"via[{at}]" for at in range(len(voyage.via))), "goal"]
    ends = list(zip(names, voyage.stops, strict=True))
    ends = ends if voyage.current.is_steady else ends[:1]
    for name, point in ends:
        strength = float(np.linalg.norm(voyage.current.velocity(point, voyage.departure)))
        if strength >= voyage.vessel.speed:
            raise errors.CurrentTooStrongError(
                f"the current at the {name} runs at {strength:.3g} m/s; the vessel makes "
                f"{voyage.vessel.speed:.3g} m/s through water{{0}}. Take a faster vessel or "
                f"another {name}",
                _until(voyage, point),
            )


def _until(voyage: Voyage, point: FloatArray) -> errors.Text:
    """Say until when the current at a point (2,) stays as strong as the vessel; empty if always."""
    if voyage.current.is_steady:
        return errors.Text("")
    begin, speed = voyage.departure, voyage.vessel.speed
    end = overpowered_spells(voyage.table, point, speed, begin, begin)[:, 1].max(initial=begin)
    if not begin < end < math.inf:
        return errors.Text("")
    return errors.Text(", and the current stays so until {0}", (errors.Moment(float(end)),))
