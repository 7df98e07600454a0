"""The store of artefacts, the stages' results: each is named by a hash of all its inputs.

An artefact's key is Dask's token of its stage, the code, the libraries and the inputs; inputs that
are artefacts themselves are represented by their keys. So a killed run continues where it stopped,
a second run does nothing, and after a change only the artefacts that depend on it are made again.
After any edit of the code all stages are computed again. The imports could tell which stage depends
on which module, but if one import were overlooked, an old result would pass for a new one.

Files are written under a temporary name, contain their hash, and are renamed once complete: a
truncated or damaged artefact counts as missing. Pickles are read only if they build values, so that
a store in a downloaded folder can't run code. A pickle names the functions that it calls; allowed
are this program's classes of values (data classes, enumerations, models, errors, the planner's
inputs) and a few constructors of arrays, geometries and times; see
https://docs.python.org/3/library/pickle.html#restricting-globals.
"""

import contextlib
import dataclasses
import enum
import hashlib
import io
import os
import pickle
import subprocess
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Generic, TypeVar

from pydantic import BaseModel

from pipeline.machine.files import UNFINISHED, needed, whole_file

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
    "numba",
)
_MAGIC = b"RENEW artefact 1\n"
_DIGEST_SIZE = hashlib.sha256().digest_size
SUFFIX = ".artefact"
DOWNLOADS = "downloads"
"""Folder of the store for the sources' downloads."""


@dataclass(frozen=True, slots=True)
class Artefact(Generic[ValueT]):
    """An artefact and its key, which represents it in the keys of artefacts made from it."""

    key: str
    value: ValueT


class Store:
    """Artefacts in a folder, one file each.

    `owner` is the name of the scenario whose run writes to it; it begins unfinished files' names.
    `has_made` tells whether an artefact was missing so far.
    """

    def __init__(self, root: Path, owner: str = "") -> None:
        self.root = root
        self.owner = owner
        self.has_made = False

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
        value = self.load(stage, key, kind)
        if value is None:
            self.has_made = True
            value = make()
            self.save(stage, key, value)
        return value

    def artefact(
        self, stage: str, kind: type[ValueT], inputs: object, make: Callable[[], ValueT]
    ) -> Artefact[ValueT]:
        """Load the artefact that a stage makes of its inputs, or make and save it."""
        key = artefact_key(stage, inputs)
        return Artefact(key, self.load_or_make(stage, key, kind, make))

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

    Raises StageError if the disk refuses.
    """
    remedy = "free some space, or choose another folder with --output"
    with needed(f"can't write {path.name} in {path.parent}", remedy):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_checked(path, pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL), owner)


def load_artefact(path: Path, kind: type[ValueT]) -> ValueT | None:
    """Load a value; None if the file is missing, damaged, or holds another type.

    The file's time is set to now: the store is pruned by the time of the last use.
    """
    content = read_checked(path)
    if content is None:
        return None
    try:
        value = _ValueUnpickler(io.BytesIO(content)).load()
    except Exception as error:  # noqa: BLE001 - a pickle of somebody else's may raise anything
        warnings.warn(
            f"{path} was not written by this program, and is not used: {error}", stacklevel=2
        )
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
    versions = []
    for name in _LIBRARIES:
        with contextlib.suppress(PackageNotFoundError):
            versions.append(f"{name} {version(name)}")
    return tuple(versions)


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


MAX_STORE_BYTES = 2_000_000_000
"""Size to which the store is pruned after a run, bytes: about a thousand runs of two seasons."""


@dataclass(frozen=True, slots=True)
class Freed:
    """Number and size of the removed files, and size of the remaining ones, bytes."""

    files: int
    size: int
    remaining: int


def prune(
    root: Path, *, max_bytes: float, used_before: float | None = None, keep_since: float = 0.0
) -> Freed:
    """Remove unfinished files, and artefacts and downloads until a store is small enough.

    At most `max_bytes` remain: files used longest ago are removed first. All files last used before
    `used_before` (s since 1970) are removed, and all used after `keep_since` stay, whatever their
    size; 0 for no limit. Must not be called while a run uses the store.
    """
    remove_unfinished(root)
    items = sorted(_items(root))
    total = remaining = sum(size for _, size, _ in items)
    count = 0
    for used, size, files in items:
        is_old = used_before is not None and used < used_before
        is_in_use = keep_since > 0 and used >= keep_since
        if is_in_use or not (is_old or remaining > max_bytes):
            continue
        with contextlib.suppress(OSError):
            for file in files:
                file.unlink(missing_ok=True)
                count += 1
            remaining -= size
    return Freed(count, total - remaining, remaining)


def _items(root: Path) -> Iterator[tuple[float, int, list[Path]]]:
    """Yield artefacts, and downloads with their sidecars: last use (s since 1970), size, files.

    Locks, and notes on the results' origins, are not among them.
    """
    for path in root.glob(f"*/*{SUFFIX}"):
        with contextlib.suppress(OSError):
            state = path.stat()
            yield state.st_mtime, state.st_size, [path]
    groups: dict[Path, list[Path]] = {}
    for path in (root / DOWNLOADS).rglob("*"):
        if path.is_file() and not path.is_symlink():
            groups.setdefault(path.with_suffix(""), []).append(path)
    for files in groups.values():
        with contextlib.suppress(OSError):
            states = [file.stat() for file in files]
            # Reading a download does not set its modification time.
            used = max(max(state.st_mtime, state.st_atime) for state in states)
            yield used, sum(state.st_size for state in states), files


_ROOT = Path(__file__).resolve().parents[2]
_HASHED = ("pipeline", "renew")


@cache
def code_hash() -> str:
    """Return the SHA-256, hexadecimal, of the sources and data files of both packages."""
    digest = hashlib.sha256()
    for file in code_files():
        digest.update(file.relative_to(_ROOT).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def code_files() -> tuple[Path, ...]:
    """Return the sources and data files of both packages, sorted."""
    files = (path for package in _HASHED for path in (_ROOT / package).rglob("*"))
    return tuple(
        sorted(path for path in files if path.is_file() and "__pycache__" not in path.parts)
    )


@cache
def code_commit() -> str:
    """Return the commit of this checkout, with "-dirty" if files differ; empty outside one."""
    # An installed package may lie inside another project's checkout.
    if _git("rev-parse", "--show-toplevel") != str(_ROOT):
        return ""
    return _git("describe", "--always", "--dirty", "--abbrev=40", "--match=")


def _git(*words: str) -> str:
    """Return git's output for this folder; empty without git, or outside a checkout."""
    command = ["git", "-C", str(_ROOT), *words]
    try:
        done = subprocess.run(command, capture_output=True, check=True, text=True)  # noqa: S603 - words are this module's
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.strip()


_PACKAGES = frozenset({"pipeline", "renew"})
# Modules of the planner whose classes are inputs, which may hold arrays.
_PLANNER_INPUTS = "renew.inputs."
_VALUES = (str, enum.Enum, BaseException, BaseModel)
# Names that NumPy, shapely and the standard library need to build values, by module. `distributed`
# makes errors picklable by `tblib`.
_ALLOWED = {
    "builtins": {"bytearray", "complex", "frozenset", "range", "set", "slice"},
    "collections": {"OrderedDict"},
    "datetime": {"date", "datetime", "timedelta", "timezone"},
    "numpy": {"dtype", "ndarray"},
    "numpy._core.multiarray": {"_reconstruct", "scalar"},
    "numpy._core.numeric": {"_frombuffer"},
    "pathlib": {"Path", "PosixPath", "PurePosixPath"},
    "pathlib._local": {"Path", "PosixPath", "PurePosixPath"},  # their name in Python 3.13
    "pydantic_core._pydantic_core": {"TzInfo"},  # of dates in scenarios
    "shapely.io": {"from_wkb"},
    "tblib": {"Code", "Frame", "Traceback"},
    "tblib.pickling_support": {"unpickle_exception", "unpickle_traceback"},
}


class _ValueUnpickler(pickle.Unpickler):
    """Resolves classes of values only."""

    def find_class(self, module: str, name: str) -> object:
        """Return the class or constructor that a pickle names."""
        if name in _ALLOWED.get(module, ()):
            return super().find_class(module, name)
        if module.partition(".")[0] in _PACKAGES:
            value_class = super().find_class(module, name)
            if isinstance(value_class, type) and _holds_values(value_class):
                return value_class
        raise pickle.UnpicklingError(f"{module}.{name} is no value of this program")


def _holds_values(kind: type) -> bool:
    """Whether a class of this program holds values only: making one has no side effect."""
    if kind.__module__.partition(".")[0] not in _PACKAGES:  # a library's, which a module imports
        return False
    is_named_tuple = issubclass(kind, tuple) and hasattr(kind, "_fields")
    is_input = kind.__module__.startswith(_PLANNER_INPUTS)
    return is_input or is_named_tuple or dataclasses.is_dataclass(kind) or issubclass(kind, _VALUES)
