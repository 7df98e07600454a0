"""Makes the workers of a test die of one case: RENEW_TEST_DEADLY says which case, and how it kills.

Python imports this module at its start where its folder is on PYTHONPATH.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import os
import signal
import sys
from collections.abc import Sequence
from types import ModuleType
from typing import Any

_MODULE = "pipeline.nightly.worker"


class _Deadly(importlib.abc.MetaPathFinder):
    """Replaces `rows_of` once its module has been loaded."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Find the module as ever, and change it when it is executed."""
        del target
        if name != _MODULE:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path)
        if spec is None or spec.loader is None:
            return None
        execute = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            execute(module)
            _arm(module)

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


def _arm(module: Any) -> None:  # noqa: ANN401 - a module's functions have no types here
    """Let one case kill the process that plans it."""
    rows_of = module.rows_of
    name, _, how = os.environ["RENEW_TEST_DEADLY"].partition(" ")

    def deadly(case: Any, *rest: Any) -> Any:  # noqa: ANN401 - as above
        if case.name == name:
            if how == "crash":
                os.kill(os.getpid(), signal.SIGSEGV)
            held = []
            while True:  # until it is ended at its limit
                held.append(bytearray(os.urandom(1 << 20)) * 16)
        return rows_of(case, *rest)

    module.rows_of = deadly


if "RENEW_TEST_DEADLY" in os.environ:
    sys.meta_path.insert(0, _Deadly())
