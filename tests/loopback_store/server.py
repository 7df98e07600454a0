"""The store's HTTP server: a proxy that answers every address itself, and fails when told to.

The client drops the port from the addresses of data, so it is sent here as to a proxy: plain HTTP
by absolute address, the login by CONNECT and TLS with a certificate made for the test.
"""

from __future__ import annotations

import contextlib
import json
import socket
import ssl
import threading
import time
from dataclasses import dataclass, field
from fnmatch import fnmatch
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any, Literal, cast
from urllib.parse import parse_qs, urlsplit

from tests.loopback_store.datasets import CODEC, ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import trustme

    from tests.loopback_store.datasets import Dataset
    from tests.loopback_store.ocean import Ocean

LOGIN = "auth.marine.copernicus.eu"
USERNAME, PASSWORD = "captain.nemo", "twenty-thousand-leagues"
_TOKEN = "token-of-the-loopback-store"  # noqa: S105 - the same
_CONFIG = "/meta/clientsConfigV1.json"


@dataclass
class Fault:
    """How answers to paths like `where` (a pattern of the shell) fail, the first `times` of them.

    A number is an HTTP status. "cut" breaks off in the middle of a body, "reset" before it,
    "stall" never answers, "gone" ends the server; "short", "empty", "garbage", "flipped" and
    "value" are whole answers with a wrong body: a `bit` of it is flipped, or of the figures in it.
    """

    where: str
    how: (
        int
        | Literal["cut", "reset", "stall", "gone", "short", "empty", "garbage", "flipped", "value"]
    )
    times: float = float("inf")
    after: int = 0
    bit: int = 0
    met: int = 0


@dataclass
class LoopbackStore:
    """A running store; `heard` lists (method, path, status) of what was asked."""

    ocean: Ocean
    datasets: tuple[Dataset, ...]
    authority: trustme.CA
    faults: list[Fault] = field(default_factory=list)
    heard: list[tuple[str, str, int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.lock = threading.Lock()
        self.server = _Server(self)
        self.tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.authority.issue_cert(LOGIN).configure_cert(self.tls)

    @contextlib.contextmanager
    def running(self) -> Iterator[LoopbackStore]:
        """Serve until the block ends; whoever still waits for an answer is let go."""
        thread = threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        try:
            yield self
        finally:
            self.stop()
            thread.join(10)

    def stop(self) -> None:
        """Close the door: no more connections, and those that are open break."""
        self.server.is_gone.set()
        self.server.shutdown()
        self.server.server_close()

    def environment(self, folder: Path) -> dict[str, str]:
        """Variables by which the client finds this store; `folder` keeps the certificate."""
        certificate = folder / "loopback-ca.pem"
        self.authority.cert_pem.write_to_path(str(certificate))
        address = f"http://127.0.0.1:{self.server.server_address[1]}"
        proxies = ("HTTP_PROXY", "HTTPS_PROXY", "http_proxy", "https_proxy")
        return {
            "COPERNICUSMARINE_CONFIG_URL": f"{ROOT}{_CONFIG}",
            "COPERNICUSMARINE_SET_SSL_CERTIFICATE_PATH": str(certificate),
            "REQUESTS_CA_BUNDLE": str(certificate),
            **dict.fromkeys(proxies, address),
        }

    def fault(self, path: str) -> Fault | None:
        """The fault that this answer meets, if any; it counts."""
        with self.lock:
            for fault in self.faults:
                if fnmatch(path, fault.where):
                    fault.met += 1
                    if fault.after < fault.met <= fault.after + fault.times:
                        return fault
        return None

    def page(self, path: str) -> bytes | None:
        """What stands at a path; None where nothing does."""
        for data in self.datasets:
            here = f"/arco/{data.product}/{data.folder}/"
            if path.startswith(here):
                return data.part(self.ocean, path.removeprefix(here))
        page = self._pages().get(path)
        return None if page is None else json.dumps(page).encode()

    def _pages(self) -> dict[str, object]:
        """The catalogue: every page by its path."""
        return {
            _CONFIG: self._configuration(),
            "/meta/idMapping.json": {data.name: data.product for data in self.datasets},
            "/meta/catalog.stac.json": self._catalogue(),
            **{
                f"/meta/{data.product}/product.stac.json": self._product(data.product)
                for data in self.datasets
            },
            **{
                f"/meta/{data.product}/{data.folder}/dataset.stac.json": data.page()
                for data in self.datasets
            },
        }

    def _configuration(self) -> dict[str, object]:
        """Where the client finds what, and which versions of it may ask."""
        services = ("mds", "mds/serverlessArco/meta", "mds/serverlessArco", "mds/serverlessNative")
        return {
            "clientVersions": dict.fromkeys(services, ">=1.0.0"),
            "catalogues": [
                {
                    "stac": f"{ROOT}/meta/catalog.stac.json",
                    "stacRoot": f"{ROOT}/meta",
                    "idMapping": f"{ROOT}/meta/idMapping.json",
                }
            ],
        }

    def _catalogue(self) -> dict[str, object]:
        """The list of products."""
        products = dict.fromkeys(data.product for data in self.datasets)
        return {
            "type": "Catalog",
            "id": "catalogue",
            "stac_version": "1.0.0",
            "description": "products of the loopback store",
            "links": [
                {"rel": "child", "href": f"{product}/product.stac.json"} for product in products
            ],
        }

    def _product(self, product: str) -> dict[str, object]:
        """A product with its datasets."""
        return {
            "type": "Collection",
            "id": product,
            "stac_version": "1.0.0",
            "title": product,
            "description": "a product of the loopback store",
            "license": "proprietary",
            "extent": {
                "spatial": {"bbox": [[-180, -90, 180, 90]]},
                "temporal": {"interval": [["1993-01-01T00:00:00Z", None]]},
            },
            "links": [
                {"rel": "item", "href": f"{data.folder}/dataset.stac.json"}
                for data in self.datasets
                if data.product == product
            ],
        }


class _Server(ThreadingHTTPServer):
    """Threads that die with the process, and a way to tell them that the store is gone."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, store: LoopbackStore) -> None:
        self.store = store
        self.is_gone = threading.Event()
        super().__init__(("127.0.0.1", 0), _Handler)

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ANN401 - as the base has it
        """A client that was killed hangs up; that is no news."""


class _Handler(BaseHTTPRequestHandler):
    """One connection."""

    protocol_version = "HTTP/1.1"

    @property
    def store(self) -> LoopbackStore:
        """The store that it belongs to."""
        return cast("_Server", self.server).store

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as the base has it
        """Say nothing: `heard` keeps the record."""

    def finish(self) -> None:
        """Close what `do_CONNECT` has put in the place of the server's own connection, too."""
        super().finish()
        self.connection.close()

    def do_CONNECT(self) -> None:
        """Become the login host: answer on, in TLS."""
        if (fault := self.store.fault(f"CONNECT {self.path}")) is not None:
            self._fail(fault, b"")
            return
        self.send_response(200)
        self.end_headers()
        self.wfile.flush()
        try:
            inner = self.store.tls.wrap_socket(self.connection, server_side=True)
        except (OSError, ssl.SSLError):
            self.close_connection = True
            return
        self.connection = self.request = inner
        self.rfile, self.wfile = inner.makefile("rb"), cast("Any", inner.makefile("wb", 0))
        self.close_connection = False

    def do_POST(self) -> None:
        """Log in."""
        form = parse_qs(self.rfile.read(int(self.headers.get("Content-Length", 0))).decode())
        right = (form.get("username"), form.get("password")) == ([USERNAME], [PASSWORD])
        if right:
            self._answer(200, json.dumps({"access_token": _TOKEN}).encode())
        else:
            self._answer(400, b'{"error": "invalid_grant"}')

    def do_GET(self) -> None:
        """A page, a chunk, or who has logged in."""
        path = urlsplit(self.path).path
        if path.endswith("/userinfo"):
            known = self.headers.get("Authorization") == f"Bearer {_TOKEN}"
            self._answer(
                200 if known else 401, json.dumps({"preferred_username": USERNAME}).encode()
            )
            return
        body = self.store.page(path)
        # As the real one has it for a key that does not exist.
        self._answer(200 if body is not None else 403, body or b"")

    def _answer(self, status: int, body: bytes) -> None:
        """Send an answer, or fail in the way that was asked for."""
        path = urlsplit(self.path).path
        fault = self.store.fault(path)
        self.store.heard.append((self.command, path, status))
        if fault is not None:
            self._fail(fault, body)
            return
        self._send(status, body)

    def _send(self, status: int, body: bytes) -> None:
        """Send a whole answer."""
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _fail(self, fault: Fault, body: bytes) -> None:
        """Fail."""
        server = cast("_Server", self.server)
        if isinstance(fault.how, int):
            self._send(fault.how, b"")
        elif fault.how == "stall":
            server.is_gone.wait()
            self._hang_up()
        elif fault.how == "reset":
            self._hang_up()
        elif fault.how == "gone":
            threading.Thread(target=self.store.stop, daemon=True).start()
            server.is_gone.wait()
            time.sleep(0.2)
            self._hang_up()
        elif fault.how == "cut":
            self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body[: len(body) // 2])
            self._hang_up()
        else:
            self._send(200, _spoilt(fault, body))

    def _hang_up(self) -> None:
        """Break the connection."""
        self.close_connection = True
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)


def _spoilt(fault: Fault, body: bytes) -> bytes:
    """A wrong body in place of the right one."""
    if fault.how == "flipped":
        return _flipped(body, fault.bit)
    if fault.how == "value":
        return bytes(CODEC.encode(_flipped(bytes(CODEC.decode(body)), fault.bit)))
    wrong = {"short": body[: len(body) // 2], "empty": b"", "garbage": b"\x5a" * len(body)}
    return wrong[str(fault.how)]


def _flipped(body: bytes, bit: int) -> bytes:
    """The same with one bit the other way."""
    place = bit % (8 * len(body))
    spoilt = bytearray(body)
    spoilt[place // 8] ^= 1 << place % 8
    return bytes(spoilt)
