"""Arguments beside the options of a plan: objects, points, departures and turns, checked."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from renew._types import FloatArray
from renew.errors import ParameterError, as_floats, check_kind, is_finite, shown
from renew.inputs.chart import Chart
from renew.inputs.options import count_faults, is_row, punctuality_faults
from renew.inputs.shut_areas import ShutArea
from renew.inputs.tidal_depth import TidalDepth
from renew.inputs.vessel import Vessel

MAX_STATIONS = 1_000_000
"""Largest number of points along a route from which turns are simulated."""
MAX_DEPARTURES = 10_000
"""Largest number of departures that are asked for at once."""

ViaPoints: TypeAlias = Sequence[FloatArray | tuple[float, float]] | FloatArray


def check_objects(
    chart: Chart, vessel: Vessel, avoid: Sequence[ShutArea] = (), depth: TidalDepth | None = None
) -> None:
    """Refuse a chart, vessel, areas or depth of another type."""
    check_kind("chart", chart, Chart)
    check_kind("vessel", vessel, Vessel)
    if not is_row(avoid):
        raise ParameterError(f"avoid = {shown(avoid)} must be areas in a row, as in [area]")
    for at, area in enumerate(avoid):
        check_kind(f"avoid[{at}]", area, ShutArea)
    if depth is not None:
        check_kind("depth", depth, TidalDepth)


def check_turns(
    chart: Chart,
    vessel: Vessel,
    length: float,
    *,
    spacing: object,
    seed: object,
    late: tuple[object, object],
) -> None:
    """Refuse arguments with which :func:`renew.contingency` can't simulate turns.

    The path is `length` m long; `late` are the share of the time and the time (s) by which the
    vessel may be late.
    """
    check_objects(chart, vessel)
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
    """Refuse a value that can't be a seed."""
    for fault in count_faults("seed", seed):
        raise ParameterError(fault)


def as_point(name: str, value: FloatArray | tuple[float, float]) -> FloatArray:
    """Return a start or goal as an array (2,)."""
    point = as_floats(name, value)
    if point.shape != (2,) or not np.isfinite(point).all():
        raise ParameterError(f"{name} = {shown(value)} must be two finite numbers (m)")
    return point


def as_via(given: ViaPoints) -> FloatArray:
    """Return via points as an array (n, 2), m; the error names all faulty ones."""
    if not is_row(given):
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


def as_departures(departures: Sequence[float] | FloatArray) -> FloatArray:
    """Return departures as an array (n,), s; refuse times that don't ascend."""
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
