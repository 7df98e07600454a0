"""Start the server: open a port of this machine, print the first address, answer until Ctrl-C."""

import asyncio
import contextlib
import socket
import webbrowser
from collections.abc import Callable, Iterator
from typing import ClassVar

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from pipeline.errors import RequestError
from pipeline.serve.app import make_app
from pipeline.serve.guard import Keys
from pipeline.serve.options import ServerOptions
from pipeline.serve.plans import Plans
from pipeline.serve.request import GivenFiles

HOST = "127.0.0.1"
"""The one address that the server listens at: nobody else's machine reaches it."""
USUAL_PORT = 8137
"""The port where none is asked for, if it is free."""
# Folder, inside the output folder, of the files that the page is given.
_GIVEN = ".given"
# Connections at a time: a browser opens six. For another, the oldest without a request is closed.
_MAX_CONNECTIONS = 200
# Seconds in which the head of a request must come.
_HEAD_S = 10.0
# Seconds that answers in progress have at the end.
_GRACE_S = 2
_GB = 1_000_000_000


def serve(options: ServerOptions, on_ready: Callable[[str], None]) -> None:
    """Serve the page until the process is stopped; call `on_ready` with the first address.

    Raises
    ------
    RequestError
        The port is taken.
    """
    with _listening(options.port) as opened:
        keys = Keys(opened.getsockname()[1])
        plans = Plans(
            options.output,
            offline=options.offline,
            workers=options.workers,
            limit_s=options.limit,
            memory_bytes=round(options.memory * _GB),
        )
        app = make_app(keys, plans, GivenFiles(options.output / _GIVEN))
        config = uvicorn.Config(
            app,
            log_level="warning",
            access_log=False,
            server_header=False,
            http=_Connection,
            limit_concurrency=_MAX_CONNECTIONS + 1,
            timeout_graceful_shutdown=_GRACE_S,
        )

        def tell() -> None:
            on_ready(keys.address)
            if options.opens:
                webbrowser.open(keys.address)

        server = _Server(config, tell)
        server.run(sockets=[opened])


class _Connection(H11Protocol):
    """A connection that is closed if no request comes in time, or when others need its place."""

    _open: ClassVar[dict["_Connection", None]] = {}  # the oldest first

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Make room, and wait for a request."""
        super().connection_made(transport)
        if len(self._open) >= _MAX_CONNECTIONS:
            next(filter(_Connection.is_idle, self._open), self).end_if_idle()
        self._open[self] = None
        self._head = self.loop.call_later(_HEAD_S, self.end_if_idle)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._open.pop(self, None)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take a part of a request; the head of the next one has its own time."""
        super().data_received(data)
        if not self.is_idle() or self._head.when() < self.loop.time():
            self._head.cancel()
            self._head = self.loop.call_later(_HEAD_S, self.end_if_idle)

    def is_idle(self) -> bool:
        """Whether there is no request whose answer is not complete."""
        return self.cycle is None or self.cycle.response_complete  # type: ignore[redundant-expr]

    def end_if_idle(self) -> None:
        """Close the connection, unless a request is at work."""
        if self.is_idle():
            self._open.pop(self, None)
            self.transport.abort()


class _Server(uvicorn.Server):
    """A server that says when it answers."""

    def __init__(self, config: uvicorn.Config, on_ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._on_ready = on_ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to answer."""
        await super().startup(sockets=sockets)
        self._on_ready()


@contextlib.contextmanager
def _listening(port: int | None) -> Iterator[socket.socket]:
    """Open a port of this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as opened:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            opened.bind((HOST, USUAL_PORT if port is None else port))
        except OSError as error:
            if port is not None:
                raise RequestError(
                    f"--port = {port} can't be opened ({error.strerror}); choose another one, or "
                    "leave it out for any that is free"
                ) from error
            opened.bind((HOST, 0))
        yield opened
