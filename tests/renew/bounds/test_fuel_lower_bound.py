"""The lower bound on fuel: each condition of its proof, then the bound against real paths."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st
from shapely import Polygon, box

import renew
from renew._types import FloatArray
from renew.bounds.fuel_lower_bound import Front, fuel_lower_bound
from renew.bounds.grids import wet_cells, whole_grid
from renew.bounds.march import projected_rate, set_bends
from renew.inputs.options import Drift
from renew.voyage.fuel import ground_speed
from renew.voyage.voyage import Voyage, Waters
from tests.compiler import uncompiled
from tests.renew.bounds.test_grids import CORNER, FIELDS, OPPOSITE
from tests.strategies import (
    PAPER_VESSEL,
    STILL,
    examples,
    random_scene,
    seeds,
    single_gyre,
    voyage_on,
)

CELLS = 16_000
"""Number of cells of a grid that is looked at cell by cell."""

DRIFTS: tuple[Drift, Drift] = ("projected", "crab")


def lower_bound(
    chart: renew.Chart,
    current: renew.CurrentField,
    vessel: renew.Vessel,
    start: FloatArray,
    goal: FloatArray,
    drift: Drift = "projected",
) -> float:
    return fuel_lower_bound(Voyage(Waters(chart, current), vessel, start, goal, drift))


# --- the grid and its rounds ------------------------------------------------------------------


@given(seeds, st.integers(4, 60))
@settings(max_examples=20)
def test_cells_are_wet_that_meet_water(seed: int, count: int) -> None:
    chart = random_scene(seed).chart
    xmin, ymin, xmax, ymax = chart.bounds
    x, y = np.linspace(xmin, xmax, count + 1), np.linspace(ymin, ymax, count + 3)
    # One by one; shrunk by the same sliver.
    sliver = 10 * chart.precision
    west, south = np.meshgrid(x[:-1] + sliver, y[:-1] + sliver)
    east, north = np.meshgrid(x[1:] - sliver, y[1:] - sliver)
    expected = shapely.intersects(shapely.box(west, south, east, north), chart.open_water)
    assert np.array_equal(wet_cells(chart, x, y), expected)
    some = np.random.default_rng(seed).random(expected.shape) < 0.5
    assert np.array_equal(wet_cells(chart, x, y, some), expected & some)


def test_a_bound_that_is_enough_is_made_no_better() -> None:
    voyage = random_scene(4).voyage
    best = fuel_lower_bound(voyage)
    first = fuel_lower_bound(voyage, enough=0.5 * best)
    assert 0.5 * best < first < best
    assert fuel_lower_bound(voyage, enough=2 * best) == best


@given(st.floats(0, 1.5), st.floats(-math.pi, math.pi), st.sampled_from(DRIFTS))
@settings(max_examples=20)
def test_a_uniform_current_in_free_water_is_bounded_by_the_best_linear_function(
    strength: float, towards: float, drift: Drift
) -> None:
    angles = np.linspace(-math.pi, math.pi, 4001)
    headings = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    flow = strength * np.array([math.cos(towards), math.sin(towards)])
    made = 1 + headings @ flow
    over_ground = headings + flow if drift == "crab" else (made[:, None] * headings)[made > 0]
    # A linear function whose slope is n/s, with s the largest speed over ground along n.
    slopes = headings / (headings @ over_ground[::4].T).max(axis=1)[:, None].clip(1e-9)
    expected = (slopes @ (OPPOSITE - CORNER)).max()
    current = renew.UniformCurrent(*flow)
    voyage = voyage_on(renew.Chart(box(0, 0, 100, 100), []), CORNER, OPPOSITE, current, drift)
    bound = fuel_lower_bound(voyage, enough=0.0) / voyage.cost_rate
    assert bound <= expected * (1 + 5e-3)
    # No route leads up a current that is stronger than the vessel: any bound is right.
    assert bound >= expected * (1 - 5e-3) or strength > 0.97


# --- the conditions of the proof --------------------------------------------------------------


@pytest.mark.gate_share(6)
@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize("name", FIELDS)
def test_no_direction_at_any_place_breaks_the_inequality(name: str, drift: Drift) -> None:
    field, rng = FIELDS[name], np.random.default_rng(5)
    chart = renew.Chart(box(0, 0, 100, 100), [box(40, 30, 70, 60)])
    grid = whole_grid(voyage_on(chart, CORNER, OPPOSITE, field, drift), CELLS)
    front = Front(grid, CORNER, OPPOSITE)
    for _ in range(2):
        front.advance(grid.wet)
        front.relax()
    front.advance(grid.wet)
    time, rate = front.rise.time, front.rates
    angle = np.linspace(0, 2 * np.pi, 180, endpoint=False)
    tangents = np.column_stack([np.cos(angle), np.sin(angle)])
    shares = rng.dirichlet(np.ones(3), 12)
    tight = 0
    for row, column in rng.permutation(np.argwhere(rate > 0))[:300]:
        x, y = grid.x[column : column + 2], grid.y[row : row + 2]
        bends = np.empty(6)
        set_bends(bends, time, grid.wet, row, column)
        worst = []
        for falling in (False, True):
            largest = 0.0
            for north in (0, 1):
                east = north if falling else 1 - north
                at = np.array([[north, east], [north, 1 - east], [1 - north, east]])
                corners = np.stack([x[at[:, 1]], y[at[:, 0]]], axis=1)
                u = time[row + at[:, 0], column + at[:, 1]]
                # Bernstein's form: on each side the mean of its ends and its bend.
                bend = np.zeros((3, 3))
                bend[0, 1], bend[0, 2], bend[1, 2] = bends[[north, 2 + east, 4 + falling]]
                slope_of_shares = np.linalg.inv(np.vstack([corners.T, np.ones(3)]))[:, :2]
                gradient = (u + 2 * shares @ (bend + bend.T)) @ slope_of_shares
                speed = ground_speed(field(shares @ corners)[:, None], tangents, 1.0, drift)
                growth = gradient @ tangents.T * np.where(speed > 0, speed, 0.0)
                largest = max(largest, float(growth.max()))
            worst.append(largest)
        assert min(worst) <= rate[row, column] * (1 + 1e-9)
        tight += min(worst) > 0.9 * rate[row, column]
    assert tight > 150  # and the ratio isn't just large


@given(st.tuples(*[st.integers(-2000, 2000).map(lambda n: n / 1000)] * 4), st.booleans())
def test_the_rate_is_the_largest_over_the_circle(
    vectors: tuple[float, float, float, float], compiled: bool
) -> None:
    px, py, cx, cy = vectors
    rate = projected_rate if compiled else uncompiled(projected_rate)
    angle = np.linspace(0, 2 * np.pi, 20_000)
    x, y = np.cos(angle), np.sin(angle)
    largest = float(((px * x + py * y) * (1 + cx * x + cy * y)).max())
    # Where the current nearly cancels the speed through water, a relative tolerance is too tight.
    slack = 0.005 * float(np.hypot(px, py)) * (1 + float(np.hypot(cx, cy)))
    assert largest * (1 - 1e-12) <= rate(px, py, cx, cy, 1.0) <= largest * 1.01 + slack + 1e-12


# --- the bound where the least fuel is known --------------------------------------------------


@pytest.mark.gate_share(4)
@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize("goal", [(95.0, 90.0), (12.0, 95.0), (93.5, 10.0), (99.0, 0.1)])
def test_still_water_takes_the_straight_line(goal: tuple[float, float], drift: Drift) -> None:
    chart = renew.Chart(box(0, 0, 100, 100))
    straight = math.dist(CORNER, goal)
    bound = lower_bound(chart, STILL, PAPER_VESSEL, CORNER, np.array(goal), drift)
    assert 0.995 * straight <= bound <= straight


def test_the_shortest_way_round_a_corner() -> None:
    extent = Polygon([(0, 0), (100, 0), (100, 30), (30, 30), (30, 100), (0, 100)])
    shortest = 2 * math.hypot(60, 20)
    endpoints = np.array([10.0, 90.0]), np.array([90.0, 10.0])
    for chart in (
        renew.Chart(extent),
        renew.Chart(box(0, 0, 100, 100), [box(30, 30, 100, 100)]),  # land meets the extent
    ):
        assert 0.98 * shortest <= lower_bound(chart, STILL, PAPER_VESSEL, *endpoints) <= shortest


@pytest.mark.slow
def test_it_speaks_of_the_land_alone_where_the_no_go_zone_is_more() -> None:
    islands = [box(30, 20, 70, 60)]
    grown = [island.buffer(12, join_style="mitre") for island in islands]
    extent, start, goal = box(0, 0, 100, 100), np.array([10.0, 40.0]), np.array([95.0, 41.0])
    least = [
        lower_bound(renew.Chart(extent, no_go, land=land), STILL, PAPER_VESSEL, start, goal)
        for no_go, land in ((islands, None), (grown, islands), (grown, None), (islands, grown))
    ]
    assert least[1] == least[0] < least[2]
    # Land beyond the no-go zone does not count: routes may cross it.
    assert least[3] == least[0]


def test_it_is_infinite_where_no_water_leads_to_the_goal() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(45, -1, 55, 101)])
    assert lower_bound(chart, STILL, PAPER_VESSEL, CORNER, OPPOSITE) == math.inf


def test_it_holds_at_true_scale_for_another_fuel_law() -> None:
    chart = renew.Chart(box(-3e5, -1e5, 3e5, 3e5), [box(-1e5, -1e5, 1e5, 1e5)])
    vessel = renew.Vessel(5.0, 0.03, fuel_coefficient=2.0, fuel_exponent=3.0)
    endpoints = np.array([-2e5, 0.0]), np.array([2e5, 0.0])
    fuel = 2 * 5.0**3 * (2 * math.hypot(1e5, 1e5) + 2e5) / 5.0
    assert 0.98 * fuel <= lower_bound(chart, STILL, vessel, *endpoints) <= fuel


def test_it_holds_in_a_narrow_extent() -> None:
    chart = renew.Chart(box(0, 0, 1000, 2))
    endpoints = np.array([1.0, 1.0]), np.array([999.0, 1.9])
    assert 0.99 * 998 <= lower_bound(chart, STILL, PAPER_VESSEL, *endpoints) <= 998.01


def test_an_extremely_long_extent_has_no_larger_grid() -> None:
    chart = renew.Chart(box(0, 0, 3e6, 1))
    grid = whole_grid(voyage_on(chart, (10.0, 0.5), (2.9e6, 0.5)), CELLS)
    assert grid.wet.size < 250_000
    assert grid.y.size > 4


# --- the bound and paths ----------------------------------------------------------------------


@pytest.mark.parametrize(("drift", "best"), [("projected", 84.42), ("crab", 86.0)])
def test_it_is_within_three_percent_on_the_single_gyre(drift: Drift, best: float) -> None:
    bound = lower_bound(*single_gyre().asked, drift)
    assert best / bound - 1 < 0.03
    assert bound < 84.2 if drift == "projected" else bound < 85.84


@examples(4, 30)
@given(seeds, st.sampled_from(DRIFTS), st.floats(0.1, 1.3))
def test_no_path_needs_less(seed: int, drift: Drift, peak: float) -> None:
    chart, current, start, goal = random_scene(seed, peak).parts
    bound = lower_bound(chart, current, PAPER_VESSEL, start, goal, drift)
    assert bound > 0
    rng = np.random.default_rng(seed)
    paths = [np.array([start, goal])]
    for count in rng.integers(1, 7, 40):
        along = np.linspace(start, goal, count + 2)[1:-1]
        bends = along + rng.normal(0, rng.uniform(5, 50), along.shape)
        paths.append(np.array([start, *np.clip(bends, 0, 200), goal]))
    free = [p for p in paths if not shapely.intersects(shapely.LineString(p), chart.hard_no_go)]
    fuels = [renew.fuel(path, current, PAPER_VESSEL, drift=drift) for path in free]
    assert all(bound <= fuel for fuel in fuels)


@pytest.mark.slow
@examples(2, 6)
@given(seeds, st.sampled_from(DRIFTS))
def test_the_way_back_in_the_reversed_current_has_the_same_bound(seed: int, drift: Drift) -> None:
    scene = random_scene(seed, 0.6)

    class Reversed(renew.CurrentField):
        def __call__(self, points: FloatArray) -> FloatArray:
            return -scene.current(points)

    there = lower_bound(*scene.asked, drift)
    back = lower_bound(scene.chart, Reversed(), PAPER_VESSEL, scene.goal, scene.start, drift)
    assert there == pytest.approx(back, rel=0.02)
