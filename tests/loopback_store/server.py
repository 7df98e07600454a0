"""The store's HTTP server: a proxy that answers every address itself, and fails as requested.

The client drops the port from the addresses of data, so this server is its proxy: plain HTTP by
absolute address, the login by CONNECT and TLS with a certificate made for the test.
"""

from __future__ import annotations

import contextlib
import json
import socket
import ssl
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from fnmatch import fnmatch
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Literal, cast
from urllib.parse import parse_qs, urlsplit

import trustme

from tests.loopback_store.datasets import CODEC, ROOT, Dataset, Ocean

LOGIN = "auth.marine.copernicus.eu"
USERNAME, PASSWORD = "captain.nemo", "twenty-thousand-leagues"
_TOKEN = "token-of-the-loopback-store"  # noqa: S105 - the same
_CONFIG = "/meta/clientsConfigV1.json"


@dataclass
class Fault:
    """How answers to paths that match `pattern` (of the shell) fail: `times` of them, `after` some.

    A number is an HTTP status. "cut" breaks off in the middle of a body, "reset" before it,
    "stall" never answers, "gone" ends the server; "short", "empty", "garbage", "flipped" and
    "value" are complete answers with a wrong body: a `bit` of it is flipped, or of its values.
    """

    pattern: str
    kind: (
        int
        | Literal["cut", "reset", "stall", "gone", "short", "empty", "garbage", "flipped", "value"]
    )
    times: float = float("inf")
    after: int = 0
    bit: int = 0
    matches: int = 0


@dataclass
class LoopbackStore:
    """A store; `requests` lists (method, path, status) of what was requested."""

    ocean: Ocean
    datasets: tuple[Dataset, ...]
    authority: trustme.CA
    faults: list[Fault] = field(default_factory=list)
    requests: list[tuple[str, str, int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.lock = threading.Lock()
        self.server = _Server(self)
        self.tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.authority.issue_cert(LOGIN).configure_cert(self.tls)

    @contextlib.contextmanager
    def running(self) -> Iterator[LoopbackStore]:
        """Serve until the block ends, then break the connections that still wait."""
        thread = threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        try:
            yield self
        finally:
            self.stop()
            thread.join(10)

    def stop(self) -> None:
        """Accept no more connections, and break those that are open."""
        self.server.is_gone.set()
        self.server.shutdown()
        self.server.server_close()

    def environment(self, folder: Path) -> dict[str, str]:
        """Return the variables by which the client finds this store; the certificate is a file."""
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
        """Return the fault of this answer, if any, and count it."""
        with self.lock:
            for fault in self.faults:
                if fnmatch(path, fault.pattern):
                    fault.matches += 1
                    if fault.after < fault.matches <= fault.after + fault.times:
                        return fault
        return None

    def page(self, path: str) -> bytes | None:
        """Return the content of a path; None where there is none."""
        for data in self.datasets:
            root = f"/arco/{data.product}/{data.folder}/"
            if path.startswith(root):
                return data.file(self.ocean, path.removeprefix(root))
        page = self._pages().get(path)
        return None if page is None else json.dumps(page).encode()

    def _pages(self) -> dict[str, object]:
        """The catalogue's pages by their paths."""
        return {
            _CONFIG: self._configuration(),
            "/meta/idMapping.json": {data.name: data.product for data in self.datasets},
            "/meta/catalog.stac.json": self._catalogue(),
            **{
                f"/meta/{data.product}/product.stac.json": self._product(data.product)
                for data in self.datasets
            },
            **{
                f"/meta/{data.product}/{data.folder}/dataset.stac.json": data.stac_item()
                for data in self.datasets
            },
        }

    def _configuration(self) -> dict[str, object]:
        """Where the client finds the catalogue, and which versions of it are allowed."""
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
    """A server whose threads end with the process, with an event for the end of the store."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, store: LoopbackStore) -> None:
        self.store = store
        self.is_gone = threading.Event()
        super().__init__(("127.0.0.1", 0), _Handler)

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ANN401 - as the base has it
        """Ignore clients that were killed."""


class _Handler(BaseHTTPRequestHandler):
    """One connection."""

    protocol_version = "HTTP/1.1"

    @property
    def store(self) -> LoopbackStore:
        """The store that the connection belongs to."""
        return cast("_Server", self.server).store

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as the base has it
        """Print nothing: `requests` has the record."""

    def finish(self) -> None:
        """Close the connection by which `do_CONNECT` replaced the server's own, too."""
        super().finish()
        self.connection.close()

    def do_CONNECT(self) -> None:
        """Become the login host: continue in TLS."""
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
        is_valid = (form.get("username"), form.get("password")) == ([USERNAME], [PASSWORD])
        if is_valid:
            self._answer(200, json.dumps({"access_token": _TOKEN}).encode())
        else:
            self._answer(400, b'{"error": "invalid_grant"}')

    def do_GET(self) -> None:
        """Answer with a page, a chunk, or the name of who has logged in."""
        path = urlsplit(self.path).path
        if path.endswith("/userinfo"):
            is_known = self.headers.get("Authorization") == f"Bearer {_TOKEN}"
            self._answer(
                200 if is_known else 401, json.dumps({"preferred_username": USERNAME}).encode()
            )
            return
        body = self.store.page(path)
        # The real store answers 403 for a key that does not exist.
        self._answer(200 if body is not None else 403, body or b"")

    def _answer(self, status: int, body: bytes) -> None:
        """Send an answer, or fail as requested."""
        path = urlsplit(self.path).path
        fault = self.store.fault(path)
        self.store.requests.append((self.command, path, status))
        if fault is not None:
            self._fail(fault, body)
            return
        self._send(status, body)

    def _send(self, status: int, body: bytes) -> None:
        """Send a complete answer."""
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _fail(self, fault: Fault, body: bytes) -> None:
        """Fail in a fault's way."""
        server = cast("_Server", self.server)
        if isinstance(fault.kind, int):
            self._send(fault.kind, b"")
        elif fault.kind == "stall":
            server.is_gone.wait()
            self._break_connection()
        elif fault.kind == "reset":
            self._break_connection()
        elif fault.kind == "gone":
            threading.Thread(target=self.store.stop, daemon=True).start()
            server.is_gone.wait()
            time.sleep(0.2)
            self._break_connection()
        elif fault.kind == "cut":
            self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body[: len(body) // 2])
            self._break_connection()
        else:
            self._send(200, _damaged(fault, body))

    def _break_connection(self) -> None:
        """Break the connection."""
        self.close_connection = True
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)


def _damaged(fault: Fault, body: bytes) -> bytes:
    """Return a wrong body in place of the right one."""
    if fault.kind == "flipped":
        return _with_bit_flipped(body, fault.bit)
    if fault.kind == "value":
        return bytes(CODEC.encode(_with_bit_flipped(bytes(CODEC.decode(body)), fault.bit)))
    wrong = {"short": body[: len(body) // 2], "empty": b"", "garbage": b"\x5a" * len(body)}
    return wrong[str(fault.kind)]


def _with_bit_flipped(body: bytes, bit: int) -> bytes:
    """Flip one bit."""
    number = bit % (8 * len(body))
    damaged = bytearray(body)
    damaged[number // 8] ^= 1 << number % 8
    return bytes(damaged)
