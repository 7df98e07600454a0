"""The planner without the extra `triangle`; `make test-no-triangle` runs its tests there."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from tests.commands import PYTHON, ran
from tests.strategies import single_gyre


def gyre() -> str:
    """Classes and the best fuel of the published single gyre, as printed."""
    plan = single_gyre().plan()
    return f"{sorted(route.homotopy for route in plan.routes)} {plan.best.fuel:.9f}"


def test_a_process_that_cannot_import_triangle_makes_the_same_plan(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = (
        "import importlib.util; assert importlib.util.find_spec('triangle') is None; "
        "from tests.renew.test_without_triangle import gyre; print(gyre())"
    )
    done = ran(
        *PYTHON,
        program,
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root / "tests" / "no_triangle")},
        timeout=300,
    )
    monkeypatch.setitem(sys.modules, "triangle", None)
    assert done.strip() == gyre()
