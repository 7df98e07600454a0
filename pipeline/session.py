"""Open an output folder for a run: lock it, remove leftovers, record the origin, and prune it.

All runs in an output folder share its store. A run holds a shared lock on the store and an
exclusive lock on its scenario. A process that removes files that others may use holds an exclusive
lock on the store.
"""

import contextlib
import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import RequestError, StageError
from pipeline.findings.names import output_directory
from pipeline.machine.files import file_lock, remove_leftovers, write_whole, writing
from pipeline.machine.paths import folder_to_write
from pipeline.machine.store import (
    DOWNLOADS,
    MAX_STORE_BYTES,
    Freed,
    Store,
    prune,
    remove_unfinished,
)
from pipeline.scenario.catalogue import ScenarioFile
from pipeline.sources.copernicus.download import remove_abandoned_downloads

# Folder of the store, inside the output folder.
_ARTEFACTS = ".artefacts"
_STORE_LOCK = "store.lock"
# Time to wait while another process prunes the store, s: it only removes files, which is quick.
_PRUNING_S = 60.0


@dataclass(frozen=True, slots=True)
class Session:
    """A scenario's result folder, to which no other run writes, with the store and the origin."""

    directory: Path
    store: Store
    origin: ScenarioFile | None

    def record_origin(self) -> None:
        """Record the scenario's file from which the results were made."""
        if self.origin is not None and not _is_own(self.directory, self.origin):
            note = {"path": str(self.origin.real_path), "sha256": self.origin.sha256}
            with contextlib.suppress(OSError):
                write_whole(_origin_note(self.store), json.dumps(note) + "\n")


@contextlib.contextmanager
def session(name: str, output: Path, origin: ScenarioFile | None = None) -> Iterator[Session]:
    """Hold the locks of the scenario `name` in an output folder during the `with` block.

    Before, unfinished files of killed runs of the scenario are removed. Afterwards the store is
    pruned if it is too large and no other run uses it. Raises RequestError if `output` can't be a
    folder, or has results of another scenario file with this name; StageError if another run of the
    scenario is writing, or nothing can be written.
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
    # Unless another run uses the store; files of this run stay.
    with contextlib.suppress(OSError), file_lock(root / _STORE_LOCK) as is_held:
        if is_held:
            prune(root, max_bytes=MAX_STORE_BYTES, keep_since=started)


def clean(output: Path, *, max_bytes: float, used_before: float | None = None) -> Freed:
    """Prune the store of an output folder; see `pipeline.machine.store.prune`.

    Raises RequestError if the folder has no store; StageError if a run is using the folder.
    """
    output = folder_to_write(output, "--output")
    root = output / _ARTEFACTS
    if not root.is_dir():
        raise RequestError(f"--output: {output} holds no results of renew; name their folder")
    with writing(root), file_lock(root / _STORE_LOCK) as is_held:
        if not is_held:
            raise StageError(f"a run is at work in {output}: wait until it has ended")
        for hidden in (output / ".results").glob("*"):
            remove_leftovers(output / hidden.name)
        remove_abandoned_downloads(root / DOWNLOADS)
        return prune(root, max_bytes=max_bytes, used_before=used_before)


def _now_in(file: Path) -> float:
    """Return the present time by the clock of a file's file system, s since 1970.

    It may differ from `time.time()`: by some milliseconds, or because a server has its own clock.
    """
    with writing(file.parent):
        os.utime(file)
        return file.stat().st_mtime


@contextlib.contextmanager
def _locks(root: Path, name: str) -> Iterator[None]:
    """Hold a shared lock on the store and an exclusive lock on the scenario."""
    with contextlib.ExitStack() as held:
        with writing(root):
            shares = held.enter_context(
                file_lock(root / _STORE_LOCK, shared=True, wait_s=_PRUNING_S)
            )
            is_alone = held.enter_context(file_lock(root / f"{name}.lock"))
        if not shares:
            raise StageError(f"another program is cleaning {root}: wait until it has ended")
        if not is_alone:
            raise StageError(
                f"another run of {name!r} is writing to {root.parent}: wait until it has ended, or "
                "choose another folder with --output"
            )
        yield


def _remove_leftovers(directory: Path, store: Store) -> None:
    """Remove unfinished files of killed runs of this scenario; files of other runs stay."""
    remove_unfinished(store.root, store.owner)
    remove_abandoned_downloads(store.root / DOWNLOADS)
    with writing(directory):
        remove_leftovers(directory)


def _is_own(directory: Path, origin: ScenarioFile) -> bool:
    """Whether a scenario's file lies in its result folder, where an earlier run wrote it."""
    return origin.real_path.parent == directory.resolve()


def _origin_note(store: Store) -> Path:
    """Return the path of the store's record of its owner's scenario file."""
    return store.root / f"{store.owner}.origin.json"


def _refuse_other_origin(directory: Path, store: Store, origin: ScenarioFile | None) -> None:
    """Raise RequestError if the results were made from another scenario file with this name."""
    if origin is None or not directory.exists() or _is_own(directory, origin):
        return
    try:
        note = json.loads(_origin_note(store).read_text(encoding="utf-8"))
        earlier, there = str(note["sha256"]), Path(note["path"]).resolve()
        hashes = {earlier, hashlib.sha256(there.read_bytes()).hexdigest()}
    except (OSError, ValueError, KeyError, TypeError):
        return  # the origin is unknown or gone: the results may be replaced
    if there != origin.real_path and origin.sha256 not in hashes:
        fault = (
            f"{origin.real_path} and {there} are both called {store.owner!r}, and {directory} has "
            "the results of the latter: rename one of them, or choose another folder with --output"
        )
        raise RequestError(fault)


def _remove_if_unused(root: Path, output: Path | None) -> None:
    """Remove a store that contains only locks, and then the output folder if it is empty.

    Locks are removed only under an exclusive lock on the store, and folders only if empty.
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
