"""Bottlenecks between islands, beside a minimum spanning tree of all distances between them."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st
from scipy.sparse.csgraph import minimum_spanning_tree

from pipeline.findings.islands import narrow_gaps
from tests.strategies import examples


def discs(seed: int, count: int = 25) -> np.ndarray:
    """Return islands in a square of 100 m, some of which overlap."""
    rng = np.random.default_rng(seed)
    places = shapely.points(rng.uniform(0, 100, (count, 2)))
    return np.asarray(shapely.buffer(places, rng.uniform(0.5, 6, count), quad_segs=12))


@examples(30, 100)
@given(st.integers(0, 10_000))
def test_the_gaps_are_those_of_a_minimum_spanning_tree(seed: int) -> None:
    bodies = shapely.get_parts(shapely.union_all(discs(seed)))
    tree = minimum_spanning_tree(shapely.distance(bodies[:, None].copy(), bodies)).data
    widest = 9.0
    found = narrow_gaps(discs(seed), widest, lambda _: True)
    widths = [gap.width_m for gap in found]
    assert widths == pytest.approx(sorted(tree[tree <= widest]), abs=1e-9)
    for gap in found:
        apart = shapely.distance(bodies[:, None], shapely.points(gap.line)).min(axis=0)
        assert apart == pytest.approx([0, 0], abs=1e-9)


def test_a_rock_in_a_strait_leaves_the_wider_side_as_the_strait() -> None:
    west, east, rock = (
        shapely.box(0, 0, 10, 100),
        shapely.box(20, 0, 60, 100),
        shapely.box(13, 50, 14, 51),
    )
    first, second = narrow_gaps(np.array([west, rock, east]), 50.0, lambda _: True)
    assert (first.width_m, second.width_m) == (3.0, 6.0)
    assert first.part_m == pytest.approx(np.hypot(1, 1))
    assert second.part_m == pytest.approx(np.hypot(14, 100))


def test_an_open_gap_joins_nothing() -> None:
    islands = shapely.box([0, 12, 25], 0, [10, 22, 35], 10)
    found = narrow_gaps(islands, 5.0, lambda line: bool(abs(line[0, 0] - 10) > 0.1))
    assert [gap.width_m for gap in found] == [3.0]
    assert narrow_gaps(np.empty(0, dtype=object), 5.0, lambda _: True) == []
