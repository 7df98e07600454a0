"""Padding fitted to the turns of a path, and ways of free turns that padding shuts."""

import math
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import box

import renew
from renew.planner import fit
from renew.turns.padding_model import PaddedEdges
from tests.strategies import PAPER_VESSEL, Scene, random_scene, voyage_on

# A turning circle to either side of a straight way is four times v/ω wide together.
BOTH_CIRCLES = 4 * PAPER_VESSEL.turning_radius


def collisions(scene: Scene[Any], route: renew.Route, seed: int) -> int:
    """Turns that meet land, of turns begun every 0.25 m, closer than the planner's stations."""
    return renew.contingency(
        route, scene.chart, scene.current, PAPER_VESSEL, spacing=0.25, seed=seed, drift=scene.drift
    ).collisions


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", [0, 1, 4, 18, 21])
def test_padding_fitted_to_turns_costs_less_fuel_and_no_safety(seed: int) -> None:
    scene = random_scene(seed)
    published, fitted = (scene.plan(classes=4, padding=name) for name in ("triangle", "adaptive"))
    assert fitted.best.fuel < published.best.fuel * (1 - 5e-4)
    for route in fitted.routes:
        assert collisions(scene, route, seed + 1) == 0
        # V is what the route keeps out of, so it is narrower where the route is nearer to land.
        inside = shapely.intersection(shapely.LineString(route.path), route.soft_no_go)
        assert inside.length < 0.02


def strait(width: float, current: tuple[float, float], **options: Any) -> renew.Plan:
    """Plan across a strait of a width (m) between two walls, which the current sets along."""
    middle = 30.0
    walls = [box(27, 0.5, 33, middle - width / 2), box(27, middle + width / 2, 33, 59.5)]
    chart = renew.Chart(box(0, 0, 60, 60), walls)
    ends = (8.0, middle), (52.0, middle)
    return renew.plan(chart, renew.UniformCurrent(*current), PAPER_VESSEL, *ends, **options)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("along", [0.4, -0.4])
def test_a_strait_is_passed_once_both_turning_circles_have_room(along: float) -> None:
    # A current along a strait moves no turn towards its banks, whatever its padding for turns on
    # other headings.
    wide, narrow = BOTH_CIRCLES + 0.45, BOTH_CIRCLES - 0.05
    with pytest.raises(renew.UnreachableError):
        strait(wide, (along, 0.0), padding="triangle")
    assert strait(wide, (along, 0.0)).best.fuel == pytest.approx(44 / (1 + along), rel=1e-3)
    with pytest.raises(renew.UnreachableError, match="rejected"):
        strait(narrow, (along, 0.0))


def test_a_strait_that_no_padding_leaves_open_is_passed_across_the_current() -> None:
    with pytest.raises(renew.UnreachableError):
        strait(8.0, (0.0, 0.3), padding="triangle")
    plan = strait(8.0, (0.0, 0.3))
    assert plan.best.fuel == pytest.approx(44.0, rel=5e-3)
    assert math.isfinite(plan.best.clearance)


@pytest.mark.gate_share(2)
@pytest.mark.parametrize("seed", range(6))
def test_asking_for_more_classes_or_more_risk_never_loses_the_best_way(seed: int) -> None:
    scene = random_scene(seed)
    least = scene.plan(classes=2).best.fuel
    assert scene.plan(classes=12).best.fuel <= least * 1.001
    assert scene.plan(classes=2, risk=0.3).best.fuel <= least * 1.001


def test_padding_that_turns_need_does_not_grow_over_an_end() -> None:
    # Turns that begin in padding around an end are not judged: it must not come to lie in one.
    voyage = voyage_on(renew.Chart(box(0, 0, 100, 100), [box(20, 0, 30, 80)]), (18.0, 40.0))
    y = np.arange(30.0, 50.0)
    start, end = (np.column_stack([np.full(20, 20.0), y + step]) for step in (0.0, 1.0))
    edges = PaddedEdges.of(start, end, np.ones(20), np.arange(20))
    limits = np.zeros(20), fit._most(edges, voyage)
    grown = fit._toward(edges, np.full(20, 5.0), limits, 1.0)
    assert grown.padding.max() == 5.0
    assert grown.padding.min() == pytest.approx(0.95 * 2.0)
    assert not len(grown.around(voyage.start).edge)


def test_a_clearance_is_kept_where_turns_need_less() -> None:
    scene = random_scene(4)
    free, kept = scene.plan(classes=1).best, scene.plan(classes=1, clearance=6.0).best
    assert free.clearance < 5.0
    assert kept.clearance > 6.0 * 0.99
    assert np.all(kept.padding_used[:, 4] >= 6.0 - 1e-9)


def test_padding_by_triangles_is_an_option_with_its_own_figures() -> None:
    scene = random_scene(1)
    published = scene.plan(classes=1, padding="triangle").best
    assert len(np.unique(published.padding_used[:, :4], axis=0)) <= 3 * sum(
        len(polygon.exterior.coords) for polygon in scene.chart.no_go
    )
    with pytest.raises(renew.ParameterError, match='"adaptive", "triangle", "none"'):
        scene.plan(padding="leg")


def test_a_vessel_that_turns_on_the_spot_is_planned_as_soon_as_any() -> None:
    # Edges were cut into pieces of v/ω: hundreds of millions, for which there is no memory.
    scene = random_scene(0)
    vessel = renew.Vessel(PAPER_VESSEL.speed, 1e6, PAPER_VESSEL.length)
    plan = renew.plan(scene.chart, scene.current, vessel, scene.start, scene.goal, classes=1)
    assert plan.best.fuel < scene.plan(classes=1).best.fuel
