"""Reads pickles that build values only, so that a store in a downloaded folder can't run code.

A pickle names the functions that it calls. Allowed are this program's classes of values (data
classes, enumerations, models, errors, the planner's inputs) and the few constructors of arrays,
geometries and times below; see
https://docs.python.org/3/library/pickle.html#restricting-globals.
"""

import dataclasses
import enum
import io
import pickle

from pydantic import BaseModel

_PACKAGES, _PLANNER_INPUTS = frozenset({"pipeline", "renew"}), "renew.inputs."
_VALUES = (enum.Enum, BaseException, BaseModel)
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


def values_from(content: bytes) -> object:
    """Return the value of a pickle.

    Raises
    ------
    pickle.UnpicklingError
        It names anything but a class or constructor of values.
    """
    return _ValueUnpickler(io.BytesIO(content)).load()


class _ValueUnpickler(pickle.Unpickler):
    """Resolves classes of values only."""

    def find_class(self, module: str, name: str) -> object:
        """Return the class or constructor that a pickle names."""
        if name in _ALLOWED.get(module, ()):
            return super().find_class(module, name)
        if module.partition(".")[0] in _PACKAGES:
            found = super().find_class(module, name)
            if isinstance(found, type) and _holds_values(found):
                return found
        raise pickle.UnpicklingError(f"{module}.{name} is no value of this program")


def _holds_values(kind: type) -> bool:
    """Whether a class of this program holds values only: making one has no side effect."""
    if kind.__module__.partition(".")[0] not in _PACKAGES:  # a library's, which a module imports
        return False
    is_named_tuple = issubclass(kind, tuple) and hasattr(kind, "_fields")
    is_input = kind.__module__.startswith(_PLANNER_INPUTS)
    return is_input or is_named_tuple or dataclasses.is_dataclass(kind) or issubclass(kind, _VALUES)
