"""Pings to a service on this machine: their content, and that no night depends on them."""

import socket
import time

import pytest

from pipeline.cli import night_watch
from pipeline.cli.night_watch import Ping, check_url, ping, report_for
from pipeline.errors import RequestError
from tests.pipeline.nightly.ping_service import Service

SECRET = "0f5c3a1e-secret"  # noqa: S105 - a test's


@pytest.mark.parametrize(
    ("what", "path"), [("start", "/ID/start"), ("success", "/ID"), ("failure", "/ID/fail")]
)
def test_each_event_has_its_address(service: Service, what: Ping, path: str) -> None:
    assert ping(f"{service.url}/ID", what) == ""
    assert ping(f"{service.url}/ID/?key=1#part", what) == ""
    assert service.asked == [path, f"{path}?key=1"]


@pytest.mark.parametrize(
    ("code", "what"),
    [
        *((code, "success") for code in (0, 10)),
        *((code, "failure") for code in (1, 2, 3, 143)),
        *((code, None) for code in (4, 5)),
    ],
)
def test_the_report_follows_from_the_exit_code(code: int, what: Ping | None) -> None:
    assert report_for(code) == what


def test_a_refusing_answer_is_reported_without_the_address(service: Service) -> None:
    said = ping(f"{service.url}/unknown/{SECRET}", "success")
    host = service.url.removeprefix("http://")
    assert said == f"--ping: reporting the success to {host} failed: it answered 404"


def test_a_service_that_is_not_there_is_reported_and_nothing_is_raised() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # and doesn't listen
        port = taken.getsockname()[1]
        said = ping(f"http://127.0.0.1:{port}/{SECRET}", "start")
    assert said == f"--ping: reporting the start to 127.0.0.1:{port} failed: Connection refused"


def test_a_silent_service_costs_little_time(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(night_watch, "_TIMEOUT_S", 0.3)
    began = time.monotonic()
    said = ping(f"{service.url}/silent/{SECRET}", "success")
    assert said.endswith(" failed: TimeoutError")
    assert time.monotonic() - began < 5
    # A step that has no timeout of its own, such as looking up a name, is abandoned.
    monkeypatch.setattr(night_watch, "_TIMEOUT_S", 15.0)
    monkeypatch.setattr(night_watch, "_DEADLINE_S", 0.3)
    said = ping(f"{service.url}/silent/{SECRET}", "success")
    assert said.endswith(" failed: no answer within 0.3 s")
    assert SECRET not in said


@pytest.mark.parametrize("url", ["https://hc.example/ID", "http://[::1]:8000/a?b=c"])
def test_addresses_are_taken(url: str) -> None:
    check_url(url)


@pytest.mark.parametrize(
    "url",
    [
        "",
        SECRET,
        f"ftp://host/{SECRET}",
        "https://",
        f"file:///{SECRET}",
        "http://host:port/",
        f"https://host/{SECRET} b",
        f"https://[host/{SECRET}",
        f"https://host/{SECRET}\n",
        f"https://me:{SECRET}@host/",
    ],
)
def test_what_is_no_address_is_refused_and_not_repeated(url: str) -> None:
    with pytest.raises(RequestError) as refused:
        check_url(url)
    assert str(refused.value) == (
        "--ping is not a usable address: give the address of the check, as in https://HOST/ID, "
        "without a user name"
    )
