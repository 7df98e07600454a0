"""Compiles kernels and caches their machine code, so that only the first run on a machine waits.

This is the only module of `renew` that uses files. Numba's own cache checks the source of each
function alone, and misses an edit of a function that it inlines. So the cache's folder is named by
a hash of all sources with kernels. The folder is in the package if that can be written, else in the
user's cache, else in a temporary folder; a folder that can only be read (an installation by root, a
container that was warmed up) is still read. A file that can't be read, or is damaged, counts as
missing.
"""

import contextlib
import errno
import hashlib
import os
import pickle
import platform
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import IO, Any, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    _CacheLocator,
)
from numba.core.registry import cpu_target
from numba.core.runtime.nrt import rtsys

from renew._compiler import KernelDispatcher

FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])

_PACKAGE = Path(__file__).resolve().parent
# Folders of earlier sources that are kept beside the one in use: another checkout may share them.
_MAX_EARLIER = 3
# Length of the digest at the end of each file, bytes.
_DIGEST = hashlib.sha256().digest_size


def kernel(function: FunctionT, **more: bool) -> FunctionT:
    """Compile a function in nopython mode when it is first called; cached on disk.

    Division by zero gives inf or NaN, as NumPy does. Other threads go on running, such as the one
    that ends the process on a signal. Under NUMBA_DISABLE_JIT=1 the function is returned unchanged.
    """
    if not is_switched_on():
        return function
    options = {"nopython": True, "boundscheck": None, "error_model": "numpy", "nogil": True}
    compiled: Any = KernelDispatcher(function, None, options | more)
    compiled._cache = _KernelCache(function)  # noqa: SLF001 - as njit(cache=True) does
    return cast("FunctionT", compiled)


def reading_kernel(function: FunctionT) -> FunctionT:
    """Compile a kernel that makes no arrays or lists, and so counts no references to arrays.

    For kernels that others call millions of times: counting the references to each array that they
    read may take longer than their work.
    """
    return kernel(function, _nrt=False)


def small_kernel(function: FunctionT) -> FunctionT:
    """Compile a reading kernel that is inlined into the kernels that call it."""
    return kernel(function, _nrt=False, forceinline=True)


def for_kernels(array: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return an array as floats in C order that can be written to; copied only if needed.

    Kernels would be compiled again for any other kind of array.
    """
    return np.require(array, np.float64, ["C", "W"])


@cache
def cache_folder() -> Path:
    """Return the folder to write machine code to: the first candidate that can be written."""
    for folder in _lasting_folders():
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            if folder.is_relative_to(_PACKAGE):
                _open_as_package(folder.parent, folder)
            tempfile.TemporaryFile(dir=folder).close()
            with contextlib.suppress(OSError):
                _remove_earlier(folder)
            return folder
    return _temporary_folder()


def cache_is_temporary() -> bool:
    """Whether neither the package nor the user's cache can be written: a reboot compiles anew."""
    return cache_folder() not in _lasting_folders()


def _folders() -> tuple[Path, ...]:
    """All folders from which machine code is loaded; the first is the one to write to."""
    return tuple(dict.fromkeys((cache_folder(), *_lasting_folders())))


@cache
def _lasting_folders() -> tuple[Path, ...]:
    """Return folders where the cache may outlive a reboot, in order of preference."""
    folders = [_PACKAGE / "__pycache__" / _name()]
    if (asked := _asked_folder()) is not None:
        folders.insert(0, asked / _name())
    if (user := user_cache()) is not None:
        folders.append(user / _name())
    return tuple(folders)


def _asked_folder() -> Path | None:
    """Return the folder that NUMBA_CACHE_DIR names.

    Numba's own setting may come from a `.numba_config.yaml` in the working directory, and a
    downloaded folder must not decide where machine code is loaded from.
    """
    asked = os.environ.get("NUMBA_CACHE_DIR")
    return Path(asked) if asked else None


def user_cache() -> Path | None:
    """Return RENEW's folder in the user's cache, whether it exists or not; None without a home."""
    with contextlib.suppress(RuntimeError):  # no home
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "renew"
    return None


def _open_as_package(*folders: Path) -> None:
    """Make new folders as readable for others as the package is."""
    mode = stat.S_IMODE(_PACKAGE.stat().st_mode)
    for folder in folders:
        state = folder.stat()
        if state.st_uid == os.geteuid() and mode & ~state.st_mode:
            folder.chmod(stat.S_IMODE(state.st_mode) | mode)


def _temporary_folder() -> Path:
    """Return a folder that only this user may write to: machine code is loaded from it.

    If none can be made, returns a folder that can't exist, and nothing is saved.
    """
    with contextlib.suppress(OSError):
        own = Path(tempfile.gettempdir()) / f"renew-{os.getuid()}"
        own.mkdir(mode=0o700, exist_ok=True)
        state = own.lstat()
        if (
            state.st_uid == os.getuid()
            and stat.S_ISDIR(state.st_mode)
            and not state.st_mode & 0o077
        ):
            (own / _name()).mkdir(exist_ok=True)
            return own / _name()
    with contextlib.suppress(OSError):
        return Path(tempfile.mkdtemp(prefix="renew-"))
    return Path(os.devnull) / _name()


@cache
def _name() -> str:
    """Return the folder's name: a hash of all sources with kernels, and of Numba's version."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(_PACKAGE.rglob("*.py")):
        source = path.read_bytes()
        if b"kernel\n" in source or path.name in ("_compiled.py", "_compiler.py"):
            digest.update(path.relative_to(_PACKAGE).as_posix().encode() + b"\0" + source)
    return f"kernels-{digest.hexdigest()[:16]}"


def _remove_earlier(folder: Path) -> None:
    """Remove the folders of earlier sources, except the newest few."""
    others = [path for path in folder.parent.glob("kernels-*") if path != folder]
    for path in sorted(others, key=lambda path: path.lstat().st_mtime)[:-_MAX_EARLIER]:
        shutil.rmtree(path, ignore_errors=True)


def is_switched_on() -> bool:
    """Whether kernels are compiled: not under NUMBA_DISABLE_JIT=1."""
    return not getattr(numba.config, "DISABLE_JIT", 0)


def is_cold() -> bool:
    """Whether nothing is compiled yet, and this process can save the code that it compiles."""
    folders = () if cache_is_temporary() else _lasting_folders()
    return is_switched_on() and bool(folders) and not any(map(_holds_code, folders))


def _holds_code(folder: Path) -> bool:
    """Whether there is machine code in a folder; a folder that can't be read counts as empty."""
    with contextlib.suppress(OSError):
        return any(name.endswith(".nbi") for name in os.listdir(folder))  # noqa: PTH208 - as names
    return False


def processor() -> str:
    """Return the processor for which code is made: this machine's, or the one in NUMBA_CPU_NAME."""
    return str(cpu_target.target_context.codegen().magic_tuple()[1])


def has_all() -> bool:
    """Whether all code that `list_all` listed can still be loaded, undamaged.

    A folder that NUMBA_CACHE_DIR names must hold all of it; if it holds none, it gets a copy.
    """
    first, *others = _folders()
    if first.parent == _asked_folder() and not _holds_code(first):
        for other in [*filter(_holds_code, others)][:1]:
            with _noting_failures():
                unfinished = shutil.ignore_patterns("*.tmp.*")
                shutil.copytree(other, first, ignore=unfinished, dirs_exist_ok=True)
    notes = (_note(folder).load(_plan_key()) for folder in _self_contained())
    noted = next(filter(None, notes), None)
    return noted is not None and noted <= _loadable()


def list_all() -> None:
    """List all compiled code, after every kernel that a plan may call has been called."""
    if not save_failures():
        with _noting_failures():
            _note(cache_folder()).save(_plan_key(), _loadable())


def _self_contained() -> tuple[Path, ...]:
    """Folders that together must hold all code; one that the user named must do so alone."""
    return _folders()[:1] if cache_folder().parent == _asked_folder() else _folders()


def _note(folder: Path) -> "_CacheFiles":
    return _CacheFiles(str(folder), "all", _name())


def _plan_key() -> str:
    """What decides which kernels are called, and how: all sources, versions and the processor."""
    sources = hashlib.sha256(b"\0".join(map(Path.read_bytes, sorted(_PACKAGE.rglob("*.py")))))
    machine = cpu_target.target_context.codegen().magic_tuple()
    return f"{sources.hexdigest()} {platform.python_version()} {np.__version__} {machine}"


def _loadable() -> frozenset[str]:
    """Names and types of all kernels whose code can be loaded."""
    found = set[str]()
    for folder in _self_contained():
        for index in folder.glob("*.nbi"):
            files = _CacheFiles(str(folder), index.stem, _name())
            found |= {f"{index.stem} {key}" for key in files.loadable()}
    return frozenset(found)


_failures: list[OSError] = []


@contextlib.contextmanager
def _noting_failures() -> Iterator[None]:
    """Continue if machine code can't be saved, and record why."""
    try:
        yield
    except OSError as error:
        _failures.append(error)


def save_failures() -> tuple[OSError, ...]:
    """Return why machine code could not be saved in this process; empty if all was saved."""
    return tuple(_failures)


def load_failures() -> tuple[OSError, ...]:
    """Return the cache's faults: files that can't be read or are damaged; they count as missing."""
    found = list[OSError]()
    for folder in _folders():
        try:
            files = sorted(os.listdir(folder))  # noqa: PTH208 - as names
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError as error:
            found.append(error)
            continue
        for name in files:
            try:
                _content(folder / name) if name.endswith((".nbi", ".nbc")) else None
            except OSError as error:
                found.append(error)
    return tuple(found)


def _content(path: Path) -> bytes:
    """Read the saved content of a file; OSError where it can't be read or is damaged."""
    content = path.read_bytes()
    if hashlib.sha256(content[:-_DIGEST]).digest() != content[-_DIGEST:]:
        raise OSError(errno.EIO, "is damaged", str(path))
    return content[:-_DIGEST]


class _CacheFiles(IndexDataCacheFile):
    """Index and machine code of a kernel in a folder, each file with a digest at its end.

    They hold neither a stamp nor a version, because both are in the folder's name.
    """

    def _load_index(self) -> Any:  # noqa: ANN401 - a dictionary by keys of Numba's
        return self._load(self._index_path) or {}

    def loadable(self) -> Iterator[object]:
        """Keys of all code that can be loaded."""
        for key, data in self._load_index().items():
            with contextlib.suppress(OSError):
                _content(Path(self._data_path(data)))
                yield key

    def _load_data(self, name: str) -> object:
        return self._load(self._data_path(name))

    def _load(self, path: str) -> object:
        """Return the saved content of a file; None where it can't be read or is damaged."""
        try:
            return pickle.loads(_content(Path(path)))  # noqa: S301 - as Numba does
        except OSError:
            return None

    def _save_index(self, overloads: object) -> None:
        with self._open_for_write(self._index_path) as file:
            file.write(self._dump(overloads))

    def _dump(self, obj: object) -> bytes:
        data: bytes = super()._dump(obj)
        return data + hashlib.sha256(data).digest()

    @contextlib.contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[IO[bytes]]:
        with super()._open_for_write(filepath) as file:
            yield file
            if Path(filepath).is_relative_to(_PACKAGE):
                # Everybody who may read the package may read its machine code, whatever the umask.
                os.fchmod(file.fileno(), Path(__file__).stat().st_mode & 0o666)


class _Locator(_CacheLocator):
    """Where the machine code of a kernel lies."""

    def __init__(self, module: str) -> None:
        self._module = module

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "_Locator":
        """Return the locator of a function; Numba calls this method by name."""
        del py_file
        return cls(py_func.__module__)

    def get_cache_path(self) -> str:
        """Return folder of the machine code."""
        return str(cache_folder())

    def get_source_stamp(self) -> str:
        """Return a stamp that must be equal for cached code to be valid."""
        return _name()

    def get_disambiguator(self) -> str:
        """Return a text that distinguishes functions of one name in different modules."""
        return self._module


class _Implementation(CompileResultCacheImpl):
    def __init__(self, function: Callable[..., Any]) -> None:
        self._locator_classes: list[Any] = [_Locator]
        super().__init__(function)


class _KernelCache(FunctionCache):
    """Loads from every folder where the cache may lie; writes to `cache_folder()`."""

    _impl_class = _Implementation

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file, *self._read_only = (
            _CacheFiles(str(folder), self._impl.filename_base, _name()) for folder in _folders()
        )

    def load_overload(self, sig: object, target_context: Any) -> object:  # noqa: ANN401
        """Load machine code; Numba's method would first import all that only its compiler needs."""
        rtsys.initialize(target_context)
        found = super()._load_overload(sig, target_context)
        index_key = self._index_key(sig, target_context.codegen())
        for files in self._read_only:
            if found is None and (data := files.load(index_key)) is not None:
                found = self._impl.rebuild(target_context, data)
                # A folder that NUMBA_CACHE_DIR names must hold all code, so that it can be shipped.
                if cache_folder().parent == _asked_folder():
                    with _noting_failures():
                        self._cache_file.save(index_key, data)
        return found

    def save_overload(self, sig: object, data: object) -> None:
        """Save machine code; if the disk is full, the next run merely has to compile again."""
        with _noting_failures():
            super().save_overload(sig, data)
