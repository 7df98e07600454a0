"""The fault table: each way in which the service and its client were seen to fail, injected."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.errors import StageError
from pipeline.sources.copernicus.adapter import Copernicus
from pipeline.sources.copernicus.download import step_ends
from tests.loopback_store import world
from tests.loopback_store.rows import Row
from tests.loopback_store.server import LoopbackStore

# Time for starting and ending a process, added to its deadline, s.
_MARGIN_S = 8.0


@dataclass(frozen=True)
class Outcome:
    """The result of a row."""

    error_m_s: float | None
    reason: str
    seconds: float
    limit_s: float
    leftovers: tuple[str, ...]
    clients: int
    written: str

    def is_wrong(self, row: Row) -> bool:
        """Whether a wrong field was accepted."""
        return self.error_m_s is not None and self.error_m_s > row.tolerance_m_s

    @property
    def is_hung(self) -> bool:
        """Whether it took longer than its deadlines allow."""
        return self.seconds > self.limit_s

    @property
    def has_leftovers(self) -> bool:
        """Whether a file or a process was left behind."""
        return bool(self.leftovers) or self.clients > 0


def inject(row: Row, folder: Path) -> Outcome:
    """Inject a row's fault into a download into a folder."""
    entry = row.entry()
    source, season = Copernicus(entry), world.season(row.valid)
    store = world.store(row.source, **row.dataset)
    store.faults.extend(replace(fault) for fault in row.faults)
    downloads, home = folder / "downloads", folder / "home"
    downloads.mkdir(parents=True)
    if row.prepare is not None:
        row.prepare(downloads)
    before = {path: path.read_bytes() for path in downloads.iterdir() if path.is_file()}
    pauses = sum(entry.pause_s * 3**attempt for attempt in range(entry.attempts - 1))
    limit = entry.attempts * (entry.deadline_s + _MARGIN_S) + pauses
    reason, error_m_s = "", None
    with world.connected(store, home, row.environment):
        begun = time.monotonic()
        with _killing(store, row.kill):
            try:
                grid = source.current(world.REGION, season, world.LAND, downloads)
            except StageError as raised:
                reason = str(raised)
            else:
                steps = source.asked(world.REGION, season).steps
                moments = [step_ends(entry, moment)[0] for moment in steps.moments]
                error_m_s = world.max_error_m_s(grid, entry.eastward, entry.northward, *moments)
        seconds = time.monotonic() - begun
        clients = len(clients_of(store))
    left = [path for path in downloads.rglob("*") if path.is_dir() or not _belongs(path, before)]
    if reason:
        left += [path for path in downloads.iterdir() if path not in before]
    return Outcome(
        error_m_s=error_m_s,
        reason=reason,
        seconds=seconds,
        limit_s=limit,
        leftovers=tuple(sorted({path.name for path in left})),
        clients=clients,
        written="\n".join(
            path.read_text("latin-1") for path in folder.rglob("*") if path.is_file()
        ),
    )


def _belongs(path: Path, before: dict[Path, bytes]) -> bool:
    """Whether a file was there before, or is a field or its sidecar."""
    return path in before or path.suffix in {".nc", ".json"}


@contextlib.contextmanager
def _killing(store: LoopbackStore, by: signal.Signals | None) -> Iterator[None]:
    """Kill the first client as soon as it waits for a chunk."""
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(0.05):
            if any("/uo/" in path for _, path, _ in store.requests):
                for process in clients_of(store):
                    os.kill(process, by or signal.SIGKILL)
                return

    thread = threading.Thread(target=watch, daemon=True)
    if by is not None:
        thread.start()
    try:
        yield
    finally:
        ended.set()
        if by is not None:
            thread.join()


def clients_of(store: LoopbackStore) -> list[int]:
    """Return the other processes that have this store as their proxy."""
    mark = f"HTTP_PROXY=http://127.0.0.1:{store.server.server_address[1]}\0".encode()
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if int(folder.name) != os.getpid() and mark in (folder / "environ").read_bytes():
                found.append(int(folder.name))
    return found
