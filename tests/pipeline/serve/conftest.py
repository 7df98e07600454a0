from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page

from tests.pipeline.serve.client import AREA, Server, serving
from tests.validators import chromium

Open = Callable[..., Page]


@pytest.fixture(scope="package")
def server(tmp_path_factory: pytest.TempPathFactory, rehearsed: None) -> Iterator[Server]:
    """A server for all tests that leave it as it is."""
    del rehearsed
    with serving(tmp_path_factory.mktemp("serve") / "outputs") as server:
        yield server


@pytest.fixture(scope="package")
def planned(server: Server) -> dict[str, Any]:
    """The voyage of seconds, around a shut area, when it has been planned."""
    return server.ended(server.begin({**server.island(), "areas": [AREA]}))


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """The system's own Chromium."""
    with chromium() as browser:
        if browser is None:
            pytest.skip("no chromium on the path: apt-get install chromium")
        yield browser


@pytest.fixture
def open_page(browser: Browser, server: Server) -> Iterator[Open]:
    """Open the page by its first address; it must log no error, and ask nobody else."""
    faults: list[str] = []

    def hear(message: ConsoleMessage) -> None:
        # A refusal of the server is no fault of the page.
        if message.type in {"error", "warning"} and "Failed to load resource" not in message.text:
            faults.append(f"console: {message.text}")

    def open_one(
        fragment: str = "", context: BrowserContext | None = None, **options: object
    ) -> Page:
        viewport = {"width": options.pop("width", 1280), "height": 800}
        given: dict[str, Any] = {"viewport": viewport, "reduced_motion": "reduce", **options}
        page = (context or browser.new_context(**given)).new_page()
        page.set_default_timeout(60_000)
        page.on("console", hear)
        page.on("pageerror", lambda error: faults.append(f"error: {error}"))
        page.on("dialog", lambda dialog: faults.append(f"dialog: {dialog.message}"))
        own = f"http://127.0.0.1:{server.port}/"
        page.on(
            "request",
            lambda sent: None if sent.url.startswith((own, "data:")) else faults.append(sent.url),
        )
        # What is prepared while a form is filled in would keep the workers from other tests.
        page.route("**/api/prepare", lambda route: route.fulfill(status=204))
        page.goto(f"{server.address}#{fragment}")
        assert page.url.partition("#")[0] == own  # the token is in no history
        page.wait_for_selector("html[data-ready]", state="attached")
        return page

    yield open_one
    for context in browser.contexts:
        context.close()
    assert faults == []
