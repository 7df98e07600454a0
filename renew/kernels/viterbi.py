"""Find the fastest chain through rows of points, and shortcuts along a chain.

A state's cost is its arrival time. Straight legs join each row of points to the next. A leg's time
is its length times the mean slowness at its ends (trapezoidal rule: rows are close). In a changing
current, legs are timed in pieces so short that a vessel that begins a piece later never ends it
earlier (FIFO; Orda & Rom, 1990). So the chain has the earliest arrival.
"""

import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel, reading_kernel, small_kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.kernels.capsules import (
    Capsules,
    Segment,
    capsule_bounds,
    extremes,
    intersects,
    leg_is_clear,
)
from renew.kernels.current_table import (
    Bend,
    CurrentTable,
    Site,
    bend_near,
    mean_metre,
    metre_at,
    site_of,
    velocity,
    velocity_there,
)
from renew.kernels.ground_speed import Polar, ground_speed

# Squared ratio of current to vessel speed from which water counts as too strong at a point; between
# two points on a leg the current may be a little stronger.
TOO_STRONG = 0.97**2
# Least headway (m²/s: length times speed over ground), so that its inverse is finite.
_MIN_HEADWAY = 1e-300
# Number of values that processors handle at once, or a multiple of it.
_LANES = 4


@small_kernel
def slowness(cx: float, cy: float, tx: float, ty: float, polar: Polar) -> float:
    """Return seconds per metre along the unit tangent t in the current c; inf if no way is made.

    A current as strong as the vessel at its highest speed is no-go, whichever way it flows.
    """
    limit = max(polar.speed, polar.no_go)
    if cx * cx + cy * cy >= limit * limit:
        return math.inf
    speed = ground_speed(cx, cy, tx, ty, polar)
    return 1.0 / speed if speed > 0.0 else math.inf


class Clock(NamedTuple):
    """The start of a path, `departure` (s), and the longest piece of a leg, `step` (m).

    In a changing current, legs are cut into pieces no longer than `step`.
    """

    departure: float
    step: float


class Stream(NamedTuple):
    """A current, the vessel's polar, and its clock."""

    table: CurrentTable
    polar: Polar
    clock: Clock


@reading_kernel
def leg_time(ax: float, ay: float, bx: float, by: float, begin: float, water: Stream) -> float:
    """Return the time (s) over a straight leg a -> b, begun at a time; inf if impassable.

    Each piece is timed by the trapezoidal rule, with the current at its end when the vessel would
    arrive at its initial speed (Heun's rule).
    """
    u, v = velocity(water.table, ax, ay, begin)
    end = site_of(water.table, bx, by)
    return leg_time_from(Segment(ax, ay, bx, by), u, v, end, begin, water)


@small_kernel
def leg_time_from(
    leg: Segment, u: float, v: float, end: Site, begin: float, water: Stream
) -> float:
    """Return the time (s) over a leg, given the current at its begin, and the site of its end."""
    table, polar, clock = water
    dx, dy = leg.bx - leg.ax, leg.by - leg.ay
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return 0.0
    tx, ty = dx / length, dy / length
    pieces = 1 if len(table.times) == 1 else math.ceil(length / clock.step)
    piece, now = length / pieces * mean_metre(table, leg.ax, leg.ay, leg.bx, leg.by), begin
    here = slowness(u, v, tx, ty, polar)
    for k in range(1, pieces + 1):
        if here == math.inf:
            return math.inf
        then = now + piece * here
        if k == pieces:
            u, v = velocity_there(table, end, then)
        else:
            place = k / pieces
            u, v = velocity(table, leg.ax + place * dx, leg.ay + place * dy, then)
        there = slowness(u, v, tx, ty, polar)
        now += piece * (here + there) / 2
        here = there
    return now - begin


@kernel
def arrivals(path: FloatArray, water: Stream) -> FloatArray:
    """Return times (n,), s, at the points of a path; inf from the first unreachable point."""
    times = np.full(len(path), np.inf)
    times[0] = water.clock.departure
    for k in range(1, len(path)):
        if times[k - 1] < np.inf:
            (ax, ay), (bx, by) = path[k - 1], path[k]
            times[k] = times[k - 1] + leg_time(ax, ay, bx, by, times[k - 1], water)
    return times


@kernel
def shortcut(path: FloatArray, water: Stream, capsules: Capsules, longest: float) -> BoolArray:
    """Return which points (n,) to keep; a short leg that is clear and no slower skips the others.

    Legs up to `longest` metres are tried in one pass along the path, from the time of passage.
    """
    every = np.arange(len(capsules.radius))
    none_exempt = np.zeros(len(capsules.radius), dtype=np.bool_)
    kept, lasts = np.zeros(len(path), dtype=np.int64), np.zeros(len(path))
    times = arrivals(path, water)
    count = 1
    for new in range(1, len(path)):
        (cx, cy), onward = path[new], times[new] - times[new - 1]
        while count >= 2:
            before = kept[count - 2]
            ax, ay = path[before]
            dx, dy = cx - ax, cy - ay
            if dx * dx + dy * dy > longest * longest:
                break
            direct = leg_time(ax, ay, cx, cy, times[before], water)
            if direct > lasts[count - 1] + onward or not leg_is_clear(
                Segment(ax, ay, cx, cy), capsules, every, none_exempt
            ):
                break
            onward = direct
            count -= 1
        kept[count], lasts[count] = new, onward
        count += 1
    keep = np.zeros(len(path), dtype=np.bool_)
    keep[kept[:count]] = True
    return keep


class _Row(NamedTuple):
    """One row of points (m,): coordinates (m), arrival times (s), and currents then (m/s).

    One array each, so that the inner loop can be vectorised. `came_from` is the point of the row
    before from which the vessel arrives.
    """

    x: FloatArray
    y: FloatArray
    u: FloatArray
    v: FloatArray
    arrival: FloatArray
    came_from: IntArray


@kernel
def quickest_chain(
    points: FloatArray, water: Stream, capsules: Capsules, exempt: BoolArray
) -> tuple[float, IntArray]:
    """Return the arrival time (s) and the chosen point (r,) of each row; inf if none is clear.

    Parameters
    ----------
    points : (r, m, 2) metres; the first and the last row are one point each, at index 0.
    water : the current, what the vessel makes in it, and its clock.
    capsules : what legs stay out of, as in :func:`renew.kernels.capsules.leg_is_clear`.
    exempt : (2, capsules) True where the first, or the last, leg may enter a capsule.
    """
    rows, count = points.shape[:2]
    # Padded with points that are never reached, so that the loop can be vectorised.
    wide = -(-count // _LANES) * _LANES
    x, y = np.empty((rows, wide)), np.empty((rows, wide))
    # A loop, because an assignment to slices takes three seconds to compile: Numba compiles the
    # error message for shapes that differ, too.
    for row in range(rows):
        for j in range(wide):
            x[row, j], y[row, j] = points[row, j if j < count else 0]
    u, v = np.zeros((rows, wide)), np.zeros((rows, wide))
    arrival = np.full((rows, wide), np.inf)
    arrival[0, 0] = water.clock.departure
    u[0, 0], v[0, 0] = velocity(water.table, x[0, 0], y[0, 0], arrival[0, 0])
    came_from = np.zeros((rows, count), dtype=np.int64)
    bounds = capsule_bounds(capsules)
    none_exempt = np.zeros(len(capsules.radius), dtype=np.bool_)
    is_simple = len(water.table.times) == 1 and water.polar.least >= water.polar.speed
    for row in range(rows - 1):
        width = 1 if row == 0 else wide
        following = 1 if row == rows - 2 else count
        here = _Row(
            x[row, :width],
            y[row, :width],
            u[row, :width],
            v[row, :width],
            arrival[row, :width],
            came_from[row],
        )
        after = row + 1
        there = _Row(
            x[after, :following],
            y[after, :following],
            u[after, :following],
            v[after, :following],
            arrival[after, :following],
            came_from[after],
        )
        near = _capsules_between(here, there, bounds)
        free = exempt[0] if row == 0 else exempt[1] if row == rows - 2 else none_exempt
        if is_simple:
            _advance_in_steady(here, there, water, capsules, near, free)
        else:
            _advance(here, there, water, capsules, near, free)
    chain = np.zeros(rows, dtype=np.int64)
    for row in range(rows - 1, 0, -1):
        chain[row - 1] = came_from[row, chain[row]]
    return arrival[rows - 1, 0], chain


@kernel
def _advance_in_steady(
    here: _Row,
    there: _Row,
    water: Stream,
    capsules: Capsules,
    near: IntArray,
    exempt: BoolArray,
) -> None:
    """Do the work of :func:`_advance` in a steady current at one speed, far faster."""
    table, polar, _ = water
    x, y, u, v, departure, _ = here
    most = TOO_STRONG * polar.speed * polar.speed
    totals = np.empty(len(x))
    for j in range(len(there.x)):
        bx, by = there.x[j], there.y[j]
        bu, bv = velocity(table, bx, by, 0.0)
        if bu * bu + bv * bv >= most:
            continue
        # Rows are close: the plane's stretch at a leg's end is that of the leg.
        half = 0.5 * metre_at(table, bx, by)
        for i in range(len(totals)):
            dx, dy = bx - x[i], by - y[i]
            first, second = _headway(u[i], v[i], dx, dy, polar), _headway(bu, bv, dx, dy, polar)
            totals[i] = departure[i] + half * (dx * dx + dy * dy) * (1.0 / first + 1.0 / second)
        while True:
            i = _first_least(totals)
            if totals[i] == np.inf:
                break
            if leg_is_clear(Segment(x[i], y[i], bx, by), capsules, near, exempt):
                there.arrival[j], there.u[j], there.v[j] = totals[i], bu, bv
                there.came_from[j] = i
                break
            totals[i] = np.inf


@small_kernel
def _first_least(values: FloatArray) -> int:
    """Return the place of the least of some numbers; NumPy's search takes far longer for a few."""
    least = 0
    for k in range(1, len(values)):
        if values[k] < values[least]:
            least = k
    return least


@small_kernel
def _headway(u: float, v: float, dx: float, dy: float, polar: Polar) -> float:
    """Return the headway along a leg in a current (m²/s): length times speed over ground."""
    most = polar.speed * polar.speed * (dx * dx + dy * dy)
    across = v * dx - u * dy if polar.crab else 0.0
    return max(u * dx + v * dy + math.sqrt(max(most - across * across, 0.0)), _MIN_HEADWAY)


@kernel
def _advance(
    here: _Row,
    there: _Row,
    water: Stream,
    capsules: Capsules,
    near: IntArray,
    exempt: BoolArray,
) -> None:
    """Fill in the next row's arrival times and currents, and the point each arrival comes from."""
    # In a changing current, or with a choice of speeds, some legs must be timed one by one.
    first = _first_least(here.arrival)
    if here.arrival[first] == np.inf:
        return
    table, polar, _ = water
    most = TOO_STRONG * polar.speed * polar.speed
    totals, timed = np.empty(len(here.x)), np.empty(len(here.x), dtype=np.bool_)
    for j in range(len(there.x)):
        bx, by = there.x[j], there.y[j]
        site = site_of(table, bx, by)
        dx, dy = bx - here.x[first], by - here.y[first]
        away = math.sqrt(dx * dx + dy * dy)
        bend = bend_near(table, site, here.arrival[first] + away / polar.speed)
        _arrivals(here, (bx, by), bend, water, totals, timed)
        while True:
            i = _first_least(totals)
            if totals[i] == np.inf:
                break
            leg = Segment(here.x[i], here.y[i], bx, by)
            if not timed[i]:
                begin, timed[i] = here.arrival[i], True
                u, v = here.u[i], here.v[i]
                totals[i] = begin + leg_time_from(leg, u, v, site, begin, water)
                continue
            u, v = velocity_there(table, site, totals[i])
            if u * u + v * v < most and leg_is_clear(leg, capsules, near, exempt):
                there.arrival[j], there.u[j], there.v[j] = totals[i], u, v
                there.came_from[j] = i
                break
            totals[i] = np.inf


@reading_kernel
def _arrivals(
    here: _Row,
    to: tuple[float, float],
    bend: Bend,
    water: Stream,
    totals: FloatArray,
    timed: BoolArray,
) -> None:
    """Fill in the arrival times (m,) at one point from each of a row, and which are exact.

    A time is exact if the leg has one piece and ends while the current there is known from `bend`.
    Exact times are those of :func:`leg_time`, computed without its branches. With d the leg and g
    the speed over ground, a time is |d|² / (|d| g), so no unit vector is needed. Any other time is
    too short: it is that of a vessel with the strongest current behind it. Such a leg is timed
    later if it may be the quickest. Where the current is as strong as the vessel, `here.arrival` is
    inf.
    """
    x, y, u, v, departure, _ = here
    polar, step = water.polar, water.clock.step
    bx, by = to
    metre = metre_at(water.table, bx, by)
    fastest = ground_speed(water.table.strongest, 0.0, 1.0, 0.0, polar) / metre
    if polar.least < polar.speed:
        for i in range(len(totals)):
            totals[i] = departure[i] + math.hypot(bx - x[i], by - y[i]) / fastest
            timed[i] = False
        return
    for i in range(len(totals)):
        dx, dy = bx - x[i], by - y[i]
        square = dx * dx + dy * dy
        a_metre = metre / _headway(u[i], v[i], dx, dy, polar)
        since = departure[i] + square * a_metre - bend.time
        before, after = max(min(since, 0.0), -bend.before), min(max(since, 0.0), bend.after)
        bu = bend.u + before * bend.u_before + after * bend.u_after
        bv = bend.v + before * bend.v_before + after * bend.v_after
        # Between points that coincide the time is 0.
        time = 0.5 * square * (a_metre + metre / _headway(bu, bv, dx, dy, polar))
        is_known = square <= step * step and since == before + after
        totals[i] = departure[i] + (time if is_known else math.sqrt(square) / fastest)
        timed[i] = is_known


@kernel
def _capsules_between(here: _Row, there: _Row, bounds: FloatArray) -> IntArray:
    """Return the indices of capsules whose bounds (c, 4) intersect the box around two rows."""
    (west, east), (south, north) = extremes(here.x), extremes(here.y)
    (left, right), (low, high) = extremes(there.x), extremes(there.y)
    west, east, south, north = min(west, left), max(east, right), min(south, low), max(north, high)
    near = np.empty(len(bounds), dtype=np.int64)
    count = 0
    for h in range(len(bounds)):
        if intersects(bounds, h, west, south, east, north):
            near[count] = h
            count += 1
    return near[:count]
