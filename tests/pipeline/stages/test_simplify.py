"""Simplified land covers all land, whatever its shape; what stays open, and what is refused."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pyproj
import pytest
import shapely
from hypothesis import assume, given, reject, settings
from hypothesis import strategies as st

from pipeline.errors import RequestError, StageError
from pipeline.geo.projection import Projection
from pipeline.sources.land.osm import land as osm_land
from pipeline.stages.simplify import SimplifiedLand, check, simplify_land
from tests.pipeline.archipelagos import EXAMPLES, EXTENT, PLANE, REGION, archipelagos, blob

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pipeline.model import Land

    Geometries = npt.NDArray[np.object_]

BUSUANGA = shapely.box(119.75, 11.75, 120.45, 12.45)
MINDORO_SIDE, WEST_SIDE = (120.42, 12.4), (119.77, 12.0)
NO_ENDPOINTS = np.empty((0, 2))


def _planar(result: SimplifiedLand) -> Geometries:
    return PLANE.geometry_to_plane(np.array(result.simplified.polygons, dtype=object))


def _run(land: Sequence[shapely.Polygon], **changes: object) -> SimplifiedLand:
    options: dict[str, object] = {
        "margin_m": 60.0,
        "close_gaps_m": 800.0,
        "tolerance_m": 400.0,
        "vertex_budget": 10_000,
    }
    return simplify_land(land, REGION, **(options | changes))  # type: ignore[arg-type]


def _assert_covers(
    result: SimplifiedLand, land: Sequence[shapely.Polygon], margin_m: float
) -> None:
    """Check without the code under test: valid, not touching, covering land and margin."""
    polygons = _planar(result)
    assert shapely.is_valid(polygons).all()
    for i, polygon in enumerate(polygons):
        assert not shapely.intersects(polygons[i + 1 :], polygon).any()
    original = PLANE.geometry_to_plane(np.array(land, dtype=object))
    whole = shapely.intersection(shapely.union_all(shapely.make_valid(original)), EXTENT)
    no_go = shapely.union_all(polygons)
    assert whole.difference(no_go).area == 0
    if whole.is_empty:
        return
    coast = no_go.boundary.intersection(EXTENT.buffer(-1))
    if not coast.is_empty:
        assert whole.distance(coast) >= margin_m
    corners = shapely.points(shapely.get_coordinates(whole))
    assert shapely.covers(no_go, corners).all()


@EXAMPLES
def test_all_land_is_covered_by_fewer_vertices(examples: int) -> None:
    @settings(max_examples=examples)
    @given(
        land=archipelagos,
        gap=st.sampled_from([0.0, 300.0, 3000.0]),
        tolerance=st.sampled_from([0.0, 150.0, 2000.0]),
    )
    def tried(land: list[shapely.Polygon], gap: float, tolerance: float) -> None:
        result = _run(land, close_gaps_m=gap, tolerance_m=tolerance)
        _assert_covers(result, land, 60.0)
        simplified = result.simplified
        assert simplified.vertices == sum(
            len(ring.coords) - 1 for p in simplified.polygons for ring in (p.exterior, *p.interiors)
        )
        assert simplified.tolerance_m == tolerance
        assert (simplified.closed_gap_m, simplified.margin_m) == (gap, 60.0)

    tried()


@EXAMPLES
def test_the_budget_is_met_or_the_fault_says_which_one_is_enough(examples: int) -> None:
    @settings(max_examples=examples)
    @given(land=archipelagos, budget=st.integers(8, 60))
    def tried(land: list[shapely.Polygon], budget: int) -> None:
        fault = ""
        try:
            result = _run(land, vertex_budget=budget)
        except RequestError as error:
            fault = str(error)
        if fault:
            assert f"chart.vertex_budget is {budget}" in fault
            enough = int(fault.split("set it to ")[1].split(" ")[0])
            assert enough > budget
            result, budget = _run(land, vertex_budget=enough), enough
        assert result.simplified.vertices <= budget
        _assert_covers(result, land, 60.0)

    tried()


@EXAMPLES
def test_start_and_goal_stay_in_one_body_of_water(examples: int) -> None:
    @settings(max_examples=examples)
    @given(
        land=archipelagos,
        start=st.tuples(st.floats(0.01, 0.49), st.floats(0.01, 0.49)),
        goal=st.tuples(st.floats(0.01, 0.49), st.floats(0.01, 0.49)),
        budget=st.sampled_from([60, 10_000]),
    )
    def tried(
        land: list[shapely.Polygon],
        start: tuple[float, float],
        goal: tuple[float, float],
        budget: int,
    ) -> None:
        endpoints = shapely.points(PLANE.to_plane([start, goal]))
        original = PLANE.geometry_to_plane(shapely.union_all(shapely.make_valid(land)))
        assume(shapely.distance(original, endpoints).min() > 1.0)
        try:
            result = _run(
                land,
                close_gaps_m=2000.0,
                tolerance_m=800.0,
                vertex_budget=budget,
                endpoints=[start, goal],
            )
        except RequestError:
            reject()
        _assert_covers(result, land, 0.0)
        water = shapely.get_parts(EXTENT.difference(shapely.union_all(_planar(result))))
        holds = shapely.intersects(water[:, None], endpoints)
        assert holds.any(axis=0).all()
        # Passages too narrow for the margin on both sides do not count.
        wide = shapely.get_parts(EXTENT.difference(original.buffer(2 * (60 + 0.1 * 800))))
        if shapely.intersects(wide[:, None], endpoints).all(axis=1).any():
            assert holds.all(axis=1).any()

    tried()


@EXAMPLES
def test_simplifying_again_changes_little(examples: int) -> None:
    @settings(max_examples=examples)
    @given(land=archipelagos)
    def tried(land: list[shapely.Polygon]) -> None:
        once = _run(land)
        again = _run(once.simplified.polygons, margin_m=0.0)
        assert again.simplified.vertices <= once.simplified.vertices + 8
        # Each pass may move the coast by the tolerance, but the first one removes most vertices.
        # Beyond the region's edge neither pass has to cover the other's land.
        before, after = (
            shapely.area(shapely.intersection(_planar(result), EXTENT)).sum()
            for result in (once, again)
        )
        perimeter = shapely.length(_planar(once)).sum()
        assert before <= after + 1 <= before + 1 + 400 * perimeter

    tried()


def test_the_result_depends_on_neither_order_nor_run() -> None:
    land = [
        blob((0.1 * i, 0.09 * j), [0.01, 0.02, 0.012, 0.016], 1, i)
        for i in (1, 2, 3)
        for j in (1, 3)
    ]
    one, two = _run(land), _run(land)
    assert [p.wkb for p in one.simplified.polygons] == [p.wkb for p in two.simplified.polygons]
    other = _run(land[::-1])
    assert other.simplified.vertices == one.simplified.vertices


def test_a_lone_rock_becomes_a_few_corners() -> None:
    rock = shapely.Point(0.25, 0.25).buffer(0.0001)
    result = _run([rock], tolerance_m=100.0)
    (polygon,) = result.simplified.polygons
    assert len(polygon.exterior.coords) - 1 <= 6
    _assert_covers(result, [rock], 60.0)
    # 11 m of rock and 60 m of margin: a corner within the tolerance of that.
    assert PLANE.geometry_to_plane(polygon).area < (2 * (11 + 60 + 100)) ** 2


def test_no_land_no_polygons() -> None:
    result = _run([])
    assert result.simplified.polygons == ()
    assert result.added == 0


def test_land_all_over_the_region() -> None:
    everywhere = shapely.box(-1, -1, 2, 2)
    result = _run([everywhere])
    assert shapely.union_all(_planar(result)).covers(EXTENT)


def test_invalid_and_overlapping_land_is_covered() -> None:
    bowtie = shapely.Polygon([(0.1, 0.1), (0.2, 0.2), (0.2, 0.1), (0.1, 0.2)])
    land = [bowtie, shapely.box(0.15, 0.12, 0.3, 0.18), shapely.box(0.15, 0.12, 0.3, 0.18)]
    _assert_covers(_run(land), land, 60.0)


@pytest.mark.parametrize(
    "other",
    [
        shapely.box(0.2, 0.2, 0.3, 0.3),  # in a corner
        shapely.box(0.2, 0.12, 0.3, 0.18),  # along an edge
        shapely.Polygon([(0.2, 0.15), (0.3, 0.1), (0.3, 0.2)]),  # a corner on an edge
        shapely.box(0.2, 0.1, 0.200001, 0.4),  # a sliver of 10 cm
    ],
    ids=["corner", "edge", "corner on edge", "sliver"],
)
def test_islands_that_touch_become_one(other: shapely.Polygon) -> None:
    land = [shapely.box(0.1, 0.1, 0.2, 0.2), other]
    for gap in (0.0, 800.0):
        result = _run(land, close_gaps_m=gap)
        _assert_covers(result, land, 60.0)
        assert len(result.simplified.polygons) == 1


def test_across_180_degrees_as_anywhere_else() -> None:
    land = [
        blob((0.1 * i, 0.09 * j), [0.01, 0.02, 0.012, 0.016], 1, i)
        for i in (1, 2, 3)
        for j in (1, 3)
    ]
    here = _run(land)
    there = simplify_land(
        [shapely.affinity.translate(polygon, 179.8) for polygon in land],
        shapely.affinity.translate(REGION, 179.8),
        margin_m=60.0,
        close_gaps_m=800.0,
        tolerance_m=400.0,
        vertex_budget=10_000,
    )
    assert there.simplified.vertices == here.simplified.vertices
    back = shapely.affinity.translate(shapely.MultiPolygon(there.simplified.polygons), -179.8)
    apart = back.symmetric_difference(shapely.MultiPolygon(here.simplified.polygons))
    assert apart.area < 1e-7 * back.area


@pytest.mark.parametrize(
    ("margin", "accuracy", "used", "noted"),
    [(None, 25.0, 25.0, False), (10.0, 25.0, 25.0, True), (60.0, 25.0, 60.0, False)],
)
def test_the_margin_is_at_least_the_charts_accuracy(
    margin: float | None, accuracy: float, used: float, *, noted: bool
) -> None:
    land = [shapely.box(0.1, 0.1, 0.2, 0.2)]
    result = _run(land, margin_m=margin, accuracy_m=accuracy)
    _assert_covers(result, land, used)
    assert result.simplified.margin_m == used
    assert bool(result.notes) is noted
    if noted:
        assert "chart.margin_m is 10 m, below the 25 m" in result.notes[0]


def test_the_margin_is_in_true_metres_at_70_degrees() -> None:
    region = shapely.box(5.0, 68.0, 55.0, 74.0)
    island = shapely.box(30.0, 70.0, 31.0, 70.3)
    result = simplify_land(
        [island], region, margin_m=2_000.0, close_gaps_m=0.0, tolerance_m=0.0, vertex_budget=10_000
    )
    edge = shapely.segmentize(shapely.union_all(result.simplified.polygons).boundary, 0.001)
    shore = shapely.get_coordinates(shapely.segmentize(island.exterior, 0.01))
    geod = pyproj.Geod(ellps="WGS84")
    apart = [
        geod.inv(*np.broadcast_to(at, shore.shape).T, *shore.T)[2].min()
        for at in shapely.get_coordinates(edge)[::20]
    ]
    assert 2_000.0 <= min(apart) < 2_060.0


def test_land_on_the_edge_extends_beyond_it() -> None:
    land = [shapely.box(-0.1, 0.2, 0.1, 0.3), shapely.box(0.45, 0.45, 0.7, 0.7)]
    result = _run(land)
    polygons = _planar(result)
    assert len(polygons) == 2
    for polygon in polygons:
        outside = polygon.difference(EXTENT)
        assert outside.area > 0
        # The coast neither ends on the edge nor leaves a strip of water behind it.
        along = polygon.intersection(EXTENT.exterior).length
        assert outside.buffer(1e-3).intersection(EXTENT.exterior).length == pytest.approx(
            along, rel=1e-3
        )


def test_a_strait_wider_than_the_gap_stays_as_wide() -> None:
    # Zigzag shores at least 1.9 km apart, whose teeth the tolerance would fill.
    x = np.arange(0.05, 0.451, 0.02)
    tooth = np.where(np.arange(len(x)) % 2, 0.02, 0.0)
    north = shapely.Polygon([*zip(x, 0.2585 + tooth, strict=True), (0.45, 0.4), (0.05, 0.4)])
    south = shapely.Polygon([*zip(x, 0.2415 - tooth, strict=True), (0.45, 0.1), (0.05, 0.1)])
    result = _run([north, south], close_gaps_m=1200.0, tolerance_m=2500.0)
    one, other = _planar(result)
    assert one.distance(other) >= 1200 * 0.97
    assert result.simplified.vertices < 20


def test_a_strait_narrower_than_the_gap_closes() -> None:
    land = [shapely.box(0.1, 0.1, 0.24, 0.4), shapely.box(0.246, 0.1, 0.4, 0.4)]
    assert len(_run(land, close_gaps_m=800.0).simplified.polygons) == 1
    assert len(_run(land, close_gaps_m=400.0).simplified.polygons) == 2


def test_lakes_are_filled_unless_start_or_goal_lies_on_one() -> None:
    lake = shapely.box(0.2, 0.2, 0.3, 0.3)
    island = shapely.Polygon(shapely.box(0.1, 0.1, 0.4, 0.4).exterior, [lake.exterior])
    sea, inland = (0.02, 0.02), (0.25, 0.25)
    (filled,) = _run([island], endpoints=[sea, (0.48, 0.48)]).simplified.polygons
    assert not filled.interiors
    (kept,) = _run([island], endpoints=[sea, inland]).simplified.polygons
    assert len(kept.interiors) == 1
    assert not kept.covers(shapely.Point(inland))


def test_a_harbour_stays_open_with_a_note() -> None:
    # A bay of 4 km behind a mouth of 300 m, start inside; the gap is 2 km.
    bay = shapely.union(shapely.box(0.2, 0.2, 0.24, 0.24), shapely.box(0.1, 0.2187, 0.21, 0.2214))
    mainland = shapely.box(0.12, 0.1, 0.4, 0.4).difference(bay)
    start, goal = (0.22, 0.22), (0.05, 0.45)
    result = _run([mainland], close_gaps_m=2000.0, tolerance_m=1000.0, endpoints=[start, goal])
    _assert_covers(result, [mainland], 0.0)
    water = EXTENT.difference(shapely.union_all(_planar(result)))
    endpoints = shapely.points(PLANE.to_plane([start, goal]))
    assert any(shapely.intersects(part, endpoints).all() for part in shapely.get_parts(water))
    (note,) = result.notes
    assert "narrower than 2000 m, which was left open" in note
    closed = _run(
        [mainland], close_gaps_m=2000.0, tolerance_m=1000.0, endpoints=[goal, (0.45, 0.05)]
    )
    assert closed.notes == ()
    assert shapely.union_all(_planar(closed)).covers(endpoints[0])


def test_a_start_inside_the_margin_keeps_half_of_its_distance() -> None:
    land = [shapely.box(0.2, 0.2, 0.3, 0.3)]
    start = (0.2 - 40 / 111_320, 0.25)  # 40 m off the quay
    result = _run(land, endpoints=[start, (0.05, 0.05)])
    no_go = shapely.union_all(_planar(result))
    assert no_go.distance(shapely.Point(PLANE.to_plane(start))) > 5
    _assert_covers(result, land, 15.0)


def test_check_names_every_fault() -> None:
    land = shapely.box(0, 0, 100, 100)
    good = shapely.box(-1, -1, 101, 101)
    check(np.array([good], dtype=object), land, np.array([[200.0, 200.0]]))
    bowtie = np.array([shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])], dtype=object)
    with pytest.raises(StageError, match="polygons are invalid"):
        check(bowtie, land, NO_ENDPOINTS)
    touching = np.array([shapely.box(0, 0, 50, 100), shapely.box(50, 0, 60, 100)], dtype=object)
    with pytest.raises(StageError) as caught:
        check(touching, land, np.array([[50.0, 50.0], [150.0, 50.0]]))
    assert "1 pairs of polygons touch" in str(caught.value)
    assert "4000 m² of land are uncovered" in str(caught.value)
    with pytest.raises(StageError, match="1 of start and goal"):
        check(np.array([good.buffer(200)], dtype=object), land, np.array([[200.0, 100.0]]))


@pytest.fixture(scope="module")
def busuanga() -> Land:
    """Return the real land around Busuanga and Culion: about 400 islands."""
    return osm_land(BUSUANGA)


@pytest.mark.parametrize(
    ("gap", "tolerance", "budget"), [(400.0, 200.0, 500), (4_000.0, 1_000.0, 90)]
)
def test_real_islands(busuanga: Land, gap: float, tolerance: float, budget: int) -> None:
    result = simplify_land(
        busuanga.polygons,
        BUSUANGA,
        margin_m=60.0,
        close_gaps_m=gap,
        tolerance_m=tolerance,
        vertex_budget=budget,
        endpoints=[MINDORO_SIDE, WEST_SIDE],
    )
    simplified = result.simplified
    assert simplified.vertices <= budget < simplified.original_vertices / 5
    plane = Projection.for_region(BUSUANGA)
    land = shapely.union_all(
        plane.geometry_to_plane(np.array(busuanga.polygons, dtype=object))
    ).intersection(plane.geometry_to_plane(BUSUANGA))
    polygons = plane.geometry_to_plane(np.array(simplified.polygons, dtype=object))
    no_go = shapely.union_all(polygons)
    assert land.difference(no_go).area == 0
    assert len(shapely.get_parts(no_go)) == len(polygons)
    endpoints = shapely.points(plane.to_plane([MINDORO_SIDE, WEST_SIDE]))
    assert not shapely.intersects(no_go, endpoints).any()
