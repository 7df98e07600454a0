"""Compilation beside a first run: it compiles all that a plan calls, and never delays the run."""

import os
import shutil
import signal
import time
from pathlib import Path

import pytest

from pipeline.machine import workers as beside
from tests.conftest import ROOT
from tests.renew.test_warming import in_fresh_process

# Prints how many functions a first plan compiles after what was compiled beside, and by how many
# processor seconds that was.
PLAN = """
import resource
from numba.core import event
from pipeline.machine.workers import first_compilation
with first_compilation() as wait:
    wait()
with event.install_recorder("numba:compile") as recorder:
    import numpy as np
    import renew
    from tests.strategies import PAPER_VESSEL, single_gyre
    chart, gyre = single_gyre().parts[:2]
    axis = np.linspace(0, 100, 40)
    uv = gyre(np.stack(np.meshgrid(axis, axis), axis=-1))
    grid = renew.GriddedCurrent(axis, axis, uv[..., 0], uv[..., 1])
    plan = renew.plan(chart, grid, PAPER_VESSEL, (10.0, 10.0), (90.0, 90.0), classes=3)
    plan.best.optimality_gap
print(len(recorder.buffer), resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime)
"""


def _compile_slowly(half: int) -> None:
    """Stand in for what compiles."""
    time.sleep(600 + half)


@pytest.fixture
def _cold(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pretend that nothing is compiled, that there are two cores, and that processes are slow."""
    monkeypatch.setattr(beside, "compile_half", _compile_slowly)
    monkeypatch.setattr("renew._compiled.is_cold", lambda: True)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})


def _started() -> list[int]:
    """Numbers of the processes that this one has started and that are at work."""
    (task,) = Path("/proc/self/task").glob(str(os.getpid()))
    return [int(number) for number in (task / "children").read_text().split()]


@pytest.mark.usefixtures("_cold")
def test_a_run_that_ends_sooner_leaves_no_process() -> None:
    before = _started()
    with beside.first_compilation():
        ours = set(_started()) - set(before)
        assert len(ours) == 2
    assert not ours & set(_started())


@pytest.mark.usefixtures("_cold")
def test_a_process_that_is_killed_is_waited_for_no_longer() -> None:
    before = _started()
    with beside.first_compilation() as wait:
        for process in set(_started()) - set(before):
            os.kill(process, signal.SIGKILL)
        wait()


@pytest.mark.usefixtures("_cold")
@pytest.mark.parametrize("why", ["one core", "something is compiled"])
def test_nothing_is_started_where_it_does_not_pay(
    why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if why == "one core":
        monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    else:
        monkeypatch.setattr("renew._compiled.is_cold", lambda: False)
    before = _started()
    with beside.first_compilation() as wait:
        wait()
        assert _started() == before


@pytest.mark.slow
def test_a_first_plan_finds_all_compiled(tmp_path: Path) -> None:
    for package in ("renew", "pipeline", "catalog"):
        left_out = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, tmp_path / package, ignore=left_out)
    variables = {"NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "XDG_CACHE_HOME": os.devnull}
    compiled, seconds = in_fresh_process(PLAN, root=tmp_path, **variables).split()
    if len(os.sched_getaffinity(0)) > 1:
        assert float(seconds) > 1
        assert compiled == "0"
