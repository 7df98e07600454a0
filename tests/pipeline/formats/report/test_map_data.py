from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.geometry.base import BaseGeometry

from pipeline.findings.result import RunResult
from pipeline.formats.report.map_data import Lattice, map_data
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
            assert decoded(route["fuel"])[-1] == pytest.approx(r.metrics.fuel, rel=1e-9)
            assert decoded(route["time"])[-1] == pytest.approx(r.metrics.duration_s, rel=1e-9)
            assert decoded(route["distance"])[-1] == pytest.approx(r.metrics.length_m, rel=1e-4)
            clearance = decoded(route["clearance"])
            assert clearance.min() == pytest.approx(r.metrics.clearance_m, rel=0.01)
            soft = filled([plane(result, ring) for ring in route["soft"]])
            zone = r.route.soft_no_go.intersection(result.water.chart.extent)
            assert soft.symmetric_difference(zone).area < 0.05 * zone.area


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
        places = corner + current["spacing"] * lattice.step * np.stack([column, row], axis=-1)
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
