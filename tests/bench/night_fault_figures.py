"""Figures of nights in which something breaks: a case that kills, a job killed half way, 50 files.

RENEW_NIGHT_SMALL_PLANS (1,000 by default) says how many cases the first two nights have.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from pipeline.nightly.cycles import rows_of_parts
from tests.bench.figure import Figure, at_most
from tests.pipeline.nightly.killed_nights import cases_done, night, run_to_the_end
from tests.pipeline.nightly.nights import plane_night, region_night, rows, write_forecast
from tests.pipeline.processes import ROOT, started, wait_until

_CASES = int(os.environ.get("RENEW_NIGHT_SMALL_PLANS", "1000"))
_FILES = 50
_DEADLY = ROOT / "tests" / "pipeline" / "nightly" / "deadly"
_LONG_S = 3600.0


def figures() -> Iterator[Figure]:
    """Yield the figures, one by one as they are measured."""
    for measure in (_one_killer, _killed_half_way, _many_files):
        with tempfile.TemporaryDirectory() as folder:
            yield measure(Path(folder))


def _one_killer(folder: Path) -> Figure:
    """Plan a night in which one case ends the interpreter of whatever plans it."""
    file, output, killer = plane_night(folder, pairs=_CASES), folder / "out", _CASES * 5 // 8
    name = f"quick/still/p{killer:04}"
    variables = {
        "PYTHONPATH": os.pathsep.join([str(_DEADLY), str(ROOT)]),
        "RENEW_TEST_DEADLY": f"{name} crash",
    }
    with started(*night(file, output), variables=variables) as process:
        process.communicate(timeout=_LONG_S)
    table = rows(output)
    planned = sum(row["status"] == "planned" for row in table)
    broken = [row["case"] for row in table if row["status"] == "broken"]
    return Figure(
        f"one killing case in {_CASES:,}",
        f"{_CASES - 1:,} planned, that one named",
        f"{planned:,} planned, broken: {', '.join(broken)}",
        (planned, broken) == (_CASES - 1, [name]),
    )


def _killed_half_way(folder: Path) -> Figure:
    """Kill a night when half of its work is done."""
    file, output = plane_night(folder, pairs=_CASES), folder / "out"
    with started(*night(file, output)) as process:
        wait_until(lambda: cases_done(output) >= _CASES / 2 > 0, _LONG_S)
        process.kill()
        process.wait()
    (partial,) = output.glob("*.partial")
    first_s = sum(row.get("seconds", 0.0) for rows in rows_of_parts(partial) for row in rows)
    run_to_the_end(file, output)
    total_s = json.loads((output / "latest" / "night.json").read_text())["planning_seconds"]
    name = f"killed half way, {_CASES:,} cases: share of the work that the next run does"
    return at_most(name, 1 - first_s / total_s, 0.55)


def _many_files(folder: Path) -> Figure:
    """Run a finished cycle of an ensemble again: every file must be looked at."""
    for member in range(_FILES):
        write_forecast(folder / "currents" / f"m{member:02}.nc", seed=member)
    file, output = region_night(folder, departures=1), folder / "out"
    run_to_the_end(file, output)
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    begun = time.perf_counter()
    run_to_the_end(file, output)
    seconds = time.perf_counter() - begun
    touched = before != {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    name = f"rerun of a finished cycle on {_FILES} files"
    return at_most(name + (", FILES TOUCHED" if touched else ""), seconds, 3, " s", 1)
