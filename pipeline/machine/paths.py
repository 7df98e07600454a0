"""Paths given by the user: unusable ones are refused before a library fails or waits on them."""

import contextlib
import errno
import os
import re
import shlex
import stat
from collections.abc import Iterable
from pathlib import Path

from pipeline.errors import RequestError, StageError, refuse_any
from pipeline.texts import acts, clean

# Neither files nor folders: reading one may wait for ever, or never end.
_OTHER_KINDS = (
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
# What a packed file begins with, its kind, and the command that unpacks it.
_PACKED = (
    (b"\x1f\x8b", "gzip", "gunzip -k"),
    (b"BZh", "bzip2", "bunzip2 -k"),
    (b"PK\x03\x04", "zip", "unzip"),
    (b"\xfd7zXZ", "xz", "unxz -k"),
    (b"(\xb5/\xfd", "zstd", "unzstd"),
)
# What a tar archive has, the byte at which it has it, and the endings of packed ones.
_TAR = b"ustar"
_TAR_AT = 257
_TAR_ENDS = re.compile(r"\.(tar\.\w+|t[gbx]z2?)$", re.IGNORECASE)
# An address, also one that was taken for a path below a folder.
_ADDRESS = re.compile(r"(^|/)(https?|ftps?|s3|gs|file):/", re.IGNORECASE)
NOT_THERE = "does not exist"
"""The reason of `unreadable_reason` where nothing is at a path."""

# Length to which a path is cut in a message, characters.
_MAX_SHOWN = 200


def unreadable_reason(path: str | Path) -> str:
    """Say why a path can't be read as a file or folder, with the remedy; empty if it can."""
    name = os.fspath(path)
    if reason := unusable_reason(name):
        return reason
    try:
        mode = Path(name).stat().st_mode
    except OSError as error:
        return _failure(Path(name), error)
    for is_kind, kind in _OTHER_KINDS:
        if is_kind(mode):
            return f"is {kind}, not a file; save its content to a file, and give that"
    is_folder = stat.S_ISDIR(mode)
    if not os.access(name, os.R_OK | os.X_OK if is_folder else os.R_OK):
        return f"may not be read; allow it, as with `chmod +r{'x' * is_folder}`"
    return "" if is_folder else packed_reason(Path(name))


def packed_reason(path: Path) -> str:
    """Say how a file is packed, with the command that unpacks it; empty if it is not."""
    begin = b""
    if path.is_file():  # a FIFO would wait
        with contextlib.suppress(OSError), path.open("rb") as file:
            begin = file.read(_TAR_AT + len(_TAR))
    kinds = [row[1:] for row in _PACKED if begin.startswith(row[0])]
    if begin[_TAR_AT:] == _TAR or (kinds and _TAR_ENDS.search(path.name)):
        kinds = [("tar", "tar -xf")]
    for kind, command in kinds:
        done = f"{command} {shlex.quote(path.name)}"
        return f"is packed ({kind}); give what `{done}` makes of it"
    return ""


def require_readable(paths: Iterable[Path], key: str) -> None:
    """Refuse paths other than readable files and folders; `key` says who names them.

    Raises RequestError with a line for each of them.
    """
    faults = [f"{key}: {shown(path)} {why}" for path in paths if (why := unreadable_reason(path))]
    refuse_any(faults)


def expanded(path: str | Path, key: str) -> Path:
    """Make a path absolute, with the home folder in place of a ~ at its beginning.

    Raises RequestError if the path is invalid, or there is no such home folder; `key` is the key or
    option; StageError if the path is relative, and the working directory was removed.
    """
    name = os.fspath(path)
    if reason := unusable_reason(name):
        raise RequestError(f"{key}: {shown(name)} {reason}")
    return working_directory() / Path(name).expanduser()


def resolved(path: str | Path, key: str) -> Path:
    """Make a path absolute, without symbolic links; raises what `expanded` does.

    A link that leads back to itself stays as it is; `unreadable_reason` reports it.
    """
    return Path(os.path.realpath(expanded(path, key)))


def working_directory() -> Path:
    """Return the working directory; StageError if it was removed."""
    try:
        return Path.cwd()
    except OSError as error:
        raise StageError(
            f"the working directory can't be used ({error.strerror}): change to another one (cd)"
        ) from None


def folder_to_write(path: Path, key: str) -> Path:
    """Return a folder to write to as an absolute path, whether it exists or not.

    Raises RequestError if no folder can be there; `key` says who names it.
    """
    path = expanded(path, key)
    try:
        if path.exists() and not path.is_dir():
            raise RequestError(f"{key}: {shown(path)} is not a folder; name another one")
        path.lstat()
    except FileNotFoundError:
        pass
    except NotADirectoryError:
        raise RequestError(f"{key}: {shown(path)} lies below a file; name another folder") from None
    except PermissionError:
        pass  # the machine's fault, which is reported when the folder is written to
    except OSError as error:
        raise RequestError(f"{key}: {shown(path)} {_failure(path, error)}") from None
    try:
        return path.resolve()
    except RuntimeError:  # as Python 3.11 and 3.12 say it
        raise RequestError(
            f"{key}: {shown(path)} is a link that leads to itself; name a folder"
        ) from None


def shown(path: str | Path) -> str:
    """Write a path in a message: printable, and no longer than a line or two."""
    return clean(os.fspath(path), _MAX_SHOWN)


def unusable_reason(name: str) -> str:
    """Say why a text can't be a path, with the remedy; empty when it can."""
    if character := acts(name):
        return f"has in its name {character}; rename it"
    if _ADDRESS.search(name):
        return "is an address; download it first, and give the file"
    try:
        Path(name).expanduser()
    except RuntimeError:
        return "names a home folder that does not exist; give the whole path"
    return ""


def _failure(path: Path, error: OSError) -> str:
    """Say why the file system finds no file."""
    if error.errno == errno.ENAMETOOLONG:
        return f"is too long a path ({len(os.fspath(path)):,} characters); move the file"
    if error.errno == errno.ELOOP:
        return "is a symbolic link that leads back to itself; give the file itself"
    if error.errno == errno.EACCES:
        return "lies in a folder that may not be read; allow it, as with `chmod +rx`"
    if error.errno in {errno.ENOENT, errno.ENOTDIR}:
        if path.is_symlink():
            return f"is a symbolic link to {shown(path.readlink())}, which does not exist"
        return NOT_THERE
    return f"can't be read: {error.strerror}"


def short_path(path: Path) -> str:
    """Return a path relative to the working directory if it lies inside."""
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)
