"""Tell what a plan is doing, and the paths that it has found so far, while it is at work."""

import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Literal

from renew._types import FloatArray


@dataclass(frozen=True, slots=True)
class Step:
    """A step of a plan.

    "class": a way round the islands is tried; "padding": hard-over turns along it meet land, so its
    padding grows; "path": it has a `path` (n, 2), planar metres, whose turns are clear. Later steps
    may find a better one of the same class.
    """

    kind: Literal["class", "padding", "path"]
    path: FloatArray | None = None


_watcher: ContextVar[Callable[[Step], None] | None] = ContextVar("watcher", default=None)


@contextlib.contextmanager
def watched(watcher: Callable[[Step], None] | None) -> Iterator[None]:
    """Have the plans of this thread tell their steps inside the `with` block; None: to nobody."""
    earlier = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(earlier)


def tell(step: Step) -> None:
    """Tell a step to the watcher, if there is one."""
    watcher = _watcher.get()
    if watcher is not None:
        watcher(step)
