"""Straight legs between points, followed from triangle to triangle and timed.

A leg has two times: the time it takes when the vessel gets there, and the least time at any hour.
The least time decides whether the leg can be part of one of the k best paths. In a steady current
both are equal.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from renew._compiled import kernel, reading_kernel, small_kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.kernels.capsules import Segment
from renew.kernels.current_table import CurrentTable, mean_metre, velocity
from renew.kernels.ground_speed import Polar, ground_speed

Extremes: TypeAlias = tuple[CurrentTable, CurrentTable, bool]
"""Tables of the least and of the largest velocity along x and y at any time; whether they agree."""

# Largest number of the table's columns or rows over which Simpson's rule is used once: about half
# of the smallest eddy that the table holds.
_PANEL = 20.0
# Largest number of triangles that a leg may cross.
_MAX_CROSSED = 4096
# Share of its length by which a leg may miss its end, by rounding.
_ROUNDING = 1e-9
# Lowest speed over ground, as a share of the vessel's: a straight leg may lead against a current
# that the path itself avoids.
_MIN_SPEED = 0.1


@reading_kernel
def time_along(leg: Segment, begin: float, table: CurrentTable, polar: Polar) -> float:
    """Return the time (s) along a leg that is begun at a time, by Simpson's rule."""
    dx, dy = leg.bx - leg.ax, leg.by - leg.ay
    length = math.hypot(dx, dy)
    if length == 0.0:
        return 0.0
    slowest = _MIN_SPEED * polar.speed
    metres = length * mean_metre(table, leg.ax, leg.ay, leg.bx, leg.by)
    halves = 2 * _panels(leg, table)
    total, slowness, now = 0.0, 0.0, begin
    for k in range(halves + 1):
        # The time here if the vessel keeps its speed at the previous point.
        now += slowness * metres / halves
        u, v = velocity(table, leg.ax + k / halves * dx, leg.ay + k / halves * dy, now)
        slowness = 1.0 / max(slowest, ground_speed(u, v, dx / length, dy / length, polar))
        total += _simpson_weight(k, halves) * slowness
    return total * metres / (3 * halves)


@small_kernel
def _panels(leg: Segment, table: CurrentTable) -> int:
    """Return the number of parts of a leg to each of which Simpson's rule is applied."""
    columns = abs(leg.bx - leg.ax) * (len(table.x) - 1) / (table.x[-1] - table.x[0])
    rows = abs(leg.by - leg.ay) * (len(table.y) - 1) / (table.y[-1] - table.y[0])
    return max(1, math.ceil(float(max(columns, rows)) / _PANEL))


@small_kernel
def _simpson_weight(k: int, halves: int) -> float:
    """Return the weight of point k in Simpson's rule; points 0 to `halves` sum to 3 `halves`."""
    if k in (0, halves):
        return 1.0
    return 4.0 if k % 2 else 2.0


@kernel
def currents_between(extremes: Extremes, points: FloatArray) -> FloatArray:
    """Return the least and largest velocities (n, 4), m/s, at points (n, 2): u, v and u, v."""
    least, largest, are_equal = extremes
    currents = np.empty((len(points), 4))
    for k in range(len(points)):
        u, v = velocity(least, points[k, 0], points[k, 1], 0.0)
        currents[k, 0], currents[k, 1] = u, v
        if not are_equal:
            u, v = velocity(largest, points[k, 0], points[k, 1], 0.0)
        currents[k, 2], currents[k, 3] = u, v
    return currents


@reading_kernel
def least_times(
    leg: Segment, here: FloatArray, there: FloatArray, extremes: Extremes, polar: Polar
) -> tuple[float, float]:
    """Return the least times (s) along a leg and back at any hour, by Simpson's rule.

    `here` and `there` (4,) are the least and the largest velocities at its ends.
    """
    dx, dy = leg.bx - leg.ax, leg.by - leg.ay
    length = math.hypot(dx, dy)
    if length == 0.0:
        return 0.0, 0.0
    tx, ty = dx / length, dy / length
    slowest = _MIN_SPEED * polar.speed
    least, largest, are_equal = extremes
    halves = 2 * _panels(leg, least)
    time, back = 0.0, 0.0
    for k in range(halves + 1):
        if k in (0, halves):
            u, v, more_u, more_v = here if k == 0 else there
            low, high = (u, v), (more_u, more_v)
        else:
            x, y = leg.ax + k / halves * dx, leg.ay + k / halves * dy
            low = velocity(least, x, y, 0.0)
            high = low if are_equal else velocity(largest, x, y, 0.0)
        weight = _simpson_weight(k, halves)
        time += weight / max(slowest, _fastest(low, high, tx, ty, polar))
        back += weight / max(slowest, _fastest(low, high, -tx, -ty, polar))
    scale = length * mean_metre(least, leg.ax, leg.ay, leg.bx, leg.by) / (3 * halves)
    return time * scale, back * scale


@kernel
def _fastest(
    least: tuple[float, float], largest: tuple[float, float], tx: float, ty: float, polar: Polar
) -> float:
    """Return the largest speed over ground (m/s) along unit tangent t in currents of a range.

    It assumes a current that helps along t at least as much as any of these, and hinders across t
    no more than any.
    """
    (low_u, low_v), (high_u, high_v) = least, largest
    along = max(tx * low_u, tx * high_u) + max(ty * low_v, ty * high_v)
    low = min(tx * low_v, tx * high_v) - max(ty * low_u, ty * high_u)
    high = max(tx * low_v, tx * high_v) - min(ty * low_u, ty * high_u)
    across = low if low > 0.0 else min(0.0, high)
    return ground_speed(along * tx - across * ty, along * ty + across * tx, tx, ty, polar)


class Mesh(NamedTuple):
    """The triangulation as legs are followed through it; `clearance` in m.

    A passing edge is only crossed at `clearance` or more from its ends on land.
    """

    corners: FloatArray  # (t, 3, 2), m
    neighbours: IntArray  # (t, 3), -1 across edges that are too narrow as well
    back: IntArray  # (t, 3): the corner of the neighbour that is opposite to the shared edge
    on_land: BoolArray  # (t, 3): whether the corner lies on land
    hazardous: BoolArray  # (t, 3): whether the edge opposite to the corner lies on land
    clearance: float


@kernel
def legs_between(
    points: FloatArray,
    triangle: IntArray,
    pairs: IntArray,
    mesh: Mesh,
    extremes: Extremes,
    polar: Polar,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, IntArray, IntArray]:
    """Return legs between pairs (p, 2) of nodes: the columns of a `Roadmap` from `first` on."""
    bounds, edges = _crossings(points, triangle, pairs, mesh)
    first = np.zeros(len(points) + 1, dtype=np.int64)
    for k in range(len(pairs)):
        if bounds[k] >= 0:
            first[pairs[k, 0] + 1] += 1
            first[pairs[k, 1] + 1] += 1
    first = np.cumsum(first)
    at = first[:-1].copy()
    # The pair of each leg, and whether it leads back.
    pair, leads_back = np.empty(first[-1], dtype=np.int64), np.zeros(first[-1], dtype=np.bool_)
    head = np.empty(first[-1], dtype=np.int64)
    time, back = np.empty((2, first[-1]))
    currents = currents_between(extremes, points)
    for k in range(len(pairs)):
        if bounds[k] < 0:
            continue
        a, b = pairs[k]
        leg = Segment(points[a, 0], points[a, 1], points[b, 0], points[b, 1])
        there, here = least_times(leg, currents[a], currents[b], extremes, polar)
        one, other = at[a], at[b]
        head[one], time[one], back[one], pair[one] = b, there, here, k
        head[other], time[other], back[other], pair[other] = a, here, there, k
        leads_back[other] = True
        at[a] += 1
        at[b] += 1
    return first, head, time, back, *_by_leg(pair, leads_back, bounds, edges, mesh)


@kernel
def _crossings(
    points: FloatArray, triangle: IntArray, pairs: IntArray, mesh: Mesh
) -> tuple[IntArray, IntArray]:
    """Return the edges that the lines between pairs of nodes cross, one line after the other.

    Also returns the place of each line's first edge (p + 1,), the last being the number of edges;
    -1 for a line that can't be sailed. A line's edges end where those of the next one begin.
    """
    begin = np.full(len(pairs) + 1, -1, dtype=np.int64)
    edges, count = np.empty(len(pairs) + _MAX_CROSSED, dtype=np.int64), 0
    for k in range(len(pairs)):
        if len(edges) < count + _MAX_CROSSED:
            edges = np.concatenate((edges, np.empty_like(edges)))
        a, b = pairs[k]
        leg = Segment(points[a, 0], points[a, 1], points[b, 0], points[b, 1])
        crossed = _crossed(mesh, leg, triangle[a], triangle[b], edges[count:])
        if crossed >= 0:
            begin[k] = count
            count += crossed
    begin[-1] = count
    return begin, edges[:count]


@reading_kernel
def _crossed(mesh: Mesh, leg: Segment, triangle: int, last: int, edges: IntArray) -> int:
    """Write the edges that a leg crosses between two triangles to `edges`; return their number.

    It is -1 where one of them can't be passed.
    """
    entry = -1
    for count in range(_MAX_CROSSED):
        if triangle == last:
            return count
        out, is_open = _crossed_edge(mesh, triangle, entry, leg)
        if not is_open:
            break
        edges[count] = 3 * triangle + out
        triangle, entry = mesh.neighbours[triangle, out], mesh.back[triangle, out]
    return -1


@kernel
def _by_leg(
    pair: IntArray, leads_back: BoolArray, begin: IntArray, edges: IntArray, mesh: Mesh
) -> tuple[IntArray, IntArray]:
    """Return edges that legs cross, from the pairs' edges, and where each leg's begin (m + 1,)."""
    end = begin[1:].copy()
    for k in range(len(end) - 2, -1, -1):
        if end[k] < 0:
            end[k] = end[k + 1]
    # Each edge as it is seen from the triangle behind it.
    behind = (3 * mesh.neighbours + mesh.back).ravel()
    first = np.zeros(len(pair) + 1, dtype=np.int64)
    for leg in range(len(pair)):
        first[leg + 1] = first[leg] + end[pair[leg]] - begin[pair[leg]]
    crossed = np.empty(first[-1], dtype=np.int32)
    for leg in range(len(pair)):
        at = first[leg]
        low, high = begin[pair[leg]], end[pair[leg]]
        for k in range(high - low):
            if leads_back[leg]:
                crossed[at + k] = behind[edges[high - 1 - k]]
            else:
                crossed[at + k] = edges[low + k]
    return first, crossed


@reading_kernel
def _crossed_edge(mesh: Mesh, triangle: int, entry: int, leg: Segment) -> tuple[int, bool]:
    """Return the edge by which a leg leaves a triangle, as the corner opposite to it; -1 for none.

    `entry` is the corner opposite to the edge by which it came in, -1 at its beginning. Also
    whether the edge may be crossed there.
    """
    ax, ay, bx, by = leg
    dx, dy = bx - ax, by - ay
    out, place = -1, 1.0 + _ROUNDING
    for c in range(3):
        if c == entry:
            continue
        px, py = mesh.corners[triangle, (c + 1) % 3]
        qx, qy = mesh.corners[triangle, (c + 2) % 3]
        ux, uy = qx - px, qy - py
        slope = ux * dy - uy * dx
        if slope < 0.0:
            # Inside is to the left of the edge.
            at = (ux * (ay - py) - uy * (ax - px)) / -slope
            if at < place:
                out, place = c, at
    if out < 0 or mesh.neighbours[triangle, out] < 0:
        return out, False
    if mesh.clearance == 0.0:
        return out, True
    one, other = (out + 1) % 3, (out + 2) % 3
    x, y = ax + place * dx, ay + place * dy
    for c in (one, other):
        if mesh.on_land[triangle, c]:
            px, py = mesh.corners[triangle, c]
            if (px - x) ** 2 + (py - y) ** 2 < mesh.clearance**2:
                return out, False
    return out, True
