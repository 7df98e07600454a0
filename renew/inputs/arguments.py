"""What a plan may be asked for, checked before anything is computed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, TypeAlias, TypedDict, TypeGuard, get_args

import numpy as np

from renew._types import FloatArray
from renew.errors import ParameterError
from renew.inputs.chart import Chart
from renew.inputs.figures import as_floats, check_kind, is_finite, is_number, shown
from renew.inputs.fuel import Drift
from renew.inputs.shut_area import ShutArea
from renew.inputs.vessel import MAX_SPEED, Vessel

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

MAX_STATIONS = 1_000_000
"""Largest number of points along a route from which turns are flown."""

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
        f"{name} = {shown(value)} must be a whole number from {least} to {most:,}"
        for name, value, least, most in (
            ("classes", classes, 1, MAX_CLASSES),
            ("samples", samples, 1, MAX_SAMPLES),
        )
        if not _is_count(value, least, most)
    ]
    faults += _seed_faults(seed)
    if not _is_one_of(padding, ("adaptive", "none")) and not _is_length(padding):
        faults.append(
            f'padding = {shown(padding)} must be "adaptive", "none" or finite metres of at least 0'
        )
    if not _is_length(clearance):
        faults.append(f"clearance = {shown(clearance)} m must be finite and at least 0")
    if not _is_one_of(distinct_by, ("auto",)) and not _is_length(distinct_by):
        faults.append(
            f'distinct_by = {shown(distinct_by)} must be "auto" or finite metres of at least 0'
        )
    if not (is_number(risk) and MIN_RISK <= risk < 1):
        faults.append(f"risk = {shown(risk)} must lie between {MIN_RISK:g} and 1, as in 0.05")
    faults += [
        f"{name} = {shown(value)} is not one of {', '.join(get_args(choices))}"
        for name, value, choices in (
            ("method", method, Method),
            ("drift", drift, Drift),
            ("order", order, Order),
            ("risk_at", risk_at, RiskAt),
        )
        if not _is_one_of(value, get_args(choices))
    ]
    faults += _punctuality_faults(lateness, min_lateness)
    faults += _time_faults(departure, arrive_by, to_within)
    faults += [
        f"{name} needs method = 'optimal', not 'sampled'"
        for name, value in (("arrive_by", arrive_by), ("speed", speed))
        if value is not None and _is_one_of(method, ("sampled",))
    ]
    faults += _speed_faults(speed)
    if is_sweep:
        faults += _sweep_faults(method, arrive_by, to_within, speed)
    if _is_one_of(risk_at, ("point",)) and not _is_one_of(padding, ("adaptive",)):
        faults.append(f'risk_at = "point" needs padding = "adaptive", not {shown(padding)}')
    faults += [
        f"via points need {name} = {needed!r}, not {shown(value)}"
        for name, value, needed in (("method", method, "optimal"), ("order", order, "fuel"))
        if has_via and not _is_one_of(value, (needed,))
    ]
    if faults:
        raise ParameterError("; ".join(faults))


def check_objects(chart: Chart, vessel: Vessel, avoid: Sequence[ShutArea]) -> None:
    """Refuse what is no chart, no vessel and no row of areas."""
    check_kind("chart", chart, Chart)
    check_kind("vessel", vessel, Vessel)
    if not _is_row(avoid):
        raise ParameterError(f"avoid = {shown(avoid)} must be areas in a row, as in [area]")
    for at, area in enumerate(avoid):
        check_kind(f"avoid[{at}]", area, ShutArea)


def check_turns(
    chart: Chart,
    vessel: Vessel,
    length: float,
    *,
    spacing: object,
    seed: object,
    late: tuple[object, object],
) -> None:
    """Refuse what :func:`renew.contingency` can't fly, along a path of a length (m).

    `late` are the share of the time and the time (s) by which the vessel may be so.
    """
    check_objects(chart, vessel, ())
    faults = _punctuality_faults(*late) + _seed_faults(seed)
    if not (is_finite(spacing) and spacing > 0):
        faults.append(f"spacing = {shown(spacing)} m must be finite and above 0")
    elif length > MAX_STATIONS * spacing:
        faults.append(
            f"spacing = {spacing:g} m is too close for a path of {length:.4g} m: turns would begin "
            f"at more than {MAX_STATIONS:,} points; take {length / MAX_STATIONS:.2g} m or more"
        )
    if faults:
        raise ParameterError("; ".join(faults))


def _seed_faults(seed: object) -> list[str]:
    """What is wrong with the seed of draws."""
    if _is_count(seed, 0, MAX_SEED):
        return []
    return [f"seed = {shown(seed)} must be a whole number from 0 to {MAX_SEED:,}"]


def check_seed(seed: object) -> None:
    """Refuse what is no seed of draws."""
    for fault in _seed_faults(seed):
        raise ParameterError(fault)


def _punctuality_faults(lateness: object, min_lateness: object) -> list[str]:
    """What is wrong with how late the vessel may be."""
    faults = []
    if not (is_finite(lateness) and 0 <= lateness < 1):
        faults.append(f"lateness = {shown(lateness)} must be a share of at least 0 and below 1")
    if not _is_length(min_lateness):
        faults.append(f"min_lateness = {shown(min_lateness)} s must be finite and at least 0")
    return faults


def as_point(name: str, value: FloatArray | tuple[float, float]) -> FloatArray:
    """Take a start or goal as an array (2,)."""
    point = as_floats(name, value)
    if point.shape != (2,) or not np.isfinite(point).all():
        raise ParameterError(f"{name} = {shown(value)} must be two finite numbers (m)")
    return point


def as_via(given: ViaPoints) -> FloatArray:
    """Take via points as an array (n, 2), m; all that are no points are named at once."""
    if not _is_row(given):
        raise ParameterError(f"via = {shown(given)} must be points (m) in a row, as in [(x, y)]")
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
    if not is_finite(departure):
        faults.append(f"departure = {shown(departure)} s must be finite")
    elif arrive_by is not None and not (is_finite(arrive_by) and arrive_by > departure):
        faults.append(
            f"arrive_by = {shown(arrive_by)} s must be finite and after departure = {departure!r} s"
        )
    if to_within is not None and not (is_finite(to_within) and to_within > 0):
        faults.append(f"to_within = {shown(to_within)} s must be finite and above 0")
    return faults


def _sweep_faults(method: object, arrive_by: object, to_within: object, speed: object) -> list[str]:
    """What is wrong with a sweep of departures."""
    faults = []
    if not _is_one_of(method, ("optimal",)):
        faults.append(f"departures are planned with method = 'optimal', not {shown(method)}")
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
    if not _is_row(speed) or len(speed) != len(("least", "most")):
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
    times = as_floats("departures", departures)
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


def _is_one_of(value: object, choices: tuple[str, ...]) -> bool:
    """Whether a value is one of some words."""
    return isinstance(value, str) and value in choices


def _is_row(value: object) -> TypeGuard[Sequence[Any] | FloatArray]:
    """Whether a value is a row of others, and not text."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def _is_count(value: object, least: int, most: int) -> bool:
    """Whether a value is a whole number between two others."""
    return is_number(value) and isinstance(value, int | np.integer) and least <= value <= most


def _is_length(value: object) -> bool:
    """Whether a value is a finite number of metres, at least 0."""
    return is_finite(value) and value >= 0
