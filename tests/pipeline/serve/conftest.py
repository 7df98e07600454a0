import contextlib
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


@pytest.fixture(scope="package")
def window(browser: Browser) -> Page:
    """A window for all tests, one after the other: a new one is a new process."""
    return browser.new_context().new_page()


@contextlib.contextmanager
def heard(page: Page, own: str, faults: list[str]) -> Iterator[None]:
    """Take a page's errors, dialogs, and requests to other addresses than its own as faults."""

    def hear(message: ConsoleMessage) -> None:
        # A refusal of the server is no fault of the page.
        if message.type in {"error", "warning"} and "Failed to load resource" not in message.text:
            faults.append(f"console: {message.text}")

    ears = {
        "console": hear,
        "pageerror": lambda error: faults.append(f"error: {error}"),
        "dialog": lambda dialog: faults.append(f"dialog: {dialog.message}"),
        "request": lambda sent: (
            None if sent.url.startswith((own, "data:")) else faults.append(sent.url)
        ),
    }
    for event, listen in ears.items():
        page.on(event, listen)  # type: ignore[call-overload]
    yield
    for event, listen in ears.items():
        page.remove_listener(event, listen)


@pytest.fixture
def open_page(browser: Browser, window: Page, server: Server) -> Iterator[Open]:
    """Open the page by its first address; it must log no error, and ask nobody else."""
    faults: list[str] = []
    opened: list[Page] = []
    own = f"http://127.0.0.1:{server.port}/"

    def open_one(
        fragment: str = "", context: BrowserContext | None = None, **options: object
    ) -> Page:
        viewport: Any = {"width": options.pop("width", 1280), "height": 800}
        given: dict[str, Any] = {"reduced_motion": "reduce", **options}
        if context is not None:
            page = context.new_page()
        elif window in opened or not given.keys() <= {"reduced_motion", "color_scheme"}:
            page = browser.new_context(viewport=viewport, **given).new_page()
        else:
            page = window
            page.context.clear_cookies()
            page.set_viewport_size(viewport)
            page.emulate_media(**{"color_scheme": "null", **given})
        opened.append(page)
        page.set_default_timeout(60_000)
        left.enter_context(heard(page, own, faults))
        # What is prepared while a form is filled in would keep the workers from other tests.
        page.route("**/api/prepare", lambda route: route.fulfill(status=204))
        page.goto(f"{server.address}#{fragment}")
        assert page.url.partition("#")[0] == own  # the token is in no history
        page.wait_for_selector("html[data-ready]", state="attached")
        return page

    with contextlib.ExitStack() as left:
        yield open_one
        for page in {*opened, *window.context.pages} - {window}:
            page.close()
        window.unroute_all()
        window.goto("about:blank")
        window.mouse.move(0, 0)
    assert faults == []
