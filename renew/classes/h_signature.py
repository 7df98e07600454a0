"""The h-signature: which islands a path passes, on which side, in which order. It names a class.

From a point in each island a ray runs in the direction of +y. The signed sequence of rays that a
path crosses, with neighbours of opposite sign cancelled, is a word in the free group on the
islands. Two paths with the same start and goal can be deformed into each other without crossing an
island exactly when their words are equal (Bhattacharya, Likhachev & Kumar, 2012). An island that
touches the end of the chart can't be passed on that side and has no ray.

Some islands get no ray, so that classes which differ only around a rock have the same word: islands
below a given size, or all except the few largest on the way, because a navigator distinguishes ways
by those. Otherwise, among hundreds of islets, all of the best classes would pass the large islands
on the same side. Just enough large islands get a ray to give k classes, if each can be passed on
both sides. The largest island has a ray, however small it is.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import shapely

from renew._compiled import for_kernels, kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.inputs.chart_and_vessel import Chart
from renew.kernels.capsules import Segment
from renew.kernels.current_table import number_up_to

Word: TypeAlias = tuple[int, ...]
"""Signed island numbers from 1: +i crosses island i's ray towards +x, -i towards -x.

At each via point there is a `VIA` in the word.
"""

VIA = 0
"""Separates the words of the parts of a voyage, at a via point."""

IDENTITY = "e"
"""The name of the empty word: no ray is crossed."""

# Longest name, in characters, that a sentence quotes whole.
_MAX_LENGTH = 60
# An island lies on the way if a detour to it lengthens the way by at most this share.
_DETOUR = 0.25
# An island on the way matters if its size is at least this share of the way's length.
_SIZE = 1 / 50


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Rays of the islands from west to east: origins `x`, `y` (i,) in m, and their `island` (i,).

    Islands are numbered from 1, the largest first; `size` (i,) is their extent along the wider
    axis, m. Where some islands have no ray (`omits_islands`), one class has many channels.
    """

    x: FloatArray
    y: FloatArray
    island: IntArray
    size: FloatArray
    omits_islands: bool = False

    @classmethod
    def of(cls, chart: Chart, overpowered: shapely.Geometry | None = None) -> "Rays":
        """Return rays of all islands, and of overpowered water, numbered after the islands'."""
        kinds = [np.array(polygons, dtype=object) for polygons in chart.islands]
        if overpowered is not None:
            kinds.append(shapely.get_parts(overpowered))
        islands = np.concatenate([_islands(polygons, chart) for polygons in kinds])
        x, y = shapely.get_coordinates(shapely.point_on_surface(islands)).reshape(-1, 2).T
        order = np.argsort(x, kind="stable")
        return cls(x[order], y[order], order + 1, _sizes(islands)[order])

    def only(self, chosen: BoolArray) -> "Rays":
        """Return only the chosen (i,) rays; they keep their numbers."""
        return Rays(
            self.x[chosen],
            self.y[chosen],
            self.island[chosen],
            self.size[chosen],
            omits_islands=self.omits_islands or not bool(chosen.all()),
        )

    def of_word(self, word: Word) -> Word:
        """Reduce a word to the letters of these rays."""
        reduced: list[int] = []
        known = set(self.island.tolist())
        for letter in word:
            if letter != VIA and abs(letter) not in known:
                continue
            if letter != VIA and reduced and reduced[-1] == -letter:
                reduced.pop()
            else:
                reduced.append(letter)
        return tuple(reduced)

    def word(self, path: FloatArray) -> Word:
        """Return reduced word of a path (n, 2)."""
        letters = _word(self.x, self.y, self.island, for_kernels(path))
        return tuple(letters.tolist())


def _islands(polygons: npt.NDArray[np.object_], chart: Chart) -> npt.NDArray[np.object_]:
    """Return islands among polygons: they can be passed on either side. The largest comes first."""
    # Land that touches the extent's edge belongs to the outside. So does land that touches such
    # land, but the chart's union has already merged both.
    outside = shapely.dwithin(polygons, chart.extent.exterior, 4 * chart.precision)
    islands = polygons[~np.asarray(outside, dtype=bool)]
    bounds = shapely.bounds(islands).reshape(-1, 4)
    return np.asarray(islands[np.lexsort((*bounds.T[::-1], -shapely.area(islands)))])


def _sizes(islands: npt.NDArray[np.object_]) -> FloatArray:
    """Return the extent (i,) of islands along the wider axis, m."""
    bounds = shapely.bounds(islands).reshape(-1, 4)
    return np.asarray((bounds[:, 2:] - bounds[:, :2]).max(axis=1, initial=0.0))


@kernel
def rays_between(x: FloatArray, ax: float, bx: float) -> tuple[int, int, int]:
    """Return first, last (excluded) and step of the rays that a leg from ax to bx meets, in order.

    A leg crosses a ray whose origin lies below the leg: see :func:`is_crossed`. The interval is
    half-open on the west, so that a path with a point right above an origin counts once.
    """
    here = number_up_to(x, ax)
    there = number_up_to(x, bx)
    return (here, there, 1) if bx > ax else (here - 1, there - 1, -1)


@kernel
def is_crossed(ray_x: float, ray_y: float, leg: Segment) -> bool:
    """Whether a ray between a leg's ends along x is crossed: the leg passes above its origin."""
    ax, ay, bx, by = leg
    return bool(ay + (ray_x - ax) / (bx - ax) * (by - ay) > ray_y)


@kernel
def _word(x: FloatArray, y: FloatArray, island: IntArray, path: FloatArray) -> IntArray:
    """Return reduced word of a path (n, 2)."""
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
    """Spell a word, as in "s2.p1"; "e" for the empty one, "s2/e" with a via point.

    A path that crosses an island's ray towards +x leaves the island to starboard (s), else to
    port (p).
    """
    parts: list[list[str]] = [[]]
    for letter in word:
        if letter == VIA:
            parts.append([])
        else:
            parts[-1].append(f"{'s' if letter > 0 else 'p'}{abs(letter)}")
    return "/".join(".".join(part) or IDENTITY for part in parts)


def shortened(name: str) -> str:
    """Return a class's name for a sentence: the middle of a long one is left out."""
    return (
        name
        if len(name) <= _MAX_LENGTH
        else f"{name[: _MAX_LENGTH // 2]}...{name[-_MAX_LENGTH // 2 :]}"
    )


def rays_that_matter(rays: Rays, path: FloatArray, count: int) -> Rays:
    """Return the rays of the islands that distinguish `count` classes around a path (n, 2), m."""
    length = float(shapely.length(shapely.LineString(path)))
    origins = np.column_stack([rays.x, rays.y])
    through_it = sum(np.linalg.norm(origins - end, axis=1) for end in path[[0, -1]])
    on_the_way = through_it - rays.size <= (1 + _DETOUR) * length
    by_it = np.flatnonzero(on_the_way)
    largest_first = by_it[np.argsort(-rays.size[by_it], kind="stable")]
    that_matter = max(1, np.count_nonzero(rays.size[by_it] >= _SIZE * length))
    chosen = np.zeros(len(rays.x), dtype=bool)
    chosen[largest_first[: min(that_matter, math.ceil(math.log2(count)))]] = True
    return rays.only(chosen)
