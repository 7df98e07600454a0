"""Wrong signs and swapped components, which are not judged where the data don't suffice."""

from __future__ import annotations

import numpy as np

from pipeline.sources.plausibility import (
    FLIPPED,
    ROTATED,
    SWAPPED,
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
