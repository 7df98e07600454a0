"""Coasts of fewer vertices, water opened again, and the widest path through it."""

import itertools

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings, strategies as st

from pipeline.geo import coast
from pipeline.geo.coast import (
    covering_land,
    in_small_pieces,
    inner_land,
    mesh_in_tiles,
    opened,
    parted,
    shore_to_shore,
    simplified,
    widest_path,
)
from tests.pipeline.archipelagos import EXTENT, PLANE, archipelagos
from tests.strategies import examples


def planar(land: list[shapely.Polygon]) -> np.ndarray:
    """Return valid polygons in the plane, m."""
    valid = shapely.get_parts(shapely.make_valid(np.array(land, dtype=object)))
    polygons = valid[shapely.get_type_id(valid) == shapely.GeometryType.POLYGON]
    return np.asarray(PLANE.geometry_to_plane(polygons))


@st.composite
def combs(draw: st.DrawFn) -> shapely.Polygon:
    """Draw a coast (m) with inlets and spits that are narrower than what is cut."""
    depth = draw(st.lists(st.floats(1.0, 900.0), min_size=6, max_size=30))
    x = np.linspace(0.0, 40.0 * len(depth), len(depth))
    lean = draw(st.floats(-300.0, 300.0))
    tips = np.column_stack([x + lean, depth])
    roots = np.column_stack([x + draw(st.floats(0.1, 20.0)), np.full(len(x), -5.0)])
    shore = np.stack([tips, roots], axis=1).reshape(-1, 2)
    ring = shapely.Polygon([*shore, (x[-1], -2_000.0), (x[0], -2_000.0)])
    parts = shapely.get_parts(shapely.make_valid(ring, method="structure"))
    return max(parts.tolist(), key=lambda part: part.area)


coasts = st.one_of(archipelagos.map(planar), combs().map(lambda comb: np.array([comb])))


# --- Outer land covers land and margin and little more; inner land is land ---


NO_ENDPOINTS = np.empty((0, 2))
TOLERANCES = st.sampled_from([0.0, 40.0, 700.0])


@examples(20, 60)
@given(land=coasts, tolerance=TOLERANCES, margin=st.sampled_from([0.0, 5.0, 200.0]))
def test_land_and_margin_are_covered_and_nothing_far_beyond(
    land: np.ndarray, tolerance: float, margin: float
) -> None:
    outer = covering_land(land, tolerance, margin, NO_ENDPOINTS)
    assert shapely.is_valid(outer).all()
    united = shapely.union_all(outer)
    assert united.area == np.float64(shapely.area(outer).sum()).round(6) or np.isclose(
        united.area, shapely.area(outer).sum(), rtol=1e-9
    )
    original = shapely.union_all(land)
    # An inscribed polygon of the round buffer, judged by GEOS alone.
    assert original.buffer(margin * 0.999).difference(united).area < 1e-3
    reach = max(margin + tolerance, 1.05 * margin)
    assert united.difference(original.buffer(1.01 * reach + 1e-3)).area < 1e-3


@settings(max_examples=60)
@given(land=coasts, tolerance=TOLERANCES, margin=st.sampled_from([0.0, 30.0]))
def test_inner_land_is_land_and_lacks_only_its_edge(
    land: np.ndarray, tolerance: float, margin: float
) -> None:
    inner = inner_land(land, tolerance, margin)
    assert shapely.is_valid(inner).all()
    original = shapely.union_all(land)
    assert shapely.union_all(inner).difference(original.buffer(-0.99 * margin)).area < 1e-3
    core = shapely.union_all(shapely.buffer(land, -(3.2 * tolerance + 1.1 * margin + 0.01)))
    assert core.difference(shapely.union_all(inner)).area < 1e-3


def test_enclosed_water_becomes_land_but_for_that_of_an_endpoint() -> None:
    island = shapely.box(0, 0, 10e3, 10e3).difference(shapely.box(4e3, 4e3, 6e3, 6e3))
    islet = shapely.box(4.9e3, 4.9e3, 5.1e3, 5.1e3)
    land = np.array([island, islet])
    (whole,) = covering_land(land, 50.0, 10.0, np.array([[-1e3, 0.0]]))
    assert not whole.interiors
    assert len(covering_land(land, 50.0, 10.0, NO_ENDPOINTS)) == 2
    kept = covering_land(land, 50.0, 10.0, np.array([[4.2e3, 4.2e3]]))
    assert len(kept) == 2
    # Two hooks enclose a pool only once they have grown together.
    hooks = shapely.difference(island, shapely.box(4.99e3, 5e3, 5.01e3, 11e3))
    (closed,) = covering_land(np.array([hooks]), 50.0, 10.0, np.array([[-1e3, 0.0]]))
    assert not closed.interiors
    assert closed.covers(shapely.Point(5e3, 5e3))


def test_small_pieces_make_up_the_same_area() -> None:
    angle = np.linspace(0, 2 * np.pi, 5_000, endpoint=False)
    radius = 1000 + 200 * np.sin(37 * angle) + 5 * np.sin(1_900 * angle)
    star = shapely.Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
    holed = star.difference(shapely.Point(0, 0).buffer(300, quad_segs=200))
    whole = np.array([holed, shapely.box(2_000, 0, 2_001, 1)], dtype=object)
    pieces = in_small_pieces(whole)
    assert shapely.get_num_coordinates(pieces).max() <= 256
    assert shapely.area(pieces).sum() == pytest.approx(shapely.area(whole).sum(), rel=1e-12)
    line = shapely.LineString([(-1_500, -700), (1_500, 433)])
    lengths = [shapely.length(shapely.intersection(line, cut)).sum() for cut in (whole, pieces)]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-9)


# --- What is cut lies near the simplified rings; nothing else changes sides ---


CUTS = st.sampled_from([0.0, 10.0, 150.0, 3000.0])


@settings(max_examples=60)
@given(land=coasts, cut=CUTS)
def test_only_what_is_nearer_than_the_cut_to_a_new_ring_changes_sides(
    land: np.ndarray, cut: float
) -> None:
    areas, outlines, owner = simplified(land, cut)
    assert shapely.is_valid(areas).all()
    for index, (polygon, area) in enumerate(zip(land, areas, strict=True)):
        own = outlines[owner == index]
        # Inscribed polygons of the buffers: a little wider than the cut makes up for it.
        near = shapely.union_all(shapely.buffer([area.boundary, *own], 1.02 * cut + 1e-6))
        assert polygon.symmetric_difference(area).difference(near).area < 1e-3


def test_an_islet_becomes_a_line_and_a_dot_a_point() -> None:
    islet = shapely.box(0, 0, 90, 10)
    dot = shapely.box(500, 0, 501, 1)
    square = shapely.box(0, 100, 90, 190)
    areas, (line, point), owner = simplified(np.array([islet, dot, square]), 20.0)
    assert shapely.is_empty(areas).tolist() == [True, True, False]
    assert owner.tolist() == [0, 1]
    assert line.length >= 90
    assert point.length < 2
    # Both can be buffered to all sides.
    assert line.buffer(20.0).covers(islet)
    assert point.buffer(20.0).covers(dot)


def test_a_lake_that_collapses_is_an_outline_of_its_land() -> None:
    lake = shapely.box(100, 100, 400, 110)
    land = shapely.box(0, 0, 1000, 1000).difference(lake)
    (area,), (outline,), owner = simplified(np.array([land]), 20.0)
    assert area.equals(shapely.box(0, 0, 1000, 1000))
    assert owner.tolist() == [0]
    assert outline.buffer(20.0).covers(lake)


# --- Start and goal stay in water, and connected, if they are so without the margin ---


WEST, EAST = (-20e3, 0.0), (20e3, 0.0)
WALL = shapely.box(-1e3, -40e3, 1e3, 40e3)


@settings(max_examples=30)
@given(land=archipelagos, where=st.tuples(st.floats(0.01, 0.49), st.floats(0.01, 0.49)))
def test_an_endpoint_keeps_half_of_its_distance_from_land(
    land: list[shapely.Polygon], where: tuple[float, float]
) -> None:
    polygons = planar(land)
    endpoint = PLANE.to_plane([where])
    point = shapely.points(endpoint)[0]
    distance = shapely.distance(shapely.union_all(polygons), point)
    assume(distance > 1.0)
    grown = covering_land(polygons, 0.0, 300.0, endpoint)
    free = opened(grown, polygons, EXTENT, endpoint, 300.0)
    assert shapely.distance(free.land, point).min(initial=np.inf) >= min(
        distance / 2 * 0.99, distance - 320
    )
    assert shapely.union_all(polygons).difference(shapely.union_all(free.land)).area < 1e-3


@pytest.mark.parametrize("width", [10.0, 400.0])
def test_the_widest_strait_is_opened_where_the_margin_shuts_all(width: float) -> None:
    wide = shapely.box(-2e3, 10e3, 2e3, 10e3 + width)
    narrow = shapely.box(-2e3, 0.0, 2e3, width / 2)
    wall = shapely.get_parts(WALL.difference(wide).difference(narrow))
    endpoints = np.array([WEST, EAST])
    grown = covering_land(wall, 100.0, 300.0, endpoints)
    assert parted(grown, EXTENT, endpoints[None]) == {0}
    free = opened(grown, wall, EXTENT, endpoints, 400.0)
    assert parted(free.land, EXTENT, endpoints[None]) == set()
    assert shapely.union_all(wall).difference(shapely.union_all(free.land)).area < 1e-3
    assert free.width_m == pytest.approx(width, rel=1e-6)
    assert free.narrowest is not None
    x, y = free.narrowest
    # Anywhere in the strait, or in its mouth.
    assert abs(x) <= 1.3e3
    assert 9.9e3 < y < 10.1e3 + width


def test_what_land_parts_stays_apart() -> None:
    endpoints = np.array([WEST, EAST])
    wall = np.array([WALL])
    grown = covering_land(wall, 100.0, 300.0, endpoints)
    free = opened(grown, wall, EXTENT, endpoints, 400.0)
    assert free.narrowest is None
    assert parted(free.land, EXTENT, endpoints[None]) == {0}


def test_bodies_of_water_are_distinguished() -> None:
    wall = np.array([WALL])
    voyages = np.array([(WEST, EAST), (WEST, (-20e3, 100.0)), (EAST, WEST)])
    assert parted(wall, EXTENT, voyages) == {0, 2}
    gate = shapely.get_parts(WALL.difference(shapely.box(-2e3, -5, 2e3, 5)))
    assert parted(gate, EXTENT, voyages) == set()


def test_each_of_many_voyages_gets_its_strait() -> None:
    """A lagoon with a narrow mouth, the wall's strait, an end within the margin, one on land."""
    ring = shapely.box(20e3, -30e3, 30e3, -20e3).difference(shapely.box(22e3, -28e3, 28e3, -22e3))
    lagoon = ring.difference(shapely.box(24.9e3, -23e3, 25.1e3, -19e3))
    wall = WALL.difference(shapely.box(-2e3, 10e3, 2e3, 10.1e3))
    land = shapely.get_parts([wall, lagoon])
    inside, close = (25e3, -25e3), (20e3 - 50.0, -25e3)
    endpoints = np.array([EAST, inside, WEST, EAST, close, EAST, (21e3, -25e3), EAST])
    grown = covering_land(land, 100.0, 300.0, endpoints)
    voyages = endpoints.reshape(-1, 2, 2)
    assert parted(grown, EXTENT, voyages) == {0, 1, 2, 3}
    free = opened(grown, land, EXTENT, endpoints, 400.0)
    assert parted(free.land, EXTENT, voyages) == {3}
    assert shapely.union_all(land).difference(shapely.union_all(free.land)).area < 1e-3
    assert free.width_m == pytest.approx(100.0, rel=0.02)


# --- The widest path takes the detour whose narrowest place is widest ---


WATER = shapely.box(0, 0, 10e3, 10e3)
START, GOAL = np.array([500.0, 5e3]), np.array([9.5e3, 5e3])


@settings(max_examples=20)
@given(widths=st.permutations([25.0, 60.0, 140.0, 320.0, 700.0]))
def test_of_many_straits_the_widest_is_taken(widths: list[float]) -> None:
    edges = [(i + 0.5) * 10e3 / len(widths) for i in range(len(widths))]
    gates = [shapely.box(4e3, y, 6e3, y + width) for y, width in zip(edges, widths, strict=True)]
    land = shapely.get_parts(shapely.box(4.5e3, -1, 5.5e3, 10.1e3) - shapely.union_all(gates))
    way = widest_path(land, WATER, START, GOAL, 100.0)
    assert way is not None
    line = shapely.union_all(way)
    assert line.distance(shapely.union_all(land)) > 0
    assert max(one.length for one in way) <= 100.0 + 1e-6
    assert all(one.coords[1] == other.coords[0] for one, other in itertools.pairwise(way))
    assert {way[0].coords[0], way[-1].coords[1]} == {tuple(START), tuple(GOAL)}
    assert line.intersects(gates[int(np.argmax(widths))])


def test_no_way_through_a_wall() -> None:
    wall = np.array([shapely.box(4.5e3, -1, 5.5e3, 10.1e3)])
    assert widest_path(wall, WATER, START, GOAL, 100.0) is None


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


@pytest.mark.gate_share(4)
@pytest.mark.parametrize("seed", range(12))
def test_among_many_islets_the_way_passes_the_widest_gate_that_joins_the_ends(seed: int) -> None:
    piece_m = 400.0
    land = _skerry(seed)
    way = widest_path(land, WATER, START, GOAL, piece_m)
    waters = shapely.get_parts(WATER.difference(shapely.union_all(land)))
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


@pytest.mark.parametrize("seed", range(6))
def test_tiles_of_water_meet_everywhere_but_on_land(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(coast, "_TILE", 30)
    land, ends = _skerry(seed), np.stack([START, GOAL])
    extent = WATER.buffer(-1.0).union(shapely.Point(5e3, 5e3).buffer(5.2e3)).convex_hull
    water, mesh = extent.difference(shapely.union_all(land)), mesh_in_tiles(land, extent, ends)
    if not any(body.covers(shapely.MultiPoint(ends)) for body in shapely.get_parts(water)):
        assert mesh is None
        return
    assert mesh is not None
    assert shapely.area(shapely.polygons(mesh.corners)).sum() == pytest.approx(water.area)
    outer = mesh.vertices[mesh.edge_vertices(*np.nonzero(mesh.neighbours < 0))]
    off_shore = shapely.distance(water.boundary, shapely.points(outer.mean(axis=1)))
    assert off_shore.max() < 1e-6


def test_an_island_beside_a_gap_is_no_shore_of_it() -> None:
    west, east = shapely.box(0, 0, 10, 9), shapely.box(90, 0, 99, 9)
    gap = np.array([[11.0, 4.0], [89.0, 5.0]])
    for others in ([], [shapely.box(45, 20, 55, 30)]):
        shores = shore_to_shore(np.array([west, east, *others]), gap, 2.0)
        assert shores is not None
        assert np.linalg.norm(shores[1] - shores[0]) == pytest.approx(80.0)


@settings(max_examples=20)
@given(
    corners=st.lists(st.tuples(st.floats(0, 900), st.floats(0, 900)), min_size=8, max_size=8),
    apart=st.floats(80.0, 1500.0),
    reach=st.floats(5.0, 60.0),
)
def test_from_shore_to_shore_is_measured_on_the_original_land(
    corners: list[tuple[float, float]], apart: float, reach: float
) -> None:
    one, other = (
        shapely.convex_hull(shapely.multipoints(half)).buffer(20.0)
        for half in (corners[:4], corners[4:])
    )
    other = shapely.transform(other, lambda points: points + np.array([960 + apart, 0]))
    land = np.array([one, other])
    shortest = shapely.shortest_line(one, other)
    wider = shapely.shortest_line(*shapely.buffer(land, 0.8 * reach))
    gap = shapely.get_coordinates(wider)
    found = shore_to_shore(land, gap[::-1], 1.02 * reach)
    assert found is not None
    assert np.linalg.norm(found[1] - found[0]) == pytest.approx(shortest.length, rel=0.01)
    assert shapely.distance(shapely.points(found), land[::-1]) == pytest.approx(0.0, abs=1e-6)
    # A bank that is further off is no shore, nor is one of open water.
    assert shore_to_shore(land, gap, 0.7 * reach) is None
    assert shore_to_shore(land[:1], gap, reach) is None
