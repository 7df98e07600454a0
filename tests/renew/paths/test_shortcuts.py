"""Merged and shortened chains: clear of V, in order, and never slower than what they came from."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import box

import renew
from renew.paths.random_chains import random_chains
from renew.paths.shortcuts import merged, with_shortcuts
from tests.renew.paths.corridors import corridor_in_scene, corridor_of
from tests.strategies import voyage_on


@pytest.mark.parametrize("scene", [0, 1, 3])
def test_a_merged_path_is_clear_and_no_slower_than_any_of_its_chains(scene: int) -> None:
    corridor = corridor_in_scene(scene, "none")
    fuel = corridor.voyage.fuel
    chains = random_chains(corridor, 200, np.random.default_rng(scene))
    chains = chains[np.argsort([fuel(chain) for chain in chains])[:10]]
    path = merged(corridor, chains)
    assert corridor.legs_clear(path).all()
    assert fuel(path) <= fuel(chains[0]) * (1 + 1e-3)
    short = with_shortcuts(corridor, path)
    assert corridor.legs_clear(short).all()
    assert fuel(short) <= fuel(path) * (1 + 1e-3)
    for one in (path, short):
        assert one[0].tolist() == corridor.voyage.start.tolist()
        assert one[-1].tolist() == corridor.voyage.goal.tolist()


def test_in_still_water_a_zigzag_around_an_island_is_drawn_taut() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(40, -1, 60, 60)])
    corridor = corridor_of(voyage_on(chart, (10.0, 30.0), (90.0, 30.0)), "none")
    zigzag = np.array(
        [[10, 30], [20, 80], [30, 65], [40, 90], [50, 62], [60, 95], [75, 70], [90, 30]]
    )
    short = with_shortcuts(corridor, zigzag.astype(float))
    taut = 2 * np.hypot(30, 30) + 20
    assert taut <= shapely.LineString(short).length < 1.02 * taut
