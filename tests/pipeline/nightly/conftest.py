"""What nights of tests share: a scheduler and a worker, and a service that watches jobs."""

from __future__ import annotations

import contextlib
import json
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.pipeline.nightly.ping_service import Service
from tests.pipeline.processes import started, wait_until


@contextlib.contextmanager
def dask_cluster(folder: Path, workers: int = 1) -> Iterator[str]:
    """Start a scheduler and workers, each a process of its own; give the address."""
    file = folder / "scheduler.json"
    dask = (sys.executable, "-m", "dask")
    command = (*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    silent = {"DASK_LOGGING__DISTRIBUTED": "critical"}  # nobody reads their pipes, which may fill
    with contextlib.ExitStack() as held:
        held.enter_context(started(*command, "--scheduler-file", str(file), variables=silent))
        wait_until(lambda: file.exists() and file.read_text(), 120)
        for _ in range(workers):
            worker = (*dask, "worker", "--scheduler-file", str(file), "--nworkers", "1")
            preload = ("--preload", "tests.pipeline.kept_land_mask")
            held.enter_context(
                started(
                    *(
                        *worker,
                        *preload,
                        "--nthreads",
                        "1",
                        "--memory-limit",
                        "2GiB",
                        "--no-dashboard",
                    ),
                    variables=silent,
                )
            )
        yield str(json.loads(file.read_text())["address"])


@pytest.fixture(scope="session")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Give the address of a scheduler with one worker: starting them takes longer than a night."""
    with dask_cluster(tmp_path_factory.mktemp("cluster")) as address:
        yield address


@pytest.fixture
def service() -> Iterator[Service]:
    """Serve until the test ends."""
    with Service() as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.ended.set()
        server.shutdown()
        thread.join()
