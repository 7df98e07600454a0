"""The widest way takes the detour whose narrowest place is widest."""

from __future__ import annotations

import itertools

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.geo.open_water import widest_way

EXTENT = shapely.box(0, 0, 10e3, 10e3)
START, GOAL = np.array([500.0, 5e3]), np.array([9.5e3, 5e3])


@settings(max_examples=20)
@given(widths=st.permutations([25.0, 60.0, 140.0, 320.0, 700.0]))
def test_of_many_straits_the_widest_is_taken(widths: list[float]) -> None:
    edges = [(i + 0.5) * 10e3 / len(widths) for i in range(len(widths))]
    gates = [shapely.box(4e3, y, 6e3, y + width) for y, width in zip(edges, widths, strict=True)]
    land = shapely.get_parts(shapely.box(4.5e3, -1, 5.5e3, 10.1e3) - shapely.union_all(gates))
    way = widest_way(land, EXTENT, START, GOAL, 100.0)
    assert way is not None
    line = shapely.union_all(way)
    assert line.distance(shapely.union_all(land)) > 0
    assert max(one.length for one in way) <= 100.0 + 1e-6
    assert all(one.coords[1] == other.coords[0] for one, other in itertools.pairwise(way))
    assert {way[0].coords[0], way[-1].coords[1]} == {tuple(START), tuple(GOAL)}
    assert line.intersects(gates[int(np.argmax(widths))])


def test_no_way_through_a_wall() -> None:
    wall = np.array([shapely.box(4.5e3, -1, 5.5e3, 10.1e3)])
    assert widest_way(wall, EXTENT, START, GOAL, 100.0) is None
