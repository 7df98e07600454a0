"""The k best paths of a roadmap with different words: one for each of the k best classes.

The search is A* over pairs of (node, word so far), as in h-signature-augmented graphs
(Bhattacharya, Likhachev & Kumar, 2012), with the exact time to go as its heuristic. A label that is
no quicker than k other labels of the same node, each with another word, can't belong to the k best
classes: the other labels can continue to the goal on the same path. So a node has at most k words
in the search, however many islands there are.
"""

import heapq
import math

import numpy as np

from renew._compiled import kernel, reading_kernel, small_kernel
from renew._types import FloatArray, IntArray
from renew.classes.legs import time_along
from renew.classes.reduced_rows import (
    MAX_FLOODED,
    TO_BE_MADE,
    UNKNOWN,
    WORD,
    SearchTask,
    first_row,
    followed,
    keeps_word,
    may_end,
    no_words,
    number_of_classes,
    row_after,
    triangles_of,
    up_to,
    with_room,
    word_changes,
)
from renew.classes.roadmap import GOAL, START, Roadmap
from renew.kernels.capsules import Segment
from renew.kernels.viterbi import Stream

# A label that is not wanted.
_BEATEN = -2
# Number of labels that there is room for at first.
_CAPACITY = 1024
# Number of buckets by which labels are ordered: they take a tenth of the time of a heap. The last
# bucket holds all labels whose time is more than about a hundred times the best.
_BUCKETS = 1 << 18
# Ratio of the times of successive buckets, less 1.
_BUCKET_SIZE = 2e-5
# Largest time of the paths that are looked for, as a multiple of the best path's time, in a mesh of
# many triangles: most of the slower paths there wind about islands that no better path has to pass.
_DEAREST = 1.6
# The same in any other mesh: no limit, but finite, so that 0 times it is 0.
_ANY = 1e300
# Columns of labels, (l, 6) whole numbers. A node has one label for each word.
_NODE = 0
_ROW = 1
_WORD = 2  # the word of the row
_PARENT = 3  # the label before, on the path
_OLDER = 4  # the label that the node had before
_SETTLED = 5  # 1 once the label is settled


@kernel
def time_to_go(graph: Roadmap) -> FloatArray:
    """Return the least time (n,), s, from each node to the goal, at any hour; inf without a way."""
    time = np.full(len(graph.points), np.inf)
    time[GOAL] = 0.0
    done = np.zeros(len(time), dtype=np.bool_)
    queue = [(0.0, GOAL)]
    while queue:
        now, node = heapq.heappop(queue)
        if done[node]:
            continue
        done[node] = True
        for leg in range(graph.first[node], graph.first[node + 1]):
            other = graph.head[leg]
            arrival = now + graph.back[leg]
            if arrival < time[other]:
                time[other] = arrival
                heapq.heappush(queue, (arrival, other))
    return time


@kernel
def _first_label(nodes: int) -> tuple[IntArray, FloatArray, IntArray]:
    """Return labels and their times, with the start's filled in, and each node's newest label."""
    labels, times = np.zeros((_CAPACITY, 6), dtype=np.int64), np.zeros(_CAPACITY)
    labels[0, _NODE], labels[0, _PARENT], labels[0, _OLDER] = START, -1, -1
    newest = np.full(nodes, -1, dtype=np.int64)
    newest[START] = 0
    return labels, times, newest


@kernel
def k_best_paths(
    task: SearchTask,
    to_go: FloatArray,
    stream: Stream,
    count: int,
    max_steps: int,
    dearest: float = math.inf,
) -> tuple[list[IntArray], list[IntArray]]:
    """Return rows of triangles, and nodes (n,), of the `count` quickest paths with different words.

    `to_go` (n,) is :func:`time_to_go`. Where the current of the `stream` changes, legs are timed by
    the clock of the `stream`. No row has a triangle twice.
    Paths that take more than `dearest` times as long as the best are left out. The search gives up
    after `max_steps`.
    """
    graph = task.graph
    rows, words = first_row(task), no_words()
    labels, times, newest = _first_label(len(graph.points))
    count, rows, used_rows = number_of_classes(task, words, rows, count)
    used, changes, found, paths = 1, word_changes(task), _no_rows(), _no_rows()
    dearest = min(dearest, _DEAREST if len(graph.mesh.neighbours) > MAX_FLOODED else _ANY)
    # In a steady current the least time is the time of the best path.
    latest = to_go[START] * (dearest if len(stream.table.times) == 1 else _ANY)
    # Buckets of labels by their whole time: each holds its newest entry, which leads to older ones.
    bucket, entries, at = np.full(_BUCKETS, -1), [(0, -1)], 0
    bucket[0] = 0 if to_go[START] < np.inf else -1
    for _ in range(max_steps):
        at = _first_filled(bucket, at)
        if at == _BUCKETS or len(found) == count:
            break
        label, bucket[at] = entries[bucket[at]]
        node, row, now = labels[label, _NODE], labels[label, _ROW], times[label]
        is_known, labels[label, _SETTLED] = labels[label, _SETTLED], 1
        if not is_known and node == GOAL and may_end(task, rows, row):
            found.append(triangles_of(rows, row))
            latest = min(latest, dearest * now)
            paths.append(up_to(labels, label, _NODE, _PARENT))
        if is_known or node == GOAL:
            continue
        labels = with_room(labels, used + graph.first[node + 1] - graph.first[node])
        times = with_room(times, len(labels))
        for leg in range(graph.first[node], graph.first[node + 1]):
            other, time = graph.head[leg], now + graph.time[leg]
            # Most legs end where a label with the same word is quicker: they need no row.
            if time + to_go[other] > latest or (
                keeps_word(graph, changes, leg)
                and _known(labels, times, newest[other], rows[row, WORD], time, count) == _BEATEN
            ):
                continue
            time = _by_clock(graph, node, other, now, time, stream)
            onwards = followed(graph, rows, row, leg)
            if onwards <= TO_BE_MADE:
                onwards, rows, used_rows = row_after(task, words, rows, used_rows, row, leg)
            word = rows[max(onwards, 0), WORD]
            noted = (
                _BEATEN if onwards < 0 else _known(labels, times, newest[other], word, time, count)
            )
            if noted == _BEATEN:
                continue
            if noted == UNKNOWN:
                noted, used = used, used + 1
                labels[noted, _OLDER], newest[other] = newest[other], noted
            labels[noted, _NODE], labels[noted, _ROW] = other, onwards
            labels[noted, _WORD], labels[noted, _PARENT] = word, label
            labels[noted, _SETTLED] = 0
            times[noted] = time
            place = max(_bucket_of((time + to_go[other]) / to_go[START]), at)
            bucket[place] = _queued(entries, noted, bucket[place])
    return found, paths


@small_kernel
def _by_clock(
    graph: Roadmap, node: int, other: int, now: float, least: float, stream: Stream
) -> float:
    """Return the time (s) since departure at the end of a leg begun now; the least if steady."""
    if len(stream.table.times) == 1:
        return least
    (ax, ay), (bx, by) = graph.points[node], graph.points[other]
    begin = stream.clock.departure + now
    time = time_along(Segment(ax, ay, bx, by), begin, stream.table, stream.polar)
    return max(least, now + time)


@kernel
def _no_rows() -> list[IntArray]:
    """Return an empty list of rows; a row is removed again so that the compiler knows its type."""
    rows = [np.empty(0, dtype=np.int64)]
    rows.clear()
    return rows


@kernel
def _queued(entries: list[tuple[int, int]], label: int, older: int) -> int:
    """Return the number of a new entry for a label; it leads to the older ones of its bucket."""
    entries.append((label, older))
    return len(entries) - 1


@kernel
def _bucket_of(ratio: float) -> int:
    """Return the bucket of labels whose whole time is some multiple of the least."""
    return min(max(int(math.log(ratio) / _BUCKET_SIZE), 0), _BUCKETS - 1)


@reading_kernel
def _first_filled(bucket: IntArray, at: int) -> int:
    """Return the first bucket, from `at` on, that holds a label, or else the number of buckets."""
    while at < len(bucket) and bucket[at] < 0:
        at += 1
    return at


@reading_kernel
def _known(
    labels: IntArray, times: FloatArray, label: int, word: int, time: float, count: int
) -> int:
    """Find the label in which to note a time at a node: the node's label with the same word.

    `label` is the node's newest label. Returns _BEATEN if the label with the word is as quick, or
    settled. If no label has the word, returns _BEATEN if at least `count` labels are as quick, and
    else UNKNOWN.
    """
    quicker = 0
    while label >= 0:
        is_quicker = times[label] <= time
        if labels[label, _WORD] == word:
            return _BEATEN if is_quicker or labels[label, _SETTLED] else label
        quicker += is_quicker
        label = labels[label, _OLDER]
    return _BEATEN if quicker >= count else UNKNOWN


@kernel
def triangles_crossed(graph: Roadmap, nodes: IntArray) -> IntArray:
    """Return the triangles (c,) that a path over nodes (n,) leaves, and the last node's triangle.

    Unlike a row of triangles, they include the triangles from which the path turns back.
    """
    legs, count = np.empty(len(nodes) - 1, dtype=np.int64), 0
    for k in range(len(legs)):
        leg = graph.first[nodes[k]]
        while graph.head[leg] != nodes[k + 1]:
            leg += 1
        legs[k] = leg
        count += graph.first_crossed[leg + 1] - graph.first_crossed[leg]
    triangles, at = np.empty(count + 1, dtype=np.int64), 0
    for leg in legs:
        for k in range(graph.first_crossed[leg], graph.first_crossed[leg + 1]):
            triangles[at] = graph.crossed[k] // 3
            at += 1
    triangles[at] = graph.triangle[nodes[-1]]
    return triangles
