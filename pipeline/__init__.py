"""The batch pipeline around the planner: from a scenario in TOML to output files.

The only package that deals with files, coordinate reference systems, the network and Dask.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.voyage.one_line import go

__all__ = ["go"]


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
    """Import `go` when it is first used, because its import takes seconds.

    The import is by name: with a plain import every module here would depend on all that `go` uses.
    """
    if name == "go":
        return import_module("pipeline.voyage.one_line").go
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
