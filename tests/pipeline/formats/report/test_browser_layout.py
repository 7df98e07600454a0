"""What fits on a phone and on a desk, in a real browser."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import pytest

import renew
from pipeline.findings.result import RunResult
from tests.pipeline.formats.report.actions import written
from tests.pipeline.formats.report.conftest import Reader

# Texts of a plot that cover each other by more than a hair, as "one / other".
OVERLAPS = """() => [...document.querySelectorAll(".plots svg")].flatMap((plot) => {
  const box = (text) => [text.textContent.trim(), text.getBoundingClientRect()];
  const texts = [...plot.querySelectorAll("text")].map(box);
  return texts.flatMap(([one, a], i) => texts.slice(i + 1)
    .filter(([, b]) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1
      && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 3)
    .map(([other]) => `${one} / ${other}`));
})"""


@pytest.mark.parametrize("width", [390, 1280])
def test_no_text_of_a_plot_covers_another(reader: Reader, file: Path, width: int) -> None:
    page = reader.open(file, width=width)
    assert page.locator(".plots svg text").count() > 50
    assert page.evaluate(OVERLAPS) == []


def test_on_a_phone_a_reason_has_room(reader: Reader, result: RunResult, tmp_path: Path) -> None:
    """A column of a few letters would make a row as tall as a screen."""
    entry, *others = result.results
    assert entry.plan is not None
    reason = "blocked at 117.1221 E 8.1063 N: the gap is 4.15 m wide, and the padding takes 3.84 m"
    gone = renew.Rejected("p2.p4.p1", reason, entry.plan.routes[0].channel)
    plan = replace(entry.plan, rejected=(gone,))
    changed = replace(result, results=(replace(entry, plan=plan), *others))
    page = reader.open(written(changed, tmp_path), width=390)
    box = page.locator("table.reasons tbody tr").bounding_box()
    assert box is not None
    assert box["height"] < 120


@pytest.mark.parametrize("width", [240, 1280])
def test_labels_of_meridians_have_room(reader: Reader, file: Path, width: int) -> None:
    page = reader.open(file, width=width)
    for _ in range(2):
        shown = [
            (box["x"], box["x"] + box["width"])
            for label in page.locator(".grid-label.leaflet-tooltip-bottom").all()
            if float(label.evaluate("label => getComputedStyle(label).opacity")) > 0
            and (box := label.locator("span").bounding_box()) is not None
        ]
        shown.sort()
        assert shown
        assert all(one[1] < other[0] for one, other in itertools.pairwise(shown))
        page.locator(".leaflet-control-zoom-in").click()
        page.wait_for_timeout(400)
