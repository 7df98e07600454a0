"""Compiles kernels with Numba, and keeps their machine code, so that only the first run waits.

This is the only module of `renew` that uses files. Numba checks the source of each cached function
alone, and misses an edit of a function that it inlines. So the folder is named by a hash of all
sources with kernels. It holds no paths and no times, and can be shipped.
"""

import contextlib
import fcntl
import hashlib
import os
import platform
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite.binding
import numba
import numpy as np
import numpy.typing as npt
from numba.core import cgutils
from numba.core.codegen import CodeLibrary, CPUCodegen
from numba.core.compiler import CompileResult
from numba.core.pythonapi import PythonAPI

FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])

_PACKAGE = Path(__file__).resolve().parent
# The decorators' own module, too.
_HAS_KERNELS = re.compile(rb"^ *(@|def )\w*kernel\b", re.MULTILINE)
# Folders of earlier sources that are kept beside the one in use: another checkout may share them.
_MAX_EARLIER = 3


def kernel(function: FunctionT, **more: bool) -> FunctionT:
    """Compile a function in nopython mode when it is first called; cached on disk.

    Division by zero gives inf or NaN, as NumPy does. Other threads go on running, such as the one
    that ends the process on a signal. Under NUMBA_DISABLE_JIT=1 the function is returned unchanged.
    """
    options: dict[str, Any] = {"cache": True, "error_model": "numpy", "nogil": True, **more}
    config: Any = numba.config
    earlier, config.CACHE_LOCATOR_CLASSES = config.CACHE_LOCATOR_CLASSES, _LOCATOR
    try:
        compiled: Any = numba.njit(function, **options)
    finally:
        config.CACHE_LOCATOR_CLASSES = earlier
    if is_switched_on():
        saving = compiled._cache._cache_file
        saving.save = partial(_saved_alone, saving.save)
        compiled._cache._impl.rebuild = _rebuilt
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
    """Return the folder of the machine code: the first that can be written, or that holds all."""
    for parent in _lasting_parents():
        folder = parent / _name()
        with contextlib.suppress(OSError):
            if (folder / _complete()).is_file():
                return folder
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            _remove_earlier(folder)
            return folder
    return Path(_temporary().name)


@cache
def _temporary() -> tempfile.TemporaryDirectory[str]:
    """Make a folder that is removed when the process ends."""
    return tempfile.TemporaryDirectory(prefix="renew-")


def cache_is_temporary() -> bool:
    """Whether neither the package nor the user's cache can be written: each start compiles anew."""
    return cache_folder().parent not in _lasting_parents()


def is_cold() -> bool:
    """Whether nothing is compiled yet, and this process can save the code that it compiles."""
    return not cache_is_temporary() and not any(cache_folder().glob("*.nbi"))


def is_switched_on() -> bool:
    """Whether kernels are compiled: not under NUMBA_DISABLE_JIT=1."""
    return not getattr(numba.config, "DISABLE_JIT", 0)


def has_all() -> bool:
    """Whether `note_all` was called in the folder for this processor, and its code is there."""
    noted = cache_folder() / _complete()
    return noted.is_file() and set(noted.read_text().splitlines()) <= set(_listed())


def note_all() -> None:
    """Note that every kernel that a plan may call has been called."""
    (cache_folder() / _complete()).write_text("\n".join(_listed()))


def processor() -> str:
    """Return the processor for which code is made: this machine's, or the one in NUMBA_CPU_NAME."""
    return str(getattr(numba.config, "CPU_NAME", "") or llvmlite.binding.get_host_cpu_name())


def user_cache() -> Path | None:
    """Return RENEW's folder in the user's cache, whether it exists or not; None without a home."""
    with contextlib.suppress(RuntimeError):  # no home
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "renew"
    return None


def _lasting_parents() -> Iterator[Path]:
    """Yield folders where the cache may outlive a reboot, in order of preference.

    Numba's own setting may come from a `.numba_config.yaml` in the working directory, and a
    downloaded folder must not decide where machine code is loaded from.
    """
    if asked := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(asked)
    yield _PACKAGE / "__pycache__"
    if (user := user_cache()) is not None:
        yield user


@cache
def _name() -> str:
    """Return the folder's name: a hash of all sources with kernels, and of Numba's version."""
    with_kernels = (path for path in _sources() if _HAS_KERNELS.search(path.read_bytes()))
    return f"kernels-{_hash(*with_kernels, of=numba.__version__)}"


@cache
def _complete() -> str:
    """Return the note's name: which kernels are called, and how, is decided by all sources."""
    features = getattr(numba.config, "CPU_FEATURES", None)
    versions = (platform.python_version(), np.__version__, processor(), features)
    return f"complete-{_hash(*_sources(), of=repr(versions))}"


def _sources() -> list[Path]:
    return sorted(_PACKAGE.rglob("*.py"))


def _hash(*paths: Path, of: str) -> str:
    """Return a hash of a text, and of files' names and contents."""
    digest = hashlib.sha256(of.encode())
    for path in paths:
        digest.update(path.relative_to(_PACKAGE).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def _listed() -> list[str]:
    """List the files of machine code, with their sizes in bytes; an index may have grown."""
    found = sorted(cache_folder().glob("*.nbc"))
    return [f"{path.name} {path.stat().st_size}" for path in found]


def _remove_earlier(folder: Path) -> None:
    """Remove the folders of earlier sources, except the newest few."""
    others = [path for path in folder.parent.glob("kernels-*") if path != folder]
    for path in sorted(others, key=lambda path: path.lstat().st_mtime)[:-_MAX_EARLIER]:
        shutil.rmtree(path, ignore_errors=True)


class Locator:
    """Tells Numba where a kernel's machine code lies, by the methods that Numba calls."""

    def __init__(self, module: str) -> None:
        self._module = module

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> "Locator":
        """Return the locator of a function."""
        del file
        return cls(function.__module__)

    def ensure_cache_path(self) -> None:
        """Do nothing: the folder is there, and may be one that can only be read."""

    def get_cache_path(self) -> str:
        """Return the folder of the machine code."""
        return str(cache_folder())

    def get_source_stamp(self) -> str:
        """Return a stamp that must be equal for cached code to be valid."""
        return _name()

    def get_disambiguator(self) -> str:
        """Return a text that distinguishes functions of one name in different modules."""
        return self._module


_LOCATOR = f"{__name__}.{Locator.__name__}"
_UNSERIALIZED = PythonAPI.unserialize


def _unserialized_or_raised(api: Any, pointer: object) -> object:
    """Emit code that unserializes an object, and leaves the function if that raises an error.

    Arrays and named tuples that a kernel returns are built with the help of a Python function, and
    a Ctrl-C that came while the kernel ran is raised there. Numba goes on without what that
    function should return: a segmentation fault.
    """
    found = _UNSERIALIZED(api, pointer)
    if api.builder.function.function_type.return_type == api.pyobj:
        with cgutils.if_unlikely(api.builder, cgutils.is_null(api.builder, found)):
            api.builder.ret(api.get_null_object())
    return found


PythonAPI.unserialize = _unserialized_or_raised  # type: ignore[method-assign]


def _saved_alone(save: Callable[[object, object], None], key: object, code: object) -> None:
    """Save machine code while no other process does, on a file system that has locks.

    Numba reads the index of a kernel, adds an entry and writes it. Of two processes that did so at
    once one would lose its entry, or an entry would name the code of other types.
    """
    folder = os.open(cache_folder(), os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(folder, fcntl.LOCK_EX)
        save(key, code)
    finally:
        os.close(folder)


def _rebuilt(context: Any, saved: Any) -> Any:
    """Make saved machine code callable; its bitcode is parsed for a kernel that inlines it only.

    Numba parses it at once, which takes three quarters of the time to load a kernel.
    """
    (name, _, (code, bitcode)), function, *others = saved
    codegen = context.codegen()
    library = codegen.create_library(name)
    library.enable_object_caching()
    library._set_compiled_object(code)
    library._finalize_final_module()
    library._get_module_for_linking = lambda: llvmlite.binding.parse_bitcode(bitcode)
    callable_as = function.llvm_func_name, function.llvm_cpython_wrapper_name
    codegen._engine._defined_symbols.update(callable_as)
    return CompileResult._rebuild(context, library, function, *others)


_UNSERIALIZE = CPUCodegen.unserialize_library


def _unserialized_library(codegen: Any, saved: Any) -> CodeLibrary:
    """Return the library of saved code, or one that is made already."""
    return saved if isinstance(saved, CodeLibrary) else _UNSERIALIZE(codegen, saved)


CPUCodegen.unserialize_library = _unserialized_library  # type: ignore[method-assign]
