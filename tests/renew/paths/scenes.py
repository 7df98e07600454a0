"""Corridors padded as a plan would pad them, and waters in which paths are refined."""

import math
from functools import cache

import numpy as np
import shapely

from renew._types import FloatArray
from renew.inputs.options import Padding, PlanOptions
from renew.kernels.capsules import Capsules
from renew.kernels.current_table import STILL_WATER
from renew.kernels.ground_speed import Polar
from renew.kernels.viterbi import Clock, Stream
from renew.paths.corridor import Corridor
from renew.paths.sections import WaterAround
from renew.planner.one_class import ClassPlanner
from renew.planner.problem import Problem
from renew.voyage.voyage import Voyage
from tests.strategies import SIZE, StreamFunctionCurrent, random_scene


@cache
def corridor_in_scene(seed: int, padding: Padding = "adaptive") -> Corridor:
    """Corridor of the first class in a random scene."""
    return corridor_of(random_scene(seed).voyage, padding)


def corridor_of(voyage: Voyage, padding: Padding = "adaptive", *, place: int = 0) -> Corridor:
    """Corridor of a class of a voyage, by its place in the order of fuel."""
    options = PlanOptions(padding=padding)
    problem = Problem(voyage, options)
    channel = problem.enumerator(0.0).channels(place + 1)[place]
    return ClassPlanner(problem).corridor(channel)


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
