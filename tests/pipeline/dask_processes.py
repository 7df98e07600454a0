"""A Dask scheduler and its workers, each a process of its own."""

import contextlib
import json
import secrets
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.pipeline.processes import started, wait_until

_DASK = (sys.executable, "-m", "dask")
_SILENT = {"DASK_LOGGING__DISTRIBUTED": "critical"}  # nobody reads their pipes, which may fill


@contextlib.contextmanager
def scheduler(folder: Path, port: int = 0) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Start a scheduler, at any free port if it is 0; give its process and its address."""
    file = folder / f"scheduler-{secrets.token_hex(4)}.json"
    command = (*_DASK, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    with started(*command, "--scheduler-file", str(file), variables=_SILENT) as process:
        wait_until(lambda: process.poll() is not None or (file.exists() and file.read_text()), 120)
        yield process, str(json.loads(file.read_text())["address"])


@contextlib.contextmanager
def worker(address: str, *options: str) -> Iterator[subprocess.Popen[str]]:
    """Start a worker of a scheduler."""
    command = (*_DASK, "worker", address, "--nworkers", "1", "--nthreads", "1", "--no-dashboard")
    with started(*command, *options, variables=_SILENT) as process:
        yield process


@contextlib.contextmanager
def cluster(
    folder: Path, workers: int = 1, port: int = 0
) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Start a scheduler and workers that can plan; give the scheduler's process and its address."""
    options = ("--preload", "tests.pipeline.kept", "--memory-limit", "2GiB")
    with scheduler(folder, port) as (process, address), contextlib.ExitStack() as held:
        for _ in range(workers):
            held.enter_context(worker(address, *options))
        yield process, address
