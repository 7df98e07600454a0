"""Scenes whose current changes on the way: swinging and reversing gyres, drifting eddies."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from shapely import box

import renew
from renew._types import FloatArray
from tests.clock_oracle import earliest_arrival, tighten
from tests.strategies import SIZE, Scene, random_islands

PERIODS = (0.5, 1.0, 3.0)
"""Periods of the currents, in voyages of about 200 s."""

# Time (s) of a voyage, about; number of times at which a current is sampled in one period.
_VOYAGE_S, _SAMPLES = 230.0, 48
# Stencil of the oracle's grid.
_RADIUS = 7


@dataclass(frozen=True)
class MovingScene(Scene[renew.CurrentField]):
    """A scene with an oracle that runs the clock."""

    def oracle(self, spacing: float = 2.0) -> float:
        """Least fuel by a grid (m) and string pulling, with the clock running."""
        own: dict[str, Any] = {"drift": self.drift, "spacing": spacing}
        _, path = earliest_arrival(*self.asked, self.departure, radius=_RADIUS, **own)
        water = self.chart, self.current, self.vessel
        least, _ = tighten(path, *water, self.departure, width=2 * spacing, **own)
        return least


@dataclass(frozen=True)
class Reversing:
    """A steady field times the cosine of the time: all of it turns round together."""

    field: renew.CurrentField
    period: float
    phase: float

    def __call__(self, points: FloatArray, times: FloatArray) -> FloatArray:
        """Velocity (..., 2), m/s, at points (..., 2) and times (...)."""
        swing = np.cos(2 * np.pi * np.asarray(times) / self.period + self.phase)
        return self.field(points) * swing[..., None]


class Drifting:
    """Stream functions whose waves run: a divergence-free current with eddies that move."""

    def __init__(self, seed: int, peak: float, period: float) -> None:
        rng = np.random.default_rng([seed, 7])
        self._wave = rng.normal(0, 2 * np.pi / 150, (6, 2))
        self._phase = rng.uniform(0, 2 * np.pi, 6)
        self._omega = 2 * np.pi / period * rng.choice([-1, 1, 0.5, -0.5], 6)
        self._scale = 1.0
        axis = np.linspace(0, SIZE, 41)
        nodes = np.stack(np.meshgrid(axis, axis), axis=-1)
        strongest = max(
            np.linalg.norm(self(nodes, np.full(nodes.shape[:-1], t)), axis=-1).max()
            for t in np.linspace(0, 2 * period, 12)
        )
        self._scale = peak / float(strongest)

    def __call__(self, points: FloatArray, times: FloatArray) -> FloatArray:
        """Velocity (..., 2), m/s, at points (..., 2) and times (...)."""
        angle = points @ self._wave.T + self._phase + np.asarray(times)[..., None] * self._omega
        slope = np.cos(angle)
        return self._scale * np.stack(
            [slope @ self._wave[:, 1], -(slope @ self._wave[:, 0])], axis=-1
        )


def moving_scene(seed: int, strongest: float = 0.7) -> MovingScene:
    """A seeded scene: which current, which period and which drift model follow from the seed."""
    rng = np.random.default_rng([seed, 11])
    period = PERIODS[seed % 3] * _VOYAGE_S
    drift: Literal["projected", "crab"] = "crab" if (seed // 3) % 2 else "projected"
    peak = float(rng.uniform(0.6, 1.0)) * strongest
    kind = ("swinging", "reversing", "drifting")[(seed // 2) % 3]
    start, goal = np.full(2, 0.05 * SIZE), np.full(2, 0.95 * SIZE)
    land = random_islands(seed, 7) if kind == "drifting" else random_islands(seed, 2)
    current: renew.CurrentField
    if kind == "swinging":
        current = renew.SwingingGyre(peak / (3 * math.pi), SIZE, SIZE, 0.25, 2 * math.pi / period)
    else:
        times = np.arange(0.0, 4 * _VOYAGE_S, period / _SAMPLES)
        gyre = renew.GyreCurrent(peak, SIZE, SIZE)
        function = (
            Reversing(gyre, period, float(rng.uniform(0, 2 * math.pi)))
            if kind == "reversing"
            else Drifting(seed, peak, period)
        )
        current = renew.VaryingCurrent(times, function)
    return MovingScene(
        renew.Chart(box(0, 0, SIZE, SIZE), land),
        current,
        start,
        goal,
        drift,
        float(rng.uniform(0, period)),
    )
