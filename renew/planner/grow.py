"""Find a class's least-fuel path that can be steered, and grow the padding until it is enough.

The padding of a class is first set for its channel. A path that bulges out of the channel, or a
turn in a perturbed current, may need more. The edges concerned then get more, and the class is
planned again.
"""

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np
import shapely

from renew._types import FloatArray, IntArray
from renew.classes.dual_graph import visits
from renew.errors import InfeasibleError
from renew.kernels.current_table import velocities
from renew.kernels.ground_speed import chosen_speeds
from renew.paths import least_fuel_path
from renew.paths.corridor import Corridor
from renew.planner.narrow_water import growable
from renew.planner.problem import Problem
from renew.steering.steer_in_corridor import steer_in_corridor, steer_simplified_in_places
from renew.turns.padding_model import PaddingModel
from renew.turns.verification import colliding_edges, passage_windows, risky_edges
from renew.voyage.voyage import Voyage

_Shortfall: TypeAlias = tuple[IntArray, FloatArray]
"""Constrained edges, and the amount by which the padding of each is too small (m)."""

Shortfalls: TypeAlias = tuple[_Shortfall | None, ...]
"""Shortfall of padding on each part of the voyage, between stops; None if there is none."""


def grown(corridor: Corridor, shortfall: Shortfalls) -> Corridor:
    """Return the corridor with its padding increased by the shortfall."""
    both = zip(corridor.paddings, shortfall, strict=True)
    return corridor.with_padding(
        [padded.grown(*short) if short else padded for padded, short in both]
    )


@dataclass(frozen=True)
class PaddingGrowth:
    """Finds how much adaptive padding a path lacks in its corridor.

    If paddings `are_fitted` to turns, turns alone judge it.
    """

    problem: Problem
    model: PaddingModel
    are_fitted: bool = False

    def shortfall(self, corridor: Corridor, path: FloatArray) -> Shortfalls | None:
        """Return a path's shortfall of padding in triangles that it crosses; if none, for turns."""
        if not self.problem.options.is_adaptive:
            return None
        # Each member of an ensemble passes via points at times of its own.
        every = zip(*(one.parts(path) for one in corridor.voyage.in_members), strict=True)
        return self.crossed_shortfall(corridor, path) or _any(
            self._turns_shortfall(part, [own for own, _ in voyages], piece)
            for (part, piece), voyages in zip(corridor.parts(path), every, strict=True)
        )

    def collisions(
        self, corridor: Corridor, path: FloatArray, speeds: FloatArray
    ) -> Shortfalls | None:
        """Return the shortfall for turns along a path (n, 2) sailed at speeds (n - 1,), m/s."""
        if not self.problem.options.is_adaptive:
            return None
        own_speeds = corridor.voyage.cut_speeds(path, speeds)
        return _any(
            growable(
                part.padded,
                colliding_edges(piece, [part.voyage], part.padded, self.problem.reach, own),
            )
            for (part, piece), own in zip(corridor.parts(path), own_speeds, strict=True)
        )

    def fitted(self, corridor: Corridor, path: FloatArray) -> Corridor:
        """Return the corridor with more padding where a path (n, 2) bulges out of its channel."""
        short = self.crossed_shortfall(corridor, path)
        return corridor if short is None else grown(corridor, short)

    def crossed_shortfall(self, corridor: Corridor, path: FloatArray) -> Shortfalls | None:
        """Return the shortfall where a path bulges out of the channel for which padding was set."""
        if corridor.is_fitted or not self.problem.options.is_adaptive:
            return None
        return _any(self._bulge_shortfall(*part) for part in corridor.parts(path))

    def _bulge_shortfall(self, corridor: Corridor, path: FloatArray) -> _Shortfall | None:
        """Return the shortfall where a path (n, 2) between two stops bulges out."""
        inside = visits(path, corridor.corners)
        crossed = inside._replace(triangle=corridor.triangles[inside.triangle])
        windows = passage_windows(corridor.voyage, path, inside.enter, inside.leave)
        return self.model.shortfall(crossed, windows, corridor.channel, corridor.padded)

    def _turns_shortfall(
        self, corridor: Corridor, voyages: Sequence[Voyage], path: FloatArray
    ) -> _Shortfall | None:
        """Return the shortfall for turns along a path (n, 2) between two stops, in all voyages."""
        voyage, padded = corridor.voyage, corridor.padded
        reach = self.problem.reach
        short = colliding_edges(path, voyages, padded, reach, is_fitted=self.are_fitted)
        short = growable(padded, short)
        if short or self.problem.options.risk_at == "route":
            return short
        return risky_edges(
            path, voyage, padded, corridor.corners, self.model.sampler, self.problem.options.risk
        )


def _any(short: Iterable[_Shortfall | None]) -> Shortfalls | None:
    """Return the shortfalls of all parts, or None if no part has one."""
    found = tuple(short)
    return found if any(one is not None for one in found) else None


# Growth of padding from which a path may be bad. In a changing current padding grows by some per
# cent in each round, because the hours of passage differ from the rough path's.
_MUCH = 1.1
# Ratio of a path's fuel to the rough path's from which padding has pushed the path away. The rough
# path itself needs a little more fuel than necessary.
_PUSHED_OFF = 1.005
# Largest distance, as a share of a path, from which a rough path still leads to that path.
_CLOSE = 0.0125


_Attempt: TypeAlias = Callable[[], tuple[Corridor, FloatArray]]
"""Finds a path (n, 2) of a class, and the corridor with the path's padding."""


def attempts(
    corridor: Corridor, near: FloatArray | None, growth: PaddingGrowth
) -> Iterator[_Attempt]:
    """Yield functions that find a path in a class, the most likely to be steerable first.

    If a path (n, 2) `near` is given, it is refined first. Above a head current of v/2, Eq. 4 as
    published rewards tacking, because v + c·T is then no convex speed polar; such paths can't be
    steered. The crab model's path is then tried last, without room to turn: making that room would
    double the time for a class that can't be sailed anyway.
    """
    if near is not None:
        yield partial(_refined, corridor, near)
    if growth.problem.falls_short:
        yield partial(path_from, corridor, near_rough, growth)
        yield partial(path_from, corridor, least_fuel_path.path_through_close_sections, growth)
        return
    for crab in dict.fromkeys((corridor.polar.crab, True)):
        own = replace(corridor, polar=corridor.polar._replace(crab=crab))
        yield partial(_near_rough_or_bulging, own, growth)
        for rough in (_bulging, least_fuel_path.path_through_sections):
            yield partial(path_from, own, rough, growth)


def _near_rough_or_bulging(
    corridor: Corridor, growth: PaddingGrowth
) -> tuple[Corridor, FloatArray]:
    """Return the corridor and the least-fuel path (n, 2) near the rough path of the class.

    In three cases the path near the best one within the channel is also searched, and the cheaper
    of both is returned: padding pushes the first path away from the rough one, tacking pays, or the
    first path needs much more padding, which the second path then has, too.
    """
    near = path_from(corridor, near_rough, growth)
    padded, path = near
    is_much_wider = any(
        bool((after.padding > _MUCH * before.padding).any())
        for before, after in zip(corridor.paddings, padded.paddings, strict=True)
    )
    is_doubtful = is_much_wider or _pays_tacking(padded, path)
    voyage = corridor.voyage
    if not is_doubtful and voyage.fuel(path) <= _PUSHED_OFF * voyage.fuel(corridor.rough_path):
        return near
    with contextlib.suppress(InfeasibleError):
        rough = _bulging(corridor)
        line = shapely.LineString(path)
        # A rough path as close to the path that was found would end there.
        is_close = shapely.LineString(rough).hausdorff_distance(line) < _CLOSE * line.length
        if is_doubtful or not is_close:
            bulging = _path_near(rough, corridor, _bulging, growth)
            return min(near, bulging, key=lambda found: corridor.voyage.fuel(found[1]))
    return near


def path_from(
    corridor: Corridor, rough_path: Callable[[Corridor], FloatArray], growth: PaddingGrowth
) -> tuple[Corridor, FloatArray]:
    """Return the path's padded corridor, and the least-fuel path (n, 2) near a rough one."""
    return _path_near(rough_path(corridor), corridor, rough_path, growth)


def _path_near(
    rough: FloatArray,
    corridor: Corridor,
    rough_path: Callable[[Corridor], FloatArray],
    growth: PaddingGrowth,
) -> tuple[Corridor, FloatArray]:
    """Return the path near a rough one or, if more padding shuts that way, near another one."""
    fitted = growth.fitted(corridor, rough)
    if fitted is corridor:
        return _refined(corridor, rough)
    try:
        return _refined(fitted, rough)
    except InfeasibleError:
        return _refined(fitted, rough_path(fitted))


def _pays_tacking(corridor: Corridor, path: FloatArray) -> bool:
    """Whether Eq. 4 rewards tacking somewhere on a path (n, 2): in a head current above v/2."""
    if corridor.polar.crab:
        return False
    legs, voyage = np.diff(path, axis=0), corridor.voyage
    times = voyage.reading_times(path)[:-1]
    velocity = velocities(voyage.table, path[:-1] + legs / 2, times)
    course = legs / np.linalg.norm(legs, axis=1)[:, None]
    along = (velocity * course).sum(axis=1)
    speed = chosen_speeds(velocity, course, voyage.polar)
    return bool((along < -speed / 2).any())


def near_rough(corridor: Corridor) -> FloatArray:
    """Return the rough path (n, 2) near the path by which the class was found."""
    return least_fuel_path.path_near(corridor, corridor.rough_path)


def _bulging(corridor: Corridor) -> FloatArray:
    """Return the rough path (n, 2) near the best path within the channel."""
    return least_fuel_path.path_near(corridor, least_fuel_path.path_through_sections(corridor))


def _refined(corridor: Corridor, rough: FloatArray) -> tuple[Corridor, FloatArray]:
    """Return the corridor, and the least-fuel path (n, 2) near a rough one."""
    return corridor, least_fuel_path.refined_path(corridor, rough)


# Maximum number of times that padding is increased where a path can't be steered.
_MAX_WIDENINGS = 16
# First increase of the padding around such a place, in multiples of v/ω.
_WIDENING = 0.15
# Largest increase of the padding there, in multiples of v/ω.
_WIDEST = 4.0
# Distance from the place up to which edges get more padding, in multiples of v/ω.
_AROUND = 3.0


def steered_as_it_is(
    corridor: Corridor, path: FloatArray
) -> tuple[Corridor, FloatArray, FloatArray]:
    """Return the corridor, the path (n, 2), and the trajectory (m, 4) steered in the corridor."""
    return corridor, *steer_in_corridor(path, corridor)


def steered_with_room(
    corridor: Corridor, path: FloatArray
) -> tuple[Corridor, FloatArray, FloatArray]:
    """Return a corridor with room to turn, a path (n, 2) in it, and its trajectory (m, 4).

    A path without padding wraps corners closely, which may leave no room to round them. Where it
    can't be steered, the edges nearby get more padding, and the path is refined again. If no edge
    is nearby, or padding doesn't help, the path is simplified there.
    """
    radius, tried = corridor.voyage.vessel.turning_radius, path
    used, places, widths = corridor, np.empty((0, 2)), np.empty(0)
    first: InfeasibleError | None = None
    for _ in range(_MAX_WIDENINGS):
        try:
            if first is not None:
                tried = least_fuel_path.refined_path(used, tried)
            return steered_as_it_is(used, tried)
        except InfeasibleError as error:
            first = first or error
            if not error.places:
                break
            # Each place gets twice the room that it had before.
            place = error.places[0]
            given = widths[np.linalg.norm(places - place, axis=1) < _AROUND * radius]
            width = max(2 * given.max(initial=0.0), _WIDENING * radius)
            if width > _WIDEST * radius:
                break
            places, widths = np.vstack([places, place]), np.append(widths, width)
            wider = [one.widened(places, widths, _AROUND * radius) for one in corridor.paddings]
            if all(len(a.edge) == len(b.edge) for a, b in zip(wider, used.paddings, strict=True)):
                # No edge is nearby.
                break
            used = corridor.with_padding(wider)
    with contextlib.suppress(InfeasibleError):
        return corridor, *steer_simplified_in_places(path, corridor)
    raise first or InfeasibleError("no attempt was made")
