"""The page in a browser: its map, live and still, and its layout."""

import itertools
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import shapely
from playwright.sync_api import Browser, Page

import renew
from pipeline.findings.result import RunResult
from pipeline.formats.appearance import COLOURS, season_colour
from pipeline.formats.report import page as report_page
from tests.pipeline.formats import small_run
from tests.pipeline.formats.report.actions import closest, drawn, pixels, season, switch, written
from tests.pipeline.formats.report.conftest import Reader
from tests.pipeline.results import rows_of
from tests.true_scale import GEOD

HOSTILE = (
    "<script>alert(1)</script></script><!-- \N{ROCKET} \u202eevil\u202c \u2028 \x00" + "W" * 300
)


@pytest.mark.slow
def test_lines_run_between_the_pixels(reader: Reader, file: Path) -> None:
    """A route of many points is smooth: the middle of its line is close to a cubic."""
    page = reader.open(file, width=1280, height=900)
    switch(page, "others")
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


@pytest.mark.slow
@pytest.mark.parametrize("pixel_ratio", [1, 2])
def test_arrows_are_as_dense_at_the_closest_zoom(
    reader: Reader, file: Path, pixel_ratio: int
) -> None:
    page = reader.open(file, width=1280, height=900, device_scale_factor=pixel_ratio)
    whole = pixels(page, "currents")[..., 3].astype(bool).mean()
    closest(page)
    # At the closest zoom arrows may be further apart.
    assert pixels(page, "currents")[..., 3].astype(bool).mean() > 0.25 * whole > 0


@pytest.mark.slow
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
    switch(page, "zones")
    after = {pane: drawn(page, pane) for pane in before}
    assert [pane for pane in before if after[pane] != before[pane]] == ["soft", "routes"]
    switch(page, "zones")
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


@pytest.mark.slow
def test_shoals_are_drawn_over_land(reader: Reader, result: RunResult, tmp_path: Path) -> None:
    page = reader.open(written(small_run.with_zones(result), tmp_path))
    shoal = [int(COLOURS["shoal"][i : i + 2], 16) for i in (1, 3, 5)]
    seen = (pixels(page, "land")[..., :3] == shoal).all(axis=-1)
    assert seen.sum() > 100


@pytest.mark.slow
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


@pytest.mark.slow
def test_buttons_of_the_classes_are_in_the_tables_first_columns(reader: Reader, file: Path) -> None:
    page = reader.open(file, width=360)
    for button in page.locator("table.classes [data-select]").all():
        box = button.bounding_box()
        assert box is not None
        assert box["x"] + box["width"] <= 360


@pytest.mark.slow
def test_on_paper_the_legend_has_its_colours(reader: Reader, file: Path) -> None:
    page = reader.open(file)
    page.emulate_media(media="print")
    swatches = page.locator(".legend.static i.area")
    assert swatches.count() >= 2
    assert set(
        swatches.evaluate_all("all => all.map(one => getComputedStyle(one).printColorAdjust)")
    ) == {"exact"}


MILE_M, KNOT_M_S = 1852.0, 1852.0 / 3600


def point_at(page: Page, right: float, down: float) -> dict[str, str]:
    """Move the pointer to a share of the map's box; return what the readout then says."""
    box = page.locator("#map").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + right * box["width"], box["y"] + down * box["height"])
    page.wait_for_timeout(80)
    return {
        name: page.locator(f"[data-probe={name}]").inner_text()
        for name in ("place", "current", "land", "soft")
    }


def lonlat(text: str) -> tuple[float, float]:
    """Longitude and latitude of "9°30.2′ N 119°10.0′ E"."""
    numbers = [float(number) for number in re.findall(r"[\d.]+", text)]
    return numbers[2] + numbers[3] / 60, numbers[0] + numbers[1] / 60


def geodesic_m(ends: npt.NDArray[np.float64]) -> float:
    return float(GEOD.inv(*ends[0], *ends[1])[2])


@pytest.mark.slow
def test_particles_drift_with_the_current(reader: Reader, file: Path) -> None:
    page = reader.open(file, reduced_motion="no-preference")
    first = pixels(page, "particles")
    page.wait_for_timeout(300)
    second = pixels(page, "particles")
    assert (first != second).any()
    assert (second[..., 3] > 0).mean() > 0.01
    switch(page, "particles")
    assert drawn(page, "particles") == ""


@pytest.mark.slow
def test_particles_stay_on_the_chart(reader: Reader, file: Path) -> None:
    """At half the size the chart fills the middle of the view only."""
    page = reader.open(file, reduced_motion="no-preference")
    page.locator("[aria-label='Zoom out']").click()
    page.wait_for_timeout(1000)
    drift = pixels(page, "particles")[..., 3] > 0
    rows, columns = np.nonzero(pixels(page, "water")[..., 3] > 200)
    water = page.locator(".leaflet-water-pane canvas").bounding_box()
    sky = page.locator(".leaflet-particles-pane canvas").bounding_box()
    assert water is not None
    assert sky is not None
    down, right = np.nonzero(drift)
    assert len(down) > 50
    for found, base, at, shift in (
        (rows, down, "y", water["y"] - sky["y"]),
        (columns, right, "x", water["x"] - sky["x"]),
    ):
        assert base.min() >= found.min() + shift - 2, at
        assert base.max() <= found.max() + shift + 2, at


@pytest.mark.slow
def test_particles_are_still_where_less_motion_is_asked_for(reader: Reader, file: Path) -> None:
    page = reader.open(file, reduced_motion="reduce")
    assert drawn(page, "particles") == ""
    assert not page.locator("[data-layer=particles]").is_checked()
    switch(page, "particles")
    assert drawn(page, "particles") != ""


def test_the_pointer_reads_position_current_and_distances(
    reader: Reader, file: Path, result: RunResult
) -> None:
    page = reader.open(file, width=1280, height=900)
    scene = result.water
    land = shapely.union_all(np.array(scene.land, dtype=object))
    seen = 0
    for number, entry in enumerate(result.results):
        season(page, number)
        soft = result.case(entry.name).routes[0].route.soft_no_go
        for right, down in ((0.35, 0.3), (0.45, 0.75), (0.6, 0.25), (0.62, 0.55), (0.7, 0.8)):
            read = point_at(page, right, down)
            place = lonlat(read["place"])
            here = shapely.Point(scene.projection.to_plane(np.array(place)))
            if here.intersects(land):
                assert read["land"] == "on land"
                continue
            seen += 1
            for name, area in (("land", land), ("soft", soft)):
                ends = scene.projection.to_lonlat(
                    shapely.get_coordinates(shapely.shortest_line(here, area))
                )
                if here.intersects(area):
                    assert read[name] == "inside"
                    continue
                size, unit = read[name].split(",")[0].split()
                metres = float(size) * {"km": 1000, "m": 1}[unit]
                # Positions are read to a tenth of a minute; the zone is drawn simplified.
                assert metres == pytest.approx(geodesic_m(ends), abs=400), (name, place)
            expected = result.planned[entry.name].current(np.array([here.x, here.y]))
            east, north = scene.projection.rotate_to_lonlat(np.array(place), expected)
            speed, _, _, course = read["current"].split()
            assert float(speed) == pytest.approx(np.hypot(east, north), abs=0.02)
            turned = float(course[:-1]) - np.degrees(np.arctan2(east, north))
            assert abs((turned + 180) % 360 - 180) < 6
    assert seen >= 5


@pytest.mark.slow
def test_the_readout_is_gone_with_the_pointer(reader: Reader, file: Path) -> None:
    page = reader.open(file)
    point_at(page, 0.5, 0.3)
    assert page.locator(".probe").is_visible()
    page.mouse.move(2, 2)
    page.wait_for_timeout(80)
    assert not page.locator(".probe").is_visible()
    # By the keyboard the map's middle is read.
    page.locator("#map").focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(500)
    assert page.locator(".probe").is_visible()


@pytest.mark.slow
def test_only_with_ctrl_the_wheel_zooms(reader: Reader, file: Path) -> None:
    page = reader.open(file, reduced_motion="no-preference")
    before = drawn(page, "land")
    point_at(page, 0.5, 0.3)
    page.locator("#map").focus()
    top = page.evaluate("scrollY")
    page.mouse.wheel(0, 100)
    page.wait_for_timeout(300)
    assert page.evaluate("scrollY") == pytest.approx(top + 100, abs=5)
    assert drawn(page, "land") == before
    assert page.locator(".wheel-hint").is_visible()
    point_at(page, 0.5, 0.3)
    page.keyboard.down("Control")
    page.mouse.wheel(0, -200)
    page.keyboard.up("Control")
    page.wait_for_timeout(500)
    assert drawn(page, "land") != before
    assert page.evaluate("scrollY") == pytest.approx(top + 100, abs=5)


def test_units_switch_everywhere_and_back(reader: Reader, file: Path, result: RunResult) -> None:
    page = reader.open(file, width=1280, height=900)
    page.locator(".choices summary").click()
    metric = page.locator("main").inner_text()
    best = rows_of(result)[0]
    switch(page, "nautical")
    card = page.locator(".card").first.inner_text()
    assert f"Length\n{best.length_m / MILE_M:.1f} NM" in card
    clearance = re.findall(r"Clear of land\s+([\d.]+) NM", card)
    assert len(clearance) == 1
    assert 0 <= best.clearance_m / MILE_M - float(clearance[0]) < 0.01
    speed = page.locator("[data-now=speed]").inner_text()
    assert speed.endswith(" kn")
    assert page.locator(".leaflet-control-scale-line").inner_text().endswith(" NM")
    assert re.search(r"\d km\b|\d m/s", page.locator(".cards").inner_text()) is None
    assert "m/s" not in page.locator(".explorer .legend").inner_text()
    switch(page, "nautical")
    assert page.locator("main").inner_text() == metric


def test_a_place_in_the_text_is_shown_on_the_map(
    reader: Reader, result: RunResult, tmp_path: Path
) -> None:
    page = reader.open(written(small_run.with_a_shut_strait(result), tmp_path))
    button = page.get_by_role("button", name="Show the strait at 119.7000 E 9.5500 N on the map")
    before = drawn(page, "land")
    button.click()
    page.wait_for_timeout(300)
    assert drawn(page, "land") != before
    assert page.locator("#map").evaluate(
        "map => { const { top, bottom } = map.getBoundingClientRect();"
        " return top > -1 && bottom < innerHeight + 1; }"
    )
    assert page.locator(".closest-label", has_text="shut strait").is_visible()
    # The place is in the middle of the map.
    read = point_at(page, 0.5, 0.5)
    assert lonlat(read["place"]) == pytest.approx((119.7, 9.55), abs=0.01)


@pytest.mark.slow
def test_the_map_is_not_below_the_fold(reader: Reader, file: Path) -> None:
    page = reader.open(file)
    for width, height in ((1280, 800), (1440, 900), (1920, 1080)):
        page.set_viewport_size({"width": width, "height": height})
        box = page.locator("#map").bounding_box()
        assert box is not None
        shown = min(box["y"] + box["height"], height) - box["y"]
        assert shown > 0.55 * box["height"]
        assert box["y"] < 0.45 * height


# Texts of a plot that cover each other by more than a hair, as "one / other".
OVERLAPS = """() => [...document.querySelectorAll(".plots svg")].flatMap((plot) => {
  const box = (text) => [text.textContent.trim(), text.getBoundingClientRect()];
  const texts = [...plot.querySelectorAll("text")].map(box);
  return texts.flatMap(([one, a], i) => texts.slice(i + 1)
    .filter(([, b]) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1
      && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 3)
    .map(([other]) => `${one} / ${other}`));
})"""


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("width", [390, 1280])
def test_no_text_of_a_plot_covers_another(reader: Reader, file: Path, width: int) -> None:
    page = reader.open(file, width=width)
    assert page.locator(".plots svg text").count() > 50
    assert page.evaluate(OVERLAPS) == []


@pytest.mark.slow
def test_on_a_phone_a_reason_has_room(reader: Reader, result: RunResult, tmp_path: Path) -> None:
    """A column of a few letters would make a row as tall as a screen."""
    entry, *others = result.results
    assert entry.plan is not None
    reason = "blocked at 117.1221 E 8.1063 N: the gap is 4.15 m wide, and 7.84 m are needed"
    gone = renew.Rejected("p2.p4.p1", reason, entry.plan.routes[0].channel)
    plan = replace(entry.plan, rejected=(gone,))
    changed = replace(result, results=(replace(entry, plan=plan), *others))
    page = reader.open(written(changed, tmp_path), width=390)
    box = page.locator("table.reasons tbody tr").bounding_box()
    assert box is not None
    assert box["height"] < 120


@pytest.mark.slow
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
