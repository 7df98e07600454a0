"""Points on the passing edges, and the cheapest chains of legs between them: compiled.

A *gate* is a passing edge, crossed one way; it is numbered 3 t + c after the triangle t that it
leads into and the corner c opposite to it. A *node* is a point on a gate. Both ways through an
edge share its points. A *chain* of nodes is a rough path; what it needs orders the classes.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.h_signature import Rays, is_crossed, passed
from renew.classes.triangulation import Triangulation
from renew.inputs.current_table import Table, velocity


class Spread(NamedTuple):
    """How closely points stand on passing edges: share of the way from start to goal, and how many.

    A passing edge has one at the least and `most` at the most.
    """

    spacing: float
    most: int


COARSE, FINE = Spread(1 / 12, 5), Spread(1 / 600, 5)
"""Among few islands the order of classes comes right with few points. More are needed among many,
and to find the best of a class's channels, where islets without a ray give it several."""

# Legs are cut into pieces of this share of the way from start to goal.
_PIECE = 1 / 12
# A chain may lead against a current that the path itself avoids: it is taken to make at least
# this share of the vessel's speed over ground.
_LEAST_WAY = 0.1
_START, _GOAL = -1, -2
"""What stands for a node where there is none."""


class Mesh(NamedTuple):
    """What a search runs on; m, m/s. A gate's nodes are first[gate] to first[gate + 1]."""

    neighbours: IntArray  # (t, 3)
    back: IntArray  # (t, 3): the corner of the neighbour that is opposite to the shared edge
    first: IntArray  # (3 t + 1,)
    gate: IntArray  # (n,): the gate of each node
    points: FloatArray  # (n, 2)
    start: FloatArray  # (2,)
    goal: FloatArray
    start_in: int
    goal_in: int
    ray_x: FloatArray  # (i,), from west to east
    ray_y: FloatArray
    island: IntArray
    table: Table
    speed: float
    crab: bool
    piece: float


def mesh_of(
    triangulation: Triangulation,
    rays: Rays,
    start: FloatArray,
    goal: FloatArray,
    ends_in: tuple[int, int],
    *,
    table: Table,
    speed: float,
    crab: bool,
    clearance: float,
    spread: Spread,
) -> Mesh:
    """Put points on the passing edges, outside `clearance` m from the land at their ends.

    A passing edge that has no such points has no nodes: no chain crosses it.
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
    way = math.dist(start, goal)
    wanted = np.ceil((high - low) * length / (spread.spacing * way))
    count = np.clip(wanted, 1, spread.most).astype(np.int64)
    count[low >= high] = 0
    of_gate = np.zeros(neighbours.size, dtype=np.int64)
    of_gate[3 * triangle + corner] = count
    edge = np.repeat(np.arange(len(count)), count)
    place = (np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[edge]
    place = low[edge] + place * (high - low)[edge]
    return Mesh(
        neighbours,
        back,
        np.concatenate([[0], np.cumsum(of_gate)]),
        (3 * triangle + corner)[edge],
        a[edge] + place[:, None] * (b - a)[edge],
        start,
        goal,
        *ends_in,
        rays.x,
        rays.y,
        rays.island,
        table,
        speed,
        crab,
        _PIECE * way,
    )


@njit(cache=True, error_model="numpy")
def _time(mesh: Mesh, ax: float, ay: float, bx: float, by: float) -> float:
    """Time (s) over a leg, by the currents in the middle of its pieces."""
    dx, dy = bx - ax, by - ay
    length = math.hypot(dx, dy)
    if length == 0.0:
        return 0.0
    tx, ty = dx / length, dy / length
    pieces = 1 + int(length / mesh.piece)
    total = 0.0
    for k in range(pieces):
        place = (k + 0.5) / pieces
        u, v = velocity(mesh.table, ax + place * dx, ay + place * dy)
        ground = u * tx + v * ty
        if mesh.crab:
            across = v * tx - u * ty
            ground += math.sqrt(max(mesh.speed * mesh.speed - across * across, 0.0))
        else:
            ground += mesh.speed
        total += 1.0 / max(ground, _LEAST_WAY * mesh.speed)
    return total * length / pieces


@njit(cache=True, error_model="numpy")
def remaining(mesh: Mesh, shut: BoolArray) -> FloatArray:
    """Least time (n,) in s from each node to the goal; inf where no row of triangles leads.

    `shut` (t, 4, 4) marks the moves that may not be made, by the corners of the edges by which a
    triangle is entered and left, 3 standing for start and goal.
    """
    time = np.full(len(mesh.gate), np.inf)
    done = np.zeros(len(mesh.gate), dtype=np.bool_)
    queue = [(0.0, -1)]
    queue.pop()
    last = mesh.goal_in
    for node in range(mesh.first[3 * last], mesh.first[3 * last + 3]):
        if not shut[last, mesh.gate[node] % 3, 3]:
            x, y = mesh.points[node]
            time[node] = _time(mesh, x, y, mesh.goal[0], mesh.goal[1])
            heapq.heappush(queue, (time[node], node))
    while queue:
        now, node = heapq.heappop(queue)
        if done[node]:
            continue
        done[node] = True
        # Whoever stands here came through the neighbour, which it entered by another edge.
        gate = mesh.gate[node]
        triangle, corner = gate // 3, gate % 3
        before, out = mesh.neighbours[triangle, corner], mesh.back[triangle, corner]
        x, y = mesh.points[node]
        for entry in range(3):
            if entry == out or shut[before, entry, out]:
                continue
            for other in range(mesh.first[3 * before + entry], mesh.first[3 * before + entry + 1]):
                if done[other]:
                    continue
                arrival = now + _time(mesh, mesh.points[other, 0], mesh.points[other, 1], x, y)
                if arrival < time[other]:
                    time[other] = arrival
                    heapq.heappush(queue, (arrival, other))
    return time


@njit(cache=True, error_model="numpy")
def cheapest_rows(
    mesh: Mesh, left: FloatArray, shut: BoolArray, wanted: int, most_steps: int
) -> tuple[list[IntArray], list[IntArray]]:
    """Rows of triangles, and their words, of the `wanted` cheapest chains with different words.

    A search over pairs of (node, word so far), as in h-signature-augmented graphs: each pair is
    expanded once, by the cheapest chain that reaches it, so that twins which part only around a
    rayless islet cost nothing. `left` (n,) is what is left to go, exact but for rows that would
    use a triangle twice. It gives up after `most_steps`.
    """
    # States as columns that grow: node, word, state before, time so far.
    nodes, words, parents, times = [_START], [0], [-1], [0.0]
    # Words are a tree: word 0 is empty; each other is one letter longer than its stem.
    stems, letters, longer = [-1], [0], {0: 0}
    # What has nothing in it yet takes its type from what it is to hold. Pairs are kept as one
    # number: tuples take seconds to compile.
    seen, found = {0}, {0}
    rows, spelled = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    seen.clear()
    found.clear()
    rows.clear()
    spelled.clear()
    queue = [(0.0, 0)]
    for _ in range(most_steps):
        if not queue or len(rows) == wanted:
            break
        _, state = heapq.heappop(queue)
        node, word = nodes[state], words[state]
        pair = word * (len(mesh.gate) + 2) - node
        if pair in seen:
            continue
        seen.add(pair)
        if node == _GOAL:
            if word not in found:
                found.add(word)
                rows.append(_row(mesh, nodes, parents, state))
                spelled.append(_spelled(stems, letters, word))
            continue
        x, y = mesh.start
        if node != _START:
            x, y = mesh.points[node]
        for onwards in _following(mesh, left, shut, nodes, parents, state):
            bx, by = mesh.goal
            if onwards != _GOAL:
                bx, by = mesh.points[onwards]
            times.append(times[state] + _time(mesh, x, y, bx, by))
            nodes.append(onwards)
            words.append(_appended(mesh, stems, letters, longer, word, x, y, bx, by))
            parents.append(state)
            rest = left[onwards] if onwards != _GOAL else 0.0
            heapq.heappush(queue, (times[-1] + rest, len(nodes) - 1))
    return rows, spelled


@njit(cache=True, error_model="numpy")
def _following(
    mesh: Mesh,
    left: FloatArray,
    shut: BoolArray,
    nodes: list[int],
    parents: list[int],
    state: int,
) -> list[int]:
    """Nodes across the triangle that a state leads into, but for triangles it has gone through."""
    triangle, entry = mesh.start_in, 3
    if nodes[state] != _START:
        triangle, entry = divmod(mesh.gate[nodes[state]], 3)
    following = [_GOAL]
    if triangle != mesh.goal_in or shut[triangle, entry, 3]:
        following.clear()
    for out in range(3):
        after = mesh.neighbours[triangle, out]
        if after < 0 or out == entry or shut[triangle, entry, out]:
            continue
        if not _visited(mesh, nodes, parents, state, after):
            gate = 3 * after + mesh.back[triangle, out]
            across = range(mesh.first[gate], mesh.first[gate + 1])
            following += [node for node in across if left[node] < np.inf]
    return following


@njit(cache=True, error_model="numpy")
def _visited(mesh: Mesh, nodes: list[int], parents: list[int], state: int, triangle: int) -> bool:
    """Whether a row of triangles has gone through a triangle."""
    while nodes[state] != _START:
        if mesh.gate[nodes[state]] // 3 == triangle:
            return True
        state = parents[state]
    return bool(triangle == mesh.start_in)


@njit(cache=True, error_model="numpy")
def _row(mesh: Mesh, nodes: list[int], parents: list[int], state: int) -> IntArray:
    """Triangles from the first to the last of a state at the goal."""
    count = 0
    at = parents[state]
    while nodes[at] != _START:
        count, at = count + 1, parents[at]
    row = np.empty(count + 1, dtype=np.int64)
    row[0] = mesh.start_in
    at = parents[state]
    while nodes[at] != _START:
        row[count] = mesh.gate[nodes[at]] // 3
        count, at = count - 1, parents[at]
    return row


@njit(cache=True, error_model="numpy")
def _appended(
    mesh: Mesh,
    stems: list[int],
    letters: list[int],
    longer: dict[int, int],
    word: int,
    ax: float,
    ay: float,
    bx: float,
    by: float,
) -> int:
    """Word after a leg a -> b that follows a word."""
    first, last, step = passed(mesh.ray_x, ax, bx)
    for i in range(first, last, step):
        if not is_crossed(mesh.ray_x[i], mesh.ray_y[i], ax, ay, bx, by):
            continue
        letter = step * mesh.island[i]
        if word and letters[word] == -letter:
            word = stems[word]
            continue
        pair = word * (2 * len(mesh.island) + 1) + letter
        if pair not in longer:
            stems.append(word)
            letters.append(letter)
            longer[pair] = len(stems) - 1
        word = longer[pair]
    return word


@njit(cache=True, error_model="numpy")
def _spelled(stems: list[int], letters: list[int], word: int) -> IntArray:
    """Letters of a word of the tree."""
    count = 0
    at = word
    while at:
        count, at = count + 1, stems[at]
    result = np.empty(count, dtype=np.int64)
    while word:
        count -= 1
        result[count] = letters[word]
        word = stems[word]
    return result
