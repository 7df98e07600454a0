"""Points on the passing edges as a graph: what a search for classes runs on.

A *portal* is a passing edge crossed one way; it is numbered 3 t + c after the triangle t that it
leads into and the corner c opposite to it. A *node* is a point on a portal. Both ways through an
edge share its points. Two nodes are joined where a triangle lies between their portals.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.h_signature import Rays
from renew.classes.triangulation import Triangulation
from renew.inputs.current_table import Table, velocity
from renew.inputs.voyage import Voyage
from renew.kernels.capsules import Segment
from renew.kernels.ground_speed import Polar, ground_speed


class Density(NamedTuple):
    """How closely nodes stand on a passing edge.

    `spacing` is a share of the distance from start to goal; an edge has at least one node and at
    most `max_nodes`.
    """

    spacing: float
    max_nodes: int


COARSE, FINE = Density(1 / 12, 5), Density(1 / 600, 5)
"""Coarse nodes rank the classes among few islands. Among many they need fine ones, and so does the
best of a class's channels, where islands without a ray give it several."""

# Length of the pieces into which a leg is cut, as a share of the distance from start to goal, and
# at least a share of the chart's diagonal: far legs matter little for a short voyage.
_PIECE, _MIN_PIECE = 1 / 12, 1 / 60
# Lowest speed over ground, as a share of the vessel's: a straight chain may lead against a current
# that the path itself avoids.
_MIN_SPEED = 0.1


class PortalGraph(NamedTuple):
    """Nodes of a triangulation's portals, the rays that name classes, and what a leg costs.

    The nodes of a portal are first[portal] to first[portal + 1]. Lengths in m, speeds in m/s.
    """

    neighbours: IntArray  # (t, 3)
    back: IntArray  # (t, 3): the corner of the neighbour that is opposite to the shared edge
    first: IntArray  # (3 t + 1,)
    portal: IntArray  # (n,): the portal of each node
    points: FloatArray  # (n, 2)
    start: FloatArray  # (2,)
    goal: FloatArray  # (2,)
    start_triangle: int
    goal_triangle: int
    ray_x: FloatArray  # (i,), from west to east
    ray_y: FloatArray
    island: IntArray
    table: Table
    polar: Polar
    piece: float


def portal_graph(
    voyage: Voyage,
    triangulation: Triangulation,
    rays: Rays,
    endpoint_triangles: tuple[int, int],
    table: Table,
    *,
    clearance: float,
    density: Density,
) -> PortalGraph:
    """Put nodes on the passing edges, at least `clearance` m from the land at their ends.

    A passing edge without room for that has no nodes: no chain crosses it.
    """
    neighbours = triangulation.neighbours
    triangle, corner = np.nonzero(neighbours >= 0)
    back = np.zeros_like(neighbours)
    beside = neighbours[triangle, corner]
    back[triangle, corner] = (neighbours[beside] == triangle[:, None]).argmax(axis=1)
    # Both ways through an edge take its ends in the same order.
    vertices = np.sort(triangulation.edge_vertices(triangle, corner), axis=1)
    a, b = triangulation.vertices[vertices[:, 0]], triangulation.vertices[vertices[:, 1]]
    length = np.linalg.norm(b - a, axis=1)
    trim = clearance * triangulation.on_land[vertices] / np.maximum(length, 1e-300)[:, None]
    low, high = trim[:, 0], 1 - trim[:, 1]
    way = math.dist(voyage.start, voyage.goal)
    wanted = np.ceil((high - low) * length / (density.spacing * way))
    count = np.clip(wanted, 1, density.max_nodes).astype(np.int64)
    count[low >= high] = 0
    of_portal = np.zeros(neighbours.size, dtype=np.int64)
    of_portal[3 * triangle + corner] = count
    edge = np.repeat(np.arange(len(count)), count)
    place = (np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[edge]
    place = low[edge] + place * (high - low)[edge]
    return PortalGraph(
        neighbours=neighbours,
        back=back,
        first=np.concatenate([[0], np.cumsum(of_portal)]),
        portal=(3 * triangle + corner)[edge],
        points=a[edge] + place[:, None] * (b - a)[edge],
        start=voyage.start,
        goal=voyage.goal,
        start_triangle=endpoint_triangles[0],
        goal_triangle=endpoint_triangles[1],
        ray_x=rays.x,
        ray_y=rays.y,
        island=rays.island,
        table=table,
        polar=voyage.polar,
        piece=max(_PIECE * way, _MIN_PIECE * math.dist(*np.reshape(voyage.chart.bounds, (2, 2)))),
    )


@kernel
def leg_time(graph: PortalGraph, leg: Segment) -> float:
    """Time (s) over a leg, by the currents in the middle of its pieces."""
    ax, ay, bx, by = leg
    dx, dy = bx - ax, by - ay
    length = math.hypot(dx, dy)
    if length == 0.0:
        return 0.0
    tx, ty = dx / length, dy / length
    pieces = 1 + int(length / graph.piece)
    slowest = _MIN_SPEED * graph.polar.speed
    total = 0.0
    for k in range(pieces):
        place = (k + 0.5) / pieces
        u, v = velocity(graph.table, ax + place * dx, ay + place * dy)
        speed = ground_speed(u, v, tx, ty, graph.polar)
        total += 1.0 / (max(slowest, speed))
    return total * length / pieces


@kernel
def cost_to_go(graph: PortalGraph, blocked: BoolArray) -> FloatArray:
    """Least time (n,) in s from each node to the goal; inf where no row of triangles leads there.

    `blocked` (t, 4, 4) marks transitions that may not be made: a triangle, and the corners opposite
    to the edges by which it is entered and left, 3 standing for start and goal.
    """
    time = np.full(len(graph.portal), np.inf)
    done = np.zeros(len(graph.portal), dtype=np.bool_)
    queue = [(0.0, -1)]
    queue.pop()
    last = graph.goal_triangle
    for node in range(graph.first[3 * last], graph.first[3 * last + 3]):
        if not blocked[last, graph.portal[node] % 3, 3]:
            x, y = graph.points[node]
            time[node] = leg_time(graph, Segment(x, y, graph.goal[0], graph.goal[1]))
            heapq.heappush(queue, (time[node], node))
    while queue:
        now, node = heapq.heappop(queue)
        if done[node]:
            continue
        done[node] = True
        # A chain gets to this node through the neighbour, which it enters by another edge.
        portal = graph.portal[node]
        triangle, corner = portal // 3, portal % 3
        before, out = graph.neighbours[triangle, corner], graph.back[triangle, corner]
        x, y = graph.points[node]
        for entry in range(3):
            if entry == out or blocked[before, entry, out]:
                continue
            entered = 3 * before + entry
            for other in range(graph.first[entered], graph.first[entered + 1]):
                if done[other]:
                    continue
                leg = Segment(graph.points[other, 0], graph.points[other, 1], x, y)
                arrival = now + leg_time(graph, leg)
                if arrival < time[other]:
                    time[other] = arrival
                    heapq.heappush(queue, (arrival, other))
    return time
