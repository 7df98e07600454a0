"""One seed gives one plan, to the last bit: on one thread and on two, in any process."""

import hashlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import renew
from tests.commands import PYTHON, ran
from tests.strategies import random_scene, single_gyre

# Variables that limit the threads of numerical libraries.
THREAD_LIMITS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def gyre(**options: Any) -> renew.Plan:  # as plan() has them
    return single_gyre().plan(**options)


def islands(**options: Any) -> renew.Plan:
    return random_scene(2).plan(**options)


CASES: dict[str, Callable[[], renew.Plan]] = {
    "adaptive": gyre,
    "clearance, exact drift": partial(gyre, padding="none", clearance=12.55, drift="crab"),
    "sampled": partial(gyre, method="sampled", samples=100, seed=7),
    "islands": partial(islands, classes=4),
    "islands, distinct": partial(islands, classes=4, padding="none", distinct_by=20.0),
}

FEW = ("adaptive", "islands, distinct")
"""What the gate plans again."""


def digest(plan: renew.Plan) -> str:
    """Hash of all figures, shapes and texts of a plan."""
    hashed = hashlib.sha256(f"{plan.chosen}".encode())
    for route in plan.routes:
        for figures in (route.path, route.trajectory, route.channel, route.padding_used):
            hashed.update(np.ascontiguousarray(figures, dtype=float).tobytes())
        hashed.update(route.soft_no_go.wkb)
        scalars = route.fuel, route.length, route.clearance, route.duration, route.optimality_gap
        hashed.update(np.array(scalars).tobytes())
        hashed.update(route.homotopy.encode())
    for rejected in plan.rejected:
        hashed.update(f"{rejected.homotopy} {rejected.reason}".encode())
        hashed.update(np.ascontiguousarray(rejected.channel, dtype=float).tobytes())
    return hashed.hexdigest()


def digests(*names: str) -> dict[str, str]:
    """Hash of the plans of some cases, or of every case."""
    return {name: digest(CASES[name]()) for name in names or CASES}


@cache
def here(name: str) -> str:
    """Hash of a plan of this process, made in its one thread."""
    return digest(CASES[name]())


def test_different_plans_have_different_hashes() -> None:
    assert len(set(map(here, FEW))) == len(FEW)
    assert digest(gyre(method="sampled", samples=100, seed=8)) != here("sampled")


@pytest.mark.slow
def test_all_plans_have_different_hashes() -> None:
    assert len(set(map(here, CASES))) == len(CASES)


@pytest.mark.slow
def test_two_threads_that_plan_at_once_do_not_disturb_each_other() -> None:
    with ThreadPoolExecutor(2) as pool:
        both = [pool.submit(digests) for _ in range(2)]
    expected = {name: here(name) for name in CASES}
    assert [done.result() for done in both] == [expected, expected]


@pytest.mark.parametrize(
    ("threads", "hash_seed", "names"),
    [
        (1, 1, FEW),
        pytest.param(1, 2, (), marks=pytest.mark.slow),
        pytest.param(2, 4242, (), marks=pytest.mark.slow),
    ],
)
def test_a_fresh_process_makes_the_same_plan_on_one_thread_and_on_two(
    threads: int, hash_seed: int, names: tuple[str, ...], root: Path
) -> None:
    limits = dict.fromkeys(THREAD_LIMITS, str(threads))
    program = f"from tests.renew.test_determinism import digests; print(digests(*{names}))"
    done = ran(
        *PYTHON,
        program,
        cwd=root,
        env={**os.environ, **limits, "PYTHONHASHSEED": str(hash_seed)},
        timeout=300,
    )
    assert done.strip() == str({name: here(name) for name in names or CASES})


@pytest.mark.slow
def test_the_compiler_changes_nothing(root: Path) -> None:
    program = (
        "from tests.renew.test_determinism import gyre; "
        'best = gyre(classes=1, padding="triangle").best; '
        "print(best.homotopy, best.fuel)"
    )
    done = ran(
        *PYTHON, program, cwd=root, env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, timeout=300
    )
    name, fuel = done.split()
    # Fitting padding takes steps whose number a last digit may change.
    best = gyre(classes=1, padding="triangle").best
    assert name == best.homotopy
    assert float(fuel) == pytest.approx(best.fuel, rel=1e-9)
