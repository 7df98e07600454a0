"""Figures of the nightly job: beside plain processes, its memory, its reruns.

The full figures take hours: RENEW_NIGHT_PLANS (60 by default) and RENEW_NIGHT_SMALL_PLANS (400)
say how many plans are made in Palawan and in a small plane.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.nightly.request.cases import Cases
from pipeline.nightly.request.config import load_config
from pipeline.nightly.request.expansion import expand
from tests.bench.figure import Figure, at_most
from tests.pipeline.nightly.nights import plane_night, rows, write_night

if TYPE_CHECKING:
    from collections.abc import Iterator

_PLANS = int(os.environ.get("RENEW_NIGHT_PLANS", "60"))
_SMALL_PLANS = int(os.environ.get("RENEW_NIGHT_SMALL_PLANS", "400"))
_PALAWAN_PAIRS = min(20, _PLANS)
# One of two plain processes: every second case, planned and evaluated one after the other.
_PLAIN = """
import sys, time
from pathlib import Path
from pipeline.nightly.planning.comparison import Rules
from pipeline.nightly.request.config import load_config
from pipeline.nightly.request.expansion import expand
from pipeline.nightly.request.newest_currents import newest_currents
from pipeline.nightly.cycle.partial import Partial
from pipeline.nightly.planning.planning import Planning
from pipeline.nightly.planning.worker import plan_case
from pipeline.storage.store import Store
from datetime import UTC, datetime
config = load_config(Path(sys.argv[1]), Path(sys.argv[2]))
cases = expand(config)
planning = Planning(cases, newest_currents(cases), Store(config.output / ".artefacts"),
    Partial(config.output, datetime.now(UTC), ""), Rules(3.0), None, "", print, print)
half = int(sys.argv[3])
tasks = [planning._case_task(cases[i]) for i in range(len(cases)) if i * 2 // len(cases) == half]
plan_case(tasks[0], planning.chart_path(cases[tasks[0].index]), Rules(3.0), None)
begun = time.perf_counter()
for task in tasks:
    plan_case(task, planning.chart_path(cases[task.index]), Rules(3.0), None)
print(time.perf_counter() - begun)
"""


def figures() -> Iterator[Figure]:
    """Yield the figures, one by one as they are measured."""
    with tempfile.TemporaryDirectory() as folder:
        yield from _beside_plain(
            "nightly, Palawan", _palawan(Path(folder)), Path(folder) / "out", 0.9
        )
    with tempfile.TemporaryDirectory() as folder:
        file = plane_night(Path(folder), pairs=_SMALL_PLANS)
        yield from _beside_plain("nightly, small plane", file, Path(folder) / "out", 0.8)


def _palawan(folder: Path) -> Path:
    """Write a night of pairs across Palawan on the embedded currents, twice a day."""
    rng = np.random.default_rng(1)
    pairs = [
        f"{120.3 + a:.4f},{12.8 + b:.4f},{116.8 + c:.4f},{7.7 + d:.4f},p{i:02}"
        for i, (a, b, c, d) in enumerate(rng.uniform(-0.05, 0.05, (_PALAWAN_PAIRS, 4)))
    ]
    (folder / "pairs.csv").write_text(
        "start_lon,start_lat,goal_lon,goal_lat,name\n" + "\n".join(pairs) + "\n"
    )
    count = max(1, _PLANS // _PALAWAN_PAIRS)
    cases = (
        'scenario = "palawan-usv"\npairs = "pairs.csv"\nvessels = ["usv-7m"]\n'
        'seasons = ["summer"]\ncurrents = ["embedded-palawan"]\n'
        f'departures = {{ first = "06:00Z", every = "6h", count = {count} }}\n'
    )
    return write_night(folder, cases, workers=2, memory_gb=1.0, stale_hours=1e6)


def _beside_plain(name: str, file: Path, output: Path, share: float) -> Iterator[Figure]:
    """Measure a night, and the same plans in two plain processes."""
    count = len(Cases(expand(load_config(file, output)).blocks))
    begun = time.perf_counter()
    peak_mb = _night(file, output)
    total_s = time.perf_counter() - begun
    said = json.loads((output / "latest" / "night.json").read_text())
    planned = sum(row["status"] == "planned" for row in rows(output))
    yield Figure(f"{name}: cases planned", f"{count}", f"{planned}", planned == count)
    planning_s = said["seconds_by_stage"]["plan"]
    plain_s = _plain(file, output)
    reached = plain_s / planning_s
    yield Figure(
        f"{name}: {count} plans, rate beside two plain processes",
        f">= {share:g}",
        f"{reached:.2f} ({planning_s:.0f} s, plain {plain_s:.0f} s; all {total_s:.0f} s)",
        reached >= share,
    )
    overhead = 1 - said["planning_seconds"] / (2 * planning_s)
    yield at_most(f"{name}: share of two workers' time that is not planning", overhead, 0.1)
    yield at_most(f"{name}: main process", peak_mb, 500, " MB", 0)
    begun = time.perf_counter()
    _night(file, output)
    yield at_most(f"{name}: rerun of a finished cycle", time.perf_counter() - begun, 3, " s", 1)


def _night(file: Path, output: Path) -> float:
    """Run a night; return the largest memory of its main process, MB."""
    command = (sys.executable, "-m", "pipeline.cli.main", "nightly", "run", "--config", str(file))
    child = subprocess.Popen(
        [*command, "--output", str(output)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    peak_kb = 0
    while child.poll() is None:
        try:
            status = Path(f"/proc/{child.pid}/status").read_text(encoding="utf-8")
            peak_kb = max(peak_kb, int(status.partition("VmHWM:")[2].split()[0]))
        except (OSError, IndexError):
            continue
        time.sleep(0.2)
    if child.returncode not in {0, 10}:
        raise RuntimeError(f"the night ended with {child.returncode}")
    return peak_kb / 1000


def _plain(file: Path, output: Path) -> float:
    """Plan all cases in two plain processes; return the time of the slower, s."""
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", _PLAIN, str(file), str(output), str(half)],
            stdout=subprocess.PIPE,
            text=True,
        )
        for half in (0, 1)
    ]
    return max(float(process.communicate()[0].split()[-1]) for process in processes)
