"""How far a current can be from its linear interpolant in the triangles of a grid.

The lower bound on fuel (:mod:`renew.bounds.fuel_lower_bound`) knows a current at the grid's nodes
and takes it as linear between them; the error of that is bounded here, by kind of field.
`UniformCurrent`, `GyreCurrent` and `GriddedCurrent` have closed forms, whose proofs stand with
them: second derivatives of the gyre's sines, slopes of the bilinear cells. Any other field is known
by its values alone, and gets an estimate.
"""

import numpy as np

from renew._types import FloatArray, IntArray
from renew.inputs.current import CurrentField, GriddedCurrent, GyreCurrent, UniformCurrent
from renew.inputs.varying_current import VaryingCurrent


def deviation_radius(
    current: CurrentField, x: FloatArray, y: FloatArray, velocity: FloatArray
) -> FloatArray:
    """Radius r (ny - 1, nx - 1) >= |c - linear interpolant of c| in each cell's triangles, m/s.

    `x` (nx,) and `y` (ny,) are the nodes, m, and `velocity` (nt, ny, nx, 2) is c there in each
    slice; a cell may be cut along either diagonal. The interpolant is linear between slices.

    Gyre: |d²c/de²| <= A (a² + b²) for every unit e, with a, b the wave numbers along x and y; and
    linear interpolation in a triangle errs by at most that times half the square of the radius
    of the circle around it.
    """
    wide, high = np.diff(x)[None, :], np.diff(y)[:, None]
    if isinstance(current, UniformCurrent):
        return np.zeros((y.size - 1, x.size - 1))
    if isinstance(current, GyreCurrent):
        waves = (current.columns / current.width) ** 2 + (current.rows / current.height) ** 2
        return abs(current.amplitude) * np.pi**2 * waves * (wide**2 + high**2) / 8
    if isinstance(current, GriddedCurrent):
        along_x = _slope_spread(current.x, current.y, current.uv, x, y)
        along_y = _slope_spread(current.y, current.x, current.uv.swapaxes(0, 1), y, x).T
        return np.asarray((along_x * wide + along_y * high) / 2)
    if isinstance(current, VaryingCurrent) and current.slices:
        every = zip(current.slices, velocity, strict=True)
        radii = [deviation_radius(one, x, y, at[None]) for one, at in every]
        return np.asarray(np.max(radii, axis=0))
    in_space = np.max([_sampled_deviation(x, y, at) for at in velocity], axis=0)
    return np.asarray(in_space + _of_cells(_bend_in_time(current.slice_times, velocity)))


def _slope_spread(
    grid_x: FloatArray, grid_y: FloatArray, uv: FloatArray, x: FloatArray, y: FloatArray
) -> FloatArray:
    """Radius of a ball that holds every ∂c/∂x of a bilinear field in each cell, 1/s.

    With such radii ρ of ∂c/∂x and σ of ∂c/∂y, linear interpolation in a triangle w wide and h
    high errs by at most (ρ w + σ h)/2: the error is Σ λᵢ ∫ (∇c - q)·(xᵢ - x) over the segments
    from x to the corners xᵢ, for any constant q, and Σ λᵢ |xᵢ - x| <= w/2 along x.
    """
    slope = np.diff(uv, axis=1) / np.diff(grid_x)[None, :, None]
    still = np.zeros((grid_y.size, 1, 2))
    slope = np.concatenate([still, slope, still], axis=1)  # the field is constant outside
    first = np.searchsorted(grid_x, x[:-1], side="right")
    last = np.searchsorted(grid_x, x[1:], side="left")
    low = _least_of_columns(slope, first, last)
    high = -_least_of_columns(-slope, first, last)
    # Along y each ∂c/∂x is linear between the grid's rows: extremes are at rows or cell sides.
    place = np.interp(y, grid_y, np.arange(grid_y.size))
    spread = -_least_of_rows(-high, place) - _least_of_rows(low, place)
    return np.asarray(np.hypot(spread[..., 0], spread[..., 1]) / 2)


def _least_of_columns(values: FloatArray, first: IntArray, last: IntArray) -> FloatArray:
    """Least of values (n, m, 2) in the columns from `first` (c,) to `last`, or one: (n, c, 2)."""
    least = values[:, first]
    for further in range(1, int((last - first).max(initial=0)) + 1):
        least = np.minimum(least, values[:, np.maximum(first, np.minimum(first + further, last))])
    return least


def _least_of_rows(values: FloatArray, place: FloatArray) -> FloatArray:
    """Least of values (n, c, 2), linear between rows, from place to place (r,): (r - 1, c, 2)."""
    floor = np.minimum(place.astype(int), len(values) - 2)
    part = (place - floor)[:, None, None]
    ends = (1 - part) * values[floor] + part * values[floor + 1]
    least = np.minimum(ends[:-1], ends[1:])
    # The rows that lie between two places.
    between = np.searchsorted(place, np.arange(len(values)), side="right") - 1
    for row, at in enumerate(between.tolist()):
        if 0 <= at < len(least):
            np.minimum(least[at], values[row], out=least[at])
    return np.asarray(least)


def _sampled_deviation(x: FloatArray, y: FloatArray, velocity: FloatArray) -> FloatArray:
    """Four times the interpolation error (m/s) that the nodes' second differences suggest."""
    bend = _bend(x, velocity.swapaxes(0, 1)).T + _bend(y, velocity)
    bend = _of_cells(bend)
    twist = velocity[1:, 1:] - velocity[1:, :-1] - velocity[:-1, 1:] + velocity[:-1, :-1]
    return np.asarray(bend + np.linalg.norm(twist, axis=-1))


def _of_cells(nodes: FloatArray) -> FloatArray:
    """Largest of the figures (ny, nx) at the corners of each cell: (ny - 1, nx - 1)."""
    rows = np.maximum(nodes[:-1], nodes[1:])
    return np.maximum(rows[:, :-1], rows[:, 1:])


def _bend_in_time(times: FloatArray, velocity: FloatArray) -> FloatArray:
    """How far any slice (nt, ny, nx, 2) is off the line between those beside it: (ny, nx)."""
    if times.size < 3:
        return np.zeros(velocity.shape[1:3])
    part = ((times[1:-1] - times[:-2]) / (times[2:] - times[:-2]))[:, None, None, None]
    line = (1 - part) * velocity[:-2] + part * velocity[2:]
    return np.asarray(np.linalg.norm(velocity[1:-1] - line, axis=-1).max(axis=0))


def _bend(axis: FloatArray, velocity: FloatArray) -> FloatArray:
    """How far each node's velocity (n, m, 2) is off the line through its neighbours, (n, m)."""
    bend = np.zeros(velocity.shape[:2])
    if axis.size < 3:
        return bend
    part = ((axis[1:-1] - axis[:-2]) / (axis[2:] - axis[:-2]))[:, None, None]
    line = (1 - part) * velocity[:-2] + part * velocity[2:]
    bend[1:-1] = np.linalg.norm(velocity[1:-1] - line, axis=-1)
    bend[0], bend[-1] = bend[1], bend[-2]
    return bend
