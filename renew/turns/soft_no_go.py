"""The soft no-go zone V: constrained edges, each with the padding that it needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from renew._types import FloatArray, IntArray
from renew.kernels.capsules import segment_distance


@dataclass(frozen=True, slots=True)
class PaddedEdges:
    """Constrained edges with their padding: the soft no-go zone V as capsules.

    `start`, `end` are (e, 2) metres, `padding` is (e,) metres and `edge` (e,) the index into the
    triangulation's constrained edges.
    """

    start: FloatArray
    end: FloatArray
    padding: FloatArray
    edge: IntArray

    @classmethod
    def joined(cls, parts: Sequence[PaddedEdges]) -> PaddedEdges:
        """All edges of some parts of a voyage, each once, with its least padding."""
        start, end, padding, edge = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("start", "end", "padding", "edge")
        )
        order = np.lexsort((padding, edge))
        kept = order[np.diff(edge[order], prepend=-1) != 0]
        return cls(start[kept], end[kept], padding[kept], edge[kept])

    def around(self, point: FloatArray) -> PaddedEdges:
        """Only the edges whose padding reaches over a point (2,)."""
        inside = segment_distance(point, self.start, self.end) < self.padding
        return PaddedEdges(
            self.start[inside], self.end[inside], self.padding[inside], self.edge[inside]
        )

    def grown(self, edges: IntArray, by: FloatArray) -> PaddedEdges:
        """Return them with the padding of some constrained edges larger by `by` metres each."""
        extra = np.zeros(len(self.edge))
        order = np.argsort(self.edge, kind="stable")
        np.maximum.at(extra, order[np.searchsorted(self.edge, edges, sorter=order)], by)
        return PaddedEdges(self.start, self.end, self.padding + extra, self.edge)

    def widened(self, places: FloatArray, by: FloatArray, reach: float) -> PaddedEdges:
        """Return them with the parts of edges within reach (m) of places (n, 2) padded more.

        By how much more is said for each place, (n,) metres.
        """
        distance = segment_distance(places[:, None], self.start, self.end)
        place, edge = np.nonzero(distance < reach)
        axis = self.end[edge] - self.start[edge]
        square = (axis * axis).sum(axis=1)
        middle = ((places[place] - self.start[edge]) * axis).sum(axis=1) / square
        half = reach / np.sqrt(square)
        low, high = np.clip([middle - half, middle + half], 0.0, 1.0)
        return PaddedEdges(
            np.concatenate([self.start, self.start[edge] + low[:, None] * axis]),
            np.concatenate([self.end, self.start[edge] + high[:, None] * axis]),
            np.concatenate([self.padding, self.padding[edge] + by[place]]),
            np.concatenate([self.edge, self.edge[edge]]),
        )
