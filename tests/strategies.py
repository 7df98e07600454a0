"""Shared test scenes and hypothesis strategies: islands, currents, vessels; planar metres."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeAlias, TypeVar, cast

import numpy as np
import shapely
from hypothesis import settings, strategies as st
from shapely import Polygon, box

import renew
from renew._types import FloatArray
from renew.inputs.current import as_field
from renew.inputs.options import Drift
from renew.voyage.voyage import Voyage, Waters

SIZE = 200.0
"""Side of the random scenes (m)."""

Point: TypeAlias = FloatArray | tuple[float, float]
CurrentT = TypeVar("CurrentT", bound=Callable[[FloatArray], FloatArray])

SINGLE_GYRE_ISLANDS = (
    ((28, 61.5), (36, 61.5), (36, 70), (30, 70)),
    ((51, 67.5), (55, 67), (55, 72), (52, 72)),
    ((39, 43), (43.5, 47.5), (64, 50), (64.5, 24), (61, 25)),
)
"""Obstacles of the published single gyre, m; read off its figure."""

PAPER_VESSEL = renew.Vessel(speed=1.0, turn_rate=math.radians(35), length=2.0)


STILL = renew.UniformCurrent(0.0, 0.0)


@dataclass(frozen=True)
class Scene(Generic[CurrentT]):
    """What :func:`renew.plan` takes, m and s."""

    chart: renew.Chart
    current: CurrentT
    start: FloatArray
    goal: FloatArray
    drift: Drift = "projected"
    departure: float = 0.0
    vessel: renew.Vessel = PAPER_VESSEL

    @property
    def parts(self) -> tuple[renew.Chart, CurrentT, FloatArray, FloatArray]:
        """Chart, current, start and goal."""
        return self.chart, self.current, self.start, self.goal

    @property
    def asked(self) -> tuple[renew.Chart, CurrentT, renew.Vessel, FloatArray, FloatArray]:
        """The first arguments of a plan."""
        return self.chart, self.current, self.vessel, self.start, self.goal

    @property
    def voyage(self) -> Voyage:
        """The voyage as parts of the planner take it."""
        waters = Waters(self.chart, as_field(self.current))
        return Voyage(waters, self.vessel, self.start, self.goal, self.drift, self.departure)

    def in_current(self, current: renew.CurrentField) -> Scene[Any]:
        """Return the scene in another current."""
        return replace(cast("Scene[Any]", self), current=current)

    def plan(self, **options: Any) -> renew.Plan:
        """Plan it."""
        own = {"drift": self.drift, "departure": self.departure}
        return renew.plan(*self.asked, **{**own, **options})

    def plan_departures(self, departures: Any, **options: Any) -> renew.Departures:  # noqa: ANN401
        """Plan departures (n,), s."""
        return renew.plan_departures(*self.asked, departures, **{"drift": self.drift, **options})

    def turns(self, route: renew.Route, **options: Any) -> renew.Contingency:
        """Fly hard-over turns from along a route."""
        given = self.chart, self.current, self.vessel
        return renew.contingency(route, *given, **{"drift": self.drift, **options})


def examples(gate: int, new: int) -> settings:
    """Give the number of examples that the gate draws, and that `make test-new-examples` does."""
    return settings(max_examples=gate if settings().derandomize else new)


def single_gyre() -> Scene[renew.GyreCurrent]:
    """Return the published single gyre."""
    chart = chart_of([Polygon(corners) for corners in SINGLE_GYRE_ISLANDS])
    ends = np.array([10.0, 10.0]), np.array([90.0, 90.0])
    return Scene(chart, renew.GyreCurrent(0.8, 100, 100), *ends)


def chart_of(islands: list[Polygon]) -> renew.Chart:
    """Return islands in a square of water, 100 m by 100 m."""
    return renew.Chart(box(0, 0, 100, 100), islands)


def random_islands(seed: int, count: int = 7) -> list[Polygon]:
    """Convex islands of a random scene, at least 10 m from its edge."""
    rng = np.random.default_rng(seed)
    islands: list[Polygon] = []
    while len(islands) < count:
        centre = rng.uniform(30, SIZE - 30, 2)
        angle = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 8)))
        corners = centre + rng.uniform(6, 20) * np.column_stack([np.cos(angle), np.sin(angle)])
        island = shapely.convex_hull(shapely.MultiPoint(corners))
        if island.geom_type == "Polygon" and island.area > 20:
            islands.append(island)
    return islands


class StreamFunctionCurrent(renew.CurrentField):
    """Divergence-free current: a seeded sum of stream functions, scaled to a given peak (m/s)."""

    def __init__(self, seed: int, peak: float) -> None:
        rng = np.random.default_rng(seed)
        self._wave = rng.normal(0, 2 * np.pi / 150, (6, 2))
        self._phase = rng.uniform(0, 2 * np.pi, 6)
        self._scale = 1.0
        x, y = np.meshgrid(np.linspace(0, SIZE, 101), np.linspace(0, SIZE, 101))
        speeds = np.linalg.norm(self(np.stack([x, y], axis=-1)), axis=-1)
        self._scale = peak / float(speeds.max())

    def __call__(self, points: FloatArray) -> FloatArray:
        """Velocity (..., 2), m/s: the gradient of the stream function, rotated by 90 degrees."""
        slope = np.cos(points @ self._wave.T + self._phase)
        return self._scale * np.stack(
            [slope @ self._wave[:, 1], -(slope @ self._wave[:, 0])], axis=-1
        )


def random_scene(
    seed: int, peak: float | None = None, islands: int = 7
) -> Scene[StreamFunctionCurrent]:
    """Return a random scene; its current peaks at 0.3 to 0.85 m/s, if no peak is given."""
    rng = np.random.default_rng([seed, 1])
    strongest = float(rng.uniform(0.3, 0.85)) if peak is None else peak
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed, islands))
    current = StreamFunctionCurrent(seed, strongest)
    return Scene(chart, current, np.array([10.0, 10.0]), np.array([SIZE - 10, SIZE - 10]))


def voyage_on(
    chart: renew.Chart,
    start: Point = (10.0, 10.0),
    goal: Point = (90.0, 90.0),
    current: renew.CurrentField | None = None,
    drift: Drift = "projected",
) -> Voyage:
    """Return a voyage of the paper's vessel; in still water, if no current is given."""
    return Scene(chart, current or STILL, np.array(start), np.array(goal), drift).voyage


seeds = st.integers(0, 10_000)
speeds = st.floats(0.0, 0.8)
angles = st.floats(-math.pi, math.pi)
