"""Verification by hard-over turns against a twin that flies every turn and asks shapely."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from shapely import box

import renew
from renew._types import FloatArray
from renew.inputs.current import as_field
from renew.inputs.options import RiskAt
from renew.turns.contingency import fly_turns, stations
from renew.turns.padding_model import PaddedEdges
from renew.turns.turn_reach import MAX_DEVIATIONS, TurnReach
from renew.turns.verification import colliding_edges
from renew.voyage.voyage import Voyage
from tests.renew.turns.test_turn_reach import begun
from tests.strategies import (
    PAPER_VESSEL,
    SIZE,
    StreamFunctionCurrent,
    random_islands,
    random_scene,
    seeds,
    voyage_on,
)

MARGIN = 0.05 * PAPER_VESSEL.turning_radius


def shores(chart: renew.Chart, padding: float) -> PaddedEdges:
    """All edges of the islands, each with the same padding (m)."""
    rings = [shapely.get_coordinates(island.exterior) for island in chart.no_go]
    start = np.concatenate([ring[:-1] for ring in rings])
    end = np.concatenate([ring[1:] for ring in rings])
    widths = np.full(len(start), padding)
    return PaddedEdges.of(start, end, widths, np.arange(len(start)) + 7)


def verify(path: FloatArray, voyage: Voyage, padded: PaddedEdges) -> dict[int, float]:
    """Growth (m) that each colliding edge needs."""
    reach = TurnReach.of(voyage.table, voyage.vessel)
    found = colliding_edges(path, [voyage], padded, reach)
    growth: dict[int, float] = {}
    for edge, by in zip(*found, strict=True) if found else ():
        growth[int(edge)] = max(by, growth.get(int(edge), 0.0))
    return growth


@settings(max_examples=8)
@given(seed=seeds)
def test_it_finds_the_edges_that_flying_every_turn_finds(seed: int) -> None:
    chart = renew.Chart(box(0, 0, SIZE, SIZE), random_islands(seed))
    rng = np.random.default_rng(seed)
    path = np.vstack([[10.0, 10.0], np.sort(rng.uniform(20, 180, (3, 2)), axis=0), [190.0, 190.0]])
    voyage = voyage_on(chart, path[0], path[-1], StreamFunctionCurrent(seed, 0.5))
    padded = shores(chart, 0.5)
    growth = verify(path, voyage, padded)

    points, course = stations(path, 0.6 * PAPER_VESSEL.turning_radius)
    corners = [[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]]
    deviations = MAX_DEVIATIONS * np.array([corners], dtype=float)
    turns = fly_turns(
        begun(points, course), voyage.waters.quick_current, PAPER_VESSEL, deviations, steps=24
    )
    tracks = shapely.linestrings(turns.reshape(-1, *turns.shape[2:]))
    edges = shapely.linestrings(np.stack([padded.start, padded.end], axis=1))
    tree = shapely.STRtree(tracks)
    touched = {
        int(padded.edge[edge])
        for edge in range(len(edges))
        if len(tree.query(edges[edge], predicate="dwithin", distance=MARGIN))
    }
    assert set(growth) == touched
    # An edge grows by what lets its deepest turn come clear, and a little more.
    assert all(by >= 2 * MARGIN - 1e-9 for by in growth.values())


def test_padding_that_keeps_turns_off_needs_no_growth_and_less_needs_what_it_lacks() -> None:
    wall = box(-1, 60, 101, 80)
    chart = renew.Chart(box(0, 0, 100, 100), [wall])
    voyage = voyage_on(chart, (10.0, 50.0), (90.0, 50.0))
    padded = shores(chart, 1.0)
    width = 2 * PAPER_VESSEL.turning_radius
    for distance, lacking in ((width + 3 * MARGIN, 0.0), (width - 1.0, 1.0)):
        path = np.array([[10.0, 60 - distance], [90.0, 60 - distance]])
        growth = verify(path, voyage, padded)
        assert bool(growth) == (lacking > 0)
        if growth:
            assert max(growth.values()) == pytest.approx(1.3 * lacking + 2 * MARGIN, rel=0.02)


def test_turns_around_a_start_inside_the_padding_are_not_held_against_it() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(0, 20, 8, 80)])
    voyage = voyage_on(chart, (9.0, 50.0), (90.0, 50.0))
    path = np.array([[9.0, 50.0], [90.0, 50.0]])
    assert not verify(path, voyage, shores(chart, 3.5))
    # The same path from a start outside the padding would be refused.
    assert verify(path, voyage, shores(chart, 0.5))


def test_without_land_there_is_nothing_to_touch() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [])
    voyage = voyage_on(chart)
    ends, width = np.empty((0, 2)), np.empty(0)
    none = PaddedEdges.of(ends, ends, width, np.empty(0, dtype=np.int64))
    assert not verify(np.array([voyage.start, voyage.goal]), voyage, none)


RISK, DRAWS = 0.05, 500


def shares_that_touch(
    route: renew.Route, chart: renew.Chart, current: renew.CurrentField
) -> FloatArray:
    """Shares (n,) of turns drawn every 2 m of a route that touch land.

    Left out are points in V around a start or goal that lies in V itself.
    """
    rng = np.random.default_rng(1)
    land = chart.hard_no_go
    shapely.prepare(land)
    points, course = stations(route.path, 2.0)
    triangles = shapely.polygons(route.corners)
    tree = shapely.STRtree(triangles)
    v, w = PAPER_VESSEL.speed, PAPER_VESSEL.turn_rate
    time = np.linspace(0, PAPER_VESSEL.turn_period, 73)
    parts = [
        part
        for part in shapely.get_parts(route.soft_no_go)
        if part.intersects(shapely.MultiPoint(route.path[[0, -1]]))
    ]
    shares = []
    for point, heading in zip(points, course, strict=True):
        place = shapely.Point(point)
        if any(part.intersects(place) for part in parts) or place.distance(land) > 12.0:
            continue
        own = tree.query(place, predicate="intersects")[:1]
        s = as_field(current).statistics(route.corners[own])
        speed = np.maximum(0.0, rng.normal(s.speed[0], s.speed_std[0], DRAWS))
        towards = rng.normal(s.direction[0], s.direction_std[0], DRAWS)
        drift = speed[:, None] * np.stack([np.cos(towards), np.sin(towards)], axis=-1)
        begin = heading + rng.uniform(-np.radians(20), np.radians(20), DRAWS)
        touched = np.zeros(DRAWS, dtype=bool)
        for side in (1.0, -1.0):
            turned = begin[:, None] + side * w * time
            circle = np.stack(
                [np.sin(turned) - np.sin(begin)[:, None], np.cos(begin)[:, None] - np.cos(turned)],
                axis=-1,
            )
            track = point + side * v / w * circle + drift[:, None] * time[:, None]
            touched |= shapely.intersects(shapely.linestrings(track), land)
        shares.append(touched.mean())
    return np.array(shares)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", [18, 19])
def test_from_no_point_more_turns_reach_land_than_the_risk_allows(seed: int) -> None:
    scene = random_scene(seed, 0.85)

    def worst(risk_at: RiskAt) -> float:
        plan = scene.plan(classes=2, risk=RISK, risk_at=risk_at)
        return float(
            max(shares_that_touch(route, scene.chart, scene.current).max() for route in plan.routes)
        )

    # Three standard deviations of a share of as many draws.
    error = 3 * np.sqrt(RISK * (1 - RISK) / DRAWS)
    assert worst("route") > RISK + error
    assert worst("point") <= RISK + error


def test_a_risk_at_every_point_needs_adaptive_padding() -> None:
    scene = random_scene(0)
    with pytest.raises(renew.ParameterError, match=r'needs padding = "adaptive", not 2\.0'):
        scene.plan(padding=2.0, risk_at="point")
