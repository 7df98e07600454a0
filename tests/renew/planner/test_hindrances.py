"""Hours at which the current shuts a class's way, and the clearance that yields in narrows."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st
from shapely import box

import renew
from renew._types import FloatArray
from renew.errors import InfeasibleError, TooLateError
from renew.planner.hindrances import with_hours
from tests.strategies import PAPER_VESSEL, STILL, examples

PEAK, PERIOD, MIDDLE = 1.5, 200.0, 100.0
"""Strongest current (m/s) of a strait's tide, its period (s), and where the strait lies (m)."""


def tide(points: FloatArray, times: FloatArray) -> FloatArray:
    """A stream to and fro that is strong in the strait only."""
    u = np.exp(-(((points[..., 0] - MIDDLE) / 25) ** 2)) * np.cos(2 * np.pi * times / PERIOD)
    return PEAK * np.stack([u, 0 * u], axis=-1)


CURRENT = renew.VaryingCurrent(np.arange(0.0, 1201.0, 4.0), tide)
STRAIT = renew.Chart(box(0, 0, 200, 100), [box(90, 0, 110, 30), box(90, 70, 110, 100)])
"""No way but through the strait."""


def sailed(departure: float, **options: float) -> renew.Plan:
    return renew.plan(
        STRAIT, CURRENT, PAPER_VESSEL, (10, 50), (190, 50), departure=departure, padding="none",
        **options,  # type: ignore[arg-type]
    )  # fmt: skip


def check(hours: renew.OverpoweredHours) -> None:
    """Check that the field itself is that strong there between the two times, and not beyond."""

    def strength(times: FloatArray) -> FloatArray:
        return np.asarray(
            np.linalg.norm(tide(np.tile(hours.place, (len(times), 1)), times), axis=1)
        )

    level = 0.97
    times = np.linspace(hours.begin, hours.end, 501)
    assert (strength(times[5:-5]) >= level - 2e-3).all()
    assert (strength(times[[0, -1]] + np.array([-1.0, 1.0])) < level).all()


def test_an_arrival_while_a_strait_is_shut_is_refused_with_its_hours() -> None:
    """At slack water the vessel passes; in the stream it is refused with the right hours."""
    with pytest.raises(renew.UnreachableError, match="The current shuts its way at") as refused:
        sailed(105.0)
    first, last = (float(text.split()[0]) for text in _hours(str(refused.value)))
    assert (first, last) == pytest.approx((PERIOD - 27.6, PERIOD + 27.6), abs=0.3)
    # A vessel that arrives when the strait opens passes; it departs well before.
    route = sailed(last - 72.0).best
    assert last < np.interp(MIDDLE, route.path[:, 0], route.times) < last + 60.0
    assert not sailed(40.0).best.overpowered


def _hours(text: str) -> tuple[str, str]:
    """What follows "from" and "until"."""
    _, _, behind = text.partition("The current shuts its way at")
    begin, _, end = behind.partition(" from ")[2].partition(" until ")
    return begin, end


def test_a_vessel_that_may_be_late_gets_the_hours_when_a_strait_shuts() -> None:
    """It passes just before the strait shuts, with a lateness that reaches those hours or not."""
    early = sailed(75.0, lateness=0.0).best
    through = float(np.interp(MIDDLE, early.path[:, 0], early.times))
    late = sailed(75.0, lateness=0.25).best
    assert not early.overpowered
    (hours,) = late.overpowered
    check(hours)
    assert through < hours.begin < through + 0.25 * (through - 75.0) + 1.0
    # An early vessel of a later departure meets the end of the same hours.
    (hours,) = sailed(157.0, lateness=0.25).best.overpowered
    check(hours)


def test_a_way_round_is_the_best_without_waiting() -> None:
    """Where another class leads round the strait, the class through it is rejected with hours."""
    chart = renew.Chart(box(0, -60, 200, 100), [box(90, 0, 110, 30), box(90, 70, 110, 100)])

    def below(points: FloatArray, times: FloatArray) -> FloatArray:
        return tide(points, times) * (points[..., 1:] > 10)

    current = renew.VaryingCurrent(np.arange(0.0, 1201.0, 4.0), below)
    plan = renew.plan(chart, current, PAPER_VESSEL, (10, 50), (190, 50), departure=105.0)
    (rejected,) = plan.rejected
    assert plan.best.path[:, 1].min() < 0
    assert not plan.best.overpowered
    for hours in rejected.overpowered:
        check(hours)
        assert str(hours.text) in rejected.reason
    assert rejected.overpowered


def test_a_stream_that_nearly_stops_the_vessel_is_a_plain_refusal() -> None:
    """Where overpowering water leaves times unbounded, the field is not evaluated at them."""
    narrow = renew.Chart(box(0, 0, 200, 100), [box(90, 0, 110, 35), box(90, 65, 110, 100)])
    with pytest.raises(renew.UnreachableError, match="The current shuts its way"):
        renew.plan(narrow, CURRENT, PAPER_VESSEL, (10, 50), (190, 50), departure=140.0)


def test_a_slower_stream_says_nothing() -> None:
    swift = replace(PAPER_VESSEL, speed=PEAK / 0.96)
    plan = renew.plan(STRAIT, CURRENT, swift, (10, 50), (190, 50), departure=105.0, padding="none")
    assert not plan.best.overpowered


def test_a_refused_departure_in_the_stream_states_until_when_it_lasts() -> None:
    with pytest.raises(renew.CurrentTooStrongError, match=r"stays so until 226\.\d* s") as refused:
        renew.plan(STRAIT, CURRENT, PAPER_VESSEL, (100, 50), (190, 50), departure=190.0)
    end = float(str(refused.value).partition("until ")[2].split()[0])
    assert np.linalg.norm(tide(np.array([100.0, 50.0]), np.array(end))) == pytest.approx(
        1, abs=2e-3
    )


@pytest.mark.parametrize("kind", [InfeasibleError, TooLateError])
def test_a_reason_keeps_its_kind_and_places(kind: type[InfeasibleError]) -> None:
    place, shut = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    hours = (renew.OverpoweredHours(shut, 5.0, math.inf),)
    longer = with_hours(kind("near {0}", place), hours)
    assert type(longer) is kind
    assert str(longer) == "near (1, 2) m. The current shuts its way at (3, 4) m from 5 s on"
    plain = with_hours(kind("a set {1, 2}"), hours)
    assert str(plain) == "a set {1, 2}. The current shuts its way at (3, 4) m from 5 s on"
    assert with_hours(plain, ()) is plain


CLEARANCE, SHARE = 100.0, 0.5
VESSEL = renew.Vessel(speed=3.0, turn_rate=0.3)
RADIUS = VESSEL.speed / VESSEL.turn_rate
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
    with pytest.raises(renew.UnreachableError, match=r"with 20\.00 m on the left"):
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


@pytest.mark.slow
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
