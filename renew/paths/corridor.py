"""The corridor of a class: its channel and the water beside it, without the soft no-go zone V."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from renew._compiled import for_kernels
from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.dual_graph import Channel, RoughPath, visits
from renew.errors import InfeasibleError, Strait
from renew.kernels.capsules import Capsules, legs_are_clear, segment_distance
from renew.kernels.ground_speed import Polar
from renew.kernels.viterbi import Stream
from renew.paths.sections import (
    FreeIntervals,
    Sections,
    free_intervals,
    intervals_outside,
    sections_of,
)
from renew.turns.padding_model import PaddedEdges
from renew.voyage.voyage import Voyage

# Extra distance from V, as a share of v/ω (1.6 cm for the paper's vessel), while a path is planned.
# With this slack, points near a line can be dropped and corners rounded without touching V.
SLACK = 0.01
# Number of directions in which a way out of V is looked for.
_DIRECTIONS = 72
# Least length of a leg out of V that a vessel turns onto, in v/ω.
_ROOM = 3.0
# Share of the largest coordinate below which a capsule's radius is lost to rounding.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Corridor:
    """Where paths of a class are planned: its channel and the triangles beside it, without V.

    `triangles` (t,) are indices and `corners` (t, 3, 2) the triangles' corners. `open_outline`
    (w, 2, 2) are outer edges that are no hazard: water too far off, or the end of the chart. Paths
    are planned in the voyage's table of the current, by the drift model of `polar`. With via
    points, `by_part` has the padding of each part of the voyage, and `padded` has all their edges
    with the least padding of each. Where padding `is_fitted`, simulated turns alone say how wide it
    must be.
    """

    voyage: Voyage
    polar: Polar
    channel: Channel
    triangles: IntArray
    corners: FloatArray
    open_outline: FloatArray
    padded: PaddedEdges
    by_part: tuple[PaddedEdges, ...] = ()
    is_fitted: bool = False

    def with_padding(self, parts: Sequence[PaddedEdges]) -> "Corridor":
        """Return the corridor with other padding: of the whole voyage, or of each part."""
        if not len(self.voyage.via):
            return replace(self, padded=parts[0])
        return replace(self, padded=PaddedEdges.joined(parts), by_part=tuple(parts))

    @property
    def paddings(self) -> tuple[PaddedEdges, ...]:
        """Padding of each part of the voyage, or of the whole if there are no via points."""
        return self.by_part or (self.padded,)

    @property
    def ends_in_padding(self) -> tuple[bool, bool]:
        """Whether the start, and the goal, lie in padding; turns begun in it are not judged."""
        first, last, voyage = self.paddings[0], self.paddings[-1], self.voyage
        return len(first.around(voyage.start).edge) > 0, len(last.around(voyage.goal).edge) > 0

    @property
    def rough_path(self) -> FloatArray:
        """The path (n, 2) by which the class was found."""
        return self.channel.rough_path(self.voyage.start, self.voyage.goal)

    def part(self, at: int, voyage: Voyage) -> "Corridor":
        """Return the corridor of a part of the voyage."""
        channel = self.channel.parts[at]
        return replace(self, voyage=voyage, channel=channel, padded=self.by_part[at], by_part=())

    def parts(self, path: FloatArray) -> "Iterator[tuple[Corridor, FloatArray]]":
        """Yield the corridor of each part of the voyage, with its piece of a path."""
        for at, (part, piece) in enumerate(self.voyage.parts(path)):
            yield (self.part(at, part) if len(self.voyage.via) else self), piece

    def chained(
        self, plan: "Callable[[Corridor, FloatArray], FloatArray]", pieces: Sequence[FloatArray]
    ) -> FloatArray:
        """Plan a path (n, 2) part by part from pieces; each part begins at the end of the last."""
        if not len(self.voyage.via):
            return plan(self, pieces[0])
        departure, paths = self.voyage.departure, list[FloatArray]()
        for at, piece in enumerate(pieces):
            part = self.part(at, self.voyage.part(at, departure))
            paths.append(plan(part, piece))
            departure = float(part.voyage.reading_times(paths[-1])[-1])
        return np.concatenate([paths[0], *(path[1:] for path in paths[1:])])

    @property
    def stream(self) -> Stream:
        """The current in which paths are planned."""
        return Stream(self.voyage.table, self.polar, self.voyage.clock)

    @cached_property
    def search_capsules(self) -> Capsules:
        """Capsules that planned paths avoid: V with some slack, and the open outline."""
        slack = SLACK * self.voyage.vessel.turning_radius
        return self._capsules(self._padding + slack)

    @cached_property
    def hard_capsules(self) -> Capsules:
        """Capsules that paths must avoid: V, and the open outline, which must not be touched.

        Edges with padding so thin that rounding would hide a crossing must not be touched either.
        """
        thinnest = _ROUNDING * np.abs(self.corners).max()
        return self._capsules(np.where(self._padding > thinnest, self._padding, -1.0))

    @cached_property
    def exempt(self) -> BoolArray:
        """Which capsules (2, c) contain the start, or the goal; a path may begin or end there."""
        start, end, radius = self.search_capsules
        return np.stack([segment_distance(place, start, end) < radius for place in self._ends])

    @property
    def _ends(self) -> tuple[FloatArray, FloatArray]:
        """The start and the goal, (2,) each, in the order of `exempt`."""
        return self.voyage.start, self.voyage.goal

    def legs_clear(self, path: FloatArray) -> BoolArray:
        """Whether each leg (n - 1,) of a path (n, 2) stays out of V.

        From a start inside V the legs up to the first point outside its capsules may lie in them.
        So may the last legs to a goal inside V.
        """
        clear = legs_are_clear(path[:-1], path[1:], self.hard_capsules)
        for at, step in enumerate((1, -1)):
            legs = slice(self._legs_in_soft_end(path[::step], at))
            # A view: its legs are in order from the end.
            from_end = clear[::step]
            if not from_end[legs].all():
                others = self.hard_capsules.select(~self.exempt[at])
                ahead, behind = path[::step][:-1][legs], path[::step][1:][legs]
                inside = legs_are_clear(ahead, behind, others)
                # Only the leg at a stop on the outline touches it.
                outline = self.exempt[at] & (self.hard_capsules.radius < 0)
                bare = self.hard_capsules.select(outline)
                inside[1:] &= legs_are_clear(ahead[1:], behind[1:], bare)
                from_end[legs] |= inside
        return clear

    def straight_in_soft_ends(self, path: FloatArray) -> FloatArray:
        """Return a path (n, 2) with one leg in V around a start or goal, which ends just outside.

        That leg leads to a point of the path or, if none can be reached, to the nearest point
        outside from which the path can continue.
        """
        for at in range(2):
            # The second round begins at the goal, and reverses the path again.
            path = self._straight_from(at, path)[::-1]
        return np.ascontiguousarray(path)

    def way_out(self, path: FloatArray) -> FloatArray | None:
        """Return a point (2,) to which a straight leg leads from the start out of V.

        Only points count whose leg is in V for hardly longer than the shortest such leg. The point
        is the one of these that suits a path (n, 2) best. Its leg is a few turning radii long at
        least. None where the path itself leaves V as soon, where the start lies in the part of V
        around the goal, or where no leg leads out.
        """
        start, holding = self.voyage.start, self.exempt[0]
        inside = path[: 1 + self._legs_in_soft_end(path, 0)]
        if len(inside) < 2 or (holding & self.exempt[1]).any():
            return None
        radius = self.voyage.vessel.turning_radius
        exits = self._exits(start, holding)
        far = np.linalg.norm(exits - start, axis=1)
        exits = start + np.maximum(1.0, _ROOM * radius / far)[:, None] * (exits - start)
        clear = _clear_from(start, exits, self._beyond(start, holding)) & self._contains(exits)
        soon = far[clear].min(initial=np.inf) + radius
        if np.linalg.norm(np.diff(inside, axis=0), axis=1).sum() <= soon:
            return None
        exits = exits[clear & (far <= soon)]
        length = np.linalg.norm(exits - start, axis=1) + np.linalg.norm(exits - inside[-1], axis=1)
        return np.asarray(exits[length.argmin()]) if len(exits) else None

    def _straight_from(self, at: int, path: FloatArray) -> FloatArray:
        """Return a path (n, 2) from an end with a first leg out of the capsules that hold it."""
        first = self._legs_in_soft_end(path, at)
        if not first:
            return path
        end, holding = self._ends[at], self.exempt[at]
        blocking = self._beyond(end, holding)
        ahead = path[first:]
        clear = _clear_from(end, ahead, blocking)
        if clear.any():
            path = np.vstack([end, ahead[clear.argmax() :]])
        else:
            exits = self._exits(end, holding)
            exits = exits[_clear_from(end, exits, blocking)]
            if not len(exits):
                return path
            length = np.linalg.norm(exits - end, axis=1) + np.linalg.norm(exits - ahead[0], axis=1)
            return np.vstack([end, exits[length.argmin()], ahead])
        soft = self.search_capsules.select(holding)
        (free,), (count,) = intervals_outside(path[:1].copy(), path[1:2].copy(), soft)
        radius, leg = self.voyage.vessel.turning_radius, path[1] - path[0]
        length = np.linalg.norm(leg)
        # If the leg goes on far beyond the capsules, the path may bend just outside of them.
        if count and length * (1.0 - free[count - 1, 0]) > radius:
            outside = free[count - 1, 0] + SLACK * radius / length
            path = np.insert(path, 1, path[0] + outside * leg, axis=0)
        return path

    def _beyond(self, end: FloatArray, holding: BoolArray) -> Capsules:
        """Return what a leg from an end avoids.

        That is the land in the capsules that hold the end, and all of the other capsules.
        """
        capsules, slack = self.hard_capsules, SLACK * self.voyage.vessel.turning_radius
        # If an end lies on an edge, each leg from it touches that edge.
        on_edge = segment_distance(end, capsules.start, capsules.end) <= slack
        radius = np.where(holding, -1.0, capsules.radius)
        return capsules._replace(radius=radius).select(~(holding & on_edge))

    def _exits(self, end: FloatArray, holding: BoolArray) -> FloatArray:
        """Return the corridor's points (n, 2) just outside the capsules that hold an end.

        They lie in all directions. None is further off than twice the widest of the capsules.
        """
        soft = self.search_capsules.select(holding)
        furthest, radius = 2 * soft.radius.max(), self.voyage.vessel.turning_radius
        angle = np.linspace(0.0, 2 * np.pi, _DIRECTIONS, endpoint=False)
        rays = np.column_stack([np.cos(angle), np.sin(angle)])
        starts = np.broadcast_to(end, rays.shape).copy()
        free, count = intervals_outside(starts, end + furthest * rays, soft)
        last = free[np.arange(len(rays)), np.maximum(count - 1, 0)]
        out = (count > 0) & (last[:, 1] == 1.0)
        exits = end + (furthest * last[out, :1] + SLACK * radius) * rays[out]
        # The outline at an end on the chart's edge is no obstacle to an exit.
        return np.asarray(exits[self._contains(exits)])

    def _contains(self, points: FloatArray) -> BoolArray:
        """Whether each point (n, 2) lies in a triangle of the corridor."""
        ahead = np.roll(self.corners, -1, axis=1) - self.corners
        to_point = points[:, None, None] - self.corners
        turns = ahead[..., 0] * to_point[..., 1] - ahead[..., 1] * to_point[..., 0]
        inside = np.abs(np.sign(turns).sum(axis=2)) == ahead.shape[1]
        return np.asarray(inside.any(axis=1))

    def _legs_in_soft_end(self, path: FloatArray, at: int) -> int:
        """Return how many legs of a path (n, 2) from an end begin in the capsules that hold it."""
        if not (self.exempt[at].any() and (path[0] == self._ends[at]).all()):
            return 0
        soft = self.search_capsules.select(self.exempt[at])
        legs = 0
        while (
            legs < len(path) - 1
            and (segment_distance(path[legs], soft.start, soft.end) < soft.radius).any()
        ):
            legs += 1
        return legs

    def follows_open_outline(self, path: FloatArray) -> bool:
        """Whether a path (n, 2) follows the open outline, beyond which a better one may lie."""
        slack = np.full(len(self.open_outline), 2 * SLACK * self.voyage.vessel.turning_radius)
        ends = for_kernels(self.open_outline[:, 0]), for_kernels(self.open_outline[:, 1])
        outline = Capsules(*ends, slack)
        return not legs_are_clear(path[:-1], path[1:], outline).all()

    def channel_along(self, path: FloatArray) -> Channel:
        """Return the channel as if a path (n, 2) had found it."""
        parts = tuple(
            replace(part.channel, found_by=part.crossed_by(piece))
            for part, piece in self.parts(path)
            if len(self.voyage.via)
        )
        return replace(self.channel, found_by=self.crossed_by(path), parts=parts)

    def crossed_by(self, path: FloatArray) -> RoughPath:
        """Return a path (n, 2) with the triangles that it crosses."""
        return RoughPath(path, self.triangles[visits(path, self.corners).triangle])

    def open_sections(self, spacing: float, angle: float) -> tuple[Sections, FreeIntervals]:
        """Return sections at most `spacing` m and `angle` rad apart, with their parts outside V.

        Raises InfeasibleError, which names the strait, if V covers a whole section.
        """
        sections = sections_of(self.channel, self.voyage.start, self.voyage.goal, spacing, angle)
        free = free_intervals(sections, self.search_capsules)
        keep = self._outside_soft_ends(sections, free)
        sections, free = sections.select(keep), free.select(keep)
        if free.blocked.any():
            places = sections.place[free.blocked].astype(int)
            blocked = (self.channel.transitions[place] for place in places)
            raise InfeasibleError.at_strait(self._narrowest(sections, free), blocked)
        return sections, free

    @cached_property
    def _padding(self) -> FloatArray:
        """Padding (c,), m, of the padded edges, followed by the outline's, which is 0."""
        return np.append(self.padded.padding, np.zeros(len(self.open_outline)))

    def _capsules(self, radius: FloatArray) -> Capsules:
        """Return capsules with radii (c,), m, around the padded edges and then the outline."""
        return Capsules(
            np.concatenate([self.padded.start, self.open_outline[:, 0]]),
            np.concatenate([self.padded.end, self.open_outline[:, 1]]),
            radius,
        )

    def _outside_soft_ends(self, sections: Sections, free: FreeIntervals) -> BoolArray:
        """Return which sections (s,) to keep, so that a path can leave V around a start or goal.

        Three kinds of sections without a free part are left out. The first kind lies in the first
        or the last triangle, which a path may cross beside the section. The second kind comes
        before the first free section, and only the capsules around the start block it. The third
        kind comes after the last free section, and only the capsules around the goal block it.
        """
        keep = ~free.blocked
        if keep.all():
            return keep
        place = sections.place
        keep |= sections.passing | ((place > place[0]) & (place < place[-1]))
        for holding, step in zip(self.exempt, (1, -1), strict=True):
            near = np.arange(len(keep))[::step]
            near = near[: _first_true(~free.blocked[near])]
            others = self.search_capsules.select(~holding)
            is_shut = keep[near] & free_intervals(sections.select(near), others).blocked
            keep[near[: _first_true(is_shut)]] = False
        return keep

    def _narrowest(self, sections: Sections, free: FreeIntervals) -> Strait:
        """Return the narrowest section that V covers completely."""
        widths = np.linalg.norm(sections.right - sections.left, axis=1)
        narrowest = int(np.where(free.blocked, widths, np.inf).argmin())
        banks = np.stack([sections.left[narrowest], sections.right[narrowest]])
        paddings = (self.padded.around(bank).padding.max(initial=0.0) for bank in banks)
        transition = self.channel.transitions[int(sections.place[narrowest])]
        return Strait(banks, *transition, *map(float, paddings))


def _clear_from(end: FloatArray, points: FloatArray, capsules: Capsules) -> BoolArray:
    """Whether the leg from an end to each point (n, 2) is clear of capsules."""
    return legs_are_clear(np.broadcast_to(end, points.shape).copy(), for_kernels(points), capsules)


def _first_true(flags: BoolArray) -> int:
    """Return the index of the first True, or the number of flags (n,) if there is none."""
    return int(flags.argmax()) if flags.any() else len(flags)
