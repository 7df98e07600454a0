"""Files that are whole or missing even after a power cut, locks on files, and folders of results.

A file system may put a rename on the disk before the renamed file's content: after a power cut a
file of length 0 has the right name. So the content is flushed first, then the file is renamed, then
its folder is flushed.

A folder of results is replaced as a whole: a reader sees the old files or the new ones.
`outputs/<name>` is a symbolic link to a folder in `outputs/.results/<name>/`. New results are
written to another folder there; when all of them are on the disk, one rename moves the link. Files
that are not results, such as the user's own, are carried over. Where there is a real folder in the
link's place (made by hand, by an earlier version, or because the file system has no links), it is
moved aside first; if the program is killed just then, the next start moves it back.
"""

import contextlib
import errno
import fcntl
import os
import secrets
import shutil
import time
import uuid
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import IO

from pipeline.errors import MachineError

UNFINISHED = ".tmp"
"""Suffix of files that are being written."""


@contextlib.contextmanager
def needed(what: str, remedy: str) -> Iterator[None]:
    """Turn an OSError in the `with` block into a MachineError: what fails, the reason, a remedy."""
    try:
        yield
    except OSError as error:
        raise MachineError(f"{what}: {error.strerror or error}; {remedy}") from error


def writing(folder: Path) -> contextlib.AbstractContextManager[None]:
    """Turn an OSError in the `with` block into a StageError about a folder of results."""
    return needed(f"can't write in {folder}", "choose another folder with --output")


@contextlib.contextmanager
def whole_file(path: Path, owner: str = "") -> Iterator[IO[bytes]]:
    """Provide a new file to write; if the block ends without error, it is renamed to the path.

    Raises OSError if the disk refuses; an earlier file at the path is unchanged. `owner` is the
    prefix of the unfinished file's name, by which leftovers of a killed process are found; by
    default the file's own name.
    """
    fresh = path.with_name(f".{owner or path.name}.{secrets.token_hex(8)}{UNFINISHED}")
    try:
        with fresh.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(path)
    finally:
        fresh.unlink(missing_ok=True)
    flush(path.parent)


def write_whole(path: Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    with whole_file(path) as file:
        file.write(text.encode())


def flush_tree(folder: Path) -> None:
    """Flush a folder, all files and folders in it, and their names to the disk."""
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            flush_tree(path)
        elif path.is_file() and not path.is_symlink():
            flush(path)
    flush(folder)


def flush(path: Path) -> None:
    """Flush a file's content, or the names in a folder, to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def remove_abandoned(folder: Path, pattern: str, age_s: float) -> None:
    """Remove what killed processes left unfinished in a folder, from an age (s) on."""
    for path in folder.glob(pattern):
        with contextlib.suppress(OSError):
            if time.time() - path.stat().st_mtime > age_s:
                _remove(path)


# Time between two attempts, s.
_PAUSE_S = 0.05
# Number of times that the lock's folder may vanish before it is locked: other processes remove it
# at most once each. If it vanishes more often, the file system can't hold it at all, like /proc.
_MAX_VANISHED = 20


@contextlib.contextmanager
def file_lock(path: Path, *, shared: bool = False, wait_s: float = 0.0) -> Iterator[bool]:
    """Hold a lock on a file, created if needed; yield False if another process holds it.

    A process with the exclusive lock may remove the file: others then lock a new one. Raises
    OSError if the file can't be made or locked.
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


_HIDDEN = ".results"
# Beginning of the name of a real folder that was moved aside.
_ASIDE = "aside-"
_NO_LINKS = {errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS}


@contextlib.contextmanager
def replacing(directory: Path, results: Callable[[], Collection[str]]) -> Iterator[Path]:
    """Provide an empty folder to fill; if the block ends without error, it replaces a directory.

    `directory` is the folder of results, as its readers name it. The earlier results in it, which
    `results` names, are dropped, other files are kept. Raises OSError if the disk refuses; the
    directory is unchanged.
    """
    remove_leftovers(directory)
    hidden = _hidden_folder(directory)
    hidden.mkdir(parents=True, exist_ok=True)
    fresh = hidden / uuid.uuid4().hex
    fresh.mkdir()
    try:
        yield fresh
        _carry_over(directory, fresh, results())
        flush_tree(fresh)
        _put_in_place(fresh, directory)
    except BaseException:
        _remove(fresh)
        _remove_if_empty(hidden)
        raise
    remove_leftovers(directory)


def remove_leftovers(directory: Path) -> None:
    """Remove leftovers: results that were replaced, and unfinished results of killed runs.

    Must not be called while another process writes to the same directory.
    """
    hidden = _hidden_folder(directory)
    if not hidden.is_dir():
        return
    aside = sorted(hidden.glob(f"{_ASIDE}*"))
    if aside and not os.path.lexists(directory):
        aside.pop().rename(directory)
    in_place = directory.resolve() if directory.is_symlink() else None
    for folder in hidden.iterdir():
        if folder.resolve() != in_place:
            _remove(folder)
    for link in directory.parent.glob(f".{directory.name}.*.link"):
        link.unlink(missing_ok=True)
    _remove_if_empty(hidden)


def _hidden_folder(directory: Path) -> Path:
    """Return the hidden folder of all results of a directory, current or not."""
    return directory.parent / _HIDDEN / directory.name


def _carry_over(directory: Path, fresh: Path, results: Collection[str]) -> None:
    """Link all files of a directory that are not results into the new folder."""
    if not directory.is_dir():
        return
    journals = {f"{name}{ending}" for name in results for ending in ("-wal", "-shm", "-journal")}
    for path in directory.iterdir():
        if path.name in results or path.name in journals or os.path.lexists(fresh / path.name):
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.copytree(path, fresh / path.name, symlinks=True, copy_function=_second_name)
        else:
            _second_name(path, fresh / path.name)


def _second_name(path: Path | str, copy: Path | str) -> None:
    """Link a file, or copy it if it can't be linked."""
    try:
        os.link(path, copy, follow_symlinks=False)
    except OSError:
        shutil.copy2(path, copy, follow_symlinks=False)


def _put_in_place(fresh: Path, directory: Path) -> None:
    """Point the link at a complete folder by one rename, once the folder's name is on the disk."""
    for folder in (fresh.parent, fresh.parent.parent, directory.parent):
        flush(folder)
    link = directory.with_name(f".{directory.name}.{fresh.name}.link")
    try:
        link.symlink_to(os.path.relpath(fresh, directory.parent), target_is_directory=True)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        _move_aside(directory)
        fresh.rename(directory)
        flush(directory.parent)
        return
    try:
        if directory.is_dir() and not directory.is_symlink():
            _move_aside(directory)
        link.replace(directory)
        flush(directory.parent)  # before the earlier results are removed
    except BaseException:
        link.unlink(missing_ok=True)
        if not os.path.lexists(directory):
            remove_leftovers(directory)
        raise


def _move_aside(directory: Path) -> None:
    """Move a real folder to the hidden one; if this run is killed, the next one moves it back."""
    if os.path.lexists(directory):
        directory.rename(_hidden_folder(directory) / f"{_ASIDE}{uuid.uuid4().hex}")


def _remove_if_empty(hidden: Path) -> None:
    """Remove a hidden folder, and the one around it, if no results are in them."""
    with contextlib.suppress(OSError):
        hidden.rmdir()
        hidden.parent.rmdir()


def _remove(path: Path) -> None:
    """Remove a folder or file, as far as the disk allows."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()
