"""Ocean currents as the planner sees them: velocity at a point, mean and spread in a triangle.

Every field takes points of shape (..., 2) in planar metres and returns velocities of the same
shape in m/s along the plane's axes.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from renew._compiled import for_kernels, kernel
from renew._types import FloatArray
from renew.errors import ParameterError
from renew.inputs.current_table import Table, table_of, tabulated, velocities
from renew.kernels.angles import wrapped

# Number of rows of the lattice of barycentric coordinates over which a triangle's mean and spread
# are taken: 36 points, vertices included. More change the single gyre's paddings by under 1 %.
_LATTICE_ROWS = 8
# Largest figure of a field (m, m/s): far beyond any sea, and squares don't overflow.
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
    """A steady current: call it with points, ask it for the statistics of triangles."""

    @abstractmethod
    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2) in m/s at points (..., 2) in metres."""

    def max_speed(self, bounds: tuple[float, float, float, float]) -> float:
        """Strongest current inside (xmin, ymin, xmax, ymax), m/s; here that of its table."""
        return self.table(bounds).strongest

    def table(self, bounds: tuple[float, float, float, float]) -> Table:
        """The field inside (xmin, ymin, xmax, ymax) as nodes for compiled code."""
        return tabulated(self, bounds)

    def statistics(self, triangles: FloatArray) -> CurrentStatistics:
        """Mean and spread of the current in triangles (n, 3, 2)."""
        points = np.einsum("lk,nkd->nld", _lattice(), triangles)
        return sample_statistics(self(points))


CurrentLike: TypeAlias = CurrentField | Callable[["FloatArray"], "FloatArray"]


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
            # Deviations from the mean direction, wrapped, and weighted by speed: the direction of
            # nearly still water says nothing of where the vessel will drift.
            deviation = wrapped(math.atan2(v, u) - direction[i])
            if speed[i] > 0.0:
                direction_std[i] += strength / (samples * speed[i]) * deviation**2
    return mean, speed, direction, np.sqrt(speed_std), np.sqrt(direction_std)


def as_field(current: CurrentLike) -> CurrentField:
    """Take a field as it is, or a callable (..., 2) m -> (..., 2) m/s as one."""
    if isinstance(current, CurrentField):
        return current
    if callable(current):
        return FunctionCurrent(current)
    raise ParameterError(
        f"current = {current!r} is neither a CurrentField nor a callable; pass "
        "renew.UniformCurrent(0, 0) for still water"
    )


@dataclass(frozen=True, slots=True)
class FunctionCurrent(CurrentField):
    """Any function (..., 2) m -> (..., 2) m/s as a field; its answers are checked."""

    function: Callable[[FloatArray], FloatArray]

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity of the wrapped function."""
        points = np.asarray(points, dtype=float)
        velocity = np.asarray(self.function(points), dtype=float)
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
class UniformCurrent(CurrentField):
    """The same current (u, v) in m/s everywhere."""

    u: float
    v: float

    def __post_init__(self) -> None:
        """Refuse a current that is not finite."""
        _check_finite("uniform current", u=self.u, v=self.v)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2), the same at every point."""
        shape = np.asarray(points).shape
        return np.broadcast_to(np.array([self.u, self.v], dtype=float), shape).copy()

    def max_speed(self, bounds: tuple[float, float, float, float]) -> float:
        """Speed of the current (m/s), wherever."""
        del bounds
        return float(np.hypot(self.u, self.v))


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
        """Refuse what is not finite, and a rectangle without area."""
        _check_finite("gyre", amplitude=self.amplitude, width=self.width, height=self.height)
        if self.width <= 0 or self.height <= 0:
            raise ParameterError(
                f"gyre: width = {self.width!r} and height = {self.height!r} m must be above 0"
            )

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2) at points (..., 2)."""
        points = np.asarray(points, dtype=float)
        x = np.pi * self.columns * points[..., 0] / self.width
        y = np.pi * self.rows * points[..., 1] / self.height
        return self.amplitude * np.stack([-np.sin(x) * np.cos(y), np.cos(x) * np.sin(y)], axis=-1)

    def max_speed(self, bounds: tuple[float, float, float, float]) -> float:
        """Amplitude (m/s): sin²cos² + cos²sin² is at most 1."""
        del bounds
        return abs(self.amplitude)


@dataclass(frozen=True, slots=True, eq=False)
class TabulatedCurrent(CurrentField):
    """A current by its table, for a field that is slow to evaluate."""

    nodes: Table

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2) by bilinear interpolation at points (..., 2)."""
        points = for_kernels(points)
        return velocities(self.nodes, points.reshape(-1, 2)).reshape(points.shape)

    def table(self, bounds: tuple[float, float, float, float]) -> Table:
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
        x, y = np.ascontiguousarray(x, dtype=float), np.ascontiguousarray(y, dtype=float)
        uv = np.stack([np.asarray(u, dtype=float), np.asarray(v, dtype=float)], axis=-1)
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
        return self.nodes.uv


def _check_finite(name: str, **figures: float) -> None:
    """Refuse figures that are not finite, or so large that squares overflow; all at once."""
    faults = [
        f"{key} = {value!r}" for key, value in figures.items() if not abs(value) <= _MAX_FIGURE
    ]
    if faults:
        raise ParameterError(
            f"{name}: {', '.join(faults)} must be finite, and at most {_MAX_FIGURE:g}"
        )


def _is_figure(value: float | FloatArray) -> bool:
    """Whether a value, or each of an array, is finite and so small that its square is, too."""
    return bool((np.abs(value) <= _MAX_FIGURE).all())


def _lattice() -> FloatArray:
    """Barycentric coordinates (n, 3) of a regular lattice over a triangle."""
    n = _LATTICE_ROWS - 1
    return np.array(
        [(i / n, j / n, (n - i - j) / n) for i in range(n + 1) for j in range(n + 1 - i)]
    )
