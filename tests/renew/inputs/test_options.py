"""The options of a plan: their ranges, and the width that every padding has at least."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest

import renew
from renew.inputs.options import RANGES, Padding
from tests.strategies import PAPER_VESSEL, single_gyre

ANY: Any = renew
"""The API without its types."""


@pytest.mark.parametrize(
    ("padding", "clearance", "width"),
    [("adaptive", 0.0, 0.0), ("adaptive", 2.0, 2.0), ("none", 3.0, 3.0), (4, 3.0, 4.0), (1, 3, 3)],
)
def test_no_padding_is_below_the_fixed_width_or_the_clearance(
    padding: Padding, clearance: float, width: float
) -> None:
    options = renew.PlanOptions(padding=padding, clearance=clearance)
    assert options.min_width == width
    assert options.is_adaptive == (padding == "adaptive")


@pytest.mark.parametrize("name", RANGES)
def test_the_ends_of_each_range_are_taken_and_what_lies_beyond_is_refused(name: str) -> None:
    bounds = RANGES[name]
    taken = [bounds["ge"], *([bounds["le"]] if "le" in bounds else [])]
    refused: list[object] = [-1, math.nan, None, "1", bounds.get("lt", math.inf)]
    refused += [bounds["le"] + 1] if "le" in bounds else []
    for value in taken:
        assert getattr(ANY.PlanOptions(**{name: value}), name) == value
    for value in refused:
        with pytest.raises(renew.ParameterError, match=f"^{name} = "):
            ANY.PlanOptions(**{name: value})


def test_all_faults_are_named_at_once_wherever_they_are_given() -> None:
    message = "(?s)classes = 0 .*samples = 0 .*order = 'x' .*"
    with pytest.raises(renew.ParameterError, match=message):
        ANY.PlanOptions(classes=0, samples=0, order="x")
    chart, current = single_gyre()
    given = chart, current, PAPER_VESSEL, (10, 10), (90, 90)
    message += "departure = nan .*arrive_by needs method = 'optimal'"
    with pytest.raises(renew.ParameterError, match=message):
        ANY.plan(
            *given, classes=0, samples=0, order="x", method="sampled", departure=math.nan,
            arrive_by=1.0,
        )  # fmt: skip
    with pytest.raises(TypeError, match=r"no option 'risks'; it has classes, risk, padding"):
        ANY.plan_departures(*given, [0.0], risks=0.1)


def test_options_as_an_object_and_by_name_give_one_plan() -> None:
    chart, current = single_gyre()
    given = chart, current, PAPER_VESSEL, (10, 10), (90, 90)
    options = renew.PlanOptions(classes=3, padding="none", drift="crab")
    by_name = renew.plan(*given, classes=3, padding="none", drift="crab")
    assert renew.plan(*given, options=options).best.fuel == by_name.best.fuel
    changed = renew.plan(*given, options=options, drift="projected", classes=1)
    assert len(changed.routes) == 1
    assert changed.best.fuel != by_name.best.fuel
    swept = renew.plan_departures(*given, [0.0], options=options)
    assert swept.plan.best.fuel == by_name.best.fuel
    with pytest.raises(dataclasses.FrozenInstanceError):
        ANY.PlanOptions().risk = 0.1
