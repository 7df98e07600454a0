"""Choosing an adapter by a source's name, or by what lies at its path."""

from __future__ import annotations

from pathlib import Path

import pytest
import shapely

from pipeline.errors import RequestError
from pipeline.scenario.region import ChartSpec
from pipeline.sources.registry import current_source, land_source
from tests.pipeline.sources.land.test_vector import write


@pytest.mark.parametrize("name", ["s57", "natural-earth"])
def test_a_kind_of_chart_needs_its_files(name: str) -> None:
    with pytest.raises(RequestError, match=r"--charts PATH"):
        land_source(ChartSpec.model_validate({"source": name}), 1.0)


def test_a_name_that_does_not_match_its_path_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path / "land.gpkg", shapely.box(118.45, 10.25, 118.46, 10.26))
    for name, path, found in (
        ("s57", file, "a vector file, not 's57'"),
        ("natural-earth", tmp_path, "S-57 cells, not 'natural-earth'"),
    ):
        spec = ChartSpec.model_validate({"source": {"name": name, "path": str(path)}})
        with pytest.raises(RequestError, match=f"is {found}; leave the name out"):
            land_source(spec, 1.0)


def test_a_source_of_land_gives_no_currents() -> None:
    with pytest.raises(RequestError, match="'osm-land' gives land, not currents"):
        current_source("osm-land")
