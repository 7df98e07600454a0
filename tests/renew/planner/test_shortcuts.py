"""Shortened chains: clear of V, in their class, and never slower than what they came from."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import box

import renew
from renew.classes.h_signature import Rays
from renew.errors import InfeasibleError
from renew.planner.sampled_paths import each_shortened, random_chains, with_shortcuts
from tests.renew.paths.corridors import corridor_in_scene, corridor_of
from tests.strategies import voyage_on


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
    assert not each_shortened(corridor, Rays.of(chart), straight[None]).paths
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
