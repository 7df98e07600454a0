from pathlib import Path

import pyogrio
import pytest
from pyogrio._ogr import _register_drivers

from pipeline.findings.result import RunResult
from pipeline.formats.gis.geopackage import write_geopackage
from pipeline.formats.records import write_currents
from pipeline.formats.report.page import gather, render
from tests.pipeline import chosen_speeds
from tests.pipeline.formats import runs, small_run
from tests.pipeline.formats.page import Page

NAMES = (
    *("small", "180 degrees", "north", "long", "harbours", "speeds", "random 0"),
    *(pytest.param(name, marks=pytest.mark.slow) for name in ("random 1", "random 2")),
)


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
        "speeds": chosen_speeds.planned,
    }
    if name.startswith("random"):
        return runs.random_run(int(name.split()[1]))
    return made[name]()


@pytest.fixture(scope="session")
def result() -> RunResult:
    return small_run.parts()


@pytest.fixture(scope="session")
def planar_result() -> RunResult:
    return small_run.parts(planar=True)


@pytest.fixture(scope="session")
def package(result: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("geopackage") / "routes.gpkg"
    write_geopackage(result, path)
    return path


@pytest.fixture(scope="session")
def page(result: RunResult) -> Page:
    return Page(render(gather(result)))


@pytest.fixture(scope="module")
def currents(result: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("currents") / "currents.nc"
    write_currents(result.case("summer"), path)
    return path


@pytest.fixture
def every_driver() -> None:
    """Give GDAL back all drivers: charts that a test before has read leave it only some."""
    pyogrio.set_gdal_config_options({"GDAL_SKIP": None})
    _register_drivers()
