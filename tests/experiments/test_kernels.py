"""Compiled primitives of the baselines against OMPL, shapely and SciPy."""

import itertools
import math
import os
from types import FunctionType
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st
from scipy.integrate import quad

import renew
from experiments.kernels import dubins
from experiments.kernels.leg_time import LegTimes, leg_time
from experiments.kernels.water import PaddedWater, leg_clear
from tests.commands import PYTHON, ran
from tests.conftest import ROOT
from tests.experiments.scenes import CURRENT, VESSEL, islands_voyage
from tests.strategies import examples

base = pytest.importorskip("ompl.base")

RADIUS = 1.64
coordinates = st.floats(-20, 20)
poses = st.tuples(coordinates, coordinates, st.floats(-math.pi, math.pi))


def interpreted() -> dict[str, Any]:
    """Give the functions of Dubins paths as Python runs them: to compile them takes seconds."""
    names = dict(vars(dubins))
    for name, made in vars(dubins).items():
        if hasattr(made, "py_func"):
            names[name] = FunctionType(made.py_func.__code__, names)
    return names


FUNCTIONS = pytest.mark.parametrize(
    "functions", [interpreted(), pytest.param(vars(dubins), marks=pytest.mark.slow)]
)


@FUNCTIONS
@examples(10, 100)
@given(one=poses, other=poses)
def test_dubins_paths_are_as_long_as_ompls(
    functions: dict[str, Any], one: tuple[float, float, float], other: tuple[float, float, float]
) -> None:
    space = base.DubinsStateSpace(RADIUS)
    bounds = base.RealVectorBounds(2)
    bounds.setLow(-50)
    bounds.setHigh(50)
    space.setBounds(bounds)
    states = [space.allocState(), space.allocState()]
    for state, (x, y, heading) in zip(states, (one, other), strict=True):
        state.setX(x)
        state.setY(y)
        state.setYaw(heading)
    ours = functions["dubins_length"](np.array(one), np.array(other), RADIUS)
    # Where two words tie, or the poses coincide, rounding may add a full circle to either.
    circle = 2 * math.pi * RADIUS
    difference = abs(ours - space.distance(*states))
    assert min(difference, abs(difference - circle)) < 1e-4


@FUNCTIONS
@examples(10, 100)
@given(one=poses, other=poses)
def test_a_dubins_path_joins_its_poses_and_turns_no_tighter_than_its_radius(
    functions: dict[str, Any], one: tuple[float, float, float], other: tuple[float, float, float]
) -> None:
    path = functions["dubins_path"](np.array(one), np.array(other), RADIUS)
    np.testing.assert_allclose(path[[0, -1]], [one[:2], other[:2]], atol=1e-9)
    legs = np.diff(path, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    assert lengths.sum() == pytest.approx(
        functions["dubins_length"](np.array(one), np.array(other), RADIUS), rel=2e-3, abs=1e-6
    )


@pytest.mark.parametrize("padding", [0.0, 3.0])
def test_legs_are_clear_where_shapely_says_so(padding: float) -> None:
    voyage = islands_voyage()
    water = PaddedWater.of(voyage.chart, padding)
    land = shapely.union_all(list(voyage.chart.no_go))
    grown = land.buffer(padding, quad_segs=512) if padding else land
    rng = np.random.default_rng(0)
    points = rng.uniform(0.5, 59.5, (4000, 2))
    inside = ~shapely.intersects_xy(grown, points[:, 0], points[:, 1])
    np.testing.assert_array_equal(water.holds(points), inside)
    free = points[inside]
    a, b = free[:-1], free[1:]
    legs = shapely.linestrings(np.stack([a, b], axis=1))
    apart = shapely.distance(legs, grown)
    clear = water.clear(a, b)
    # Within the error of shapely's chords nothing is asked.
    sure = (apart > 0) | (shapely.length(shapely.intersection(legs, grown)) > 0.05)
    np.testing.assert_array_equal(clear[sure], apart[sure] > 0)
    assert 100 < clear.sum() < len(clear) - 100


def test_listed_edges_are_padded_and_all_others_bare() -> None:
    voyage = islands_voyage()
    padded = np.array([(36.0, 34.0, 36.0, 46.0, 5.0), (36.0, 46.0, 44.0, 46.0, 0.0)])
    water = PaddedWater.of(voyage.chart, padded)
    held = water.holds(np.array([(32.0, 40.0), (43.0, 47.0), (40.0, 40.0), (30.0, 40.0)]))
    np.testing.assert_array_equal(held, [False, True, False, True])


def test_no_padding_reaches_start_or_goal() -> None:
    voyage = islands_voyage()
    # 2 m off the square's west side, and far off everything.
    ends = np.array([(34.0, 40.0), (6.0, 7.0)])
    around = np.array([(34.0, 40.0), (35.0, 40.0), (40.0, 48.0), (40.0, 49.5)])
    padded = PaddedWater.of(voyage.chart, 3.0, ends)
    np.testing.assert_array_equal(padded.holds(around), [True, False, False, True])
    assert not PaddedWater.of(voyage.chart, 3.0).holds(around[:1]).any()


def test_the_time_of_a_leg_is_its_integral() -> None:
    voyage = islands_voyage()
    legs = LegTimes.of(voyage.chart, CURRENT, VESSEL)
    a, b = np.array([5.0, 9.0]), np.array([51.0, 40.0])
    tangent = (b - a) / np.linalg.norm(b - a)

    def slowness(place: float) -> float:
        return float(1 / (1 + CURRENT(a + place * (b - a)) @ tangent))

    exact = quad(slowness, 0, 1)[0] * np.linalg.norm(b - a)
    there, back = leg_time(5.0, 9.0, 51.0, 40.0, legs), leg_time(51.0, 40.0, 5.0, 9.0, legs)
    assert there == pytest.approx(exact, rel=1e-4)
    assert there != pytest.approx(back, rel=0.1)


def test_water_that_overpowers_the_vessel_is_impassable() -> None:
    voyage = islands_voyage()
    strong = LegTimes.of(voyage.chart, renew.UniformCurrent(1.1, 0.0), VESSEL)
    assert leg_time(5.0, 5.0, 50.0, 5.0, strong) == math.inf


def test_ompl_calls_the_compiled_functions_and_counts_each_call() -> None:
    """Through OMPL itself, between places in the water, on land and in padding."""
    from experiments.baselines.spaces import Space, fuel_objective

    voyage = islands_voyage()
    space = Space(PaddedWater.of(voyage.chart, 3.0))
    objective = fuel_objective(space, CURRENT, VESSEL)
    legs = LegTimes.of(voyage.chart, CURRENT, VESSEL)
    fastest = VESSEL.speed + legs.table.strongest
    places = np.random.default_rng(5).uniform(1, 59, (60, 2))
    for calls, (one, other) in enumerate(itertools.pairwise(places)):
        states = space.state(one), space.state(other)
        (ax, ay), (bx, by) = one, other
        assert space.calls.count.item() == 3 * calls
        is_clear = leg_clear(ax, ay, bx, by, space.water.buckets)
        assert space.information.checkMotion(*states) == is_clear
        seconds = leg_time(ax, ay, bx, by, legs)
        assert objective.motionCost(*states).value() == seconds
        least = objective.motionCostHeuristic(*states).value()
        assert least == math.dist(one, other) / fastest <= seconds
    assert not objective.isSymmetric()


def test_an_object_of_another_class_than_expected_is_refused() -> None:
    from experiments.baselines.spaces import Space
    from experiments.baselines.virtual import never, override

    information = Space(PaddedWater.of(islands_voyage().chart)).information
    with pytest.raises(RuntimeError, match=r"requirements\.lock"):
        override(information, "DiscreteMotionValidator", {}, ())
    with pytest.raises(RuntimeError, match="undefined symbol"):
        override(information.getMotionValidator(), "DiscreteMotionValidator", {"_Znone": never}, ())


@pytest.mark.slow
def test_a_process_that_has_replaced_functions_ends_well() -> None:
    """Memory that is freed is overwritten here: OMPL must not look for its functions there."""
    script = (
        "from experiments.baselines.spaces import Space, fuel_objective\n"
        "from experiments.kernels.water import PaddedWater\n"
        "from tests.experiments.scenes import CURRENT, VESSEL, islands_voyage\n"
        "space = Space(PaddedWater.of(islands_voyage().chart))\n"
        "objective = fuel_objective(space, CURRENT, VESSEL)\n"
    )
    ran(*PYTHON, script, cwd=ROOT, env=os.environ | {"MALLOC_PERTURB_": "165"})
