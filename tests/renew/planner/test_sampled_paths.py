"""The paper's random chains: in free water, shortened in their class, and the class they choose."""

import statistics
from collections.abc import Sequence
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st
from shapely import box

import renew
from renew.classes.h_signature import Rays
from renew.errors import InfeasibleError
from renew.planner.sampled_paths import (
    chosen_class,
    each_shortened,
    harmonic_mean,
    random_chains,
    with_shortcuts,
)
from tests.renew.paths.scenes import corridor_in_scene, corridor_of
from tests.strategies import random_scene, voyage_on


@pytest.mark.parametrize("scene", [0, 1, 2])
def test_chains_cross_each_passing_edge_and_no_point_lies_in_the_padding(scene: int) -> None:
    corridor = corridor_in_scene(scene, 2.0)
    chains = random_chains(corridor, 200, np.random.default_rng(0))
    channel, padded = corridor.channel, corridor.padded
    assert chains.shape == (200, len(channel.left) + 2, 2)
    assert (chains[:, 0] == corridor.voyage.start).all()
    assert (chains[:, -1] == corridor.voyage.goal).all()
    edges = shapely.linestrings(np.stack([channel.left, channel.right], axis=1))
    points = shapely.points(chains[:, 1:-1])
    assert shapely.distance(points, edges).max() < 1e-9
    land = shapely.linestrings(np.stack([padded.start, padded.end], axis=1))
    assert (shapely.distance(points[..., None], land) >= padded.padding).all()
    # Another seed gives other chains, the same seed the same.
    again, other = (random_chains(corridor, 200, np.random.default_rng(seed)) for seed in (0, 1))
    assert (again == chains).all()
    assert (other != chains).any()


@pytest.mark.parametrize("scene", [0, 1, 3])
def test_a_shortened_chain_is_clear_in_its_class_and_no_slower(scene: int) -> None:
    corridor = corridor_in_scene(scene, "none")
    voyage, rays = corridor.voyage, Rays.of(corridor.voyage.chart)
    chains = random_chains(corridor, 100, np.random.default_rng(scene))
    clear = np.array([corridor.legs_clear(chain).all() for chain in chains])
    paths, times = each_shortened(corridor, rays, chains)
    assert clear.sum() <= len(paths) <= len(chains)
    for path in (*paths, with_shortcuts(corridor, rays, paths[int(times.argmin())])):
        assert corridor.legs_clear(path).all()
        assert rays.word(path) == corridor.channel.word
        assert path[[0, -1]].tolist() == [voyage.start.tolist(), voyage.goal.tolist()]
    fuels = np.array([voyage.fuel(path) for path in paths])
    assert voyage.vessel.fuel_rate * times == pytest.approx(fuels, rel=1e-2)
    # Also for each chain by itself: if it is clear, it is among the results.
    alone, _ = each_shortened(corridor, rays, chains[clear])
    for chain, path in zip(chains[clear], alone, strict=True):
        assert voyage.fuel(path) <= voyage.fuel(chain) * (1 + 1e-2)


def test_a_shortcut_keeps_to_its_side_of_an_island_and_past_land_that_its_chain_crosses() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(45, 45, 55, 55)])
    voyage = voyage_on(chart, (10.0, 50.0), (90.0, 50.0))
    corridor, rays = corridor_of(voyage, "none"), Rays.of(chart)
    for side in (1, -1):
        # Far around the island, and then through its corner, which a shortcut passes.
        bent = [[10, 50], [30, 50 + 40 * side], [49, 50 + 7 * side], [56, 54.9], [90, 50]]
        chain = np.array([bent, bent], dtype=float)
        chain[1, 3] = 70, 50 + 30 * side
        paths, _ = each_shortened(corridor, rays, chain)
        assert len(paths) == 2
        for path in paths:
            assert rays.word(path) == rays.word(chain[1])
            assert shapely.LineString(path).length < shapely.LineString(chain[1]).length


def test_a_path_whose_every_way_crosses_land_has_none() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(45, 45, 55, 55)])
    corridor = corridor_of(voyage_on(chart, (10.0, 50.0), (90.0, 50.0)), "none")
    straight = np.array([[10.0, 50.0], [90.0, 50.0]])
    assert not each_shortened(corridor, Rays.of(chart), straight[None])[0]
    with pytest.raises(InfeasibleError, match="no legs between places"):
        with_shortcuts(corridor, Rays.of(chart), straight)


def test_in_still_water_a_zigzag_around_an_island_is_drawn_taut() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(40, -1, 60, 60)])
    corridor = corridor_of(voyage_on(chart, (10.0, 30.0), (90.0, 30.0)), "none")
    zigzag = np.array(
        [[10, 30], [20, 80], [30, 65], [40, 90], [50, 62], [60, 95], [75, 70], [90, 30]]
    )
    short = with_shortcuts(corridor, Rays.of(chart), zigzag.astype(float))
    taut = 2 * np.hypot(30, 30) + 20
    assert taut <= shapely.LineString(short).length < 1.02 * taut


@given(st.lists(st.floats(0.1, 1e6), min_size=1, max_size=20))
def test_it_is_that_of_the_standard_library(fuels: list[float]) -> None:
    assert harmonic_mean(np.array(fuels)) == pytest.approx(statistics.harmonic_mean(fuels))


def test_a_path_that_cannot_be_made_counts_as_infinite_fuel() -> None:
    assert harmonic_mean(np.array([10.0, np.inf])) == pytest.approx(20)


def test_the_class_with_the_least_mean_is_chosen() -> None:
    routes = [SimpleNamespace(harmonic_mean=mean, lacking=(0, 0.0)) for mean in (5.0, 3.0, 4.0)]
    assert chosen_class(cast("Sequence[renew.Route]", routes)) == 1


@pytest.mark.parametrize(
    ("routes", "chosen"),
    [
        # (fuel, steps of a turn for which there is no room, metres of such stretches)
        ([(1.0, 1, 50.0), (1.1, 0, 0.0)], 1),  # a free way is worth a tenth more fuel
        ([(1.0, 1, 50.0), (1.3, 0, 0.0)], 0),  # but not nearly a third
        ([(1.0, 18, 2_400.0), (1.06, 18, 2_000.0)], 0),  # 400 m at the quay are not worth 20 km
        ([(1.0, 18, 2_400.0), (1.005, 18, 2_000.0)], 1),  # they are worth 1.6 km
        ([(1.0, 19, 2_000.0), (1.06, 18, 2_000.0)], 0),  # nor is a step of that share
        ([(1.0, 18, 2_000.0), (1.06, 9, 2_000.0)], 1),  # half of a turn is
    ],
)
def test_room_to_turn_is_worth_some_fuel_and_not_any(
    routes: list[tuple[float, int, float]], chosen: int
) -> None:
    made = [
        SimpleNamespace(harmonic_mean=fuel, lacking=(steps, metres), length=320_000.0 * fuel)
        for fuel, steps, metres in routes
    ]
    assert chosen_class(cast("Sequence[renew.Route]", made)) == chosen


def test_the_sampled_method_may_choose_another_class_than_that_of_the_cheapest_path() -> None:
    plan = random_scene(2).plan(padding="none", method="sampled", samples=60)
    means = [route.harmonic_mean for route in plan.routes]
    assert plan.best.harmonic_mean == min(means)
    assert all(route.harmonic_mean >= route.fuel for route in plan.routes)
