"""One scenario's exclusive use of an output folder: its locks, leftovers, origin and pruning.

All runs in an output folder share its store. A run holds the store's lock shared and its scenario's
lock exclusively; a process that removes files that others may use holds the store's lock
exclusively.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import RequestError, StageError
from pipeline.machine.paths import folder_to_write
from pipeline.machine.storage.locks import file_lock
from pipeline.machine.storage.pruning import MAX_STORE_BYTES, Freed, prune
from pipeline.machine.storage.result_folder import remove_leftovers
from pipeline.machine.storage.store import DOWNLOADS, Store, remove_unfinished
from pipeline.machine.storage.whole_files import write_whole
from pipeline.sources.currents.copernicus.cache import remove_abandoned
from pipeline.stages.write import output_directory

# Folder of the store, inside the output folder.
_ARTEFACTS = ".artefacts"
_STORE_LOCK = "store.lock"
# Time to wait while another process prunes the store, s: that only removes files.
_PRUNING_S = 60.0


@dataclass(frozen=True, slots=True)
class Origin:
    """The file that a scenario was loaded from, and the SHA-256 of its content."""

    path: Path
    sha256: str

    @classmethod
    def of(cls, path: Path) -> Origin:
        """Describe a scenario's file."""
        return cls(path.resolve(), hashlib.sha256(path.read_bytes()).hexdigest())


@dataclass(frozen=True, slots=True)
class Session:
    """The folder of a scenario's results, and the store, while no other run writes there."""

    directory: Path
    store: Store
    origin: Origin | None

    def record_origin(self) -> None:
        """Note which file made the results that were just written."""
        if self.origin is not None and not _is_own(self.directory, self.origin):
            note = {"path": str(self.origin.path), "sha256": self.origin.sha256}
            with contextlib.suppress(OSError):
                write_whole(_origin_note(self.store), json.dumps(note) + "\n")


@contextlib.contextmanager
def session(name: str, output: Path, origin: Origin | None = None) -> Iterator[Session]:
    """Prepare a run that is the only one of the scenario `name` in an output folder.

    What a killed run of the scenario left unfinished is removed before; afterwards the store is
    pruned where it is too large and nobody else uses it.

    Raises
    ------
    RequestError
        `output` can't be a folder, or holds results that another file of this name made.
    StageError
        Another run of the scenario is at work, or nothing can be written.
    """
    output = folder_to_write(output, "--output")
    root, is_new = output / _ARTEFACTS, not output.exists()
    store, started = Store(root, owner=name), 0.0
    try:
        with _locks(root, name):
            started = _now_in(root / f"{name}.lock")
            directory = output_directory(output, name)
            _remove_leftovers(directory, store)
            _refuse_other_origin(directory, store, origin)
            yield Session(directory, store, origin)
    except RequestError:
        _remove_if_unused(root, output if is_new else None)
        raise
    _prune_after_run(root, started)


def clean(output: Path, *, max_bytes: float, used_before: float | None = None) -> Freed:
    """Prune the store of an output folder; see `pipeline.machine.storage.pruning.prune`.

    Raises
    ------
    RequestError
        There is no such folder.
    StageError
        A run is at work in it.
    """
    output = folder_to_write(output, "--output")
    root = output / _ARTEFACTS
    if not root.is_dir():
        raise RequestError([f"--output: {output} holds no results of renew; name their folder"])
    with _writing(root), file_lock(root / _STORE_LOCK) as is_held:
        if not is_held:
            raise StageError(f"a run is at work in {output}: wait until it has ended")
        for hidden in (output / ".results").glob("*"):
            remove_leftovers(output / hidden.name)
        remove_abandoned(root / DOWNLOADS)
        return prune(root, max_bytes=max_bytes, used_before=used_before)


def _now_in(file: Path) -> float:
    """Return the time by the clock of a file's file system, s since 1970.

    It may be some milliseconds behind `time.time()`, and another machine's.
    """
    with _writing(file.parent):
        os.utime(file)
        return file.stat().st_mtime


@contextlib.contextmanager
def _locks(root: Path, name: str) -> Iterator[None]:
    """Hold the store's lock with other runs, and the scenario's alone."""
    with contextlib.ExitStack() as held:
        with _writing(root):
            shares = held.enter_context(
                file_lock(root / _STORE_LOCK, shared=True, wait_s=_PRUNING_S)
            )
            is_alone = held.enter_context(file_lock(root / f"{name}.lock"))
        if not shares:
            raise StageError(f"another program cleans {root}: wait until it has ended")
        if not is_alone:
            raise StageError(
                f"another run of {name!r} is writing to {root.parent}: wait until it has ended, or "
                "choose another folder with --output"
            )
        yield


@contextlib.contextmanager
def _writing(folder: Path) -> Iterator[None]:
    """Turn errors of the file system into a StageError with a remedy."""
    try:
        yield
    except OSError as error:
        raise StageError(
            f"can't write in {folder}: {error.strerror or error}; choose another folder with "
            "--output"
        ) from error


def _remove_leftovers(directory: Path, store: Store) -> None:
    """Remove what killed runs of this scenario left unfinished; others may be at work."""
    remove_unfinished(store.root, store.owner)
    remove_abandoned(store.root / DOWNLOADS)
    with _writing(directory):
        remove_leftovers(directory)


def _is_own(directory: Path, origin: Origin) -> bool:
    """Whether a scenario's file is one that an earlier run wrote among its results."""
    return origin.path.parent == directory.resolve()


def _origin_note(store: Store) -> Path:
    """Where a store notes which file made the results of its owner."""
    return store.root / f"{store.owner}.origin.json"


def _refuse_other_origin(directory: Path, store: Store, origin: Origin | None) -> None:
    """Refuse to replace results that another scenario's file of the same name made."""
    if origin is None or not directory.exists() or _is_own(directory, origin):
        return
    try:
        note = json.loads(_origin_note(store).read_text(encoding="utf-8"))
        earlier = Origin(Path(note["path"]), str(note["sha256"]))
        there = Origin.of(earlier.path)
    except (OSError, ValueError, KeyError, TypeError):
        return  # nobody knows, or that file is gone: this one may take its place
    if there.path != origin.path and origin.sha256 not in {earlier.sha256, there.sha256}:
        fault = (
            f"{origin.path} and {there.path} are both called {store.owner!r}, and {directory} has "
            "the results of the latter: rename one of them, or choose another folder with --output"
        )
        raise RequestError([fault])


def _remove_if_unused(root: Path, output: Path | None) -> None:
    """Remove a store that holds nothing but locks, and an output folder that is empty then.

    Only a process that holds the store's lock alone removes a lock; a folder goes only if empty.
    """
    with contextlib.suppress(OSError):
        if not root.is_dir():
            return
        with file_lock(root / _STORE_LOCK) as is_held:
            if not is_held:
                return
            for folder in (path for path in root.iterdir() if path.is_dir()):
                folder.rmdir()
            if all(path.suffix == ".lock" for path in root.iterdir()):
                for lock in sorted(root.iterdir(), key=lambda path: path.name == _STORE_LOCK):
                    lock.unlink()
                root.rmdir()
        if output is not None:
            output.rmdir()


def _prune_after_run(root: Path, started: float) -> None:
    """Prune a store that is too large, unless another run uses it; keep what this run used."""
    with contextlib.suppress(OSError), file_lock(root / _STORE_LOCK) as is_held:
        if is_held:
            prune(root, max_bytes=MAX_STORE_BYTES, keep_since=started)
