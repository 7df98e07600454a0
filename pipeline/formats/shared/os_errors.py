"""What a library's error on writing is to the operating system."""

from __future__ import annotations

import errno
import shutil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

# A disk with less left is taken for full when a write fails; this is more than SQLite's journal.
_LITTLE_SPACE = 16 * 2**20


def os_error(path: Path, error: Exception) -> OSError:
    """Turn an error of GDAL, SQLite or HDF5, which keep the system's own to themselves, into one.

    The disk is asked whether it is full.
    """
    full = shutil.disk_usage(path.parent).free < _LITTLE_SPACE
    return OSError(errno.ENOSPC if full else errno.EIO, f"{path.name}: {error}")
