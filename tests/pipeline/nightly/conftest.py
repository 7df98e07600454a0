"""What nights of tests share: a scheduler and a worker, and a service that watches jobs."""

import threading
from collections.abc import Iterator

import pytest

from tests.pipeline import dask_processes
from tests.pipeline.nightly.ping_service import Service


@pytest.fixture(scope="session")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Give the address of a scheduler with one worker: starting them takes longer than a night."""
    with dask_processes.cluster(tmp_path_factory.mktemp("cluster")) as (_, address):
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
