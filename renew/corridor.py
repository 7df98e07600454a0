"""The least-fuel path inside one padded channel.

``least_fuel_path`` is a dynamic programme over m points on the free part of each section, run
again on ever narrower windows around the winner; ``sampled_paths`` are the paper's random
chains, one random point on the free part of each passing edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from renew.errors import InfeasibleError
from renew.fuel import Drift, ground_speed
from renew.geometry import capsule_interval, segment_distance
from renew.sections import Sections, cut, free_intervals

if TYPE_CHECKING:
    from renew._types import BoolArray, FloatArray
    from renew.channels import Channel
    from renew.current import CurrentField
    from renew.padding import Hazards
    from renew.vessel import Vessel

# A channel's midline is cut into about this many sections; the single gyre's fuel changes by
# under 0.1 % from here to twice as many.
_SECTIONS = 64
# Points a section in the first pass, over its whole free part, and in the later, narrower ones.
_FIRST_POINTS, _LATER_POINTS = 25, 13
# A later pass looks this many spacings of the one before to either side of the winner. With 13
# points that divides the spacing by 4 each time: 5 passes leave 1/1000 of the first.
_WINDOW = 1.5
_PASSES = 6
# A point is needless if the leg past it costs less than this share of the whole time more; the
# search for such a leg looks this many points beyond the last that it found. A leg may graze a
# bank by this share of a section: several sections meet in the vertex that a path wraps.
_NEEDLESS, _LOOK_AHEAD, _ON_BANK = 2e-7, 3, 1e-9
# Padding shrinks by this (m) where legs are tested, so that a leg may touch V's edge.
_TOUCH = 1e-6


@dataclass(frozen=True, slots=True)
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

    def legs_clear(self, a: FloatArray, b: FloatArray, *, edges: bool = False) -> BoolArray:
        """Whether legs a -> b (..., 2) keep out of V, but for the part of V around the ends.

        Capsules that hold the start (or goal) are left by (entered on) the leg that touches it.
        With `edges`, legs may not touch bare constrained edges either.
        """
        clear = np.ones(np.broadcast_shapes(a.shape, b.shape)[:-1], dtype=bool)
        low = np.minimum(a, b).reshape(-1, 2).min(axis=0)
        high = np.maximum(a, b).reshape(-1, 2).max(axis=0)
        h = self.hazards
        near = (
            (edges | (h.padding > 0))
            & (np.minimum(h.start, h.end) - h.padding[:, None] <= high).all(axis=1)
            & (np.maximum(h.start, h.end) + h.padding[:, None] >= low).all(axis=1)
        )
        for p, q, radius in zip(h.start[near], h.end[near], h.padding[near], strict=True):
            enter, leave = capsule_interval(a, b, p, q, np.asarray(max(radius - _TOUCH, 0.0)))
            hit = enter <= leave if edges else enter < leave
            for point, leg_end in ((self.start, a), (self.goal, b)):
                if segment_distance(point, p, q) < radius:
                    hit &= ~(leg_end == point).all(axis=-1)
            clear &= ~hit
        return clear

    def leg_times(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Time (s) over straight legs a -> b (..., 2) by Simpson's rule; inf where impassable."""
        leg = b - a
        length = np.sqrt((leg * leg).sum(-1))
        tangent = leg / np.where(length > 0, length, 1.0)[..., None]
        total = np.zeros(length.shape)
        for points, weight in ((a, 1 / 6), ((a + b) / 2, 4 / 6), (b, 1 / 6)):
            velocity = self.current(points)
            speed = ground_speed(velocity, tangent, self.vessel.speed, self.drift)
            # Water that outruns the vessel is no-go for it, whichever way it flows.
            passable = (speed > 0) & ((velocity * velocity).sum(-1) < self.vessel.speed**2)
            total = total + np.where(passable, weight / np.where(passable, speed, 1.0), np.inf)
        return np.where(length > 0, length * np.where(length > 0, total, 0.0), 0.0)


def least_fuel_path(corridor: Corridor) -> FloatArray:
    """Path (n, 2) of least fuel through the corridor; InfeasibleError says why there is none.

    Post-condition: it visits every section between left and right bank, never enters V but for
    the part around start and goal, and no leg of it runs where the current outruns the vessel.
    """
    midline = corridor.channel.midline(corridor.start, corridor.goal)
    spacing = float(np.linalg.norm(np.diff(midline, axis=0), axis=1).sum()) / _SECTIONS
    sections = cut(corridor.channel, corridor.start, corridor.goal, spacing)
    intervals = free_intervals(sections, corridor.hazards)
    sections, intervals = _skip_soft_ends(sections, intervals)
    _check_open(corridor, sections, intervals)
    places = [_spread(free, _FIRST_POINTS) for free in intervals]
    step = np.array([np.ptp(p) for p in places]) / _FIRST_POINTS
    winner = np.empty(0)
    for _ in range(_PASSES):
        best = _best_chain(corridor, sections, _padded(places))
        if best is None:
            raise InfeasibleError(
                "no leg between two sections is clear of V and of overpowering current"
            )
        winner = best
        places = [
            _window(free, at, _WINDOW * width)
            for free, at, width in zip(intervals, winner, step, strict=True)
        ]
        step = step * 2 * _WINDOW / (_LATER_POINTS - 1)
    path = np.vstack([corridor.start, sections.points(winner), corridor.goal])
    return _without_needless_points(corridor, sections, path)


def sampled_paths(corridor: Corridor, samples: int, rng: np.random.Generator) -> FloatArray:
    """Random chains (samples', n, 2) on the free part of each passing edge, those clear of V.

    The paper samples whole passing edges and discards; a point in V can't be kept, so drawing
    from the free part gives the same chains sooner.
    """
    gates = cut(corridor.channel, corridor.start, corridor.goal, math.inf)
    intervals = free_intervals(gates, corridor.hazards)
    _check_open(corridor, gates, intervals)
    places = np.array([_draw(free, samples, rng) for free in intervals], dtype=float).reshape(
        len(intervals), samples
    )
    chains = np.empty((samples, len(intervals) + 2, 2))
    chains[:, 0], chains[:, -1] = corridor.start, corridor.goal
    chains[:, 1:-1] = gates.points(places).swapaxes(0, 1)
    clear = np.ones(samples, dtype=bool)
    for i in range(chains.shape[1] - 1):
        clear &= corridor.legs_clear(chains[:, i], chains[:, i + 1])
    if not clear.any():
        raise InfeasibleError(f"each of {samples} sampled chains crosses the soft no-go zone")
    return chains[clear]


def _check_open(corridor: Corridor, sections: Sections, intervals: list[FloatArray]) -> None:
    """Raise InfeasibleError where V takes a whole section: at the narrowest of them."""
    shut = np.array([len(free) == 0 for free in intervals], dtype=bool)
    if not shut.any():
        return
    widths = np.where(shut, np.linalg.norm(sections.right - sections.left, axis=1), np.inf)
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


def _skip_soft_ends(
    sections: Sections, intervals: list[FloatArray]
) -> tuple[Sections, list[FloatArray]]:
    """Drop the sections before the first (after the last) passing edge that lie wholly in V.

    A start in V leaves it by the first section with a free part; the passing edges stay.
    """
    keep = np.ones(len(intervals), dtype=bool)
    for order in (range(len(intervals)), range(len(intervals) - 1, -1, -1)):
        for i in order:
            if sections.passing[i]:
                break
            keep[i] &= len(intervals[i]) > 0
    return sections.select(keep), [f for f, k in zip(intervals, keep, strict=True) if k]


def _spread(free: FloatArray, count: int) -> FloatArray:
    """Spread places evenly over intervals, both ends of each included."""
    lengths = free[:, 1] - free[:, 0]
    shares = np.maximum(2, np.round(count * lengths / lengths.sum()).astype(int))
    return np.concatenate([np.linspace(a, b, n) for (a, b), n in zip(free, shares, strict=True)])


def _window(free: FloatArray, at: float, half_width: float) -> FloatArray:
    """Places around one, itself among them, inside the free interval that holds it."""
    inside = (free[:, 0] - 1e-12 <= at) & (at <= free[:, 1] + 1e-12)
    low, high = free[int(np.argmax(inside))]
    grid = np.linspace(max(low, at - half_width), min(high, at + half_width), _LATER_POINTS - 1)
    return np.sort(np.append(grid, at))


def _draw(free: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Draw places uniformly over the union of intervals."""
    lengths = free[:, 1] - free[:, 0]
    chosen = rng.choice(len(free), size=count, p=lengths / lengths.sum())
    return np.asarray(free[chosen, 0] + rng.random(count) * lengths[chosen])


def _padded(places: list[FloatArray]) -> FloatArray:
    """Rows of places as one array (s, m), short rows filled with their last place."""
    width = max((len(row) for row in places), default=0)
    return np.array([np.pad(row, (0, width - len(row)), mode="edge") for row in places]).reshape(
        len(places), width
    )


def _best_chain(corridor: Corridor, sections: Sections, places: FloatArray) -> FloatArray | None:
    """Places (s,) of the quickest chain through places (s, m), by dynamic programming."""
    if not len(places):
        return np.empty(0) if _leg(corridor, corridor.start, corridor.goal) < math.inf else None
    points = sections.points(places)
    times = corridor.leg_times(points[:-1, :, None], points[1:, None])
    arrival = _leg(corridor, corridor.start, points[0])
    came_from = []
    for here, there, leg_times in zip(points[:-1], points[1:], times, strict=True):
        clear = corridor.legs_clear(here[:, None], there[None])
        total = arrival[:, None] + np.where(clear, leg_times, np.inf)
        came_from.append(total.argmin(axis=0))
        arrival = total.min(axis=0)
    total = arrival + _leg(corridor, points[-1], corridor.goal)
    best = int(total.argmin())
    if not math.isfinite(total[best]):
        return None
    chain = [best]
    for back in reversed(came_from):
        chain.append(int(back[chain[-1]]))
    return np.asarray(places[np.arange(len(places)), chain[::-1]])


def _leg(corridor: Corridor, a: FloatArray, b: FloatArray) -> FloatArray:
    """Time over legs a -> b, inf where V or the current is in the way."""
    a, b = np.broadcast_arrays(a, b)
    return np.where(corridor.legs_clear(a, b), corridor.leg_times(a, b), np.inf)


def _without_needless_points(
    corridor: Corridor, sections: Sections, path: FloatArray
) -> FloatArray:
    """Drop points that cost nothing to drop: straight water wants no waypoints.

    A point goes if the leg past it takes no longer, keeps out of V and crosses the sections
    dropped so far between their banks.
    """
    kept = [0]
    last = len(path) - 1
    times = corridor.leg_times(path[:-1], path[1:])
    reach = np.concatenate([[0.0], np.cumsum(times)])
    while kept[-1] < last:
        here = kept[-1]
        best = here + 1
        for after in range(here + 2, last + 1):
            if _shortcut(corridor, sections, path, reach, here, after):
                best = after
            elif after - best > _LOOK_AHEAD:
                break
        kept.append(best)
    return path[kept]


def _shortcut(
    corridor: Corridor, sections: Sections, path: FloatArray, reach: FloatArray, i: int, j: int
) -> bool:
    """Whether the straight leg from point i to point j is as good as the path between them."""
    a, b = path[i], path[j]
    left, right = sections.left[i : j - 1], sections.right[i : j - 1]
    d = b - a
    across = right - left
    turn = across[:, 0] * d[1] - across[:, 1] * d[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        place = ((a[0] - left[:, 0]) * d[1] - (a[1] - left[:, 1]) * d[0]) / turn
    if not ((place >= -_ON_BANK) & (place <= 1 + _ON_BANK)).all():
        return False
    pieces = np.linspace(0.0, 1.0, j - i + 1)[:, None]
    points = a + pieces * d
    time = corridor.leg_times(points[:-1], points[1:]).sum()
    if time > reach[j] - reach[i] + _NEEDLESS * reach[-1]:
        return False
    return bool(corridor.legs_clear(a, b))
