"""Files of land are checked against the world's: a file with one wreck is no chart of an island.

Ascension lies alone in the Atlantic, 13 km wide.
"""

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RunResult
from pipeline.scenario.loading import parse_scenario
from pipeline.sources.land.osm import land_polygons
from tests.pipeline.results import result_of

REGION = (-14.62, -8.12, -14.12, -7.76)
WEST, EAST = (-14.55, -7.95), (-14.20, -7.95)
WRECK = shapely.box(-14.60, -8.10, -14.59, -8.09)


def scenario_data(source: object, **asked: object) -> dict[str, Any]:
    """A voyage from one side of the island to the other."""
    return {
        "schema_version": 1,
        "name": "ascension",
        "start": list(WEST),
        "goal": list(EAST),
        "vessel": {"length_m": 7.0, "speed_m_s": 5.0, "turn_rate_deg_s": 11.8},
        "region": {"bbox": list(REGION)},
        "chart": {"source": source},
        "planner": {"classes": 2, "clearance": 0.0},
        "seasons": [{"name": "still", "currents": ["still"]}],
        **asked,
    }


def planned(folder: Path, source: object) -> RunResult:
    """Plan the voyage with some sources of land."""
    return result_of(parse_scenario(scenario_data(source), folder), folder / "outputs")


def file(folder: Path, *land: shapely.Geometry) -> str:
    """Write land to a file, and return its name."""
    path = folder / "land.geojson"
    path.write_text(shapely.to_geojson(shapely.GeometryCollection(land)))
    return f"./{path.name}"


def test_a_route_over_land_that_a_file_lacks_is_refused_and_both_remedies_work(
    tmp_path: Path,
) -> None:
    wreck = file(tmp_path, WRECK)
    with pytest.raises(RequestError) as refused:
        planned(tmp_path, wreck)
    (fault,) = str(refused.value).splitlines()
    island = shapely.union_all(land_polygons(shapely.box(*REGION)).polygons)
    over = shapely.intersection(shapely.LineString([WEST, EAST]), island).length
    length_km = float(re.search(r"crosses ([0-9.]+) km", fault)[1])  # type: ignore[index]
    assert length_km == pytest.approx(over * 110.6 * np.cos(np.radians(7.95)), rel=0.05)
    added, right = (
        re.sub("…", wreck, one)
        for one in re.findall(r"source = (\[.*?\]|\{ path = \"…\", complete = true \})", fault)
    )
    beside = planned(tmp_path, tomllib.loads(f"source = {added}")["source"])
    route = shapely.LineString(beside.water.projection.to_lonlat(beside.routes[0].route.path))
    assert not route.intersects(island)
    over_land = planned(tmp_path, tomllib.loads(f"source = {right}")["source"])
    (said,) = [one for one in note_texts(over_land.unknowns) if "OpenStreetMap" in one]
    assert "OpenStreetMap has land where routes cross water of this chart" in said


@pytest.mark.gate_share(1)
@pytest.mark.parametrize(("coarser_deg", "off_deg"), [(0.0, 4e-4), (0.001, 0.0)])
def test_a_chart_of_about_the_same_coast_is_planned_on(
    tmp_path: Path, coarser_deg: float, off_deg: float
) -> None:
    # Off by 45 m, and simplified by 110 m, of which 50 m and 150 m are given.
    island = shapely.union_all(land_polygons(shapely.box(*REGION)).polygons)
    coast = shapely.affinity.translate(island.simplify(coarser_deg), off_deg, 0.0)
    source = {"path": file(tmp_path, coast), "accuracy_m": 150.0 if coarser_deg else 50.0}
    assert planned(tmp_path, source).routes
