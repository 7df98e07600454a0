"""The paper's random chains: a point on each passing edge, and none of them in the padding."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import box

import renew
from renew.errors import InfeasibleError
from renew.paths.random_chains import random_chains
from tests.renew.paths.corridors import corridor_in_scene, corridor_of
from tests.strategies import voyage_on


@pytest.mark.parametrize("scene", [0, 1, 2])
def test_chains_cross_each_passing_edge_and_keep_out_of_the_padding(scene: int) -> None:
    corridor = corridor_in_scene(scene, 2.0)
    chains = random_chains(corridor, 200, np.random.default_rng(0))
    channel, padded = corridor.channel, corridor.padded
    assert 0 < len(chains) <= 200
    assert (chains[:, 0] == corridor.voyage.start).all()
    assert (chains[:, -1] == corridor.voyage.goal).all()
    edges = shapely.linestrings(np.stack([channel.left, channel.right], axis=1))
    assert shapely.distance(shapely.points(chains[:, 1:-1]), edges).max() < 1e-9
    land = shapely.linestrings(np.stack([padded.start, padded.end], axis=1))
    distance = shapely.distance(shapely.linestrings(chains)[:, None], land)
    assert (distance >= padded.padding).all()
    # Another seed gives other chains, the same seed the same.
    again, other = (random_chains(corridor, 200, np.random.default_rng(seed)) for seed in (0, 1))
    assert (again == chains).all()
    assert other.shape != chains.shape or (other != chains).any()


def test_where_every_chain_crosses_the_padding_the_class_has_none() -> None:
    # Above the tip of the wall a path must run within 5 cm of the chart's edge.
    chart = renew.Chart(box(0, 0, 100, 69), [box(49.9, 0, 50.1, 60)])
    corridor = corridor_of(voyage_on(chart, (20.0, 30.0), (80.0, 30.0)), 8.95)
    with pytest.raises(InfeasibleError, match="each of 50 sampled chains crosses"):
        random_chains(corridor, 50, np.random.default_rng(0))
