"""The page in a real browser: by mouse, by keyboard, on a phone, and with hostile text."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import shapely
from playwright.sync_api import Page, expect

from tests.pipeline.serve.client import AREA, LONG, VOYAGE, Server
from tests.pipeline.serve.conftest import Open
from tests.pipeline.voyage.waters import ISLAND
from tests.validators import axe_faults

HOSTILE = "<img src=x onerror=alert(1)><script>alert(2)</script>"


def fill(page: Page, request: dict[str, Any]) -> None:
    """Fill in the texts of a request."""
    page.select_option("#vessel", request.get("vessel", ""))
    for key in ("start", "goal", "speed", "length", "turning_circle", "depart"):
        if key in request:
            page.fill(f"#{key}", request[key])
    page.fill("#month", ", ".join(request.get("month", ())))
    if "currents" in request:
        page.select_option("#source", request["currents"][0])
    page.locator("#month").press("Tab")


def fold_out(page: Page, title: str) -> None:
    page.get_by_text(title, exact=True).click()


def on_map(page: Page, x: float, y: float) -> None:
    """Click the map at shares of its width and height."""
    box = page.locator("#map").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])


def identity(page: Page) -> str:
    """The id of the plan that a page shows."""
    return page.url.partition("#")[2]


def test_a_voyage_is_planned_shown_downloaded_and_there_again_after_a_reload(
    open_page: Open, planned: dict[str, Any], tmp_path: Path
) -> None:
    page = open_page()
    chart = tmp_path / "island.geojson"
    chart.write_text(shapely.to_geojson(ISLAND))
    fill(page, VOYAGE)
    fold_out(page, "Shut areas")
    page.fill("#corners", ";".join(f"{lon},{lat}" for lon, lat in AREA))
    page.click("#add-area")
    fold_out(page, "Chart, depths, tide and havens")
    page.set_input_files("#charts", chart)
    expect(page.locator("#charted")).to_contain_text("island.geojson, 0.0 MB")
    expect(page.locator("#charted")).not_to_contain_text("being sent")
    page.click("#plan")
    expect(page.locator("#status")).to_contain_text("Planned in")
    assert identity(page) == planned["id"]  # the same request is planned once

    def is_shown() -> None:
        routes = planned["sides"]["seasons"][0]["routes"]
        cards = page.locator(".side")
        expect(cards).to_have_count(sum(one["is_side"] for one in routes))
        for card, route in zip(cards.all(), (r for r in routes if r["is_side"]), strict=True):
            expect(card).to_contain_text(route["way"])
            expect(card).to_contain_text(route["because"])
        expect(page.locator(".price-label")).to_have_count(cards.count())
        expect(page.locator("path.shut")).to_have_count(1)
        assert page.input_value("#command") == planned["command"]

    is_shown()
    page.reload()
    expect(page.locator("#status")).to_contain_text("Planned in")
    is_shown()
    assert page.input_value("#start") == VOYAGE["start"]
    assert page.input_value("#turning_circle") == VOYAGE["turning_circle"]
    with page.expect_download() as download:
        page.click("#download")
    assert download.value.suggested_filename == f"{planned['name']}.zip"
    with page.expect_popup() as popup:
        page.click("#report")
    popup.value.wait_for_selector("html[data-ready]", state="attached")
    assert popup.value.evaluate("self.origin") == "null"  # it is shut in


@pytest.mark.slow
def test_distances_are_in_nautical_miles_if_asked_for(
    open_page: Open, planned: dict[str, Any]
) -> None:
    page = open_page(planned["id"])
    facts = page.locator(".side .facts").first
    expect(facts).to_contain_text(re.compile(r"\d km"))
    page.check("#nautical")
    expect(facts).to_contain_text(re.compile(r"\d NM"))
    expect(facts).not_to_contain_text("km")


@pytest.mark.slow
def test_dragging_the_goal_plans_anew_and_a_plan_is_cancelled(
    open_page: Open, planned: dict[str, Any], server: Server
) -> None:
    page = open_page(planned["id"])
    goal = page.get_by_role("button", name="Goal: drag it")
    goal.scroll_into_view_if_needed()
    box = goal.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 13, box["y"] + 13)
    page.mouse.down()
    page.mouse.move(box["x"] + 13, box["y"] - 30, steps=5)
    page.mouse.up()
    expect(page.locator("#cancel")).to_be_enabled()
    now = identity(page)
    assert now != planned["id"]
    asked = server.state(now)["request"]
    assert asked["goal"] == page.input_value("#goal") != VOYAGE["goal"]
    assert {**asked, "goal": VOYAGE["goal"]} == planned["request"]
    page.click("#cancel")
    expect(page.locator("#status")).to_have_text("Cancelled.")
    assert server.state(now)["state"] == "cancelled"
    expect(page.locator("#cancel")).to_be_disabled()


def test_points_and_areas_are_set_by_clicks_and_what_is_wrong_is_told(open_page: Open) -> None:
    page = open_page()
    for x, y in ((0.3, 0.5), (0.6, 0.5), (0.45, 0.6)):
        on_map(page, x, y)
        page.wait_for_timeout(400)  # a double-click would zoom
    page.select_option("#vessel", "")  # without one it is refused, and keeps no worker
    for field in ("#start", "#goal", "#vias input"):
        assert re.fullmatch(r"[\d.]+[NS] [\d.]+[EW]", page.input_value(field))
    expect(page.locator(".pin")).to_have_count(3)
    fold_out(page, "Shut areas")
    page.click("#draw")
    page.locator("#map").scroll_into_view_if_needed()
    for x, y in ((0.4, 0.3), (0.5, 0.3), (0.5, 0.4)):
        on_map(page, x, y)
    page.click("#close-area")
    expect(page.locator("#areas")).to_contain_text("Area 1: 3 corners")
    with page.expect_request("**/api/plan") as sent:
        page.click("#plan")
    asked = json.loads(sent.value.post_data or "")
    assert asked["via"] == [page.input_value("#vias input")]
    assert len(asked["areas"][0]) == 3
    page.get_by_role("button", name="Remove area 1").click()
    page.get_by_role("button", name="Remove point 1").click()
    expect(page.locator(".pin")).to_have_count(2)
    expect(page.locator("path.shut")).to_have_count(0)


def test_the_keyboard_reaches_everything(open_page: Open) -> None:
    page = open_page()
    page.locator("#map").focus()
    page.keyboard.press("s")
    expect(page.locator("#start")).to_have_value(re.compile("N|S"))
    for _ in range(4):
        page.keyboard.press("ArrowRight")
    page.keyboard.press("g")
    expect(page.locator("#goal")).to_have_value(re.compile("N|S"))
    page.keyboard.press("v")
    expect(page.locator("#vias input")).to_have_value(re.compile("N|S"))
    assert page.input_value("#goal") != page.input_value("#start")
    page.locator("#start").focus()
    reached = set()
    for _ in range(60):
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.ariaLabel"))
        page.keyboard.press("Tab")
    assert {"goal", "vessel", "month", "depart", "source", "given", "plan", "map"} <= reached
    assert {"nautical", "Remove point 1"} <= reached
    page.fill("#goal", "nowhere")
    page.keyboard.press("Enter")
    alert = page.get_by_role("alert")  # a worker gives it, which may have to start first
    expect(alert).to_contain_text("nowhere", timeout=30_000)
    expect(page.locator("#goal")).to_be_focused()


def test_text_from_elsewhere_is_never_markup(open_page: Open, tmp_path: Path) -> None:
    page = open_page()
    fill(page, {**VOYAGE, "start": HOSTILE, "speed": HOSTILE, "month": [HOSTILE]})
    file = tmp_path / "<img src=x onerror=alert(3)>.nc"
    file.write_bytes(b"no currents")
    page.set_input_files("#given", file)
    expect(page.locator("#files")).to_contain_text("onerror=alert(3)")
    page.click("#plan")
    expect(page.get_by_role("alert")).to_contain_text(HOSTILE[:20], timeout=30_000)
    expect(page.locator("#plans")).to_contain_text(HOSTILE[:20])
    assert page.locator("img, #plans script, #faults script").count() == 0


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_axe_finds_nothing_serious(
    open_page: Open, planned: dict[str, Any], width: int, scheme: str
) -> None:
    page = open_page(planned["id"], width=width, color_scheme=scheme)
    expect(page.locator(".side").first).to_be_visible()
    for title in ("Shut areas", "Chart, depths, tide and havens", "Notes"):
        fold_out(page, title)
    assert axe_faults(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.slow
def test_files_of_currents_are_dropped_on_the_page(open_page: Open) -> None:
    page = open_page()
    for target, name in (("#drop", "one.nc"), ("#map", "two.nc")):
        dropped = page.evaluate_handle(
            "name => { const data = new DataTransfer();"
            " data.items.add(new File(['rubbish'], name)); return data; }",
            name,
        )
        page.dispatch_event(target, "drop", {"dataTransfer": dropped})
        expect(page.locator("#files")).to_contain_text(name)
    expect(page.locator("#files")).not_to_contain_text("being sent")
    expect(page.locator("#source")).to_be_disabled()
    fill(page, {key: value for key, value in VOYAGE.items() if key != "currents"})
    with page.expect_request("**/api/plan") as sent:
        page.click("#plan")
    assert len(json.loads(sent.value.post_data or "")["currents"]) == 2
    page.get_by_role("button", name="Remove one.nc").click()
    expect(page.locator("#files li")).to_have_count(1)


@pytest.mark.slow
def test_two_tabs_show_two_plans_and_compare_them(
    open_page: Open, planned: dict[str, Any], server: Server
) -> None:
    first = open_page(planned["id"])
    second = open_page(context=first.context)
    fill(second, {**LONG, "goal": "116.84,7.70"})
    second.click("#plan")
    expect(second.locator("#cancel")).to_be_enabled()
    expect(first.locator("#status")).to_contain_text("Planned in")
    assert identity(first) == planned["id"] != identity(second)
    expect(second.locator("#plans li")).not_to_have_count(0)
    second.click("#cancel")
    expect(second.locator("#status")).to_have_text("Cancelled.")
    assert first.locator(".side").count() == 2
    other = server.ended(server.begin({**server.island(), "speed": "10kn", "areas": [AREA]}))
    first.reload()
    first.get_by_role("button", name=re.compile("Compare with .* 10kn")).click()
    table = first.get_by_role("region", name="Two plans compared")
    expect(table).to_contain_text("The other, dotted")
    expect(first.locator("path.other-plan")).to_have_count(1)
    assert other["state"] == "done"
