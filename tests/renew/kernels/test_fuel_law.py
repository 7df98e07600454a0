"""The law of fuel: the spline through given powers, and its derivatives."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from renew.kernels.fuel_law import FuelLaw, efforts, in_way, marginal, spline_nodes
from tests.compiler import uncompiled

CURVE = tuple((v, 19.13 * v**3.33 + 4.0) for v in (0.1, 0.5, 1.0, 1.5, 2.0, 2.5, 2.78))
steps = st.lists(st.tuples(st.floats(0.05, 2.0), st.floats(0.0, 5.0)), min_size=1, max_size=9)


@given(first=st.floats(0.05, 1.0), rising=st.floats(1e-3, 5.0), bends=steps)
def test_a_spline_passes_its_points_rises_and_is_convex(
    first: float, rising: float, bends: list[tuple[float, float]]
) -> None:
    v, power, points = first, 1.0, [(first, 1.0)]
    for width, bend in bends:
        v, power, rising = v + width, power + width * rising, rising + bend
        points.append((v, power))
    law = FuelLaw(math.nan, 0.0, spline_nodes(tuple(points)))
    assert efforts(np.array(points)[:, 0], law) == pytest.approx(np.array(points)[:, 1])
    speeds = np.linspace(first, v, 2_001)
    rates = efforts(speeds, law)
    size = rates[-1] - rates[0]
    assert np.diff(rates).min() >= -1e-9 * size
    assert np.diff(rates, 2).min() >= -1e-9 * size


def test_a_power_curve_is_nearly_met_between_points() -> None:
    """Within 1.2 % where speeds rise by up to a half, and 5 % where they double."""
    for least, points in ((0.012, 8), (0.05, 5)):
        v = np.geomspace(0.4, 6.4, points)
        nodes = spline_nodes(tuple(zip(v.tolist(), (19.13 * v**3.33).tolist(), strict=True)))
        speeds = np.linspace(0.4, 6.4, 1_001)
        found = efforts(speeds, FuelLaw(math.nan, 0.0, nodes))
        assert found == pytest.approx(19.13 * speeds**3.33, rel=least)


@pytest.mark.parametrize(
    "law", [FuelLaw(3.33, 1.2), FuelLaw(2.0), FuelLaw(math.nan, 1.2, spline_nodes(CURVE))]
)
def test_derivatives_are_those_of_differences(law: FuelLaw) -> None:
    for way, across in ((0.4, 0.0), (0.7, 0.3), (1.3, 0.9), (0.2, 2.1)):
        speed, step = math.hypot(way, across), 1e-5
        rate, slope, bend = in_way(way, across**2, law)
        assert rate == pytest.approx(float(efforts(speed, law)))
        assert uncompiled(in_way)(way, across**2, law) == pytest.approx((rate, slope, bend))
        more, less = (np.array(in_way(way + off, across**2, law)[:2]) for off in (step, -step))
        assert (more - less) / (2 * step) == pytest.approx([slope, bend], rel=1e-5)
        ahead, behind = (float(efforts(speed + off, law)) for off in (step, -step))
        assert (ahead - behind) / (2 * step) == pytest.approx(marginal(speed, law), rel=1e-5)
