"""Waters in which paths are refined: still and open, or a current with capsules beside a path."""

from __future__ import annotations

import math

import numpy as np
import shapely

from renew._types import FloatArray
from renew.kernels.capsules import Capsules
from renew.kernels.current_table import STILL_WATER
from renew.kernels.ground_speed import Polar
from renew.kernels.viterbi import Clock, Stream
from renew.paths.sections import WaterAround
from tests.strategies import SIZE, StreamFunctionCurrent

NO_LAND = Capsules(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
AT_ONCE = Clock(0.0, math.inf)
CALM = WaterAround(Stream(STILL_WATER, Polar(1.0, crab=False), AT_ONCE), NO_LAND)
NOTHING_WHOLE = np.zeros(2, dtype=bool)


def water_beside(
    path: FloatArray, rng: np.random.Generator, seed: int, *, crab: bool
) -> WaterAround:
    """A current with up to twelve capsules, none of which touches a path (n, 2)."""
    start = rng.uniform(20, SIZE - 20, (12, 2))
    capsules = Capsules(start, start + rng.normal(0, 5, (12, 2)), rng.uniform(0.5, 3, 12))
    axes = shapely.linestrings(np.stack([capsules.start, capsules.end], axis=1))
    is_beside = shapely.distance(axes, shapely.LineString(path)) > capsules.radius
    table = StreamFunctionCurrent(seed, 0.6).table((0.0, 0.0, SIZE, SIZE))
    return WaterAround(Stream(table, Polar(1.0, crab), AT_ONCE), capsules.select(is_beside))
