"""Numba's compiler, with machine code for those kernels alone that Python calls.

Numba makes a whole of each function that another one calls: optimized, with machine code, and with
wrappers for Python and for C, although its caller takes in a copy of the code. Most kernels are
only called by others, as are all of Numba's own functions for arrays. Here such a *part* is typed,
and becomes machine code in its callers alone, which saves a third of the time.
"""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Callable, Hashable, Iterator
from functools import cache
from typing import Any

from numba.core import cgutils
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import lookup_environment
from numba.core.pythonapi import PythonAPI
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.targetconfig import TargetConfig

# How Numba begins the names of what functions look up while they run.
_ENVIRONMENT = "_ZN08NumbaEnv"


class KernelDispatcher(CPUDispatcher):
    """A kernel: whole for Python, and a part for other kernels."""

    def __init__(
        self,
        py_func: Callable[..., Any],
        locals: dict[str, Any] | None = None,  # noqa: A002 - Numba's name
        targetoptions: dict[str, Any] | None = None,
        pipeline_class: type[Compiler] | None = None,
    ) -> None:
        options = {**(targetoptions or {}), "no_cfunc_wrapper": True}
        compiler = pipeline_class or _KernelCompiler
        super().__init__(py_func, locals or {}, options, compiler)
        options = {**options, "no_cpython_wrapper": True}
        self._part = CPUDispatcher(py_func, locals or {}, options, compiler)

    def get_call_template(self, args: Any, kws: Any) -> Any:  # noqa: ANN401 - types of Numba's
        """What a kernel that calls this one is typed by; Numba's own name for this."""
        return self._part.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:  # noqa: ANN401 - types of Numba's
        """What a kernel that calls this one is linked to; Numba's own name for this."""
        return self._part.get_overload(sig)


class _KernelCompiler(Compiler):
    """Numba's compiler, but for what is made of parts, and of signals that interrupt a kernel.

    Arrays and named tuples are made of what a kernel returns with the help of a Python function: a
    Ctrl-C that came while the kernel ran is raised there. Numba goes on with what that did not
    return, which ends in a SystemError or a segmentation fault.
    """

    def _compile_core(self) -> object:
        with global_compiler_lock, _for_kernels():
            state = self.state
            kind = _Part if state.flags.no_cpython_wrapper else _Whole
            state.library = kind(state.targetctx.codegen(), state.func_id.func_qualname)
            state.library.enable_object_caching()
            return super()._compile_core()


@contextlib.contextmanager
def _for_kernels() -> Iterator[None]:
    """Have Numba make parts of its own functions, and code that minds signals.

    What it makes lives on: the garbage collector, which would look through it again and again for a
    tenth of the time, waits. Nor are the options, by which Numba finds its functions some 60,000
    times, asked one by one.
    """
    if PythonAPI.unserialize is _unserialized_or_raised:
        yield  # for the kernel that calls this one
        return
    codegen, collects = cpu_target.target_context.codegen(), gc.isenabled()
    PythonAPI.unserialize = _unserialized_or_raised  # type: ignore[method-assign]
    TargetConfig.values = _values  # type: ignore[method-assign]
    codegen._library_class = _Part  # noqa: SLF001 - what Numba has no option for
    gc.disable()
    try:
        yield
    finally:
        PythonAPI.unserialize = _UNSERIALIZED  # type: ignore[method-assign]
        TargetConfig.values = _VALUES  # type: ignore[method-assign]
        del codegen._library_class  # noqa: SLF001 - so that it is its class' again
        if collects:
            gc.enable()


class _Part(JITCodeLibrary):
    """Code for callers to take in: not optimized as a whole, and no machine code."""

    @property
    def codegen(self) -> _NoMachineCode:
        """What knows where the machine code lies."""
        return _NoMachineCode()

    def get_pointer_to_function(self, name: str) -> int:
        """Address of a function: none."""
        del name
        self._ensure_finalized()
        return 0

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _NoMachineCode:
    """Stands for the machine code of a part."""

    def set_env(self, env_name: str, env: object) -> None:
        """Nothing can be looked up yet: :class:`_Whole` sees to it."""


class _Whole(JITCodeLibrary):
    """Code that Python calls, with all its parts."""

    def _finalize_specific(self) -> None:
        super()._finalize_specific()
        for variable in self._final_module.global_variables:
            if variable.name.startswith(_ENVIRONMENT):
                environment = lookup_environment(variable.name)
                if environment is not None:
                    codegen: Any = self._codegen
                    codegen.set_env(variable.name, environment)


_UNSERIALIZED, _VALUES = PythonAPI.unserialize, TargetConfig.values


def _unserialized_or_raised(api: Any, pointer: object) -> object:  # noqa: ANN401
    """Emit code that unserializes an object; where that raises, the function that asks returns.

    What the kernel has returned is lost then, and its memory with it.
    """
    found = _UNSERIALIZED(api, pointer)
    if api.builder.function.function_type.return_type == api.pyobj:
        with cgutils.if_unlikely(api.builder, cgutils.is_null(api.builder, found)):
            api.builder.ret(api.get_null_object())
    return found


def _values(config: Any) -> dict[str, Any]:  # noqa: ANN401
    """Values of a compiler's options, those not set among them: in one go."""
    kind: Any = type(config)
    return {**_defaults(kind), **config._values}  # noqa: SLF001


@cache
def _defaults(kind: Hashable) -> dict[str, Any]:
    """Values of the options of some kind where none is set."""
    options: Any = kind.options  # type: ignore[attr-defined]
    return {name: option.default for name, option in options.items()}
