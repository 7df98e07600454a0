"""Currents that change with time: slices with linear change between them, functions, a gyre.

Times are seconds on the field's own clock; a plan's departure and arrivals use the same clock.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from renew._types import FloatArray
from renew.errors import ParameterError, as_floats, shown
from renew.inputs.current import (
    CurrentField,
    CurrentLike,
    TabulatedCurrent,
    as_field,
    check_finite,
    checked_velocity,
)
from renew.inputs.tabulation import tabulated_in_time
from renew.kernels.current_table import CurrentTable, same_axes, table_of

VaryingFunction: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]
"""Velocity (..., 2) m/s at points (..., 2) m and times (...) s."""

# Number of slices of a periodic field in one period: linear change between them errs by 0.1 %.
_SLICES_A_PERIOD = 64


class VaryingCurrent(CurrentField):
    """A current that changes with time, known from the first to the last of some times.

    Parameters
    ----------
    times : array_like
        Strictly ascending times (nt,), s, two at least.
    currents : sequence or callable
        One steady field per time, with linear change in between; or one function of points (..., 2)
        and times (...), which is sampled at `times`.

    Raises
    ------
    ParameterError
        Times that don't ascend or aren't finite, or another number of fields than of times.
    """

    def __init__(
        self, times: FloatArray | Sequence[float], currents: Sequence[CurrentLike] | VaryingFunction
    ) -> None:
        self._times = as_floats("varying current: times", times).copy()
        faults = _faults(self._times)
        if callable(currents):
            self._function: VaryingFunction | None = currents
            self._slices: tuple[CurrentField, ...] = ()
        else:
            if not isinstance(currents, Sequence):
                raise ParameterError(
                    f"varying current: currents = {shown(currents)} must be a field for each time "
                    "in a row, or one function"
                )
            self._slices = tuple(map(as_field, currents))
            self._function = None
            if len(self._slices) != self._times.size:
                faults.append(f"{len(self._slices)} currents for {self._times.size} times")
            if not all(one.is_steady for one in self._slices):
                faults.append("each of the currents must be steady")
        if faults:
            raise ParameterError("varying current: " + "; ".join(faults))

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2) at time 0."""
        return self.velocity(points, 0.0)

    def velocity(self, points: FloatArray, time: float | FloatArray) -> FloatArray:
        """Velocity (..., 2) at points (..., 2) and times (...), s; held outside its span."""
        points = np.asarray(points, dtype=float)
        times = np.clip(np.broadcast_to(time, points.shape[:-1]), self._times[0], self._times[-1])
        # A function may write into what it gets.
        return checked_velocity(points, (self._function or self._between)(points.copy(), times))

    @property
    def slice_times(self) -> FloatArray:
        """Times (nt,), s."""
        return self._times

    @property
    def span(self) -> tuple[float, float]:
        """The first and the last time, s."""
        return float(self._times[0]), float(self._times[-1])

    @property
    def slices(self) -> tuple[CurrentField, ...]:
        """The steady fields between which it changes linearly; none if it is a function."""
        return self._slices

    def table(self, bounds: tuple[float, float, float, float]) -> CurrentTable:
        """The field as nodes, a slice for each time."""
        if self._slices and all(one is self._slices[0] for one in self._slices):
            return self._slices[0].table(bounds)
        return self._nodes or tabulated_in_time(self.velocity, self._times, bounds)

    @cached_property
    def _nodes(self) -> CurrentTable | None:
        """All slices as one table, if their tables have the same nodes; else None."""
        nodes = [one.nodes for one in self._slices if isinstance(one, TabulatedCurrent)]
        if len(nodes) != self._times.size or not all(same_axes(nodes[0], one) for one in nodes):
            return None
        uv = np.concatenate([one.uv for one in nodes])
        return table_of(nodes[0].x, nodes[0].y, uv, times=self._times)

    def _between(self, points: FloatArray, times: FloatArray) -> FloatArray:
        """Velocity (..., 2), linear between slices."""
        if self._nodes is not None:
            return TabulatedCurrent(self._nodes).velocity(points, times)
        flat, when = points.reshape(-1, 2), times.ravel()
        at = np.clip(np.searchsorted(self._times, when, side="right") - 1, 0, len(self._slices) - 2)
        share = (when - self._times[at]) / np.diff(self._times)[at]
        velocity = np.zeros(flat.shape)
        for k in np.unique(np.concatenate([at, at + 1])):
            weight = np.where(at == k, 1 - share, np.where(at + 1 == k, share, 0.0))
            some = weight > 0
            velocity[some] += weight[some, None] * self._slices[k](flat[some])
        return velocity.reshape(points.shape)


@dataclass(frozen=True, slots=True)
class SwingingGyre(CurrentField):
    """Two gyres side by side whose border swings to and fro (Shadden, Lekien & Marsden, 2005).

    On the rectangle from (0, 0) to (width, height), in units of X = 2 x/width and Y = y/height:
    ψ = A sin(π f) sin(π Y), f = ε sin(ωt) X² + (1 - 2 ε sin(ωt)) X; u = -∂ψ/∂Y, v = ∂ψ/∂X, each
    for a width of two heights. A is `amplitude` (m/s), ε is `epsilon`, ω is `omega` (rad/s).
    """

    amplitude: float
    width: float
    height: float
    epsilon: float
    omega: float

    def __post_init__(self) -> None:
        """Refuse figures that are not finite, and a rectangle without area."""
        check_finite(
            "swinging gyre",
            amplitude=self.amplitude,
            width=self.width,
            height=self.height,
            epsilon=self.epsilon,
            omega=self.omega,
        )
        if self.width <= 0 or self.height <= 0:
            raise ParameterError(
                f"swinging gyre: width = {self.width!r} and height = {self.height!r} m must be "
                "above 0"
            )

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2) at time 0."""
        return self.velocity(points, 0.0)

    def velocity(self, points: FloatArray, time: float | FloatArray) -> FloatArray:
        """Velocity (..., 2) at points (..., 2) and times (...), s."""
        points = np.asarray(points, dtype=float)
        x, y = 2 * points[..., 0] / self.width, np.pi * points[..., 1] / self.height
        swing = self.epsilon * np.sin(self.omega * np.asarray(time, dtype=float))
        f, slope = swing * x**2 + (1 - 2 * swing) * x, 2 * swing * (x - 1) + 1
        u = -np.sin(np.pi * f) * np.cos(y)
        v = np.cos(np.pi * f) * np.sin(y) * slope * (2 * self.height / self.width)
        return np.asarray(np.pi * self.amplitude * np.stack([u, v], axis=-1))

    @property
    def slice_times(self) -> FloatArray:
        """Times (nt,), s, over one period; one if it does not swing."""
        if self.period == math.inf:
            return np.zeros(1)
        return np.linspace(0.0, self.period, _SLICES_A_PERIOD + 1)

    def table(self, bounds: tuple[float, float, float, float]) -> CurrentTable:
        """The field as nodes, over one period."""
        return tabulated_in_time(self.velocity, self.slice_times, bounds, self.period)

    @property
    def period(self) -> float:
        """Time (s) after which it repeats itself."""
        return 2 * math.pi / abs(self.omega) if self.omega and self.epsilon else math.inf


def _faults(times: FloatArray) -> list[str]:
    """Return the faults of a current's times, each with the values concerned."""
    if times.ndim != 1 or times.size <= 1:
        return [f"times have shape {times.shape}; there must be two or more in a row"]
    if not np.isfinite(times).all():
        return [f"times[{int((~np.isfinite(times)).argmax())}] is not finite"]
    return [
        f"times[{k + 1}] = {times[k + 1]:g} s does not come after times[{k}] = {times[k]:g} s"
        for k in np.flatnonzero(np.diff(times) <= 0).tolist()
    ]
