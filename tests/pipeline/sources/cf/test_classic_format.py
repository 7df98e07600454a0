"""Classic NetCDF files that end too early are found: the library reads zeros beyond their end."""

from __future__ import annotations

from pathlib import Path

import netCDF4
import numpy as np
import pytest

from pipeline.errors import RequestError
from pipeline.sources.cf.dataset import missing_bytes
from tests.pipeline.sources.cf.sample_files import SEA, read
from tests.pipeline.synthetic_currents import dataset

FORMATS = ("NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA")
TYPES = ("i1", "S1", "i2", "i4", "f4", "f8")


def write_random(path: Path, name: str, rng: np.random.Generator) -> bool:
    """Write random variables, with and without a dimension that grows; whether any has values."""
    steps = int(rng.integers(0, 4))
    has_values = False
    with netCDF4.Dataset(path, "w", format=name) as data:  # type: ignore[arg-type]  # one of FORMATS
        data.createDimension("time", None)
        for i in range(3):
            data.createDimension(f"d{i}", int(rng.integers(1, 6)))
        data.title = "é" * int(rng.integers(0, 9))
        for i in range(int(rng.integers(0, 7))):
            shape = [f"d{j}" for j in range(rng.integers(0, 3))]
            grows = bool(rng.integers(0, 2))
            kind = rng.choice(TYPES)
            variable = data.createVariable(f"v{i}", kind, ["time"] * grows + shape)
            variable.range = np.arange(3, dtype="i2")
            if grows and steps:
                variable[:steps] = np.ones((steps, *variable.shape[1:]), kind)
            has_values |= not grows or steps > 0
    return has_values


@pytest.mark.parametrize("name", FORMATS)
def test_no_byte_of_a_complete_file_is_missing_and_none_can_be_spared(
    tmp_path: Path, name: str
) -> None:
    rng = np.random.default_rng(1)
    path = tmp_path / "classic.nc"
    for _ in range(25):
        has_values = write_random(path, name, rng)
        assert missing_bytes(path) == 0
        if has_values:
            # The last value may have up to three bytes of padding.
            content = path.read_bytes()
            path.write_bytes(content[:-4])
            assert 1 <= missing_bytes(path) <= 4


def test_a_truncated_classic_file_is_refused_and_not_read_as_zeros(tmp_path: Path) -> None:
    path = tmp_path / "classic.nc"
    dataset(SEA).to_netcdf(
        path, engine="netcdf4", format="NETCDF3_CLASSIC", unlimited_dims=["time"]
    )
    assert np.isfinite(read(path).u).all()
    content = path.read_bytes()
    path.write_bytes(content[:-1000])
    with netCDF4.Dataset(path) as data:
        assert (data["vo"][0, -2:] == 0).any(), "the library does so without an error"
    with pytest.raises(RequestError, match=r"classic\.nc: it can't be read: it ends 1,000 bytes"):
        read(path)
