"""Paths steered in their corridor: sailable, clear of the padding, and around sharp corners."""

import numpy as np
import pytest
import shapely
from shapely import Polygon, box

import renew
from renew.errors import InfeasibleError
from renew.inputs.options import Padding
from renew.paths.least_fuel_path import path_near, path_through_sections, refined_path
from renew.steering.steer_in_corridor import steer_in_corridor, steer_simplified_in_places
from tests.bounded_scenes import walls
from tests.renew.paths.scenes import corridor_of
from tests.renew.steering.motion import assert_sailable
from tests.strategies import PAPER_VESSEL, STILL, random_scene, voyage_on


def test_unpadded_corners_are_passed_closely_and_can_still_be_steered() -> None:
    island = Polygon([(30, 20), (70, 20), (50, 80)])
    chart = renew.Chart(box(0, 0, 100, 100), [island])
    plan = renew.plan(chart, STILL, PAPER_VESSEL, (10, 50), (90, 50), padding="none")
    assert len(plan.routes) == 2
    for route in plan.routes:
        assert route.clearance < 0.1 * PAPER_VESSEL.turning_radius
        assert not shapely.LineString(route.path).intersects(island.buffer(-1e-6))
        track = shapely.LineString(route.trajectory[:, 1:3])
        assert not track.intersects(island.buffer(-0.01))


@pytest.mark.parametrize("scene", [0, 1, 3, 5])
@pytest.mark.parametrize("padding", ["none", "adaptive", 1.0])
def test_a_steered_path_is_sailable_clear_and_little_longer(scene: int, padding: Padding) -> None:
    chart, current, start, goal = random_scene(scene).parts
    corridor = corridor_of(voyage_on(chart, start, goal, current, "crab"), padding)
    path = refined_path(corridor, path_near(corridor, path_through_sections(corridor)))
    steered, trajectory = steer_in_corridor(path, corridor)
    assert_sailable(trajectory, current, start, goal)
    assert corridor.legs_clear(steered).all()
    before, after = shapely.LineString(path), shapely.LineString(steered)
    assert after.length <= before.length * 1.01
    assert after.hausdorff_distance(before) < 3 * PAPER_VESSEL.turning_radius
    track = shapely.LineString(trajectory[:, 1:3])
    assert not track.intersects(chart.hard_no_go.buffer(-1e-6))


@pytest.mark.parametrize("scene", [4, 12, 22])
def test_convex_corners_close_together_are_rounded_at_next_to_no_cost(scene: int) -> None:
    # An island's corners of 15, 10 and 15 degrees, all within the arc of one.
    voyage = random_scene(scene).voyage
    corridor = corridor_of(voyage, "none")
    assert corridor.channel.found_by is not None
    path = refined_path(corridor, path_near(corridor, corridor.channel.found_by.points))
    steered, _ = steer_in_corridor(path, corridor)
    assert voyage.fuel(steered) <= 1.0005 * voyage.fuel(path)


@pytest.mark.parametrize(
    ("kind", "seed", "most"), [("bay", 2, 1.012), ("serpentine", 5, 1.02), ("serpentine", 6, 1.03)]
)
def test_a_turn_round_the_end_of_a_thin_wall_costs_little_more_than_its_corners(
    kind: str, seed: int, most: float
) -> None:
    # Its two corners are closer together than the discs round which the path turns there are large.
    scene = walls(kind, seed)
    voyage = scene.voyage
    corridor = corridor_of(voyage, "none")
    assert corridor.channel.found_by is not None
    path = refined_path(corridor, path_near(corridor, corridor.channel.found_by.points))
    route = scene.plan(padding="none", classes=4).best
    assert route.fuel <= most * voyage.fuel(path)
    assert_sailable(route.trajectory, voyage.current, voyage.start, voyage.goal)
    track = shapely.LineString(route.trajectory[:, 1:3])
    assert not track.intersects(scene.chart.hard_no_go.buffer(-1e-6))


def test_a_passage_too_narrow_to_round_its_bend_in_is_refused() -> None:
    # A passage 2.2 m wide with a right angle, between an inner and two outer walls.
    inner, south, east = box(-1, 12.2, 47.8, 61), box(-1, -1, 61, 10), box(50, -1, 61, 61)
    chart = renew.Chart(box(0, 0, 60, 60), [inner, south, east])
    corridor = corridor_of(voyage_on(chart, (2.0, 11.1), (48.9, 58.0)), 0.9)
    path = np.array([[2.0, 11.1], [48.9, 11.1], [48.9, 58.0]])
    assert corridor.legs_clear(path).all()
    with pytest.raises(InfeasibleError, match=r"too narrow near .* to round its corners in"):
        steer_in_corridor(path, corridor)


def test_only_the_place_that_cannot_be_steered_is_thinned_more() -> None:
    """A long wave that can be steered, with a kink of 1.3 m in it that can't."""
    chart = renew.Chart(box(0, 0, 120, 60), [box(50, 0, 60, 10)])
    voyage = voyage_on(chart, (5.0, 30.0), (115.0, 30.0))
    corridor = corridor_of(voyage, "none")
    x = np.linspace(5, 115, 111)
    wave = np.column_stack([x, 30 + 2 * np.sin((x - 5) / 110 * 4 * np.pi)])
    kink = wave[x == 40] + np.array([[0, 0], [0.8, 1.3], [1.6, -1.3], [2.4, 0]])
    path = np.vstack([wave[x < 40], kink, wave[x > 43]])
    with pytest.raises(InfeasibleError, match="two opposite turns near"):
        steer_in_corridor(path, corridor)
    steered, trajectory = steer_simplified_in_places(path, corridor)
    assert_sailable(trajectory, STILL, voyage.start, voyage.goal)
    assert shapely.LineString(steered).length < shapely.LineString(path).length
    # Far from the kink the wave stays, to less than a fifth of a metre.
    far = shapely.points(wave[np.abs(x - 41) > 15])
    assert shapely.distance(far, shapely.LineString(steered)).max() < 0.2


def test_the_best_class_among_eddies_as_wide_as_two_turns_is_steered() -> None:
    """Half-waves of 7.7 m: the least-fuel path of the northern class has S-bends too tight to turn.

    Zermelo's isochrones need 165.42 there, on a path that no vessel of this turning radius can
    steer. Without simplifying in places our route of that class needed 171.7, the best of all
    166.1.
    """
    islands = [
        Polygon([(62, 70), (88, 62), (96, 84), (70, 92)]),
        Polygon([(112, 118), (138, 112), (146, 134), (122, 144)]),
    ]
    chart = renew.Chart(box(0, 0, 200, 200), islands)
    current = renew.GyreCurrent(0.8, 200, 200, 26, 26)
    plan = renew.plan(chart, current, PAPER_VESSEL, (20, 15), (185, 180), padding="none", classes=2)
    assert plan.best.fuel < 165.42
    assert_sailable(plan.best.trajectory, current, plan.best.path[0], plan.best.path[-1])
