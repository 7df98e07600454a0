"""Kernels without the compiler, as an oracle for the compiled ones; and compiled oracles."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])


def compiled(function: FunctionT) -> FunctionT:
    """Compile an oracle's loop when it is first called; it isn't kept from run to run."""
    return cast("FunctionT", numba.njit(error_model="numpy")(function))


def uncompiled(kernel: FunctionT) -> FunctionT:
    """Return the Python function of a kernel; itself where the compiler is off."""
    function: FunctionT = getattr(kernel, "py_func", kernel)
    return function
