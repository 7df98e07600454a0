"""What is asked of a plan: where, with which vessel, in which current, when, and how."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from renew._types import FloatArray
from renew.errors import ParameterError, check_kind, is_finite, is_number, shown
from renew.inputs.chart_and_vessel import MAX_SPEED, Chart, Vessel
from renew.inputs.current import CurrentField, CurrentLike, as_field
from renew.inputs.openings import Opening, ShutArea, TidalDepth, with_always_shut
from renew.inputs.options import (
    PlanOptions,
    ViaPoints,
    as_point,
    as_via,
    check_objects,
    is_one_of,
    is_row,
)
from renew.voyage.voyage import Voyage, Waters

Place: TypeAlias = FloatArray | tuple[float, float]
"""A point (2,), m."""
Speeds: TypeAlias = tuple[float, float]
"""Lowest and highest speed through water, m/s."""


@dataclass(frozen=True, eq=False)
class Request:
    """What is asked of a plan, checked.

    Attributes
    ----------
    chart : without the water of areas that are always shut.
    stops : (n, 2) m, start, via points and goal.
    areas : those that are shut for some hours, among them those of the `depth`.
    departure : start of the voyage (s), on the clock of the current.
    arrive_by : latest allowed arrival (s), on the same clock.
    speed : lowest and highest speed (m/s), if the vessel chooses speeds.
    members : if the current is the mean of an ensemble, the fields in which turns are to be clear.
    like : a request in the same water and current; what its planners know is shared.
    falls_short : whether padding keeps only as much as there is room for.
    planners : what plans the classes; see :func:`renew.planner.plan.planner_of`.
    """

    chart: Chart
    current: CurrentField
    vessel: Vessel
    stops: FloatArray
    options: PlanOptions = field(default_factory=PlanOptions)
    areas: tuple[Opening, ...] = ()
    depth: TidalDepth | None = None
    departure: float = 0.0
    arrive_by: float | None = None
    speed: Speeds | None = None
    members: tuple[CurrentField, ...] = ()
    like: "Request | None" = None
    falls_short: bool = False
    planners: dict[object, Any] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(
        cls,
        chart: Chart,
        current: CurrentLike,
        vessel: Vessel,
        ends: tuple[Place, Place],
        *,
        options: PlanOptions | None = None,
        changes: Mapping[str, Any] | None = None,
        departure: float = 0.0,
        arrive_by: float | None = None,
        via: ViaPoints = (),
        avoid: Sequence[ShutArea] = (),
        depth: TidalDepth | None = None,
        speed: Speeds | None = None,
        more_faults: Sequence[str] = (),
    ) -> "Request":
        """Return the request for a plan from the first of two `ends` to the other.

        The other arguments are those of :func:`renew.plan`; `changes` are its options by name.
        Raises ParameterError for options, times, speeds and via points out of range: it names all
        faults at once, and `more_faults` that the caller found.
        """
        check_objects(chart, vessel, avoid, depth)
        given = options_by_name(options, changes or {})
        points = as_via(via)
        faults = list[str]()
        try:
            options = PlanOptions(**given)
        except ParameterError as error:
            faults.append(str(error))
        faults += _time_faults(departure, arrive_by)
        if is_one_of(given["method"], ("sampled",)):
            faults += [
                f"{name} needs method = 'optimal', not 'sampled'"
                for name, value in (("arrive_by", arrive_by), ("speed", speed))
                if value is not None
            ]
        faults += [*_speed_faults(speed, vessel), *more_faults]
        faults += [
            f"via points need {name} = {needed!r}, not {shown(given[name])}"
            for name, needed in (("method", "optimal"), ("order", "fuel"))
            if len(points) and not is_one_of(given[name], (needed,))
        ]
        field = as_field(current)
        if options is not None and options.adrift and not field.is_steady:
            faults.append(
                f"adrift = {options.adrift:g} s needs a current that does not change: in one that "
                "does, each hour has water of its own; leave it out, or plan in the mean current"
            )
        if faults or options is None:
            raise ParameterError("; ".join(faults))
        never_open, tidal_areas = (depth.never_open, depth.tidal_areas) if depth else ((), ())
        return cls(
            with_always_shut(chart, [*avoid, *never_open]),
            field,
            vessel,
            np.vstack([as_point("start", ends[0]), points, as_point("goal", ends[1])]),
            options,
            (*(area for area in avoid if not area.is_always_shut), *tidal_areas),
            depth,
            departure,
            arrive_by,
            speed,
        )

    @cached_property
    def waters(self) -> Waters:
        """The chart and the current, with what all voyages there share."""
        if self.like:
            return self.like.waters
        members = tuple(Waters(self.chart, member) for member in self.members)
        return Waters(self.chart, self.current, members)

    @property
    def deadline(self) -> float:
        """Latest arrival (s) with a choice of speeds, at most the end of the current's data."""
        last = self.current.span[1]
        return float(last if self.arrive_by is None else min(self.arrive_by, last))

    def voyage(self, waters: Waters, vessel: Vessel) -> Voyage:
        """Return the voyage in some waters, with a vessel whose speed is the highest to choose."""
        voyage = Voyage(
            waters,
            self.chart.turning(vessel),
            self.stops[0],
            self.stops[-1],
            self.options.drift,
            float(self.departure),
            float(self.options.lateness),
            float(self.options.min_lateness),
            self.stops[1:-1],
        )
        if self.speed is None:
            return voyage
        return replace(voyage, least_speed=float(self.speed[0]), deadline=self.deadline)


def options_by_name(options: PlanOptions | None, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return all options by name, with the changes; TypeError if a change names no option."""
    options = PlanOptions() if options is None else options
    check_kind("options", options, PlanOptions)
    given = vars(options)
    unknown = ", ".join(map(repr, changes.keys() - given.keys()))
    if unknown:
        raise TypeError(f"a plan has no option {unknown}; it has {', '.join(given)}")
    return {**given, **changes}


def _time_faults(departure: object, arrive_by: object) -> list[str]:
    """Faults of the times (s) of a plan."""
    if not is_finite(departure):
        return [f"departure = {shown(departure)} s must be finite"]
    if arrive_by is not None and not (is_finite(arrive_by) and arrive_by > departure):
        return [
            f"arrive_by = {shown(arrive_by)} s must be finite and after departure = {departure!r} s"
        ]
    return []


def _speed_faults(speed: object, vessel: Vessel) -> list[str]:
    """Faults of the speeds (m/s) from which a vessel may choose."""
    if speed is None:
        return []
    if not is_row(speed) or len(speed) != len(("least", "most")):
        return [f"speed = {shown(speed)} must be two speeds (m/s), the lowest and the highest"]
    faults = [
        f"speed.{name} = {shown(value)} m/s must be a number above 0 and at most {MAX_SPEED:g}"
        for name, value in zip(("least", "most"), speed, strict=True)
        if not (is_number(value) and 0 < value <= MAX_SPEED)
    ]
    if not faults and speed[0] > speed[1]:
        faults.append(
            f"speed.least = {speed[0]!r} m/s is above speed.most = {speed[1]!r} m/s; exchange them"
        )
    for name, value in zip(("least", "most"), speed, strict=True):
        faults += vessel.speed_faults(f"speed.{name}", value)
    return faults
