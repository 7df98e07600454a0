"""Names for homotopy classes: which islands a path passes, on which side, in which order.

From a point in each island a ray runs in the direction of +y. The signed sequence of rays that a
path crosses, with neighbours of opposite sign cancelled, is a word in the free group on the
islands, and two paths with the same ends can be deformed into each other without crossing an
island exactly when their words are equal (the h-signature of Bhattacharya, Likhachev & Kumar,
2012). Islands that touch the end of the chart can't be passed on that side and have no ray;
islands smaller than a given size can be left out, so that classes which part only around a rock
get the same word.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import shapely

if TYPE_CHECKING:
    from renew._types import FloatArray
    from renew.chart import Chart

Word: TypeAlias = tuple[int, ...]
"""Signed island numbers from 1: +i crosses island i's ray towards +x, -i towards -x."""

IDENTITY = "e"
"""The name of the empty word: no ray is crossed."""


@dataclass(frozen=True, slots=True)
class Rays:
    """Rays of the islands, the largest island first: island i's ray starts at origins[i - 1]."""

    origins: FloatArray

    @classmethod
    def of(cls, chart: Chart, smallest: float = 0.0) -> Rays:
        """Rays of the islands whose extent along the wider axis is at least `smallest` metres."""
        # Land that touches the extent's edge belongs to the outside; what touches such land too,
        # and the chart's union has already merged what overlaps.
        outside = shapely.dwithin(chart.no_go, chart.extent.exterior, 4 * chart.precision)
        islands = [p for p, out in zip(chart.no_go, outside, strict=True) if not out]
        islands = [
            p for p in islands if max(np.ptp(shapely.get_coordinates(p), axis=0)) >= smallest
        ]
        islands.sort(key=lambda p: (-p.area, p.bounds))
        points = shapely.point_on_surface(np.array(islands, dtype=object))
        return cls(shapely.get_coordinates(points).reshape(-1, 2))

    def crossings(self, a: FloatArray, b: FloatArray) -> Word:
        """Rays that the segment a -> b crosses, in order, signed."""
        x, y = self.origins[:, 0], self.origins[:, 1]
        # Half-open on the left, so that a path through a point right above an origin counts once.
        east = (a[0] < x) & (b[0] >= x)
        west = (b[0] < x) & (a[0] >= x)
        index = np.flatnonzero(east | west)
        if not index.size:
            return ()
        place = (x[index] - a[0]) / (b[0] - a[0])
        above = a[1] + place * (b[1] - a[1]) > y[index]
        index, place = index[above], place[above]
        order = np.argsort(place, kind="stable")
        return tuple(int(i + 1) if east[i] else -int(i + 1) for i in index[order])

    def word(self, path: FloatArray) -> Word:
        """Reduced word of a path (n, 2)."""
        word: Word = ()
        for a, b in itertools.pairwise(path):
            word = append(word, self.crossings(a, b))
        return word


def append(word: Word, letters: Word) -> Word:
    """Append letters to a reduced word and cancel what has become adjacent to its inverse."""
    result = list(word)
    for letter in letters:
        if result and result[-1] == -letter:
            result.pop()
        else:
            result.append(letter)
    return tuple(result)


def name(word: Word) -> str:
    """Spell a word, as in "s2.p1"; "e" for the empty one.

    Who crosses an island's ray towards +x leaves the island to starboard (s), else to port (p).
    """
    return ".".join(f"{'s' if letter > 0 else 'p'}{abs(letter)}" for letter in word) or IDENTITY
