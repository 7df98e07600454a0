"""Worker processes: started ahead, killed when a plan takes too long, and started again."""

import asyncio
import contextlib
import json
import os
import signal
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Any

from pipeline.errors import StageError
from pipeline.machine.interpreters import python_command, python_environment

# Longest line that a worker may write, bytes: all routes of twelve months.
_MAX_LINE = 64 << 20
# Characters of a dead worker's last output that are kept for the message.
_MAX_SHOWN = 200
# Plans after which a worker is replaced, so that memory that libraries leak stays bounded.
_MAX_PLANS = 50


class Worker:
    """A process that plans (see `pipeline.serve.worker`), within some bytes of memory."""

    def __init__(self, memory_bytes: int) -> None:
        self._memory = memory_bytes
        self._process: Process | None = None
        self._last_words = ""
        self._listening: asyncio.Task[None] | None = None
        self._plans = 0
        self._changing = asyncio.Lock()

    @property
    def is_running(self) -> bool:
        """Whether the process lives."""
        return self._process is not None and self._process.returncode is None

    @property
    def memory_bytes(self) -> int:
        """Resident memory of the process; 0 where the system does not tell it."""
        try:
            pages = Path(f"/proc/{self._process.pid if self._process else 0}/statm").read_text()
        except OSError:
            return 0
        return int(pages.split()[1]) * os.sysconf("SC_PAGE_SIZE")

    async def start(self) -> None:
        """Start the process unless it runs, and wait until it is ready."""
        async with self._changing:
            if self.is_running and self._plans >= _MAX_PLANS:
                await self.kill()
            if not self.is_running:
                await self._start()

    async def _start(self) -> None:
        """Start the process, and wait until it is ready."""
        command = python_command("-m", "pipeline.serve.worker", str(self._memory))
        self._process = await asyncio.create_subprocess_exec(
            *command,
            stdin=PIPE,
            stdout=PIPE,
            stderr=PIPE,
            env={**python_environment()},
            limit=_MAX_LINE,
            start_new_session=True,  # killed together with all that it started
        )
        self._plans, self._last_words = 0, ""
        self._listening = asyncio.create_task(self._listen(self._process))
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
        assert self._process is not None  # noqa: S101 - it was started
        assert self._process.stdin is not None  # noqa: S101 - it is a pipe
        self._plans += 1
        try:
            async with asyncio.timeout(limit_s):
                self._process.stdin.write(json.dumps(asked).encode() + b"\n")
                with contextlib.suppress(ConnectionError):  # the process ended: said below
                    await self._process.stdin.drain()
                while True:
                    event = await self._event()
                    yield event
                    if event["event"] in {"done", "failed", "prepared"}:
                        return
        except TimeoutError:
            await self.kill()
            raise StageError(
                f"the plan took longer than {limit_s:g} s; plan a shorter voyage, or raise the "
                "limit: renew serve --limit SECONDS"
            ) from None

    async def kill(self) -> None:
        """End the process and all that it started, at once."""
        process, self._process = self._process, None
        if process is None:
            return
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        await process.wait()
        if self._listening is not None:
            self._listening.cancel()

    async def _event(self) -> dict[str, Any]:
        """Return the next event."""
        assert self._process is not None  # noqa: S101 - it was started
        assert self._process.stdout is not None  # noqa: S101 - it is a pipe
        line = await self._process.stdout.readline()
        if not line.endswith(b"\n"):
            code = await self._process.wait()
            words = f": {self._last_words[-_MAX_SHOWN:]}" if self._last_words else ""
            raise StageError(
                f"the process that planned ended with code {code}{words}; if memory was short, "
                "plan a shorter voyage, or raise the limit: renew serve --memory GB"
            )
        event: dict[str, Any] = json.loads(line)
        return event

    async def _listen(self, process: Process) -> None:
        """Keep the last line that a process writes to standard error."""
        assert process.stderr is not None  # noqa: S101 - it is a pipe
        with contextlib.suppress(ValueError):  # a line beyond the limit
            async for line in process.stderr:
                self._last_words = line.decode(errors="replace").strip() or self._last_words
