"""A server of its own process, and a program that asks it over loopback."""

import contextlib
import http.client
import json
import subprocess
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import shapely

from tests.pipeline.processes import renew, started
from tests.pipeline.voyage.waters import ISLAND

# A voyage of seconds: in still water past an island of a given chart.
VOYAGE: dict[str, Any] = {
    "start": "35.0N 40.06W",
    "goal": "35.0N 39.94W",
    "speed": "8kn",
    "length": "12m",
    "turning_circle": "40m",
    "currents": ["still"],
}
AREA = [[-40.06, 35.01], [-40.04, 35.01], [-40.04, 35.03]]
# One that takes long enough to be cancelled: many ways among the islands of the Philippines.
LONG: dict[str, Any] = {
    "start": "120.30,12.80",
    "goal": "116.80,7.70",
    "vessel": "usv-7m",
    "month": ["2024-07"],
}
_LIVE = {"waiting", "running"}


@dataclass(frozen=True)
class Answer:
    """An answer: its status, its headers by lower-case names, and its content."""

    status: int
    headers: Mapping[str, str]
    content: bytes

    @property
    def json(self) -> Any:  # noqa: ANN401 - whatever the server says
        return json.loads(self.content)


@dataclass(frozen=True)
class Server:
    """A running `renew serve`."""

    process: subprocess.Popen[str]
    port: int
    token: str
    output: Path

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/?token={self.token}"

    def send(
        self,
        method: str,
        path: str,
        body: bytes | str | Iterator[bytes] | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> Answer:
        """Send a request as it is, without a token."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)
        with contextlib.closing(connection):
            connection.request(method, path, body, dict(headers or {}))
            answer = connection.getresponse()
            names = {name.lower(): value for name, value in answer.getheaders()}
            return Answer(answer.status, names, answer.read())

    def ask(
        self,
        method: str,
        path: str,
        body: Mapping[str, Any] | bytes | Iterator[bytes] | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> Answer:
        """Send a request with the token; a dictionary goes as JSON."""
        content = json.dumps(body) if isinstance(body, Mapping) else body
        own = {"Authorization": f"Bearer {self.token}", "Content-Type": "application/json"}
        return self.send(method, path, content, {**own, **(headers or {})})

    def give(self, content: bytes, name: str) -> str:
        """Give the server a file; return its id."""
        answer = self.ask("POST", f"/api/files?name={name}", content)
        assert answer.status == 201, answer.content
        return str(answer.json["id"])

    def island(self) -> dict[str, Any]:
        """The voyage of seconds, with its chart."""
        chart = self.give(shapely.to_geojson(ISLAND).encode(), "island.geojson")
        return {**VOYAGE, "charts": chart}

    def begin(self, request: Mapping[str, Any]) -> str:
        """Ask for a plan; return its id."""
        answer = self.ask("POST", "/api/plan", dict(request))
        assert answer.status == 202, answer.content
        return str(answer.json["id"])

    def state(self, identity: str) -> dict[str, Any]:
        """What the server tells of a plan."""
        found: dict[str, Any] = self.ask("GET", f"/api/plan/{identity}").json
        return found

    def ended(self, identity: str, seconds: float = 120.0) -> dict[str, Any]:
        """Wait for the end of a plan; return what the server tells of it."""
        deadline = time.monotonic() + seconds
        while (plan := self.state(identity))["state"] in _LIVE:
            assert time.monotonic() < deadline, plan
            time.sleep(0.05)
        return plan


@contextlib.contextmanager
def serving(
    output: Path, *options: str, program: tuple[str, ...] = renew("serve")
) -> Iterator[Server]:
    """Start a server at any free port; stop it at the end."""
    given = ("--port", "0", "--output", str(output), "--offline", *options)
    with started(*program, *given) as process:
        assert process.stdout is not None
        address = urlsplit(process.stdout.readline().strip())
        assert address.hostname == "127.0.0.1", process.stderr and process.stderr.read()
        yield Server(process, int(address.port or 0), parse_qs(address.query)["token"][0], output)
