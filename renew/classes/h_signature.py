"""The h-signature: which islands a path passes, on which side, in which order. It names a class.

From a point in each island a ray runs in the direction of +y. The signed sequence of rays that a
path crosses, with neighbours of opposite sign cancelled, is a word in the free group on the
islands. Two paths with the same start and goal can be deformed into each other without crossing an
island exactly when their words are equal (Bhattacharya, Likhachev & Kumar, 2012). An island that
touches the end of the chart can't be passed on that side and has no ray. Islands smaller than a
given size can be left without one, so that classes which part only around a rock get the same word.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from renew._compiled import kernel
from renew._types import FloatArray, IntArray
from renew.inputs.chart import Chart
from renew.kernels.capsules import Segment

Word: TypeAlias = tuple[int, ...]
"""Signed island numbers from 1: +i crosses island i's ray towards +x, -i towards -x."""

IDENTITY = "e"
"""The name of the empty word: no ray is crossed."""

# Longest name, in characters, that a sentence quotes whole.
_MAX_LENGTH = 60


@dataclass(frozen=True, slots=True)
class Rays:
    """Rays of the islands from west to east: origins `x`, `y` (i,) in m, and their `island` (i,).

    Islands are numbered from 1, the largest first. Where some islands have no ray
    (`omits_small_islands`), one class has many channels.
    """

    x: FloatArray
    y: FloatArray
    island: IntArray
    omits_small_islands: bool

    @classmethod
    def of(
        cls, chart: Chart, min_size: float = 0.0, overpowered: BaseGeometry | None = None
    ) -> Rays:
        """Rays of the islands whose extent along the wider axis is at least `min_size` metres.

        Overpowered water has rays as well, numbered after the islands'.
        """
        kinds = [np.array(chart.no_go, dtype=object)]
        if overpowered is not None:
            kinds.append(shapely.get_parts(overpowered))
        origins = np.concatenate([_origins(polygons, chart, min_size) for polygons in kinds])
        order = np.argsort(origins[:, 0], kind="stable")
        x, y = np.ascontiguousarray(origins[order].T)
        return cls(x, y, order + 1, min_size > 0 and len(origins) < sum(map(len, kinds)))

    def word(self, path: FloatArray) -> Word:
        """Reduced word of a path (n, 2)."""
        letters = _word(self.x, self.y, self.island, np.ascontiguousarray(path, dtype=float))
        return tuple(letters.tolist())


def _origins(polygons: npt.NDArray[np.object_], chart: Chart, min_size: float) -> FloatArray:
    """One point (i, 2) in each polygon of at least that size, the largest polygon first."""
    # Land that touches the extent's edge belongs to the outside; what touches such land too,
    # and the chart's union has already merged what overlaps.
    outside = shapely.dwithin(polygons, chart.extent.exterior, 4 * chart.precision)
    islands = polygons[~np.asarray(outside, dtype=bool)]
    bounds = shapely.bounds(islands).reshape(-1, 4)
    large = (bounds[:, 2:] - bounds[:, :2]).max(axis=1, initial=0.0) >= min_size
    islands, bounds = islands[large], bounds[large]
    largest_first = np.lexsort((*bounds.T[::-1], -shapely.area(islands)))
    points = shapely.point_on_surface(islands[largest_first])
    return np.asarray(shapely.get_coordinates(points).reshape(-1, 2))


@kernel
def rays_between(x: FloatArray, ax: float, bx: float) -> tuple[int, int, int]:
    """Rays first, first + step, ... before last that stand between ax and bx, in a leg's order.

    A leg crosses those whose origin lies below it: see :func:`is_crossed`. Half-open on the west,
    so that a path through a point right above an origin counts once.
    """
    here = int(np.searchsorted(x, ax, side="right"))
    there = int(np.searchsorted(x, bx, side="right"))
    return (here, there, 1) if bx > ax else (here - 1, there - 1, -1)


@kernel
def is_crossed(ray_x: float, ray_y: float, leg: Segment) -> bool:
    """Whether a ray between a leg's ends along x is crossed: the leg passes above its origin."""
    ax, ay, bx, by = leg
    return bool(ay + (ray_x - ax) / (bx - ax) * (by - ay) > ray_y)


@kernel
def _word(x: FloatArray, y: FloatArray, island: IntArray, path: FloatArray) -> IntArray:
    """Reduced word of a path (n, 2)."""
    word = np.empty(16, dtype=np.int64)
    length = 0
    for k in range(len(path) - 1):
        (ax, ay), (bx, by) = path[k], path[k + 1]
        first, last, step = rays_between(x, ax, bx)
        for i in range(first, last, step):
            if not is_crossed(x[i], y[i], Segment(ax, ay, bx, by)):
                continue
            letter = step * island[i]
            if length and word[length - 1] == -letter:
                length -= 1
                continue
            if length == len(word):
                word = np.concatenate((word, word))
            word[length] = letter
            length += 1
    return word[:length]


def name(word: Word) -> str:
    """Spell a word, as in "s2.p1"; "e" for the empty one.

    A path that crosses an island's ray towards +x leaves the island to starboard (s), else to
    port (p).
    """
    return ".".join(f"{'s' if letter > 0 else 'p'}{abs(letter)}" for letter in word) or IDENTITY


def shortened(name: str) -> str:
    """A class's name for a sentence: the middle of a long one is left out."""
    return (
        name
        if len(name) <= _MAX_LENGTH
        else f"{name[: _MAX_LENGTH // 2]}...{name[-_MAX_LENGTH // 2 :]}"
    )
