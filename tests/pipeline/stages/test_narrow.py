"""Voyages from quay to quay: stretches without room to turn are told in every output.

The slow test sails eleven reference routes of the Norwegian Coastal Administration and flies the
turns itself, as circles on the original land.
"""

import json
import math
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely

from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RunResult
from pipeline.run import Outcome
from pipeline.voyage.one_line import go
from tests.renew.planner.test_narrow_water import hits

# A basin of 600 m by 900 m in the Atlantic, whose mouth is 110 m wide: a ship's circle is 300 m.
BASIN = shapely.box(-40.010, 34.996, -40.000, 35.002)
MOUTH = shapely.box(-40.013, 34.9985, -40.009, 34.9995)
LAND = shapely.box(-40.012, 34.990, -39.990, 35.010).difference(shapely.union(BASIN, MOUTH))
SHIP: dict[str, Any] = {"speed": "10kn", "length": "80m", "turning_circle": "300m"}
REFERENCE = Path(__file__).parents[3].parent / "shared" / "data" / "field" / "reference_routes.json"
VESSELS: dict[str, dict[str, Any]] = {
    "ship": {"speed": "12kn", "length": "150m", "turning_circle": "500m"},
    "boat": {"speed": "8kn", "length": "20m", "turning_circle": "80m"},
}


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    folder = tmp_path_factory.mktemp("harbour")
    chart = folder / "land.geojson"
    chart.write_text(shapely.to_geojson(LAND), encoding="utf-8")
    return go(
        (-40.08, 35.0),
        (-40.005, 34.999),
        charts=[f"{chart},accuracy=5m"],
        currents=["still"],
        name="harbour",
        output=folder / "outputs",
        offline=True,
        **SHIP,
    )


@pytest.fixture
def result(outcome: Outcome) -> RunResult:
    return outcome.result


def test_the_stretch_is_measured_in_true_metres(result: RunResult) -> None:
    (case,) = result.cases
    (stretch,) = case.narrow(1)
    assert stretch.width_m == pytest.approx(110, abs=15)
    assert stretch.needed_m == pytest.approx(300, rel=0.01)
    assert stretch.kept_m < 110
    assert stretch.side == "either side"


def test_every_output_tells_it(outcome: Outcome) -> None:
    (note,) = outcome.result.narrow_notes
    (words,) = note_texts([note])
    assert words.startswith("no room to turn hard over on route 1 for ")
    folder = outcome.directory
    assert words[0].upper() + words[1:] in (folder / "report.html").read_text("utf-8")
    for file in ("harbour-still.gpx", "harbour-still.rtz"):
        assert "no room to turn hard over" in (folder / file).read_text("utf-8").lower()
    layer = geopandas.read_file(folder / "routes.gpkg", layer="narrow_stretches")
    assert layer["kept_m"].tolist()[0] == pytest.approx(dict(note.values)["kept_m"])
    assert "narrow-stretch" in (folder / "manifest.json").read_text("utf-8")
    # It is told once, and not again as turns that meet land anywhere.
    assert not any(one.kind == "not-safe-everywhere" for one in outcome.result.fetched.notes)


@pytest.mark.slow
@pytest.mark.skipif(not REFERENCE.exists(), reason="the reference routes are not here")
@pytest.mark.parametrize("vessel", VESSELS)
def test_reference_routes_are_sailed_from_quay_to_quay(vessel: str, tmp_path: Path) -> None:
    """All are planned, as short as the official ones, and every tight stretch is listed."""
    routes = json.loads(REFERENCE.read_text("utf-8"))
    for number, (key, route) in enumerate(routes.items()):
        begin, *_, end = route["waypoints"]
        found = go(
            tuple(begin),
            tuple(end),
            currents=["still"],
            name=f"reference-{number}",
            output=tmp_path,
            offline=True,
            **VESSELS[vessel],
        )
        (case,) = found.result.cases
        best, planned = case.routes[0], case.planned
        assert planned is not None
        assert best.metrics.length_m <= 1.02 * 1000 * route["length_km"], key
        radius, path = planned.vessel.turning_radius, best.route.path
        zone = shapely.LineString(path).buffer(3 * radius)
        land = [one.intersection(zone) for one in planned.water.land if one.intersects(zone)]
        along, touched = hits(path, land, radius, spacing=radius / 10)
        _, nearly = hits(path, land, 1.05 * radius, spacing=radius / 10)
        listed = np.zeros(len(along), dtype=bool)
        for one in case.narrow(1):
            inside = (along >= one.begin_m - radius) & (
                along <= one.begin_m + one.length_m + radius
            )
            assert nearly[inside].any(), key
            listed |= inside
        assert not (touched & ~listed).any(), key
        assert math.isfinite(best.metrics.fuel)
