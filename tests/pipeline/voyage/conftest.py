"""The chart of the voyages in one line."""

from pathlib import Path

import pytest
import shapely

from tests.pipeline.voyage.waters import ISLAND


@pytest.fixture(scope="module")
def chart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("chart") / "island.geojson"
    file.write_text(shapely.to_geojson(ISLAND))
    return file
