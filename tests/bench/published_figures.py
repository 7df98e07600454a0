"""The paper's scenes by the default method: the figures of the paper map."""

from collections.abc import Iterator
from functools import partial
from unittest import mock

import numpy as np

import renew
from renew._types import FloatArray
from renew.classes import triangulation
from renew.classes.class_enumerator import ClassEnumerator
from renew.classes.h_signature import Rays
from renew.classes.triangulation import _by_shapely, _by_triangle, triangulate
from renew.inputs import current as current_module
from renew.inputs.options import PlanOptions
from renew.turns import turn_reach
from renew.turns.padding_model import PaddingModel
from renew.turns.turn_reach import TurnSampler
from tests.bench.figure import Figure, quoted
from tests.published import ABLATION, FOUR_GYRE, GYRE
from tests.renew.turns.test_padding_model import always
from tests.renew.turns.test_turn_reach import TURNS
from tests.renew.turns.test_verification import shares_that_touch
from tests.strategies import PAPER_VESSEL, random_scene, voyage_on

SCENES = range(20)
"""Seeds of the random scenes."""
PEAK_M_S = 0.85
"""Strongest current of the scenes in which turns are drawn from single points, m/s."""
_DRAWS, _DENSE_DRAWS, _REPEATS = 512, 1_000_000, 200
_RISK = 0.05
# Rows of the lattice of points in a triangle, and of one that is dense.
_LATTICE, _DENSE_LATTICE = 8, 80


def scenes() -> Iterator[Figure]:
    """4-gyre and the ablation, as the paper's table has them."""
    four = FOUR_GYRE.plan().best
    yield _row("4-gyre", "four_gyre", four)
    flown = renew.contingency(four, FOUR_GYRE.chart, FOUR_GYRE.current, PAPER_VESSEL)
    yield quoted(
        "4-gyre, turns", four_gyre_collisions=flown.collisions, four_gyre_turns=flown.trials
    )
    for classes in (1, 4, 16):
        fuel = FOUR_GYRE.plan(classes=classes, order="depth-first").best.fuel
        name = f"4-gyre, best of the first {classes} classes of a depth-first search"
        yield quoted(name, **{f"four_gyre_depth_first_{classes}": fuel})
    for scene in ABLATION:
        best = scene.plan().best
        yield _row(scene.name, scene.name.replace(" ", "_"), best)
        if scene is ABLATION[-1]:
            bound = best.fuel / (1 + best.optimality_gap)
            yield quoted(f"{scene.name}, bound", ablation_d_bound=bound)


def _row(name: str, key: str, route: renew.Route) -> Figure:
    """Figures of a route, as the paper gives them."""
    values = {
        "fuel": route.fuel,
        "length": route.length,
        "fuel_per_distance": route.fuel_per_distance,
        "clearance": route.clearance,
    }
    return quoted(name, **{f"{key}_{what}": value for what, value in values.items()})


def paddings() -> Iterator[Figure]:
    """What the paddings rest on: draws, the lattice, and turns from single points."""
    even, chance = _quantile_errors()
    yield quoted("error of the quantile, 512 draws, %", even_draws=even, random_draws=chance)
    wider = _wider_on_the_lattice()
    yield quoted(
        "paddings beside those on a dense lattice, %",
        lattice_median=float(np.median(wider)),
        lattice_least=float(wider.min()),
        lattice_most=float(wider.max()),
    )
    yield quoted("turns that reach land from a single point, %", from_a_point=_from_a_point())


def triangulators() -> Iterator[Figure]:
    """By how much the best fuel as triangulated by GEOS is above that by Triangle."""
    off = []
    for seed in SCENES:
        both = []
        for corners in (partial(_by_triangle, precision=1e-9), _by_shapely):
            with mock.patch.object(triangulation, "_by_shapely", corners):
                both.append(random_scene(seed).plan().best.fuel)
        off.append(both[1] / both[0] - 1)
    name = f"GEOS above Triangle at most, {len(SCENES)} random scenes, %"
    yield quoted(name, geos_beside_triangle=round(100 * max(off), 4))


def _quantile_errors() -> tuple[float, float]:
    """Root mean square errors of the quantile, %, of even and of random draws."""
    true = np.quantile(TurnSampler(0, _DENSE_DRAWS).reaches(TURNS), 1 - _RISK, axis=1)

    def error() -> float:
        found = [
            np.quantile(TurnSampler(seed, _DRAWS).reaches(TURNS), 1 - _RISK, axis=1)
            for seed in range(_REPEATS)
        ]
        return float(100 * np.sqrt(np.mean((np.array(found) / true - 1) ** 2)))

    def by_chance(seed: int, count: int) -> FloatArray:
        return np.random.default_rng(seed).random((3, count))

    even = error()
    with mock.patch.object(turn_reach, "_even_draws", by_chance):
        return even, error()


def _wider_on_the_lattice() -> FloatArray:
    """By how much paddings of the single gyre are wider than on a lattice of more points, %."""
    triangulation, options = triangulate(GYRE.chart), PlanOptions(risk=_RISK)
    ends = np.array(GYRE.start), np.array(GYRE.goal)
    enumerator = ClassEnumerator.of(
        voyage_on(GYRE.chart, *ends), triangulation, Rays.of(GYRE.chart), "length"
    )
    channels = enumerator.channels(4)
    widths = []
    for rows in (_LATTICE, _DENSE_LATTICE):
        with mock.patch.object(current_module, "_LATTICE_ROWS", rows):
            model = PaddingModel(triangulation, GYRE.current, PAPER_VESSEL, options)
            widths.append(
                np.concatenate(
                    [model.padded_edges(one, *ends, always(one)).padding for one in channels]
                )
            )
    return np.asarray(100 * (widths[0] / widths[1] - 1))


def _from_a_point() -> float:
    """Largest share of drawn turns that reach land from a point of a route, %."""
    largest = 0.0
    for seed in SCENES:
        scene = random_scene(seed, PEAK_M_S)
        plan = scene.plan(classes=4, risk=_RISK)
        for route in plan.routes:
            shares = shares_that_touch(route, scene.chart, scene.current)
            largest = max(largest, float(shares.max(initial=0.0)))
    return 100 * largest
