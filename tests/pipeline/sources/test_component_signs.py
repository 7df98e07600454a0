"""Wrong signs and swapped components, which are not judged where the data don't suffice."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.sources.current_field import Field
from pipeline.sources.plausibility import (
    FLIPPED,
    ROTATED,
    SWAPPED,
    Assessment,
    assess_directions,
    likeliest_variant,
)
from tests.pipeline.sources.faulty_fields import (
    OCEAN,
    rotated,
    swapped,
    with_both_flipped,
    with_u_flipped,
    with_v_flipped,
)
from tests.pipeline.synthetic_currents import sea


def test_the_likeliest_variant_undoes_the_fault() -> None:
    field = sea(*OCEAN)
    for fault, name in (
        (with_u_flipped, FLIPPED),
        (with_v_flipped, FLIPPED),
        (swapped, SWAPPED),
        (rotated, ROTATED),
    ):
        variant = likeliest_variant(fault(field))
        assert variant is not None
        assert variant.name == name
        assert variant.contrast > 0.5
    assert likeliest_variant(field) is None
    assert likeliest_variant(with_both_flipped(field)) is None


def test_a_field_that_is_too_small_is_not_judged() -> None:
    small = sea(np.arange(145, 146, 0.25), np.arange(30, 31, 0.25))
    for field in (small, with_u_flipped(small), swapped(small)):
        assert likeliest_variant(field) is None


@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0, 90.0])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_tide_of_a_strait_is_not_judged(degrees: float, noise: float) -> None:
    """It runs to and fro, diverges where the level rises, and does not turn: a long wave."""
    lon, lat = np.linspace(5.0, 6.0, 41), np.linspace(60.0, 60.6, 41)
    x, y = np.meshgrid((lon - 5.5) * 55_600, (lat - 60.3) * 111_200)
    along = x * np.cos(np.radians(degrees)) + y * np.sin(np.radians(degrees))
    speed = 1.5 * np.cos(2 * np.pi * along / 200e3 + 0.7)
    rng = np.random.default_rng(1)
    u, v = (
        speed * part(np.radians(degrees)) + noise * rng.normal(size=speed.shape)
        for part in (np.cos, np.sin)
    )
    assert assess_directions(Field(lon, lat, u, v)) == Assessment()


def test_the_tide_of_a_bay_is_a_doubt_without_figures() -> None:
    """A long wave in two directions looks like eddies whose currents were turned by 90 degrees."""
    lon, lat = np.linspace(5.0, 6.0, 41), np.linspace(60.0, 60.6, 41)
    x, y = np.meshgrid((lon - 5.5) * 55_600, (lat - 60.3) * 111_200)
    u, v = np.cos(x / 20e3) * np.sin(y / 25e3), 0.8 * np.sin(x / 20e3) * np.cos(y / 25e3)
    (doubt,) = assess_directions(Field(lon, lat, u, v)).warnings
    assert "or it is waves and tides" in doubt
    assert "standard errors" not in doubt
