"""What a plan may be asked for, checked before anything is computed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeGuard

import numpy as np

from renew._types import FloatArray
from renew.errors import ParameterError
from renew.inputs.chart import Chart
from renew.inputs.figures import as_floats, check_kind, is_finite, is_number, shown
from renew.inputs.options import PlanOptions, count_faults, is_one_of, punctuality_faults
from renew.inputs.shut_area import ShutArea
from renew.inputs.vessel import MAX_SPEED, Vessel

ViaPoints: TypeAlias = Sequence[FloatArray | tuple[float, float]] | FloatArray
Speeds: TypeAlias = tuple[float, float]
"""Lowest and highest speed through water, m/s."""

MAX_STATIONS = 1_000_000
"""Largest number of points along a route from which turns are flown."""

MAX_DEPARTURES = 10_000
"""Largest number of departures that are asked for at once."""


@dataclass(frozen=True, kw_only=True)
class Request(PlanOptions):
    """Options, times (s) and speeds (m/s) of one plan, so that the faults of all are named at once.

    `is_sweep` says that it is asked for several departures, of which `departure` is the first.
    """

    departure: float = 0.0
    arrive_by: float | None = None
    to_within: float | None = None
    speed: Speeds | None = None
    has_via: bool = False
    is_sweep: bool = False

    def _faults(self) -> list[str]:
        """What is wrong with the options, and with what is asked for beside them."""
        found = super()._faults()
        found += _time_faults(self.departure, self.arrive_by, self.to_within)
        found += [
            f"{name} needs method = 'optimal', not 'sampled'"
            for name in ("arrive_by", "speed")
            if getattr(self, name) is not None and is_one_of(self.method, ("sampled",))
        ]
        found += _speed_faults(self.speed)
        if self.is_sweep:
            found += self._sweep_faults()
        return found + [
            f"via points need {name} = {needed!r}, not {shown(value)}"
            for name, value, needed in (
                ("method", self.method, "optimal"),
                ("order", self.order, "fuel"),
            )
            if self.has_via and not is_one_of(value, (needed,))
        ]

    def _sweep_faults(self) -> list[str]:
        """What is wrong with a sweep of departures."""
        found = []
        if not is_one_of(self.method, ("optimal",)):
            found.append(
                f"departures are planned with method = 'optimal', not {shown(self.method)}"
            )
        if self.speed is None and self.arrive_by is not None:
            found.append("arrive_by beside departures needs speed to choose from; add it")
        if self.speed is not None and self.to_within is not None:
            found.append(
                "to_within can't be proven where speeds are chosen; leave it out, or give "
                "departures that stand closer"
            )
        return found


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
    faults = punctuality_faults(*late) + count_faults("seed", seed)
    if not (is_finite(spacing) and spacing > 0):
        faults.append(f"spacing = {shown(spacing)} m must be finite and above 0")
    elif length > MAX_STATIONS * spacing:
        faults.append(
            f"spacing = {spacing:g} m is too close for a path of {length:.4g} m: turns would begin "
            f"at more than {MAX_STATIONS:,} points; take {length / MAX_STATIONS:.2g} m or more"
        )
    if faults:
        raise ParameterError("; ".join(faults))


def check_seed(seed: object) -> None:
    """Refuse what is no seed of draws."""
    for fault in count_faults("seed", seed):
        raise ParameterError(fault)


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


def _is_row(value: object) -> TypeGuard[Sequence[Any] | FloatArray]:
    """Whether a value is a row of others, and not text."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)
