"""What is half sent, gone, twice or nowhere: the page answers others, and in one form."""

import contextlib
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pipeline.serve import app, plans as files
from pipeline.serve.plans import GivenFiles
from tests.pipeline.serve.client import Server, serving

HEAD_S = 1.0
"""Time in which the head of a request must come at the hasty server, s."""
HASTY = f"""
from pipeline.cli.main import main
from pipeline.serve import app
app._HEAD_S = {HEAD_S}
main()
"""


@pytest.fixture(scope="module")
def hasty(tmp_path_factory: pytest.TempPathFactory, rehearsed: None) -> Iterator[Server]:
    """A server that waits a second for the head of a request; it prints no traceback."""
    del rehearsed
    assert 5 <= app._HEAD_S <= 20
    program = (sys.executable, "-c", HASTY, "serve")
    with serving(tmp_path_factory.mktemp("hasty") / "outputs", program=program) as server:
        yield server
        server.process.terminate()
        assert "Traceback" not in server.process.communicate(timeout=30)[1]


@pytest.mark.slow
def test_half_sent_requests_keep_nobody_out(server: Server) -> None:
    """More than the server takes, none with a token: a program with one is answered at once."""
    with contextlib.ExitStack() as held:
        for i in range(450):
            one = held.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            one.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: " + b"a" * (i % 7))
            if i % 50 == 49:
                begun = time.monotonic()
                assert server.ask("GET", "/api/plan").status == 200
                assert time.monotonic() - begun < 5


@pytest.mark.slow
def test_a_request_whose_head_does_not_come_is_closed(hasty: Server) -> None:
    with socket.create_connection(("127.0.0.1", hasty.port)) as connection:
        connection.settimeout(30)
        connection.sendall(b"GET /api/plan HTTP/1.1\r\n")
        begun = time.monotonic()
        with contextlib.suppress(ConnectionResetError):
            assert connection.recv(100) == b""
        assert HEAD_S / 2 < time.monotonic() - begun < HEAD_S + 10


@pytest.mark.slow
def test_a_slow_file_of_one_with_the_token_is_taken(hasty: Server) -> None:
    """Its head came in time, and its body may take longer than that."""
    lines = (
        "POST /api/files?name=slow.nc HTTP/1.1",
        f"Host: 127.0.0.1:{hasty.port}",
        f"Authorization: Bearer {hasty.token}",
        "Content-Length: 2",
    )
    with socket.create_connection(("127.0.0.1", hasty.port)) as connection:
        connection.sendall(("\r\n".join(lines) + "\r\n\r\na").encode())
        time.sleep(1.5 * HEAD_S)
        connection.sendall(b"b")
        assert connection.recv(100).split()[1] == b"201"


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/nowhere", 404),
        ("GET", "/api/nowhere", 404),
        ("PUT", "/api/plan", 405),
        ("DELETE", "/", 405),
        ("GET", f"/api/plan/{'0' * 32}", 404),
        ("GET", "/api/land/9/9/9999", 404),
    ],
)
def test_every_refusal_has_one_form(server: Server, method: str, path: str, status: int) -> None:
    answer = server.ask(method, path)
    assert answer.status == status
    assert set(answer.json) == {"faults"}
    assert all(isinstance(fault, str) and fault for fault in answer.json["faults"])
    assert status != 405 or answer.headers["allow"]


def test_files_that_are_gone_are_named_so(server: Server, planned: dict[str, Any]) -> None:
    identity, name = planned["id"], planned["name"]
    report, away = server.output / name / "report.html", server.output / name / "away.html"
    report.rename(away)
    for path in (f"/api/plan/{identity}/files/report.html", f"/plan/{identity}/report.html"):
        answer = server.ask("GET", path)
        assert answer.status == 404
        assert "if it was removed, plan the voyage again" in answer.json["faults"][0]
    answer = server.ask("GET", f"/api/plan/{identity}/files.zip")
    assert (answer.status, set(answer.json)) == (404, {"faults"})
    assert server.ask("GET", f"/api/plan/{identity}/files/metrics.csv").status == 200
    away.rename(report)


async def _send(given: GivenFiles, content: bytes) -> Path:
    async def chunks() -> Any:  # noqa: ANN401 - an iterator of bytes
        yield content

    return await given.receive("a.nc", chunks())


@pytest.mark.anyio
async def test_a_file_that_is_sent_twice_counts_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "_MAX_ALL_BYTES", 1_000)
    given = GivenFiles(tmp_path)
    sent = [await _send(given, b"x" * 400) for _ in range(5)]
    assert len(set(sent)) == 1
    await _send(given, b"y" * 400)
    with pytest.raises(files.NotTakenError, match="no room is left"):
        await _send(given, b"z" * 400)
