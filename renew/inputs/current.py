"""Ocean currents as the planner sees them: velocity at a point, mean and spread in a triangle.

Every field takes points of shape (..., 2) in planar metres and returns velocities of the same
shape in m/s along the plane's axes. A field that changes with time has slices with linear change
between them, or is a function of points and times, in seconds on the field's own clock; a plan's
departure and arrivals use the same clock.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from functools import cached_property, wraps
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from renew._compiled import for_kernels, kernel
from renew._types import FloatArray
from renew.errors import ParameterError, as_floats, is_number, shown
from renew.inputs.tabulation import tabulated, tabulated_in_time
from renew.kernels.capsules import wrapped
from renew.kernels.current_table import CurrentTable, same_axes, table_of, velocities

# Number of rows of the lattice of barycentric coordinates over which a triangle's mean and spread
# are taken: 36 points, vertices included. In the single gyre, paddings are in the median 2.8 %
# wider than with a dense lattice, and none is narrower (`python -m tests.bench draws`).
_LATTICE_ROWS = 8
# Largest number of times in a window over which mean and spread are taken.
_MAX_TIMES = 25
# Largest coordinate or speed (m, m/s): far larger than in any sea, but its square does not
# overflow.
_MAX_FIGURE = 1e12


class CurrentStatistics(NamedTuple):
    """Mean and spread of a current over areas; every array but `mean` (n, 2) has shape (n,).

    `mean`, `speed` and `speed_std` are in m/s; `direction` (of the mean vector, towards) and
    `direction_std` are in radians, anticlockwise from the x axis.
    """

    mean: FloatArray
    speed: FloatArray
    direction: FloatArray
    speed_std: FloatArray
    direction_std: FloatArray


class CurrentField(ABC):
    """A current: call it with points, ask it for the statistics of triangles.

    A steady field defines the call alone. A field that changes also defines `velocity` and
    `slice_times`.
    """

    def __init_subclass__(cls) -> None:
        """Let a user's own field work on copies only; this package's fields change no array."""
        for name in ("__call__", "velocity", "samples", "statistics"):
            if name in vars(cls) and not cls.__module__.startswith("renew."):
                setattr(cls, name, _on_copies(vars(cls)[name]))

    @abstractmethod
    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2) in m/s at points (..., 2) in metres; of a changing field, at time 0."""

    def velocity(self, points: FloatArray, time: float | FloatArray) -> FloatArray:
        """Velocity (..., 2) at points (..., 2) and times (...) in seconds on the field's clock."""
        del time
        return self(points)

    @property
    def slice_times(self) -> FloatArray:
        """Ascending times (nt,), s, between which the field changes nearly linearly.

        A steady field has one.
        """
        return np.zeros(1)

    @property
    def period(self) -> float:
        """Time (s) after which the slices begin again; infinite if they don't."""
        return math.inf

    @property
    def span(self) -> tuple[float, float]:
        """First and last time (s) at which the field is known."""
        return -math.inf, math.inf

    @property
    def is_steady(self) -> bool:
        """Whether it is the same at all times."""
        return len(self.slice_times) == 1

    def table(self, bounds: tuple[float, float, float, float]) -> CurrentTable:
        """The field inside (xmin, ymin, xmax, ymax) as nodes for compiled code."""
        return tabulated(self, bounds)

    def statistics(
        self, triangles: FloatArray, windows: FloatArray | None = None
    ) -> CurrentStatistics:
        """Mean and spread of the current in triangles (n, 3, 2), over windows of time (n, 2), s.

        Without windows, at time 0.
        """
        return sample_statistics(self.samples(triangles, windows))

    def samples(self, triangles: FloatArray, windows: FloatArray | None) -> FloatArray:
        """Velocities (n, samples, 2), m/s, over triangles (n, 3, 2) and windows (n, 2), s."""
        points = np.einsum("lk,nkd->nld", _lattice(), triangles)
        if windows is None or self.is_steady or not len(triangles):
            return self(points)
        longest = float(np.diff(windows, axis=1).max())
        step = float(np.diff(self.slice_times).min())
        count = min(2 + math.ceil(longest / step), _MAX_TIMES)
        times = windows[:, :1] + np.diff(windows, axis=1) * np.linspace(0.0, 1.0, count)
        every = np.broadcast_to(points[:, None], (len(points), count, *points.shape[1:]))
        velocity = self.velocity(every, times[:, :, None])
        return velocity.reshape(len(points), -1, 2)


def _on_copies(method: Callable[..., Any]) -> Callable[..., Any]:
    """Return a method that gets copies of its arguments, and whose answers are copies.

    So the planner's arrays stay as they are, whatever the method writes into, now or later.
    """

    @wraps(method)
    def copied(self: CurrentField, *given: object, **named: object) -> object:
        return deepcopy(method(self, *deepcopy(given), **deepcopy(named)))

    return copied


CurrentLike: TypeAlias = CurrentField | Callable[[FloatArray], FloatArray]


def sample_statistics(velocity: FloatArray) -> CurrentStatistics:
    """Mean and spread over the samples (axis 1) of velocities (n, samples, 2)."""
    return CurrentStatistics(*_sample_statistics(for_kernels(velocity)))


@kernel
def _sample_statistics(
    velocity: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Columns of a CurrentStatistics, compiled."""
    count, samples = velocity.shape[:2]
    mean, speed, direction = np.zeros((count, 2)), np.zeros(count), np.empty(count)
    speed_std, direction_std = np.zeros(count), np.zeros(count)
    for i in range(count):
        for k in range(samples):
            u, v = velocity[i, k]
            mean[i, 0] += u / samples
            mean[i, 1] += v / samples
            speed[i] += math.hypot(u, v) / samples
        direction[i] = math.atan2(mean[i, 1], mean[i, 0])
        for k in range(samples):
            u, v = velocity[i, k]
            strength = math.hypot(u, v)
            speed_std[i] += (strength - speed[i]) ** 2 / samples
            # Deviations from the mean direction are wrapped, and weighted by speed, because the
            # direction of nearly still water hardly matters for the drift.
            deviation = wrapped(math.atan2(v, u) - direction[i])
            if speed[i] > 0.0:
                direction_std[i] += strength / (samples * speed[i]) * deviation**2
    return mean, speed, direction, np.sqrt(speed_std), np.sqrt(direction_std)


def as_field(current: CurrentLike) -> CurrentField:
    """Return a field as it is; wrap a callable (..., 2) m -> (..., 2) m/s as a field."""
    if isinstance(current, CurrentField):
        return current
    if callable(current):
        return FunctionCurrent(current)
    raise ParameterError(
        f"current = {shown(current)} is neither a CurrentField nor a callable; pass "
        "renew.UniformCurrent(0, 0) for still water"
    )


def checked_velocity(points: FloatArray, answer: object) -> FloatArray:
    """Check velocities (..., 2) that a function returned for points (..., 2); return a copy."""
    # The function may return a buffer that its next call writes into.
    velocity = as_floats("current: what the function returned", answer).copy()
    if velocity.shape != points.shape:
        raise ParameterError(
            f"current: for points of shape {points.shape} the function returned shape "
            f"{velocity.shape}; it must return velocities of the points' own shape"
        )
    if not _is_figure(velocity):
        raise ParameterError(
            f"current: not finite, or beyond {_MAX_FIGURE:g} m/s, at {{0}}; fill the field "
            "over the whole extent, land included",
            points[~(np.abs(velocity) <= _MAX_FIGURE).all(axis=-1)][0],
        )
    return velocity


@dataclass(frozen=True, slots=True)
class FunctionCurrent(CurrentField):
    """Any function (..., 2) m -> (..., 2) m/s as a field; its answers are checked."""

    function: Callable[[FloatArray], FloatArray]

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity of the wrapped function."""
        points = np.asarray(points, dtype=float)
        try:
            velocity = self.function(points.copy())  # it may write into what it gets
        except (TypeError, ValueError, LookupError, ArithmeticError) as error:
            raise ParameterError(
                f"current: asked for its velocity at points of shape {points.shape}, the function "
                f"raised {type(error).__name__}: {shown(str(error))}"
            ) from error
        return checked_velocity(points, velocity)


@dataclass(frozen=True, slots=True)
class UniformCurrent(CurrentField):
    """The same current (u, v) in m/s everywhere."""

    u: float
    v: float

    def __post_init__(self) -> None:
        """Refuse a current that is not finite."""
        _check_finite("uniform current", self)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2), the same at every point."""
        shape = np.asarray(points).shape
        return np.broadcast_to(np.array([self.u, self.v], dtype=float), shape).copy()


@dataclass(frozen=True, slots=True)
class GyreCurrent(CurrentField):
    """Gyres on a rectangle from (0, 0) to (width, height): the paper's synthetic currents.

    u = -A sin(πX) cos(πY), v = A cos(πX) sin(πY) with X = columns x/width, Y = rows y/height;
    neighbouring cells turn in opposite senses. A is `amplitude` (m/s), the field's maximum.
    """

    amplitude: float
    width: float
    height: float
    columns: int = 1
    rows: int = 1

    def __post_init__(self) -> None:
        """Refuse figures that are not finite, and a rectangle without area."""
        _check_gyre("gyre", self)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2) at points (..., 2)."""
        points = np.asarray(points, dtype=float)
        x = np.pi * self.columns * points[..., 0] / self.width
        y = np.pi * self.rows * points[..., 1] / self.height
        return self.amplitude * np.stack([-np.sin(x) * np.cos(y), np.cos(x) * np.sin(y)], axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class TabulatedCurrent(CurrentField):
    """A current by its table, for a field that is slow to evaluate."""

    nodes: CurrentTable

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2) by bilinear interpolation at points (..., 2)."""
        return self.velocity(points, 0.0)

    def velocity(self, points: FloatArray, time: float | FloatArray) -> FloatArray:
        """Velocity (..., 2), linear between slices as well, at points (..., 2) and times (...)."""
        points = for_kernels(points)
        times = for_kernels(np.broadcast_to(time, points.shape[:-1]).ravel())
        return velocities(self.nodes, points.reshape(-1, 2), times).reshape(points.shape)

    @property
    def slice_times(self) -> FloatArray:
        """Times of its slices (nt,), s."""
        return self.nodes.times

    @property
    def period(self) -> float:
        """Time (s) after which the slices begin again; infinite if they don't."""
        return self.nodes.period

    def table(self, bounds: tuple[float, float, float, float]) -> CurrentTable:
        """Its own nodes, all of them."""
        del bounds
        return self.nodes


class GriddedCurrent(TabulatedCurrent):
    """A current on a rectilinear grid, bilinear between its nodes, held constant outside.

    Parameters
    ----------
    x, y : array_like
        Strictly ascending node coordinates (m), shapes (nx,) and (ny,), at least two each.
    u, v : array_like
        Velocity along x and along y (m/s), shape (ny, nx), finite everywhere.

    Raises
    ------
    ParameterError
        Wrong shapes, axes that do not ascend, or values that are not finite.
    """

    def __init__(self, x: FloatArray, y: FloatArray, u: FloatArray, v: FloatArray) -> None:
        x, y, u, v = (
            np.ascontiguousarray(as_floats(f"gridded current: {name}", given))
            for name, given in (("x", x), ("y", y), ("u", u), ("v", v))
        )
        if u.shape != v.shape:
            raise ParameterError(f"gridded current: u has shape {u.shape}, and v {v.shape}")
        uv = np.stack([u, v], axis=-1)
        faults = [
            f"{name} has {axis.size} nodes, not ascending"
            if axis.size > 1
            else f"{name} has < 2 nodes"
            for name, axis in (("x", x), ("y", y))
            if axis.ndim != 1 or axis.size <= 1 or not (np.diff(axis) > 0).all()
        ]
        if uv.shape != (y.size, x.size, 2):
            faults.append(f"u, v have shape {uv.shape[:-1]}, not {(y.size, x.size)}")
        if not _is_figure(uv):
            bad = int((~(np.abs(uv) <= _MAX_FIGURE)).any(axis=-1).sum())
            faults.append(f"{bad} nodes not finite, or beyond {_MAX_FIGURE:g} m/s")
        if faults:
            raise ParameterError("gridded current: " + "; ".join(faults))
        super().__init__(table_of(x, y, uv))

    @property
    def x(self) -> FloatArray:
        """Nodes (nx,), m."""
        return self.nodes.x

    @property
    def y(self) -> FloatArray:
        """Nodes (ny,), m."""
        return self.nodes.y

    @property
    def uv(self) -> FloatArray:
        """Velocities (ny, nx, 2) at the nodes, m/s."""
        return np.asarray(self.nodes.uv[0])


def _check_finite(name: str, field: "UniformCurrent | GyreCurrent | SwingingGyre") -> None:
    """Refuse figures that are not finite, or so large that squares overflow; all at once."""
    faults = [
        f"{key} = {shown(value)}"
        for key, value in asdict(field).items()
        if not (is_number(value) and abs(value) <= _MAX_FIGURE)
    ]
    if faults:
        raise ParameterError(
            f"{name}: {', '.join(faults)} must be numbers, finite, and at most {_MAX_FIGURE:g}"
        )


def _check_gyre(name: str, gyre: "GyreCurrent | SwingingGyre") -> None:
    """Refuse figures that are not finite, and a rectangle without area."""
    _check_finite(name, gyre)
    if gyre.width <= 0 or gyre.height <= 0:
        raise ParameterError(
            f"{name}: width = {gyre.width!r} and height = {gyre.height!r} m must be above 0"
        )


def _is_figure(value: float | FloatArray) -> bool:
    """Whether a value, or each of an array, is finite, and its square does not overflow."""
    return bool((np.abs(value) <= _MAX_FIGURE).all())


def _lattice() -> FloatArray:
    """Barycentric coordinates (n, 3) of a regular lattice over a triangle."""
    n = _LATTICE_ROWS - 1
    return np.array(
        [(i / n, j / n, (n - i - j) / n) for i in range(n + 1) for j in range(n + 1 - i)]
    )


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
                    f"varying current: currents = {shown(currents)} must be a sequence with a "
                    "field for each time, or one function"
                )
            self._slices = tuple(map(as_field, currents))
            self._function = None
            if len(self._slices) != self._times.size:
                faults.append(f"{len(self._slices)} currents for {self._times.size} times")
            if not all(current.is_steady for current in self._slices):
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
        if self._slices and all(current is self._slices[0] for current in self._slices):
            return self._slices[0].table(bounds)
        return self._nodes or tabulated_in_time(self.velocity, self._times, bounds)

    @cached_property
    def _nodes(self) -> CurrentTable | None:
        """All slices as one table, if their tables have the same nodes; else None."""
        nodes = [current.nodes for current in self._slices if isinstance(current, TabulatedCurrent)]
        if len(nodes) != self._times.size or not all(same_axes(nodes[0], table) for table in nodes):
            return None
        uv = np.concatenate([table.uv for table in nodes])
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

    On the rectangle from (0, 0) to (width, height), in units of X = 2 x/width and Y = y/height: ψ =
    A sin(π f) sin(π Y), f = ε sin(ωt) X² + (1 - 2 ε sin(ωt)) X; u = -∂ψ/∂Y and v = ∂ψ/∂X if the
    width is two heights. A is `amplitude` (m/s), ε is `epsilon`, ω is `omega` (rad/s).
    """

    amplitude: float
    width: float
    height: float
    epsilon: float
    omega: float

    def __post_init__(self) -> None:
        """Refuse figures that are not finite, and a rectangle without area."""
        _check_gyre("swinging gyre", self)

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
