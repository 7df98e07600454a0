from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.pipeline.serve.client import Server, serving


@pytest.fixture(scope="package")
def server(tmp_path_factory: pytest.TempPathFactory, rehearsed: None) -> Iterator[Server]:
    """A server with one worker, for all tests that leave it as it is."""
    del rehearsed
    with serving(tmp_path_factory.mktemp("serve") / "outputs", "--workers", "1") as server:
        yield server
