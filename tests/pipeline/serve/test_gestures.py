"""What people do on the page by mouse, finger and keyboard, in a real browser."""

import re
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.pipeline.serve.client import VOYAGE, Server, serving
from tests.pipeline.serve.conftest import Open
from tests.pipeline.serve.test_page import fill, identity, on_map


def middle(shown: Locator) -> tuple[float, float]:
    """The middle of an element, scrolled into view."""
    shown.scroll_into_view_if_needed()
    box = shown.bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def pin(page: Page, name: str) -> Locator:
    return page.get_by_role("button", name=f"{name}: drag it")


def pull(page: Page, place: tuple[float, float], by: tuple[float, float]) -> None:
    """Press the button at a place, move the pointer, and let go."""
    page.mouse.move(*place)
    page.mouse.down()
    page.mouse.move(place[0] + by[0], place[1] + by[1], steps=5)
    page.mouse.up()


def shown(open_page: Open, planned: dict[str, Any], **options: object) -> Page:
    """The page with a plan, when its map is drawn."""
    page = open_page(planned["id"], **options)
    expect(page.locator(".price-label").first).to_be_visible()
    return page


def test_a_double_click_zooms_and_sets_nothing(open_page: Open) -> None:
    page = open_page()
    before = page.locator(".leaflet-control-scale-line").inner_text()
    way = [page.input_value("#start"), page.input_value("#goal")]
    page.mouse.dblclick(*middle(page.locator("#map")))
    expect(page.locator(".leaflet-control-scale-line")).not_to_have_text(before)
    page.wait_for_timeout(400)  # longer than a second click may take
    assert [page.input_value("#start"), page.input_value("#goal")] == way
    # The first point of one's own takes the place of the example.
    on_map(page, 0.5, 0.6)
    expect(page.locator(".pin")).to_have_count(1)
    assert page.input_value("#start") != way[0]
    assert page.input_value("#goal") == ""


@pytest.mark.slow
def test_a_line_is_pulled_to_a_point_which_its_pin_removes(
    open_page: Open, planned: dict[str, Any], server: Server
) -> None:
    page = shown(open_page, planned)
    label = page.locator(".price-label", has_text="best")
    with page.expect_response(lambda one: one.status == 202) as answer:  # a plan is taken
        pull(page, middle(label), (0, 12))
    expect(page.locator("#outcome.stale .card").first).to_be_attached()  # the old ones stay
    field = page.locator("#vias input")
    asked = server.state(answer.value.json()["id"])["request"]
    assert asked == {**planned["request"], "via": [field.input_value()]}
    expect(page.locator("#outcome.stale")).to_have_count(0, timeout=30_000)
    expect(page.locator(".pin")).to_have_count(3)
    pin(page, "Point 1").click()
    page.locator(".leaflet-popup button").click()
    expect(field).to_have_count(0)
    expect(page.locator(".pin")).to_have_count(2)
    page.wait_for_url(re.compile(planned["id"]))


def test_changes_are_undone_and_all_is_cleared(open_page: Open, planned: dict[str, Any]) -> None:
    page = shown(open_page, planned)
    pull(page, middle(pin(page, "Goal")), (0, -30))
    expect(page.locator("#goal")).not_to_have_value(VOYAGE["goal"])
    page.wait_for_url(lambda url: planned["id"] not in url)  # it is being planned
    page.keyboard.press("Control+z")
    expect(page.locator("#goal")).to_have_value(VOYAGE["goal"])
    page.wait_for_url(re.compile(planned["id"]))
    page.click("#clear")
    expect(page.locator(".pin, .card, path.shut")).to_have_count(0)
    assert page.input_value("#start") == page.input_value("#goal") == ""
    assert identity(page) == ""
    page.click("#undo")
    expect(page.locator(".pin")).to_have_count(2)


def test_what_is_cleared_before_the_answer_comes_stays_cleared(
    open_page: Open, planned: dict[str, Any]
) -> None:
    page = shown(open_page, planned)
    page.evaluate(
        "window.fetch = ((now) => async (path, asked) => { if (path === '/api/plan' && asked.body)"
        " await new Promise((done) => setTimeout(done, 300)); return now(path, asked); })(fetch)"
    )
    with page.expect_response(lambda one: one.status == 202):
        page.click("#plan")
        page.click("#clear")
    page.wait_for_timeout(300)
    assert identity(page) == ""
    expect(page.locator(".card")).to_have_count(0)


@pytest.mark.slow
def test_a_line_and_its_card_are_one(open_page: Open, planned: dict[str, Any]) -> None:
    page = shown(open_page, planned)
    first, second = page.locator(".card").all()
    for chosen, other in ((second, first), (first, second)):
        chosen.locator("h4 button").click()
        expect(chosen).to_have_class(re.compile(r"\bselected\b"))
        expect(other).not_to_have_class(re.compile(r"\bselected\b"))
    label = page.locator(".price-label", has_text="+")
    page.mouse.move(*middle(label))
    expect(second).to_have_class(re.compile(r"\bhovered\b"))
    page.mouse.click(*middle(label))
    expect(second).to_have_class(re.compile(r"\bselected\b"))
    expect(page.locator(".pin")).to_have_count(2)  # the click was none on the map


@pytest.mark.slow
def test_across_180_degrees_nothing_is_torn_apart(open_page: Open) -> None:
    page = open_page()
    page.fill("#start", "17.5S 179.5E")
    page.fill("#goal", "17.5S 179.5W")
    page.locator("#goal").press("Tab")
    expect(page.get_by_role("button", name="Goal: drag it")).to_be_visible()
    page.wait_for_timeout(300)
    box = page.locator("#map").bounding_box()
    assert box is not None
    apart = middle(pin(page, "Goal"))[0] - middle(pin(page, "Start"))[0]
    assert 0.3 * box["width"] < apart < box["width"]
    page.get_by_text("Shut areas", exact=True).click()
    page.click("#draw")
    before = middle(pin(page, "Start"))
    for x, y in ((0.45, 0.2), (0.55, 0.2), (0.55, 0.3)):
        on_map(page, x, y)
    page.click("#close-area")
    drawn = page.locator("path.shut").bounding_box()
    assert drawn is not None
    assert 0.08 * box["width"] < drawn["width"] < 0.12 * box["width"]
    assert middle(pin(page, "Start"))[0] == pytest.approx(before[0], abs=1)


@pytest.mark.slow
def test_on_a_phone_a_finger_sets_the_way(open_page: Open) -> None:
    page = open_page(width=390, has_touch=True, is_mobile=True)
    page.locator("#map").scroll_into_view_if_needed()
    box = page.locator("#map").bounding_box()
    assert box is not None
    for number, x in enumerate((0.3, 0.7), start=1):
        page.touchscreen.tap(box["x"] + x * box["width"], box["y"] + 0.4 * box["height"])
        expect(page.locator(".pin")).to_have_count(number)
        page.wait_for_timeout(300)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_a_fault_is_at_its_field_with_its_remedy(open_page: Open, server: Server) -> None:
    page = open_page()
    request = server.island()
    fault = (
        "start = [-40.0, 35.001] lies on land, or within the margin around it, 620 m from the "
        "nearest water with a way out at [-39.99000, 35.00100]; move it there"
    )
    fill(page, request)
    with page.expect_request("**/api/plan"):
        page.route("**/api/plan", lambda route: route.fulfill(status=422, json={"faults": [fault]}))
        page.click("#plan")
    expect(page.locator("#start")).to_be_focused()
    expect(page.locator("#start + .told")).to_contain_text("lies on land")
    page.unroute("**/api/plan")
    with page.expect_response("**/api/plan") as asked:
        page.get_by_role("button", name="Move it to the nearest water, 620 m").click()
    assert asked.value.status == 202
    assert page.input_value("#start") == "35.00100N 39.99000W"
    expect(page.locator(".told")).to_have_count(0)


@pytest.mark.slow
def test_each_file_is_a_download_of_its_own(open_page: Open, planned: dict[str, Any]) -> None:
    page = shown(open_page, planned)
    for kind, end in (("GPX", ".gpx"), ("RTZ", ".rtz"), ("GeoPackage", ".gpkg"), ("CSV", ".csv")):
        with page.expect_download() as download:
            page.get_by_role("link", name=kind, exact=True).first.click()
        assert download.value.suggested_filename.endswith(end)
        assert Path(download.value.path()).stat().st_size > 100


@pytest.mark.slow
def test_a_later_server_has_the_plans_named_shown_and_deleted(
    browser: Browser, server: Server
) -> None:
    plan = server.ended(server.begin({**server.island(), "speed": "7.5kn"}))
    named = server.ask("PUT", f"/api/plan/{plan['id']}/title", b'"To the lee"')
    assert named.status == 200
    with serving(server.output) as second:
        kept = second.state(plan["id"])
        assert kept["title"] == "To the lee"
        assert [kept[key] for key in ("sides", "files", "request")] == [
            plan[key] for key in ("sides", "files", "request")
        ]
        page = browser.new_page()
        page.goto(f"{second.address}#{plan['id']}")
        expect(page.locator(".price-label").first).to_be_visible()
        names = page.get_by_label("Name of the plan")
        expect(names.first).to_have_value("To the lee")
        others = names.count() - 1
        page.get_by_role("button", name=re.compile("^Delete .*its files stay")).first.click()
        expect(names).to_have_count(others)
        assert second.ask("GET", f"/api/plan/{plan['id']}").status == 404
        assert (second.output / plan["name"] / "report.html").exists()
        page.close()


@pytest.mark.slow
def test_the_next_plan_does_not_wait_for_files(server: Server) -> None:
    """Of two plans one after the other, the second is found before it would be by waiting."""
    voyage = {**server.island(), "speed": "7.5kn"}
    first = server.begin(voyage)
    while not server.state(first)["sides"]:
        pass
    second = server.begin({**voyage, "speed": "7.6kn"})
    while (state := server.state(second))["state"] == "waiting":
        pass
    assert state["state"] in {"running", "done"}
    assert [server.ended(one)["state"] for one in (first, second)] == ["done", "done"]
