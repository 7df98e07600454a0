"""Compiles kernels and caches their machine code, so that only the first run on a machine waits.

The one module of `renew` that knows files. Numba's own cache looks at the source of each function
alone and misses an edit of another that it inlines; here the cache's folder is named by a hash of
all sources with kernels. It lies in the package where that can be written, else in the user's
cache, else in a temporary folder; a folder that can only be read (an installation by root, a
container that was warmed up) is read all the same.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

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

FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])

_PACKAGE = Path(__file__).resolve().parent
# Folders of earlier sources that are kept beside the one in use: another checkout may share them.
_MAX_EARLIER = 3


def kernel(function: FunctionT, *, forceinline: bool = False) -> FunctionT:
    """Compile a function in nopython mode when it is first called; cached on disk.

    Division by zero gives inf or NaN, as NumPy does. Other threads run on meanwhile, among them one
    that ends the process on a signal. Under NUMBA_DISABLE_JIT=1 the function stays
    as it is.
    """
    compile_it = numba.njit(error_model="numpy", nogil=True, forceinline=forceinline)
    compiled: Any = compile_it(function)
    if compiled is not function:
        compiled._cache = _KernelCache(function)  # noqa: SLF001 - as njit(cache=True) does
    return cast("FunctionT", compiled)


def small_kernel(function: FunctionT) -> FunctionT:
    """The same, put into the kernels that call it.

    For lookups that are made millions of times: a call that takes arrays counts the references to
    each of them, which takes longer than the lookup.
    """
    return kernel(function, forceinline=True)


def for_kernels(array: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Floats in C order that may be written to: for all else kernels would be compiled once more.

    A copy only where it has to be one.
    """
    return np.require(array, np.float64, ["C", "W"])


@cache
def cache_folder() -> Path:
    """Folder into which machine code is written: the first of the possible ones that allows it."""
    for folder in _lasting_folders():
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            _remove_earlier(folder)
            return folder
    return _temporary_folder()


def cache_is_temporary() -> bool:
    """Whether neither the package nor the user's cache can be written: a reboot compiles anew."""
    return cache_folder() not in _lasting_folders()


@cache
def _lasting_folders() -> tuple[Path, ...]:
    """Folders where the cache may lie and outlive a reboot, in order of preference."""
    folders = [_PACKAGE / "__pycache__" / _name()]
    if (asked := _asked()) is not None:
        folders.insert(0, asked / _name())
    if (user := user_cache()) is not None:
        folders.append(user / _name())
    return tuple(folders)


def _asked() -> Path | None:
    """Folder that NUMBA_CACHE_DIR names.

    Not what Numba says: it reads a `.numba_config.yaml` in the working directory too, and machine
    code is not to be loaded from wherever a downloaded folder points.
    """
    asked = os.environ.get("NUMBA_CACHE_DIR")
    return Path(asked) if asked else None


def user_cache() -> Path | None:
    """Folder of RENEW in the user's cache, whether it exists or not; None without a home."""
    with contextlib.suppress(RuntimeError):  # no home
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "renew"
    return None


def _temporary_folder() -> Path:
    """A folder for this user alone: machine code is loaded from it, so no other may write there."""
    own = Path(tempfile.gettempdir()) / f"renew-{os.getuid()}"
    with contextlib.suppress(OSError):
        own.mkdir(mode=0o700, exist_ok=True)
        state = own.lstat()
        if (
            state.st_uid == os.getuid()
            and stat.S_ISDIR(state.st_mode)
            and not state.st_mode & 0o077
        ):
            (own / _name()).mkdir(exist_ok=True)
            return own / _name()
    return Path(tempfile.mkdtemp(prefix="renew-"))


@cache
def _name() -> str:
    """Name of the folder: it changes with every edit of a source that has kernels."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        source = path.read_bytes()
        if b"@kernel\n" in source or path == Path(__file__):
            digest.update(path.relative_to(_PACKAGE).as_posix().encode() + b"\0" + source)
    return f"kernels-{digest.hexdigest()[:16]}"


def _remove_earlier(folder: Path) -> None:
    """Remove the folders of earlier sources, but for the newest few."""
    others = [path for path in folder.parent.glob("kernels-*") if path != folder]
    for path in sorted(others, key=lambda path: path.stat().st_mtime)[:-_MAX_EARLIER]:
        shutil.rmtree(path, ignore_errors=True)


def is_switched_on() -> bool:
    """Whether kernels are compiled: not under NUMBA_DISABLE_JIT=1."""
    return not getattr(numba.config, "DISABLE_JIT", 0)


def processor() -> str:
    """Name of the processor that code is made for: this machine's, or that of NUMBA_CPU_NAME."""
    return str(cpu_target.target_context.codegen().magic_tuple()[1])


_failures: list[OSError] = []


@contextlib.contextmanager
def _noting_failures() -> Iterator[None]:
    """Go on where machine code can't be saved, and note why."""
    try:
        yield
    except OSError as error:
        _failures.append(error)


def save_failures() -> tuple[OSError, ...]:
    """Why machine code could not be saved in this process; empty where all could."""
    return tuple(_failures)


class _Locator(_CacheLocator):
    """Where the machine code of a kernel lies."""

    def __init__(self, module: str) -> None:
        self._module = module

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _Locator:
        """Return the locator of a function; Numba's own name for this."""
        del py_file
        return cls(py_func.__module__)

    def get_cache_path(self) -> str:
        """Folder of the machine code."""
        return str(cache_folder())

    def get_source_stamp(self) -> str:
        """What must be equal for cached code to hold."""
        return _name()

    def get_disambiguator(self) -> str:
        """What tells functions of one name in different modules apart."""
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
        self._read_only = [
            IndexDataCacheFile(str(folder), self._impl.filename_base, _name())
            for folder in _lasting_folders()
            if folder != cache_folder() and folder.is_dir()
        ]

    def _load_overload(self, sig: object, target_context: Any) -> object:  # noqa: ANN401
        found = super()._load_overload(sig, target_context)
        index_key = self._index_key(sig, target_context.codegen())
        for files in self._read_only:
            if found is None and (data := files.load(index_key)) is not None:
                found = self._impl.rebuild(target_context, data)
                # A folder that was asked for is to hold all, so that it can be shipped.
                if cache_folder().parent == _asked():
                    with _noting_failures():
                        self._cache_file.save(index_key, data)
        return found

    def save_overload(self, sig: object, data: object) -> None:
        """Save machine code; a full disk costs the next run its time, and nothing else."""
        with _noting_failures():
            super().save_overload(sig, data)
