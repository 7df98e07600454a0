"""What the page's map gets, and how it is encoded."""

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp
from shapely.geometry.base import BaseGeometry

from pipeline.findings.result import RunResult
from pipeline.formats.report.map_data import (
    Lattice,
    coarser,
    map_data,
    series,
    turn_room,
)
from pipeline.geo.coast import within
from pipeline.model import CaseResult, ShoreCrossing
from tests.pipeline.formats import small_run
from tests.pipeline.results import with_measures

LIMITS = (0.2, 0.4)


@pytest.fixture(scope="module")
def data(result: RunResult) -> dict[str, Any]:
    return map_data(result, LIMITS)


def plane(result: RunResult, moves: list[int]) -> np.ndarray:
    """Planar points (n, 2) of an encoded line."""
    lattice = Lattice.of(result.water.chart.bounds, result.water.projection.scale)
    return lattice.origin + lattice.step * np.cumsum(np.reshape(moves, (-1, 2)), axis=0)


def decoded(encoded: dict[str, Any]) -> np.ndarray:
    return np.asarray(encoded["step"] * np.cumsum(encoded["moves"]))


def filled(rings: list[np.ndarray]) -> BaseGeometry:
    """Area of outer rings, which are anticlockwise, less that of the other rings."""
    areas: dict[bool, list[BaseGeometry]] = {True: [], False: []}
    for ring in rings:
        areas[shapely.LinearRing(ring).is_ccw].append(shapely.Polygon(ring).buffer(0))
    return shapely.union_all(areas[True]).difference(shapely.union_all(areas[False]))


def test_the_coast_is_the_original_one(data: dict[str, Any], result: RunResult) -> None:
    drawn = filled([plane(result, ring) for ring in data["land"]])
    land = shapely.union_all(result.water.land).intersection(result.water.chart.extent)
    assert drawn.symmetric_difference(land).area < 1e-4 * land.area


def test_beyond_the_chart_the_map_goes_on(data: dict[str, Any], result: RunResult) -> None:
    """The cape beyond the chart's edge is land of the map; without such land there is no sheet."""
    assert (data["sheet"], data["beyond"]) == ([], [])
    cape = shapely.box(119.9, 9.4, 120.6, 9.6)
    fetched = replace(result.fetched, surroundings=(cape,))
    wider: dict[str, Any] = map_data(replace(result, fetched=fetched), LIMITS)
    assert wider["land"] == data["land"]
    extent = result.water.chart.extent
    sheet = filled([plane(result, ring) for ring in wider["sheet"]])
    beyond = filled([plane(result, ring) for ring in wider["beyond"]])
    around = shapely.union_all(
        [*result.water.land, result.water.projection.geometry_to_plane(cape)]
    )
    assert sheet.contains(extent)
    assert beyond.symmetric_difference(around.difference(extent)).area < 1e-3 * beyond.area
    assert beyond.area > 0


def test_routes_run_from_start_to_goal_with_their_metrics(
    data: dict[str, Any], result: RunResult
) -> None:
    start, goal = plane(result, data["start"])[0], plane(result, data["goal"])[0]
    for season, entry in zip(data["seasons"], result.results, strict=True):
        ranked = result.case(entry.name).routes
        assert [route["rank"] for route in season["routes"]] == [r.rank for r in ranked]
        for route, r in zip(season["routes"], ranked, strict=True):
            places = plane(result, route["places"])
            assert places[0] == pytest.approx(start, abs=1e-3)
            assert places[-1] == pytest.approx(goal, abs=1e-3)
            line = shapely.LineString(places)
            assert line.hausdorff_distance(shapely.LineString(r.route.path)) < 2e-3
            assert decoded(route["fuel"])[-1] == pytest.approx(
                100 * r.metrics.fuel / r.metrics.still_fuel, rel=1e-9
            )
            assert decoded(route["time"])[-1] == pytest.approx(r.metrics.duration_s, rel=1e-9)
            assert decoded(route["distance"])[-1] == pytest.approx(r.metrics.length_m, rel=1e-4)
            clearance = decoded(route["clearance"])
            assert clearance.min() == pytest.approx(r.metrics.clearance_m, rel=0.01)
            assert route["least"] == r.metrics.clearance_m  # what the map writes is the card's
            soft = filled([plane(result, ring) for ring in route["soft"]])
            zone = r.route.soft_no_go.intersection(result.water.chart.extent)
            assert soft.symmetric_difference(zone).area < 0.05 * zone.area


def test_the_room_for_turns_is_apart_where_the_offing_is_wider(
    data: dict[str, Any], result: RunResult
) -> None:
    ranked = result.routes[0]
    assert data["seasons"][0]["routes"][0]["turnRoom"] == []
    padded = ranked.route.padding_used
    fifth = replace(ranked, route=replace(ranked.route, turn_padding=padded[:, 4] / 5))
    [room] = turn_room(fifth)
    assert ranked.route.soft_no_go.buffer(1e-6).covers(room)
    # The edge nearest to the route has its room, and no more to the side of the route.
    edges = shapely.linestrings(padded[:, :4].reshape(-1, 2, 2))
    path = shapely.LineString(ranked.route.path)
    nearest = int(shapely.distance(edges, path).argmin())
    assert room.buffer(1e-6).covers(edges[nearest])
    assert room.distance(path) >= shapely.distance(edges, path).min() - padded[:, 4].max() / 5


def test_arrows_are_on_water_and_show_the_planners_current(
    data: dict[str, Any], result: RunResult
) -> None:
    land = shapely.union_all(result.water.land)
    for season, entry in zip(data["seasons"], result.results, strict=True):
        current = season["current"]
        velocity = np.stack([current["u"], current["v"]], axis=-1) / 100
        assert 100 < len(velocity) <= 7000
        corner = plane(result, current["corner"])[0]
        lattice = Lattice.of(result.water.chart.bounds, result.water.projection.scale)
        row, column = np.divmod(np.arange(len(velocity)), current["columns"])
        places = corner + current["spacing"] * lattice.step / lattice.step_m * np.stack(
            [column, row], axis=-1
        )
        moving = velocity.any(axis=1)
        assert not shapely.contains_xy(land, places[moving]).any()
        asked = result.case(entry.name).case.current(places[moving])
        assert np.abs(velocity[moving] - asked).max() <= 0.0051
        dry = ~moving & shapely.contains_xy(result.water.chart.extent, places)
        still = np.abs(result.case(entry.name).case.current(places[dry])).max(axis=1) <= 0.0051
        assert (shapely.contains_xy(land, places[dry]) | still).all()


def test_every_turn_that_met_land_is_shown(result: RunResult) -> None:
    found, *others = result.case("summer").measures.turns
    collided = np.zeros(len(found.points), dtype=bool)
    collided[::7] = True
    turns = (replace(found, collided=collided), *others)
    changed = with_measures(result, "summer", turns=turns)
    seasons: Any = map_data(changed, LIMITS)["seasons"]
    route = seasons[0]["routes"][0]
    assert plane(result, route["hits"]) == pytest.approx(found.points[collided], abs=1e-3)
    assert len(plane(result, route["turns"])) <= 80


def test_land_of_another_shoreline_is_marked_on_the_route_that_crosses_it(
    result: RunResult,
) -> None:
    crossings = (ShoreCrossing(1, 119.6, 9.4, 2461.0),)
    crossed = with_measures(result, "summer", shore_crossings=crossings)
    encoded: Any = map_data(crossed, LIMITS)
    best, second = encoded["seasons"][0]["routes"][:2]
    (place,) = plane(result, best["shores"])
    assert place == pytest.approx(result.water.projection.to_plane([119.6, 9.4]), abs=1.0)
    assert second["shores"] == []


def test_a_season_without_routes_or_current_is_empty(result: RunResult) -> None:
    gone = replace(
        result,
        results=tuple(CaseResult(one.name, None, "no", 0.0) for one in result.results),
        planned={},
    )
    seasons: Any = map_data(gone, LIMITS)["seasons"]
    assert [(season["current"], season["routes"]) for season in seasons] == [(None, [])] * 2


def test_zones_are_clipped_to_the_chart_and_have_only_their_own_edges(
    data: dict[str, Any], result: RunResult
) -> None:
    assert data["zones"] == []
    zoned = small_run.with_zones(result, rule="no <entry>")
    zones: Any = map_data(zoned, LIMITS)["zones"]
    extent = result.water.chart.extent
    assert [(zone["kind"], zone["text"]) for zone in zones] == [
        ("restricted", "Whale & calf: no <entry>"),
        ("traffic", "Traffic scheme: keep to starboard"),
    ]
    for zone, (_, area) in zip(zones, zoned.open_zones, strict=True):
        inside = area.intersection(extent)
        drawn = filled([plane(result, ring) for ring in zone["area"]])
        assert drawn.symmetric_difference(inside).area < 1e-3 * inside.area
        edges = shapely.multilinestrings([plane(result, edge) for edge in zone["edges"]])
        own = area.boundary.intersection(extent)
        assert edges.hausdorff_distance(own) < 2e-3
        assert edges.length == pytest.approx(own.length, rel=1e-3)
    juts_out = shapely.multilinestrings([plane(result, edge) for edge in zones[0]["edges"]])
    assert juts_out.length < 0.9 * zoned.open_zones[0][1].intersection(extent).length


PLACES = hnp.arrays(
    float, st.tuples(st.integers(1, 30), st.just(2)), elements=st.floats(-3000.0, 9000.0)
)


def read_line(moves: list[int], lattice: Lattice) -> np.ndarray:
    """Decode a line as the page's script does."""
    return lattice.origin + lattice.step * np.cumsum(np.reshape(moves, (-1, 2)), axis=0)


@given(PLACES, st.sampled_from([1.0, 5.0, 1000.0]))
def test_a_line_is_decoded_to_half_a_step(places: np.ndarray, scale: float) -> None:
    lattice = Lattice.of((-3000.0, -3000.0, 9000.0, 5000.0), scale)
    assert 12_000 * scale / lattice.step_m >= 2e5
    assert lattice.step * scale == pytest.approx(lattice.step_m)
    back = read_line(lattice.line(places), lattice)
    steps = lattice.to_steps(places)
    different = [group[0] for group in (list(g) for _, g in itertools.groupby(steps.tolist()))]
    assert len(back) == len(different)
    expected = lattice.origin + lattice.step * np.array(different)
    assert np.abs(back - expected).max() < 1e-6 * 12_000
    assert np.abs(lattice.origin + lattice.step * steps - places).max() <= 0.5001 * lattice.step


def test_outer_rings_are_anticlockwise_and_holes_clockwise() -> None:
    outer = shapely.Point(50, 50).buffer(30)
    holed = shapely.Polygon(outer.reverse().exterior, [shapely.Point(50, 50).buffer(10).exterior])
    lattice = Lattice.of((0.0, 0.0, 100.0, 100.0), 1.0)
    speck = shapely.box(1, 1, 1 + lattice.step / 10, 1 + lattice.step / 10)
    areas = np.array([shapely.MultiPolygon([holed]), speck, shapely.Polygon()], dtype=object)
    shell, hole = (read_line(ring, lattice) for ring in lattice.rings(areas))
    assert shapely.LinearRing(shell).is_ccw
    assert not shapely.LinearRing(hole).is_ccw
    back = shapely.Polygon(shell, [hole])
    assert back.symmetric_difference(holed).area < 1e-3 * holed.area


@given(hnp.arrays(float, st.integers(1, 50), elements=st.floats(-1e6, 1e6)))
def test_a_series_is_decoded_and_its_last_value_is_exact(values: np.ndarray) -> None:
    encoded = series(values)
    step, moves = encoded["step"], encoded["moves"]
    assert isinstance(step, float)
    assert isinstance(moves, list)
    back = step * np.cumsum(moves)
    assert np.abs(back - values).max() <= 0.5001 * step
    assert step <= max(np.abs(values).max() / 50_000, 0) or step == 1.0
    if abs(values[-1]) > 0.1 * np.abs(values).max():
        assert back[-1] == pytest.approx(values[-1], rel=1e-12)


def test_a_series_with_infinite_values_has_no_moves() -> None:
    assert series(np.array([1.0, np.inf]))["moves"] is None


def test_areas_are_clipped_to_the_chart() -> None:
    chart = shapely.box(0, 0, 10, 10)
    areas = np.array(
        [shapely.box(1, 1, 2, 2), shapely.box(8, 8, 12, 12), shapely.box(20, 20, 21, 21)],
        dtype=object,
    )
    assert sorted(shapely.area(within(areas, chart))) == pytest.approx([1.0, 4.0])


def test_a_coast_is_simplified_only_if_it_has_too_many_vertices() -> None:
    coast = np.array([shapely.Point(0, 0).buffer(10, quad_segs=500)], dtype=object)
    assert shapely.get_num_coordinates(coarser(coast, 0.01, 5000)).sum() == 2001
    shorter = coarser(coast, 1e-4, 200)
    assert 20 < shapely.get_num_coordinates(shorter).sum() <= 200
    assert shapely.area(shorter)[0] == pytest.approx(shapely.area(coast)[0], rel=0.01)
    triangle = np.array([shapely.box(0, 0, 1, 1)], dtype=object)
    assert shapely.get_num_coordinates(coarser(triangle, 1e-9, 1)).sum() == 5


def test_islets_are_dropped_before_islands() -> None:
    corners = np.random.default_rng(3).uniform(0, 1000, (3000, 2))
    islets = shapely.box(*corners.T, *(corners + 0.4).T)
    island = shapely.Point(500, 500).buffer(100, quad_segs=20)
    simple = coarser(np.append(islets, island), 0.1, 200)
    assert shapely.is_empty(simple[:-1]).all()
    assert shapely.area(simple[-1]) == pytest.approx(shapely.area(island), rel=0.01)
