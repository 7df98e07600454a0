from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from pipeline.formats.gis.geopackage import write_geopackage
from pipeline.formats.report.page import gather, render
from tests.pipeline.formats import small_run
from tests.pipeline.formats.page import Page

if TYPE_CHECKING:
    from pathlib import Path

    from pipeline.formats.shared.result import RunResult


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
