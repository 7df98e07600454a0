"""The catalogue's chart scenarios end to end, on the currents and cells in ../shared."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pyogrio
import pyproj
import pytest
import shapely
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.findings.note_words import note_texts
from pipeline.geo.projection import Projection
from pipeline.model.depths import DepthRule
from pipeline.run import Outcome, run
from pipeline.scenario.loading import load_scenario
from pipeline.sources.land.s57 import S57Chart
from tests.pipeline.results import rows_of
from tests.true_scale import clearance_m


@pytest.fixture(scope="module")
def oscar(shared: Path) -> Path:
    """Give the monthly climatology of OSCAR; skip where it is absent."""
    file = shared / "data" / "currents" / "oscar_climatology_1992-2012_monthly_third_deg.nc"
    if not file.is_file():
        pytest.skip("needs ../shared/data/currents, which is not here")
    return file


def assert_valid(outcome: Outcome) -> None:
    """Every season has routes on both sides of an island, without routes or turns over land."""
    assert outcome.exit_code == 0
    rows = rows_of(outcome.result)
    for case in outcome.result.cases:
        assert len({row.main_passage for row in case.measures.routes}) == 2
    assert all(row.land_m == 0 for row in rows)
    assert all(row.collisions == 0 for row in rows)


@pytest.mark.parametrize(
    ("name", "width", "height"), [("hansando", 1533, 1619), ("far-east", 1360, 1270)]
)
def test_the_region_is_as_large_as_the_papers(name: str, width: float, height: float) -> None:
    scenario = load_scenario(name)
    assert scenario.region is not None
    plane = Projection.for_region(scenario.region.shape, scenario.scale)
    west, south, east, north = scenario.region.shape.bounds
    middle = (west + east) / 2, (south + north) / 2
    edges = plane.to_plane(
        [(west, middle[1]), (east, middle[1]), (middle[0], south), (middle[0], north)]
    )
    assert np.linalg.norm(edges[1] - edges[0]) == pytest.approx(width, rel=0.03)
    assert np.linalg.norm(edges[3] - edges[2]) == pytest.approx(height, rel=0.03)


def test_a_scenario_on_cells_asks_for_them(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["run", "boston-enc", "--output", str(tmp_path / "outputs")])
    assert result.exit_code == 2
    assert "--charts" in result.stderr
    assert "`renew show` prints" in result.stderr
    assert "NOAA ENC" in load_scenario("boston-enc").description
    assert "US5BOSCD" in load_scenario("boston-enc").description
    assert not (tmp_path / "outputs").exists()


@pytest.mark.slow
def test_hansando(oscar: Path, tmp_path: Path) -> None:
    assert_valid(run(load_scenario("hansando", currents=[oscar]), tmp_path))


@pytest.mark.slow
def test_far_east(oscar: Path, tmp_path: Path) -> None:
    outcome = run(load_scenario("far-east", currents=[oscar]), tmp_path)
    assert_valid(outcome)
    assert any(
        "as fast as the vessel (1 m/s) or faster" in note
        for note in note_texts(outcome.fetched.notes)
    )


@pytest.mark.slow
def test_boston_by_its_soundings_and_marks(oscar: Path, shared: Path, tmp_path: Path) -> None:
    cells = tmp_path / "cells"
    cells.mkdir()
    for file in (shared / "data" / "charts").glob("US5BOSCD.*"):
        shutil.copyfile(file, cells / file.name)
    scenario = load_scenario("boston-enc", charts=cells, currents=[oscar])
    outcome = run(scenario, tmp_path / "outputs")
    assert_valid(outcome)
    assert scenario.region is not None
    assert scenario.vessel.draught_m is not None
    depth_m = scenario.vessel.draught_m + scenario.chart.under_keel_clearance_m
    package = outcome.directory / "routes.gpkg"
    meta, _, wkb, columns = pyogrio.raw.read(package, layer="routes", columns=["clearance_m"])
    assert list(meta["fields"]) == ["clearance_m"]
    land = S57Chart(cells, DepthRule(depth_m)).land(scenario.region.shape)
    for line, reported in zip(shapely.from_wkb(wkb), columns[0], strict=True):
        assert clearance_m(shapely.get_coordinates(line), land.polygons) == pytest.approx(
            reported, abs=1.0
        )
    # Checked in UTM, which the pipeline does not use here: rocks, wrecks and marks are further from
    # the routes than their radius plus the coast's accuracy, and no shallow sounding is near.
    to_utm = pyproj.Transformer.from_crs(4326, 32619, always_xy=True)

    def in_metres(geometry: shapely.Geometry) -> shapely.Geometry:
        flat = shapely.force_2d(geometry)
        return shapely.transform(flat, lambda xy: np.column_stack(to_utm.transform(*xy.T)))

    routes = in_metres(shapely.union_all(shapely.from_wkb(wkb)))
    for name, min_m in (("UWTROC", 16), ("WRECKS", 16), ("BOYLAT", 31), ("PILPNT", 16)):
        meta, _, wkb, columns = pyogrio.raw.read(cells / "US5BOSCD.000", layer=name)
        geometry = in_metres(shapely.from_wkb(wkb))
        fields = list(meta["fields"])
        if "VALSOU" in fields:
            geometry = geometry[~(columns[fields.index("VALSOU")].astype(float) >= depth_m)]
        assert shapely.distance(geometry, routes).min() >= min_m, name
    _, _, wkb, (depth,) = pyogrio.raw.read(
        cells / "US5BOSCD.000",
        layer="SOUNDG",
        columns=["DEPTH"],
        SPLIT_MULTIPOINT="ON",
        ADD_SOUNDG_DEPTH="ON",
    )
    near = shapely.dwithin(in_metres(shapely.from_wkb(wkb)), routes, 20.0)
    assert near.sum() > 10
    assert depth[near].min() >= depth_m
