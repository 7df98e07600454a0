"""Places that are open at some hours only: shut areas, tidal water, havens.

A prediction of the tide knows neither wind nor pressure, and a tide runs early or late. So a vessel
relies on the least predicted height within a `lag` of its time, less a `surge`.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from renew import errors
from renew._types import BoolArray, FloatArray, IntArray
from renew.inputs.chart_and_vessel import Chart
from renew.inputs.tide import Tide

# Time (s) ahead in which a message names the next hours of enough water: from one spring tide to
# the next but one.
_NEXT = 30 * 86_400.0
# Time (s) that is tried first: most areas open once or twice a day.
_SOON = 2 * 86_400.0
# Time step (s) of the heights from which the hours are computed. With a tide of 6 m twice a day,
# linear interpolation between two steps is off by 0.2 mm.
_STEP = 120.0
# Time (s) before and after a voyage that is searched too, so that messages name complete periods.
_AROUND = 86_400.0


@dataclass(frozen=True, eq=False)
class Opening(ABC):
    """A `polygon` (m) that is open at some hours and shut at others.

    A plan knows no more of areas, tides and weather than when their water is shut.
    """

    polygon: Polygon | MultiPolygon

    @abstractmethod
    def is_shut(self, begin: FloatArray, end: FloatArray) -> BoolArray:
        """Whether it is shut at some time between each `begin` and `end` (n,), s."""

    def is_shut_within(self, begin: float, end: float) -> bool:
        """Whether it is shut at some time from `begin` to `end`, s."""
        return bool(self.is_shut(np.array([begin]), np.array([end]))[0])

    @abstractmethod
    def hours(self, begin: float, end: float) -> FloatArray:
        """Return its spells (n, 2), s, in which it is shut, at least those from begin to end."""

    @abstractmethod
    def text(self, departure: float) -> errors.Text:
        """Name it with its hours, for a message on a voyage from `departure` (s)."""


@dataclass(frozen=True, eq=False)
class ShutArea(Opening):
    """An area that is shut from `begin` until `end` (s), on the clock of the current, or always.

    Parameters
    ----------
    polygon : Polygon or MultiPolygon
        The area (m).
    begin, end : float
        Times (s) from which and until which no vessel may be in it.
    name : str
        Its name in messages.

    Raises
    ------
    GeometryError
        An area that is no valid polygon; says where and why.
    ParameterError
        An end that does not come after the beginning.
    """

    begin: float = -math.inf
    end: float = math.inf
    name: str = ""

    def __post_init__(self) -> None:
        """Refuse a polygon that is not valid, and hours that are not in order."""
        check_area(f"area {self.name!r}", self.polygon)
        hours = self.begin, self.end
        if not (all(map(errors.is_number, hours)) and self.begin < self.end):
            begin, end = map(errors.shown, hours)
            raise errors.ParameterError(
                f"area {self.name!r} is shut from {begin} until {end} s; the end must come after "
                "the beginning"
            )

    @property
    def is_always_shut(self) -> bool:
        """Whether it has no hours at which it is open."""
        return math.isinf(self.begin) and math.isinf(self.end)

    def is_shut(self, begin: FloatArray, end: FloatArray) -> BoolArray:
        """Whether it is shut at some time between each `begin` and `end` (n,), s."""
        return np.asarray((begin < self.end) & (end > self.begin))

    def is_shut_within(self, begin: float, end: float) -> bool:
        """Whether it is shut at some time from `begin` to `end`, s; quicker, as there are many."""
        return begin < self.end and end > self.begin

    def hours(self, begin: float, end: float) -> FloatArray:  # noqa: ARG002 - as of a tidal area
        """Return the one spell (1, 2), s, in which it is shut."""
        return np.array([[self.begin, self.end]])

    def text(self, departure: float) -> errors.Text:  # noqa: ARG002 - as of a tidal area
        """The area with its hours, for a message on a voyage from `departure` (s)."""
        name = errors.Text(f"area {self.name!r}" if self.name else "an area")
        if self.is_always_shut:
            return errors.Text("{0}, always shut", (name,))
        return errors.Text("{0}, which is shut{1}", (name, errors.from_until(self.begin, self.end)))


@dataclass(frozen=True, eq=False)
class OverLimit(ShutArea):
    """Water where wind or waves exceed the vessel's limit for some hours; its name says which.

    `most` is their largest value there in these hours, in a `unit`: "m" or "m/s"; infinite where
    they are not known.
    """

    most: float = math.inf
    unit: str = "m"

    def text(self, departure: float) -> errors.Text:  # noqa: ARG002 - as of a tidal area
        """The water with its hours, for a message on a voyage from `departure` (s)."""
        hours = errors.from_until(self.begin, self.end)
        if math.isinf(self.most):
            return errors.Text(f"water with unknown {self.name}{{0}}", (hours,))
        # Rounded up, so that it is never said to be at its limit.
        most = math.ceil(10 * self.most) / 10
        return errors.Text(f"water with {self.name} of up to {most:.1f} {self.unit}{{0}}", (hours,))


@dataclass(frozen=True, eq=False)
class ReliedOnTide:
    """A tide that may be lower than predicted by `surge` (m), and early or late by `lag` (s)."""

    tide: Tide
    surge: float
    lag: float

    @property
    def least(self) -> float:
        """A height (m over chart datum) below which it never falls."""
        return self.tide.lowest - self.surge

    @property
    def most(self) -> float:
        """A height (m over chart datum) above which it never rises."""
        return self.tide.highest - self.surge

    def heights(self, times: FloatArray) -> FloatArray:
        """Heights (...,), m over chart datum, at times (...,), s."""
        count = 2 * int(np.ceil(self.lag / _STEP)) + 1
        around = np.asarray(times)[..., None] + np.linspace(-self.lag, self.lag, count)
        predicted = self.tide.heights(around.ravel()).reshape(around.shape)
        return np.asarray(predicted.min(axis=-1) - self.surge)

    def too_low(self, need: float, begin: float, end: float) -> FloatArray:
        """Hours (n, 2), s, that overlap `begin` to `end` (s), in which it is below a need (m).

        Hours that begin or end more than a day outside `begin` to `end` are infinite there.
        """
        times, excess = self._excess(need, begin, end)
        hours = _joined(_spells(times, -excess) + np.array([-self.lag, self.lag]))
        return hours[(hours[:, 0] < end) & (hours[:, 1] > begin)]

    def high_enough(self, need: float, begin: float, end: float) -> FloatArray:
        """Hours (n, 2), s, from `begin` to `end` (s), in which it is at least the need (m)."""
        low = np.clip(self.too_low(need, begin, end), begin, end)
        hours = np.column_stack([np.append(begin, low[:, 1]), np.append(low[:, 0], end)])
        return hours[hours[:, 0] < hours[:, 1]]

    def highest(self, begin: float, end: float) -> float:
        """Its greatest height (m over chart datum) from `begin` to `end` (s)."""
        return float(self.heights(np.arange(begin, end + _STEP, _STEP)).max())

    def _excess(self, need: float, begin: float, end: float) -> tuple[FloatArray, FloatArray]:
        """Times (n,), s, and by how much the predicted height less the surge exceeds a need, m."""
        # Times are whole multiples of the step, so that the hours do not depend on `begin`.
        first, last = np.floor((begin - _AROUND) / _STEP), np.ceil((end + _AROUND) / _STEP)
        times = _STEP * np.arange(first, last + 1)
        return times, self.tide.heights(times) - self.surge - need


def _spells(times: FloatArray, excess: FloatArray) -> FloatArray:
    """Hours (n, 2), s, in which a function, linear between (n,) `times`, is above 0."""
    above = excess > 0
    change = np.flatnonzero(above[1:] != above[:-1])
    before, after = excess[change], excess[change + 1]
    cross = times[change] + before / (before - after) * (times[change + 1] - times[change])
    first = [-np.inf] if above[0] else []
    last = [np.inf] if above[-1] else []
    return np.concatenate([first, cross, last]).reshape(-1, 2)


def _joined(hours: FloatArray) -> FloatArray:
    """Hours (n, 2), s, in ascending order, with overlapping ones joined."""
    if not len(hours):
        return hours
    apart = hours[1:, 0] > hours[:-1, 1]
    begins = hours[np.append(True, apart), 0]
    return np.column_stack([begins, hours[np.append(apart, True), 1]])


@dataclass(frozen=True, eq=False)
class TidalArea(Opening):
    """An area that is shut while the tide relied on is below its need (m over chart datum)."""

    need: float
    tide: ReliedOnTide
    name: str = ""

    def is_shut(self, begin: FloatArray, end: FloatArray) -> BoolArray:
        """Whether it is shut at some time between each `begin` and `end` (n,), s."""
        shut = np.zeros(len(begin), dtype=bool)
        if len(begin):
            for low in self.tide.too_low(self.need, float(begin.min()), float(end.max())):
                shut |= (begin < low[1]) & (end > low[0])
        return shut

    def hours(self, begin: float, end: float) -> FloatArray:
        """Return the spells (n, 2), s, of too little water that overlap `begin` to `end` (s)."""
        return self.tide.too_low(self.need, begin, end)

    def text(self, departure: float) -> errors.Text:
        """The area with its next hours of enough water, for a voyage from `departure` (s)."""
        name = f"area {self.name!r}, which" if self.name else "water that"
        text = f"{name} needs {math.ceil(100 * self.need) / 100:.2f} m of tide"
        hours = self.next_hours(departure)
        if hours is None:
            highest = math.ceil(100 * self.tide.highest(departure, departure + _NEXT)) / 100
            return errors.Text(
                f"{text} (no more than {highest:.2f} m can be relied on until {{0}})",
                (errors.Moment(departure + _NEXT),),
            )
        return errors.Text(f"{text} (there is enough{{0}})", (errors.from_until(*hours),))

    def next_hours(self, time: float) -> tuple[float, float] | None:
        """Return begin and end (s) of the hours of enough water around a time (s), or next to it.

        A beginning two days before that time, and an end a month after it, are infinite. None if
        there is too little water for a month.
        """
        for ahead in (_SOON, _NEXT):
            low = self.tide.too_low(self.need, time - _SOON, time + ahead)
            begins, ends = np.append(-math.inf, low[:, 1]), np.append(low[:, 0], math.inf)
            after = np.flatnonzero((ends > time) & (begins < time + ahead))
            if len(after) and (ends[after[0]] < math.inf or ahead == _NEXT):
                return float(begins[after[0]]), float(ends[after[0]])
        return None


def check_area(name: str, polygon: object) -> None:
    """Refuse anything but a valid polygon (m); the error names the area."""
    if not isinstance(polygon, Polygon | MultiPolygon) or polygon.is_empty:
        raise errors.GeometryError(
            f"{name} must be a non-empty polygon, not {errors.shown(polygon)}"
        )
    if not np.isfinite(shapely.get_coordinates(polygon)).all():
        raise errors.GeometryError(f"{name} has coordinates that are not finite")
    if not polygon.is_valid:
        raise errors.GeometryError(
            f"{name} is not valid: {shapely.is_valid_reason(polygon)}. Mend with shapely.make_valid"
        )


def polygons_of(areas: Sequence[Opening]) -> list[Polygon]:
    """The polygons of some areas."""
    return [
        one for area in areas for one in shapely.get_parts(area.polygon) if isinstance(one, Polygon)
    ]


def with_always_shut(chart: Chart, areas: Sequence[ShutArea]) -> Chart:
    """Return the chart without the water of areas that are always shut."""
    always = [area for area in areas if area.is_always_shut]
    return chart.without(polygons_of(always), is_land=True) if always else chart


Schedules: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""Times (n,), s, at which places are passed: on time, early and late."""


class LeastWater(NamedTuple):
    """Where a route has least water to spare.

    In the `area` the tide relied on exceeds the need by `spare` (m), at the `place` (2,), m, which
    the vessel passes on time at `time` (s). `early` and `late` are the least spare water (m)
    anywhere on the way of a vessel that is early or late.
    """

    spare: float
    place: FloatArray
    time: float
    early: float
    late: float
    area: TidalArea


@dataclass(frozen=True, eq=False)
class TidalDepth:
    """Areas of water, and the height of tide that the vessel needs in each.

    The tide relied on is the least height predicted within `lag` of the vessel's time, less the
    `surge`; an area is shut while this height is below its need. Areas may overlap; all their needs
    count. Outside them there is enough water at any time.

    Parameters
    ----------
    areas : sequence of Polygon or MultiPolygon
        Areas (n) of water (m).
    needs : array_like
        Draught, squat and clearance, less the charted depth (n,), m. Depths and tides are
        counted from one chart datum.
    tide : Tide or sequence of Tide
        The tide everywhere, or of each area, on the clock of the current.
    surge : float
        Height (m) by which the tide may be lower than predicted.
    lag : float
        Time (s) by which it may be early or late.
    names : sequence of str, optional
        The areas' names in messages.

    Raises
    ------
    ParameterError
        Needs, tides or names that do not fit the areas, or numbers out of range; all at once.
    GeometryError
        An area that is no valid polygon.
    """

    areas: Sequence[Polygon | MultiPolygon]
    needs: Sequence[float] | FloatArray
    tide: Tide | Sequence[Tide]
    surge: float = 0.3
    lag: float = 900.0
    names: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Refuse areas, needs and tides that do not fit each other."""
        count, needs = len(self.areas), errors.as_floats("depth.needs", self.needs)
        faults = []
        if needs.shape != (count,) or not np.isfinite(needs).all():
            faults.append(f"depth.needs must be {count} finite heights (m), one for each area")
        if not isinstance(self.tide, Tide) and len(self.tide) != count:
            faults.append(f"depth.tide has {len(self.tide)} tides for {count} areas")
        if len(self.names) not in {0, count}:
            faults.append(f"depth.names has {len(self.names)} names for {count} areas")
        for name, unit in (("surge", "m"), ("lag", "s")):
            value = getattr(self, name)
            if not (errors.is_finite(value) and value >= 0):
                faults.append(
                    f"depth.{name} = {errors.shown(value)} {unit} must be finite, 0 or more"
                )
        if faults:
            raise errors.ParameterError("; ".join(faults))
        for at, area in enumerate(self.areas):
            check_area(f"depth.areas[{at}]", area)
        for at, tide in enumerate([] if isinstance(self.tide, Tide) else self.tide):
            errors.check_kind(f"depth.tide[{at}]", tide, Tide)

    @cached_property
    def tidal_areas(self) -> tuple[TidalArea, ...]:
        """Areas that the tide may shut for some hours."""
        return tuple(one for one in self._all_areas if one.tide.least < one.need <= one.tide.most)

    @cached_property
    def never_open(self) -> tuple[ShutArea, ...]:
        """Areas in which no tide is high enough."""
        return tuple(
            ShutArea(area.polygon, name=area.name)
            for area in self._all_areas
            if area.need > area.tide.most
        )

    def least_water(self, path: FloatArray, schedules: Schedules) -> LeastWater | None:
        """Return where a path (n, 2), m, has least water to spare; None where no area is passed."""
        leg, area, spare = self._spare(path, schedules)
        if not len(leg):
            return None
        worst = int(spare[0].argmin())
        place, (least, early, late) = leg[worst], spare.min(axis=1).tolist()
        time, passed = float(schedules[0][place]), self._all_areas[area[worst]]
        return LeastWater(least, path[place], time, early, late, passed)

    def spare_along(self, path: FloatArray, times: FloatArray) -> FloatArray:
        """Return the least spare water (n - 1,), m, on each leg of a path (n, 2), m.

        It is passed at times (n,), s. Outside all areas the water is infinite.
        """
        leg, _, spare = self._spare(path, (times,))
        least = np.full(len(path) - 1, np.inf)
        np.minimum.at(least, leg, spare[0])
        return least

    def _spare(
        self, path: FloatArray, schedules: Sequence[FloatArray]
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the leg (k,) of each passage of an area, the area (k,), and the spare water, m.

        The water (schedules, k) is given for each schedule: the times (n,), s, at a path's points.
        """
        legs = shapely.linestrings(np.stack([path[:-1], path[1:]], axis=1))
        leg, area = self._tree.query(legs, predicate="intersects")
        spare = np.empty((len(schedules), len(leg)))
        for tide in set(self._tides):
            in_them = np.array([relied_on is tide for relied_on in self._tides])[area]
            # Points are close, so the tide on a leg is nearly that at one of its ends.
            for row, times in zip(spare, schedules, strict=True):
                heights = tide.heights(times)
                row[in_them] = np.minimum(heights[:-1], heights[1:])[leg[in_them]]
        return leg, area, spare - np.asarray(self.needs)[area]

    @cached_property
    def _tides(self) -> tuple[ReliedOnTide, ...]:
        """The tide relied on in each area."""
        given = [self.tide] * len(self.areas) if isinstance(self.tide, Tide) else self.tide
        made = {tide: ReliedOnTide(tide, self.surge, self.lag) for tide in given}
        return tuple(made[tide] for tide in given)

    @cached_property
    def _all_areas(self) -> tuple[TidalArea, ...]:
        """All areas, each with its need and the tide relied on there."""
        needs = np.asarray(self.needs, dtype=float).tolist()
        names = self.names or [""] * len(needs)
        rows = zip(self.areas, needs, self._tides, names, strict=True)
        return tuple(TidalArea(*row) for row in rows)

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree(list(self.areas))


@dataclass(frozen=True, eq=False)
class Haven:
    """A place where a vessel can take refuge, as the user says; nothing here can check that.

    Parameters
    ----------
    name : str
        Its name in messages and results.
    place : array_like
        Point (2,), m, in the chart's water and outside the soft no-go zone.
    opens, closes : float
        Times (s), on the clock of the current, from which and until which it can be entered. A
        vessel that comes earlier waits outside, and burns fuel at its thrust.

    Raises
    ------
    ParameterError
        A name without letters, a place that is no point, or hours that don't ascend.
    """

    name: str
    place: FloatArray
    opens: float = -math.inf
    closes: float = math.inf

    def __post_init__(self) -> None:
        """Refuse figures that no haven has; the error names all faults."""
        faults = []
        if not str(self.name).strip():
            faults.append("its name is empty")
        place = errors.as_floats("place", self.place)
        if place.shape != (2,) or not np.isfinite(place).all():
            faults.append(f"place = {errors.shown(self.place)} must be two finite numbers (m)")
        hours = (self.opens, self.closes)
        if not (all(map(errors.is_number, hours)) and self.opens < self.closes):
            faults.append(
                f"opens = {errors.shown(self.opens)} s must be a time before closes = "
                f"{errors.shown(self.closes)} s"
            )
        if faults:
            raise errors.ParameterError(f"haven {errors.shown(self.name)}: " + "; ".join(faults))
        object.__setattr__(self, "place", place)
