"""A night in the three ways of docs/how-to/nightly.md.

`python -m tests.bench.three_ways 1000` runs it.

One machine; a scheduler and workers by the commands of kubernetes.yaml, as plain processes; the
Slurm job by its own script, where `srun` runs what it is given twice. RENEW_KERNELS is the folder
that `renew warm` has filled for it; else its workers compile. It prints a row for each.
"""

from __future__ import annotations

import json
import os
import re
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from tests.bench.nightly_figures import gyre_night
from tests.pipeline.nightly.killed_nights import night
from tests.pipeline.nightly.nights import rows
from tests.pipeline.processes import ROOT, started, wait_until

_OPERATION = ROOT / "catalog" / "operation"
_WORKERS = 2
_LONG_S = 7200.0


def one_machine(file: Path, output: Path) -> str:
    """Plan by processes of this machine."""
    _run(*night(file, output))
    return "`renew nightly run`"


def cluster(file: Path, output: Path) -> str:
    """Plan on a scheduler and two workers, each a process, by the commands of kubernetes.yaml."""
    text = (_OPERATION / "kubernetes.yaml").read_text("utf-8")
    scheduler, worker = re.findall(r"command: \[dask, (.+)\]", text)
    scheduler_file = file.with_name("scheduler.json")
    with ExitStack() as held:
        options = scheduler.replace('"8786"', "0").replace('"', "").split(", ")
        dask = (sys.executable, "-m", "dask")
        options += ["--host", "127.0.0.1", "--scheduler-file", str(scheduler_file)]
        held.enter_context(started(*dask, *options))
        wait_until(lambda: scheduler_file.exists() and scheduler_file.read_text())
        address = str(json.loads(scheduler_file.read_text())["address"])
        options = worker.replace('"', "").replace("tcp://renew-scheduler:8786", address).split(", ")
        options += ["--host", "127.0.0.1"]
        workers = [held.enter_context(started(*dask, *options)) for _ in range(2)]
        _run(*night(file, output, "--scheduler", address))
        for worker in workers:  # in good order: else their processor time is nobody's
            worker.terminate()
            worker.wait(60)
    return "`renew nightly run --scheduler`, 2 workers"


def slurm_job(file: Path, output: Path) -> str:
    """Plan by the script of the Slurm job."""
    programs = file.with_name("programs")
    programs.mkdir()
    for name, command in (
        # As `srun`, it ends its tasks when it is told to end.
        ("srun", "trap 'kill $(jobs -p)' TERM\n" + '"$@" &\n' * _WORKERS + "wait"),
        ("dask", f'exec {sys.executable} -m dask "$@"'),
        ("renew", f'exec {sys.executable} -m pipeline.cli.main "$@"'),
    ):
        (programs / name).write_text(f"#!/bin/sh\n{command}\n")
        (programs / name).chmod(0o755)
    variables = {
        "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "SLURM_JOB_ID": "1",
        "RENEW_KERNELS": os.environ.get("RENEW_KERNELS", str(file.parent / "kernels")),
    }
    script = ("/bin/bash", str(_OPERATION / "nightly.slurm"), str(file), str(output))
    with started(*script, variables=variables) as process:
        _, errors = process.communicate(timeout=_LONG_S)
    if process.returncode:
        raise RuntimeError(f"the job ended with {process.returncode}: {errors[-1000:]}")
    return f"`nightly.slurm`, {_WORKERS} workers"


WAYS: dict[str, Callable[[Path, Path], str]] = {
    "one machine": one_machine,
    "cluster": cluster,
    "Slurm job": slurm_job,
}


def _run(*command: str) -> None:
    """Run a night to its end."""
    with started(*command) as process:
        _, errors = process.communicate(timeout=_LONG_S)
    if process.returncode not in {0, 10}:
        raise RuntimeError(f"the night ended with {process.returncode}: {errors[-1000:]}")


def _cpu_s() -> float:
    """Processor time of all processes that have ended below this one, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _tried(way: str, count: int) -> str:
    """Try a way; return its row."""
    with tempfile.TemporaryDirectory() as folder:
        file, output = gyre_night(Path(folder), count, workers=_WORKERS)
        begun, processor = time.perf_counter(), _cpu_s()
        command = WAYS[way](file, output)
        wall_s, used_s = time.perf_counter() - begun, _cpu_s() - processor
        planned = sum(row["status"] == "planned" for row in rows(output))
    return f"| {way} | {command} | {planned:,} | {wall_s:,.0f} s | {used_s:,.0f} s |"


if __name__ == "__main__":
    for name in sys.argv[2:] or WAYS:
        print(_tried(name, int(sys.argv[1])), flush=True)
