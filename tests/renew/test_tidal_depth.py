"""Tidal water: closed forms, an oracle with the clock, passages and turns that the test flies."""

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st
from shapely import Polygon, box

import renew
from renew.inputs.openings import ReliedOnTide
from tests.strategies import PAPER_VESSEL, STILL
from tests.tidal_waters import tidal_scene

CHART = renew.Chart(box(0, 0, 200, 60))
START, GOAL = (20.0, 30.0), (180.0, 30.0)
# Across the whole way but for a gap in the north, and all across.
BAR, WHOLE_BAR = box(95, -1, 105, 40), box(95, -1, 105, 61)
M2_PERIOD = 360 / 28.9841042 * 3600


def semidiurnal(amplitude: float = 1.5, mean: float = 1.9) -> renew.Tide:
    return renew.Tide({"M2": renew.Constant(amplitude, 0.0)}, mean, EPOCH, name="bar")


EPOCH = np.datetime64("2026-11-22T00:00:00")


def constant(height: float) -> renew.Tide:
    return renew.Tide({}, height, EPOCH)


def plan(depth: renew.TidalDepth | None = None, **options: Any) -> renew.Plan:
    asked: dict[str, Any] = {"classes": 4, **options}
    return renew.plan(CHART, STILL, PAPER_VESSEL, START, GOAL, depth=depth, **asked)


def first_low_water(tide: renew.Tide) -> float:
    times = np.arange(0.0, M2_PERIOD, 10.0)
    return float(times[tide.heights(times).argmin()])


@pytest.mark.parametrize("need", [0.6, 1.9, 2.7])
@pytest.mark.parametrize(("surge", "lag"), [(0.0, 0.0), (0.3, 900.0)])
def test_the_hours_of_a_bar_are_those_of_a_cosine(need: float, surge: float, lag: float) -> None:
    tide = semidiurnal()
    low = first_low_water(tide)
    highest = tide.heights(np.arange(0.0, M2_PERIOD, 10.0)).max()
    amplitude = float(highest - tide.mean_level)
    half = math.acos((need + surge - tide.mean_level) / amplitude) / (2 * math.pi) * M2_PERIOD
    # Around each low water, half a period less `half` on both sides.
    expected = low + (M2_PERIOD / 2 - half) * np.array([-1, 1]) + [-lag, lag]
    hours = ReliedOnTide(tide, surge, lag).too_low(need, low - 3600.0, low + 3600.0)
    np.testing.assert_allclose(hours, [expected], atol=60.0)


def test_the_height_relied_on_is_the_least_within_the_lag_less_the_surge() -> None:
    tide = semidiurnal()
    times = np.linspace(0.0, 2 * M2_PERIOD, 97)
    around = times[:, None] + np.linspace(-900.0, 900.0, 181)
    least = tide.heights(around.ravel()).reshape(around.shape).min(axis=1)
    np.testing.assert_allclose(
        ReliedOnTide(tide, 0.3, 900.0).heights(times), least - 0.3, atol=1e-3
    )


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("height", [0.7, 2.5])
def test_a_constant_tide_is_a_depth_bit_for_bit(height: float) -> None:
    need = 1.2
    found = plan(renew.TidalDepth([BAR], [need], constant(height), surge=0.0, lag=0.0))
    lower = plan(renew.TidalDepth([BAR], [need - height], constant(0.0), surge=0.0, lag=0.0))
    expected = plan(avoid=[renew.ShutArea(BAR)] if height < need else [])
    for one in (found, lower):
        np.testing.assert_array_equal(one.best.path, expected.best.path)
        np.testing.assert_array_equal(one.best.trajectory, expected.best.trajectory)
        assert one.best.fuel_bound.value == expected.best.fuel_bound.value


@pytest.mark.parametrize(
    ("after_low", "is_entered"), [(0.0, False), (0.2, False), (0.5, True), (0.35, True)]
)
def test_a_bar_is_crossed_at_high_water_and_gone_around_at_low_water(
    after_low: float, is_entered: bool
) -> None:
    tide = semidiurnal()
    departure = first_low_water(tide) + after_low * M2_PERIOD
    depth = renew.TidalDepth([BAR], [1.5], tide, names=["the bar"])
    found = plan(depth, departure=departure)
    assert shapely.LineString(found.best.path).intersects(BAR) == is_entered
    if is_entered:
        assert found.best.fuel == pytest.approx(160.0, rel=1e-6)
        least = found.best.least_water
        assert least is not None
        at_bar = departure + 75.0 + np.array([0.0, -4.0, 14.0])
        heights = ReliedOnTide(tide, 0.3, 900.0).heights(at_bar) - 1.5
        assert least.spare == pytest.approx(heights[0], abs=0.02)
        assert 95.0 - 5.0 <= least.place[0] <= 105.0
        assert found.shut == ()
    else:
        around = plan(avoid=[renew.ShutArea(BAR)], departure=departure).best.fuel
        assert found.best.fuel == pytest.approx(around, rel=1e-9)
        assert found.best.least_water is None
        (area,) = found.shut
        assert isinstance(area, renew.TidalArea)
        assert area.name == "the bar"
        # Water that the tide shuts now counts as open for the bound.
        assert found.best.fuel_bound.value <= 160.0


def test_where_the_tide_shuts_every_way_the_next_hours_are_named() -> None:
    tide = semidiurnal()
    low = first_low_water(tide)
    depth = renew.TidalDepth([WHOLE_BAR], [1.5], tide, names=["the bar"])
    begin = float(ReliedOnTide(tide, 0.3, 900.0).too_low(1.5, low, low)[0, 1])
    with pytest.raises(renew.UnreachableError) as caught:
        plan(depth, departure=low)
    text = str(caught.value)
    assert f"area 'the bar', which needs 1.50 m of tide (there is enough from {begin:.6g} s" in text
    assert "Depart at another time" in text
    rarely = renew.TidalDepth([WHOLE_BAR], [3.09], semidiurnal(1.5, 1.9))
    with pytest.raises(
        renew.UnreachableError, match=r"no more than 3\.0\d m can be relied on|no water joins"
    ):
        plan(rarely, departure=low)
    with pytest.raises(renew.UnreachableError, match="no water joins"):
        plan(renew.TidalDepth([WHOLE_BAR], [5.0], tide), departure=low)


def test_of_several_departures_the_one_at_high_water_is_found() -> None:
    tide = semidiurnal()
    low = first_low_water(tide)
    departures = low + np.array([0.0, 0.25, 0.5]) * M2_PERIOD
    found = renew.plan_departures(
        CHART,
        STILL,
        PAPER_VESSEL,
        START,
        GOAL,
        departures,
        depth=renew.TidalDepth([BAR], [2.5], tide),
    )
    assert found.best == 2
    assert found.unproven == math.inf
    assert found.fuels[2] == pytest.approx(160.0, rel=1e-6)
    assert (found.fuels[:2] > 161.0).all()
    assert found.plan.best.least_water is not None


@pytest.mark.parametrize("begin", [-1.0, 0.4])
def test_the_latest_departure_in_time_leaves_between_hours_of_low_water(begin: float) -> None:
    """Whether the first departure is shut or open: hours of low water lie before the deadline."""
    tide, need = semidiurnal(), 1.5
    low = first_low_water(tide)
    depth = renew.TidalDepth([WHOLE_BAR], [need], tide)
    departure, arrive_by = low + begin * M2_PERIOD, low + M2_PERIOD
    best = plan(depth, departure=departure, arrive_by=arrive_by).best
    end = ReliedOnTide(tide, 0.3, 900.0).too_low(need, arrive_by, arrive_by)[0, 0]
    # It and its last turn leave the bar, 86 s after the departure, when too little water is left.
    turn = 2 * math.pi / PAPER_VESSEL.turn_rate
    latest = float(end) - 1.05 * 85.0 - turn
    assert latest - 60.0 <= best.times[0] <= latest + 10.0
    assert best.fuel == pytest.approx(160.0, rel=1e-6)


def test_no_departure_in_time_over_a_bar_names_its_hours() -> None:
    tide = semidiurnal()
    low = first_low_water(tide)
    depth = renew.TidalDepth([WHOLE_BAR], [2.5], tide, names=["the bar"])
    with pytest.raises(renew.UnreachableError, match=r"which needs 2\.50 m of tide"):
        plan(depth, departure=low, arrive_by=low + 3600.0)


@given(
    st.floats(-1.0, 4.0),
    st.floats(0.0, 0.5),
    st.floats(0.0, 1800.0),
    st.floats(0.0, 4 * M2_PERIOD),
    st.floats(60.0, M2_PERIOD),
)
def test_hours_of_low_and_enough_water_fill_the_time_and_hold_what_they_say(
    need: float, surge: float, lag: float, begin: float, length: float
) -> None:
    relied = ReliedOnTide(semidiurnal(), surge, lag)
    low, enough = (
        relied.too_low(need, begin, begin + length),
        relied.high_enough(need, begin, begin + length),
    )
    times = begin + length * np.linspace(0.0, 1.0, 41)
    is_low = ((times[:, None] > low[:, 0]) & (times[:, None] < low[:, 1])).any(axis=1)
    is_enough = ((times[:, None] >= enough[:, 0]) & (times[:, None] <= enough[:, 1])).any(axis=1)
    assert np.logical_xor(is_low, is_enough)[1:-1].all()
    spare = relied.heights(times) - need
    # The hours follow straight lines between heights two minutes apart.
    assert (spare[~is_low] > -2e-3).all()
    assert (spare[is_low] < 0.05).all()


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", range(20))
def test_no_passage_and_no_turn_is_over_too_little_water(seed: int) -> None:
    scene = tidal_scene(seed)
    try:
        found = scene.plan(classes=3)
    except renew.UnreachableError:
        pytest.skip("the tide shuts every way")
    for route in found.routes:
        low, count = scene.too_shallow(route)
        assert count > 0
        assert low == 0


def test_a_route_at_another_hour_would_be_over_too_little_water() -> None:
    """The test's flights do find too little water."""
    scene = tidal_scene(0)
    low_water = first_low_water(scene.depth.tide)  # type: ignore[arg-type]
    free = renew.plan(
        scene.chart, scene.current, scene.vessel, scene.start, scene.goal, departure=low_water
    )
    low, _ = scene.too_shallow(free.best)
    assert low > 0


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("seed", range(20))
def test_fuel_is_near_that_of_an_oracle_whose_legs_the_tide_shuts(seed: int) -> None:
    scene = tidal_scene(seed)
    fuel, path = scene.oracle()
    try:
        best = scene.plan(padding="none", classes=8).best
    except renew.UnreachableError:
        assert scene.is_in_time_for_water(path)
        return
    assert best.fuel_bound.value <= fuel
    # The planner does not make detours to wait for a bar to open: a later departure needs less
    # fuel.
    assert best.fuel <= 1.005 * fuel or scene.is_in_time_for_water(path)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(40))
def test_a_higher_tide_is_never_dearer(seed: int) -> None:
    scene = tidal_scene(seed)
    fuels = []
    for rise in (0.0, 0.3, 1.0):
        try:
            found = scene.with_tide_raised(rise).plan(classes=4)
        except renew.UnreachableError:
            fuels.append(math.inf)
            continue
        fuels.append(found.best.fuel)
    assert fuels[1] <= fuels[0] * 1.001 or math.isinf(fuels[0])
    assert fuels[2] <= fuels[1] * 1.001 or math.isinf(fuels[1])


def test_what_does_not_fit_is_refused_with_all_faults() -> None:
    tide = semidiurnal()
    with pytest.raises(renew.ParameterError) as caught:
        renew.TidalDepth(
            [BAR], [1.0, 2.0], [tide, tide], surge=-1.0, lag=math.nan, names=["a", "b"]
        )
    for text in (
        "depth.needs must be 1 finite heights (m), one for each area",
        "depth.tide has 2 tides for 1 areas",
        "depth.names has 2 names for 1 areas",
        "depth.surge = -1.0 m must be finite, 0 or more",
        "depth.lag = nan s must be finite, 0 or more",
    ):
        assert text in str(caught.value)
    with pytest.raises(renew.GeometryError, match=r"depth\.areas\[0\] is not valid"):
        renew.TidalDepth([Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])], [1.0], tide)
    with pytest.raises(renew.ParameterError, match=r"must be a renew\.TidalDepth"):
        plan("high water")  # type: ignore[arg-type]
