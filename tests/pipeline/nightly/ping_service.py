"""A service that watches jobs, on this machine."""

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class Service(ThreadingHTTPServer):
    """Notes what it is asked for; answers 404 below /unknown, and never below /silent."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.ended = threading.Event()
        super().__init__(("127.0.0.1", 0), _Handler)

    @property
    def url(self) -> str:
        """Its address."""
        return f"http://127.0.0.1:{self.server_address[1]}"


class _Handler(BaseHTTPRequestHandler):
    server: Service

    def do_GET(self) -> None:
        """Answer."""
        self.server.asked.append(self.path)
        if self.path.startswith("/silent"):
            self.server.ended.wait(20)
        self.send_response(404 if self.path.startswith("/unknown") else 200)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - its name there
        """Say nothing."""
