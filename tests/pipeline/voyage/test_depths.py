"""Voyages in one line on a grid of depths."""

import json
import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import shapely
import xarray as xr

import pipeline
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.scenario.loading import load_scenario
from tests.pipeline.results import result_of, rows_of
from tests.pipeline.sources.depth_grids import emodnet
from tests.pipeline.voyage.waters import FIGURES, GOAL, ISLAND, START, metrics

SHOAL = shapely.box(-40.03, 35.0, -39.98, 35.05)


def depth_grid(file: Path) -> Path:
    """Write depths of 50 m with a shoal of 1 m beside the island, and no figures in the east.

    The grid has longitudes of 0 to 360 degrees, and is a third of a mile fine.
    """
    lon, lat = np.arange(-40.4, -39.799, 0.005), np.arange(34.8, 35.2, 0.005)
    x, y = np.meshgrid(lon, lat)
    height = np.full(x.shape, -50.0)
    height[shapely.contains_xy(SHOAL, x, y)] = -1.0
    height[:, lon > -39.97] = np.nan
    return emodnet(file, lon, lat, height)


@pytest.mark.usefixtures("plain_report")
def test_routes_keep_off_shallow_cells_and_uncharted_depth_is_reported(
    tmp_path: Path, chart: Path
) -> None:
    file = depth_grid(tmp_path / "depths.nc")
    outcome = pipeline.go(
        START, GOAL, **FIGURES, draught="2m", currents=("still",),
        charts=chart, depths=file, clearance_m=0.0, output=tmp_path, name="deep",
    )  # fmt: skip
    assert outcome.exit_code == 0
    rows = metrics(outcome.directory)
    assert {row["way"].partition(" of ")[0] for row in rows} == {"north", "south"}
    routes = json.loads((outcome.directory / "deep-still.geojson").read_text())["features"]
    with xr.open_dataset(file) as grid:
        # Point by point in the file itself, by its own nearest node.
        for route in (one for one in routes if one["properties"]["feature"] == "route"):
            line = shapely.segmentize(shapely.LineString(route["geometry"]["coordinates"]), 2e-4)
            lon, lat = shapely.get_coordinates(line).T
            places = {"lon": xr.DataArray(lon % 360), "lat": xr.DataArray(lat)}
            depth = grid["depth"].sel(places, method="nearest").to_numpy()
            assert np.nanmin(depth) >= 3.0  # draught, and 1 m under the keel
            (row,) = [one for one in rows if int(one["rank"]) == route["properties"]["rank"]]
            assert float(row["uncharted_share"]) == pytest.approx(np.isnan(depth).mean(), abs=0.02)
            assert 0.2 < float(row["uncharted_share"]) < 0.5
            assert float(row["filled_share"]) == 0.0
            assert not shapely.intersects(line, SHOAL)
    manifest = json.loads((outcome.directory / "manifest.json").read_text())
    (sentence,) = [text for text in manifest["unknown"] if "depth" in text]
    assert sentence.startswith("no depth is charted for ")
    assert sentence in note_texts(outcome.fetched.notes)
    assert manifest["inputs"]["land"]["has_depths"] is True
    rtz = (outcome.directory / "deep-still.rtz").read_text()
    assert "no depth is charted for" in rtz
    assert any("less than 3 m deep" in note for note in note_texts(outcome.fetched.notes))
    made = load_scenario(str(outcome.directory / "scenario.toml"))
    again = rows_of(result_of(made, tmp_path / "again"))
    assert [(row.way, row.fuel) for row in again] == [
        (row["way"], float(row["fuel"])) for row in rows
    ]


def test_a_shut_bar_is_told_though_the_tide_ends_in_a_wider_region(tmp_path: Path) -> None:
    """Off Boston: no way leads round the bar, nor does the station's tide reach as far."""
    lon, lat = np.arange(-71.1, -70.85, 0.002), np.arange(42.25, 42.42, 0.002)
    height = np.full((lat.size, lon.size), -12.0)
    height[:, (lon > -70.99) & (lon < -70.985)] = -2.0
    with pytest.raises(RequestError) as caught:
        pipeline.go(
            "42.33N 71.00W", "42.33N 70.96W", **FIGURES, draught="2.4m", currents=("still",),
            depths=emodnet(tmp_path / "depths.nc", lon, lat, height), tide=("boston",),
            datum="MLLW", depart=datetime(2026, 11, 22, 19, tzinfo=UTC), output=tmp_path,
        )  # fmt: skip
    assert "Depart at another time" in str(caught.value)
    assert "Add a station" not in str(caught.value)


def test_a_start_in_shallow_water_is_refused_with_the_nearest_deep_water(
    tmp_path: Path, chart: Path
) -> None:
    with pytest.raises(RequestError) as caught:
        pipeline.go(
            (-40.005, 35.03), GOAL, **FIGURES, draught="2m",
            currents=("still",), charts=chart, depths=depth_grid(tmp_path / "depths.nc"),
            output=tmp_path / "outputs", snap_m=0.0,
        )  # fmt: skip
    (fault,) = caught.value.faults
    assert fault.startswith("start = [-40.005, 35.03] lies on land, or water too shallow")
    place = re.search(r"nearest water with a way out at \[(.*), (.*)\]; move it there", fault)
    assert place is not None
    here = shapely.Point(*map(float, place.groups()))
    assert not SHOAL.union(ISLAND).buffer(0.002).contains(here)
    assert SHOAL.distance(here) < 0.01
    assert not (tmp_path / "outputs").exists()
