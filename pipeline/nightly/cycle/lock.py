"""The lock of an output folder, which allows one job at a time; its file names the holder."""

import contextlib
import json
import os
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from pipeline.machine.files import file_lock
from pipeline.nightly.cycle.folders import writing
from pipeline.nightly.outcome import BusyError

LOCK = ".nightly.lock"
# Time to wait for the lock, s: `renew nightly status` holds it for a moment, to test it.
_WAIT_S = 0.3


@dataclass(frozen=True, slots=True)
class Holder:
    """The holder of the lock: its process, its machine, and the time when it got the lock (UTC)."""

    pid: int
    host: str
    since: str

    def __str__(self) -> str:
        """Return the holder as text for a message."""
        return f"process {self.pid} on {self.host}, since {self.since}"


@contextlib.contextmanager
def night_lock(output: Path, *, shared: bool = False) -> Iterator[None]:
    """Hold the lock of an output folder, alone or shared with the other jobs of a night.

    Raises
    ------
    BusyError
        Another job holds the lock.
    StageError
        Nothing can be written in the folder.
    """
    path = output / LOCK
    with contextlib.ExitStack() as held:
        with writing(output):
            is_held = held.enter_context(file_lock(path, shared=shared, wait_s=_WAIT_S))
            if is_held:
                now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
                holder = {"pid": os.getpid(), "host": socket.gethostname(), "since": now}
                path.write_text(json.dumps(holder) + "\n", encoding="utf-8")
        if not is_held:
            raise BusyError(f"another job is at work in {output}: {holder_of(output)}")
        yield


def holder_of(output: Path) -> str:
    """Return the holder that the lock's file names, as text."""
    try:
        holder = json.loads((output / LOCK).read_text(encoding="utf-8"))
        return str(Holder(int(holder["pid"]), str(holder["host"]), str(holder["since"])))
    except (OSError, ValueError, KeyError, TypeError):
        return "a process that is just beginning"


def is_busy(output: Path) -> bool:
    """Whether a job holds the lock; writes nothing."""
    path = output / LOCK
    if not path.is_file():
        return False
    with contextlib.suppress(OSError), file_lock(path) as is_free:
        return not is_free
    return True
