"""The corridor of a class: what its legs must avoid, and where it is blocked."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st
from shapely import box

import renew
from renew.errors import InfeasibleError
from renew.inputs.options import Padding
from renew.paths.corridor import SLACK
from renew.paths.least_fuel_path import path_through_sections
from tests.renew.paths.scenes import corridor_in_scene, corridor_of
from tests.strategies import PAPER_VESSEL, voyage_on

STRAIT = renew.Chart(box(0, 0, 100, 100), [box(0, 45, 47, 55), box(53, 45, 100, 55)])
HARBOUR = renew.Chart(box(0, 0, 100, 100), [box(0, 20, 8, 80)])


@pytest.mark.parametrize("padding", ["adaptive", "none", 1e-300])
@settings(max_examples=12)
@given(
    scene=st.integers(0, 3), seed=st.integers(0, 10_000), wander=st.sampled_from([3.0, 10.0, 60.0])
)
def test_clear_legs_are_those_that_shapely_finds_outside_the_padding(
    padding: Padding, scene: int, seed: int, wander: float
) -> None:
    corridor = corridor_in_scene(scene, padding)
    start, goal = corridor.voyage.start, corridor.voyage.goal
    rng = np.random.default_rng(seed)
    middle = corridor.channel.midline(start, goal)
    path = np.vstack([start, middle[1:-1] + rng.normal(0, wander, middle[1:-1].shape), goal])
    legs = shapely.linestrings(np.stack([path[:-1], path[1:]], axis=1))
    edges = corridor.padded
    land = shapely.linestrings(np.stack([edges.start, edges.end], axis=1))
    # Edges without padding, and the corridor's outline, may not even be touched; and a padding
    # thinner than rounding must not let a leg through.
    distance = shapely.distance(legs[:, None], land)
    entered = (distance < edges.padding) | ((edges.padding == 0) & (distance == 0))
    outline = shapely.multilinestrings(shapely.linestrings(corridor.open_outline))
    expected = ~entered.any(axis=1) & ~shapely.intersects(legs, outline)
    assert not corridor.exempt.any()
    assert corridor.legs_clear(path).tolist() == expected.tolist()


def test_the_first_leg_may_leave_the_padding_around_the_start_and_no_other_may_enter_it() -> None:
    voyage = voyage_on(HARBOUR, (9.0, 50.0), (90.0, 50.0))
    corridor = corridor_of(voyage)
    assert corridor.exempt[0].any()
    assert not corridor.exempt[1].any()
    out = np.array([[9.0, 50.0], [20.0, 50.0], [90.0, 50.0]])
    assert corridor.legs_clear(out).tolist() == [True, True]
    back_again = np.array([[9.0, 50.0], [20.0, 50.0], [9.0, 60.0], [90.0, 50.0]])
    assert corridor.legs_clear(back_again).tolist() == [True, False, False]
    # A leg that begins elsewhere in that padding is not permitted.
    assert corridor.legs_clear(np.array([[9.0, 51.0], [90.0, 50.0]])).tolist() == [False]


def test_legs_near_a_goal_on_the_edge_of_the_chart_stay_on_the_chart() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), [box(90, 40, 97, 42)])
    corridor = corridor_of(voyage_on(chart, (50.0, 90.0), (100.0, 42.0)))
    assert corridor.exempt[1].any()
    ends = np.array([[50.0, 90.0], [98.5, 52.0], [99.5, 44.5], [99.9, 42.5], [100.0, 42.0]])
    assert corridor.legs_clear(ends).all()
    ends[3, 0] = 100.1
    assert corridor.legs_clear(ends).tolist() == [True, True, False, True]


def test_several_legs_may_lie_in_the_padding_around_an_end() -> None:
    corridor = corridor_of(voyage_on(HARBOUR, (90.0, 50.0), (9.0, 50.0)))
    path = np.array([[90.0, 50.0], [20.0, 52.0], [10.0, 51.0], [9.5, 50.2], [9.0, 50.0]])
    assert corridor.legs_clear(path).all()
    straight = corridor.straight_in_soft_ends(path)
    assert np.delete(straight, 2, axis=0).tolist() == path[[0, 1, 4]].tolist()
    # The leg in the padding ends just outside it.
    edges = shapely.linestrings(np.stack([corridor.padded.start, corridor.padded.end], axis=1))
    beyond = shapely.distance(edges, shapely.Point(straight[2])) - corridor.padded.padding
    assert 0 < beyond.min() < 3 * SLACK * PAPER_VESSEL.turning_radius
    # Beyond the point that lies outside, no leg in the padding is permitted.
    detour = np.insert(path, 1, [[40.0, 50.0], [9.0, 55.0]], axis=0)
    assert corridor.legs_clear(detour).tolist() == [True, False, False, True, True, True]


def test_a_path_through_other_padding_takes_the_shortest_way_out_of_the_padding_at_its_end() -> (
    None
):
    # North of the goal, another pier's padding adjoins the shore's.
    piers = [box(0, 20, 8, 44), box(0, 44, 2, 56), box(0, 56, 8, 80)]
    chart = renew.Chart(box(0, 0, 100, 100), piers)
    corridor = corridor_of(voyage_on(chart, (9.5, 98.0), (9.0, 43.0)))
    assert corridor.exempt[1].any()
    path = np.array([[9.5, 98.0], [9.5, 58.0], [9.0, 43.0]])
    straight = corridor.straight_in_soft_ends(path)
    assert straight[[0, 1, -1]].tolist() == path.tolist()
    assert corridor.legs_clear(straight)[-1]
    edges = shapely.linestrings(np.stack([corridor.padded.start, corridor.padded.end], axis=1))
    assert (shapely.distance(edges, shapely.Point(straight[-2])) > corridor.padded.padding).all()


def test_no_way_out_of_the_padding_leads_over_the_edge_of_the_chart() -> None:
    # The goal lies on the edge of the chart, behind a pier. Beyond the edge there is no padding.
    chart = renew.Chart(box(0, 0, 100, 100), [box(40, 90, 60, 99)])
    corridor = corridor_of(voyage_on(chart, (90.0, 50.0), (50.0, 100.0)))
    path = np.array([[90.0, 50.0], [50.0, 85.0], [50.0, 100.0]])
    straight = corridor.straight_in_soft_ends(path)
    assert shapely.covers(chart.extent, shapely.points(straight)).all()


def test_a_passing_edge_that_only_the_capsules_around_an_end_block_shuts_no_way_out() -> None:
    # The first passing edge joins the two heads of a cove, close to its shore.
    cove = shapely.Polygon([(0, 20), (8, 20), (10, 45), (8, 50), (10, 55), (8, 80), (0, 80)])
    chart = renew.Chart(box(0, 0, 100, 100), [cove])
    corridor = corridor_of(voyage_on(chart, (8.5, 50.0), (90.0, 50.0)))
    _, free = corridor.open_sections(np.inf, np.inf)
    assert not free.blocked.any()
    path = path_through_sections(corridor)
    assert corridor.legs_clear(path).all()


@pytest.mark.parametrize("padding", [2.0, 2.9])
def test_sections_across_a_strait_are_free_between_the_paddings(padding: float) -> None:
    corridor = corridor_of(voyage_on(STRAIT, (50.0, 10.0), (50.0, 90.0)), padding)
    sections, free = corridor.open_sections(np.inf, np.inf)
    assert not free.blocked.any()
    widths = np.linalg.norm(sections.right - sections.left, axis=1)
    narrow = int(np.argmin(widths))
    assert widths[narrow] == pytest.approx(6)
    low, high = free.intervals[narrow, 0] * 6
    kept_off = padding + SLACK * PAPER_VESSEL.turning_radius
    assert (low, 6 - high) == pytest.approx((kept_off, kept_off))


def test_a_blocked_corridor_names_its_strait() -> None:
    corridor = corridor_of(voyage_on(STRAIT, (50.0, 10.0), (50.0, 90.0)), 3.2)
    with pytest.raises(InfeasibleError, match=r"blocked at \(50, \d+\) m") as caught:
        corridor.open_sections(5.0, 0.3)
    strait = caught.value.strait
    assert strait is not None
    assert strait.width == pytest.approx(6)
    assert np.sort(strait.gap[:, 0]) == pytest.approx([47, 53])
    assert (strait.padding_left, strait.padding_right) == pytest.approx((3.2, 3.2))
    assert strait.transition in corridor.channel.transitions
