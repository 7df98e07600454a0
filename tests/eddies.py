"""Scenes with small eddies, islands or thin walls, and an oracle for them.

The current is a sum of stream functions A sin(a π x / L + φ) sin(b π y / L + χ), so it has no
divergence, as a sea's has nearly none; its peak is 0.85 of the vessel's speed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import Polygon, affinity, box

import renew
from renew._types import FloatArray
from tests.oracles import grid_dijkstra, tighten
from tests.strategies import Scene

PEAK_M_S = 0.85
"""Strongest current, m/s."""

WAVES, ISLANDS = (4, 7, 10, 14, 20), (0, 1, 3, 8)
SCENES = tuple(
    (seed, waves, ISLANDS[seed // len(WAVES) % len(ISLANDS)], 1600.0 if waves == 20 else 200.0)
    for seed, waves in ((seed, WAVES[seed % len(WAVES)]) for seed in range(40))
)
"""Forty scenes: seed, half-waves along a side, islands, side (m)."""

# Thickness of a thin wall, and width of the gaps in a serpentine of them, m.
_THICKNESS, _GAP = 3.0, 30.0

# Number of stream functions that are added.
_TERMS = 6
# Number of points a side on which the peak is found.
_DENSE = 400
# Spacing of the oracle's grid as a share of the square's side, and its stencil: 80 neighbours.
_ORACLE_SPACING, _ORACLE_RADIUS = 1 / 200, 5


@dataclass(frozen=True)
class Eddies:
    """A current as a plain function; each row of `terms` (t, 5) is A, a, φ, b, χ."""

    side: float
    terms: FloatArray
    factor: float = 1.0

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2), m/s, at points (..., 2), m."""
        strength, a, phase_x, b, phase_y = self.terms.T
        x = a * np.pi / self.side * points[..., :1] + phase_x
        y = b * np.pi / self.side * points[..., 1:] + phase_y
        u = -(strength * b * np.sin(x) * np.cos(y)).sum(-1)
        v = (strength * a * np.cos(x) * np.sin(y)).sum(-1)
        return np.asarray(self.factor * np.stack([u, v], axis=-1))


@dataclass(frozen=True)
class EddyScene(Scene[Eddies]):
    """A scene with an oracle."""

    def oracle(self, clearance: float = 0.0) -> tuple[float, FloatArray]:
        """Least fuel and path (n, 2) by a fine grid and string pulling."""
        spacing = _ORACLE_SPACING * self.current.side
        _, path = grid_dijkstra(*self.asked, spacing, clearance, radius=_ORACLE_RADIUS)
        water = self.chart, self.current, self.vessel
        return tighten(path, *water, clearance, spacing=spacing, width=2 * spacing)


def eddies(rng: np.random.Generator, waves: int, side: float) -> Eddies:
    """Eddies with up to `waves` half-waves along a side."""
    low = max(1, waves // 3)
    terms = np.column_stack(
        [
            rng.uniform(0.3, 1, _TERMS),
            rng.integers(low, waves + 1, _TERMS),
            rng.uniform(0, 2 * np.pi, _TERMS),
            rng.integers(low, waves + 1, _TERMS),
            rng.uniform(0, 2 * np.pi, _TERMS),
        ]
    )
    terms[:, 0] /= np.hypot(terms[:, 1], terms[:, 3])
    axis = np.linspace(0, side, _DENSE)
    raw = Eddies(side, terms)
    peak = np.linalg.norm(raw(np.stack(np.meshgrid(axis, axis), axis=-1)), axis=-1).max()
    return Eddies(side, terms, PEAK_M_S / float(peak))


def eddy_scene(seed: int, waves: int, islands: int, side: float = 200.0) -> EddyScene:
    """Square of water with eddies and convex islands; start and goal in opposite corners."""
    rng = np.random.default_rng([seed, waves, islands])
    current = eddies(rng, waves, side)
    start, goal = np.full(2, 0.1 * side), np.full(2, 0.9 * side)
    land: list[Polygon] = []
    while len(land) < islands:
        centre = rng.uniform(0.12 * side, 0.88 * side, 2)
        angle = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(5, 9))))
        radius = side * rng.uniform(0.03, 0.30 / np.sqrt(islands + 1))
        island = shapely.convex_hull(
            shapely.multipoints(centre + radius * np.column_stack([np.cos(angle), np.sin(angle)]))
        )
        apart = 0.03 * side
        near = [*land, shapely.Point(start), shapely.Point(goal)]
        if island.area > 0.3 * radius**2 and shapely.distance(island, near).min() > apart:
            land.append(island)
    return EddyScene(renew.Chart(shapely.box(0, 0, side, side), land), current, start, goal)


def walls(kind: str, seed: int) -> EddyScene:
    """Thin walls on 200 m by 200 m: a "serpentine", a "comb", a "spiral" or a "bay"."""
    side = 200.0
    rng = np.random.default_rng([seed, sum(map(ord, kind))])
    start, goal = np.array([15.0, 100.0]), np.array([185.0, 100.0])
    land: list[Polygon] = []
    if kind == "serpentine":
        for i, x in enumerate(np.linspace(0, side, int(rng.integers(5, 8)))[1:-1]):
            low, high = (0.0, side - _GAP) if i % 2 else (_GAP, side)
            land.append(box(x - _THICKNESS / 2, low, x + _THICKNESS / 2, high))
    elif kind == "comb":
        for x in np.linspace(40, 160, int(rng.integers(3, 6))):
            high, middle = rng.uniform(30, 65), rng.uniform(60, 140)
            wall = box(x - _THICKNESS / 2, middle - high, x + _THICKNESS / 2, middle + high)
            land.append(affinity.rotate(wall, rng.uniform(-23, 23)))
    elif kind == "spiral":
        turn = np.linspace(0.35, 1, 60)
        angle = 3.2 * np.pi * turn + rng.uniform(0, 2 * np.pi)
        line = 100 + 80 * turn[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        land.append(shapely.LineString(line).buffer(_THICKNESS / 2, quad_segs=2).simplify(0.2))
        start, goal = np.array([100.0, 100.0]), np.array([195.0, 5.0])
    else:
        bay = box(60, 40, 150, 160).difference(box(59, 43, 147, 157))
        land.append(affinity.rotate(bay, rng.uniform(0, 360), origin=(100, 100)))
        start = np.array([100.0, 100.0])
    current = eddies(rng, int(rng.integers(2, 7)), side)
    current = replace(current, factor=current.factor / PEAK_M_S * rng.uniform(0.5, 0.9))
    return EddyScene(renew.Chart(shapely.box(0, 0, side, side), land), current, start, goal)
