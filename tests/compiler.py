"""Kernels without the compiler, as an oracle for the compiled ones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])


def uncompiled(kernel: FunctionT) -> FunctionT:
    """Return the Python function of a kernel; itself where the compiler is off."""
    function: FunctionT = getattr(kernel, "py_func", kernel)
    return function
