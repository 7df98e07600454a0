"""The chart and the vessel: bad figures are refused, and what counts as land."""

import math

import pytest
import shapely
from shapely import Polygon, box

import renew
from tests.strategies import chart_of


def test_all_bad_geometry_is_named() -> None:
    bow_tie = Polygon([(0, 0), (10, 10), (10, 0), (0, 10)])
    endless = Polygon([(0, 0), (math.inf, 0), (0, 1)])
    with pytest.raises(renew.GeometryError) as caught:
        chart_of([box(1, 1, 2, 2), bow_tie, endless])
    assert "no_go[1] is not valid: Self-intersection[5 5]" in str(caught.value)
    assert "no_go[2] has coordinates that are not finite" in str(caught.value)
    with pytest.raises(renew.GeometryError, match="no water is left"):
        chart_of([box(-1, -1, 101, 101)])


def test_an_extent_thinner_than_the_charts_grid_is_refused() -> None:
    with pytest.raises(renew.GeometryError, match=r"the extent is thinner than 0\.005 m"):
        renew.Chart(box(0, 0, 5e6, 1e-6))


def test_land_and_water_add_up_to_the_extent() -> None:
    lake = box(60, 60, 70, 70)
    # They overlap, touch, stick out of the extent and have a lake.
    islands = [
        box(10, 10, 30, 30),
        box(20, 20, 40, 40),
        box(40, 40, 50, 50),
        box(90, 90, 120, 120),
        box(55, 55, 80, 80).difference(lake),
    ]
    chart = chart_of(islands)
    land = shapely.union_all([box(0, 0, 100, 100).intersection(island) for island in islands])
    assert chart.hard_no_go.is_valid
    assert chart.hard_no_go.symmetric_difference(land).area < 1e-3
    assert chart.water.area == pytest.approx(100**2 - land.area)
    assert chart.water.contains(lake.centroid)


def test_holes_in_the_extent_are_land_like_any_other() -> None:
    hole = box(40, 40, 60, 60)
    chart = renew.Chart(Polygon(box(0, 0, 100, 100).exterior, [hole.exterior]))
    assert chart.hard_no_go.symmetric_difference(hole).area < 1e-3
    assert not chart.extent.interiors


def test_all_faults_of_a_vessel_are_named() -> None:
    with pytest.raises(renew.ParameterError) as caught:
        renew.Vessel(speed=-1.0, turn_rate=math.nan, length=0.0)
    for name in ("speed = -1.0", "turn_rate = nan", "length = 0.0"):
        assert name in str(caught.value)


CURVE = ((0.5, 2.1), (1.0, 19.0), (2.0, 190.0))


@pytest.mark.parametrize(
    ("power", "said"),
    [
        (((0.5, 2.1),), r"shape \(1, 2\)"),
        (((0.5, 2.1), (1.0, "a lot")), "real numbers"),
        (((0.0, 2.1), (1.0, 19.0)), "hotel is the power at 0"),
        (((0.5, 2.1), (1.0, 2.0)), "rise with speed"),
        (((0.5, 2.1), (1.0, math.nan)), "rise with speed"),
        (((0.5, 2.1), (1.0, 114.0), (2.0, 198.0)), "114 W at 1 m/s lie above the line"),
        (((0.5, 2.1), (0.9, 19.0)), "speed = 1 m/s is above the speeds.*, 0.5 to 0.9 m/s"),
    ],
)
def test_a_power_that_is_no_curve_is_refused(power: object, said: str) -> None:
    with pytest.raises(renew.ParameterError, match=said):
        renew.Vessel(1.0, 0.6, power=power)  # type: ignore[arg-type]


def test_speeds_beyond_the_power_given_are_refused() -> None:
    with pytest.raises(renew.ParameterError, match=r"speed = 2\.5 m/s is above the speeds"):
        renew.Vessel(2.5, 0.6, power=CURVE)
    with pytest.raises(renew.ParameterError, match="in place of fuel_coefficient"):
        renew.Vessel(1.0, 0.6, fuel_exponent=3.0, power=CURVE)
    with pytest.raises(renew.ParameterError, match=r"hotel = -1"):
        renew.Vessel(1.0, 0.6, hotel=-1)
    vessel = renew.Vessel(1.0, 0.6, power=CURVE, hotel=30.0)
    assert vessel.fuel_rate == pytest.approx(49.0)
    with pytest.raises(renew.ParameterError) as refused:
        renew.plan(
            renew.Chart(shapely.box(0, 0, 9, 9)),
            renew.UniformCurrent(0.0, 0.0),
            vessel,
            (1, 1),
            (8, 8),
            speed=(0.4, 2.2),
        )
    assert "speed.least = 0.4 m/s is below" in str(refused.value)
    assert "speed.most = 2.2 m/s is above" in str(refused.value)


def test_an_exponent_whose_power_overflows_is_refused() -> None:
    with pytest.raises(renew.ParameterError, match=r"fuel_exponent = 1000\.0 must be"):
        renew.Vessel(1.0, 0.6, fuel_exponent=1000.0)


def test_one_turn_sails_the_circumference_of_the_turning_circle() -> None:
    vessel = renew.Vessel(speed=3.0, turn_rate=0.2, fuel_coefficient=0.5, fuel_exponent=3.0)
    circumference = 2 * math.pi * vessel.turning_radius
    assert vessel.speed * vessel.turn_period == pytest.approx(circumference)
    assert vessel.turning_radius == pytest.approx(15)
    assert vessel.fuel_rate == pytest.approx(13.5)
