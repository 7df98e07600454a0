"""Errors of libraries that write files, as the operating system's errors."""

import errno
import shutil
from pathlib import Path

# Free space, bytes, below which a failed write means a full disk; more than SQLite's journal.
_FULL_BELOW_BYTES = 16 * 2**20


def os_error(path: Path, error: Exception) -> OSError:
    """Turn an error of GDAL, SQLite or HDF5, which hide the system's own, into an OSError.

    ENOSPC if the disk is full, else EIO.
    """
    full = shutil.disk_usage(path.parent).free < _FULL_BELOW_BYTES
    return OSError(errno.ENOSPC if full else errno.EIO, f"{path.name}: {error}")
