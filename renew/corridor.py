"""The least-fuel path inside one padded channel.

``least_fuel_path`` is a dynamic programme over m points on the free part of each section, run
again on ever narrower windows around the winner; ``sampled_paths`` are the paper's random
chains, one random point on the free part of each passing edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import shapely

from renew.errors import InfeasibleError
from renew.geometry import legs_are_clear, segment_distance
from renew.sections import FreeParts, Sections, cut, free_parts
from renew.viterbi import quickest_chain

if TYPE_CHECKING:
    from renew._types import BoolArray, FloatArray
    from renew.channels import Channel
    from renew.current import CurrentField
    from renew.fuel import Drift
    from renew.padding import Hazards
    from renew.vessel import Vessel

# The first pass has few sections and many points on each, so that its legs can take almost any
# course: spacing as a share of the midline, angle in a fan (rad), points a section.
_COARSE_SPACING, _COARSE_ANGLE, _COARSE_POINTS = 1 / 14, math.radians(30), 41
# The later passes have many sections, so that the path can bend: within a fan by so little at
# each that chords round the end of a padded edge stay within 0.3 % of the arc. They look at few
# points in a window around the winner; it starts at so many spacings of the first pass to either
# side and halves from pass to pass, to 1/500 of that spacing.
_FINE_SPACING, _FINE_ANGLE, _FINE_POINTS = 1 / 64, math.radians(9), 12
_FIRST_WINDOW, _SHRINK, _FINE_PASSES = 2.0, 0.5, 11
# Paths are sought this share of v/ω further out than V reaches (3 cm for the paper's vessel), so
# that points closer than that to the line past them can go, and corners be rounded, outside V.
_SLACK = 0.02


@dataclass(frozen=True)
class Corridor:
    """Where paths are sought: a channel, its corners (t, 3, 2) and V, a current and a vessel."""

    channel: Channel
    corners: FloatArray
    hazards: Hazards
    current: CurrentField
    vessel: Vessel
    start: FloatArray
    goal: FloatArray
    drift: Drift

    @cached_property
    def sought(self) -> FloatArray:
        """Distance (e,) from each edge that is kept while seeking: its padding and some slack."""
        return self.hazards.padding + _SLACK * self.vessel.turning_radius

    @cached_property
    def forbidden(self) -> FloatArray:
        """Distance (e,) from each edge that must be kept; -1 for a bare edge: not to be touched."""
        padding = self.hazards.padding
        return np.where(padding > 0, padding, -1.0)

    def holds(self, point: FloatArray) -> BoolArray:
        """Which edges (e,) have a point inside the distance that is sought."""
        return segment_distance(point, self.hazards.start, self.hazards.end) < self.sought

    def legs_clear(self, path: FloatArray) -> BoolArray:
        """Whether each leg (n - 1,) of a path (n, 2) keeps out of V.

        V around a start or goal inside it may be left on the first, entered on the last leg.
        """
        h = self.hazards
        clear = legs_are_clear(path[:-1], path[1:], h.start, h.end, self.forbidden)
        for leg, point in ((0, self.start), (-1, self.goal)):
            if not clear[leg] and (path[leg] == point).all():
                others = ~self.holds(point)
                clear[leg] = legs_are_clear(
                    path[:-1][[leg]],
                    path[1:][[leg]],
                    h.start[others],
                    h.end[others],
                    self.forbidden[others],
                )[0]
        return clear


def least_fuel_path(corridor: Corridor) -> FloatArray:
    """Path (n, 2) of least fuel through the corridor; InfeasibleError says why there is none.

    Post-condition: it visits every section between left and right bank, never enters V but for
    the part around start and goal, and no leg of it runs where the current outruns the vessel.
    """
    midline = corridor.channel.midline(corridor.start, corridor.goal)
    length = float(np.linalg.norm(np.diff(midline, axis=0), axis=1).sum())
    fine = _open_sections(corridor, _FINE_SPACING * length, _FINE_ANGLE)
    try:
        first = _first_path(
            corridor, *_open_sections(corridor, _COARSE_SPACING * length, _COARSE_ANGLE)
        )
    except InfeasibleError:  # legs as long as that may not get round a corner of V
        first = _first_path(corridor, *fine)
    best = _narrowed(corridor, *fine, *first)
    path = np.vstack([corridor.start, fine[0].points(best), corridor.goal])
    return _without_needless_points(corridor, path)


def _first_path(
    corridor: Corridor, sections: Sections, free: FreeParts
) -> tuple[FloatArray, float]:
    """Quickest path (n, 2) through points all over the sections, and their spacing (m)."""
    best = _Chains(corridor, sections)(free.spread(_COARSE_POINTS))
    widths = np.linalg.norm(sections.right - sections.left, axis=1)
    path = np.vstack([corridor.start, sections.points(best), corridor.goal])
    return path, float(widths.max(initial=0.0)) / _COARSE_POINTS


def _open_sections(corridor: Corridor, spacing: float, angle: float) -> tuple[Sections, FreeParts]:
    """Sections of a corridor and their free intervals, none of them shut."""
    sections = cut(corridor.channel, corridor.start, corridor.goal, spacing, angle)
    free = free_parts(sections, corridor.hazards, corridor.sought)
    sections, free = _skip_soft_ends(sections, free)
    _check_open(corridor, sections, free)
    return sections, free


def _narrowed(
    corridor: Corridor,
    sections: Sections,
    free: FreeParts,
    path: FloatArray,
    step: float,
) -> FloatArray:
    """Places (s,) of the least-fuel chain near a first path, in ever narrower windows."""
    quickest = _Chains(corridor, sections)
    best = sections.places(path)
    low, high = free.around(best)
    best = np.clip(best, low, high)
    half_window = _FIRST_WINDOW * step / np.linalg.norm(sections.right - sections.left, axis=1)
    grid = np.linspace(0.0, 1.0, _FINE_POINTS)
    for _ in range(_FINE_PASSES):
        near, far = np.maximum(low, best - half_window), np.minimum(high, best + half_window)
        window = near[:, None] + (far - near)[:, None] * grid
        # The winner stays among the points, so that no pass is worse than the one before.
        best = quickest(np.column_stack([window, best]))
        half_window *= _SHRINK
    return best


class _Chains:
    """Finds the quickest chain through points on the sections of a corridor."""

    def __init__(self, corridor: Corridor, sections: Sections) -> None:
        self._corridor, self._sections = corridor, sections
        h = corridor.hazards
        left = np.vstack([corridor.start, sections.left, corridor.goal])
        right = np.vstack([corridor.start, sections.right, corridor.goal])
        low, high = np.minimum(left, right), np.maximum(left, right)
        # Only capsules whose bounds meet those of two consecutive sections can be in the way.
        reach = corridor.sought[:, None]
        meets = (
            (np.minimum(h.start, h.end) - reach)[None] <= np.maximum(high[:-1], high[1:])[:, None]
        ) & ((np.maximum(h.start, h.end) + reach)[None] >= np.minimum(low[:-1], low[1:])[:, None])
        rows, self._near = np.nonzero(meets.all(axis=2))
        self._near_from = np.searchsorted(rows, np.arange(len(left)))
        self._left_out = np.zeros((len(left) - 1, len(h.edge)), dtype=bool)
        self._left_out[0] |= corridor.holds(corridor.start)
        self._left_out[-1] |= corridor.holds(corridor.goal)

    def __call__(self, places: FloatArray) -> FloatArray:
        """Places (s,) of the quickest chain through places (s, m)."""
        corridor = self._corridor
        points = np.empty((len(places) + 2, max(places.shape[1], 1), 2))
        points[0], points[-1] = corridor.start, corridor.goal
        points[1:-1] = self._sections.points(places)
        arrival, chain = quickest_chain(
            points,
            corridor.current(points),
            corridor.vessel.speed,
            corridor.drift == "crab",
            corridor.hazards.start,
            corridor.hazards.end,
            corridor.sought,
            self._near,
            self._near_from,
            self._left_out,
        )
        if not math.isfinite(arrival):
            raise InfeasibleError(
                "no leg between two sections is clear of V and of overpowering current"
            )
        return np.asarray(places[np.arange(len(places)), chain[1:-1]])


def sampled_paths(corridor: Corridor, samples: int, rng: np.random.Generator) -> FloatArray:
    """Random chains (samples', n, 2) on the free part of each passing edge, those clear of V.

    The paper samples whole passing edges and discards; a point in V can't be kept, so drawing
    from the free part gives the same chains sooner.
    """
    gates = cut(corridor.channel, corridor.start, corridor.goal, math.inf, math.inf)
    free = free_parts(gates, corridor.hazards, corridor.sought)
    _check_open(corridor, gates, free)
    chains = np.empty((samples, len(gates.left) + 2, 2))
    chains[:, 0], chains[:, -1] = corridor.start, corridor.goal
    chains[:, 1:-1] = gates.points(free.draw(samples, rng)).swapaxes(0, 1)
    clear = np.array([corridor.legs_clear(chain).all() for chain in chains])
    if not clear.any():
        raise InfeasibleError(f"each of {samples} sampled chains crosses the soft no-go zone")
    return np.asarray(chains[clear])


def _check_open(corridor: Corridor, sections: Sections, free: FreeParts) -> None:
    """Raise InfeasibleError where V takes a whole section: at the narrowest of them."""
    if not free.shut.any():
        return
    widths = np.where(free.shut, np.linalg.norm(sections.right - sections.left, axis=1), np.inf)
    narrowest = int(np.argmin(widths))
    left, right = sections.left[narrowest], sections.right[narrowest]
    middle = (left + right) / 2
    h = corridor.hazards
    paddings = [h.padding[np.argmin(segment_distance(p, h.start, h.end))] for p in (left, right)]
    raise InfeasibleError(
        f"shut at ({middle[0]:.1f}, {middle[1]:.1f}) m: the soft no-go zone takes the whole gap of "
        f"{widths[narrowest]:.2f} m, with a padding of {paddings[0]:.2f} m on the left and "
        f"{paddings[1]:.2f} m on the right bank",
        corridor.channel.moves[int(sections.fan[narrowest])],
    )


def _skip_soft_ends(sections: Sections, free: FreeParts) -> tuple[Sections, FreeParts]:
    """Drop the sections before the first (after the last) passing edge that lie wholly in V.

    A start in V leaves it by the first section with a free part; the passing edges stay.
    """
    keep = ~free.shut
    if len(keep):
        keep |= (sections.fan > sections.fan[0]) & (sections.fan <= sections.fan[-1] - 1)
        keep |= sections.passing
    return sections.select(keep), free.select(keep)


def _without_needless_points(corridor: Corridor, path: FloatArray) -> FloatArray:
    """Drop points that straight water does not want, where the legs past them keep out of V."""
    line = shapely.LineString(path)
    thinned = shapely.get_coordinates(line.simplify(_SLACK * corridor.vessel.turning_radius))
    kept = np.flatnonzero((path[:, None] == thinned[None]).all(axis=2).any(axis=1))
    keep = np.zeros(len(path), dtype=bool)
    keep[kept] = True
    for leg in np.flatnonzero(~corridor.legs_clear(path[kept])):
        keep[kept[leg] : kept[leg + 1]] = True
    return np.asarray(path[keep])
