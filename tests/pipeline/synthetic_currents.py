"""Random currents for tests, without divergence, and functions that write them to files."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pipeline._types import FloatArray
from pipeline.sources.current_field import Field, LandMask

EARTH_RADIUS_M = 6_371_000.0
EASTWARD, NORTHWARD = "eastward_sea_water_velocity", "northward_sea_water_velocity"


def sea(lon: FloatArray, lat: FloatArray, seed: int = 1, speed_m_s: float = 0.3) -> Field:
    """Return random gyres of 150 to 600 km from a stream function: no divergence, some shear."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.radians(lon), np.radians(lat))
    u, v = np.zeros(x.shape), np.zeros(x.shape)
    for _ in range(40):
        length = rng.uniform(150e3, 600e3) / EARTH_RADIUS_M
        bearing, phase = rng.uniform(0, 2 * np.pi, 2)
        kx, ky = 2 * np.pi / length * np.array([np.cos(bearing), np.sin(bearing)])
        slope = np.cos(kx * x + ky * y + phase) * length
        u -= ky * slope
        v += kx * slope / np.cos(y)
    strength = speed_m_s / np.sqrt(np.mean(u**2 + v**2))
    return Field(lon, lat, u * strength, v * strength)


def coastal(field: Field, shore: LandMask) -> Field:
    """Return a field with gaps on land."""
    land = shore.on_grid(field.lon, field.lat)
    return Field(
        field.lon, field.lat, np.where(land, np.nan, field.u), np.where(land, np.nan, field.v)
    )


def dataset(
    *steps: Field,
    times: Any = ("2024-07-01",),  # noqa: ANN401 - anything xarray accepts as a time axis
    names: tuple[str, str] = ("uo", "vo"),
    units: str = "m s-1",
    standard: tuple[str, str] = (EASTWARD, NORTHWARD),
) -> xr.Dataset:
    """Return fields on one grid as a dataset with the axes time, latitude, longitude."""
    axes = ("time", "latitude", "longitude")
    parts = zip(
        names,
        standard,
        (np.stack([s.u for s in steps]), np.stack([s.v for s in steps])),
        strict=True,
    )
    return xr.Dataset(
        {
            name: (axes, values, {"units": units, **({"standard_name": said} if said else {})})
            for name, said, values in parts
        },
        {
            "time": np.array(times, dtype="datetime64[ns]"),
            "latitude": ("latitude", steps[0].lat, {"units": "degrees_north"}),
            "longitude": ("longitude", steps[0].lon, {"units": "degrees_east"}),
        },
        {"title": "A sea made up for a test"},
    )


def write(path: Path, data: xr.Dataset, **encoding: dict[str, Any]) -> Path:
    """Write a dataset in the format of its suffix: .zarr, else NetCDF."""
    if path.suffix == ".zarr":
        data.to_zarr(path, zarr_format=2, consolidated=False, encoding=encoding)
    else:
        data.to_netcdf(path, engine="netcdf4", encoding=encoding)
    return path
