"""Figures of the nightly job: beside plain processes, its memory, its reruns.

The full figures take hours: RENEW_NIGHT_PLANS (60 by default) and RENEW_NIGHT_SMALL_PLANS (400)
say how many plans are made in Palawan and on the single gyre; 0 leaves a night out.
"""

import contextlib
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.nightly.cases import expand
from pipeline.nightly.config import load_config
from tests.bench.figure import Figure, at_most
from tests.conftest import ROOT
from tests.pipeline.nightly.nights import rows, write_night
from tests.pipeline.processes import descendants, started

_PLANS = int(os.environ.get("RENEW_NIGHT_PLANS", "60"))
_SMALL_PLANS = int(os.environ.get("RENEW_NIGHT_SMALL_PLANS", "400"))
_PALAWAN_PAIRS = min(20, _PLANS)
# One of two plain processes: every second case, planned and evaluated one after the other.
_PLAIN = """
import sys, time
from pathlib import Path
from pipeline.nightly.config import load_config
from pipeline.nightly.cases import all_cases, expand
from pipeline.nightly.currents import newest_currents
from pipeline.nightly.cycles import Partial
from pipeline.nightly.planning import Planning
from pipeline.machine.store import Store
from datetime import UTC, datetime
config = load_config(Path(sys.argv[1]), Path(sys.argv[2]))
blocks = expand(config)
cases = list(all_cases(blocks))
now = datetime.now(UTC)
planning = Planning(cases, newest_currents(blocks, now), Store(config.output / ".artefacts"),
    Partial(config.output, now, {}), {}, 3.0, "", config.output, print, print)
half = int(sys.argv[3])
batches = [planning._batch([one]) for one in cases if one.index * 2 // len(cases) == half]
batches[0].make()
begun, processor = time.perf_counter(), time.process_time()
for batch in batches:
    batch.make()
print(time.perf_counter() - begun, time.process_time() - processor)
"""


def figures() -> Iterator[Figure]:
    """Yield the figures, one by one as they are measured."""
    if _PLANS:
        with tempfile.TemporaryDirectory() as folder:
            yield from _beside_plain("nightly, Palawan", *palawan_night(Path(folder)), 0.9)
    if _SMALL_PLANS:
        with tempfile.TemporaryDirectory() as folder:
            night = gyre_night(Path(folder), _SMALL_PLANS)
            yield from _beside_plain("nightly, single gyre", *night, 0.8)


def gyre_night(folder: Path, plans: int) -> tuple[Path, Path]:
    """Write a night of pairs across the paper's single gyre; return its file and its output."""
    ends = np.random.default_rng(1).uniform((5, 5, 85, 85), (15, 15, 95, 95), (plans, 4))
    pairs = [",".join(f"{x:.4f}" for x in row) + f",p{i:05}" for i, row in enumerate(ends)]
    (folder / "pairs.csv").write_text(
        "start_x,start_y,goal_x,goal_y,name\n" + "\n".join(pairs) + "\n"
    )
    cases = 'scenario = "single-gyre"\npairs = "pairs.csv"\n'
    return write_night(folder, cases, workers=2, memory_gb=1.0), folder / "out"


def palawan_night(folder: Path) -> tuple[Path, Path]:
    """Write a night of pairs across Palawan on the embedded currents; return file and output."""
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
    file = write_night(folder, cases, workers=2, memory_gb=1.0, stale_hours=1e6)
    return file, folder / "out"


class _Measured(NamedTuple):
    """What it took, s: all of a night, its planning, and the same in plain processes."""

    night_s: float
    night_cpu_s: float
    plan_s: float
    planning_s: float
    plain_s: float
    plain_cpu_s: float


class _Peaks(NamedTuple):
    """Largest memory of a night's main process, and of its largest worker, MB."""

    main_mb: float
    worker_mb: float


def _beside_plain(name: str, file: Path, output: Path, share: float) -> Iterator[Figure]:
    """Measure a night, and the same plans in two plain processes."""
    count = sum(block.size for block in expand(load_config(file, output)))
    took, peaks = _round(file, output)
    planned = sum(row["status"] == "planned" for row in rows(output))
    yield Figure(f"{name}: cases planned", f"{count}", f"{planned}", planned == count)
    reached = took.plain_s / took.plan_s
    yield Figure(
        f"{name}: {count} plans, rate beside two plain processes",
        f">= {share:g}",
        f"{reached:.2f} ({took.plan_s:.0f} s, plain {took.plain_s:.0f} s; "
        f"all of the night {took.night_s:.0f} s)",
        reached >= share,
    )
    cpu = took.plain_cpu_s / took.night_cpu_s
    yield Figure(
        f"{name}: the same by processor time, all that a night does counted",
        f">= {share:g}",
        f"{cpu:.2f} ({took.night_cpu_s:.0f} s, plain {took.plain_cpu_s:.0f} s)",
        cpu >= share,
    )
    overhead = 1 - took.planning_s / (2 * took.plan_s)
    yield at_most(f"{name}: share of two workers' time that is not planning", overhead, 0.1)
    yield at_most(f"{name}: main process", peaks.main_mb, 500, " MB", 0)
    yield at_most(f"{name}: a worker", peaks.worker_mb, 1000, " MB", 0)
    begun = time.perf_counter()
    _night(file, output)
    yield at_most(f"{name}: rerun of a finished cycle", time.perf_counter() - begun, 3, " s", 1)


def _round(file: Path, output: Path) -> tuple[_Measured, _Peaks]:
    """Plan all cases in a night, then in two plain processes."""
    begun, processor = time.perf_counter(), _children_cpu_s()
    peaks = _night(file, output)
    night_s, night_cpu_s = time.perf_counter() - begun, _children_cpu_s() - processor
    said = json.loads((output / "latest" / "night.json").read_text())
    times = night_s, night_cpu_s, said["seconds_by_stage"]["plan"], said["planning_seconds"]
    return _Measured(*times, *_plain(file, output)), peaks


def _children_cpu_s() -> float:
    """Processor time of all processes that have ended below this one, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _night(file: Path, output: Path) -> _Peaks:
    """Run a night; return the largest memory of its processes."""
    command = (sys.executable, "-m", "pipeline.cli.main", "nightly", "run", "--config", str(file))
    child = subprocess.Popen(
        [*command, "--output", str(output)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    peaks: dict[int, float] = {}
    while child.poll() is None:
        for pid in (child.pid, *descendants(child.pid)):
            with contextlib.suppress(OSError, IndexError):  # it ends just now
                status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
                peaks[pid] = int(status.partition("VmHWM:")[2].split()[0]) / 1000
        time.sleep(0.2)
    if child.returncode not in {0, 10}:
        raise RuntimeError(f"the night ended with {child.returncode}")
    return _Peaks(peaks.pop(child.pid, 0.0), max(peaks.values(), default=0.0))


def _plain(file: Path, output: Path) -> tuple[float, float]:
    """Plan all cases in two plain processes; return the slower's time, and both's on the cores."""
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", _PLAIN, str(file), str(output), str(half)],
            stdout=subprocess.PIPE,
            text=True,
        )
        for half in (0, 1)
    ]
    said = [process.communicate()[0].split()[-2:] for process in processes]
    return max(float(wall) for wall, _ in said), sum(float(cpu) for _, cpu in said)


_JOB = ROOT / "catalog" / "operation" / "nightly.slurm"


def slurm_job() -> Iterator[Figure]:
    """Yield the time of a night that the script of the Slurm job plans, with two workers.

    Here `srun` runs what it is given twice on this machine. RENEW_KERNELS is the folder that
    `renew warm` has filled for the job; else its workers compile.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file, output = gyre_night(folder, _PLANS)
        programs = folder / "programs"
        programs.mkdir()
        for program, command in (
            # As `srun`, it ends its tasks when it is told to end.
            ("srun", "trap 'kill $(jobs -p)' TERM\n" + '"$@" &\n' * 2 + "wait"),
            ("dask", f'exec {sys.executable} -m dask "$@"'),
            ("renew", f'exec {sys.executable} -m pipeline.cli.main "$@"'),
        ):
            (programs / program).write_text(f"#!/bin/sh\n{command}\n")
            (programs / program).chmod(0o755)
        variables = {
            "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
            "SLURM_JOB_ID": "1",
            "RENEW_KERNELS": os.environ.get("RENEW_KERNELS", str(folder / "kernels")),
        }
        begun, processor = time.perf_counter(), _children_cpu_s()
        script = ("/bin/bash", str(_JOB), str(file), str(output))
        with started(*script, variables=variables) as process:
            _, errors = process.communicate(timeout=7200.0)
        if process.returncode:
            raise RuntimeError(f"the job ended with {process.returncode}: {errors[-1000:]}")
        wall_s, cpu_s = time.perf_counter() - begun, _children_cpu_s() - processor
        planned = sum(row["status"] == "planned" for row in rows(output))
    text = f"{planned:,} in {wall_s:,.0f} s, on the cores {cpu_s:,.0f} s"
    yield Figure("Slurm job, cases planned by two workers", f"{_PLANS}", text, planned == _PLANS)
