"""The k best chains of nodes with different words: one for each of the k best classes.

A *chain* of nodes, one on each passing edge, is a rough path; its time ranks its class. The search
is A* over pairs of (node, word so far), as in h-signature-augmented graphs (Bhattacharya, Likhachev
& Kumar, 2012): each pair is expanded once, by the quickest chain that reaches it, so that channels
which part only around an island without a ray cost nothing.
"""

from __future__ import annotations

import heapq
from typing import NamedTuple

import numpy as np

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.h_signature import is_crossed, rays_between
from renew.classes.portal_graph import PortalGraph, leg_time
from renew.kernels.capsules import Segment

# Stand for the start and the goal in the place of a node's number.
_START, _GOAL = -1, -2


class _States(NamedTuple):
    """States of the search as columns that grow: node, word, the state before, time so far (s)."""

    node: list[int]
    word: list[int]
    parent: list[int]
    time: list[float]


class _Words(NamedTuple):
    """All words met so far as a tree: word 0 is empty, each other one letter longer than its stem.

    `longer` finds a word by the number of its stem and its last letter.
    """

    stem: list[int]
    letter: list[int]
    longer: dict[int, int]


@kernel
def k_best_chains(
    graph: PortalGraph, cost_to_go: FloatArray, blocked: BoolArray, count: int, max_steps: int
) -> tuple[list[IntArray], list[IntArray]]:
    """Rows of triangles, and their words, of the `count` quickest chains with different words.

    `cost_to_go` (n,) must be exact for these blocked transitions (but for rows that would use a
    triangle twice); otherwise A* expands thousands of near-equal chains. The search gives up after
    `max_steps`.
    """
    states = _States([_START], [0], [-1], [0.0])
    tree = _Words([-1], [0], {0: 0})
    # An empty list or set has no type for the compiler: it takes that of what is removed again.
    # Pairs are kept as one number: tuples take seconds to compile.
    expanded, found = {0}, {0}
    rows, words = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    expanded.clear()
    found.clear()
    rows.clear()
    words.clear()
    queue = [(0.0, 0)]
    for _ in range(max_steps):
        if not queue or len(rows) == count:
            break
        _, state = heapq.heappop(queue)
        node, word = states.node[state], states.word[state]
        pair = word * (len(graph.portal) + 2) - node
        if pair in expanded:
            continue
        expanded.add(pair)
        if node == _GOAL:
            if word not in found:
                found.add(word)
                rows.append(_row(graph, states, state))
                words.append(_letters(tree, word))
            continue
        x, y = graph.start
        if node != _START:
            x, y = graph.points[node]
        for onwards in _successors(graph, cost_to_go, blocked, states, state):
            bx, by = graph.goal
            if onwards != _GOAL:
                bx, by = graph.points[onwards]
            leg = Segment(x, y, bx, by)
            states.time.append(states.time[state] + leg_time(graph, leg))
            states.node.append(onwards)
            states.word.append(_appended(graph, tree, word, leg))
            states.parent.append(state)
            rest = cost_to_go[onwards] if onwards != _GOAL else 0.0
            heapq.heappush(queue, (states.time[-1] + rest, len(states.node) - 1))
    return rows, words


@kernel
def _successors(
    graph: PortalGraph, cost_to_go: FloatArray, blocked: BoolArray, states: _States, state: int
) -> list[int]:
    """Nodes across the triangle that a state leads into, except in triangles used before."""
    triangle, entry = graph.start_triangle, 3
    if states.node[state] != _START:
        triangle, entry = divmod(graph.portal[states.node[state]], 3)
    successors = [_GOAL]
    if triangle != graph.goal_triangle or blocked[triangle, entry, 3]:
        successors.clear()
    for out in range(3):
        after = graph.neighbours[triangle, out]
        if after < 0 or out == entry or blocked[triangle, entry, out]:
            continue
        if not _is_used(graph, states, state, after):
            portal = 3 * after + graph.back[triangle, out]
            across = range(graph.first[portal], graph.first[portal + 1])
            successors += [node for node in across if cost_to_go[node] < np.inf]
    return successors


@kernel
def _is_used(graph: PortalGraph, states: _States, state: int, triangle: int) -> bool:
    """Whether the chain to a state has gone through a triangle."""
    while states.node[state] != _START:
        if graph.portal[states.node[state]] // 3 == triangle:
            return True
        state = states.parent[state]
    return bool(triangle == graph.start_triangle)


@kernel
def _row(graph: PortalGraph, states: _States, state: int) -> IntArray:
    """Triangles, from the first to the last, of a state at the goal."""
    count = 0
    at = states.parent[state]
    while states.node[at] != _START:
        count, at = count + 1, states.parent[at]
    row = np.empty(count + 1, dtype=np.int64)
    row[0] = graph.start_triangle
    at = states.parent[state]
    while states.node[at] != _START:
        row[count] = graph.portal[states.node[at]] // 3
        count, at = count - 1, states.parent[at]
    return row


@kernel
def _appended(graph: PortalGraph, tree: _Words, word: int, leg: Segment) -> int:
    """Number of the word after a leg that follows a word."""
    first, last, step = rays_between(graph.ray_x, leg.ax, leg.bx)
    for i in range(first, last, step):
        if not is_crossed(graph.ray_x[i], graph.ray_y[i], leg):
            continue
        letter = step * graph.island[i]
        if word and tree.letter[word] == -letter:
            word = tree.stem[word]
            continue
        pair = word * (2 * len(graph.island) + 1) + letter
        if pair not in tree.longer:
            tree.stem.append(word)
            tree.letter.append(letter)
            tree.longer[pair] = len(tree.stem) - 1
        word = tree.longer[pair]
    return word


@kernel
def _letters(tree: _Words, word: int) -> IntArray:
    """Letters of a word of the tree."""
    count = 0
    at = word
    while at:
        count, at = count + 1, tree.stem[at]
    letters = np.empty(count, dtype=np.int64)
    while word:
        count -= 1
        letters[count] = tree.letter[word]
        word = tree.stem[word]
    return letters
