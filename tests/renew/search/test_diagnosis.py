"""Why a class is rejected, what it would cost, and what would let a plan succeed."""

from __future__ import annotations

import math
import pickle
import re

import numpy as np
import pytest
from shapely import Polygon, box

import renew
from tests.strategies import PAPER_VESSEL, single_gyre

STILL = renew.UniformCurrent(0.0, 0.0)
# A strait of 6 m between two walls; the way round leads through the gap at the end of one.
NARROW = [box(0, 45, 47, 55), box(53, 45, 90, 55)]
BLOCKED = [box(0, 45, 47, 55), box(53, 45, 100, 55)]
START, GOAL = (50.0, 10.0), (50.0, 90.0)


def chart_of(islands: list[Polygon]) -> renew.Chart:
    return renew.Chart(box(0, 0, 100, 100), islands)


def test_a_blocked_class_names_its_strait_and_its_cost() -> None:
    chart = chart_of(NARROW)
    plan = renew.plan(chart, STILL, PAPER_VESSEL, START, GOAL, padding=3.2)
    [rejected] = plan.rejected
    strait = rejected.strait
    assert strait is not None
    assert strait.width == pytest.approx(6)
    assert (strait.padding_left, strait.padding_right) == pytest.approx((3.2, 3.2))
    assert np.sort(strait.gap[:, 0]) == pytest.approx([47, 53])
    assert "triangle" not in rejected.reason
    assert rejected.reason.startswith("blocked at (50, 45) m, between (")
    assert "the gap is 6.00 m wide, and the padding takes 3.20 m on the left" in rejected.reason
    # Who knows more than metres can have the places spelled in another way.
    assert rejected.located_reason(lambda place: f"<{place[0]:g}>").startswith("blocked at <50>")
    # The strait would be the short way: 80 m. The way round costs what the padding costs.
    assert rejected.unpadded_fuel == pytest.approx(80, rel=1e-3)
    assert plan.best.fuel > 100
    again = pickle.loads(pickle.dumps(rejected))  # noqa: S301  (our own bytes)
    assert again.unpadded_fuel == rejected.unpadded_fuel
    assert again.reason == rejected.reason
    assert again.located_reason(str) == rejected.located_reason(str)


def test_a_fixed_margin_that_blocks_all_has_the_adaptive_one_suggested_first() -> None:
    # The strait is 10 m wide: still water needs 3.3 m a side, a margin of 6 m blocks it.
    walls = [box(0, 45, 45, 55), box(55, 45, 100, 55)]
    with pytest.raises(renew.UnreachableError, match=r"the gap is 10\.00 m wide") as caught:
        renew.plan(chart_of(walls), STILL, PAPER_VESSEL, START, GOAL, padding=6.0)
    text = str(caught.value)
    adaptive = re.search(r'"adaptive" would leave one, class \S+ for a fuel of ([\d.]+)', text)
    assert adaptive
    assert float(adaptive[1]) == pytest.approx(
        renew.plan(chart_of(walls), STILL, PAPER_VESSEL, START, GOAL).best.fuel, rel=1e-3
    )
    advised = float(re.search(r"a padding of ([\d.]+) m would leave one", text)[1])  # type: ignore[index]
    assert text.index("adaptive") < text.rindex("a padding of")
    assert renew.plan(chart_of(walls), STILL, PAPER_VESSEL, START, GOAL, padding=advised).routes
    # The largest: half of the gap, less the slack with which a path is planned.
    assert 4.6 < advised < 5
    with pytest.raises(renew.UnreachableError):
        renew.plan(chart_of(walls), STILL, PAPER_VESSEL, START, GOAL, padding=1.03 * 5)


def test_a_clearance_that_blocks_all_has_the_largest_margin_suggested() -> None:
    with pytest.raises(renew.UnreachableError) as caught:
        renew.plan(
            chart_of(BLOCKED), STILL, PAPER_VESSEL, START, GOAL, padding="none", clearance=8.0
        )
    advised = float(re.search(r"padding of ([\d.]+) m would", str(caught.value))[1])  # type: ignore[index]
    assert 2.7 < advised < 3


def test_adaptive_padding_that_blocks_all_has_the_largest_fixed_one_suggested() -> None:
    with pytest.raises(renew.UnreachableError) as caught:
        renew.plan(chart_of(BLOCKED), STILL, PAPER_VESSEL, START, GOAL)
    text = str(caught.value)
    assert "no risk up to 0.5 would leave one" in text
    assert re.search(r"a padding of 2\.\d+ m would leave one", text)
    assert "widest way through has a gap of 6.00 m" in text


def test_classes_blocked_by_the_padding_of_others_are_planned_for_themselves() -> None:
    chart, gyre = single_gyre()
    plan = renew.plan(chart, gyre, PAPER_VESSEL, (10, 10), (90, 90))
    bare = renew.plan(chart, gyre, PAPER_VESSEL, (10, 10), (90, 90), padding="none")
    known = {r.homotopy for r in plan.routes} | {r.homotopy for r in plan.rejected}
    assert known == {r.homotopy for r in bare.routes}
    assert all(math.isfinite(r.unpadded_fuel) for r in plan.rejected)


def test_names_of_hundreds_of_islands_are_cut_short_in_sentences() -> None:
    x, y = np.meshgrid(np.linspace(12, 88, 14), np.linspace(12, 88, 14))
    islands = [box(a - 2.2, b - 2.2, a + 2.2, b + 2.2) for a, b in zip(x.flat, y.flat, strict=True)]
    with pytest.raises(renew.UnreachableError) as caught:
        renew.plan(chart_of(islands), STILL, PAPER_VESSEL, (18, 50), (82, 50), classes=2)
    assert len(str(caught.value)) < 2000
