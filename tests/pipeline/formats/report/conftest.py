import contextlib
import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, Route

from pipeline.findings.result import RunResult
from tests.pipeline.formats.report.actions import written
from tests.validators import chromium

# Options of a context that a page takes, too.
MEDIA = ("color_scheme", "reduced_motion")


@dataclass
class Reader:
    """Opens pages, and records their requests, console errors and dialogs as faults."""

    browser: Browser
    window: Page
    faults: list[str] = field(default_factory=list)

    def open(self, path: Path, *, width: int = 900, height: int = 700, **options: object) -> Page:
        """Open a file and wait until its script has run.

        In the window of all tests, as a new one is a new process; in one of its own where it is
        asked for what only that can have, such as a finger.

        Drifting particles keep a processor busy, so they only drift where motion is tested: with
        `reduced_motion="no-preference"`.
        """
        options = {"reduced_motion": "reduce", **options}
        size: Any = {"width": width, "height": height}
        if options.keys() <= set(MEDIA):
            page = self.window
            page.set_viewport_size(size)
            shown: dict[str, Any] = {**dict.fromkeys(("media", *MEDIA), "null"), **options}
            page.emulate_media(**shown)
        else:
            page = self.browser.new_context(viewport=size, **options).new_page()  # type: ignore[arg-type]
        page.set_default_timeout(10_000)
        page.route("**/*", lambda route: self._answer(route, path.as_uri()))
        for event, hear in self._ears.items():
            page.on(event, hear)  # type: ignore[call-overload]
        page.goto(path.as_uri())
        if options.get("java_script_enabled", True):
            page.wait_for_selector("html[data-ready]", state="attached")
        return page

    def close(self) -> None:
        """Close what is open, and leave the window of all tests as it was."""
        for context in self.browser.contexts:
            if context != self.window.context:
                context.close()
        self.window.unroute_all()
        self.window.goto("about:blank")
        self.window.mouse.move(0, 0)
        for event, hear in self._ears.items():
            with contextlib.suppress(KeyError):  # it was never opened
                self.window.remove_listener(event, hear)

    @functools.cached_property
    def _ears(self) -> dict[str, Callable[[Any], None]]:
        """What hears of a page's events."""
        return {
            "console": self._hear,
            "pageerror": lambda error: self.faults.append(f"error: {error}"),
            "dialog": lambda dialog: self.faults.append(f"dialog: {dialog.message}"),
        }

    def _answer(self, route: Route, allowed: str) -> None:
        if route.request.url == allowed:
            route.continue_()
        else:
            self.faults.append(f"request: {route.request.url}")
            route.abort()

    def _hear(self, message: ConsoleMessage) -> None:
        if message.type in {"error", "warning"}:
            self.faults.append(f"console: {message.text}")


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """The system's own Chromium."""
    with chromium() as browser:
        if browser is None:
            pytest.skip("no chromium on the path: apt-get install chromium")
        yield browser


@pytest.fixture(scope="package")
def window(browser: Browser) -> Page:
    """A window for all tests, one after the other."""
    return browser.new_context().new_page()


@pytest.fixture
def reader(browser: Browser, window: Page) -> Iterator[Reader]:
    """A reader; its pages must make no request, log no error and open no dialog."""
    reader = Reader(browser, window)
    yield reader
    reader.close()
    assert reader.faults == []


@pytest.fixture(scope="package")
def file(result: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Page of the small run."""
    return written(result, tmp_path_factory.mktemp("report"))
