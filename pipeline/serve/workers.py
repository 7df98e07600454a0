"""The workers of a server: started ahead, killed when a plan takes too long, and started again."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from typing import Any

from pipeline.errors import StageError
from pipeline.machine.workers import Worker, WorkerEndedError
from pipeline.serve.worker import answer_request, get_ready

# Plans after which a worker is replaced, so that memory that libraries leak stays bounded.
_MAX_PLANS = 50


class ServingWorker:
    """A process that plans (see `pipeline.serve.worker`), within some bytes of memory."""

    def __init__(self, memory_bytes: int) -> None:
        self._worker = Worker(data_bytes=memory_bytes)
        self._plans = 0
        self._changing = asyncio.Lock()

    @property
    def is_running(self) -> bool:
        """Whether the process lives."""
        return self._worker.is_running

    @property
    def memory_bytes(self) -> int:
        """Resident memory of the process; 0 where the system does not tell it."""
        return self._worker.resident_bytes

    async def start(self) -> None:
        """Start the process unless it runs, and wait until it is ready."""
        async with self._changing:
            if self.is_running and self._plans >= _MAX_PLANS:
                self.kill()
            if not self.is_running:
                self._plans = 0
                self._worker.call(get_ready)
                await self._event()

    async def plan(self, asked: Mapping[str, Any], limit_s: float) -> AsyncIterator[dict[str, Any]]:
        """Plan a voyage; yield its events, "done" or "failed" last.

        If `asked` only prepares, the last is "prepared".

        Raises
        ------
        StageError
            It took too long, or the process ended.
        """
        await self.start()
        self._plans += 1
        try:
            async with asyncio.timeout(limit_s):
                self._worker.call(answer_request, asked)
                while True:
                    event = await self._event()
                    yield event
                    if event["event"] in {"done", "failed", "prepared"}:
                        return
        except TimeoutError:
            self.kill()
            raise StageError(
                f"the plan took longer than {limit_s:g} s; plan a shorter voyage, or raise the "
                "limit: renew serve --limit SECONDS"
            ) from None

    def kill(self) -> None:
        """End the process and all that it started, at once."""
        self._worker.kill()

    async def _event(self) -> dict[str, Any]:
        """Wait for the next event that the process tells; what its calls return is nothing."""
        while True:
            await _readable(self._worker.pipe.fileno())
            try:
                kind, value = self._worker.answer()
            except WorkerEndedError as ended:
                words = str(ended).removeprefix("its process ").removesuffix(" (out of memory?)")
                raise StageError(
                    f"the process that planned {words}; if memory was short, plan a shorter "
                    "voyage, or raise the limit: renew serve --memory GB"
                ) from None
            if kind == "raised":
                raise value
            if kind == "told":
                event: dict[str, Any] = value
                return event


async def _readable(descriptor: int) -> None:
    """Wait until a file descriptor can be read."""
    loop, is_readable = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(descriptor, is_readable.set)
    try:
        await is_readable.wait()
    finally:
        loop.remove_reader(descriptor)
