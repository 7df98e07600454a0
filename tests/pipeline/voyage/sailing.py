"""A finished run in a tide round an island, and the positions of a vessel that sails it."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import xarray as xr

from pipeline.run import run
from pipeline.scenario.catalogue import ScenarioFile
from pipeline.scenario.loading import load_scenario
from pipeline.sources.current_field import Field
from tests.pipeline import tidal_run
from tests.pipeline.results import plain_pages
from tests.pipeline.synthetic_currents import dataset, write

NAME, SEASON = "strait", "tide"


def make(folder: Path) -> Path:
    """Plan a voyage, and return the folder of its results."""
    file = scenario_file(folder)
    asked = load_scenario(str(file))
    with plain_pages():
        run(asked, folder / "outputs", offline=True, origin=ScenarioFile.read(file))
    return results_in(folder)


def results_in(folder: Path) -> Path:
    """Return the folder of the voyage's results in that where it was planned."""
    return folder / "outputs" / NAME


def copied(results: Path, folder: Path) -> Path:
    """Copy the folder of a voyage, its inputs and its store; return that of the results in it."""
    made = results.parent.parent
    shutil.copytree(made, folder, symlinks=True)
    scenario = folder / "outputs" / NAME / "scenario.toml"
    scenario.write_text(scenario.read_text().replace(str(made), str(folder)))
    return scenario.parent


def scenario_file(folder: Path) -> Path:
    """Write the voyage's scenario and its chart and tide."""
    (folder / "island.geojson").write_text(shapely.to_geojson(tidal_run.ISLAND))
    tide_file(folder / "tide.nc")
    file = folder / f"{NAME}.toml"
    west, south, east, north = tidal_run.BBOX
    file.write_text(f"""
schema_version = 1
name = "{NAME}"
start = [119.005, 9.53]
goal = [119.095, 9.53]
[region]
bbox = [{west}, {south}, {east}, {north}]
[chart]
source = [{{ path = "island.geojson", accuracy_m = 5.0 }}]
[vessel]
length_m = 4.0
speed_m_s = 1.5
turn_rate_deg_s = 4.0
[[seasons]]
name = "{SEASON}"
time_method = "changing"
departure = {tidal_run.DEPARTURE.isoformat()}
currents = ["tide.nc"]
[planner]
classes = 2
clearance = 100.0
""")
    return file


def tide_file(path: Path, *, faster: float = 1.0, hours: int = 30) -> None:
    """Write the tide of `tidal_run`, hourly, times a factor."""
    west, south, east, north = tidal_run.BBOX
    lon = np.linspace(west - 0.02, east + 0.02, 15)
    lat = np.linspace(south - 0.02, north + 0.02, 11)
    strength = faster * (0.3 + 0.2 * (lat - south) / (north - south))
    times = np.datetime64("2026-11-22T05:00") + np.arange(hours) * np.timedelta64(1, "h")
    steps = []
    for hour in range(hours):
        phase = 2 * np.pi * hour * 3600 / tidal_run.PERIOD_S + 0.6
        u = np.cos(phase) * strength[:, None] * np.ones(lon.size)
        steps.append(Field(lon, lat, u, 0.1 * np.sin(phase) * np.ones(u.shape)))
    data: xr.Dataset = dataset(*steps, times=times)
    write(path, data)


def waypoints(results: Path) -> list[dict[str, Any]]:
    """The waypoints of the best route."""
    features = json.loads((results / f"{NAME}-{SEASON}.geojson").read_bytes())["features"]
    return [
        one
        for one in features
        if one["properties"]["feature"] == "waypoint" and one["properties"]["rank"] == 1
    ]


def sailed(results: Path, seconds: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Positions (n, 2), degrees, of a vessel on its plan at times (n,) since its departure."""
    points = waypoints(results)
    times = [one["properties"]["time_s"] for one in points]
    lonlat = np.array([one["geometry"]["coordinates"] for one in points])
    return np.stack([np.interp(seconds, times, lonlat[:, i]) for i in (0, 1)], axis=-1)
