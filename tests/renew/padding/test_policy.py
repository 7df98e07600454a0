"""The padding policy: which width every padding has at least."""

from __future__ import annotations

import pytest

from renew.inputs.arguments import Padding
from renew.padding.policy import PaddingPolicy


@pytest.mark.parametrize(
    ("padding", "clearance", "width"),
    [("adaptive", 0.0, 0.0), ("adaptive", 2.0, 2.0), ("none", 3.0, 3.0), (4, 3.0, 4.0), (1, 3, 3)],
)
def test_no_padding_is_below_the_fixed_width_or_the_clearance(
    padding: Padding, clearance: float, width: float
) -> None:
    policy = PaddingPolicy(padding, clearance, risk=0.05, seed=0)
    assert policy.min_width == width
    assert policy.is_adaptive == (padding == "adaptive")
