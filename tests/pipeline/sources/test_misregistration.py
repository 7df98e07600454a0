"""Shifted fields: the offset is found, and unshifted fields have none."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline._types import BoolArray, FloatArray
from pipeline.sources.current_field import LandMask, find_shift
from tests.pipeline.sources.faulty_fields import ISLANDS, shifted
from tests.pipeline.synthetic_currents import coastal, sea


@pytest.mark.parametrize(("east", "north"), [(0.5, 0), (0, -0.5), (-0.75, 0.25), (1.0, 1.0)])
def test_a_shift_is_measured(world_mask: LandMask, east: float, north: float) -> None:
    found = find_shift(shifted(coastal(sea(*ISLANDS), world_mask), east, north), world_mask)
    assert found is not None
    assert abs(found.east - east) <= 0.25
    assert abs(found.north - north) <= 0.25


def test_a_field_that_is_too_small_has_no_shift(world_mask: LandMask) -> None:
    small = sea(np.arange(145, 146, 0.25), np.arange(30, 31, 0.25))
    assert find_shift(small, world_mask) is None


def test_only_land_inside_the_masks_bounds_is_used(world_mask: LandMask) -> None:
    """Outside of them land is not known, and must not count as water."""
    field = coastal(sea(*ISLANDS), world_mask)
    west, south, east, north = 113.0, 3.0, 129.0, 17.0

    def is_land(lon: FloatArray, lat: FloatArray) -> BoolArray:
        inside = (lon >= west) & (lon <= east) & (lat >= south) & (lat <= north)
        assert inside.all(), "asked outside the bounds"
        return world_mask.is_land(lon, lat)

    known = LandMask(is_land, (west, south, east, north))
    assert find_shift(field, known) is None
    found = find_shift(shifted(field, 0.5, 0.0), known)
    assert found is not None
    assert abs(found.east - 0.5) <= 0.25
