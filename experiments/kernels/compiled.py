"""Compiles the baselines' loops when they are first called.

Machine code is kept for one run: the cache of :mod:`renew._compiled` is named by the planner's own
sources and would miss an edit here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])


def compiled(function: FunctionT) -> FunctionT:
    """Compile a function in nopython mode; division by zero gives inf or NaN, as NumPy does."""
    return cast("FunctionT", numba.njit(error_model="numpy")(function))
