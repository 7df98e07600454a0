"""A channel: a row of triangles from start to goal, in which paths of one class are planned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from renew._types import FloatArray, IntArray
from renew.classes import h_signature
from renew.classes.h_signature import VIA, Word
from renew.classes.triangulation import Triangulation

Transition: TypeAlias = tuple[int, int, int]
"""A triangle with the one before and the one after it; -1 before the start, after the goal."""


class RoughPath(NamedTuple):
    """Path by which a search found a class: points (n, 2), m, and the triangles (c,) crossed."""

    points: FloatArray
    triangles: IntArray


@dataclass(frozen=True)
class Channel:
    """A row of triangles from start to goal.

    Attributes
    ----------
    triangles : (n,) indices into the triangulation, none twice on the way to a via point.
    left, right : (n - 1, 2) ends of the passing edges in metres, as seen when sailing along.
    word : the homotopy class's h-signature.
    found_by : rough path of the class, if a search found it by one; it may leave the row.
    parts : the channels from one via point to the next, where there are any.
    """

    triangles: IntArray
    left: FloatArray
    right: FloatArray
    word: Word
    found_by: RoughPath | None = None
    parts: tuple[Channel, ...] = ()

    @classmethod
    def joined(cls, parts: Sequence[Channel], via: FloatArray) -> Channel:
        """Channel through via points (s - 1, 2), m, of the parts (s,) between them.

        In the triangle of a via point the row has a passing edge of no length there.
        """
        left, right = [parts[0].left], [parts[0].right]
        word = parts[0].word
        for point, part in zip(via, parts[1:], strict=True):
            left += [point[None], part.left]
            right += [point[None], part.right]
            word = (*word, VIA, *part.word)
        paths = [part.found_by for part in parts if part.found_by is not None]
        return cls(
            np.concatenate([part.triangles for part in parts]),
            np.concatenate(left),
            np.concatenate(right),
            word,
            RoughPath(
                np.concatenate([paths[0].points, *(path.points[1:] for path in paths[1:])]),
                np.concatenate([path.triangles for path in paths]),
            ),
            tuple(parts),
        )

    @classmethod
    def of(cls, triangulation: Triangulation, row: IntArray, word: Word = ()) -> Channel:
        """Channel of a row of triangles (n,)."""
        beside = triangulation.neighbours[row[:-1]]
        corners = (beside == row[1:, None]).argmax(axis=1)
        # Leaving an anticlockwise triangle across its edge (first, second): first is on the right.
        edges = triangulation.vertices[triangulation.edge_vertices(row[:-1], corners)]
        return cls(row, edges[:, 1], edges[:, 0], word)

    @property
    def name(self) -> str:
        """The class's name, such as "s2.p1"."""
        return h_signature.name(self.word)

    @property
    def transitions(self) -> list[Transition]:
        """How each triangle is crossed."""
        row = [-1, *self.triangles.tolist(), -1]
        return list(zip(row[:-2], row[1:-1], row[2:], strict=True))

    def midline(self, start: FloatArray, goal: FloatArray) -> FloatArray:
        """Start, the passing edges' midpoints, goal: shape (n + 1, 2)."""
        return np.vstack([start, (self.left + self.right) / 2, goal])

    def rough_path(self, start: FloatArray, goal: FloatArray) -> FloatArray:
        """The rough path by which the class was found, or the midline: shape (n, 2)."""
        return self.midline(start, goal) if self.found_by is None else self.found_by.points
