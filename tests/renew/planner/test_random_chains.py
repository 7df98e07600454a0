"""The paper's random chains: a point on each passing edge, and none of them in the padding."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from renew.planner.sampled_paths import random_chains
from tests.renew.paths.corridors import corridor_in_scene


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
