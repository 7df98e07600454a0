"""Constants of tidal streams, fitted by least squares to a user's own hourly currents.

At each node the current to east is mean + Σ f Re[c exp(i (V + u))], with c = u_re + i u_im, and the
current to north likewise. `renew.inputs.tide.arguments` gives the factor f, the argument V and the
nodal angle u for each hour, so that a series longer than a year needs no mean nodal factor. The
normal equations are summed as the file is read. By Rayleigh's criterion a series separates two
constituents if one makes a turn more than the other within the series.
"""

from collections.abc import Iterator, Sequence
from datetime import timedelta
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

import renew
from pipeline._types import Dataset, FloatArray
from pipeline.errors import RequestError, refuse_any
from pipeline.sources.cf.axes import TimeSteps, label
from pipeline.sources.cf.contents import Contents, find_files, name_of, read_contents
from pipeline.sources.cf.fields import FieldReader, find_window
from renew.inputs.tide import Instants, arguments, speeds

ComplexArray: TypeAlias = npt.NDArray[np.complex128]

CONSTITUENTS = (
    *("M2", "K1", "S2", "O1", "N2", "P1", "K2", "Q1", "NU2", "M4", "MS4", "MN4", "L2", "T2"),
    *("MU2", "2N2", "J1", "M1", "OO1", "RHO", "LAM2", "M6", "S4", "MK3", "2MK3", "2SM2", "M3"),
    *("S1", "R2", "2Q1", "S6", "M8", "MF", "MM", "MSF", "SSA", "SA"),
)
"""Constituents by their weight in most waters: of two that a series can't separate, the first
is fitted, and includes the other."""
# Shortest series, days: M2 and N2 can be separated after 27.6, and M2 and S2 after 14.8.
_LEAST_DAYS = 29.0
_HOUR = timedelta(hours=1)
# Largest deviation of the time step from an hour: times stored as float32 days deviate.
_SLACK = timedelta(minutes=2)
_COMMENT = (
    "u = u_mean + sum of f Re((u_re + i u_im) exp(i (V + u))), v alike, with f, V and u of "
    "Schureman (1940): the amplitude is the modulus, the phase lag at Greenwich minus the argument"
)


def fit_files(paths: Sequence[str]) -> Dataset:
    """Fit constants at each node of hourly currents in files that belong together.

    Returns `u_re`, `u_im`, `v_re` and `v_im` (constituent, lat, lon), m/s; `u_mean` and `v_mean`,
    `residual_rms` of both components together, m/s, and `variance_share` (lat, lon). They are NaN
    where a step has no current. Raises RequestError if the files can't be used, or their series are
    too short, have holes or are not hourly: one line for each fault.
    """
    files = find_files(paths)
    contents = read_contents(files)
    try:
        refuse_any([f"{name_of(files)}: {fault}" for fault in _series_faults(contents.steps)])
        return _fitted(contents)
    except (renew.ParameterError, ValueError) as error:
        raise RequestError(f"{name_of(files)}: {error}") from None


def separable(days: float, interval: timedelta) -> tuple[str, ...]:
    """Return the constituents that a series tells apart, by Rayleigh's and Nyquist's criterion."""
    turn = 360.0 / (24 * days)
    chosen: dict[str, float] = {}
    for name, speed in zip(CONSTITUENTS, speeds(CONSTITUENTS), strict=True):
        is_slow = speed * (interval / _HOUR) < 180
        if is_slow and all(abs(speed - other) >= turn for other in (0.0, *chosen.values())):
            chosen[name] = float(speed)
    return tuple(chosen)


def _series_faults(steps: TimeSteps) -> Iterator[str]:
    """Say why a series can't be fitted."""
    moments = steps.moments
    if len(moments) < 2:
        yield f"it has {steps.span}; give {_LEAST_DAYS:g} days of hourly currents at least"
        return
    interval = steps.interval
    days = (moments[-1] - moments[0] + interval) / timedelta(days=1)
    apart = ", ".join(separable(days, interval)) or "no constituent at all"
    if interval > _HOUR + _SLACK:
        hours = interval / _HOUR
        yield (
            f"its steps are {hours:g} hours apart, which separate only {apart}; "
            "give hourly currents"
        )
    if days < _LEAST_DAYS:
        yield (
            f"it has {days:.1f} days, fewer than {_LEAST_DAYS:g}; they separate only {apart}, "
            "each mixed with its neighbours; give a longer series, best a year"
        )
    holes = [pair for pair in pairwise(moments) if pair[1] - pair[0] > interval + _SLACK]
    if holes:
        begin, end = max(holes, key=lambda pair: pair[1] - pair[0])
        yield (
            f"it has {len(holes)} hole{'s' * (len(holes) > 1)}, the longest from {label(begin)} "
            f"to {label(end)}; fill them, or give the longest series without"
        )


def _fitted(contents: Contents) -> Dataset:
    """Fit the constants of all nodes at once; ValueError if a file is damaged."""
    import xarray as xr

    steps = contents.steps
    moments = np.array([moment.replace(tzinfo=None) for moment in steps.moments], "datetime64[us]")
    names = separable(len(moments) * (steps.interval / timedelta(days=1)), steps.interval)
    design = _design(names, moments, steps.width)
    contents = contents.on_axes(contents.bounds)
    bounds = (contents.lon.min(), contents.lat.min(), contents.lon.max(), contents.lat.max())
    window = find_window(contents.lon, contents.lat, bounds)
    with FieldReader(contents, window) as reader:
        solved = _solved(design, reader.blocks(range(len(moments))))
    constants, (u_mean, v_mean), (u_left, v_left), (u_about, v_about) = solved
    u, v = constants[:, 0], constants[:, 1]
    # A node that lacks a component at any step has no constants.
    gap = np.where(np.isfinite(u_left + v_left), 0.0, np.nan)
    left, about = u_left + v_left + gap, u_about + v_about
    grid, m_s = ("lat", "lon"), {"units": "m s-1"}
    share = 1 - left / np.where(about > 0, about, np.inf)
    return xr.Dataset(
        {
            "u_re": (("constituent", *grid), u.real + gap, m_s),
            "u_im": (("constituent", *grid), u.imag + gap, m_s),
            "v_re": (("constituent", *grid), v.real + gap, m_s),
            "v_im": (("constituent", *grid), v.imag + gap, m_s),
            "u_mean": (grid, u_mean + gap, m_s),
            "v_mean": (grid, v_mean + gap, m_s),
            "residual_rms": (grid, np.sqrt(left / len(moments)), m_s),
            "variance_share": (grid, share, {"units": "1"}),
        },
        {
            "constituent": list(names),
            "lat": ("lat", window.lat, {"units": "degrees_north", "standard_name": "latitude"}),
            "lon": ("lon", window.lon, {"units": "degrees_east", "standard_name": "longitude"}),
        },
        {
            "Conventions": "CF-1.11",
            "title": "Harmonic constants of tidal streams",
            "source": name_of(contents.files),
            "time_coverage_start": steps.moments[0].isoformat(),
            "time_coverage_end": steps.moments[-1].isoformat(),
            "comment": _COMMENT,
        },
    )


def _design(names: Sequence[str], moments: Instants, width: timedelta | None) -> FloatArray:
    """Return the columns (steps, 1 + 2 constituents) of which the series is a weighted sum.

    If steps have a width, a constituent's mean over a step is its current in the middle of the step
    multiplied by the sinc of half the angle by which it turns within the step.
    """
    factors, angles = arguments(names, moments)
    if width is not None:
        factors = factors * np.sinc(speeds(names)[:, None] * (width / _HOUR) / 360)
    ones = np.ones((1, len(moments)))
    return np.concatenate([ones, factors * np.cos(angles), -factors * np.sin(angles)]).T


def _solved(
    design: FloatArray, blocks: Iterator[tuple[list[int], FloatArray]]
) -> tuple[ComplexArray, FloatArray, FloatArray, FloatArray]:
    """Solve the normal equations of both components; NaN where a step has no value.

    Returns their constants (constituents, 2, ny, nx), their means (2, ny, nx), and the sums of
    squares (2, ny, nx) that the fit leaves, and of the series about their means.
    """
    right, squares, first = np.zeros(()), np.zeros(()), np.zeros(())
    for number, (rows, values) in enumerate(blocks):
        if number == 0:
            # Squares are summed about the first step, so that a large mean does not cost digits.
            first = values[0]
        apart = values - first
        right = right + np.tensordot(design[rows], apart, axes=(0, 0))
        squares = squares + (apart**2).sum(axis=0)
    shape = (len(right), -1)
    solution = np.linalg.solve(design.T @ design, right.reshape(shape)).reshape(right.shape)
    half = (len(solution) + 1) // 2
    return (
        solution[1:half] + 1j * solution[half:],
        first + solution[0],
        np.maximum(squares - (solution * right).sum(axis=0), 0.0),
        np.maximum(squares - right[0] ** 2 / len(design), 0.0),
    )
