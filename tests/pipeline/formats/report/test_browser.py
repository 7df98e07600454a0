"""The page in a real browser: mouse, keyboard, screen reader, and no requests."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from pipeline.findings import text as texts
from pipeline.findings.result import RunResult
from pipeline.formats.report import page as report_page
from pipeline.model import CaseResult, Credit, Passage
from tests.pipeline.formats import small_run
from tests.pipeline.formats.report.actions import drawn, now, season, slide, switch, written
from tests.pipeline.formats.report.big_page import measure, write_big_page
from tests.pipeline.formats.report.conftest import Reader
from tests.pipeline.results import rows_of, with_rows
from tests.validators import axe_faults

WIDTHS = (360, 768, 1280)
HOSTILE = (
    "<script>alert(1)</script></script><!--<img src=x onerror=alert(2)> \N{ROCKET} "
    "\u202eevil\u202c \u05e9\u05dc\u05d5\u05dd \x07" + "W" * 300
)


def hostile(result: RunResult) -> RunResult:
    """The run with hostile text wherever text comes from outside."""
    seasons = tuple(s.model_copy(update={"title": HOSTILE}) for s in result.scenario.seasons)
    scenario = result.scenario.model_copy(
        update={"title": HOSTILE, "description": HOSTILE, "seasons": seasons}
    )
    credit = Credit(HOSTILE, "land", HOSTILE, HOSTILE, "javascript:alert(3)")
    passages = (Passage("north", (HOSTILE,)),)
    islands = tuple(replace(island, name=HOSTILE) for island in result.islands)
    return replace(
        with_rows(result, lambda _, row: replace(row, passages=passages)),
        scenario=scenario,
        fetched=replace(
            result.fetched,
            land=replace(result.fetched.land, credits=(credit,)),
            notes=(small_run.note(HOSTILE),),
        ),
        islands=islands,
    )


def test_the_map_replaces_the_static_pictures(reader: Reader, file: Path) -> None:
    page = reader.open(file, reduced_motion="no-preference")
    assert page.locator("#map").is_visible()
    assert not page.locator(".maps").is_visible()
    for pane in ("water", "currents", "soft", "land", "routes"):
        assert drawn(page, pane).startswith("data:image/png"), pane
    assert page.locator(".end-label").all_inner_texts() == ["Start", "Goal"]
    numbers = [island.label for island in small_run.parts().islands]
    assert page.locator(".island-label").all_inner_texts() == numbers
    labels = page.locator(".grid-label").all_inner_texts()
    assert {"9°00′N", "10°00′N", "120°00′E"} <= set(labels)


# Words that a reader sees before scrolling.
FIRST_SCREEN = """() => {
  const words = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const seen = { visibilityProperty: true, opacityProperty: true };
    if (!node.parentElement.checkVisibility(seen)) continue;
    for (const { index, 0: word } of node.data.matchAll(/\\S+/g)) {
      const range = document.createRange();
      range.setStart(node, index);
      range.setEnd(node, index + word.length);
      const { top, bottom, width } = range.getBoundingClientRect();
      if (width > 0 && bottom > 0 && top < innerHeight) words.push(word);
    }
  }
  return words;
}"""


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_the_first_screen_has_few_words(
    reader: Reader, file: Path, width: int, height: int
) -> None:
    page = reader.open(file, width=width, height=height)
    words = page.evaluate(FIRST_SCREEN)
    assert 50 < len(words) <= 120, words
    # What is no everyday word leads to its explanation.
    for link in page.locator(".card a").all():
        target = page.locator(str(link.get_attribute("href")))
        assert target.locator("xpath=following-sibling::dd[1]").inner_text()


def test_the_card_of_another_season_is_folded(reader: Reader, file: Path) -> None:
    page = reader.open(file)
    facts = page.locator(".card .facts")
    assert [one.is_visible() for one in facts.all()] == [True, False]
    page.locator(".card .answer").nth(1).click()
    assert [one.is_visible() for one in facts.all()] == [False, True]
    assert page.locator("[data-routes='1']").is_visible()
    page.emulate_media(media="print")
    assert all(one.is_visible() for one in facts.all())


def test_the_numbers_are_the_runs(reader: Reader, file: Path, result: RunResult) -> None:
    page = reader.open(file)
    for number, case in enumerate(result.cases):
        season(page, number)
        rows = case.measures.routes
        buttons = page.locator(f"[data-routes='{number}'] [data-select]")
        assert buttons.count() == len(rows)
        for folded in page.locator(f"[data-routes='{number}'] summary").all():
            folded.click()
        for index, m in enumerate(rows):
            text = buttons.nth(index).inner_text()
            assert " ".join(text.split()).startswith(f"{m.rank} {m.way} {texts.fuel(m.fuel, m)}")
            buttons.nth(index).click()
            slide(page, 1000)
            assert now(page, "fuel") == f"{texts.number(100 * m.fuel / m.still_fuel)} %"
            assert now(page, "time") == texts.hours(m.duration_s)
            assert float(now(page, "distance").split()[0]) == pytest.approx(
                m.length_m / 1000, rel=5e-4
            )
            least, most = page.locator("[data-plot=clearance] .range").inner_text().split(" to ")
            assert least == texts.clearance(m.clearance_m)
            assert most
            label = page.locator(".closest-label").inner_text()
            assert label == f"{least} to land"


def test_quantities_are_formatted_as_in_the_tables(browser: Browser) -> None:
    page = browser.new_page()
    code = (Path(report_page.__file__).parent / "scripts" / "text.js").read_text(encoding="utf-8")
    values = [1234.567, 0.5, 12.3456, 712_089.9, 3_460.0, 820.4, 99.96, 0.012345, 2.5e7, -1.5]
    formatted = page.evaluate(
        f"values => {{ {code}; return values.map(v => [formatNumber(v), formatDistance(v),"
        " formatTime(v), formatClearance(v)]); }",
        values,
    )
    forms = (texts.number, texts.distance, texts.hours, texts.clearance)
    for shown, value in zip(formatted, values, strict=True):
        # There are no negative distances and times.
        wanted = [form(value) for form in (forms if value > 0 else forms[:1])]
        assert shown[: len(wanted)] == [text.replace("-", "\N{MINUS SIGN}") for text in wanted]
    page.close()


@pytest.mark.slow
def test_seasons_switch(reader: Reader, file: Path) -> None:
    page = reader.open(file)
    before = {pane: drawn(page, pane) for pane in ("routes", "currents", "land")}
    assert page.locator("[data-routes='0']").is_visible()
    season(page, 1)
    assert page.locator("[data-routes='1']").is_visible()
    assert not page.locator("[data-routes='0']").is_visible()
    after = {pane: drawn(page, pane) for pane in before}
    assert after["routes"] != before["routes"]
    assert after["currents"] != before["currents"]
    assert after["land"] == before["land"]
    season(page, 0)
    assert drawn(page, "currents") == before["currents"]


@pytest.mark.slow
def test_layers_switch(reader: Reader, file: Path) -> None:
    page = reader.open(file)
    panes = {"currents": "currents", "soft": "soft", "turns": "marks", "others": "routes"}
    before = {pane: drawn(page, pane) for pane in panes.values()}
    for layer, pane in panes.items():
        switch(page, layer)
        assert drawn(page, pane) != before[pane]
        assert all(drawn(page, p) == before[p] for p in panes.values() if p != pane)
        switch(page, layer)
        assert drawn(page, pane) == before[pane]


def test_routes_switch_and_are_selected(reader: Reader, file: Path) -> None:
    page = reader.open(file)
    rows = page.locator("[data-routes='0'] li")
    assert "selected" in (rows.nth(0).get_attribute("class") or "")
    still = drawn(page, "routes")
    rows.nth(1).hover()  # its line stands out while the pointer is on its row
    before = drawn(page, "routes")
    assert before != still
    rows.nth(1).locator("input").click()
    without = drawn(page, "routes")
    assert without != before
    rows.nth(1).locator("input").click()
    assert drawn(page, "routes") == before
    page.get_by_role("button", name="Only the selected one").click()
    assert drawn(page, "routes") not in {before, without}
    # The selected route is drawn, ticked or not; a route that is much dearer is folded.
    page.locator("[data-routes='0'] summary").click()
    rows.nth(2).locator("button").click()
    selected = page.locator("[data-route].selected")
    assert [selected.nth(i).get_attribute("data-route") for i in range(2)] == ["0-2", "0-2"]
    assert selected.count() == 2
    assert rows.nth(2).locator("button").get_attribute("aria-pressed") == "true"
    page.get_by_role("button", name=re.compile("^Show route 2 of Winter")).click()
    assert page.locator("[data-routes='1']").is_visible()
    assert page.locator("[data-routes='1'] li").nth(1).get_attribute("class") == "selected"
    assert page.locator("[name=season]").nth(1).is_checked()


@pytest.mark.slow
def test_the_voyage_plays(reader: Reader, file: Path) -> None:
    page = reader.open(file, reduced_motion="no-preference")
    vessel = page.locator(".vessel")
    place, time = vessel.bounding_box(), now(page, "time")
    page.locator("#play").click()
    page.wait_for_timeout(700)
    assert page.locator("#play").inner_text() == "Pause"
    page.locator("#play").click()
    assert page.locator("#play").inner_text() == "Play the voyage"
    assert now(page, "time") != time
    assert vessel.bounding_box() != place
    assert float(now(page, "fuel").removesuffix("%")) > 0
    assert int(page.locator("#time").input_value()) > 5
    # Announced once, after the vessel has stopped.
    page.wait_for_selector("#spoken:not(:empty)", state="attached")
    assert page.locator("#spoken").inner_text().startswith(f"After {now(page, 'time')}: ")


def test_the_voyages_position_and_time_are_true(
    reader: Reader, file: Path, result: RunResult
) -> None:
    page = reader.open(file)
    for value, end in ((0, result.scenario.start), (1000, result.scenario.goal)):
        slide(page, value)
        assert end is not None
        numbers = [float(n) for n in re.findall(r"[\d.]+", now(page, "place"))]
        lat, lon = numbers[0] + numbers[1] / 60, numbers[2] + numbers[3] / 60
        assert (lon, lat) == pytest.approx(end, abs=0.1 / 60)
    values = []
    for value in range(0, 1001, 50):
        slide(page, value)
        values.append(float(now(page, "fuel").removesuffix("%")))
        assert page.locator("#time").get_attribute("aria-valuetext") == (
            f"{now(page, 'time')} of {texts.hours(rows_of(result)[0].duration_s)}"
        )
    assert values == sorted(values)


@pytest.mark.slow
def test_with_reduced_motion_the_vessel_moves_in_steps(reader: Reader, file: Path) -> None:
    page = reader.open(file, reduced_motion="reduce")
    seen = page.evaluate(
        """() => new Promise(done => {
            const places = new Set();
            const field = document.querySelector("[data-now=time]");
            document.querySelector("#play").click();
            const look = setInterval(() => places.add(field.textContent), 20);
            setTimeout(() => { clearInterval(look); done(places.size); }, 1900);
        })"""
    )
    assert seen == 2


def test_the_keyboard_reaches_every_control(reader: Reader, file: Path) -> None:
    page = reader.open(file, reduced_motion="no-preference")
    reached: list[str] = []
    for _ in range(40):
        page.keyboard.press("Tab")
        name = page.evaluate(
            "(({id, name, dataset}) => id || name || Object.keys(dataset)[0] || '')"
            "(document.activeElement)"
        )
        reached.append(str(name))
        if name == "season":
            page.keyboard.press("ArrowRight")
            assert page.locator("[data-routes='1']").is_visible()
        elif page.evaluate("document.activeElement.matches('.choices summary')"):
            page.keyboard.press("Enter")
        elif name == "layer" and "layer" not in reached[:-1]:
            before = drawn(page, "currents")
            page.keyboard.press("Space")
            assert drawn(page, "currents") != before
        elif name == "map":
            before = drawn(page, "land")
            page.keyboard.press("+")
            page.wait_for_timeout(400)
            assert drawn(page, "land") != before
        elif name == "play":
            page.keyboard.press("Enter")
            page.wait_for_timeout(200)
            page.keyboard.press("Enter")
            assert int(page.locator("#time").input_value()) > 0
        elif name == "time":
            page.keyboard.press("Home")
            page.keyboard.press("ArrowRight")
            assert page.locator("#time").input_value() == "1"
        elif name == "shown" and "shown" not in reached[:-1]:
            before = drawn(page, "routes")
            # The best is selected, so it is drawn, ticked or not; the next row's box hides its own.
            page.keyboard.press("Tab")
            page.keyboard.press("Tab")
            page.keyboard.press("Space")
            assert drawn(page, "routes") != before
        elif name == "select":
            page.keyboard.press("Enter")
            assert page.evaluate("document.activeElement.getAttribute('aria-pressed')") == "true"
            break
    assert {"season", "layer", "map", "fit", "play", "time", "shown", "select"} <= set(reached)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize(("scheme", "width"), [("light", 360), ("dark", 1280)])
def test_axe_finds_no_barriers(reader: Reader, file: Path, scheme: str, width: int) -> None:
    page = reader.open(file, width=width, height=800, color_scheme=scheme)
    assert axe_faults(page) == []


@pytest.mark.slow
def test_the_map_follows_the_pages_colour_scheme(reader: Reader, file: Path) -> None:
    page = reader.open(file, color_scheme="light")
    panes = ("water", "currents", "land", "routes")
    light = [drawn(page, pane) for pane in panes]
    page.emulate_media(color_scheme="dark")
    dark = [drawn(page, pane) for pane in panes]
    assert all(a != b for a, b in zip(light, dark, strict=True))
    page.emulate_media(color_scheme="light")
    assert [drawn(page, pane) for pane in panes] == light


def assert_fits(page: Page) -> None:
    """Check that at no width the page is wider than its window."""
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 800})
        wide = page.evaluate("document.documentElement.scrollWidth - window.innerWidth")
        assert wide <= 0, width
        box = page.locator("#map").bounding_box()
        assert box is not None
        assert box["width"] > 0.6 * min(width, 1000)


@pytest.mark.slow
def test_the_page_fits_every_width(reader: Reader, file: Path) -> None:
    assert_fits(reader.open(file, width=WIDTHS[0]))


def test_bad_names_are_harmless(reader: Reader, result: RunResult, tmp_path: Path) -> None:
    page = reader.open(written(hostile(result), tmp_path))
    page.locator("[data-routes='0'] [data-select]").nth(1).click()
    season(page, 1)
    assert_fits(page)
    assert page.locator("img").count() == 0
    assert page.locator("script").count() == 2
    shown = page.locator("h1").inner_text()
    assert "<script>alert(1)</script></script><!--<img src=x" in shown
    assert "\N{ROCKET}" in shown
    # The script writes text, too: the label of a route under the pointer has its season's name.
    start = page.locator(".vessel").bounding_box()
    assert start is not None
    page.mouse.move(start["x"] + 14, start["y"] + 14)
    label = page.locator(".route-label")
    assert "<script>alert(1)</script>" in label.inner_text()


def test_on_paper_the_static_pictures_are_shown(reader: Reader, file: Path) -> None:
    page = reader.open(file)
    assert not page.locator(".notice details li").first.is_visible()
    page.emulate_media(media="print")
    assert page.locator(".maps svg.map").first.is_visible()
    assert page.locator(".notice details li").first.is_visible()
    for hidden in (".explorer", "#play", "#map", "button"):
        assert not page.locator(hidden).first.is_visible()
    assert len(page.pdf(format="A4")) > 50_000


def test_without_scripts_the_static_pictures_are_shown(reader: Reader, file: Path) -> None:
    page = reader.open(file, java_script_enabled=False)
    pictures = page.locator(".maps svg.map")
    assert pictures.count() == 2
    assert pictures.first.is_visible()
    assert page.locator("button").count() > 0
    assert not any(button.is_visible() for button in page.locator("button").all())
    assert page.locator(".plots svg").first.is_visible()


@pytest.mark.slow
def test_a_planar_scenario_has_positions_in_metres(
    reader: Reader, planar_result: RunResult, tmp_path: Path
) -> None:
    page = reader.open(written(planar_result, tmp_path))
    assert now(page, "place") == "x 10.00 m, y 10.00 m"
    slide(page, 1000)
    assert now(page, "place") == "x 90.00 m, y 90.00 m"
    m = rows_of(planar_result)[0]
    assert now(page, "fuel") == f"{texts.number(100 * m.fuel / m.still_fuel)} %"


@pytest.mark.slow
def test_seasons_without_a_route_can_not_be_selected(
    reader: Reader, result: RunResult, tmp_path: Path
) -> None:
    failed = small_run.with_a_failed_season(result)
    page = reader.open(written(failed, tmp_path))
    assert page.locator("[name=season]").nth(1).is_disabled()
    none = replace(
        failed, results=tuple(CaseResult(one.name, None, "no", 0.0) for one in failed.results)
    )
    page = reader.open(written(none, tmp_path))
    assert page.locator("#map").is_visible()
    assert not page.locator(".player").is_visible()


@pytest.mark.slow
def test_the_largest_page_is_small_and_ready_within_a_second(
    browser: Browser, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("big") / "report.html"
    write_big_page(path)
    data = json.loads(re.findall(r'id="map-data">(.*?)</script>', path.read_text("utf-8"))[0])
    assert sum(len(ring) for ring in data["land"]) / 2 > 45_000
    assert sum(len(entry["routes"]) for entry in data["seasons"]) == 16
    assert all(6_800 < len(entry["current"]["u"]) <= 7_000 for entry in data["seasons"])
    assert path.stat().st_size < 1_750_000
    # Processor time: the wall time on a busy machine says more of the machine than of the page.
    assert any(measure(browser, path).busy_s < 1.0 for _ in range(3))
