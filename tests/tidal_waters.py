"""Scenes with bars that the tide shuts, an oracle that runs the clock, and flights on a route."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

import renew
from renew._types import BoolArray, FloatArray
from renew.inputs.openings import ReliedOnTide
from tests.clock_oracle import earliest_arrival, sailed, tighten
from tests.oracles import STENCIL_RADIUS
from tests.strategies import PAPER_VESSEL, Scene, random_scene

SCALE = 100.0
"""Metres of a tidal scene to a metre of a random one: a voyage takes about half a tide."""

# Share of the time under way by which the vessel may be early or late.
LATENESS = 0.05
_TIDE = {"M2": renew.Constant(1.5, 0.0), "S2": renew.Constant(0.4, 30.0)}
_MEAN = 1.9
_SURGE, _LAG = 0.2, 600.0
# Largest error (m) of straight lines between heights two minutes apart.
_ROUNDING = 2e-3
# Times (s), up to a tenth of the voyage, by which a vessel without its detour would be too early.
_EARLIER = np.arange(400.0, 2401.0, 400.0)


def positions(
    route: renew.Route,
    scene: Scene[renew.CurrentField],
    along: FloatArray,
    late: FloatArray,
    side: float,
    step: float,
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield where vessels are (n, 2), m, and when (n,), s, at each step (s) of their turns.

    The vessel sails its track, and from its places there at times `along` (n,), s, it turns full
    circles to a side (1 or -1) at the highest speed of its route. It passes them so much later than
    planned: `late` (n,), s.
    """
    track = route.trajectory
    place = np.stack([np.interp(along, track[:, 0], track[:, k]) for k in (1, 2, 3)], axis=1)
    position, heading = place[:, :2], place[:, 2]
    now = np.maximum(along + late, route.times[0])
    for _ in range(int(np.ceil(scene.vessel.turn_period / step)) + 1):
        yield position, now
        through = route.speeds.max() * np.column_stack([np.cos(heading), np.sin(heading)])
        position = position + step * (through + scene.current.velocity(position, now))
        heading = heading + side * scene.vessel.turn_rate * step
        now = now + step


class _Scaled(renew.CurrentField):
    """The current of a random scene on a scale."""

    def __init__(self, field: renew.CurrentField) -> None:
        self._field = field

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2), m/s."""
        return self._field(points / SCALE)


@dataclass(frozen=True)
class TidalScene(Scene[renew.CurrentField]):
    """A scene with water that the tide opens and shuts."""

    depth: renew.TidalDepth = field(kw_only=True)

    def plan(self, **options: Any) -> renew.Plan:
        """Plan with the tide."""
        return super().plan(**{"depth": self.depth, "lateness": LATENESS, **options})

    def with_tide_raised(self, rise: float) -> TidalScene:
        """Return the scene with a tide that is higher by so many metres at all times."""
        tide = self.depth.tide
        assert isinstance(tide, renew.Tide)
        higher = replace(tide, mean_level=tide.mean_level + rise)
        return replace(self, depth=replace(self.depth, tide=higher))

    @property
    def bound(self) -> float:
        """Fuel that no route stays below, whatever the tide does over water that it may open.

        It is that of all plans of the scene, and known even where the tide shuts every way.
        """
        open_at_all_times = {"depth": None, "avoid": self.depth.never_open}
        found = self.plan(padding="none", classes=1, **open_at_all_times)
        return found.best.fuel_bound.value

    def oracle(
        self, spacing: float = 3.0 * SCALE, *, is_coarse: bool = False
    ) -> tuple[float, FloatArray]:
        """Least fuel by a grid (m) and string pulling, with legs shut by the tide; and the path.

        A coarse stencil, tightened in fewer places, takes a fifth of the time. Its fuel, too, is
        that of a path that can be sailed: a bound above it is wrong.
        """
        common: dict[str, Any] = {"drift": self.drift, "is_shut": self.is_shut}
        radius = 4 if is_coarse else STENCIL_RADIUS
        fuel, path = earliest_arrival(
            *self.asked, self.departure, spacing=spacing, radius=radius, **common
        )
        if not len(path):
            return fuel, path
        common |= {"spacing": (6.0 if is_coarse else 3.0) * SCALE, "width": 6.0 * SCALE}
        water = self.chart, self.current, self.vessel
        return tighten(path, *water, self.departure, rounds=2 if is_coarse else 7, **common)

    def too_shallow(self, route: renew.Route) -> tuple[int, int]:
        """Fly turns along a route: those with too little water somewhere, and all.

        A vessel passes early, on time and late, and from each place of its track begins a full turn
        to each side; the tide relied on must exceed the need wherever it is.
        """
        tide = ReliedOnTide(self.depth.tide, self.depth.surge, self.depth.lag)  # type: ignore[arg-type]
        begin, end = route.trajectory[[0, -1], 0]
        along = np.arange(begin, end, 60.0)
        late = LATENESS * (along - begin)
        sides = list(itertools.product((-1.0, 0.0, 1.0), (1.0, -1.0)))
        is_low = np.zeros((len(sides), len(along)), dtype=bool)
        for low, (share, side) in zip(is_low, sides, strict=True):
            flight = positions(route, self, along, share * late, side, self.vessel.turn_period / 60)
            for position, time in flight:
                heights = tide.heights(time)
                for area, need in zip(self.depth.areas, self.depth.needs, strict=True):
                    low[shapely.contains_xy(area, position) & (heights < need - _ROUNDING)] = True
        return int(is_low.sum()), is_low.size

    def is_in_time_for_water(self, path: FloatArray) -> bool:
        """Whether a path (n, 2) comes to a bar soon after it opens, like paths with a detour.

        A path without points, of a grid on which every way is shut, is in time as well.
        """
        if not len(path):
            return True
        line = shapely.LineString(path)
        path = shapely.get_coordinates(line.segmentize(line.length / 400))
        times = [self.departure]
        for begin, end in itertools.pairwise(path):
            arguments = self.current, self.vessel, self.drift, 1
            times += sailed(begin[None], end[None], np.array(times[-1:]), *arguments).tolist()
        return any(
            self.is_shut(path[:-1], path[1:], passed[:-1], passed[1:]).any()
            for passed in np.array(times) - _EARLIER[:, None]
        )

    def is_shut(
        self, a: FloatArray, b: FloatArray, begin: FloatArray, end: FloatArray
    ) -> BoolArray:
        """Whether there may be too little water on legs while a vessel, or its turn, is there."""
        shut = ~np.isfinite(end)
        legs = shapely.linestrings(np.stack([a, b], axis=1))
        tide = ReliedOnTide(self.depth.tide, _SURGE, _LAG)  # type: ignore[arg-type]
        for area, need in zip(self.depth.areas, self.depth.needs, strict=True):
            shapely.prepare(area)
            at = np.flatnonzero(shapely.intersects(area, legs) & ~shut)
            early = begin[at] - LATENESS * (begin[at] - self.departure)
            late = end[at] + LATENESS * (end[at] - self.departure) + self.vessel.turn_period
            shut[at] = tide.heights(np.linspace(early, late, 4)).min(axis=0) < need
        return shut


def tidal_scene(seed: int) -> TidalScene:
    """Return a random scene with one to three bars across the way, each with a deeper part."""
    rng = np.random.default_rng([seed, 37])
    chart, current, start, goal = random_scene(seed).parts
    start, goal = start * SCALE, goal * SCALE
    bars = int(rng.integers(1, 4))
    areas, needs = [], []
    along = (goal - start) / np.linalg.norm(goal - start)
    across = np.array([-along[1], along[0]])
    for place in np.sort(rng.uniform(0.2, 0.8, bars)):
        middle = start + place * (goal - start)
        half = rng.uniform(2, 5) * SCALE
        ends = np.concatenate([[-400.0], np.sort(rng.uniform(-60, 60, 2)), [400.0]]) * SCALE
        for left, right in itertools.pairwise(ends):
            corners = [
                middle + side * half * along + end * across
                for side, end in ((-1, left), (1, left), (1, right), (-1, right))
            ]
            area = shapely.intersection(Polygon(corners), shapely.transform(chart.extent, _scaled))
            if not area.is_empty:
                areas.append(area)
                needs.append(float(rng.uniform(-0.5, 3.3)))
    tide = renew.Tide(_TIDE, _MEAN, np.datetime64("2026-11-22T00:00:00"))
    return TidalScene(
        renew.Chart(
            shapely.transform(chart.extent, _scaled),
            [shapely.transform(one, _scaled) for one in chart.no_go],
        ),
        _Scaled(current),
        start,
        goal,
        "crab" if seed % 2 else "projected",
        float(rng.uniform(0, 12.42 * 3600)),
        renew.Vessel(PAPER_VESSEL.speed, PAPER_VESSEL.turn_rate / SCALE, PAPER_VESSEL.length),
        depth=renew.TidalDepth(areas, needs, tide, surge=_SURGE, lag=_LAG),
    )


def _scaled(points: FloatArray) -> FloatArray:
    """Coordinates on the scene's scale."""
    return points * SCALE
