"""Tracks of hard-over turns in a current from a table, for compiled code.

A turn is a full circle through the water, which the current carries along. It is integrated by the
midpoint rule. Each turn is made in a current whose speed and direction are changed by a draw.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from renew._compiled import kernel, reading_kernel, small_kernel
from renew._types import BoolArray, FloatArray, IntArray
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
    """How far points of an even raster (ny, nx) are from land; the first is at `west`, `south`, m.

    `off_land` is in rows or columns, whichever are more; 0 on land.
    """

    off_land: IntArray
    west: float
    south: float
    spacing: float


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
    tracks, changed = np.empty((count, 2 * draws, steps + 1, 2)), np.empty((draws, 3))
    step = 2 * math.pi / turn_rate / steps
    for i in range(count):
        _change(changed, speed_change[i], direction_change[i])
        for side in range(2):
            rate = turn_rate if side == 0 else -turn_rate
            through = _through_water(heading[i], rate, speeds[i], step, steps)
            own = tracks[i, side::2]
            for draw in range(draws):
                own[draw, 0, 0], own[draw, 0, 1] = points[i]
            # One turn after the other, each step would wait for the step before it.
            for k in range(steps):
                now = times[i] + k * step
                for draw in range(draws):
                    x, y = own[draw, k]
                    after = _carried(table, x, y, now, step, through[k], changed[draw])
                    own[draw, k + 1, 0], own[draw, k + 1, 1] = after
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
    is_free, changed = np.ones(count, dtype=np.bool_), np.empty((draws, 3))
    for i in range(count):
        _change(changed, speed_change[i], direction_change[i])
        for side in range(2):
            rate = turn_rate if side == 0 else -turn_rate
            through = _through_water(heading[i], rate, speeds[i], step, steps)
            vessels = np.empty((draws, 2))
            vessels[:] = points[i]
            for k in range(steps):
                now = times[i] + k * step
                for draw in range(draws):
                    x, y = vessels[draw]
                    after = _carried(table, x, y, now, step, through[k], changed[draw])
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
    rows, columns = water.off_land.shape
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
                    water.off_land[row, column] = 0


@small_kernel
def _line_is_water(water: WaterRaster, a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Whether a line from a to b is on water, at its end and at points a few cells apart."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    cells = math.hypot(dx, dy) / water.spacing
    off_land = _off_land(water, b[0], b[1])
    # The nearest points to two places may lie one row further apart than the places.
    if off_land == 0 or off_land > cells + 1:
        return off_land > 0
    pieces = 1 + int(cells / _CELLS)
    for k in range(1, pieces):
        if _off_land(water, a[0] + k / pieces * dx, a[1] + k / pieces * dy) == 0:
            return False
    return True


@small_kernel
def _off_land(water: WaterRaster, x: float, y: float) -> int:
    """Return how many cells the nearest point of a raster is off land; 1 beyond the raster."""
    rows, columns = water.off_land.shape
    row = math.floor((y - water.south) / water.spacing + 0.5)
    column = math.floor((x - water.west) / water.spacing + 0.5)
    beyond = row < 0 or row >= rows or column < 0 or column >= columns
    return 1 if beyond else int(water.off_land[row, column])


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


@reading_kernel
def _change(changes: FloatArray, more: FloatArray, turned: FloatArray) -> None:
    """Set changes (draws, 3) of a current: of its speed (m/s), cosine and sine of its direction."""
    for draw in range(len(changes)):
        changes[draw, 0] = more[draw]
        changes[draw, 1], changes[draw, 2] = math.cos(turned[draw]), math.sin(turned[draw])


@small_kernel
def _carried(
    table: CurrentTable,
    x: float,
    y: float,
    now: float,
    step: float,
    through: FloatArray,
    change: FloatArray,
) -> tuple[float, float]:
    """Return the place after a step (s) through water, in a changed current."""
    u, v = _changed_velocity(velocity(table, x, y, now), change)
    half_x, half_y = x + step / 2 * (through[0] + u), y + step / 2 * (through[1] + v)
    u, v = _changed_velocity(velocity(table, half_x, half_y, now + step / 2), change)
    return x + step * (through[0] + u), y + step * (through[1] + v)


@small_kernel
def _changed_velocity(current: tuple[float, float], change: FloatArray) -> tuple[float, float]:
    """Return a velocity (m/s) with its speed changed and its direction rotated; see `_change`."""
    (u, v), (more, cos, sin) = current, change
    speed = math.sqrt(u * u + v * v)
    factor = max(0.0, speed + more) / speed if speed > 0.0 else 0.0
    return factor * (u * cos - v * sin), factor * (u * sin + v * cos)
