"""Locks on files, which the system releases when their process ends for any reason."""

import contextlib
import fcntl
import os
import time
from collections.abc import Iterator
from pathlib import Path

# Time between two attempts, s.
_PAUSE_S = 0.05
# Number of times that the lock's folder may vanish before it is locked: other processes remove it
# at most once each. If it vanishes more often, the file system can't hold it at all, like /proc.
_MAX_VANISHED = 20


@contextlib.contextmanager
def file_lock(path: Path, *, shared: bool = False, wait_s: float = 0.0) -> Iterator[bool]:
    """Hold a lock on a file, created if needed; yield False if another process holds it.

    A process with the exclusive lock may remove the file: others then lock a new one.

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
    """Open and lock a file; None if others still hold it after the wait."""
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
    """Whether an open file is still at its path: it may have been removed before it was locked."""
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False
