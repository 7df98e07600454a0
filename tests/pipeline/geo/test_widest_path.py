"""The widest path takes the detour whose narrowest place is widest."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

from pipeline.geo.coast import widest_path

EXTENT = shapely.box(0, 0, 10e3, 10e3)
START, GOAL = np.array([500.0, 5e3]), np.array([9.5e3, 5e3])


@settings(max_examples=20)
@given(widths=st.permutations([25.0, 60.0, 140.0, 320.0, 700.0]))
def test_of_many_straits_the_widest_is_taken(widths: list[float]) -> None:
    edges = [(i + 0.5) * 10e3 / len(widths) for i in range(len(widths))]
    gates = [shapely.box(4e3, y, 6e3, y + width) for y, width in zip(edges, widths, strict=True)]
    land = shapely.get_parts(shapely.box(4.5e3, -1, 5.5e3, 10.1e3) - shapely.union_all(gates))
    way = widest_path(land, EXTENT, START, GOAL, 100.0)
    assert way is not None
    line = shapely.union_all(way)
    assert line.distance(shapely.union_all(land)) > 0
    assert max(one.length for one in way) <= 100.0 + 1e-6
    assert all(one.coords[1] == other.coords[0] for one, other in itertools.pairwise(way))
    assert {way[0].coords[0], way[-1].coords[1]} == {tuple(START), tuple(GOAL)}
    assert line.intersects(gates[int(np.argmax(widths))])


def test_no_way_through_a_wall() -> None:
    wall = np.array([shapely.box(4.5e3, -1, 5.5e3, 10.1e3)])
    assert widest_path(wall, EXTENT, START, GOAL, 100.0) is None


def _skerry(seed: int) -> np.ndarray:
    """Return random islets, among them some that touch, off the two ends."""
    rng = np.random.default_rng(seed)
    corners = 500.0 * rng.integers(2, 17, (30, 2))
    squares = shapely.box(*corners.T, *(corners + 500.0 * rng.integers(1, 3, (30, 1))).T)
    rounds = shapely.buffer(shapely.points(rng.uniform(0, 10e3, (60, 2))), rng.uniform(20, 500, 60))
    land = np.concatenate([squares, rounds])
    free = shapely.union_all(shapely.buffer(shapely.points([START, GOAL]), 300.0))
    return np.asarray(land[~shapely.intersects(land, free)])


def _widest_gate(
    water: shapely.Polygon,
) -> tuple[float, shapely.Point, list[shapely.LineString]] | None:
    """Join cells through ever narrower gates, widest first, until the ends are joined.

    Return the width of the last gate, its middle, and all gates narrower than that.
    """
    cells = [
        cell
        for cell in shapely.constrained_delaunay_triangles(water).geoms
        if water.contains(cell.centroid)
    ]
    sides: dict[frozenset[tuple[float, ...]], list[int]] = {}
    for number, cell in enumerate(cells):
        for side in itertools.pairwise(cell.exterior.coords):
            sides.setdefault(frozenset(side), []).append(number)
    gates = [(shapely.LineString(list(ends)), of) for ends, of in sides.items() if len(of) == 2]
    gates.sort(key=lambda gate: -gate[0].length)
    group = list(range(len(cells)))
    first, last = (
        int(np.argmin(shapely.distance(cells, shapely.Point(place)))) for place in (START, GOAL)
    )
    for at, (gate, (one, other)) in enumerate(gates):
        group = [group[one] if of == group[other] else of for of in group]
        if group[first] == group[last]:
            return gate.length, gate.centroid, [narrower for narrower, _ in gates[at + 1 :]]
    return None


@pytest.mark.parametrize("seed", range(12))
def test_among_many_islets_the_way_passes_the_widest_gate_that_joins_the_ends(seed: int) -> None:
    piece_m = 400.0
    land = _skerry(seed)
    way = widest_path(land, EXTENT, START, GOAL, piece_m)
    waters = shapely.get_parts(EXTENT.difference(shapely.union_all(land)))
    water = next((one for one in waters if one.covers(shapely.MultiPoint([START, GOAL]))), None)
    if water is None:
        assert way is None
        return
    assert way is not None
    found = _widest_gate(shapely.segmentize(water, piece_m))
    assert found is not None
    width, middle, narrower = found
    assert shapely.distance(way, middle).min() < 1e-3
    crossed = [gate for gate in narrower if shapely.crosses(way, gate).any()]
    assert [gate.length for gate in crossed if gate.length < width - 1e-3] == []
