"""The clearance yields in narrows, there only, and never more than a turn allows."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st

import renew
from tests.strategies import examples

CLEARANCE, SHARE = 100.0, 0.5
VESSEL = renew.Vessel(speed=3.0, turn_rate=0.3)
RADIUS = VESSEL.speed / VESSEL.turn_rate
STILL = renew.UniformCurrent(0.0, 0.0)
EXTENT = shapely.box(0, 0, 6000, 2000)
START, GOAL = (200.0, 300.0), (5800.0, 300.0)


def wall(x: float, width: float, middle: float = 1000.0) -> list[shapely.Polygon]:
    """Return a wall 400 m thick at x, with a gap of some width."""
    return [
        shapely.box(x, -10, x + 400, middle - width / 2),
        shapely.box(x, middle + width / 2, x + 400, 2010),
    ]


def planned(chart: renew.Chart, **options: object) -> renew.Route:
    return renew.plan(chart, STILL, VESSEL, START, GOAL, classes=1, **options).best  # type: ignore[arg-type]


def apart(route: renew.Route, chart: renew.Chart, water: shapely.Polygon) -> float:
    """Return the least distance from land of the part of a route in some water."""
    line = shapely.LineString(route.path).intersection(water)
    return float(shapely.distance(line, shapely.union_all(chart.no_go)))


@pytest.mark.parametrize("width", [180.0, 120.0, 60.0, 45.0])
def test_the_offing_is_reduced_in_a_strait_to_a_share_of_the_half_width(width: float) -> None:
    chart = renew.Chart(EXTENT, [*wall(2000, width), *wall(4000, 700)])
    with pytest.raises(renew.UnreachableError):
        planned(chart, clearance=CLEARANCE)
    route = planned(chart, clearance=CLEARANCE, narrow_share=SHARE)
    wanted = max(SHARE * width / 2, 2 * RADIUS)
    inside = apart(route, chart, shapely.box(1990, 0, 2410, 2000))
    assert wanted * 0.95 <= inside < width / 2 + 1
    # In the wide passage, and far from the narrow one, it keeps the whole clearance.
    assert apart(route, chart, shapely.box(2900, 0, 6000, 2000)) >= CLEARANCE
    beside = apart(route, chart, shapely.box(0, 0, 1900, 2000))
    assert beside >= SHARE * 100


def test_the_padding_for_turns_is_never_reduced() -> None:
    chart = renew.Chart(EXTENT, wall(2000, 3.8 * RADIUS))
    with pytest.raises(renew.UnreachableError, match=r"padding takes 20\.00 m"):
        planned(chart, clearance=CLEARANCE, narrow_share=SHARE)


def test_where_the_clearance_fits_nothing_changes() -> None:
    chart = renew.Chart(EXTENT, [*wall(2000, 420), *wall(4000, 700)])
    one = planned(chart, clearance=CLEARANCE)
    other = planned(chart, clearance=CLEARANCE, narrow_share=SHARE)
    assert other.fuel == pytest.approx(one.fuel, rel=1e-4)
    assert other.clearance >= CLEARANCE


def test_a_harbour_may_be_left_at_less_than_the_clearance() -> None:
    quays = [shapely.box(-10, 240, 900, 260), shapely.box(-10, 340, 900, 360)]
    route = planned(renew.Chart(EXTENT, quays), clearance=CLEARANCE, narrow_share=SHARE)
    assert not route.starts_in_soft_no_go
    assert route.clearance >= SHARE * 40 * 0.99


def test_pieces_of_shores_stand_out_of_the_padding_for_turns() -> None:
    chart = renew.Chart(EXTENT, [*wall(2000, 60), *wall(4000, 700)])
    used = planned(chart, clearance=CLEARANCE, narrow_share=SHARE).padding_used
    length = np.linalg.norm(used[:, 2:4] - used[:, :2], axis=1)
    pieces = used[length <= CLEARANCE / 4 * 1.001]
    assert len(pieces)
    assert (pieces[:, 4] > used[:, 4].min()).all()


@given(st.integers(0, 2**32 - 1))
@examples(2, 5)
def test_among_skerries_a_way_is_found_where_one_is_without_clearance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    middles = rng.uniform((600, 0), (5400, 2000), (60, 2))
    chart = renew.Chart(
        EXTENT, shapely.buffer(shapely.points(middles), rng.uniform(20, 140, 60)).tolist()
    )
    try:
        bare = planned(chart)
    except renew.PlanningError:
        return
    route = planned(chart, clearance=CLEARANCE, narrow_share=SHARE)
    assert route.fuel >= bare.fuel * (1 - 1e-3)
    assert route.clearance >= 2 * RADIUS * (1 - 1e-6)
