"""The soft no-go zone as padded edges: which ones hold a point, and how they grow."""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import given, settings

from renew.turns.soft_no_go import PaddedEdges
from tests.strategies import seeds


def padded_edges(seed: int) -> PaddedEdges:
    """Twelve edges, by numbers that are not in order."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(0, 10, (12, 2))
    end = start + rng.normal(0, 2, (12, 2))
    return PaddedEdges(start, end, rng.uniform(0, 3, 12), rng.permutation(30)[:12])


@settings(max_examples=20)
@given(seed=seeds)
def test_the_edges_around_a_point_are_those_whose_buffer_holds_it(seed: int) -> None:
    padded = padded_edges(seed)
    point = np.random.default_rng(seed).uniform(0, 10, 2)
    lines = shapely.linestrings(np.stack([padded.start, padded.end], axis=1))
    holding = shapely.distance(lines, shapely.Point(point)) < padded.padding
    assert padded.around(point).edge.tolist() == padded.edge[holding].tolist()


def test_an_edge_that_is_named_twice_grows_by_the_larger_figure() -> None:
    padded = padded_edges(0)
    one, other = padded.edge[[7, 2]]
    grown = padded.grown(np.array([one, other, one]), np.array([0.5, 2.0, 1.5]))
    expected = padded.padding.copy()
    expected[[7, 2]] += [1.5, 2.0]
    assert grown.padding.tolist() == expected.tolist()
    assert grown.edge.tolist() == padded.edge.tolist()
