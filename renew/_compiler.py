"""Numba's compiler, changed so that only the kernels that Python calls get machine code.

Numba fully compiles every function that another one calls, with optimization, machine code and
wrappers for Python and C, although the caller only needs a copy of its code. Most kernels are only
called by others, as are all of Numba's own functions for arrays. Here, such code is only typed,
and becomes machine code only within its callers, which saves a third of the time.
"""

import contextlib
import gc
from collections.abc import Callable, Hashable, Iterator
from functools import cache
from typing import Any

from numba.core import cgutils, event
from numba.core.codegen import JITCodeLibrary, ll  # type: ignore[attr-defined]
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import lookup_environment
from numba.core.pythonapi import PythonAPI
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.targetconfig import TargetConfig

# Prefix of Numba's names for environments, in which functions look up objects while they run.
_ENVIRONMENT = "_ZN08NumbaEnv"
# Kinds of Numba's events that are told each time that a lock is taken and released.
_LOCKS = ("numba:llvm_lock", "numba:compiler_lock")


class KernelDispatcher(CPUDispatcher):
    """A kernel, compiled completely for Python, and as code to inline into others."""

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
        self._inlined = CPUDispatcher(py_func, locals or {}, options, compiler)

    def compile(self, sig: Any) -> Any:  # noqa: ANN401 - types of Numba's
        """Load or compile the code for a signature. Overrides Numba's method."""
        with global_compiler_lock, _untimed():
            return super().compile(sig)

    def get_call_template(self, args: Any, kws: Any) -> Any:  # noqa: ANN401 - types of Numba's
        """Return the types of the inlined code for a caller. Overrides Numba's method."""
        return self._inlined.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:  # noqa: ANN401 - types of Numba's
        """Return the code that other kernels inline. Overrides Numba's method."""
        return self._inlined.get_overload(sig)


@contextlib.contextmanager
def _untimed() -> Iterator[None]:
    """Have Numba not time its locks: all kernels at work would be told of each call of LLVM."""
    events: Any = event
    start, end, timer = events.start_event, events.end_event, events.install_timer
    events.start_event = lambda kind, **about: kind in _LOCKS or start(kind, **about)
    events.end_event = lambda kind, **about: kind in _LOCKS or end(kind, **about)
    events.install_timer = lambda *_: contextlib.nullcontext()
    try:
        yield
    finally:
        events.start_event, events.end_event, events.install_timer = start, end, timer


class _KernelCompiler(Compiler):
    """Numba's compiler, changed to make inlined code, and kernels that a signal can't crash.

    Arrays and named tuples that a kernel returns are built with the help of a Python function, and
    a Ctrl-C that came while the kernel ran is raised there. Numba itself goes on without what this
    function should return, which ends in a SystemError or a segmentation fault.
    """

    def _compile_core(self) -> object:
        with global_compiler_lock, _for_kernels():
            state = self.state
            kind = _InlinedCode if state.flags.no_cpython_wrapper else _Whole
            state.library = kind(state.targetctx.codegen(), state.func_id.func_qualname)
            state.library.enable_object_caching()
            return super()._compile_core()


@contextlib.contextmanager
def _for_kernels() -> Iterator[None]:
    """Have Numba compile its own functions for inlining, too, and emit code that handles signals.

    The garbage collector is switched off meanwhile: it would spend a tenth of the time on compiled
    code, none of which is freed. All options are read at once, because Numba looks up its functions
    by them some 60,000 times.
    """
    if PythonAPI.unserialize is _unserialized_or_raised:
        yield  # already set up, for a kernel that calls this one
        return
    codegen, collects = cpu_target.target_context.codegen(), gc.isenabled()
    PythonAPI.unserialize = _unserialized_or_raised  # type: ignore[method-assign]
    TargetConfig.values = _values  # type: ignore[method-assign]
    codegen._library_class = _InlinedCode  # noqa: SLF001 - what Numba has no option for
    gc.disable()
    try:
        yield
    finally:
        PythonAPI.unserialize = _UNSERIALIZED  # type: ignore[method-assign]
        TargetConfig.values = _VALUES  # type: ignore[method-assign]
        del codegen._library_class  # noqa: SLF001 - the attribute of its class is used again
        if collects:
            gc.enable()


class _Library(JITCodeLibrary):
    """Code whose functions are only simplified one by one: whole code is optimized in the end."""

    def _optimize_functions(self, ll_module: Any) -> None:  # noqa: ANN401 - a module of llvmlite's
        codegen: Any = self._codegen
        ll_module.data_layout = codegen._data_layout  # noqa: SLF001 - as the overridden method does
        passes, builder = ll.create_new_function_pass_manager(), codegen._pass_builder()  # noqa: SLF001
        passes.add_sroa_pass()
        passes.add_simplify_cfg_pass()
        passes.add_instruction_combine_pass()
        passes.add_simplify_cfg_pass()
        for function in ll_module.functions:
            if not function.is_declaration:
                passes.run(function, builder)


class _InlinedCode(_Library):
    """Code that callers copy: neither optimized as a whole nor turned into machine code."""

    @property
    def codegen(self) -> "_NoMachineCode":
        """A stand-in for the code generator, by which Numba sets addresses in machine code."""
        return _NoMachineCode()

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0 in place of the address of a function, which has no machine code."""
        del name
        self._ensure_finalized()
        return 0

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _NoMachineCode:
    """Stands in for the code generator of inlined code, which has no machine code."""

    def set_env(self, env_name: str, env: object) -> None:
        """Do nothing: :class:`_Whole` sets the environments of its code."""


class _Whole(_Library):
    """Code that Python calls, with all inlined code."""

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
    """Emit code that unserializes an object, and leaves the function if that raises an error.

    The result of the kernel is lost then, and its memory is not freed.
    """
    found = _UNSERIALIZED(api, pointer)
    if api.builder.function.function_type.return_type == api.pyobj:
        with cgutils.if_unlikely(api.builder, cgutils.is_null(api.builder, found)):
            api.builder.ret(api.get_null_object())
    return found


def _values(config: Any) -> dict[str, Any]:  # noqa: ANN401
    """Read the values of all options of a compiler at once, including those that are not set."""
    kind: Any = type(config)
    return {**_defaults(kind), **config._values}  # noqa: SLF001


@cache
def _defaults(kind: Hashable) -> dict[str, Any]:
    """Return default values of all options in a class of options."""
    options: Any = kind.options  # type: ignore[attr-defined]
    return {name: option.default for name, option in options.items()}
