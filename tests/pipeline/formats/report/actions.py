"""Actions of a reader on a page, and what the page then shows."""

import base64
import io
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image
from playwright.sync_api import Page

from pipeline.findings.result import RunResult
from pipeline.formats.report.page import gather, render


def written(result: RunResult, directory: Path) -> Path:
    """Write a run's page."""
    path = directory / "report.html"
    path.write_text(render(gather(result)), encoding="utf-8")
    return path


def drawn(page: Page, pane: str) -> str:
    """The picture in a pane's canvas, as text."""
    # Leaflet draws in the next frame after a change.
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => setTimeout(done, 60)))")
    return str(
        page.evaluate(
            "pane => document.querySelector(`.leaflet-${pane}-pane canvas`)?.toDataURL() ?? ''",
            pane,
        )
    )


def now(page: Page, name: str) -> str:
    """A figure of the vessel at the current time."""
    return page.locator(f"[data-now={name}]").inner_text()


def slide(page: Page, value: int) -> None:
    """Set the time as if the slider were dragged."""
    page.locator("#time").evaluate(
        "(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input')); }",
        value,
    )


def season(page: Page, number: int) -> None:
    """Choose a season by its button."""
    page.locator(".seasons label").nth(number).click()


def switch(page: Page, layer: str) -> None:
    """Switch a layer of the map on or off, or the units, by its id; the list may be folded."""
    page.locator(".choices details").evaluate("list => { list.open = true; }")
    page.locator(f"[data-layer={layer}], #{layer}").click()


def closest(page: Page, place: str = "Goal") -> None:
    """Zoom in on a place as far as the map allows."""
    page.locator("#map").focus()
    page.keyboard.down("Control")
    for _ in range(10):
        if page.locator(".leaflet-control-zoom-in.leaflet-disabled").count():
            break
        label = page.locator(".end-label", has_text=place).bounding_box()
        assert label is not None
        page.mouse.move(label["x"] + label["width"] + 8, label["y"] + label["height"] / 2)
        page.mouse.wheel(0, -400)
        page.wait_for_timeout(100)  # Leaflet gathers turns of the wheel for a while
        page.wait_for_function("() => document.querySelector('.leaflet-zoom-anim') === null")
    page.keyboard.up("Control")


def pixels(page: Page, pane: str) -> npt.NDArray[np.uint8]:
    """Pixels (height, width, 4) of a pane's canvas, RGBA."""
    _, _, picture = drawn(page, pane).partition(",")
    image = Image.open(io.BytesIO(base64.b64decode(picture)))
    return np.asarray(image.convert("RGBA"))
