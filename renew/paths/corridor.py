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
from typing import NamedTuple

import numpy as np
import shapely

from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.channels import Channel
from renew.errors import InfeasibleError, Strait
from renew.inputs.current import CurrentField
from renew.inputs.current_table import Table, velocities
from renew.inputs.fuel import Drift
from renew.inputs.vessel import Vessel
from renew.kernels.capsules import boxes_near, capsule_bounds, legs_are_clear, segment_distance
from renew.kernels.viterbi import quickest_chain
from renew.padding.padding_model import Hazards
from renew.paths.refinement import across_rungs, cut_short, with_rungs
from renew.paths.sections import FreeParts, Sections, cut, free_parts

# The first pass has few sections and many points on each, so that its legs can take almost any
# course: spacing as a share of the midline, angle in a fan (rad), points a section.
_COARSE_SPACING, _COARSE_ANGLE, _COARSE_POINTS = 1 / 14, math.radians(30), 41
# Where legs as long as that find no way round a corner of V, or jump over a current that outruns
# the vessel, they are made shorter.
_SHORT_SPACING, _SHORT_ANGLE = 1 / 64, math.radians(9)
# Legs beside a turn of more than this angle (rad) are halved from pass to pass, until their rungs
# stand closer than this share of v/ω.
_BEND, _CLOSEST_RUNGS = math.radians(5), 0.25


class _Pass(NamedTuple):
    """A pass over rungs: window to either side and spacing (shares of the path), points each."""

    window: float
    spacing: float
    points: int
    bend: float


# Windows shrink to 1/4,000 of the path: 4 cm on the single gyre. The wider they are the more points
# they have, so that legs between them can take almost any course.
_WINDOWS = tuple(0.15 * 0.45**step for step in range(9))
_WIDE = tuple(
    _Pass(window, max(1 / 80, window / 4), points, math.inf)
    for window, points in zip(_WINDOWS, (25, 17, 13), strict=False)
)
_NARROW = tuple(_Pass(window, 1 / 80, 7, _BEND) for window in _WINDOWS[3:])
# Paths are sought this share of v/ω further out than V reaches (7 cm for the paper's vessel), so
# that points closer than that to the line past them can go, and corners be rounded, outside V.
_SLACK = 0.04
# A point (x, y) as x + iy, so that points can be looked for among others.
_AS_COMPLEX = np.array([1, 1j])


@dataclass(frozen=True)
class Corridor:
    """Where paths of a class are sought: its channel and the triangles beside it, less V.

    `triangles` (t,) are their indices and `corners` (t, 3, 2) their corners; `walls` (w, 2, 2) the
    outer edges among theirs that are no hazard: water too far off, or the end of the chart. Paths
    are sought in the current's `table`.
    """

    channel: Channel
    triangles: IntArray
    corners: FloatArray
    walls: FloatArray
    hazards: Hazards
    current: CurrentField
    table: Table
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

    @cached_property
    def left_out(self) -> BoolArray:
        """Barriers (2, b) whose V holds the start, or the goal: the first or last leg is free."""
        return np.stack([self.holds(self.start), self.holds(self.goal)])

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


def rough_path(corridor: Corridor, *, bulging: bool = True) -> FloatArray:
    """Path (n, 2) through the corridor that is close to the least-fuel one.

    Post-condition: it never enters V but for the part around start and goal, and no leg of it
    runs where the current outruns the vessel. Unless it may bulge, it keeps near its channel.
    InfeasibleError says why there is none.
    """
    midline = corridor.channel.midline(corridor.start, corridor.goal)
    length = _length(midline)
    try:
        path = _through_sections(corridor, _COARSE_SPACING * length, _COARSE_ANGLE)
    except InfeasibleError as error:
        if error.strait is not None:
            raise
        path = _through_sections(corridor, _SHORT_SPACING * length, _SHORT_ANGLE)
    return _bettered(corridor, path, _WIDE) if bulging else path


def refined_path(corridor: Corridor, rough: FloatArray) -> FloatArray:
    """Least-fuel path (n, 2) near a rough one, which V may have grown into since.

    Post-condition: as of :func:`rough_path`. InfeasibleError where no way out of V is near.
    """
    path = _bettered(corridor, rough, _NARROW)
    if not corridor.legs_clear(path).all():
        raise InfeasibleError("its path lies in V, and no path clear of V is near")
    return _without_needless_points(corridor, path)


def _bettered(corridor: Corridor, path: FloatArray, passes: tuple[_Pass, ...]) -> FloatArray:
    """Path (n, 2) after some passes over points on rungs across it."""
    length = _length(path)
    closest = _CLOSEST_RUNGS * corridor.vessel.turning_radius
    capsules = _Capsules(*corridor.barriers, corridor.sought, corridor.left_out)
    # From pass to pass it moves by a window at the most, and these shrink: twice the first in all.
    capsules = capsules.near(path, 2 * passes[0].window * length)
    whole = np.asarray(corridor.left_out.any(axis=1))
    current = corridor.table, corridor.vessel.speed, corridor.drift == "crab"
    # A channel of many triangles has brought many points.
    path = cut_short(path, 2 * passes[0].spacing * length, *current, *capsules.capsules)
    for one in passes:
        path = with_rungs(path, one.spacing * length, one.bend, closest, whole)
        window, longest = one.window * length, 2 * one.spacing * length
        # Legs lie between points that lie in windows beside the path.
        near = capsules.near(path, window)
        path = across_rungs(
            path, window, one.points, longest, *current, *near.capsules, near.left_out
        )
    return path


class _Capsules(NamedTuple):
    """What paths keep out of: see :func:`renew.kernels.viterbi.quickest_chain`."""

    start: FloatArray
    end: FloatArray
    radius: FloatArray
    left_out: BoolArray

    @property
    def capsules(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Ends (b, 2) and (b, 2), and radius (b,)."""
        return self.start, self.end, self.radius

    def near(self, path: FloatArray, distance: float) -> _Capsules:
        """Those whose bounds come within a distance (m) of a leg's."""
        bounds = capsule_bounds(self.start, self.end, self.radius)
        close = boxes_near(path, distance, bounds)
        left_out = np.ascontiguousarray(self.left_out[:, close])
        return _Capsules(self.start[close], self.end[close], self.radius[close], left_out)


def _length(path: FloatArray) -> float:
    """Length of a path (n, 2) in metres."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _through_sections(corridor: Corridor, spacing: float, angle: float) -> FloatArray:
    """Quickest path (n, 2) through points all over the channel's sections."""
    sections, free = _open_sections(corridor, spacing, angle)
    best = _quickest(corridor, sections, free.spread(_COARSE_POINTS))
    return np.vstack([corridor.start, sections.points(best), corridor.goal])


def _open_sections(corridor: Corridor, spacing: float, angle: float) -> tuple[Sections, FreeParts]:
    """Sections of a corridor and their free intervals, none of them shut."""
    sections = cut(corridor.channel, corridor.start, corridor.goal, spacing, angle)
    free = free_parts(sections, *corridor.barriers, corridor.sought)
    sections, free = _skip_soft_ends(sections, free)
    _check_open(corridor, sections, free)
    return sections, free


def _quickest(corridor: Corridor, sections: Sections, places: FloatArray) -> FloatArray:
    """Places (s,) of the quickest chain through places (s, m) on sections."""
    points = np.empty((len(places) + 2, max(places.shape[1], 1), 2))
    points[0], points[-1] = corridor.start, corridor.goal
    points[1:-1] = sections.points(places)
    arrival, chain = quickest_chain(
        points,
        velocities(corridor.table, points.reshape(-1, 2)).reshape(points.shape),
        corridor.vessel.speed,
        corridor.drift == "crab",
        *corridor.barriers,
        corridor.sought,
        corridor.left_out,
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
    banks = np.stack([sections.left[narrowest], sections.right[narrowest]])
    paddings = (corridor.hazards.around(bank).padding.max(initial=0.0) for bank in banks)
    move = corridor.channel.moves[int(sections.fan[narrowest])]
    raise InfeasibleError(Strait(banks, *move, *map(float, paddings)))


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
    kept = np.flatnonzero(np.isin(path @ _AS_COMPLEX, thinned @ _AS_COMPLEX))
    keep = np.zeros(len(path), dtype=bool)
    keep[kept] = True
    for leg in np.flatnonzero(~corridor.legs_clear(path[kept])):
        keep[kept[leg] : kept[leg + 1]] = True
    return np.asarray(path[keep])
