"""Fixtures of the pipeline's tests: land that takes seconds to fetch is fetched once."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from pipeline.machine.store import Store
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.model import Scenario
from pipeline.stages.fetch import fetch
from tests.conftest import once
from tests.pipeline.kept import keep
from tests.pipeline.results import plain_pages
from tests.pipeline.voyage import sailing

# A region across the middle of Palawan: the island divides it from edge to edge.
ACROSS_BOX = [118.3, 9.3, 119.2, 10.4]


@pytest.fixture(scope="session", autouse=True)
def _kept() -> None:
    keep()


@pytest.fixture(scope="session")
def across_outputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an output folder whose store holds the land in ACROSS_BOX."""
    output = tmp_path_factory.mktemp("across") / "outputs"
    table = load_scenario("palawan-season").model_dump(mode="json")
    table["region"]["bbox"] = ACROSS_BOX
    fetch(Scenario.model_validate(table), Store(output / ".artefacts"), offline=True)
    return output


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of results of a voyage in a tide, planned once for all processes."""
    return sailing.results_in(once(tmp_path_factory, "sailing", sailing.make))


@pytest.fixture
def plain_report() -> Iterator[None]:
    """Write no figures in tests that do not look at them."""
    with plain_pages():
        yield
