"""Locks on files, which the system releases when their process ends, however that happens."""

from __future__ import annotations

import contextlib
import fcntl
import os
import time
from collections.abc import Iterator
from pathlib import Path

# Time between two attempts, s.
_PAUSE_S = 0.05
# Number of times that the lock's folder may vanish while it is locked: others remove it at most
# once each. More, and the file system has no room for it at all, as /proc has not.
_MAX_VANISHED = 20


@contextlib.contextmanager
def file_lock(path: Path, *, shared: bool = False, wait_s: float = 0.0) -> Iterator[bool]:
    """Hold a lock on a file, made with its folder if needed; give False where others hold it.

    A lock file may be removed by whoever holds it alone: others then lock a new one.

    Raises
    ------
    OSError
        The file can't be made or locked.
    """
    descriptor = _acquire(path, fcntl.LOCK_SH if shared else fcntl.LOCK_EX, wait_s)
    try:
        yield descriptor is not None
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _acquire(path: Path, kind: int, wait_s: float) -> int | None:
    """Open and lock a file; None where others hold it still after the wait."""
    deadline, vanished = time.monotonic() + wait_s, 0
    while True:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except (FileNotFoundError, FileExistsError):  # its folder was removed in between
            vanished += 1
            if vanished > _MAX_VANISHED:
                raise
            continue
        try:
            fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
            if _is_at(path, descriptor):
                return descriptor
        except BlockingIOError:
            if time.monotonic() >= deadline:
                os.close(descriptor)
                return None
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)
        time.sleep(_PAUSE_S)


def _is_at(path: Path, descriptor: int) -> bool:
    """Whether the open file is the one at a path: it may have been removed before it was locked."""
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False
