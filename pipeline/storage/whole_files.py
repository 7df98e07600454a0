"""Files that are whole or not there, also after a power cut.

A file system may put a rename on the disk before the content of the file that was renamed: after a
power cut a file of length 0 has the right name. So content goes first, then the name, then the
folder that holds the name.
"""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import IO

UNFINISHED = ".tmp"
"""How the name of a file ends that is being written."""


@contextlib.contextmanager
def whole_file(path: Path, owner: str = "") -> Iterator[IO[bytes]]:
    """Give a new file to write; without an error in the block, it then takes its place.

    Parameters
    ----------
    owner
        Begins the name of the unfinished file, by which leftovers of a killed process are found;
        the file's own name by default.

    Raises
    ------
    OSError
        The disk refuses; what was at the path is as it was.
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
    """Write a text file, as `whole_file` does."""
    with whole_file(path) as file:
        file.write(text.encode())


def flush_tree(folder: Path) -> None:
    """Wait until a folder, all files and folders in it, and their names are on the disk."""
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            flush_tree(path)
        elif path.is_file() and not path.is_symlink():
            flush(path)
    flush(folder)


def flush(path: Path) -> None:
    """Wait until a file's content, or the names in a folder, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
