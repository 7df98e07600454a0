"""A snapshot of a folder, to see what a run changed in it."""

import hashlib
from pathlib import Path


def tree(folder: Path) -> dict[str, tuple[int, str]]:
    """Give every file's inode and hash: whatever is written again is another file."""
    return {
        str(path.relative_to(folder)): (
            path.stat().st_ino,
            hashlib.sha256(path.read_bytes()).hexdigest(),
        )
        for path in folder.rglob("*")
        if path.is_file()
    }
