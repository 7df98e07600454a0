"""A night in the three ways of docs/how-to/nightly.md.

`python -m tests.bench.three_ways 1000` runs it.

One machine; a scheduler and workers by the commands of kubernetes.yaml, as plain processes; the job
array by its own script, where `srun` runs what it is given, two parts at a time. RENEW_KERNELS is
the folder that `renew warm` has filled for it; else its parts compile. It prints the rows of the
page's table.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
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
_PARTS, _AT_ONCE = 4, 2
_LONG_S = 7200.0


def one_machine(file: Path, output: Path) -> str:
    """Plan on a local cluster."""
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


def job_array(file: Path, output: Path) -> str:
    """Plan in parts by the script of the job array."""
    programs = file.with_name("programs")
    programs.mkdir()
    (programs / "srun").write_text('#!/bin/sh\nshift\nexec "$@"\n')
    (programs / "renew").write_text(f'#!/bin/sh\nexec {sys.executable} -m pipeline.cli.main "$@"\n')
    for program in programs.iterdir():
        program.chmod(0o755)
    script = (str(_OPERATION / "nightly.slurm"), str(file), str(output))
    waiting, working = list(range(1, _PARTS + 1)), list[subprocess.Popen[bytes]]()
    while waiting or working:
        while waiting and len(working) < _AT_ONCE:
            variables = {
                "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
                "PYTHONPATH": str(ROOT),
                "SLURM_ARRAY_TASK_ID": str(waiting.pop(0)),
                "SLURM_ARRAY_TASK_COUNT": str(_PARTS),
                "RENEW_KERNELS": os.environ.get("RENEW_KERNELS", str(file.parent / "kernels")),
            }
            working.append(subprocess.Popen(["/bin/bash", *script], env=os.environ | variables))
        if (code := working.pop(0).wait()) != 0:
            raise RuntimeError(f"a part ended with {code}")
    return f"`nightly.slurm`, {_PARTS} parts, {_AT_ONCE} at a time"


WAYS: dict[str, Callable[[Path, Path], str]] = {
    "one machine": one_machine,
    "cluster": cluster,
    "job array": job_array,
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
        file, output = gyre_night(Path(folder), count, workers=1 if way == "job array" else 2)
        begun, processor = time.perf_counter(), _cpu_s()
        command = WAYS[way](file, output)
        wall_s, used_s = time.perf_counter() - begun, _cpu_s() - processor
        planned = sum(row["status"] == "planned" for row in rows(output))
    return f"| {way} | {command} | {planned:,} | {wall_s:,.0f} s | {used_s:,.0f} s |"


if __name__ == "__main__":
    for name in sys.argv[2:] or WAYS:
        print(_tried(name, int(sys.argv[1])), flush=True)
