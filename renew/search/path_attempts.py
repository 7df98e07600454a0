"""Ways to find the least-fuel path of a class that can be steered: the best first."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from renew._types import FloatArray
from renew.errors import InfeasibleError
from renew.inputs.voyage import Voyage
from renew.kernels.current_table import velocities
from renew.kernels.ground_speed import chosen_speeds
from renew.paths.corridor import Corridor
from renew.paths.least_fuel_path import path_near, path_through_sections, refined_path
from renew.search.growing_padding import PaddingGrowth, grown

# Ratio by which padding grows that may spoil a path. As the current changes, it grows by some per
# cent each time: a path is passed at other hours than the way by which its class was found.
_MUCH = 1.1
# Ratio to the fuel of a rough way, which is a little dearer than it need be, from which padding has
# pushed a path off it.
_PUSHED_OFF = 1.005


class PathAttempts:
    """Looks for the least-fuel path of a corridor, whose padding may grow."""

    def __init__(self, voyage: Voyage, growth: PaddingGrowth) -> None:
        self._voyage, self._growth = voyage, growth

    def in_order(
        self, corridor: Corridor, near: FloatArray | None
    ) -> list[Callable[[], tuple[Corridor, FloatArray]]]:
        """Ways to find a path that can be steered and stays in its class; the best first.

        Eq. 4 as published rewards tacking against currents above v/2, where v + c·T is no convex
        speed polar: such paths can't be steered. The crab model's path then can, as it is: making
        room for it as well would double the time of a class that can't be sailed.
        """
        polars = dict.fromkeys((corridor.polar, corridor.polar._replace(crab=True)))
        ways = (_bulging, path_through_sections)
        attempts: list[Callable[[], tuple[Corridor, FloatArray]]] = []
        for polar in polars:
            own = replace(corridor, polar=polar)
            attempts.append(partial(self._near_first, own))
            attempts += [partial(self.from_rough, own, way) for way in ways]
        if near is not None:
            attempts.insert(0, partial(_refined, corridor, near))
        return attempts

    def _near_first(self, corridor: Corridor) -> tuple[Corridor, FloatArray]:
        """Least-fuel path (n, 2) near that by which the class was found, and its corridor.

        The path near the best one within the channel is taken if it needs less fuel: where the
        other comes so close to land that it needs much more padding, which then stays, where
        padding pushes it off the way by which the class was found, or where tacking pays.
        """
        near = self.from_rough(corridor, near_first)
        if not (
            _is_much_wider(near[0], corridor)
            or self._is_pushed_off(*near)
            or self._pays_tacking(*near)
        ):
            return near
        with contextlib.suppress(InfeasibleError):
            bulging = self.from_rough(corridor, _bulging)
            return min(near, bulging, key=lambda found: self._voyage.fuel(found[1]))
        return near

    def _is_pushed_off(self, corridor: Corridor, path: FloatArray) -> bool:
        """Whether a path (n, 2) needs more than the rough way by which its class was found."""
        voyage = self._voyage
        way = corridor.channel.way(voyage.start, voyage.goal)
        return voyage.fuel(path) > _PUSHED_OFF * voyage.fuel(way)

    def _pays_tacking(self, corridor: Corridor, path: FloatArray) -> bool:
        """Whether Eq. 4 rewards tacking somewhere on a path (n, 2): against more than v/2."""
        if corridor.polar.crab:
            return False
        legs, voyage = np.diff(path, axis=0), self._voyage
        times = voyage.reading_times(path)[:-1]
        velocity = velocities(voyage.table, path[:-1] + legs / 2, times)
        course = legs / np.linalg.norm(legs, axis=1)[:, None]
        along = (velocity * course).sum(axis=1)
        speed = chosen_speeds(velocity, course, voyage.polar)
        return bool((along < -speed / 2).any())

    def from_rough(
        self, corridor: Corridor, way: Callable[[Corridor], FloatArray]
    ) -> tuple[Corridor, FloatArray]:
        """Least-fuel path (n, 2) from a rough one, and the corridor with the padding it needs."""
        rough = way(corridor)
        shortfall = self._growth.crossed_shortfall(corridor, rough)
        if shortfall is None:
            return _refined(corridor, rough)
        corridor = grown(corridor, shortfall)
        try:
            return _refined(corridor, rough)
        except InfeasibleError:
            return _refined(corridor, way(corridor))


def _is_much_wider(grown: Corridor, corridor: Corridor) -> bool:
    """Whether the padding of a corridor has grown by much somewhere."""
    return any(
        bool((after.padding > _MUCH * before.padding).any())
        for before, after in zip(corridor.paddings, grown.paddings, strict=True)
    )


def near_first(corridor: Corridor) -> FloatArray:
    """Rough path (n, 2) near the one by which the class was found."""
    voyage = corridor.voyage
    return path_near(corridor, corridor.channel.way(voyage.start, voyage.goal))


def _bulging(corridor: Corridor) -> FloatArray:
    """Rough path (n, 2) near the best one within the channel."""
    return path_near(corridor, path_through_sections(corridor))


def _refined(corridor: Corridor, rough: FloatArray) -> tuple[Corridor, FloatArray]:
    """Corridor, and the least-fuel path (n, 2) near a rough one."""
    return corridor, refined_path(corridor, rough)
