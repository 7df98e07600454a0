"""The planner without the extra `triangle`: its quick tests once more, triangulated by GEOS."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from tests.commands import PYTHON, ran
from tests.renew import test_against_oracles, test_planner
from tests.strategies import single_gyre


@pytest.fixture(autouse=True)
def _without_triangle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refuse the import of `triangle`, as where it is not installed."""
    monkeypatch.setitem(sys.modules, "triangle", None)


def _quick_tests(module: ModuleType) -> dict[str, Callable[..., None]]:
    """Tests of a module that are not marked slow, by their names."""
    tests = {name: value for name, value in vars(module).items() if name.startswith("test_")}
    marks = {name: getattr(test, "pytestmark", []) for name, test in tests.items()}
    return {
        name: test
        for name, test in tests.items()
        if "slow" not in {mark.name for mark in marks[name]}
    }


globals().update(_quick_tests(test_planner) | _quick_tests(test_against_oracles))


def gyre() -> str:
    """Classes and the best fuel of the published single gyre, as printed."""
    plan = single_gyre().plan()
    return f"{sorted(route.homotopy for route in plan.routes)} {plan.best.fuel:.9f}"


def test_a_process_that_cannot_import_triangle_makes_the_same_plan(root: Path) -> None:
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
    assert done.strip() == gyre()
