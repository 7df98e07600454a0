"""Both triangulators against the definition of a constrained Delaunay triangulation."""

import gc
import itertools
import math
import sys
import weakref
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from typing import Any, TypeAlias

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st
from shapely import Polygon, box
from shapely.affinity import affine_transform

import renew
from renew._types import FloatArray
from renew.classes import triangulation
from renew.classes.triangulation import (
    Backend,
    Triangulation,
    _by_triangle,
    triangulate,
    triangulation_of,
)
from tests.strategies import (
    PAPER_VESSEL,
    SIZE,
    Scene,
    chart_of,
    random_islands,
    random_scene,
    seeds,
    single_gyre,
)

Point: TypeAlias = tuple[float, float]
Edge: TypeAlias = frozenset[Point]

needs_triangle = pytest.mark.skipif(
    find_spec("triangle") is None, reason="needs the extra `triangle`"
)
both = pytest.mark.parametrize(
    "backend", [pytest.param("triangle", marks=needs_triangle), "shapely"]
)

# Angle (rad) by which rounding may break the Delaunay condition where vertices lie on one circle.
ROUNDING = 1e-7

U_SHAPE = Polygon([(30, 30), (70, 30), (70, 70), (60, 70), (60, 40), (40, 40), (40, 70), (30, 70)])
CHARTS = {
    "empty": [],
    "concave": [U_SHAPE],
    "touches the extent": [box(0, 40, 60, 60)],
    "sticks out of the extent": [box(-20, 40, 60, 60), Polygon([(90, 90), (120, 95), (95, 120)])],
    "has a lake": [box(20, 20, 80, 80).difference(box(40, 40, 60, 60))],
    "touch at a point": [box(20, 20, 50, 50), box(50, 50, 80, 80)],
    "overlap": [box(20, 20, 55, 55), box(45, 45, 80, 80)],
    "share an edge": [box(20, 20, 50, 50), box(50, 20, 80, 50)],
    "in a row, vertices collinear": [box(x, 40, x + 5, 45) for x in range(10, 90, 10)],
    "collinear vertices on edges": [shapely.segmentize(box(20, 20, 80, 70), 1.5)],
    "a sliver": [Polygon([(20, 20), (80, 50), (50, 35 + 1e-6)])],
    "a channel of a micrometre": [box(10, 10, 50, 90), box(50 + 1e-6, 10, 90, 90)],
    "on one circle": [shapely.Point(50, 50).buffer(30, quad_segs=16)],
}


# --- the definition ---------------------------------------------------------------------------


def apexes_by_edge(triangles: FloatArray) -> dict[Edge, list[Point]]:
    """For every edge of triangles (t, 3, 2) the corners that face it."""
    found: dict[Edge, list[Point]] = defaultdict(list)
    for corners in triangles.tolist():
        a, b, c = map(tuple, corners)
        for apex, edge in ((a, (b, c)), (b, (c, a)), (c, (a, b))):
            found[frozenset(edge)].append(apex)
    return found


def ring_edges(water: shapely.Geometry) -> set[Edge]:
    """Edges of all rings of some polygons: what a triangulation is constrained to."""
    polygons = shapely.get_parts(water)
    rings = [ring for polygon in polygons for ring in (polygon.exterior, *polygon.interiors)]
    return {
        frozenset(pair)
        for ring in rings
        for pair in itertools.pairwise(map(tuple, shapely.get_coordinates(ring).tolist()))
    }


def angle(apex: Point, edge: Edge) -> float:
    """Angle (rad) at which an apex sees an edge."""
    (ax, ay), (bx, by) = ((x - apex[0], y - apex[1]) for x, y in edge)
    return math.atan2(abs(ax * by - ay * bx), ax * bx + ay * by)


def assert_constrained_delaunay(mesh: Triangulation, chart: renew.Chart) -> None:
    """Check the definition; nothing here is shared with the triangulators or with Triangulation."""
    triangles = shapely.polygons(mesh.corners)
    assert shapely.area(triangles).sum() == pytest.approx(chart.water.area, rel=1e-9)
    vertices = {tuple(point) for point in mesh.corners.reshape(-1, 2).tolist()}
    assert vertices <= {tuple(point) for point in shapely.get_coordinates(chart.water).tolist()}
    apexes = apexes_by_edge(mesh.corners)
    # An edge of the water bounds one triangle, any other edge two: none is missing, none crossed.
    assert {edge for edge, facing in apexes.items() if len(facing) == 1} == ring_edges(chart.water)
    for edge, facing in apexes.items():
        # Of two triangles that share an edge, neither apex lies in the other's circumcircle: just
        # then the angles that face the edge add up to a half turn or less. With that on every edge
        # that is not constrained the triangulation is Delaunay (Lee and Lin 1986).
        if len(facing) > 1:
            one, other = facing
            assert angle(one, edge) + angle(other, edge) <= math.pi + ROUNDING


def triangle_set(mesh: Triangulation) -> set[frozenset[Point]]:
    """The set of triangles, each as the set of its corners."""
    return {frozenset(map(tuple, corners)) for corners in mesh.corners.tolist()}


# --- charts -----------------------------------------------------------------------------------


@both
@pytest.mark.parametrize("islands", CHARTS.values(), ids=CHARTS)
def test_triangles_are_constrained_delaunay(islands: list[Polygon], backend: Backend) -> None:
    chart = chart_of(islands)
    assert_constrained_delaunay(triangulate(chart, backend), chart)


@both
@settings(max_examples=15)
@given(seed=seeds)
def test_triangles_of_random_charts_are_constrained_delaunay(backend: Backend, seed: int) -> None:
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed, 12))
    assert_constrained_delaunay(triangulate(chart, backend), chart)


places = st.floats(0, 90)
sizes = st.floats(2, 30)
powers = st.floats(-6, 0).map(lambda exponent: 10.0**exponent)


def grid_box(i: int, j: int, w: int, h: int) -> list[Polygon]:
    """Box on a grid: it touches others at points and along edges, and shares lines with them."""
    return [box(10 * i, 10 * j, 10 * (i + w), 10 * (j + h))]


def sliver(x: float, y: float, length: float, thickness: float) -> list[Polygon]:
    """Triangle far longer than thick."""
    return [Polygon([(x, y), (x + length, y + length / 3), (x + length / 2, y - thickness)])]


def near_pair(x: float, y: float, size: float, gap: float) -> list[Polygon]:
    """Two boxes that all but touch."""
    return [box(x, y, x + size, y + size), box(x + size + gap, y - 1, x + 2 * size, y + size)]


def slit_ring(x: float, y: float, size: float, slit: float) -> list[Polygon]:
    """Ring that is open by a narrow slit."""
    centre = shapely.Point(x, y)
    ring = centre.buffer(size).difference(centre.buffer(size / 2))
    parts = shapely.get_parts(ring.difference(box(x, y, x + size + 1, y + slit))).tolist()
    return [part for part in parts if part.geom_type == "Polygon"]


def beaded_box(x: float, y: float, size: float, step: float) -> list[Polygon]:
    """Box with collinear vertices on its edges."""
    return [shapely.segmentize(box(x, y, x + size, y + size), step)]


def polygon_on_circle(x: float, y: float, size: float) -> list[Polygon]:
    """Polygon whose vertices lie on one circle."""
    return [shapely.Point(x, y).buffer(size, quad_segs=4)]


cells, spans = st.integers(0, 9), st.integers(1, 3)
degenerate = st.lists(
    st.one_of(
        st.builds(grid_box, cells, cells, spans, spans),
        st.builds(sliver, places, places, sizes, powers),
        st.builds(near_pair, places, places, sizes, powers),
        st.builds(slit_ring, places, places, sizes, powers),
        st.builds(beaded_box, places, places, sizes, st.floats(0.7, 5)),
        st.builds(polygon_on_circle, places, places, sizes),
    ),
    min_size=1,
    max_size=6,
).map(lambda groups: [island for group in groups for island in group])


@both
@settings(max_examples=40)
@given(
    islands=degenerate,
    scale=st.sampled_from([1.0, 0.02, 3e3]),
    shift=st.sampled_from([0.0, 1e5 / 3]),
)
def test_degenerate_charts_are_constrained_delaunay(
    backend: Backend, islands: list[Polygon], scale: float, shift: float
) -> None:
    extent, *land = (
        affine_transform(polygon, [scale, 0, 0, scale, scale * shift, -scale * shift])
        for polygon in (box(0, 0, 100, 100), *islands)
    )
    chart = renew.Chart(extent, land)
    assert_constrained_delaunay(triangulate(chart, backend), chart)


@both
@pytest.mark.parametrize("islands", CHARTS.values(), ids=CHARTS)
def test_constrained_edges_are_the_no_go_zone_inside_the_extent(
    islands: list[Polygon], backend: Backend
) -> None:
    chart = chart_of(islands)
    edges = triangulate(chart, backend).constrained_edges
    boundary = chart.hard_no_go.boundary
    inside = shapely.length(shapely.difference(boundary, chart.extent.exterior.buffer(1e-6)))
    assert np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1).sum() == pytest.approx(inside)


# --- one against the other --------------------------------------------------------------------


@needs_triangle
@settings(max_examples=15)
@given(seed=seeds)
def test_both_give_the_same_triangles_where_no_four_vertices_lie_on_a_circle(seed: int) -> None:
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed, 12))
    # Overpowered water is cut out with its own, finely stepped outline.
    cut = shapely.Point(np.random.default_rng(seed).uniform(0, SIZE, 2)).buffer(25.37)
    for closed in (None, cut):
        one, other = (triangulate(chart, backend, closed) for backend in ("triangle", "shapely"))
        assert triangle_set(one) == triangle_set(other)
        assert one.hazardous.sum() == other.hazardous.sum()


def is_barely_missed(route: renew.Route, plan: renew.Plan) -> bool:
    """Whether a plan misses a class as its last one costs about as much, or by an inch."""
    if route.fuel > plan.routes[-1].fuel * (1 - 1e-3):
        return True
    straits = (one.strait for one in plan.rejected if one.homotopy == route.homotopy)
    return any(
        strait is not None and strait.padding_left + strait.padding_right < 1.05 * strait.width
        for strait in straits
    )


@pytest.mark.gate_share(2)
@needs_triangle
@pytest.mark.parametrize(
    "scene",
    [single_gyre, *(partial(random_scene, seed) for seed in (3, 8, 12))],
    ids=["single gyre", "random 3", "random 8", "random 12"],
)
def test_plans_find_the_same_classes_for_the_same_fuel(
    scene: Callable[[], Scene[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def plan() -> renew.Plan:
        return scene().plan(classes=6)  # on a chart of its own: plans on one share its triangles

    by_geos = plan()
    monkeypatch.setattr(triangulation, "_by_shapely", partial(_by_triangle, precision=1e-9))
    by_triangle = plan()
    for one, other in ((by_geos, by_triangle), (by_triangle, by_geos)):
        found = {route.homotopy for route in other.routes}
        for route in one.routes:
            if route.homotopy not in found:
                assert is_barely_missed(route, other)
    assert by_geos.best.fuel == pytest.approx(by_triangle.best.fuel, rel=1e-3)


def test_plans_on_one_chart_share_its_triangles_as_long_as_it_lives() -> None:
    chart, current, start, goal = single_gyre().parts
    once = renew.plan(chart, current, PAPER_VESSEL, start, goal, classes=3)
    kept = triangulation_of(chart)
    assert (kept.corners == triangulate(chart).corners).all()
    again = renew.plan(chart, current, PAPER_VESSEL, goal, start, classes=3)
    assert triangulation_of(chart) is kept
    other = renew.Chart(chart.extent, chart.no_go)
    assert triangulation_of(other) is not kept
    # The same to the last bit as on a chart that nobody has planned on.
    for plan, ends in ((once, (start, goal)), (again, (goal, start))):
        fresh = renew.Chart(chart.extent, chart.no_go)
        alone = renew.plan(fresh, current, PAPER_VESSEL, *ends, classes=3)
        for one, two in zip(plan.routes, alone.routes, strict=True):
            assert (one.path == two.path).all()
            assert (one.padding_used == two.padding_used).all()
    forgotten = weakref.ref(kept)
    del kept, chart, once, again, plan, alone, one, two, fresh
    gc.collect()
    assert forgotten() is None


# --- which of them ----------------------------------------------------------------------------


def test_triangle_is_refused_where_it_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "triangle", None)
    chart = single_gyre().chart
    with pytest.raises(renew.ParameterError, match="pip install triangle, or choose 'shapely'"):
        triangulate(chart, "triangle")


def test_an_unknown_backend_is_refused_with_the_known_ones() -> None:
    with pytest.raises(renew.ParameterError, match="'cgal' is not one of shapely, triangle"):
        triangulate(single_gyre().chart, "cgal")  # type: ignore[arg-type]


def test_a_triangle_that_is_a_line_hides_no_other() -> None:
    """On real charts two vertices of a triangle may be one point to the last digit."""
    whole = triangulate(renew.Chart(box(0, 0, 10, 10)))
    line = np.vstack([whole.triangles[:1], whole.triangles])
    line[0, 1] = line[0, 0]
    point = np.array([3.0, 5.0])
    assert replace(whole, triangles=line).locate(point) == whole.locate(point) + 1 > 0
