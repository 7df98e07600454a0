"""Rows of triangles that a search has met, and the words of their paths.

A row leads from the start's triangle to the last triangle that a path has entered. It is *reduced*:
a path that turns back through the edge by which it entered a triangle shortens it, so that paths
that can be deformed into each other have the same row.
"""

from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from renew._compiled import kernel, reading_kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.h_signature import is_crossed, rays_between
from renew.classes.legs import Mesh
from renew.classes.roadmap import GOAL, START, Roadmap
from renew.kernels.capsules import Segment

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
_CAPACITY = 1024

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
    rows = np.full((_CAPACITY, _LONGER + 3), UNKNOWN)
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
    """Lengthen a row by the triangle across an edge, as row `new`; return 1, or 0 if it can't be.

    If the triangle may not be entered, the table of rows notes it. `place` is three times the row
    that is lengthened, plus the corner opposite to the edge.
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
    """Return the number of the word that a leg makes of a word."""
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
