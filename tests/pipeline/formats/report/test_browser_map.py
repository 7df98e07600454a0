"""The map in a real browser: at the largest zoom, by touch, on paper."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from pipeline.findings.result import RunResult
from pipeline.formats.palette import COLOURS, season_colour
from pipeline.formats.report import page as report_page
from tests.pipeline.formats import small_run
from tests.pipeline.formats.report.actions import closest, drawn, pixels, written
from tests.pipeline.formats.report.conftest import Reader

HOSTILE = (
    "<script>alert(1)</script></script><!-- \N{ROCKET} \u202eevil\u202c \u2028 \x00" + "W" * 300
)


def test_lines_run_between_the_pixels(reader: Reader, file: Path) -> None:
    """A route of many points is smooth: the middle of its line is close to a cubic."""
    page = reader.open(file, width=1280, height=900)
    page.locator("[data-layer=others]").click()
    page.get_by_role("button", name="Only the selected one").click()
    shown = pixels(page, "routes").astype(float)
    best, halo = (int(colour[3:5], 16) for colour in (season_colour(0), COLOURS["halo"]))
    weight = shown[..., 3] / 255 * np.clip((halo - shown[..., 1]) / (halo - best), 0, 1)
    columns = np.flatnonzero(weight.sum(axis=0) > 2)
    first = columns[len(columns) // 10 : len(columns) // 4]
    rows = (weight[:, first] * np.arange(len(weight))[:, None]).sum(axis=0)
    middle = rows / weight[:, first].sum(axis=0)
    steps = middle - np.polynomial.Polynomial.fit(first, middle, 3)(first)
    assert len(first) > 60
    assert np.sqrt(np.mean(steps**2)) < 0.1


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("pixel_ratio", [1, 2])
def test_arrows_are_as_dense_at_the_closest_zoom(
    reader: Reader, file: Path, pixel_ratio: int
) -> None:
    page = reader.open(file, width=1280, height=900, device_scale_factor=pixel_ratio)
    whole = pixels(page, "currents")[..., 3].astype(bool).mean()
    closest(page)
    # At the closest zoom arrows may be further apart.
    assert pixels(page, "currents")[..., 3].astype(bool).mean() > 0.25 * whole > 0


def test_the_scale_bar_is_true_at_the_closest_zoom(
    reader: Reader, planar_result: RunResult, tmp_path: Path
) -> None:
    page = reader.open(written(planar_result, tmp_path), width=640, height=480)
    whole = page.locator(".leaflet-control-scale-line").inner_text()
    closest(page, "Start")
    bar = page.locator(".leaflet-control-scale-line")
    assert bar.inner_text() != whole
    box = bar.bounding_box()
    assert box is not None
    assert box["width"] <= 110


def test_between_the_lattice_the_current_is_interpolated(browser: Browser) -> None:
    page = browser.new_page()
    assets_folder = Path(report_page.__file__).parent
    page.add_script_tag(path=assets_folder / "vendor" / "leaflet" / "leaflet.js")
    code = (assets_folder / "scripts" / "currents.js").read_text(encoding="utf-8")
    # u grows along rows, v up the columns; one place is land.
    columns, rows = 4, 3
    u = [10 * c for _ in range(rows) for c in range(1, columns + 1)]
    v = [100 * r for r in range(1, rows + 1) for _ in range(columns)]
    u[5] = v[5] = 0
    found = page.evaluate(
        f"current => {{ {code}; return {{"
        "places: [[0, 0], [1.5, 2.5], [-0.25, 3.25], [1, 1.25], [1, 1]]"
        ".map(([r, c]) => interpolatedCurrent(current, r, c)),"
        "steps: [0.25, 0.5, 1, 2, 4].map(stride => arrowSteps(stride, 5, -9, 9)),"
        "seen: arrowSteps(0.5, 5, 1, 2.3),"
        "strides: [3, 25, 26, 100, 105, 900].map(arrowStride) }; }",
        {"columns": columns, "u": u, "v": v},
    )
    # Beyond the outermost places their own current; beside land, that of the water; on land, none.
    for place, expected in zip(
        found["places"], [(0.1, 1.0), (0.35, 2.5), (0.4, 1.0), (0.3, 2.0), None], strict=True
    ):
        assert place == (expected and pytest.approx(expected))
    for stride, steps in zip((0.25, 0.5, 1), found["steps"], strict=False):
        assert len(steps) == 5 / stride
        assert (steps[0] + steps[-1]) / 2 == 2
        assert {b - a for a, b in pairwise(steps)} == {stride}
    assert found["steps"][3:] == [[1, 3], [2]]
    assert found["seen"] == [1.25, 1.75, 2.25]
    assert found["strides"] == [16, 2, 1, 1, 0.5, 0.0625]
    page.close()


def test_zones_can_be_hidden_and_have_labels(
    reader: Reader, result: RunResult, tmp_path: Path
) -> None:
    page = reader.open(written(small_run.with_zones(result, name=HOSTILE), tmp_path))
    before = {pane: drawn(page, pane) for pane in ("soft", "routes", "land")}
    page.locator("[data-layer=zones]").click()
    after = {pane: drawn(page, pane) for pane in before}
    assert [pane for pane in before if after[pane] != before[pane]] == ["soft", "routes"]
    page.locator("[data-layer=zones]").click()
    assert {pane: drawn(page, pane) for pane in before} == before
    # Southwards from the start to the edge of the restricted area.
    start = page.locator(".end-label", has_text="Start").bounding_box()
    assert start is not None
    label = page.locator(".route-label")
    for below in range(4, 90, 3):
        page.mouse.move(start["x"] + 20, start["y"] + below)
        if label.count() and "alert(1)" in label.first.inner_text():
            break
    assert "<script>alert(1)</script>" in label.first.inner_text()


def test_shoals_are_drawn_over_land(reader: Reader, result: RunResult, tmp_path: Path) -> None:
    page = reader.open(written(small_run.with_zones(result), tmp_path))
    shoal = [int(COLOURS["shoal"][i : i + 2], 16) for i in (1, 3, 5)]
    seen = (pixels(page, "land")[..., :3] == shoal).all(axis=-1)
    assert seen.sum() > 100


def test_touch_targets_are_large_enough(reader: Reader, result: RunResult, tmp_path: Path) -> None:
    path = written(small_run.with_zones(result), tmp_path)
    page = reader.open(path, width=360, has_touch=True, is_mobile=True)
    small = page.evaluate(
        """() => [...document.querySelectorAll("button, input, summary, .leaflet-bar a")]
          .filter(element => element.checkVisibility())
          .map(element => element.closest("label") ?? element)
          .filter(element => { const { width, height } = element.getBoundingClientRect();
                               return width < 44 || height < 44; })
          .map(element => element.outerHTML)"""
    )
    assert small == []


def test_buttons_of_the_classes_are_in_the_tables_first_columns(reader: Reader, file: Path) -> None:
    page = reader.open(file, width=360)
    for button in page.locator("table.classes [data-select]").all():
        box = button.bounding_box()
        assert box is not None
        assert box["x"] + box["width"] <= 360


def test_on_paper_the_legend_has_its_colours(reader: Reader, file: Path) -> None:
    page = reader.open(file)
    page.emulate_media(media="print")
    swatches = page.locator(".legend.static i.area")
    assert swatches.count() >= 2
    assert set(
        swatches.evaluate_all("all => all.map(one => getComputedStyle(one).printColorAdjust)")
    ) == {"exact"}
