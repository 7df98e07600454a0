"""Tracks of hard-over turns in a current from a table, for compiled code.

A turn is a full circle through the water, which the current carries along. It is integrated by the
midpoint rule. Each turn is made in a current whose speed and direction are changed by a draw.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from renew._compiled import kernel, reading_kernel
from renew._types import BoolArray, FloatArray
from renew.kernels.capsules import Segment, square_off
from renew.kernels.current_table import CurrentTable, velocity

# Largest distance of the points of a line that are looked up on a raster, in cells.
_CELLS = 1.7

Changes: TypeAlias = tuple[FloatArray, FloatArray]
"""Changes (n, draws) of the current's speed, m/s, and of its direction, rad."""


class TurnsBegun(NamedTuple):
    """Points (n, 2), m, where turns begin, and the course (n,), rad, and the time (n,), s, there.

    `speeds` (n,) are through water, m/s.
    """

    points: FloatArray
    course: FloatArray
    times: FloatArray
    speeds: FloatArray


class WaterRaster(NamedTuple):
    """Whether points of an even raster (ny, nx) are water; the first is at `west`, `south`, m."""

    is_water: BoolArray
    west: float
    south: float
    spacing: float


class _Change(NamedTuple):
    """A change of the current's speed (m/s), and the cosine and sine of that of its direction."""

    more: float
    cos: float
    sin: float


@kernel
def flown_by_table(
    begun: TurnsBegun,
    heading: FloatArray,
    changes: Changes,
    table: CurrentTable,
    turn_rate: float,
    steps: int,
) -> FloatArray:
    """Return tracks (n, 2 draws, steps + 1, 2): each draw turns to port, then to starboard."""
    (points, _, times, speeds), (speed_change, direction_change) = begun, changes
    count, draws = speed_change.shape
    tracks = np.empty((count, 2 * draws, steps + 1, 2))
    step = 2 * math.pi / turn_rate / steps
    for i in range(count):
        for side in range(2):
            rate = turn_rate if side == 0 else -turn_rate
            through = _through_water(heading[i], rate, speeds[i], step, steps)
            for draw in range(draws):
                change = _changed(speed_change[i, draw], direction_change[i, draw])
                x, y = points[i]
                track = tracks[i, 2 * draw + side]
                track[0, 0], track[0, 1] = x, y
                for k in range(steps):
                    x, y = _carried(table, x, y, times[i] + k * step, step, through[k], change)
                    track[k + 1, 0], track[k + 1, 1] = x, y
    return tracks


@kernel
def turns_stay_on(
    water: WaterRaster,
    begun: TurnsBegun,
    heading: FloatArray,
    changes: Changes,
    table: CurrentTable,
    turn_rate: float,
    steps: int,
) -> BoolArray:
    """Return from which points (n,) all turns stay on water; beyond the raster all is water.

    So must the lines between the vessels of successive draws, at each step: land between two tracks
    is met by a draw between both.
    """
    (points, _, times, speeds), (speed_change, direction_change) = begun, changes
    count, draws = speed_change.shape
    step = 2 * math.pi / turn_rate / steps
    is_free = np.ones(count, dtype=np.bool_)
    for i in range(count):
        for side in range(2):
            rate = turn_rate if side == 0 else -turn_rate
            through = _through_water(heading[i], rate, speeds[i], step, steps)
            vessels = np.empty((draws, 2))
            vessels[:] = points[i]
            for k in range(steps):
                for draw in range(draws):
                    change = _changed(speed_change[i, draw], direction_change[i, draw])
                    x, y = vessels[draw]
                    now = times[i] + k * step
                    after = _carried(table, x, y, now, step, through[k], change)
                    is_free[i] = is_free[i] and _line_is_water(water, (x, y), after)
                    vessels[draw, 0], vessels[draw, 1] = after
                for draw in range(draws if draws > 1 else 0):
                    (x, y), other = vessels[draw], vessels[(draw + 1) % draws]
                    line = _line_is_water(water, (x, y), (other[0], other[1]))
                    is_free[i] = is_free[i] and line
                if not is_free[i]:
                    break
            if not is_free[i]:
                break
    return is_free


@kernel
def drop_shore(water: WaterRaster, start: FloatArray, end: FloatArray, margin: float) -> None:
    """Mark points closer than a margin (m) to segments (e, 2) as land."""
    rows, columns = water.is_water.shape
    for h in range(len(start)):
        (ax, ay), (bx, by) = start[h], end[h]
        west = math.floor((min(ax, bx) - margin - water.west) / water.spacing)
        east = math.ceil((max(ax, bx) + margin - water.west) / water.spacing)
        south = math.floor((min(ay, by) - margin - water.south) / water.spacing)
        north = math.ceil((max(ay, by) + margin - water.south) / water.spacing)
        for row in range(max(south, 0), min(north + 1, rows)):
            for column in range(max(west, 0), min(east + 1, columns)):
                x, y = water.west + column * water.spacing, water.south + row * water.spacing
                if square_off(x, y, Segment(ax, ay, bx, by)) < margin * margin:
                    water.is_water[row, column] = False


@reading_kernel
def _line_is_water(water: WaterRaster, a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Whether a line from a to b is on water, at its end and at points a few cells apart."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    pieces = 1 + int(math.hypot(dx, dy) / (_CELLS * water.spacing))
    for k in range(1, pieces + 1):
        if not _is_water(water, a[0] + k / pieces * dx, a[1] + k / pieces * dy):
            return False
    return True


@reading_kernel
def _is_water(water: WaterRaster, x: float, y: float) -> bool:
    """Whether the nearest point of a raster is water, or a point lies beyond the raster."""
    rows, columns = water.is_water.shape
    row = math.floor((y - water.south) / water.spacing + 0.5)
    column = math.floor((x - water.west) / water.spacing + 0.5)
    beyond = row < 0 or row >= rows or column < 0 or column >= columns
    return bool(beyond or water.is_water[row, column])


@kernel
def _through_water(
    heading: float, rate: float, speed: float, step: float, steps: int
) -> FloatArray:
    """Return velocities (steps, 2) through water, m/s, in the middle of each step of a turn."""
    through = np.empty((steps, 2))
    for k in range(steps):
        middle = heading + rate * step * (k + 0.5)
        through[k, 0], through[k, 1] = speed * math.cos(middle), speed * math.sin(middle)
    return through


@kernel
def _changed(more: float, turned: float) -> _Change:
    """Return a change of speed (m/s) and of direction (rad)."""
    return _Change(more, math.cos(turned), math.sin(turned))


@reading_kernel
def _carried(
    table: CurrentTable,
    x: float,
    y: float,
    now: float,
    step: float,
    through: FloatArray,
    change: _Change,
) -> tuple[float, float]:
    """Return the place after a step (s) through water, in a changed current."""
    u, v = _changed_velocity(velocity(table, x, y, now), change)
    half_x, half_y = x + step / 2 * (through[0] + u), y + step / 2 * (through[1] + v)
    u, v = _changed_velocity(velocity(table, half_x, half_y, now + step / 2), change)
    return x + step * (through[0] + u), y + step * (through[1] + v)


@kernel
def _changed_velocity(current: tuple[float, float], change: _Change) -> tuple[float, float]:
    """Return a velocity (m/s) with its speed changed and its direction rotated."""
    u, v = current
    speed = math.sqrt(u * u + v * v)
    factor = max(0.0, speed + change.more) / speed if speed > 0.0 else 0.0
    return (
        factor * (u * change.cos - v * change.sin),
        factor * (u * change.sin + v * change.cos),
    )
