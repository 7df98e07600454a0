"""Pruning of the store: files are removed in the order of their last use, oldest first."""

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.machine.storage.store import DOWNLOADS, SUFFIX, remove_unfinished

MAX_STORE_BYTES = 2_000_000_000
"""Size to which the store is pruned after a run, bytes: about a thousand runs of two seasons."""


@dataclass(frozen=True, slots=True)
class Freed:
    """Number and size of the removed files, and size of the remaining ones, bytes."""

    files: int
    size: int
    remaining: int


@dataclass(frozen=True, slots=True)
class _Item:
    """An artefact, or a download with its sidecar."""

    files: tuple[Path, ...]
    size: int
    used: float


def prune(
    root: Path, *, max_bytes: float, used_before: float | None = None, keep_since: float = 0.0
) -> Freed:
    """Remove unfinished files, and artefacts and downloads until a store is small enough.

    Must not be called while a run uses the store.

    Parameters
    ----------
    root
        The store's folder.
    max_bytes
        Size that may remain; files used longest ago are removed first.
    used_before
        All files last used before this time (s since 1970) are removed.
    keep_since
        All files used after this time (s since 1970) stay, whatever their size; 0 for no limit.
    """
    remove_unfinished(root)
    items = sorted(_items(root), key=lambda item: item.used)
    total = remaining = sum(item.size for item in items)
    count = 0
    for item in items:
        is_old = used_before is not None and item.used < used_before
        is_in_use = keep_since > 0 and item.used >= keep_since
        if is_in_use or not (is_old or remaining > max_bytes):
            continue
        with contextlib.suppress(OSError):
            for file in item.files:
                file.unlink(missing_ok=True)
                count += 1
            remaining -= item.size
    return Freed(count, total - remaining, remaining)


def seconds_ago(days: float) -> float:
    """Return the time some days ago, s since 1970."""
    return time.time() - days * 86_400


def _items(root: Path) -> Iterator[_Item]:
    """Yield all items of a store, without its locks and its notes on the results' origins."""
    for path in root.glob(f"*/*{SUFFIX}"):
        with contextlib.suppress(OSError):
            state = path.stat()
            yield _Item((path,), state.st_size, state.st_mtime)
    groups: dict[Path, list[Path]] = {}
    for path in (root / DOWNLOADS).rglob("*"):
        if path.is_file() and not path.is_symlink():
            groups.setdefault(path.with_suffix(""), []).append(path)
    for files in groups.values():
        with contextlib.suppress(OSError):
            states = [file.stat() for file in files]
            # Reading a download does not set its modification time.
            used = max(max(state.st_mtime, state.st_atime) for state in states)
            yield _Item(tuple(files), sum(state.st_size for state in states), used)
