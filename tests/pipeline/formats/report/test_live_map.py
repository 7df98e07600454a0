"""The live map in a real browser: drifting particles, the pointer's figures, units, places."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyproj
import pytest
import shapely
from playwright.sync_api import Page

from pipeline.findings.result import RunResult
from tests.pipeline.formats import small_run
from tests.pipeline.formats.report.actions import drawn, pixels, season, written
from tests.pipeline.formats.report.conftest import Reader
from tests.pipeline.results import rows_of

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
    return float(pyproj.Geod(ellps="WGS84").inv(*ends[0], *ends[1])[2])


def test_particles_drift_with_the_current(reader: Reader, file: Path) -> None:
    page = reader.open(file, reduced_motion="no-preference")
    first = pixels(page, "particles")
    page.wait_for_timeout(300)
    second = pixels(page, "particles")
    assert (first != second).any()
    assert (second[..., 3] > 0).mean() > 0.01
    page.locator("[data-layer=particles]").click()
    assert drawn(page, "particles") == ""


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


def test_particles_are_still_where_less_motion_is_asked_for(reader: Reader, file: Path) -> None:
    page = reader.open(file, reduced_motion="reduce")
    assert drawn(page, "particles") == ""
    assert not page.locator("[data-layer=particles]").is_checked()
    page.locator("[data-layer=particles]").click()
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
    metric = page.locator("main").inner_text()
    best = rows_of(result)[0]
    page.locator("#nautical").click()
    card = page.locator(".card").first.inner_text()
    assert f"Length\n{best.length_m / MILE_M:.1f} NM" in card
    clearance = re.findall(r"Clearance\s+([\d.]+) NM", card)
    assert len(clearance) == 1
    assert 0 <= best.clearance_m / MILE_M - float(clearance[0]) < 0.01
    speed = page.locator("[data-now=speed]").inner_text()
    assert speed.endswith(" kn")
    assert page.locator(".leaflet-control-scale-line").inner_text().endswith(" NM")
    assert re.search(r"\d km\b|\d m/s", page.locator(".cards").inner_text()) is None
    assert "m/s" not in page.locator(".explorer .legend").inner_text()
    page.locator("#nautical").click()
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
        " return top >= 0 && bottom <= innerHeight; }"
    )
    assert page.locator(".closest-label", has_text="shut strait").is_visible()
    # The place is in the middle of the map.
    read = point_at(page, 0.5, 0.5)
    assert lonlat(read["place"]) == pytest.approx((119.7, 9.55), abs=0.01)


def test_the_map_is_not_below_the_fold(reader: Reader, file: Path) -> None:
    page = reader.open(file)
    for width, height in ((1280, 800), (1440, 900), (1920, 1080)):
        page.set_viewport_size({"width": width, "height": height})
        box = page.locator("#map").bounding_box()
        assert box is not None
        shown = min(box["y"] + box["height"], height) - box["y"]
        assert shown > 0.55 * box["height"]
        assert box["y"] < 0.45 * height
