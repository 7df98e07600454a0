"""Attempts to find the least-fuel path of a class that can be steered, the most likely first."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np
import shapely

from renew._types import FloatArray
from renew.errors import InfeasibleError
from renew.kernels.current_table import velocities
from renew.kernels.ground_speed import chosen_speeds
from renew.paths.corridor import Corridor
from renew.paths.least_fuel_path import path_near, path_through_sections, refined_path
from renew.planner.grow import PaddingGrowth

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
    for polar in dict.fromkeys((corridor.polar, corridor.polar._replace(crab=True))):
        own = replace(corridor, polar=polar)
        yield partial(_near_rough_or_bulging, own, growth)
        for rough in (_bulging, path_through_sections):
            yield partial(path_from, own, rough, growth)


def _near_rough_or_bulging(
    corridor: Corridor, growth: PaddingGrowth
) -> tuple[Corridor, FloatArray]:
    """Return the corridor and the least-fuel path (n, 2) near the rough path of the class.

    In three cases the path near the best one within the channel is also searched, and the cheaper
    of both is returned: the first path needs much more padding, which then stays; padding pushes
    the first path away from the rough one; or tacking pays.
    """
    near = path_from(corridor, near_rough, growth)
    is_doubtful = _is_much_wider(near[0], corridor) or _pays_tacking(*near)
    if not (is_doubtful or _is_pushed_off(*near)):
        return near
    with contextlib.suppress(InfeasibleError):
        rough = _bulging(corridor)
        if is_doubtful or not _leads_to(rough, near[1]):
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
    """Return the path near a rough one; if more padding shuts that, near another rough path."""
    fitted = growth.fitted(corridor, rough)
    if fitted is corridor:
        return _refined(corridor, rough)
    try:
        return _refined(fitted, rough)
    except InfeasibleError:
        return _refined(fitted, rough_path(fitted))


def _is_pushed_off(corridor: Corridor, path: FloatArray) -> bool:
    """Whether a path (n, 2) needs clearly more fuel than the rough path of its class."""
    voyage = corridor.voyage
    rough = corridor.channel.rough_path(voyage.start, voyage.goal)
    return voyage.fuel(path) > _PUSHED_OFF * voyage.fuel(rough)


def _leads_to(rough: FloatArray, path: FloatArray) -> bool:
    """Whether a rough path runs so close to a least-fuel one (n, 2) that it would end there."""
    one, other = shapely.linestrings(rough), shapely.linestrings(path)
    return bool(shapely.hausdorff_distance(one, other) < _CLOSE * shapely.length(other))


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


def _is_much_wider(grown: Corridor, corridor: Corridor) -> bool:
    """Whether padding of a corridor has grown considerably anywhere."""
    return any(
        bool((after.padding > _MUCH * before.padding).any())
        for before, after in zip(corridor.paddings, grown.paddings, strict=True)
    )


def near_rough(corridor: Corridor) -> FloatArray:
    """Return the rough path (n, 2) near the path by which the class was found."""
    voyage = corridor.voyage
    return path_near(corridor, corridor.channel.rough_path(voyage.start, voyage.goal))


def _bulging(corridor: Corridor) -> FloatArray:
    """Return the rough path (n, 2) near the best path within the channel."""
    return path_near(corridor, path_through_sections(corridor))


def _refined(corridor: Corridor, rough: FloatArray) -> tuple[Corridor, FloatArray]:
    """Return the corridor, and the least-fuel path (n, 2) near a rough one."""
    return corridor, refined_path(corridor, rough)
