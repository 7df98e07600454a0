from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, Route

from pipeline.findings.result import RunResult
from tests.pipeline.formats.report.actions import written
from tests.validators import chromium


@dataclass
class Reader:
    """Opens pages, and records their requests, console errors and dialogs as faults."""

    browser: Browser
    faults: list[str] = field(default_factory=list)

    def open(self, path: Path, *, width: int = 900, height: int = 700, **options: object) -> Page:
        """Open a file in a context of its own and wait until its script has run.

        Drifting particles keep a processor busy, so they only drift where motion is tested: with
        `reduced_motion="no-preference"`.
        """
        context = self.browser.new_context(
            viewport={"width": width, "height": height},
            **{"reduced_motion": "reduce", **options},  # type: ignore[arg-type]
        )
        page = context.new_page()
        page.set_default_timeout(10_000)
        page.route("**/*", lambda route: self._answer(route, path.as_uri()))
        page.on("console", self._hear)
        page.on("pageerror", lambda error: self.faults.append(f"error: {error}"))
        page.on("dialog", lambda dialog: self.faults.append(f"dialog: {dialog.message}"))
        page.goto(path.as_uri())
        if options.get("java_script_enabled", True):
            page.wait_for_selector("html[data-ready]", state="attached")
        return page

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


@pytest.fixture
def reader(browser: Browser) -> Iterator[Reader]:
    """A reader; its pages must make no request, log no error and open no dialog."""
    reader = Reader(browser)
    yield reader
    for context in browser.contexts:
        context.close()
    assert reader.faults == []


@pytest.fixture(scope="package")
def file(result: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Page of the small run."""
    return written(result, tmp_path_factory.mktemp("report"))
