"""Simplified land covers all land, whatever its shape, and inner land is land; what stays open."""

import math
import time
from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings, strategies as st

from pipeline._types import Geometries
from pipeline.errors import StageError
from pipeline.findings.note_words import note_text, note_texts
from pipeline.geo.projection import Projection
from pipeline.model import Land, SimplifiedLand
from pipeline.sources.land.osm import OsmLand
from pipeline.stages.simplify import check, chosen_tolerance_m, simplify_land
from tests.pipeline.archipelagos import EXAMPLES, EXTENT, PLANE, REGION, archipelagos, blob
from tests.true_scale import GEOD


def _planar(result: SimplifiedLand) -> Geometries:
    return PLANE.geometry_to_plane(np.array(result.polygons, dtype=object))


def _planar_inner(result: SimplifiedLand) -> Geometries:
    return PLANE.geometry_to_plane(np.array(result.inner_polygons, dtype=object))


def _valid(land: Sequence[shapely.Polygon]) -> Geometries:
    """Return the land in the plane; its own make_valid, not the stage's."""
    return PLANE.geometry_to_plane(shapely.make_valid(np.array(land, dtype=object)))


def _run(land: Sequence[shapely.Polygon], **changes: object) -> SimplifiedLand:
    options: dict[str, object] = {"margin_m": 60.0, "tolerance_m": 400.0}
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
def test_all_land_is_covered_and_all_inner_land_is_land(examples: int) -> None:
    @settings(max_examples=examples)
    @given(
        land=archipelagos,
        margin=st.sampled_from([0.0, 60.0, 500.0]),
        tolerance=st.sampled_from([0.0, 100.0, 2000.0]),
    )
    def tried(land: list[shapely.Polygon], margin: float, tolerance: float) -> None:
        result = _run(land, margin_m=margin, tolerance_m=tolerance)
        _assert_covers(result, land, margin)
        simplified = result
        assert simplified.vertices == sum(
            len(ring.coords) - 1 for p in simplified.polygons for ring in (p.exterior, *p.interiors)
        )
        assert (simplified.tolerance_m, simplified.margin_m) == (tolerance, margin)
        whole = shapely.union_all(_valid(land))
        inner = _planar_inner(result)
        assert shapely.is_valid(inner).all()
        assert shapely.union_all(inner).difference(whole).area < 1e-3
        # Inner land is kept in the widest parts of the land.
        cores = shapely.buffer(_valid(land), -3.2 * tolerance - 1)
        core = shapely.union_all(cores).intersection(EXTENT)
        assert core.difference(shapely.union_all(inner)).area < 1e-3

    tried()


@EXAMPLES
def test_a_passage_wider_than_margin_and_tolerance_on_both_sides_stays_open(examples: int) -> None:
    @settings(max_examples=examples)
    @given(land=archipelagos, tolerance=st.sampled_from([60.0, 100.0, 900.0]))
    def tried(land: list[shapely.Polygon], tolerance: float) -> None:
        margin = 60.0
        no_go = shapely.union_all(_planar(_run(land, margin_m=margin, tolerance_m=tolerance)))
        # The middle of every passage that is wider than that is further from land than this.
        far = EXTENT.difference(shapely.union_all(_valid(land)).buffer(margin + tolerance + 1.0))
        assert no_go.intersection(far).area == 0

    tried()


@EXAMPLES
def test_only_areas_that_overlap_are_joined(examples: int) -> None:
    @settings(max_examples=examples)
    @given(land=archipelagos)
    def tried(land: list[shapely.Polygon]) -> None:
        polygons = _planar(_run(land, tolerance_m=100.0))
        original = shapely.union_all(_valid(land))
        parts = shapely.get_parts(original.buffer(160.0 + 1.0))
        parts = parts[shapely.intersects(parts, original.intersection(EXTENT))]
        # Land that is further apart than margin and tolerance on both sides stays apart.
        assert len(polygons) >= len(parts)

    tried()


@EXAMPLES
def test_start_and_goal_stay_in_one_body_of_water(examples: int) -> None:
    @settings(max_examples=examples)
    @given(
        land=archipelagos,
        start=st.tuples(st.floats(0.01, 0.49), st.floats(0.01, 0.49)),
        goal=st.tuples(st.floats(0.01, 0.49), st.floats(0.01, 0.49)),
        margin=st.sampled_from([60.0, 1000.0]),
    )
    def tried(
        land: list[shapely.Polygon],
        start: tuple[float, float],
        goal: tuple[float, float],
        margin: float,
    ) -> None:
        endpoints = shapely.points(PLANE.to_plane([start, goal]))
        original = shapely.union_all(_valid(land))
        assume(shapely.distance(original, endpoints).min() > 1.0)
        result = _run(land, margin_m=margin, tolerance_m=800.0, endpoints=[start, goal])
        _assert_covers(result, land, 0.0)
        water = shapely.get_parts(EXTENT.difference(shapely.union_all(_planar(result))))
        holds = shapely.intersects(water[:, None], endpoints)
        assert holds.any(axis=0).all()
        # Where water without the margin connects them, except through passages of some metres.
        wide = shapely.get_parts(EXTENT.difference(original.buffer(5.0)))
        if shapely.intersects(wide[:, None], endpoints).all(axis=1).any():
            assert holds.all(axis=1).any()

    tried()


def test_the_result_depends_on_neither_order_nor_run() -> None:
    land = [
        blob((0.1 * i, 0.09 * j), [0.01, 0.02, 0.012, 0.016], 1, i)
        for i in (1, 2, 3)
        for j in (1, 3)
    ]
    one, two = _run(land), _run(land)
    assert [p.wkb for p in one.polygons] == [p.wkb for p in two.polygons]
    other = _run(land[::-1])
    assert other.vertices == one.vertices


def test_a_lone_rock_becomes_a_few_corners() -> None:
    rock = shapely.Point(0.25, 0.25).buffer(0.0001)
    result = _run([rock], tolerance_m=100.0)
    (polygon,) = result.polygons
    assert len(polygon.exterior.coords) - 1 <= 8
    _assert_covers(result, [rock], 60.0)
    assert PLANE.geometry_to_plane(polygon).area < (2 * (11 + 60 + 100)) ** 2
    assert result.inner_polygons == ()


def test_no_land_no_polygons() -> None:
    result = _run([])
    assert result.polygons == ()
    assert result.inner_polygons == ()


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
    result = _run(land)
    _assert_covers(result, land, 60.0)
    assert len(result.polygons) == 1


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
        tolerance_m=400.0,
    )
    assert there.vertices == here.vertices
    back = shapely.affinity.translate(shapely.MultiPolygon(there.polygons), -179.8)
    apart = back.symmetric_difference(shapely.MultiPolygon(here.polygons))
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
    assert result.margin_m == used
    assert bool(result.notes) is noted
    if noted:
        assert "10 m, but the coast may be off by 25 m" in note_text(result.notes[0])


def test_the_margin_is_in_true_metres_at_70_degrees() -> None:
    region = shapely.box(5.0, 68.0, 55.0, 74.0)
    island = shapely.box(30.0, 70.0, 31.0, 70.3)
    result = simplify_land([island], region, margin_m=2_000.0, tolerance_m=0.0)
    edge = shapely.segmentize(shapely.union_all(result.polygons).boundary, 0.001)
    shore = shapely.get_coordinates(shapely.segmentize(island.exterior, 0.01))
    apart = [
        GEOD.inv(*np.broadcast_to(at, shore.shape).T, *shore.T)[2].min()
        for at in shapely.get_coordinates(edge)[::20]
    ]
    assert 2_000.0 <= min(apart) < 2_105.0


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


def test_lakes_are_filled_unless_start_or_goal_lies_on_one() -> None:
    lake = shapely.box(0.2, 0.2, 0.3, 0.3)
    island = shapely.Polygon(shapely.box(0.1, 0.1, 0.4, 0.4).exterior, [lake.exterior])
    sea, inland = (0.02, 0.02), (0.25, 0.25)
    (filled,) = _run([island], endpoints=[sea, (0.48, 0.48)]).polygons
    assert not filled.interiors
    (kept,) = _run([island], endpoints=[sea, inland]).polygons
    assert len(kept.interiors) == 1
    assert not kept.covers(shapely.Point(inland))


def test_a_harbour_stays_open_with_a_note() -> None:
    # A bay of 4 km behind a mouth of 300 m, start inside; the margin is 1 km.
    bay = shapely.union(shapely.box(0.2, 0.2, 0.24, 0.24), shapely.box(0.1, 0.2187, 0.21, 0.2214))
    mainland = shapely.box(0.12, 0.1, 0.4, 0.4).difference(bay)
    start, goal = (0.22, 0.22), (0.05, 0.45)
    result = _run([mainland], margin_m=1000.0, tolerance_m=1000.0, endpoints=[start, goal])
    _assert_covers(result, [mainland], 0.0)
    water = EXTENT.difference(shapely.union_all(_planar(result)))
    endpoints = shapely.points(PLANE.to_plane([start, goal]))
    assert any(shapely.intersects(part, endpoints).all() for part in shapely.get_parts(water))
    (note,) = note_texts(result.notes)
    assert "the margin of 1000 m would close every passage between start and goal" in note
    place, width = note.split("the narrowest place, at ")[1].split(", is ")
    assert 290 < int(width.removesuffix(" m wide")) < 305
    lon, lat = place.replace("E", "").replace("N", "").split()
    assert 0.12 < float(lon) < 0.21
    assert 0.2187 < float(lat) < 0.2214
    closed = _run([mainland], margin_m=1000.0, tolerance_m=1000.0, endpoints=[goal, (0.45, 0.05)])
    assert closed.notes == ()
    assert shapely.union_all(_planar(closed)).covers(endpoints[0])


def test_endpoints_that_land_parts_stay_apart_and_one_on_land_stays_there() -> None:
    wall = shapely.box(0.24, -0.1, 0.26, 0.6)
    apart = _run([wall], endpoints=[(0.1, 0.1), (0.4, 0.4)])
    assert apart.notes == ()
    _assert_covers(apart, [wall], 60.0)
    ashore = _run([wall], endpoints=[(0.25, 0.1), (0.4, 0.4)])
    _assert_covers(ashore, [wall], 60.0)


def test_a_start_inside_the_margin_keeps_half_of_its_distance() -> None:
    land = [shapely.box(0.2, 0.2, 0.3, 0.3)]
    start = (0.2 - 40 / 111_320, 0.25)  # 40 m off the quay
    result = _run(land, endpoints=[start, (0.05, 0.05)])
    no_go = shapely.union_all(_planar(result))
    assert no_go.distance(shapely.Point(PLANE.to_plane(start))) > 5
    _assert_covers(result, land, 15.0)


@pytest.mark.parametrize(
    ("accuracy", "radius", "diagonal", "tolerance"),
    [(60.0, 17.0, 200e3, 60.0), (60.0, 1600.0, 200e3, 200.0), (60.0, 17.0, 4000e3, 200.0)],
    ids=["accuracy", "turning radius", "size"],
)
def test_the_tolerance_follows_from_what_matters_most(
    accuracy: float, radius: float, diagonal: float, tolerance: float
) -> None:
    assert chosen_tolerance_m(accuracy, radius, diagonal) == pytest.approx(tolerance)


def test_the_work_grows_no_faster_than_n_log_n() -> None:
    """A coast with 16 times the vertices and islands takes 16 times as long, and a bit for log n.

    CPU time, the least of three; half as much again is left for the machine's other work.
    """

    def seconds(side: int) -> float:
        land = [
            blob((0.5 * (i + 0.5) / side, 0.5 * (j + 0.5) / side), radii / side, 1, i * j)
            for i in range(side)
            for j in range(side)
        ]
        took = []
        for _ in range(3):
            began = time.process_time()
            _run(land, tolerance_m=60.0, endpoints=[(0.001, 0.001), (0.499, 0.499)])
            took.append(time.process_time() - began)
        return min(took)

    radii = 0.2 * (1 + 0.1 * np.cos(np.arange(60) * 2.4))
    few, many = seconds(7), seconds(28)
    exponent = math.log(many / few) / math.log(16)
    # d log(n log n) / d log n is 1 + 1 / log n: 1.11 at 10,000 vertices.
    assert exponent < 1.11 + math.log(1.5) / math.log(16)


# --- The check of simplified land ---


NO_ENDPOINTS = np.empty((0, 2))


def test_check_names_every_fault() -> None:
    land, none = _array(shapely.box(0, 0, 100, 100)), _array()
    good = _array(shapely.box(-1, -1, 101, 101))
    check(good, _array(shapely.box(1, 1, 99, 99)), land, np.array([[200.0, 200.0]]), PLANE)
    bowtie = _array(shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]))
    with pytest.raises(StageError) as caught:
        check(bowtie, bowtie, land, NO_ENDPOINTS, PLANE)
    assert "1 outer polygons are invalid" in str(caught.value)
    assert "1 inner polygons are invalid" in str(caught.value)
    half = _array(shapely.box(0, 0, 50, 100), shapely.box(50, 0, 60, 100))
    with pytest.raises(StageError) as caught:
        check(half, good, land, np.array([[50.0, 50.0], [150.0, 50.0]]), PLANE)
    assert "4000 m² of land are uncovered" in str(caught.value)
    assert "404 m² of inner land lie outside the land" in str(caught.value)
    # The middle of the uncovered part, which is the right half.
    lon, lat = PLANE.to_lonlat((80.0, 50.0))
    assert f"uncovered, at {lon:.4f} E {lat:.4f} N" in str(caught.value)
    lon, lat = PLANE.to_lonlat((200.0, 100.0))
    place = f"at {lon:.4f} E {lat:.4f} N"
    with pytest.raises(StageError, match=f"1 of starts and goals are covered by land, {place}"):
        check(shapely.buffer(good, 200), none, land, np.array([[200.0, 100.0]]), PLANE)


def _array(*polygons: shapely.Polygon) -> Geometries:
    return np.array(polygons, dtype=object)


# --- The simplified land of real coasts ---


MINDORO_SIDE, WEST_SIDE = (120.42, 12.4), (119.77, 12.0)
BUSUANGA = shapely.box(119.75, 11.75, 120.45, 12.45)


@pytest.fixture(scope="module")
def busuanga() -> Land:
    """Return the real land around Busuanga and Culion: about 400 islands."""
    return OsmLand().land(BUSUANGA)


def test_real_islands(busuanga: Land) -> None:
    result = simplify_land(
        busuanga.polygons,
        BUSUANGA,
        accuracy_m=busuanga.accuracy_m,
        turning_radius_m=17.0,
        endpoints=[MINDORO_SIDE, WEST_SIDE],
    )
    simplified = result
    assert simplified.tolerance_m == simplified.margin_m == 60.0
    plane = Projection.for_region(BUSUANGA)
    extent = plane.geometry_to_plane(BUSUANGA)
    land = shapely.union_all(plane.geometry_to_plane(np.array(busuanga.polygons, dtype=object)))
    polygons, inner = (
        plane.geometry_to_plane(np.array(some, dtype=object))
        for some in (simplified.polygons, simplified.inner_polygons)
    )
    no_go = shapely.union_all(polygons)
    assert land.intersection(extent).difference(no_go).area == 0
    assert len(shapely.get_parts(no_go)) == len(polygons)
    assert shapely.union_all(inner).difference(land).area < 1e-3
    endpoints = shapely.points(plane.to_plane([MINDORO_SIDE, WEST_SIDE]))
    # Water that is enclosed at this distance may have become land.
    far = shapely.get_parts(extent.difference(land.buffer(121.0)))
    (sea,) = far[shapely.intersects(far[:, None], endpoints).all(axis=1)]
    assert no_go.intersection(sea).area == 0
    assert not shapely.intersects(no_go, endpoints).any()


@pytest.mark.slow
def test_straits_of_the_cyclades_are_water() -> None:
    """Naxos–Donousa and Amorgos–Kinaros, 16 and 17 km wide, which became land once."""
    region = shapely.box(22.5, 35.0, 29.0, 38.5)
    ends = [(23.6, 37.85), (28.3, 36.5)]
    land = OsmLand().land(region)
    result = simplify_land(
        land.polygons, region, accuracy_m=land.accuracy_m, turning_radius_m=17.0, endpoints=ends
    )
    plane = Projection.for_region(region)
    polygons = plane.geometry_to_plane(np.array(result.polygons, dtype=object))
    water = shapely.get_parts(
        plane.geometry_to_plane(region).difference(shapely.union_all(polygons))
    )
    straits = [(25.69, 37.15), (26.18, 36.96)]
    places = shapely.points(plane.to_plane([*ends, *straits]))
    assert shapely.intersects(water[:, None], places).all(axis=1).sum() == 1
    # As wide as they are, less margin and tolerance.
    assert shapely.distance(polygons[:, None], places[2:]).min() > 4_000
    assert len(result.inner_polygons) > 100
