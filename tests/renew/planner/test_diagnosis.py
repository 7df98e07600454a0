"""What is suggested where no class can be sailed; each suggestion is tried out."""

from __future__ import annotations

import re
from unittest.mock import Mock

import numpy as np
import pytest
from shapely import Polygon, box

import renew
from renew.classes import class_enumerator, roadmap
from renew.planner import classes
from tests.strategies import PAPER_VESSEL

STILL = renew.UniformCurrent(0.0, 0.0)
# A strait of 6 m between two walls is the only way.
BLOCKED = [box(0, 45, 47, 55), box(53, 45, 100, 55)]
START, GOAL = (50.0, 10.0), (50.0, 90.0)


def chart_of(islands: list[Polygon]) -> renew.Chart:
    return renew.Chart(box(0, 0, 100, 100), islands)


def test_where_a_fixed_padding_blocks_all_the_adaptive_one_is_suggested_first() -> None:
    # The strait is 10 m wide: still water needs 3.3 m on each side, a padding of 6 m blocks it.
    walls = [box(0, 45, 45, 55), box(55, 45, 100, 55)]
    with pytest.raises(renew.UnreachableError, match=r"the gap is 10\.00 m wide") as caught:
        renew.plan(chart_of(walls), STILL, PAPER_VESSEL, START, GOAL, padding=6.0)
    text = str(caught.value)
    assert set(caught.value.text.class_names) == {"e"}
    adaptive = re.search(r'"adaptive" would leave one, class \S+ for a fuel of ([\d.]+)', text)
    assert adaptive
    assert float(adaptive[1]) == pytest.approx(
        renew.plan(chart_of(walls), STILL, PAPER_VESSEL, START, GOAL).best.fuel, rel=1e-3
    )
    suggested = float(re.search(r"padding = ([\d.]+) \(planar m\) would leave one", text)[1])  # type: ignore[index]
    assert text.index("adaptive") < text.rindex("padding = ")
    assert renew.plan(chart_of(walls), STILL, PAPER_VESSEL, START, GOAL, padding=suggested).routes
    # The largest one: half of the gap, less the slack with which a path is planned.
    assert 4.6 < suggested < 5
    with pytest.raises(renew.UnreachableError):
        renew.plan(chart_of(walls), STILL, PAPER_VESSEL, START, GOAL, padding=1.03 * 5)


def test_where_a_clearance_blocks_all_the_largest_padding_is_suggested() -> None:
    with pytest.raises(renew.UnreachableError) as caught:
        renew.plan(
            chart_of(BLOCKED), STILL, PAPER_VESSEL, START, GOAL, padding="none", clearance=8.0
        )
    suggested = float(re.search(r"padding = ([\d.]+) \(planar m\) would", str(caught.value))[1])  # type: ignore[index]
    assert 2.7 < suggested < 3


def test_where_adaptive_padding_blocks_all_the_largest_fixed_one_is_suggested() -> None:
    with pytest.raises(renew.UnreachableError) as caught:
        renew.plan(chart_of(BLOCKED), STILL, PAPER_VESSEL, START, GOAL)
    text = str(caught.value)
    assert "a risk of 0.5 would leave none of the widest ways" in text
    assert re.search(r"padding = 2\.\d+ \(planar m\) would leave one", text)
    assert "widest way through has a gap of 6.00 m" in text
    assert text.startswith("the only class was rejected: class e: blocked at (50, 45) m")
    # Where a planar metre is a kilometre, only what the option takes stays in planar metres.
    at_scale = caught.value.located(str, length=lambda one: f"{one.metres:.2f} km")
    assert "widest way through has a gap of 6.00 km" in at_scale
    assert re.search(r"padding = 2\.\d+ \(planar m\) would leave one, .* 3\.00 km clear", at_scale)


def test_a_gap_in_the_soft_zone_of_an_end_hides_no_risk_that_leaves_a_route(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The start lies between two walls, whose padding holds it; only the strait ahead needs less.
    # Between the walls the current runs east and west in turn: a larger risk needs less padding.
    monkeypatch.setattr(classes, "_RISK_STEP", 0.5)
    walls = [box(0, 28, 15, 32), box(25, 28, 40, 32), box(0, 9, 18.5, 11), box(21.5, 9, 40, 11)]
    chart = renew.Chart(box(0, 6, 40, 46), walls)

    y = np.linspace(6.0, 46.0, 81)
    u = np.repeat(0.35 * np.sin(y / 0.7)[:, None], 2, axis=1)
    swirl = renew.GriddedCurrent(np.array([0.0, 40.0]), y, u, 0.0 * u)
    with pytest.raises(renew.UnreachableError, match=r"a risk of 0\.5 would leave one"):
        renew.plan(chart, swirl, PAPER_VESSEL, (20, 10), (20, 42), risk=0.01)


def test_a_reason_that_classes_share_is_given_once() -> None:
    islands = [*BLOCKED, box(20, 20, 30, 30), box(60, 20, 70, 30), box(60, 70, 70, 80)]
    with pytest.raises(renew.UnreachableError) as caught:
        renew.plan(chart_of(islands), STILL, PAPER_VESSEL, START, GOAL, classes=8)
    text = str(caught.value)
    assert text.count("the gap is 6.00 m wide") == 1
    named = re.match(
        r"all (\d+) classes were rejected: classes \S+, \S+, \S+ and (\d+) more: ", text
    )
    assert named
    assert int(named[1]) == 3 + int(named[2])
    assert "more reason" not in text


def test_names_of_classes_among_hundreds_of_islands_are_shortened() -> None:
    x, y = np.meshgrid(np.linspace(12, 88, 14), np.linspace(12, 88, 14))
    islands = [box(a - 2.2, b - 2.2, a + 2.2, b + 2.2) for a, b in zip(x.flat, y.flat, strict=True)]
    with pytest.raises(renew.UnreachableError) as caught:
        renew.plan(chart_of(islands), STILL, PAPER_VESSEL, (18, 50), (82, 50), classes=2)
    assert len(str(caught.value)) < 2000


def test_remedies_are_tried_in_the_ways_that_were_refused_without_another_roadmap(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    built = Mock(wraps=roadmap.roadmap)
    monkeypatch.setattr(class_enumerator, "roadmap", built)
    with pytest.raises(renew.UnreachableError, match="would leave one"):
        renew.plan(chart_of(BLOCKED), STILL, PAPER_VESSEL, START, GOAL)
    assert built.call_count <= 2
