"""After the rehearsal a fresh process compiles nothing, whatever plan it is asked for."""

import json
import os
import shutil
from pathlib import Path

import pytest

from pipeline.scenario import catalogue
from tests.commands import PYTHON, ran
from tests.conftest import ROOT

REHEARSE = """
from renew.warming import rehearse
for what in rehearse():
    pass
"""
# These two print which functions each plan compiles, after what both need.
COUNTING = """
import json, sys
import numba
import numpy as np
from numba.core import event
with event.install_recorder("numba:compile") as recorder:
    import renew
    from pipeline.scenario.loading import load_scenario
    from shapely import box
    from tests.strategies import PAPER_VESSEL, single_gyre

    def since(before):
        begun = [one.data for _, one in recorder.buffer[before:] if one.is_start]
        return [f"{one['dispatcher'].py_func.__qualname__}{one['args']}" for one in begun]

    def compiled(chart, current, start, goal, vessel=PAPER_VESSEL, **options):
        before = len(recorder.buffer)
        plan = renew.plan(chart, current, vessel, start, goal, **options)
        for route in plan.routes:
            route.optimality_gap, route.channel, route.soft_no_go
            renew.contingency(route, chart, current, vessel, spacing=10.0)
            renew.fuel(route.path, current, vessel, drift=options.get("drift", "projected"))
        renew.tightest(plan.best, current, vessel)
        return since(before)

    chart, gyre = single_gyre().parts[:2]
    axis = np.linspace(0, 100, 40)
    uv = gyre(np.stack(np.meshgrid(axis, axis), axis=-1))
    grid = renew.GriddedCurrent(axis, axis, uv[..., 0], uv[..., 1])
    ends, swing = ((10.0, 10.0), (90.0, 90.0)), (100.0, 100.0, 0.25, 0.05)
    found = {}
"""
COUNTED = """
    before = len(recorder.buffer)
    numba.njit(lambda x: x + 1)(1)
    found["counted"] = since(before)
print(json.dumps(found))
"""
# A catalogue's options are tried on a small plane, each set of them once.
OPTIONS = f"""{COUNTING}
    for name in sys.argv[1:]:
        options = load_scenario(name).planner.model_dump(exclude={{"snap", "lanes"}})
        options |= {{"clearance": options["clearance"] or 0.0, "classes": 2}}
        if repr(options) not in found:
            found[repr(options)] = compiled(chart, grid, *ends, **options)
    # Whole numbers, single precision, no island at all: other types at the door.
    whole = renew.Vessel(speed=1, turn_rate=1, length=2)
    given = chart, gyre, (10, 10), (90, 90), whole
    found["whole numbers"] = compiled(*given, padding=2, clearance=1)
    start = np.array([10, 10], dtype=np.float32)
    found["single precision"] = compiled(chart, gyre, start, ends[1], drift="crab")
    still = renew.UniformCurrent(0, 0)
    found["open water"] = compiled(renew.Chart(chart.extent, []), still, *ends)
    # As pandas and xarray hand arrays over, and numpy views of one element.
    nodes = grid.x.copy(), grid.y.copy(), grid.uv[..., 0], np.asfortranarray(grid.uv[..., 1])
    path = np.array([ends[0], (50.0, 15.0), ends[1]])
    for array in (*nodes, start, path):
        array.flags.writeable = False
    fixed = renew.GriddedCurrent(*nodes)
    found["read only"] = compiled(chart, fixed, start, ends[1])
    before = len(recorder.buffer)
    renew.fuel(path, fixed, PAPER_VESSEL)
    renew.fuel(np.asfortranarray(path), gyre, PAPER_VESSEL)
    found["read-only path"] = since(before)
    near = renew.Chart(box(0, 0, 60, 60), [box(22, 20, 36, 40)])
    at_points = dict(risk_at="point", risk=0.001, drift="crab")
    found["point risk"] = compiled(near, grid, (10.0, 10.0), (50.0, 50.0), **at_points)
    wall = renew.Chart(box(0, 0, 60, 60), [box(30, 0, 34, 28.5), box(30, 31.5, 34, 60)])
    found["narrow water"] = compiled(wall, gyre, (10, 30), (50, 30), shortfall="least")
    found["chains"] = compiled(chart, gyre, *ends, method="sampled", samples=40, padding="none")
{COUNTED}"""
CLOCK = f"""{COUNTING}
    # The whole plane, where the current shuts the way for a while, takes 20 s of the processor.
    if "whole" in sys.argv:
        changing, waters, way, by = renew.SwingingGyre(0.2, *swing), chart, ends, 125.0
    else:
        changing, way, by = renew.SwingingGyre(0.05, *swing), ((10.0, 10.0), (30.0, 30.0)), 30.0
        waters = renew.Chart(box(0, 0, 40, 40), [box(18, 14, 24, 20)])
    chosen = dict(speed=(0.9, 1.3), arrive_by=by, classes=1)
    found["speeds by the clock"] = compiled(waters, changing, *way, **chosen)
    before = len(recorder.buffer)
    renew.plan_departures(waters, changing, PAPER_VESSEL, *way, [5.0], **chosen)
    found["departures"] = since(before)
{COUNTED}"""


def in_fresh_process(script: str, *arguments: str, root: Path, **variables: str) -> str:
    """Run a script in a process of its own, and return what it prints."""
    return ran(
        *PYTHON,
        script,
        *arguments,
        cwd=root,
        env=os.environ | {"PYTHONPATH": f"{root}{os.pathsep}{ROOT}"} | variables,
    )


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="the compiler is off")
@pytest.mark.usefixtures("rehearsed")
@pytest.mark.parametrize(
    ("script", "plans"),
    [
        pytest.param(OPTIONS, 10, id="options"),
        pytest.param(CLOCK, 2, id="clock", marks=pytest.mark.slow),
    ],
)
def test_no_plan_compiles_anything_after_the_rehearsal(script: str, plans: int, root: Path) -> None:
    scenarios = catalogue.names("scenarios")
    found = json.loads(in_fresh_process(script, *scenarios, root=root))
    assert len(found.pop("counted")) == 1, "what is compiled is not counted"
    assert len(found) >= plans
    assert {name: some for name, some in found.items() if some} == {}


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """Warm up as catalog/operation/Containerfile does: an installation, and its variables.

    No cache of this checkout or user is in reach; afterwards none can be written.
    """
    installed = tmp_path_factory.mktemp("installed")
    for package in ("renew", "pipeline", "catalog"):
        left_out = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, installed / package, ignore=left_out)
    variables = {
        "NUMBA_CPU_NAME": "x86-64-v3",
        "NUMBA_CPU_FEATURES": "",
        "NUMBA_CACHE_DIR": str(installed / "kernels"),
        "XDG_CACHE_HOME": os.devnull,
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    in_fresh_process(REHEARSE, root=installed, **variables)
    for path in (installed / "kernels").rglob("*"):
        os.utime(path, (0, 0))
    moved = installed.rename(installed.with_name("shipped"))
    variables["NUMBA_CACHE_DIR"] = str(moved / "kernels")
    return moved, variables


@pytest.mark.slow
def test_shipped_code_is_all_that_a_plan_needs(shipped: tuple[Path, dict[str, str]]) -> None:
    root, variables = shipped
    for script, asked in ((OPTIONS, "palawan-usv"), (CLOCK, "whole")):
        found = json.loads(in_fresh_process(script, asked, root=root, **variables))
        assert len(found.pop("counted")) == 1
        assert {name: some for name, some in found.items() if some} == {}
