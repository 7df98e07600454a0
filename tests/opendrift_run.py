"""Follow vessels adrift with OpenDrift, in an interpreter that has it: IN.npz to OUT.npz."""

from __future__ import annotations

import logging
import sys
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import xarray as xr
from opendrift.models.oceandrift import OceanDrift  # type: ignore[import-not-found]
from opendrift.readers.reader_netCDF_CF_generic import (  # type: ignore[import-not-found]
    Reader as Field,
)
from opendrift.readers.reader_shape import Reader as Land  # type: ignore[import-not-found]

BEGIN = datetime(2026, 12, 1)  # noqa: DTZ001 - OpenDrift's times are naive


def follow(asked: dict[str, Any]) -> tuple[Any, Any]:
    """Return seconds (n,) until land, NaN for none in time, and lon/lat (n, 2) where it is met."""
    logging.disable(logging.INFO)
    times = np.datetime64(BEGIN, "ns") + (1e9 * asked["times_s"]).astype("timedelta64[ns]")
    axes = {
        "time": times,
        "lat": ("lat", asked["lat"], {"units": "degrees_north", "standard_name": "latitude"}),
        "lon": ("lon", asked["lon"], {"units": "degrees_east", "standard_name": "longitude"}),
    }
    data = {
        name: (("time", "lat", "lon"), asked[name], {"units": "m s-1", "standard_name": standard})
        for name, standard in (
            ("u", "eastward_sea_water_velocity"),
            ("v", "northward_sea_water_velocity"),
        )
    }
    path = Path(sys.argv[2]).with_suffix(".nc")
    xr.Dataset(data, axes).to_netcdf(path)
    model = OceanDrift(loglevel=50)
    model.set_config("drift:advection_scheme", "runge-kutta4")
    model.set_config("general:coastline_action", "stranding")
    for name in (
        *("drift:vertical_mixing", "drift:vertical_advection", "drift:stokes_drift"),
        *("general:use_auto_landmask", "seed:ocean_only"),
    ):
        model.set_config(name, value=False)
    model.set_config("seed:wind_drift_factor", 0.0)
    for name in (
        "x_wind",
        "y_wind",
        "sea_surface_wave_stokes_drift_x_velocity",
        "sea_surface_wave_stokes_drift_y_velocity",
    ):
        model.set_config(f"environment:constant:{name}", 0.0)
    model.add_reader([Field(str(path)), Land(shapely.from_wkb(asked["land"].tolist()).tolist())])
    lon, lat = asked["start"].T
    begun = [BEGIN + timedelta(seconds=float(one)) for one in asked["begun_s"]]
    model.seed_elements(lon=lon, lat=lat, time=begun, number=len(lon), radius=0)
    step = float(asked["step_s"])
    last = timedelta(seconds=float(asked["times_s"][-1]) - 2 * step)
    model.run(end_time=BEGIN + last, time_step=step, time_step_output=step)
    status = model.result.status.values
    stranded = model.status_categories.index("stranded")
    is_ashore = status == stranded
    found = is_ashore.any(axis=1)
    at = is_ashore.argmax(axis=1)
    clock = (model.result.time.values - np.datetime64(BEGIN, "ns")) / np.timedelta64(1, "s")
    rows = np.arange(len(lon))
    place = np.stack([model.result[name].values[rows, at] for name in ("lon", "lat")], axis=-1)
    return np.where(found, clock[at] - asked["begun_s"], np.nan), place


if __name__ == "__main__":
    with np.load(sys.argv[1], allow_pickle=True) as given:
        seconds, end = follow(dict(given))
    np.savez(sys.argv[2], seconds=seconds, end=end)
