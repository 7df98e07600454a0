"""The store of artefacts: each is named by the content of what made it, and whole or absent.

An artefact's key is Dask's token of its stage, the code of that stage and its inputs; inputs that
are artefacts themselves go in by their keys. So a run that was killed goes on where it stopped, a
second run does nothing, and a change of anything makes just what depends on it anew. Files are
written to a temporary name, carry their hash, and are renamed: one that is cut short or damaged
counts as absent.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import secrets
import time
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, TypeVar

from filelock import FileLock, Timeout

from pipeline.code_identity import code_hash
from pipeline.errors import StageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

ValueT = TypeVar("ValueT")

# Libraries whose releases change figures, or how a pickle reads.
_LIBRARIES = (
    "renew-planner",
    "numpy",
    "scipy",
    "shapely",
    "pyproj",
    "networkx",
    "triangle",
    "numba",
)
_MAGIC = b"RENEW artefact 1\n"
_DIGEST_SIZE = hashlib.sha256().digest_size
_SUFFIX, _UNFINISHED = ".artefact", ".tmp"
# What a killed run left unfinished; no artefact takes a day to write.
_LEFTOVER_AGE_S = 24 * 3600.0


class Store:
    """Artefacts under a folder, one file each.

    They are pickles, for this machine's eyes: a store is as trusted as the program beside it.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def path(self, stage: str, key: str) -> Path:
        """Where an artefact lies, or would."""
        return self.root / stage / f"{key}{_SUFFIX}"

    def load(self, stage: str, key: str, kind: type[ValueT]) -> ValueT | None:
        """Read an artefact; None where it is absent or damaged."""
        return load(self.path(stage, key), kind)

    def save(self, stage: str, key: str, value: object) -> Path:
        """Write an artefact under its key, whole or not at all."""
        path = self.path(stage, key)
        save(path, value)
        return path

    def made(self, stage: str, key: str, kind: type[ValueT], make: Callable[[], ValueT]) -> ValueT:
        """Read an artefact, or make and keep it."""
        found = self.load(stage, key, kind)
        if found is None:
            found = make()
            self.save(stage, key, found)
        return found

    def folder(self, name: str) -> Path:
        """A folder of the store for files that a source keeps."""
        path = self.root / name
        path.mkdir(parents=True, exist_ok=True)
        return path


@contextlib.contextmanager
def only_run(path: Path, name: str) -> Iterator[None]:
    """Keep a second run of one scenario out until the first has ended.

    Raises
    ------
    StageError
        Another run holds the lock.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = FileLock(path)
        lock.acquire(timeout=0)
    except Timeout:
        raise StageError(
            f"another run of {name!r} is at work in {path.parent.parent}: wait until it has ended, "
            "or choose another place with --output"
        ) from None
    except OSError as error:
        raise StageError(
            f"can't write in {path.parent}: {error.strerror or error}; choose another place with "
            "--output"
        ) from error
    try:
        sweep(path.parent)
        yield
    finally:
        lock.release()


def sweep(root: Path) -> None:
    """Remove what killed runs left unfinished, a day after."""
    for leftover in root.glob(f"*/.*{_UNFINISHED}"):
        with contextlib.suppress(OSError):
            if time.time() - leftover.stat().st_mtime > _LEFTOVER_AGE_S:
                leftover.unlink()


def key(stage: str, *inputs: object) -> str:
    """Name an artefact: stage, its code, the libraries, and its inputs."""
    from dask.base import tokenize

    token = tokenize(stage, code_hash(stage), libraries(), inputs, ensure_deterministic=True)
    return str(token)


def save(path: Path, value: object) -> None:
    """Write a value to a temporary name with its hash, and rename it."""
    content = pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh = path.with_name(f".{path.stem[:16]}.{secrets.token_hex(4)}{_UNFINISHED}")
        try:
            with fresh.open("xb") as file:
                file.write(_MAGIC + hashlib.sha256(content).digest() + content)
                file.flush()
                os.fsync(file.fileno())
            fresh.replace(path)
        finally:
            fresh.unlink(missing_ok=True)
    except OSError as error:
        raise StageError(
            f"can't keep {path.name} in {path.parent}: {error.strerror or error}; make room or "
            "choose another place with --output"
        ) from error


def load(path: Path, kind: type[ValueT]) -> ValueT | None:
    """Read a value; None where the file is absent, damaged, or holds something else."""
    try:
        stored = path.read_bytes()
    except OSError:
        return None
    begin = len(_MAGIC) + _DIGEST_SIZE
    content = stored[begin:]
    if stored[:begin] != _MAGIC + hashlib.sha256(content).digest():
        return None
    value = pickle.loads(content)  # noqa: S301 - written by `save` above; the hash says whole
    return value if isinstance(value, kind) else None


@cache
def libraries() -> tuple[str, ...]:
    """Releases of the libraries that figures depend on."""
    found = []
    for name in _LIBRARIES:
        with contextlib.suppress(PackageNotFoundError):
            found.append(f"{name} {version(name)}")
    return tuple(found)


def file_hash(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
