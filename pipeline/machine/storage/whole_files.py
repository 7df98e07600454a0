"""Writes files that are either whole or missing, even after a power cut.

A file system may put a rename on the disk before the renamed file's content: after a power cut a
file of length 0 has the right name. So the content is flushed first, then the file is renamed, then
its folder is flushed.
"""

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import IO

UNFINISHED = ".tmp"
"""Suffix of files that are being written."""


@contextlib.contextmanager
def whole_file(path: Path, owner: str = "") -> Iterator[IO[bytes]]:
    """Provide a new file to write; if the block ends without error, it is renamed to the path.

    Parameters
    ----------
    owner
        Prefix of the unfinished file's name, by which leftovers of a killed process are found; by
        default the file's own name.

    Raises
    ------
    OSError
        The disk refuses; an earlier file at the path is unchanged.
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
