"""The voyage that every step of a plan works on: chart, current, vessel, start and goal."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from renew._compiled import for_kernels
from renew._types import FloatArray
from renew.inputs.chart_and_vessel import Chart, Vessel
from renew.inputs.current import CurrentField, TabulatedCurrent
from renew.inputs.options import Drift
from renew.kernels.capsules import segment_distance
from renew.kernels.current_table import CurrentTable, changes
from renew.kernels.ground_speed import Polar, choosing, made_good
from renew.kernels.viterbi import Clock, Stream, arrivals
from renew.voyage.fuel import Pieces, passage

# Share of the vessel's speed by which the current may change in a step of the clock.
_CHANGE = 0.1
# Largest number of steps across the chart.
_MAX_STEPS = 2000
# Change (m/s²) up to which a current counts as constant.
_SLOWEST_CHANGE = 1e-12
# A path may come near a via point several times. It passes the point the first time, unless it
# comes closer later by more than this share of v/ω.
_AS_CLOSE = 0.01


@dataclass(frozen=True, eq=False)
class PooledCurrent(CurrentField):
    """The current of a plan, with a mean and spread that are taken over all members."""

    lead: CurrentField
    fields: tuple[CurrentField, ...]

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2) of the lead."""
        return self.lead(points)

    @property
    def slice_times(self) -> FloatArray:
        """Times (nt,), s, of the lead."""
        return self.lead.slice_times

    def samples(self, triangles: FloatArray, windows: FloatArray | None) -> FloatArray:
        """Velocities (n, samples, 2), m/s, of every member in triangles and windows."""
        return np.concatenate(
            [member.samples(triangles, windows) for member in self.fields], axis=1
        )


@dataclass(frozen=True, eq=False)
class Waters:
    """A chart and its current, with the tables that all voyages there share.

    If the current is the mean of an ensemble, `members` are the same chart in each of its fields.
    """

    chart: Chart
    current: CurrentField
    members: "tuple[Waters, ...]" = ()

    @cached_property
    def table(self) -> CurrentTable:
        """The current as a table: the search for paths looks it up there."""
        table, chart = self.current.table(self.chart.bounds), self.chart
        return table._replace(metres=chart.metres, metres_in=chart.metres_in)

    @cached_property
    def quick_current(self) -> CurrentField:
        """The table as a current if it is accurate, else the current itself."""
        return TabulatedCurrent(self.table) if self.table.is_fine else self.current

    @cached_property
    def padded_for(self) -> CurrentField:
        """The current whose mean and spread padding is for: over all members, if there are any."""
        fields = tuple(member.quick_current for member in self.members)
        return PooledCurrent(self.quick_current, fields) if fields else self.quick_current

    @cached_property
    def current_change(self) -> float:
        """Largest change of the current in a second, anywhere in its table, m/s²."""
        return float(changes(self.table).max())


@dataclass(frozen=True, eq=False)
class Voyage:
    """A passage from `start` to `goal` (2,), m, by a drift model of Eq. 4.

    It begins at `departure` (s), on the clock of a current that changes, and may be early or late
    by a share `lateness` of the time under way, and at least by `min_lateness` (s). The points
    `via` (n, 2), m, are passed in their order. As a part of a longer voyage it has been under way
    for `before` (s) when it begins.

    A vessel that chooses speeds sails at `least_speed` (m/s) to its own speed, and has to be at the
    goal by the `deadline` (s). Every search for paths then minimises the cost, fuel + λ time. The
    `price` of time λ is the Lagrange multiplier of the deadline (fuel units a second); if it is
    infinite, time alone counts. In a current that changes a `schedule` (n, 2) says when the vessel
    is where: shares of its path's length, and times (s).
    """

    waters: Waters
    vessel: Vessel
    start: FloatArray
    goal: FloatArray
    drift: Drift
    departure: float = 0.0
    lateness: float = 0.0
    min_lateness: float = 0.0
    via: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    before: float = 0.0
    least_speed: float = math.inf
    price: float = math.inf
    deadline: float = math.inf
    schedule: FloatArray | None = None

    @property
    def chart(self) -> Chart:
        """Extent and land."""
        return self.waters.chart

    @property
    def current(self) -> CurrentField:
        """The current as it was given."""
        return self.waters.current

    @property
    def table(self) -> CurrentTable:
        """The current as a table; see :class:`Waters`."""
        return self.waters.table

    @cached_property
    def clock(self) -> Clock:
        """When the voyage begins, and how closely the search for paths follows the clock.

        In one step the current changes by no more than a share of the vessel's speed. But no step
        is shorter than the time between slices, and their number across the chart is limited.
        """
        table, speed = self.table, self.vessel.speed
        if table.is_steady:
            return Clock(self.departure, math.inf)
        least = float(np.diff(table.times).min())
        step = max(_CHANGE * speed / max(self.waters.current_change, _SLOWEST_CHANGE), least)
        xmin, ymin, xmax, ymax = self.chart.bounds
        return Clock(self.departure, max(speed * step, (xmax - xmin + ymax - ymin) / _MAX_STEPS))

    @property
    def speed_change(self) -> float:
        """Largest change of the speed over ground in a second, as a share of that speed (1/s).

        On any course; infinite where the current is as strong as the vessel. A vessel that crabs at
        an angle β loses or gains 1/cos β times the change of the current.
        """
        speed, strongest = self.vessel.speed, self.table.strongest
        if strongest >= speed:
            return math.inf
        crab = speed / math.sqrt(speed**2 - strongest**2) if self.drift == "crab" else 1.0
        return crab * self.waters.current_change / (speed - strongest)

    @property
    def in_members(self) -> "tuple[Voyage, ...]":
        """The voyage itself, and the voyage in each member of its current."""
        return self, *(replace(self, waters=waters) for waters in self.waters.members)

    def leaving(self, departure: float) -> "Voyage":
        """Return the voyage at another departure (s)."""
        return replace(self, departure=departure, schedule=None)

    @property
    def stops(self) -> FloatArray:
        """Start, via points and goal (n + 2, 2), m."""
        return np.vstack([self.start, self.via, self.goal])

    @property
    def least_duration(self) -> float:
        """Time (s) of the straight way with the strongest current behind: no voyage takes less."""
        way = sum(itertools.starmap(math.dist, itertools.pairwise(self.stops)))
        return way * float(self.chart.metres.min()) / (self.vessel.speed + self.table.strongest)

    def part(self, at: int, departure: float) -> "Voyage":
        """Return the part from one stop to the next as a voyage of its own, begun at a time (s)."""
        start, goal = self.stops[at : at + 2]
        before = departure - self.departure
        return replace(
            self.leaving(departure), start=start, goal=goal, via=self.via[:0], before=before
        )

    def parts(self, path: FloatArray) -> "Iterator[tuple[Voyage, FloatArray]]":
        """Yield each part with its piece of a path (n, 2), begun when the path comes to it."""
        if not len(self.via):
            yield self, path
            return
        departure = self.departure
        for at, piece in enumerate(self.cut(path)):
            part = self.part(at, departure)
            yield part, piece
            duration = part.duration(piece)
            # A part that can't be sailed takes no time.
            departure += duration if math.isfinite(duration) else 0.0

    def cut(self, path: FloatArray) -> list[FloatArray]:
        """Return pieces (n, 2) of a path between via points; each but the last ends at one."""
        return self._cut(path)[0]

    def cut_speeds(self, path: FloatArray, speeds: FloatArray) -> list[FloatArray]:
        """Return the speeds (n - 1,), m/s, of the legs of each piece, from the path's speeds."""
        by_piece, first = list[FloatArray](), 0
        for piece in self.cut(path):
            last = first + len(piece) - 1
            by_piece.append(speeds[first:last])
            # A leg that passes a via point between its ends belongs to both pieces.
            first = last if (path[last] == piece[-1]).all() else last - 1
        return by_piece

    def missed(self, path: FloatArray) -> FloatArray:
        """Return distance (v,), m, at which a path (n, 2) passes each via point, in their order."""
        return self._cut(path)[1]

    def _cut(self, path: FloatArray) -> tuple[list[FloatArray], FloatArray]:
        """Return the pieces, and how far off each via point is."""
        return cut_at(path, self.via, _AS_CLOSE * self.vessel.turning_radius)

    def at_speed(self, speed: float) -> "Voyage":
        """Return the voyage at a constant speed through water (m/s)."""
        return replace(self, vessel=replace(self.vessel, speed=speed), schedule=None)

    @cached_property
    def polar(self) -> Polar:
        """Speed and drift model, for kernels; with the choice of speeds, if there is one."""
        vessel, is_crab = self.vessel, self.drift == "crab"
        if not self.has_price:
            return Polar(vessel.speed, is_crab)
        return choosing(
            vessel.speed,
            crab=is_crab,
            least=self.least_speed,
            price=self.price / vessel.fuel_coefficient,
            law=vessel.law,
        )

    @property
    def has_choice(self) -> bool:
        """Whether the vessel has a choice of speeds."""
        return self.least_speed < self.vessel.speed

    @property
    def has_price(self) -> bool:
        """Whether speeds are chosen, and time has a finite price."""
        return self.has_choice and self.price < math.inf

    @property
    def price_of_all_time(self) -> float:
        """Worth of the time from departure to deadline (fuel units)."""
        if self.has_price and self.price > 0:
            return self.price * (self.deadline - self.departure)
        return 0.0

    @property
    def cost_rate(self) -> float:
        """Cost of a second by the polar (fuel units): the fuel rate, where no speed is chosen."""
        if self.has_price:
            return self.vessel.fuel_coefficient * self.polar.scale
        return self.vessel.fuel_rate

    def early_and_late(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return earliest and latest times (n,), s, at places passed at `times` (n,), s."""
        begun = self.departure - self.before
        return early_and_late(times, begun, self.lateness, self.min_lateness)

    def fuel(self, path: FloatArray) -> float:
        """Return fuel by Eq. 4 along a path (n, 2), or its cost; inf where no way can be made."""
        if self.has_price:
            pieces = Pieces.of(path)
            velocity = self.current.velocity(pieces.points, self.departure)
            made = made_good(velocity, pieces.tangent, self.polar)
            with np.errstate(divide="ignore", invalid="ignore"):
                total = pieces.total(np.where(made > 0, 1 / made, np.inf), self.chart).sum()
            return float(self.cost_rate * total)
        return float(self.vessel.fuel_rate * (self.arrivals(path)[-1] - self.departure))

    def arrivals(self, path: FloatArray) -> FloatArray:
        """Return times (n,), s, at a path's points (n, 2), on the current's clock, by Eq. 4."""
        key = path.tobytes()
        if key not in self._arrivals:
            self._arrivals[key] = self._timed(path)
        return self._arrivals[key]

    @cached_property
    def _arrivals(self) -> dict[bytes, FloatArray]:
        """Times at the points of paths, cached because every step of planning needs them."""
        return {}

    def _timed(self, path: FloatArray) -> FloatArray:
        """Return times (n,), s, at the points of a path, computed in the current itself."""
        times = None
        if not self.current.is_steady:
            times = arrivals(for_kernels(path), Stream(self.table, self.polar, self.clock))
        passed = passage(
            path,
            self.current,
            self.vessel,
            guess=times,
            drift=self.drift,
            departure=self.departure,
            chart=self.chart,
        )
        return np.asarray(self.departure + np.concatenate([[0.0], np.cumsum(passed.durations)]))

    def duration(self, path: FloatArray) -> float:
        """Return the time under way (s) along a path (n, 2), by the table; inf without headway."""
        end = float(arrivals(for_kernels(path), Stream(self.table, self.polar, self.clock))[-1])
        return end - self.departure if math.isfinite(end) else math.inf

    def reading_times(self, path: FloatArray) -> FloatArray:
        """Return the approximate times (n,), s, for reading the current at a path's points (n, 2).

        They are times of passage by the schedule, or else by the table; in a steady current all are
        the departure. A leg that can't be sailed takes no time.
        """
        if self.current.is_steady:
            return np.full(len(path), self.departure)
        if self.schedule is not None:
            return np.interp(shares(path), *self.schedule.T)
        times = arrivals(for_kernels(path), Stream(self.table, self.polar, self.clock))
        return np.asarray(np.minimum(times, times[np.isfinite(times)][-1]))


def shares(path: FloatArray) -> FloatArray:
    """Return shares (n,) of the way, from 0 to 1, at which the points of a path (n, 2) lie."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    return np.asarray(along / max(along[-1], 1e-300))


def cut_at(
    path: FloatArray, points: FloatArray, close: float
) -> tuple[list[FloatArray], FloatArray]:
    """Return pieces (n, 2) of a path cut at points (v, 2), and how far off (v,), m, these are.

    Where the path passes a point again as closely, within `close` m, the first time counts.
    """
    pieces, missed, ahead = list[FloatArray](), list[float](), path
    for point in points:
        distance = segment_distance(point, ahead[:-1], ahead[1:])
        first = int(np.argmax(distance <= distance.min() + close))
        behind = np.flatnonzero(distance[first:] > distance.min() + close)
        last = first + int(behind[0]) if len(behind) else len(distance)
        leg = first + int(distance[first:last].argmin())
        following = leg + 2 if (ahead[leg + 1] == point).all() else leg + 1
        pieces.append(np.vstack([ahead[: leg + 1], point]))
        missed.append(float(distance[leg]))
        ahead = np.vstack([point, ahead[following:]])
    return [*pieces, ahead], np.array(missed)


def early_and_late(
    times: FloatArray, departure: float, lateness: float, min_lateness: float
) -> tuple[FloatArray, FloatArray]:
    """Return earliest and latest times (n,), s, at places passed at `times` (n,), s.

    They differ from `times` by a share `lateness` of the time since departure, and at least by
    `min_lateness` (s); but the vessel is nowhere before the departure.
    """
    away = np.maximum(lateness * (times - departure), min_lateness)
    return np.maximum(times - away, np.minimum(times, departure)), times + away
