"""The k best paths of a roadmap with different words: one for each of the k best classes.

The search is A* over pairs of (node, word so far), as in h-signature-augmented graphs
(Bhattacharya, Likhachev & Kumar, 2012), with the exact time to go as its heuristic. A label that is
no quicker than k other labels of the same node, each with another word, can't belong to the k best
classes: the other labels can continue to the goal on the same path. So a node has at most k words
in the search, however many islands there are.

The search keeps the rows of triangles that it has met, and the words of their paths. A row leads
from the start's triangle to the last triangle that a path has entered. It is *reduced*: a path that
turns back through the edge by which it entered a triangle shortens it, so that paths that can be
deformed into each other have the same row.
"""

import heapq
import math
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from renew._compiled import kernel, reading_kernel, small_kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.h_signature import is_crossed, rays_between
from renew.classes.legs import Mesh, time_along
from renew.classes.roadmap import GOAL, START, Roadmap
from renew.kernels.capsules import Segment
from renew.kernels.viterbi import Stream

# Stands for a row of triangles that is not allowed: it enters a triangle twice, or makes a blocked
# transition.
_IMPOSSIBLE = -2
# Stands for a row that nobody has asked for yet.
UNKNOWN = -1
# Numbers from here downwards stand for rows that must still be made; see `followed`.
TO_BE_MADE = -3
# Largest number of triangles at the end of a row from which a path has to turn back to reach the
# goal.
_MAX_ASTRAY = 2
# Number of triangles up to which rows that can't lead to the goal are recognised: among more, k
# classes are found long before such rows are looked at.
MAX_FLOODED = 1000
# Number of rows that there is room for at first.
_FIRST_ROWS = 1024

_Number = TypeVar("_Number", np.int64, np.float64)

# Columns of rows of triangles, (r, 8): they are a tree, each is one triangle longer than its stem.
# A row is reduced: a path that turns back through the edge by which it entered a triangle shortens
# it.
_STEM = 0
_TRIANGLE = 1  # the last triangle
_ENTRY = 2  # the corner opposite to the edge by which that was entered; 3 at the start
WORD = 3
_ASTRAY = 4  # from how many triangles, at its end, a path has to turn back to reach the goal
_LONGER = 5  # this and the next two: the next row, across each edge of the last triangle


class RayColumns(NamedTuple):
    """The rays by which words are spelled; see :class:`renew.classes.h_signature.Rays`."""

    x: FloatArray
    y: FloatArray
    island: IntArray


class SearchTask(NamedTuple):
    """Where to search, and for which classes.

    `blocked` (t, 4, 4) marks transitions that may not be made: a triangle, and the corners opposite
    to the edges by which it is entered and left, 3 standing for start and goal.
    """

    graph: Roadmap
    rays: RayColumns
    blocked: BoolArray


class Words(NamedTuple):
    """All words met so far as a tree: word 0 is empty, each other one letter longer than its stem.

    `newest` is the last word made from a word as its stem, and `older` the one made before it from
    the same stem; -1 is none. A dictionary would take a second to compile.
    """

    stem: list[int]
    letter: list[int]
    newest: list[int]
    older: list[int]


@kernel
def first_row(task: SearchTask) -> IntArray:
    """Return the table of rows with its first row, the start's triangle."""
    rows = np.full((_FIRST_ROWS, _LONGER + 3), UNKNOWN)
    rows[0, _TRIANGLE], rows[0, _ENTRY] = task.graph.triangle[START], 3
    rows[0, WORD], rows[0, _ASTRAY] = 0, 0
    return rows


@kernel
def no_words() -> Words:
    """Return the table of words with its first word, which is empty."""
    return Words([-1], [0], [-1], [-1])


@kernel
def with_room(array: npt.NDArray[_Number], size: int) -> npt.NDArray[_Number]:
    """Return an array with room for at least `size` rows, by doubling its length."""
    while len(array) < size:
        array = np.concatenate((array, np.full_like(array, UNKNOWN)))
    return array


@kernel
def row_after(
    task: SearchTask, words: Words, rows: IntArray, used: int, row: int, leg: int
) -> tuple[int, IntArray, int]:
    """Return the row after a leg, negative where there can be none; all rows, and their number."""
    onwards = followed(task.graph, rows, row, leg)
    while onwards <= TO_BE_MADE:
        rows = with_room(rows, used + 1)
        used += _lengthened(task, words, rows, TO_BE_MADE - onwards, used)
        onwards = followed(task.graph, rows, row, leg)
    return onwards, rows, used


@reading_kernel
def followed(graph: Roadmap, rows: IntArray, row: int, leg: int) -> int:
    """Return the row after a leg, negative where there can be none.

    If the row is not known yet, returns TO_BE_MADE - 3 r - e: r is the last known row, and e the
    edge by which the leg leaves it.
    """
    for k in range(graph.first_crossed[leg], graph.first_crossed[leg + 1]):
        out = graph.crossed[k] % 3
        after = rows[row, _LONGER + out] if out != rows[row, _ENTRY] else rows[row, _STEM]
        if after < 0:
            return _IMPOSSIBLE if after == _IMPOSSIBLE else TO_BE_MADE - 3 * row - out
        row = after
    return row


@kernel
def _lengthened(task: SearchTask, words: Words, rows: IntArray, place: int, new: int) -> int:
    """Write row `new`: a row with the triangle across an edge added. Return how many were written.

    That is 1, or 0 if the triangle may not be entered; then the table of rows notes that. `place`
    is three times the row that is lengthened, plus the corner opposite to the edge.
    """
    mesh, rays = task.graph.mesh, task.rays
    row, out = divmod(place, 3)
    triangle = rows[row, _TRIANGLE]
    after = mesh.neighbours[triangle, out]
    is_possible = not task.blocked[triangle, rows[row, _ENTRY], out]
    at = row
    while is_possible and at >= 0:
        is_possible = rows[at, _TRIANGLE] != after
        at = rows[at, _STEM]
    astray = 0 if _leads_on(task, rows, row, out) else rows[row, _ASTRAY] + 1
    if not is_possible or astray > _MAX_ASTRAY:
        rows[row, _LONGER + out] = _IMPOSSIBLE
        return 0
    # Any path through these triangles crosses the same rays: here from middle to middle.
    word = rows[row, WORD]
    for leg in _across(mesh, triangle, out):
        word = appended(rays, words, word, leg)
    # The rows that follow the new one are not known yet.
    rows[row, _LONGER + out] = new
    rows[new, _STEM], rows[new, _TRIANGLE] = row, after
    rows[new, _ENTRY] = mesh.back[triangle, out]
    rows[new, WORD], rows[new, _ASTRAY] = word, astray
    return 1


@kernel
def word_changes(task: SearchTask) -> BoolArray:
    """Return which edges (3 t,), numbered 3 triangle + corner, change a row's word."""
    mesh, rays = task.graph.mesh, task.rays
    changes = np.zeros(mesh.neighbours.size, dtype=np.bool_)
    for triangle in range(len(mesh.neighbours)):
        for out in range(3):
            after = mesh.neighbours[triangle, out]
            if after < 0:
                continue
            for leg in _across(mesh, triangle, out):
                first, last, step = rays_between(rays.x, leg.ax, leg.bx)
                for i in range(first, last, step):
                    if is_crossed(rays.x[i], rays.y[i], leg):
                        # Noted for both directions: by rounding, the test may differ between them.
                        changes[3 * triangle + out] = True
                        changes[3 * after + mesh.back[triangle, out]] = True
    return changes


@reading_kernel
def keeps_word(graph: Roadmap, changes: BoolArray, leg: int) -> bool:
    """Whether a leg crosses no edge across which words change."""
    for k in range(graph.first_crossed[leg], graph.first_crossed[leg + 1]):
        if changes[graph.crossed[k]]:
            return False
    return True


@kernel
def _across(mesh: Mesh, triangle: int, out: int) -> tuple[Segment, Segment]:
    """Return legs from a triangle's middle to that of an edge, and on to the next triangle's."""
    ax, ay = _middle(mesh, triangle)
    bx, by = _middle(mesh, mesh.neighbours[triangle, out])
    p, q = mesh.corners[triangle, (out + 1) % 3], mesh.corners[triangle, (out + 2) % 3]
    x, y = (p[0] + q[0]) / 2, (p[1] + q[1]) / 2
    return Segment(ax, ay, x, y), Segment(x, y, bx, by)


@kernel
def _leads_on(task: SearchTask, rows: IntArray, row: int, out: int) -> bool:
    """Whether the goal can be reached across an edge without entering the row's triangles again."""
    mesh, last = task.graph.mesh, task.graph.triangle[GOAL]
    count = len(mesh.neighbours)
    if count > MAX_FLOODED:
        return True
    # A triangle, and the edge by which it is entered, as 3 t + corner.
    seen = np.zeros(3 * count, dtype=np.bool_)
    waiting = np.empty(3 * count, dtype=np.int64)
    triangle = rows[row, _TRIANGLE]
    waiting[0], size = 3 * mesh.neighbours[triangle, out] + mesh.back[triangle, out], 1
    while row >= 0:
        triangle = rows[row, _TRIANGLE]
        seen[3 * triangle : 3 * triangle + 3] = True
        row = rows[row, _STEM]
    while size:
        size -= 1
        triangle, entry = divmod(waiting[size], 3)
        if triangle == last and not task.blocked[triangle, entry, 3]:
            return True
        for corner in range(3):
            beside = mesh.neighbours[triangle, corner]
            if beside < 0 or corner == entry or task.blocked[triangle, entry, corner]:
                continue
            place = 3 * beside + mesh.back[triangle, corner]
            if not seen[place]:
                seen[place] = True
                waiting[size] = place
                size += 1
    return False


@kernel
def _middle(mesh: Mesh, triangle: int) -> tuple[float, float]:
    """Return the centroid of a triangle."""
    corners = mesh.corners[triangle]
    return (
        (corners[0, 0] + corners[1, 0] + corners[2, 0]) / 3,
        (corners[0, 1] + corners[1, 1] + corners[2, 1]) / 3,
    )


@kernel
def triangles_of(rows: IntArray, row: int) -> IntArray:
    """Return triangles of a row, from the start's on."""
    return up_to(rows, row, _TRIANGLE, _STEM)


@kernel
def up_to(table: IntArray, row: int, column: int, before: int) -> IntArray:
    """Return a column's values along the stems that lead to a row; `before` has each row's stem."""
    values = [table[row, column]]
    while table[row, before] >= 0:
        row = table[row, before]
        values.append(table[row, column])
    return np.array(values[::-1], dtype=np.int64)


@kernel
def appended(rays: RayColumns, words: Words, word: int, leg: Segment) -> int:
    """Return the number of the word that a path has after a leg, if it had `word` before."""
    first, last, step = rays_between(rays.x, leg.ax, leg.bx)
    for i in range(first, last, step):
        if not is_crossed(rays.x[i], rays.y[i], leg):
            continue
        letter = step * rays.island[i]
        if word and words.letter[word] == -letter:
            word = words.stem[word]
            continue
        longer = words.newest[word]
        while longer >= 0 and words.letter[longer] != letter:
            longer = words.older[longer]
        if longer < 0:
            longer = len(words.stem)
            words.stem.append(word)
            words.letter.append(letter)
            words.newest.append(-1)
            words.older.append(words.newest[word])
            words.newest[word] = longer
        word = longer
    return word


@reading_kernel
def may_end(task: SearchTask, rows: IntArray, row: int) -> bool:
    """Whether the transition from a row's last triangle to the goal is not blocked."""
    return not task.blocked[rows[row, _TRIANGLE], rows[row, _ENTRY], 3]


@kernel
def number_of_classes(
    task: SearchTask, words: Words, rows: IntArray, most: int
) -> tuple[int, IntArray, int]:
    """Return how many rows reach the goal (counted up to `most`), all rows made, and their number.

    Among many triangles nothing is counted, and the number is `most`.
    """
    found, waiting = 0, [0]
    used = len(waiting)  # not 1: for a literal the compiler would make `_lengthened` once more
    if len(task.graph.mesh.neighbours) > MAX_FLOODED:
        return most, rows, used
    while waiting and found < most:
        row = waiting.pop()
        if rows[row, _TRIANGLE] == task.graph.triangle[GOAL]:
            found += may_end(task, rows, row)
            continue
        for out in range(3):
            is_edge = task.graph.mesh.neighbours[rows[row, _TRIANGLE], out] >= 0
            if is_edge and out != rows[row, _ENTRY]:
                rows = with_room(rows, used + 1)
                if _lengthened(task, words, rows, 3 * row + out, used):
                    if rows[used, _ASTRAY] == 0:
                        waiting.append(used)
                    used += 1
    return found, rows, used


# A label that is not wanted.
_BEATEN = -2
# Number of labels that there is room for at first.
_FIRST_LABELS = 1024
# Number of buckets by which labels are ordered: they take a tenth of the time of a heap. The last
# bucket holds all labels whose time is more than about a hundred times the best.
_BUCKETS = 1 << 18
# Ratio of the times of successive buckets, less 1.
_BUCKET_SIZE = 2e-5
# In a mesh of many triangles, paths are looked for up to this multiple of the best path's time:
# most slower ones wind about islands that no better path has to pass.
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


def time_to_go(graph: Roadmap) -> FloatArray:
    """Return the least time (n,), s, from each node to the goal, at any hour; inf without a way."""
    return np.asarray(time_from(graph, GOAL, graph.back))


@kernel
def time_from(graph: Roadmap, root: int, times: FloatArray) -> FloatArray:
    """Return the least sum (n,), s, of legs' times (m,) from a root to each node; inf for none."""
    time = np.full(len(graph.points), np.inf)
    time[root] = 0.0
    done = np.zeros(len(time), dtype=np.bool_)
    queue = [(0.0, root)]
    while queue:
        now, node = heapq.heappop(queue)
        if done[node]:
            continue
        done[node] = True
        for leg in range(graph.first[node], graph.first[node + 1]):
            other = graph.head[leg]
            arrival = now + times[leg]
            if arrival < time[other]:
                time[other] = arrival
                heapq.heappush(queue, (arrival, other))
    return time


@kernel
def nodes_of_rounded_path(
    graph: Roadmap, time: FloatArray, to_go: FloatArray, turn_rate: float
) -> IntArray:
    """Return the nodes (n,) of the quickest path whose corners a vessel can round; empty if none.

    Legs take `time` (m,), s, and `to_go` (n,), s, is the least time from each node. A corner can be
    rounded if an arc at the speed over ground, of the quicker leg, ends within half of each leg.
    """
    arrival, before = np.full(len(time), np.inf), np.full(len(time), -1)
    done = np.zeros(len(time), dtype=np.bool_)
    tail = np.empty(len(time), dtype=np.int64)
    for node in range(len(graph.points)):
        tail[graph.first[node] : graph.first[node + 1]] = node
    queue = [(0.0, 0)]
    queue.clear()
    for leg in range(graph.first[START], graph.first[START + 1]):
        arrival[leg] = time[leg]
        heapq.heappush(queue, (time[leg] + to_go[graph.head[leg]], leg))
    while queue:
        whole, leg = heapq.heappop(queue)
        if whole == np.inf:
            break
        node = graph.head[leg]
        if node == GOAL:
            return up_to(np.column_stack((before, graph.head)), leg, 1, 0)
        if done[leg]:
            continue
        done[leg] = True
        for after in range(graph.first[node], graph.first[node + 1]):
            now = arrival[leg] + time[after]
            if now < arrival[after] and _can_round(graph, tail, time, leg, after, turn_rate):
                arrival[after], before[after] = now, leg
                heapq.heappush(queue, (now + to_go[graph.head[after]], after))
    return np.empty(0, dtype=np.int64)


@reading_kernel
def _can_round(
    graph: Roadmap, tail: IntArray, time: FloatArray, leg: int, after: int, turn_rate: float
) -> bool:
    """Whether a vessel can round the corner between a leg and the one after it."""
    (ax, ay), (bx, by) = graph.points[tail[leg]], graph.points[graph.head[leg]]
    cx, cy = graph.points[graph.head[after]]
    ux, uy, vx, vy = bx - ax, by - ay, cx - bx, cy - by
    one, other = math.hypot(ux, uy), math.hypot(vx, vy)
    radius = max(one / time[leg], other / time[after]) / turn_rate
    # The arc takes the radius times the tangent of half the angle of both legs.
    sin, cos = abs(ux * vy - uy * vx), one * other + ux * vx + uy * vy
    return bool(radius * sin <= cos * min(one, other) / 2)


@kernel
def _first_label(nodes: int) -> tuple[IntArray, FloatArray, IntArray]:
    """Return labels and their times, with the start's filled in, and each node's newest label."""
    labels, times = np.zeros((_FIRST_LABELS, 6), dtype=np.int64), np.zeros(_FIRST_LABELS)
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
    """Return the time (s) since departure at the end of a leg that is begun at the time `now`.

    `least` is a lower bound on it, and the time itself in a steady current.
    """
    if len(stream.table.times) == 1:
        return least
    (ax, ay), (bx, by) = graph.points[node], graph.points[other]
    begin = stream.clock.departure + now
    time = time_along(Segment(ax, ay, bx, by), begin, stream.table, stream.polar)
    return max(least, now + time)


@kernel
def _no_rows() -> list[IntArray]:
    """Return an empty list of rows. A row is put in and removed: it tells the compiler the type."""
    rows = [np.empty(0, dtype=np.int64)]
    rows.clear()
    return rows


@kernel
def _queued(entries: list[tuple[int, int]], label: int, older: int) -> int:
    """Add an entry for a label, before the `older` one of its bucket; return its number."""
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
