"""Compiled functions as virtual ones of OMPL's objects: OMPL calls them without Python.

OMPL's planners call an objective or a motion validator up to 8 million times. Overridden in Python,
as its bindings allow, a call takes 1 to 4 μs, most of it to wrap two states. So a C++ object gets a
table of virtual functions of its own: a copy of its class's, some of them replaced. The layout is
that of the Itanium C++ ABI, which Linux and macOS keep. Places in the table are found by OMPL's
symbols: a release that names its functions otherwise is refused.
"""

from __future__ import annotations

import atexit
import ctypes
import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numba
import ompl
from numba import types
from numba.extending import intrinsic

from experiments.kernels.compiled import compiled

TWO_STATES = "EPKNS0_5StateES4_"
"""End of a mangled name, of a function of two states."""

Word = ctypes.c_size_t
Function: TypeAlias = Callable[..., Any]

# Numba has no types of its own.
_pointer: Any = types.CPointer
_typeof: Any = numba.typeof
# A state of a vector space: a table of virtual functions, then its coordinates.
_STATE = _pointer(_pointer(types.float64))
# Words that are copied of a table: more than the classes here have.
_TABLE = 64
# Words at a table's beginning, an offset and the type: objects refer to the first function, behind
# them.
_HEAD = 2
# Bytes of an object of nanobind before the C++ object, or before the pointer to it.
_WRAPPER = 24


def override(
    instance: object, name: str, functions: Mapping[str, Function], context: tuple[Any, ...]
) -> None:
    """Replace virtual functions of one object of OMPL's class `ompl::base::<name>`.

    `functions` has mangled names, as they stand in the class's table, each with a function of
    :func:`of_states`. All get the `context`.

    Raises
    ------
    RuntimeError
        OMPL's library does not have the class or a function, or the object is of another class.
    """
    try:
        table = (Word * _TABLE).from_address(_address(f"_ZTVN4ompl4base{len(name)}{name}E"))
        places = {list(table).index(_address(symbol)): f for symbol, f in functions.items()}
        first = ctypes.addressof(table) + _HEAD * ctypes.sizeof(Word)
        # The C++ object stands inside the Python object, or elsewhere if OMPL made it.
        here = id(instance) + _WRAPPER
        pointer = next(
            Word.from_address(place)
            for place in (here, Word.from_address(here).value)
            if Word.from_address(place).value == first
        )
    except (ValueError, StopIteration) as error:
        raise RuntimeError(
            f"OMPL's class {name} is not as expected: {error!r}; install the release of OMPL that "
            "requirements.lock names"
        ) from error
    # The context's address stands before the table.
    own = (Word * (1 + _TABLE))(_kept(context), *table)
    for place, function in places.items():
        own[1 + place] = function(_typeof(context)).address
    pointer.value = ctypes.addressof(own) + (1 + _HEAD) * ctypes.sizeof(Word)
    # The object keeps its new table until the process ends; its end is called by the old one, as
    # by then the new one may be freed.
    atexit.register(_give_back, pointer, first, instance, own)


def _give_back(pointer: Word, first: int, *_kept: object) -> None:
    """Give an object its class's table again; what it refers to has lived as long, a whole job."""
    pointer.value = first


def _address(symbol: str) -> int:
    """Address of a symbol of OMPL's library; ValueError if it has none of that name."""
    return ctypes.addressof(ctypes.c_char.in_dll(_library(), symbol))


@functools.cache
def _library() -> ctypes.CDLL:
    """OMPL's library, which its bindings have loaded."""
    return ctypes.CDLL(str(next(Path(ompl.__file__).parent.glob("libompl.*"))))


def of_states(result: types.Type) -> Callable[[Function], Function]:
    """Make a virtual function of two states of a function of the context and ax, ay, bx, by."""

    def made(function: Function) -> Function:
        inner = compiled(function)

        @functools.cache
        def for_context(context: types.Type) -> Any:  # noqa: ANN401
            this = _pointer(_pointer(_pointer(context)))

            @numba.cfunc(result(this, _STATE, _STATE))
            def virtual(this: Any, one: Any, other: Any) -> Any:  # noqa: ANN401
                a, b = one[1], other[1]
                return inner(this[0][-1 - _HEAD][0], a[0], a[1], b[0], b[1])

            return virtual

        return for_context

    return made


def never(_context: types.Type) -> Any:  # noqa: ANN401
    """Return the virtual function without arguments that says no."""
    return _no


@numba.cfunc(types.boolean(types.voidptr))
def _no(_this: object) -> bool:
    return False


@intrinsic
def _stored(_typing: Any, value: types.Type) -> Any:  # noqa: ANN401
    """Numba's code for it: what the tuple refers to is kept, too."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        (stored,) = arguments
        size = context.get_constant(types.intp, context.get_abi_sizeof(stored.type))
        memory = context.nrt.allocate(builder, size)
        builder.store(stored, builder.bitcast(memory, stored.type.as_pointer()))
        context.nrt.incref(builder, value, stored)
        return builder.ptrtoint(memory, context.get_value_type(types.intp))

    return types.intp(value), generate


@compiled
def _kept(value: tuple[Any, ...]) -> int:
    """Address of a copy of a tuple, as compiled functions read it, that is never freed."""
    return int(_stored(value))  # type: ignore[call-arg]
