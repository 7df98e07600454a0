"""Several charts as one, from a scenario or the command line."""

from __future__ import annotations

from pathlib import Path

import pytest
import shapely
from pydantic import ValidationError

from pipeline.errors import RequestError
from pipeline.model import Credit, Land, Note, Zone
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.region import ChartSource, ChartSpec
from pipeline.sources.combined_charts import Overlay, overlay
from pipeline.sources.land.osm import OsmLand
from pipeline.sources.registry import land_source
from tests.pipeline.conftest import ACROSS_BOX
from tests.pipeline.small_region import small_region
from tests.pipeline.sources.land.test_vector import write

SCENARIO = (
    small_region("mine")
    + """[chart]
source = {source}
[[seasons]]
name = "summer"
valid = "2024-07"
currents = ["embedded-palawan"]
"""
)
ROCK = shapely.box(118.45, 10.25, 118.46, 10.26)


def chart(
    *polygons: shapely.Polygon,
    name: str = "one",
    accuracy_m: float = 10.0,
    uncharted: shapely.Polygon | None = None,
) -> Land:
    """Make the land of one source."""
    zones = () if uncharted is None else (Zone("uncharted", "", "", uncharted),)
    credit = Credit(name, "land", name, "")
    return Land(polygons, (credit,), accuracy_m, (Note.of("gdal-warning", source=name),), zones)


def fault(folder: Path, source: str) -> str:
    """Return the fault of a scenario with a chart.source."""
    path = folder / "mine.toml"
    path.write_text(SCENARIO.format(source=source), encoding="utf-8")
    with pytest.raises(RequestError) as caught:
        load_scenario(str(path))
    (line,) = caught.value.faults
    return line


def test_areas_and_credits_add_up_and_the_worst_accuracy_counts() -> None:
    one, two = shapely.box(0, 0, 2, 2), shapely.box(1, 1, 3, 3)
    both = overlay([chart(one), chart(two, name="two", accuracy_m=60.0)])
    assert shapely.union_all(both.polygons).equals(shapely.union(one, two))
    assert [credit.name for credit in both.credits] == ["one", "two"]
    assert both.accuracy_m == 60.0
    assert both.notes == tuple(Note.of("gdal-warning", source=name) for name in ("one", "two"))
    assert both.zones == ()


def test_only_what_no_chart_covers_is_no_go() -> None:
    west, middle = shapely.box(0, 0, 2, 1), shapely.box(1, 0, 2, 1)
    alone = overlay([chart(uncharted=west)])
    assert shapely.union_all(alone.polygons).equals(west)
    two = overlay([chart(uncharted=west), chart(name="two", uncharted=shapely.box(1, 0, 3, 1))])
    assert shapely.union_all(two.polygons).equals(middle)
    assert [zone.kind for zone in two.zones] == ["uncharted"]
    assert overlay([chart(uncharted=west), chart(name="two")]).polygons == ()


def test_a_file_on_top_of_openstreetmap(tmp_path: Path) -> None:
    file = write(tmp_path / "rocks.geojson", ROCK)
    path = tmp_path / "mine.toml"
    path.write_text(SCENARIO.format(source='["osm-land", "./rocks.geojson"]'), encoding="utf-8")
    scenario = load_scenario(str(path))
    assert [one.name or one.path for one in scenario.chart.source] == ["osm-land", str(file)]
    both = land_source(scenario.chart, None)
    assert isinstance(both, Overlay)
    osm, rocks = both.sources
    assert isinstance(osm, OsmLand)
    (rock,) = rocks.land(shapely.box(*ACROSS_BOX)).polygons
    assert rock.equals(ROCK)
    assert set(osm.identity) | set(rocks.identity) <= set(both.identity)


def test_the_command_lines_chart_replaces_the_scenarios(tmp_path: Path) -> None:
    file = write(tmp_path / "rocks.geojson", ROCK)
    scenario = load_scenario("palawan-season", charts=file)
    assert [one.path for one in scenario.chart.source] == [str(file)]
    with pytest.raises(RequestError, match=r"none\.gpkg' does not exist"):
        load_scenario("palawan-season", charts=tmp_path / "none.gpkg")


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("osm-land", ChartSource(name="osm-land")),
        ("./land", ChartSource(path="./land")),
        ("land.gpkg", ChartSource(path="land.gpkg")),
        ("~/charts", ChartSource(path="~/charts")),
        ({"path": "land.gpkg", "layer": "coast"}, ChartSource(path="land.gpkg", layer="coast")),
    ],
)
def test_one_source_is_a_list_of_one(given: object, expected: ChartSource) -> None:
    assert ChartSpec.model_validate({"source": given}).source == (expected,)
    again = ChartSpec.model_validate({"source": [given]})
    assert ChartSpec.model_validate(again.model_dump(mode="json")) == again


@pytest.mark.parametrize("given", [[], {}, [{"layer": "coast"}], [3], ""])
def test_an_empty_source_is_refused(given: object) -> None:
    with pytest.raises(ValidationError):
        ChartSpec.model_validate({"source": given})


@pytest.mark.parametrize(
    ("source", "parts"),
    [
        ('"osm-lnad"', ["chart.source", "did you mean 'osm-land'", "./charts"]),
        ('["osm-land", "osm-lnad"]', ["chart.source[1]", "did you mean 'osm-land'"]),
        ('"embedded-palawan"', ["gives currents, not land"]),
        ('"./none.gpkg"', ["none.gpkg", "does not exist", "S-57 cells"]),
        ('{ path = "land.gpkg", layr = "x" }', ["unknown key", "layr", "did you mean 'layer'"]),
        ('{ layer = "coast" }', ["neither 'name' nor 'path'", "give one of the two"]),
        ('{ path = "land.gpkg", radius_m = -1 }', ["radius_m = -1", "is not above 0"]),
    ],
)
def test_faults_name_the_source_and_the_remedy(
    tmp_path: Path, source: str, parts: list[str]
) -> None:
    line = fault(tmp_path, source)
    for part in parts:
        assert part in line
