"""Hours adrift beside OpenDrift's, where an interpreter has it (OPENDRIFT_PYTHON)."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import Geod

from pipeline.geo.projection import Projection
from pipeline.model import CurrentGrid
from pipeline.model.inputs import Credit
from pipeline.stages.project import planar_current
from renew import Chart
from renew.voyage.drift import Drift
from tests.conftest import ROOT
from tests.pipeline.synthetic_currents import sea

PYTHON = os.environ.get("OPENDRIFT_PYTHON", sys.executable)
HOUR, STEP_S, STATIONS = 3600.0, 120.0, 200
REGION = shapely.box(118.0, 9.0, 120.0, 11.0)
LAND = [
    shapely.Point(119.0, 10.0).buffer(0.35, quad_segs=3),
    shapely.Point(118.4, 9.5).buffer(0.15, quad_segs=2),
    shapely.box(119.5, 9.0, 119.8, 10.9),
]


@pytest.mark.slow
@pytest.mark.parametrize("changes", [False, True])
def test_vessels_adrift_come_to_the_places_of_opendrift(tmp_path: Path, changes: bool) -> None:
    if subprocess.run(
        [PYTHON, "-c", "import opendrift"], check=False, capture_output=True
    ).returncode:
        pytest.skip("OpenDrift is not installed: give OPENDRIFT_PYTHON=PYTHON")
    lon, lat = np.arange(117.0, 121.01, 0.1), np.arange(8.0, 12.01, 0.1)
    times = np.arange(0.0, 73 * HOUR, 6 * HOUR)
    seas = [sea(lon, lat, seed=7 + step * changes, speed_m_s=0.5) for step in range(len(times))]
    u, v = (np.array([getattr(one, name) for one in seas]) for name in ("u", "v"))
    grid = CurrentGrid("one", lon, lat, u, v, "", Credit("test", "current", "", ""), times_s=times)
    projection = Projection.for_region(REGION)
    land = projection.geometry_to_plane(
        np.array([shapely.segmentize(one, 0.01) for one in LAND], dtype=object)
    )
    extent = shapely.Polygon(
        projection.to_plane(shapely.get_coordinates(shapely.segmentize(REGION, 0.1)))
    )
    rng = np.random.default_rng(1)
    start = rng.uniform((118.05, 9.05), (119.95, 10.95), (20 * STATIONS, 2))
    start = start[~shapely.intersects_xy(shapely.union_all(LAND).buffer(0.02), start)][:STATIONS]
    begun = rng.uniform(0, 12 * HOUR, STATIONS) // STEP_S * STEP_S
    table = planar_current(grid, projection, extent.bounds).table(extent.bounds)
    chart = Chart(extent, land.tolist(), point_scale=projection.scale_at)
    until = times[-1] - 2 * STEP_S
    seconds, ends = Drift.of(chart, table, land, 72 * HOUR).follow(
        projection.to_plane(start), begun, (72 * HOUR, until)
    )
    files = tmp_path / "in.npz", tmp_path / "out.npz"
    np.savez(
        files[0],
        lon=lon,
        lat=lat,
        times_s=times,
        u=u,
        v=v,
        start=start,
        begun_s=begun,
        step_s=STEP_S,
        land=np.array(shapely.to_wkb(LAND), dtype=object),
    )
    subprocess.run([PYTHON, str(ROOT / "tests/opendrift_run.py"), *map(str, files)], check=True)
    with np.load(files[1]) as found:
        theirs, places = found["seconds"], found["end"]
    both = np.isfinite(theirs) & np.isfinite(seconds)
    own = projection.to_lonlat(ends)
    apart = Geod(ellps="WGS84").inv(*own.T, *places.T)[2]
    reach = Geod(ellps="WGS84").inv(*start.T, *own.T)[2]
    share = apart[both] / np.maximum(reach[both], 1.0)
    assert both.sum() > 80
    assert np.median(share) <= 0.05
