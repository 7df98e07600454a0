"""The store of artefacts, the stages' results: each is named by a hash of all its inputs.

An artefact's key is Dask's token of its stage, the code, the libraries and the inputs; inputs that
are artefacts themselves are represented by their keys. So a killed run continues where it stopped,
a second run does nothing, and after a change only the artefacts that depend on it are made again.
Files are written under a temporary name, contain their hash, and are renamed once complete: a
truncated or damaged artefact counts as missing.
"""

import contextlib
import hashlib
import os
import pickle
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Generic, TypeVar

from pipeline.errors import StageError
from pipeline.machine.storage.code_identity import code_hash
from pipeline.machine.storage.unpickling import values_from
from pipeline.machine.storage.whole_files import UNFINISHED, whole_file

ValueT = TypeVar("ValueT")

# Libraries whose releases may change results or the format of a pickle.
_LIBRARIES = (
    "renew-planner",
    "contourpy",
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
SUFFIX = ".artefact"
DOWNLOADS = "downloads"
"""Folder of the store for the sources' downloads."""


@dataclass(frozen=True, slots=True)
class Made(Generic[ValueT]):
    """An artefact and its key, which represents it in the keys of artefacts made from it."""

    key: str
    value: ValueT


class Store:
    """Artefacts in a folder, one file each.

    `owner` is the name of the scenario whose run writes to it; it begins unfinished files' names.
    """

    def __init__(self, root: Path, owner: str = "") -> None:
        self.root = root
        self.owner = owner

    def path(self, stage: str, key: str) -> Path:
        """Return the path of an artefact, whether it exists or not."""
        return self.root / stage / f"{key}{SUFFIX}"

    def load(self, stage: str, key: str, kind: type[ValueT]) -> ValueT | None:
        """Load an artefact; None if it is missing or damaged."""
        return load_artefact(self.path(stage, key), kind)

    def save(self, stage: str, key: str, value: object) -> Path:
        """Save an artefact under its key, completely or not at all."""
        path = self.path(stage, key)
        save_artefact(path, value, self.owner)
        return path

    def load_or_make(
        self, stage: str, key: str, kind: type[ValueT], make: Callable[[], ValueT]
    ) -> ValueT:
        """Load an artefact, or make and save it."""
        found = self.load(stage, key, kind)
        if found is None:
            found = make()
            self.save(stage, key, found)
        return found

    def made(
        self, stage: str, kind: type[ValueT], inputs: object, make: Callable[[], ValueT]
    ) -> Made[ValueT]:
        """Load the artefact that a stage makes of its inputs, or make and save it."""
        key = artefact_key(stage, inputs)
        return Made(key, self.load_or_make(stage, key, kind, make))

    def folder(self, name: str) -> Path:
        """Return a folder of the store, created if needed, for a source's cached files."""
        path = self.root / name
        path.mkdir(parents=True, exist_ok=True)
        return path


def remove_unfinished(root: Path, owner: str = "*") -> None:
    """Remove unfinished files of killed runs of a scenario, or of all scenarios.

    Must not be called while such a run is at work.
    """
    for leftover in root.glob(f"*/.{owner}.*{UNFINISHED}"):
        with contextlib.suppress(OSError):
            leftover.unlink()


def artefact_key(stage: str, *inputs: object) -> str:
    """Return an artefact's key: a token of stage, code, libraries and inputs."""
    from dask.base import tokenize

    token = tokenize(stage, code_hash(), library_versions(), inputs, ensure_deterministic=True)
    return str(token)


def save_artefact(path: Path, value: object, owner: str = "") -> None:
    """Write a value with its hash under a temporary name, and rename it.

    Raises
    ------
    StageError
        The disk refuses.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_checked(path, pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL), owner)
    except OSError as error:
        raise StageError(
            f"can't write {path.name} in {path.parent}: {error.strerror or error}; free some "
            "space, or choose another folder with --output"
        ) from error


def load_artefact(path: Path, kind: type[ValueT]) -> ValueT | None:
    """Load a value; None if the file is missing, damaged, or holds another type.

    The file's time is set to now: the store is pruned by the time of the last use.
    """
    content = read_checked(path)
    if content is None:
        return None
    try:
        value = values_from(content)
    except Exception as error:  # noqa: BLE001 - a pickle of somebody else's may raise anything
        warnings.warn(f"{path} is none of this program's, and not used: {error}", stacklevel=2)
        return None
    if not isinstance(value, kind):
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return value


def write_checked(path: Path, content: bytes, owner: str = "") -> None:
    """Write a whole file with a hash, by which `read_checked` detects damage."""
    with whole_file(path, owner) as file:
        file.write(_MAGIC + hashlib.sha256(content).digest() + content)


def read_checked(path: Path) -> bytes | None:
    """Return the content that `write_checked` wrote; None if the file is missing or damaged."""
    try:
        stored = path.read_bytes()
    except OSError:
        return None
    begin = len(_MAGIC) + _DIGEST_SIZE
    content = stored[begin:]
    return content if stored[:begin] == _MAGIC + hashlib.sha256(content).digest() else None


@cache
def library_versions() -> tuple[str, ...]:
    """Return the installed versions of the libraries that results depend on."""
    found = []
    for name in _LIBRARIES:
        with contextlib.suppress(PackageNotFoundError):
            found.append(f"{name} {version(name)}")
    return tuple(found)


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
