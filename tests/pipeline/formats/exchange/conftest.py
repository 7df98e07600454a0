from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.pipeline.formats import small_run
from tests.pipeline.formats.exchange import runs

if TYPE_CHECKING:
    from pipeline.formats.shared.result import RunResult

NAMES = ("small", "180 degrees", "north", "long", "harbours", "random 0", "random 1", "random 2")


@pytest.fixture(scope="session", params=NAMES)
def any_run(request: pytest.FixtureRequest) -> RunResult:
    """Give each of the runs in turn."""
    name: str = request.param
    made = {
        "small": small_run.parts,
        "180 degrees": runs.across_180,
        "north": runs.far_north,
        "long": runs.long_way,
        "harbours": runs.harbours,
    }
    if name.startswith("random"):
        return runs.random_run(int(name.split()[1]))
    return made[name]()
