"""What a plan may be asked for, checked before anything is computed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Literal, TypeAlias, TypedDict, TypeGuard, get_args

import numpy as np
import shapely

from renew._types import FloatArray
from renew.errors import (
    CurrentTooStrongError,
    GoalInNoGoError,
    Moment,
    ParameterError,
    PlanningError,
    StartInNoGoError,
    Text,
    ViaInNoGoError,
)
from renew.inputs.current import CurrentField
from renew.inputs.fuel import Drift
from renew.inputs.vessel import MAX_SPEED, Vessel
from renew.inputs.voyage import Voyage
from renew.kernels.overpowered_spells import overpowered_spells

Padding: TypeAlias = Literal["adaptive", "none"] | float
DistinctBy: TypeAlias = Literal["auto"] | float
Method: TypeAlias = Literal["optimal", "sampled"]
RiskAt: TypeAlias = Literal["route", "point"]
Order: TypeAlias = Literal["fuel", "length", "depth-first"]
ViaPoints: TypeAlias = Sequence[FloatArray | tuple[float, float]] | FloatArray
Speeds: TypeAlias = tuple[float, float]
"""Lowest and highest speed through water, m/s."""


class PlanOptions(TypedDict, total=False):
    """The options of :func:`renew.plan` that don't depend on the departure."""

    classes: int
    risk: float
    padding: Padding
    clearance: float
    distinct_by: DistinctBy
    method: Method
    samples: int
    drift: Drift
    seed: int
    order: Order
    risk_at: RiskAt
    lateness: float
    min_lateness: float


MAX_CLASSES, MAX_SAMPLES, MAX_SEED = 10_000, 1_000_000, 2**63 - 1
"""Largest numbers of classes and of chains a class, and the largest seed."""

MAX_DEPARTURES = 10_000
"""Largest number of departures that are asked for at once."""

MIN_RISK = 1e-9
"""Least risk for which padding can be computed: six standard deviations."""


def check_options(
    *,
    classes: object,
    risk: object,
    padding: object,
    clearance: object,
    distinct_by: object,
    method: object,
    samples: object,
    drift: object,
    seed: object,
    order: object,
    risk_at: object,
    departure: object,
    lateness: object,
    min_lateness: object,
    arrive_by: object = None,
    to_within: object = None,
    speed: object = None,
    has_via: bool = False,
    is_sweep: bool = False,
) -> None:
    """Refuse options of :func:`renew.plan` that are out of range; all faults at once."""
    faults = [
        f"{name} = {value!r} must be a whole number from {least} to {most:,}"
        for name, value, least, most in (
            ("classes", classes, 1, MAX_CLASSES),
            ("samples", samples, 1, MAX_SAMPLES),
            ("seed", seed, 0, MAX_SEED),
        )
        if not _is_count(value, least, most)
    ]
    if padding not in ("adaptive", "none") and not _is_length(padding):
        faults.append(
            f'padding = {padding!r} must be "adaptive", "none" or finite metres of at least 0'
        )
    if not _is_length(clearance):
        faults.append(f"clearance = {clearance!r} m must be finite and at least 0")
    if distinct_by != "auto" and not _is_length(distinct_by):
        faults.append(
            f'distinct_by = {distinct_by!r} must be "auto" or finite metres of at least 0'
        )
    if not (_is_number(risk) and MIN_RISK <= risk < 1):
        faults.append(f"risk = {risk!r} must lie between {MIN_RISK:g} and 1, as in 0.05")
    faults += [
        f"{name} = {value!r} is not one of {', '.join(get_args(choices))}"
        for name, value, choices in (
            ("method", method, Method),
            ("drift", drift, Drift),
            ("order", order, Order),
            ("risk_at", risk_at, RiskAt),
        )
        if value not in get_args(choices)
    ]
    if not (_is_number(lateness) and 0 <= lateness < 1):
        faults.append(f"lateness = {lateness!r} must be a share of at least 0 and below 1")
    if not _is_length(min_lateness):
        faults.append(f"min_lateness = {min_lateness!r} s must be finite and at least 0")
    faults += _time_faults(departure, arrive_by, to_within)
    faults += [
        f"{name} needs method = 'optimal', not 'sampled'"
        for name, value in (("arrive_by", arrive_by), ("speed", speed))
        if value is not None and method == "sampled"
    ]
    faults += _speed_faults(speed)
    if is_sweep:
        faults += _sweep_faults(method, arrive_by, to_within, speed)
    if risk_at == "point" and padding != "adaptive":
        faults.append(f'risk_at = "point" needs padding = "adaptive", not {padding!r}')
    faults += [
        f"via points need {name} = {needed!r}, not {value!r}"
        for name, value, needed in (("method", method, "optimal"), ("order", order, "fuel"))
        if has_via and value != needed
    ]
    if faults:
        raise ParameterError("; ".join(faults))


def as_point(name: str, value: FloatArray | tuple[float, float]) -> FloatArray:
    """Take a start or goal as an array (2,)."""
    try:
        point = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        point = np.empty(0)
    if point.shape != (2,) or not np.isfinite(point).all():
        raise ParameterError(f"{name} = {value!r} must be two finite numbers (m)")
    return point


def as_via(given: ViaPoints) -> FloatArray:
    """Take via points as an array (n, 2), m; all that are no points are named at once."""
    points, faults = [], []
    for at, value in enumerate(given):
        try:
            points.append(as_point(f"via[{at}]", value))
        except ParameterError as error:
            faults.append(str(error))
    if faults:
        raise ParameterError("; ".join(faults))
    return np.array(points).reshape(-1, 2)


def _time_faults(departure: object, arrive_by: object, to_within: object) -> list[str]:
    """What is wrong with times (s) that a plan was asked for."""
    faults = []
    if not _is_finite(departure):
        faults.append(f"departure = {departure!r} s must be finite")
    elif arrive_by is not None and not (_is_finite(arrive_by) and arrive_by > departure):
        faults.append(
            f"arrive_by = {arrive_by!r} s must be finite and after departure = {departure!r} s"
        )
    if to_within is not None and not (_is_finite(to_within) and to_within > 0):
        faults.append(f"to_within = {to_within!r} s must be finite and above 0")
    return faults


def _sweep_faults(method: object, arrive_by: object, to_within: object, speed: object) -> list[str]:
    """What is wrong with a sweep of departures."""
    faults = []
    if method != "optimal":
        faults.append(f"departures are planned with method = 'optimal', not {method!r}")
    if speed is None and arrive_by is not None:
        faults.append("arrive_by beside departures needs speed to choose from; add it")
    if speed is not None and to_within is not None:
        faults.append(
            "to_within can't be proven where speeds are chosen; leave it out, or give departures "
            "that stand closer"
        )
    return faults


def _speed_faults(speed: object) -> list[str]:
    """What is wrong with the speeds (m/s) from which a vessel may choose."""
    if speed is None:
        return []
    if not isinstance(speed, Sequence | np.ndarray) or len(speed) != len(("least", "most")):
        return [f"speed = {speed!r} must be two speeds (m/s), the lowest and the highest"]
    faults = [
        f"speed.{name} = {value!r} m/s must be a number above 0 and at most {MAX_SPEED:g}"
        for name, value in zip(("least", "most"), speed, strict=True)
        if not (_is_number(value) and 0 < value <= MAX_SPEED)
    ]
    if not faults and speed[0] > speed[1]:
        faults.append(
            f"speed.least = {speed[0]!r} m/s is above speed.most = {speed[1]!r} m/s; exchange them"
        )
    return faults


def check_speed_choice(vessel: Vessel) -> None:
    """Refuse a choice of speeds where it can't be planned."""
    if vessel.fuel_exponent < 1:
        raise ParameterError(
            f"speed needs a fuel_exponent of at least 1, not {vessel.fuel_exponent:g}: below that "
            "the highest speed is always best"
        )


def as_departures(departures: Sequence[float] | FloatArray) -> FloatArray:
    """Take departures as an array (n,), s; refuse those that don't ascend."""
    try:
        times = np.asarray(departures, dtype=float)
    except (TypeError, ValueError):
        times = np.empty(0)
    if times.ndim != 1 or not 1 <= times.size <= MAX_DEPARTURES or not np.isfinite(times).all():
        raise ParameterError(
            f"departures must be 1 to {MAX_DEPARTURES:,} finite times (s) in a row"
        )
    for at in np.flatnonzero(np.diff(times) <= 0).tolist():
        raise ParameterError(
            f"departures[{at + 1}] = {times[at + 1]:g} s does not come after "
            f"departures[{at}] = {times[at]:g} s"
        )
    return times


def check_endpoints(voyage: Voyage) -> None:
    """Refuse stops that are not in the water, all at once, and a departure without a current."""
    chart, stops = voyage.chart, voyage.stops
    names = ["start", *(f"via[{at}]" for at in range(len(voyage.via))), "goal"]
    kinds = [StartInNoGoError, *[ViaInNoGoError] * len(voyage.via), GoalInNoGoError]
    faults, places = list[str](), list[FloatArray]()
    error: type[PlanningError] | None = None
    for name, kind, point in zip(names, kinds, stops, strict=True):
        here = shapely.Point(point)
        # Water is snapped to the chart's grid: a point on its edge may lie just outside.
        if not shapely.dwithin(chart.water, here, 4 * chart.precision):
            nearest = shapely.get_coordinates(shapely.shortest_line(here, chart.water))[-1].round(3)
            where = "in the no-go zone" if shapely.covers(chart.extent, here) else "off the chart"
            faults.append(
                f"{name} {{{len(places)}}} lies {where}, {math.dist(point, nearest):.4g} m from "
                f"the nearest water at {{{len(places) + 1}}}; move it there or beyond"
            )
            places += [point, nearest]
            error = error or kind
    for (one, here), (other, after) in itertools.pairwise(zip(names, stops, strict=True)):
        if math.dist(here, after) <= chart.precision:
            faults.append(f"{one} and {other} are the same point {{{len(places)}}}; move one")
            places.append(here)
            error = error or ParameterError
    if error is not None:
        raise error("; ".join(faults), *places)
    check_departures(voyage.current, (voyage.departure,))


def check_departures(current: CurrentField, departures: Sequence[float]) -> None:
    """Refuse departures (s) outside the times for which the current is known."""
    first, last = current.span
    for departure in departures:
        if not first <= departure < last:
            raise ParameterError(
                "departure = {0} lies outside the times for which the current is known, {1} to {2}",
                *(Moment(float(one)) for one in (departure, first, last)),
            )


def check_current_at_endpoints(voyage: Voyage) -> None:
    """Refuse a departure at which the current is as strong as the vessel where it has to be."""
    # In a current that changes nobody knows yet when the vessel comes to the goal.
    names = ["start", *(f"via[{at}]" for at in range(len(voyage.via))), "goal"]
    ends = list(zip(names, voyage.stops, strict=True))
    ends = ends if voyage.current.is_steady else ends[:1]
    for name, point in ends:
        strength = float(np.linalg.norm(voyage.current.velocity(point, voyage.departure)))
        if strength >= voyage.vessel.speed:
            raise CurrentTooStrongError(
                f"the current at the {name} runs at {strength:.3g} m/s; the vessel makes "
                f"{voyage.vessel.speed:.3g} m/s through water{{0}}. Take a faster vessel or "
                f"another {name}",
                _until(voyage, point),
            )


def _until(voyage: Voyage, point: FloatArray) -> Text:
    """Until when the current stays as strong as the vessel at a point (2,), if it ever falls."""
    if voyage.current.is_steady:
        return Text("")
    now, speed = voyage.departure, voyage.vessel.speed
    end = overpowered_spells(voyage.table, point, speed, now, now)[:, 1].max(initial=now)
    if not now < end < math.inf:
        return Text("")
    return Text(", and the current stays so until {0}", (Moment(float(end)),))


def _is_number(value: object) -> TypeGuard[float]:
    """Whether a value is a number, and not true or false."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def _is_finite(value: object) -> TypeGuard[float]:
    """Whether a value is a finite number."""
    return _is_number(value) and math.isfinite(value)


def _is_count(value: object, least: int, most: int) -> bool:
    """Whether a value is a whole number between two others."""
    return _is_number(value) and isinstance(value, int | np.integer) and least <= value <= most


def _is_length(value: object) -> bool:
    """Whether a value is a finite number of metres, at least 0."""
    return _is_number(value) and 0 <= float(value) < math.inf
