"""A synthetic sea on a grid, written in the many ways of the CF conventions, and read back."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from pipeline.errors import RequestError
from pipeline.geo.projection import Bounds
from pipeline.sources.cf.contents import find_files, read_contents
from pipeline.sources.cf.fields import FieldReader, find_window
from pipeline.sources.current_field import Field
from tests.pipeline.synthetic_currents import dataset, sea, write

BOX = (117.0, 8.0, 122.0, 13.0)
LON, LAT = np.arange(100.0, 140.0, 0.5), np.arange(-10.0, 30.0, 0.5)
SEA = sea(LON, LAT)


def read(*paths: Path, weights: dict[int, float] | None = None, box: Bounds = BOX) -> Field:
    """Read a box from files: the first step, unless weights are given."""
    contents = read_contents(find_files([str(path) for path in paths]))
    with FieldReader(contents, find_window(contents.lon, contents.lat, box)) as reader:
        return reader.field(weights or {0: 1.0})


def expected(field: Field = SEA, box: Bounds = BOX) -> Field:
    """Cut the box out of a field by comparing each node."""
    west, south, east, north = box
    x = np.array([west <= lon <= east for lon in field.lon])
    y = np.array([south <= lat <= north for lat in field.lat])
    return type(field)(field.lon[x], field.lat[y], field.u[y][:, x], field.v[y][:, x])


def assert_same(one: Field, other: Field, within: float = 1e-6) -> None:
    """Compare two fields."""
    for name in ("lon", "lat", "u", "v"):
        ours, theirs = getattr(one, name), getattr(other, name)
        assert ours.shape == theirs.shape, name
        assert np.allclose(ours, theirs, atol=within, equal_nan=True), name


def refusal(folder: Path, make: Callable[[], xr.Dataset]) -> str:
    """Write a dataset that must be refused, and return the message: one line, no Python types."""
    path = write(folder / "bad.nc", make())
    with pytest.raises(RequestError) as caught:
        read_contents((path,))
    assert not re.search(r"\n|<class|Error\(", "".join(caught.value.faults))
    return str(caught.value)


def at_levels(levels: Sequence[float], units: str, positive: str) -> xr.Dataset:
    """Put the sea at the shallowest of some levels, and slower water at the others."""
    data = dataset(SEA)
    shallow = int(np.argmin(np.abs(levels)))
    layers = xr.concat([data * (1.0 if i == shallow else 0.1) for i in range(len(levels))], "depth")
    for name in ("uo", "vo"):
        layers[name].attrs = data[name].attrs
    layers = layers.transpose("time", "depth", "latitude", "longitude")
    return layers.assign_coords(
        depth=("depth", list(levels), {"units": units, "positive": positive})
    )


def _from_minus_180(data: xr.Dataset) -> xr.Dataset:
    lon = (data.longitude + 180) % 360 - 180
    return data.assign_coords(longitude=lon.assign_attrs(data.longitude.attrs))


def _named(u: str, v: str, standard: tuple[str, str] = ("", "")) -> xr.Dataset:
    return dataset(SEA, names=(u, v), standard=standard)


def _in_unit(units: str, factor: float) -> xr.Dataset:
    data = dataset(SEA, units=units)
    for name in ("uo", "vo"):
        data[name] = (data[name] * factor).assign_attrs(data[name].attrs)
    return data


# The same sea, written in different ways.
VARIANTS: dict[str, Callable[[], xr.Dataset]] = {
    "as usual": lambda: dataset(SEA),
    "latitudes descend": lambda: dataset(SEA).isel(latitude=slice(None, None, -1)),
    "longitudes descend": lambda: dataset(SEA).isel(longitude=slice(None, None, -1)),
    "longitudes -180 to 180": lambda: _from_minus_180(dataset(SEA)),
    "a turn further on": lambda: dataset(SEA).assign_coords(
        longitude=("longitude", LON + 360, {"units": "degrees_east"})
    ),
    "other order of axes": lambda: dataset(SEA).transpose("longitude", "time", "latitude"),
    "no time": lambda: dataset(SEA).isel(time=0, drop=True),
    "an ensemble of one": lambda: dataset(SEA).expand_dims("member", axis=1),
    "geostrophic": lambda: _named("ugos", "vgos"),
    "upper case": lambda: _named("U", "V"),
    "standard names before names": lambda: _named(
        "current_e", "current_n", ("eastward_sea_water_velocity", "northward_sea_water_velocity")
    ),
    "other variables beside": lambda: dataset(SEA).assign(
        uwind=dataset(SEA).uo.assign_attrs(standard_name="eastward_wind"),
        zos=dataset(SEA).uo.assign_attrs(standard_name="sea_surface_height_above_geoid"),
    ),
    "cm/s": lambda: _in_unit("cm/s", 100),
    "km h-1": lambda: _in_unit("km h-1", 3.6),
    "knots": lambda: _in_unit("knots", 3600 / 1852),
    "m.s^-1": lambda: _in_unit("m.s^-1", 1),
}
