"""Finds the narrow straits between coasts of different land.

Between two close coasts there are many gaps, most of them between rocks and useless. Gaps are taken
in the order of their width, and each gap between two parts of the land joins them into one: wider
gaps between these two are skipped (Kruskal, *On the shortest spanning subtree of a graph*, 1956).
The remaining gaps are the bottlenecks: if they are wide enough, every strait is wide enough. The
detour around a shut gap depends on the smaller of the two parts.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from pipeline._types import FloatArray, Geometries, IndexArray

# Coasts are divided into pieces of this many segments, to measure distances between pieces.
_PIECE = 16


@dataclass(frozen=True, slots=True)
class Gap:
    """A gap between two parts of the land, planar metres.

    `line` (2, 2) leads from coast to coast, `part_m` is the size of the smaller part: the diagonal
    of its bounds.
    """

    line: FloatArray
    part_m: float

    @property
    def width_m(self) -> float:
        """Width of the gap."""
        return float(np.linalg.norm(self.line[1] - self.line[0]))


def narrow_gaps(
    land: Geometries, widest_m: float, is_shut: Callable[[FloatArray], bool]
) -> list[Gap]:
    """Return the shut bottlenecks between parts of the land (valid planar polygons).

    Gaps up to `widest_m` wide count, the narrowest first; `is_shut` takes a gap's line (2, 2).
    """
    bodies = shapely.get_parts(shapely.disjoint_subset_union_all(land))
    lines, owner = _close_pairs(bodies, widest_m)
    parts = _Parts(shapely.bounds(bodies))
    found = []
    for line, (one, other) in zip(lines, owner.tolist(), strict=True):
        one, other = parts.of(one), parts.of(other)  # noqa: PLW2901 - the parts that they are in
        if one != other and is_shut(line):
            found.append(Gap(line, min(parts.size(one), parts.size(other))))
            parts.join(one, other)
    return found


def _close_pairs(bodies: Geometries, widest_m: float) -> tuple[FloatArray, IndexArray]:
    """Return the shortest lines (n, 2, 2) between bodies that are close, and both bodies (n, 2).

    The shortest lines come first.
    """
    pieces, owner = _pieces(bodies)
    if not len(pieces):
        return np.empty((0, 2, 2)), np.empty((0, 2), dtype=np.intp)
    one, other = shapely.STRtree(pieces).query(pieces, predicate="dwithin", distance=widest_m)
    differ = owner[one] < owner[other]
    one, other = one[differ], other[differ]
    apart = shapely.distance(pieces[one], pieces[other])
    order = np.lexsort((apart, owner[other], owner[one]))
    pairs = np.stack([owner[one[order]], owner[other[order]]], axis=-1)
    is_first = np.ones(len(pairs), dtype=bool)
    is_first[1:] = (pairs[1:] != pairs[:-1]).any(axis=1)
    nearest = order[is_first]
    nearest = nearest[np.argsort(apart[nearest], kind="stable")]
    lines = shapely.shortest_line(pieces[one[nearest]], pieces[other[nearest]])
    ends = np.stack([owner[one[nearest]], owner[other[nearest]]], axis=-1)
    return shapely.get_coordinates(lines).reshape(-1, 2, 2), ends


def _pieces(bodies: Geometries) -> tuple[Geometries, IndexArray]:
    """Divide the coasts of bodies into lines (n,) of some segments, with their bodies (n,)."""
    rings, body = shapely.get_rings(bodies, return_index=True)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    number = np.arange(len(points)) - np.searchsorted(ring, ring)
    last = np.searchsorted(ring, ring, side="right") - 1
    begins = np.flatnonzero((number % _PIECE == 0) & (np.arange(len(points)) < last))
    counts = np.minimum(_PIECE, last[begins] - begins) + 1
    piece = np.repeat(np.arange(len(begins)), counts)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    lines = shapely.linestrings(points[begins[piece] + within], indices=piece)
    return np.atleast_1d(lines), body[ring[begins]]


class _Parts:
    """Disjoint sets of bodies, with their bounds (n, 4)."""

    def __init__(self, bounds: FloatArray) -> None:
        self._bounds, self._above = bounds.copy(), list(range(len(bounds)))

    def of(self, body: int) -> int:
        """Return the number of the part that a body is in."""
        while self._above[body] != body:
            self._above[body] = self._above[self._above[body]]
            body = self._above[body]
        return body

    def size(self, part: int) -> float:
        """Return the diagonal of a part's bounds."""
        xmin, ymin, xmax, ymax = self._bounds[part]
        return float(np.hypot(xmax - xmin, ymax - ymin))

    def join(self, one: int, other: int) -> None:
        """Make two parts one."""
        low = np.minimum(self._bounds[one, :2], self._bounds[other, :2])
        high = np.maximum(self._bounds[one, 2:], self._bounds[other, 2:])
        self._bounds[one] = [*low, *high]
        self._above[other] = one
