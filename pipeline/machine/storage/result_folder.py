"""A folder of results that is replaced as a whole: a reader sees the old files or the new ones.

`outputs/<name>` is a symbolic link to a folder in `outputs/.results/<name>/`. New results are
written to another folder there; when all of them are on the disk, one rename moves the link. Files
that are not results, such as the user's own, are carried over.

Where there is a real folder in the link's place (made by hand, by an earlier version, or because
the file system has no links), it is moved aside first; if the program is killed just then, the
next start moves it back.
"""

import contextlib
import errno
import os
import shutil
import uuid
from collections.abc import Callable, Collection, Iterator
from pathlib import Path

from pipeline.machine.storage.whole_files import flush, flush_tree

_HIDDEN = ".results"
# Beginning of the name of a real folder that was moved aside.
_ASIDE = "aside-"
_NO_LINKS = {errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS}


@contextlib.contextmanager
def replacing(directory: Path, results: Callable[[], Collection[str]]) -> Iterator[Path]:
    """Provide an empty folder to fill; if the block ends without error, it replaces a directory.

    Parameters
    ----------
    directory
        The folder of results, as its readers name it.
    results
        Returns the names of the earlier results in it: they are dropped, other files are kept.

    Raises
    ------
    OSError
        The disk refuses; the directory is unchanged.
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
