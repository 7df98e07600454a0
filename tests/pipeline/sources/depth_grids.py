"""Grids of depths as GEBCO and EMODnet publish them, made up for tests."""

from pathlib import Path

import numpy as np
import xarray as xr

from pipeline._types import FloatArray

LON_ATTRIBUTES = {"standard_name": "longitude", "units": "degrees_east"}
LAT_ATTRIBUTES = {"standard_name": "latitude", "units": "degrees_north"}


def dataset(
    lon: FloatArray, lat: FloatArray, values: FloatArray, name: str, **attributes: str
) -> xr.Dataset:
    """Return values (ny, nx) as a dataset with one variable."""
    return xr.Dataset(
        {name: (("lat", "lon"), values, attributes)},
        {"lat": ("lat", lat, LAT_ATTRIBUTES), "lon": ("lon", lon, LON_ATTRIBUTES)},
        {"title": "A sea floor made up for a test"},
    )


def gebco(file: Path, lon: FloatArray, lat: FloatArray, height_m: FloatArray) -> Path:
    """Write heights as GEBCO does: whole metres, positive up; NaN becomes a fill value."""
    data = dataset(
        lon,
        lat,
        np.rint(height_m),
        "elevation",
        standard_name="height_above_mean_sea_level",
        long_name="Elevation relative to sea level",
        units="m",
    )
    data.to_netcdf(file, encoding={"elevation": {"dtype": "int16", "_FillValue": -32767}})
    return file


def emodnet(file: Path, lon: FloatArray, lat: FloatArray, height_m: FloatArray) -> Path:
    """Write them as depths, positive down, packed in centimetres, from north to south."""
    data = dataset(
        lon % 360,
        lat[::-1],
        -height_m[::-1],
        "depth",
        standard_name="sea_floor_depth_below_mean_sea_level",
        units="m",
    )
    encoding = {"dtype": "int32", "scale_factor": 0.01, "add_offset": 5.0, "_FillValue": -(2**31)}
    data.to_netcdf(file, encoding={"depth": encoding})
    return file
