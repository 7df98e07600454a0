"""The least-fuel path in one homotopy class, outside its soft no-go zone V.

``least_fuel_path`` is a dynamic programme in two parts. The first runs over sections of the
channel: few sections, many points on each, so that the way round is right. The second lays rungs
across the path found, from V to V, and runs again over points on them, in ever narrower windows,
so that the path can bend, and bulge out of its channel: the least-fuel path of a class may leave
its row of triangles across open water and come back.

``sampled_paths`` are the paper's random chains, one random point on the free part of each
passing edge.
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
from renew.kinematics import course_changes
from renew.sections import FreeParts, Sections, cut, free_parts
from renew.viterbi import quickest_chain, without_detours

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
# Where legs as long as that find no way round a corner of V, or jump over a current that outruns
# the vessel, they are made shorter.
_SHORT_SPACING, _SHORT_ANGLE = 1 / 64, math.radians(9)
# Rungs stand this share of the path apart; from pass to pass they double to either side of where
# it turns by more than an angle, until they stand closer than this share of v/ω. The windows on
# them begin at this share of the path to either side and halve, to 1/16,000: 1 cm on the single
# gyre.
# The first, wide ones have many points, so that legs between them can take almost any course.
_RUNG_SPACING, _FIRST_WINDOW, _SHRINK, _RUNG_PASSES = 1 / 80, 0.15, 0.5, 11
_WIDE_PASSES, _WIDE_POINTS, _NARROW_POINTS = 3, 41, 13
_BEND, _CLOSEST_RUNGS = math.radians(5), 0.25
# Paths are sought this share of v/ω further out than V reaches (7 cm for the paper's vessel), so
# that points closer than that to the line past them can go, and corners be rounded, outside V.
_SLACK = 0.04


@dataclass(frozen=True)
class Corridor:
    """Where paths of a class are sought: its channel and the triangles beside it, less V.

    `corners` (t, 3, 2) are those triangles'; `walls` (w, 2, 2) the outer edges among theirs that
    are no hazard: water too far off, or the end of the chart.
    """

    channel: Channel
    corners: FloatArray
    walls: FloatArray
    hazards: Hazards
    current: CurrentField
    vessel: Vessel
    start: FloatArray
    goal: FloatArray
    drift: Drift

    @cached_property
    def barriers(self) -> tuple[FloatArray, FloatArray]:
        """Ends (b, 2) and (b, 2) of all that paths keep away from: hazards, then walls."""
        return (
            np.concatenate([self.hazards.start, self.walls[:, 0]]),
            np.concatenate([self.hazards.end, self.walls[:, 1]]),
        )

    @cached_property
    def sought(self) -> FloatArray:
        """Distance (b,) from each barrier that is kept while seeking: padding and some slack."""
        padding = np.append(self.hazards.padding, np.zeros(len(self.walls)))
        return padding + _SLACK * self.vessel.turning_radius

    @cached_property
    def forbidden(self) -> FloatArray:
        """Distance (b,) that must be kept; -1 for a bare barrier: it may not be touched."""
        padding = np.append(self.hazards.padding, np.zeros(len(self.walls)))
        return np.where(padding > 0, padding, -1.0)

    def holds(self, point: FloatArray) -> BoolArray:
        """Which barriers (b,) have a point inside the distance that is sought."""
        return segment_distance(point, *self.barriers) < self.sought

    def legs_clear(self, path: FloatArray) -> BoolArray:
        """Whether each leg (n - 1,) of a path (n, 2) keeps out of V.

        V around a start or goal inside it may be left on the first, entered on the last leg.
        """
        start, end = self.barriers
        clear = legs_are_clear(path[:-1], path[1:], start, end, self.forbidden)
        for leg, point in ((0, self.start), (-1, self.goal)):
            if not clear[leg] and (path[leg] == point).all():
                others = ~self.holds(point)
                clear[leg] = legs_are_clear(
                    path[:-1][[leg]],
                    path[1:][[leg]],
                    start[others],
                    end[others],
                    self.forbidden[others],
                )[0]
        return clear


def least_fuel_path(corridor: Corridor, *, bulging: bool = True) -> FloatArray:
    """Path (n, 2) of least fuel through the corridor; InfeasibleError says why there is none.

    Post-condition: it never enters V but for the part around start and goal, and no leg of it
    runs where the current outruns the vessel. Unless it may bulge, it keeps near its channel.
    """
    midline = corridor.channel.midline(corridor.start, corridor.goal)
    length = float(np.linalg.norm(np.diff(midline, axis=0), axis=1).sum())
    try:
        path = _sought(corridor, _COARSE_SPACING * length, _COARSE_ANGLE, bulging=bulging)
    except InfeasibleError:
        path = _sought(corridor, _SHORT_SPACING * length, _SHORT_ANGLE, bulging=bulging)
    return _without_needless_points(corridor, path)


def _sought(corridor: Corridor, spacing: float, angle: float, *, bulging: bool) -> FloatArray:
    """Least-fuel path (n, 2), first through sections of the channel, then across rungs."""
    path = _through_sections(corridor, spacing, angle)
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    window = _FIRST_WINDOW * length
    for step in range(_RUNG_PASSES):
        if step >= _WIDE_PASSES or bulging:
            path = _with_rungs(path, _RUNG_SPACING * length, corridor, bends=step >= _WIDE_PASSES)
            points = _WIDE_POINTS if step < _WIDE_PASSES else _NARROW_POINTS
            path = _across_rungs(corridor, path, window, points)
        window *= _SHRINK
    return path


def _through_sections(corridor: Corridor, spacing: float, angle: float) -> FloatArray:
    """Quickest path (n, 2) through points all over the channel's sections."""
    sections, free = _open_sections(corridor, spacing, angle)
    best = _quickest(corridor, sections, free.spread(_COARSE_POINTS))
    return np.vstack([corridor.start, sections.points(best), corridor.goal])


def _with_rungs(path: FloatArray, spacing: float, corridor: Corridor, *, bends: bool) -> FloatArray:
    """Path with points added (n', 2), at most `spacing` apart and, if asked, beside its bends.

    A start in V is left on the first leg, and a goal in V reached on the last, as they are.
    """
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    path, lengths = path[np.append(lengths > 0, True)], lengths[lengths > 0]
    pieces = np.maximum(1, np.ceil(lengths / spacing).astype(np.int64))
    if bends and len(path) > 2:
        bent = np.abs(course_changes(path)[0]) > _BEND
        beside = np.append(bent, False) | np.append(False, bent)
        long = lengths > 2 * _CLOSEST_RUNGS * corridor.vessel.turning_radius
        pieces[beside & long & (pieces == 1)] = 2
    for leg, point in ((0, corridor.start), (-1, corridor.goal)):
        if corridor.holds(point).any():
            pieces[leg] = 1
    legs = np.diff(path, axis=0)
    cut = np.repeat(np.arange(len(legs)), pieces)
    place = (np.arange(len(cut)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[cut]
    return np.vstack([path[cut] + place[:, None] * legs[cut], path[-1:]])


def _across_rungs(corridor: Corridor, path: FloatArray, window: float, count: int) -> FloatArray:
    """Quickest path (n, 2) over points on rungs across a path, `window` metres to either side."""
    if len(path) < 3:
        return path
    along = path[2:] - path[:-2]
    unit = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    across = window * np.stack([-unit[:, 1], unit[:, 0]], axis=-1)
    none = np.zeros(len(across), dtype=np.int64)
    rungs = Sections(path[1:-1] + across, path[1:-1] - across, none > 0, none)
    low, high = free_parts(rungs, *corridor.barriers, corridor.sought).around(
        np.full(len(across), 0.5)
    )
    grid = np.linspace(0.0, 1.0, count - 1)
    # The path's own points stay among them, so that no pass is worse than the one before.
    places = np.column_stack([low[:, None] + (high - low)[:, None] * grid, np.full(len(low), 0.5)])
    best = _quickest(corridor, rungs, places)
    path = np.vstack([corridor.start, rungs.points(best), corridor.goal])
    # Rungs that cross beside a bend may be visited back and forth.
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    keep = without_detours(
        path,
        corridor.current(path),
        corridor.vessel.speed,
        corridor.drift == "crab",
        *corridor.barriers,
        corridor.sought,
        2 * _RUNG_SPACING * float(lengths.sum()),
    )
    return np.asarray(path[keep])


def _open_sections(corridor: Corridor, spacing: float, angle: float) -> tuple[Sections, FreeParts]:
    """Sections of a corridor and their free intervals, none of them shut."""
    sections = cut(corridor.channel, corridor.start, corridor.goal, spacing, angle)
    free = free_parts(sections, *corridor.barriers, corridor.sought)
    sections, free = _skip_soft_ends(sections, free)
    _check_open(corridor, sections, free)
    return sections, free


def _quickest(corridor: Corridor, sections: Sections, places: FloatArray) -> FloatArray:
    """Places (s,) of the quickest chain through places (s, m) on sections."""
    start, end = corridor.barriers
    left = np.vstack([corridor.start, sections.left, corridor.goal])
    right = np.vstack([corridor.start, sections.right, corridor.goal])
    low, high = np.minimum(left, right), np.maximum(left, right)
    # Only capsules whose bounds meet those of two consecutive sections can be in the way.
    reach = corridor.sought[:, None]
    meets = ((np.minimum(start, end) - reach)[None] <= np.maximum(high[:-1], high[1:])[:, None]) & (
        (np.maximum(start, end) + reach)[None] >= np.minimum(low[:-1], low[1:])[:, None]
    )
    rows, near = np.nonzero(meets.all(axis=2))
    left_out = np.zeros((len(left) - 1, len(start)), dtype=bool)
    left_out[0] |= corridor.holds(corridor.start)
    left_out[-1] |= corridor.holds(corridor.goal)
    points = np.empty((len(left), max(places.shape[1], 1), 2))
    points[0], points[-1] = corridor.start, corridor.goal
    points[1:-1] = sections.points(places)
    arrival, chain = quickest_chain(
        points,
        corridor.current(points),
        corridor.vessel.speed,
        corridor.drift == "crab",
        start,
        end,
        corridor.sought,
        near,
        np.searchsorted(rows, np.arange(len(left))),
        left_out,
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
    free = free_parts(gates, *corridor.barriers, corridor.sought)
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
    paddings = [corridor.hazards.around(bank).padding.max(initial=0.0) for bank in (left, right)]
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
