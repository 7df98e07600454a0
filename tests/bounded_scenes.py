"""Scenes with small eddies or thin walls, scenes that try to break the lower bound, and oracles.

Eddies are a sum of stream functions A sin(a π x / L + φ) sin(b π y / L + χ), so the current has no
divergence, as a sea's has nearly none; its peak is 0.85 of the vessel's speed.

Half of the bounded scenes have walls thinner than a cell of the bound's grid, with gaps, and
islets. Currents are of every kind that the bound distinguishes and up to 0.97 of the vessel's
speed; both drift models occur. The oracles share no code with the planner: their fuel is that of a
real path in the water (Dijkstra on a dense grid, then string pulling), so a bound above it is
false.
"""

import csv
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from shapely import Polygon, affinity, box

import renew
from renew._types import FloatArray
from renew.inputs.options import Drift
from tests.oracles import Field, grid_dijkstra, leg_times, tighten
from tests.strategies import PAPER_VESSEL, Scene

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


SEEDS = range(400)
"""The scenes of the whole suite."""

STRONGEST = 0.97
"""Strongest current, as a share of the vessel's speed: every fourth scene has it."""

SIDE_M = 200.0
"""Side of the square of water."""

FUELS = Path(__file__).with_name("bounded_scenes.csv")
"""The oracle's fuels, by seed: a test works some of them out again."""

_KINDS = ("still", "uniform", "gyre", "grid", "function")
# Spacing of the oracle's grid, m, and its stencil: 80 neighbours.
_SPACING, _RADIUS = 2.0, 5
# Largest length on which the oracle's final fuel is integrated by four nodes, m.
_PIECE = 0.5
# Least distance from start to goal, m, and of either from land.
_APART, _CLEAR = 70.0, 0.5


@dataclass(frozen=True)
class BoundedScene(Scene[renew.CurrentField]):
    """A scene with an oracle."""

    def oracle(self) -> float:
        """Fuel of the cheapest path that a grid and string pulling find; inf if there is none."""
        scene = (self.chart, self.current, PAPER_VESSEL)
        _, path = grid_dijkstra(*self.asked, _SPACING, drift=self.drift, radius=_RADIUS)
        if not len(path):
            return math.inf
        _, path = tighten(path, *scene, drift=self.drift, spacing=_SPACING, width=2 * _SPACING)
        times, _ = leg_times(path[:-1], path[1:], self.current, PAPER_VESSEL, self.drift, _PIECE)
        return float(PAPER_VESSEL.fuel_rate * times.sum())


class _Function(renew.CurrentField):
    """A current that is known by its values alone."""

    def __init__(self, velocity: Field) -> None:
        self._velocity = velocity

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2), m/s, at points (..., 2), m."""
        return self._velocity(points)


def bounded_scene(seed: int) -> BoundedScene:
    """Scene of a seed: drift, current, land and ends change at different paces."""
    rng = np.random.default_rng([seed, 36])
    drift: Drift = "crab" if seed % 2 else "projected"
    land = _thin_land(rng) if seed // 2 % 2 else _islands(rng)
    peak = STRONGEST if seed % 4 in (0, 3) and seed // 4 % 2 else rng.uniform(0.1, STRONGEST)
    current = _current(_KINDS[seed // 4 % len(_KINDS)], float(peak), rng)
    water = shapely.difference(box(0, 0, SIDE_M, SIDE_M), shapely.union_all(land).buffer(_CLEAR))
    while True:
        start, goal = rng.uniform(5, SIDE_M - 5, (2, 2))
        if math.dist(start, goal) > _APART and shapely.covers(
            water, shapely.multipoints([start, goal])
        ):
            break
    chart = renew.Chart(box(0, 0, SIDE_M, SIDE_M), land)
    return BoundedScene(chart, current, start, goal, drift)


def stored_fuels() -> dict[int, float]:
    """The oracle's fuels by seed, as they were worked out last."""
    with FUELS.open(encoding="utf-8", newline="") as file:
        return {int(row["seed"]): float(row["fuel"]) for row in csv.DictReader(file)}


def _current(kind: str, peak: float, rng: np.random.Generator) -> renew.CurrentField:
    """Current of a kind whose strongest is `peak` (m/s)."""
    angle = rng.uniform(0, 2 * np.pi)
    if kind == "still":
        return renew.UniformCurrent(0.0, 0.0)
    if kind == "uniform":
        return renew.UniformCurrent(peak * math.cos(angle), peak * math.sin(angle))
    if kind == "gyre":
        columns, rows = rng.integers(1, 4, 2).tolist()
        return renew.GyreCurrent(peak, SIDE_M, SIDE_M, columns, rows)
    swirls = eddies(rng, int(rng.integers(2, 7)), SIDE_M)

    def velocity(points: FloatArray) -> FloatArray:
        return peak / PEAK_M_S * swirls(points)

    if kind == "function":
        return _Function(velocity)
    axis = np.linspace(-1, SIDE_M + 1, int(rng.integers(9, 60)))
    return renew.GriddedCurrent(
        axis, axis, *np.moveaxis(velocity(np.stack(np.meshgrid(axis, axis), axis=-1)), -1, 0)
    )


def _islands(rng: np.random.Generator) -> list[Polygon]:
    """Up to eight convex islands, apart from each other."""
    land: list[Polygon] = []
    for _ in range(int(rng.integers(0, 9))):
        centre, radius = rng.uniform(20, SIDE_M - 20, 2), rng.uniform(3, 25)
        angle = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 9))))
        corners = centre + radius * np.column_stack([np.cos(angle), np.sin(angle)])
        island = shapely.convex_hull(shapely.multipoints(corners))
        if island.area > 2.0 and all(island.distance(other) > 1.0 for other in land):
            land.append(island)
    return land


def _thin_land(rng: np.random.Generator) -> list[Polygon]:
    """Walls 0.1 to 2 m thick, some with a gap of 1 to 20 m, and islets of 0.2 to 3 m."""
    land: list[Polygon] = []
    for _ in range(int(rng.integers(2, 6))):
        centre, long = rng.uniform(40, SIDE_M - 40, 2), rng.uniform(30, 80)
        half, gap = rng.uniform(0.05, 1.0), rng.uniform(1, 20)
        angle, gap_at = rng.uniform(0, 180), rng.uniform(-0.5, 0.5) * long
        parts = [(-long, gap_at - gap / 2), (gap_at + gap / 2, long)]
        whole = [(-long, long)]
        for low, high in parts if rng.random() < 0.6 else whole:
            wall = box(centre[0] + low, centre[1] - half, centre[0] + high, centre[1] + half)
            turned = affinity.rotate(wall, angle, origin=tuple(centre))
            inside = shapely.intersection(turned, box(2, 2, SIDE_M - 2, SIDE_M - 2))
            if inside.geom_type == "Polygon" and inside.area > 0:
                land.append(inside)
    for _ in range(int(rng.integers(5, 25))):
        x, y = rng.uniform(5, SIDE_M - 5, 2)
        size = rng.uniform(0.1, 1.5)
        land.append(affinity.rotate(box(x - size, y - size, x + size, y + size), x))
    apart: list[Polygon] = []
    for one in land:
        if all(one.distance(other) > 0.2 for other in apart):
            apart.append(one)
    return apart
