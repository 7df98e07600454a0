"""Reading a region from the user's files: across seams, weighted, and in little memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, strategies as st

from pipeline.geo.lonlat import Bounds
from pipeline.sources.cf.axes import TimeSteps
from pipeline.sources.cf.contents import Contents, read_contents
from pipeline.sources.cf.fields import FieldReader, coverage_faults, find_window
from tests.pipeline.sources.cf.sample_files import BOX, LAT, LON, SEA, read
from tests.pipeline.synthetic_currents import dataset, sea, write

# --- across the seams ---------------------------------------------------------------------------

GLOBE = np.arange(0.0, 360.0, 2.0)
WORLD = sea(GLOBE, np.arange(-60.0, 61.0, 2.0), seed=4)


@pytest.mark.gate_share(10)
@pytest.mark.parametrize("first", [0.0, -180.0, 20.0])
@pytest.mark.parametrize("west", [-190.0, -21.0, 0.0, 170.0, 340.0])
@pytest.mark.parametrize("down", [False, True])
def test_a_region_across_a_seam_is_read_in_one_piece(
    tmp_path: Path, first: float, west: float, *, down: bool
) -> None:
    begin = int(np.flatnonzero(first % 360 == GLOBE)[0])
    data = dataset(WORLD).roll(longitude=-begin, roll_coords=False)
    lon = first + GLOBE
    data = data.assign_coords(longitude=("longitude", lon, {"units": "degrees_east"}))
    if down:
        data = data.isel(longitude=slice(None, None, -1))
    box = (west, -10.0, west + 31.0, 10.0)
    field = read(write(tmp_path / "world.nc", data), box=box)
    assert field.lon.tolist() == [x for x in range(-400, 800, 2) if west <= x <= west + 31]
    number = {float(lon): i for i, lon in enumerate(WORLD.lon)}
    for i, lon in enumerate(field.lon):
        at = number[lon % 360]
        rows = np.abs(WORLD.lat) <= 10
        assert np.array_equal(field.u[:, i], WORLD.u[rows, at])
        assert np.array_equal(field.v[:, i], WORLD.v[rows, at])


def test_a_repeated_longitude_is_read_once(tmp_path: Path) -> None:
    data = dataset(WORLD)
    again = data.isel(longitude=[0]).assign_coords(longitude=[360.0])
    both = xr.concat([data, again], "longitude")
    both.longitude.attrs = data.longitude.attrs
    field = read(write(tmp_path / "twice.nc", both), box=(-6.0, -10.0, 6.0, 10.0))
    assert field.lon.tolist() == [-6, -4, -2, 0, 2, 4, 6]


@given(
    first=st.floats(-360, 360),
    step=st.floats(0.1, 3),
    count=st.integers(2, 100),
    west=st.floats(-180, 180),
    wide=st.floats(0.5, 180),
    down=st.booleans(),
)
def test_a_window_has_all_nodes_inside_and_no_others(
    first: float, step: float, count: int, west: float, wide: float, *, down: bool
) -> None:
    lon = first + step * np.arange(count, dtype=float)
    lat = np.linspace(-60, 60, 41)
    contents = Contents(
        files=(),
        lon=lon[::-1] if down else lon,
        lat=lat[::-1] if down else lat,
        u=(),
        v=(),
        steps=TimeSteps(),
        u_index=(),
        v_index=(),
        notes=(),
        attributes={},
    )
    window = find_window(contents.lon, contents.lat, (west, -30.0, west + wide, 30.0))
    numbers = [i for run in window.columns for i in range(*run.indices(count))]
    assert len(numbers) == window.lon.size
    assert (np.diff(window.lon) > 0).all()
    for number, place in zip(numbers, window.lon, strict=True):
        turns = (place - contents.lon[number]) / 360
        assert abs(turns - round(turns)) < 1e-9
        assert west <= place <= west + wide
    inside = {
        round(float(value + 360 * turn), 6)
        for value in lon
        for turn in range(-3, 4)
        if west <= value + 360 * turn <= west + wide
    }
    assert len(window.lon) >= len(inside) - 2 * (step * count >= 359)
    assert (
        contents.lat[window.rows].tolist()
        == window.lat.tolist()
        == [y for y in lat if -30 <= y <= 30]
    )


# --- weights and gaps ---------------------------------------------------------------------------


def test_a_gap_in_one_step_is_a_gap_in_the_mean(tmp_path: Path) -> None:
    first, second = (sea(LON, LAT, seed=day) for day in range(2))
    second.v[45, 45] = np.nan
    path = write(tmp_path / "two.nc", dataset(first, second, times=["2024-07-01", "2024-07-02"]))
    mean = read(path, weights={0: 0.5, 1: 0.5}, box=(122.0, 12.0, 123.0, 13.0))
    at = np.flatnonzero(mean.lon == LON[45]), np.flatnonzero(mean.lat == LAT[45])
    assert np.isnan(mean.u[at[1], at[0]]).all()
    assert np.isnan(mean.u).sum() == np.isnan(mean.v).sum() == 1


# --- coverage -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("box", "part"),
    [
        ((99.74, 8, 122, 13), "west of 99.75 (the region reaches 99.74)"),
        ((117, -10.26, 122, 13), "south of -10.25"),
        ((117, 8, 139.76, 13), "east of 139.75"),
        ((117, 8, 122, 29.76), "north of 29.75"),
        ((-60, 8, -50, 13), "no data there at all"),
        ((90, -20, 150, 40), "west of 99.75 (the region reaches 90) nor south of -10.25"),
    ],
)
def test_how_far_a_region_reaches_beyond_the_grid_is_reported(
    tmp_path: Path, box: Bounds, part: str
) -> None:
    contents = read_contents((write(tmp_path / "sea.nc", dataset(SEA)),))
    (fault,) = coverage_faults(contents, box)
    assert part in fault
    assert coverage_faults(contents, (99.76, -10.24, 139.74, 29.74)) == []


def test_a_region_beyond_both_ends_of_the_grid_is_not_covered(tmp_path: Path) -> None:
    contents = read_contents((write(tmp_path / "sea.nc", dataset(SEA)),))
    (fault,) = coverage_faults(contents, (135.0, 0.0, 464.0, 10.0))
    assert "between 139.5 and 460 E" in fault


# --- memory -------------------------------------------------------------------------------------

READ_BIG_FILE = """
import resource, sys
from pipeline.sources.cf.contents import find_files, read_contents
from pipeline.sources.cf.fields import FieldReader, find_window
import dask.array, netCDF4, numcodecs, xarray, zarr
contents = read_contents(find_files(sys.argv[1:]))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
steps = len(contents.steps.labels)
window = find_window(contents.lon, contents.lat, (116.0, 7.0, 122.0, 13.0))
with FieldReader(contents, window) as reader:
    field = reader.field({i: 1 / steps for i in range(steps)})
grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
print(grown >> 10, field.u.min(), field.u.max(), field.v.min(), field.v.max())
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["zarr", "netcdf"])
def test_a_global_file_of_gigabytes_is_read_in_megabytes(tmp_path: Path, kind: str) -> None:
    steps, ny, nx = 90, 2160, 4320
    path = tmp_path / f"global.{'zarr' if kind == 'zarr' else 'nc'}"
    rows, columns = slice(1152, 1280), slice(3456, 3712)
    (_zarr if kind == "zarr" else _netcdf)(path, (steps, ny, nx), rows, columns)
    printed = subprocess.run(
        [sys.executable, "-c", READ_BIG_FILE, str(path)],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[5],
    ).stdout.split()
    assert 2 * 4 * steps * ny * nx > 6e9
    assert int(printed[0]) < 200, "megabytes"
    # Step i has i/100 east and -i/50 north.
    assert [float(value) for value in printed[1:]] == pytest.approx([0.445] * 2 + [-0.89] * 2)


def _axes(ny: int, nx: int) -> tuple[np.ndarray, np.ndarray]:
    return -90 + (np.arange(ny) + 0.5) / 12, -180 + (np.arange(nx) + 0.5) / 12


def _zarr(path: Path, shape: tuple[int, int, int], rows: slice, columns: slice) -> None:
    """Write the metadata of the whole array, but only the chunks of one block."""
    import dask.array as da

    lat, lon = _axes(*shape[1:])
    blank = da.full(  # type: ignore[no-untyped-call]
        shape, np.nan, dtype="f4", chunks=(10, 128, 256)
    )
    step = np.arange(shape[0])
    data = xr.Dataset(
        {name: (("time", "lat", "lon"), blank, {"units": "m/s"}) for name in ("uo", "vo")},
        {"time": step, "lat": lat, "lon": lon},
    )
    data.time.attrs["units"] = "days since 2024-01-01"
    data.to_zarr(path, zarr_format=2, consolidated=False, compute=False)
    block = np.broadcast_to(step[:, None, None], (shape[0], 128, 256)).astype("f4")
    part = xr.Dataset(
        {
            "uo": (("time", "lat", "lon"), block / 100),
            "vo": (("time", "lat", "lon"), -block / 50),
        }
    )
    part.to_zarr(
        path,
        zarr_format=2,
        consolidated=False,
        region={"time": slice(0, shape[0]), "lat": rows, "lon": columns},
    )


def _netcdf(path: Path, shape: tuple[int, int, int], rows: slice, columns: slice) -> None:
    """Write one block; the other chunks are never allocated."""
    with netCDF4.Dataset(path, "w") as file:
        for name, size in zip(("time", "lat", "lon"), shape, strict=True):
            file.createDimension(name, size)
            file.createVariable(name, "f8", (name,))
        file["time"][:], file["time"].units = np.arange(shape[0]), "days since 2024-01-01"
        file["lat"][:], file["lon"][:] = _axes(*shape[1:])
        for name, factor in (("uo", 0.01), ("vo", -0.02)):
            variable = file.createVariable(
                name, "f4", ("time", "lat", "lon"), fill_value=np.nan, chunksizes=(10, 128, 256)
            )
            variable.units = "m/s"
            for step in range(shape[0]):
                variable[step, rows, columns] = factor * step


# --- real files ---------------------------------------------------------------------------------

REAL = {
    "cmems": ("cmems_mod_glo_phy-cur_anfc_0.083deg_P1D-m_2024-01_1deg_5day.nc", "uo", "vo"),
    "cwb": ("cwb_ocm_M-B0071-000_20200617T00.nc", "uo", "vo"),
    "duacs": ("duacs_nrt_global_allsat_phy_l4_20190223_20190226.nc", "ugos", "vgos"),
    "oscar": ("oscar_climatology_1992-2012_monthly_third_deg.nc", "uo", "vo"),
}


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("box", [BOX, (-10.0, 35.0, 12.0, 50.0), (172.0, -45.0, 189.0, -30.0)])
def test_real_files_node_by_node(shared: Path, name: str, box: Bounds) -> None:
    file, u_name, v_name = REAL[name]
    path = shared / "data" / "currents" / file
    contents = read_contents((path,))
    if coverage_faults(contents, box):
        assert name == "cwb"
        return
    last = len(contents.steps.labels) - 1
    with FieldReader(contents, find_window(contents.lon, contents.lat, box)) as reader:
        field = reader.field({last: 1.0})
    with netCDF4.Dataset(path) as raw:
        lon, lat = np.asarray(raw["longitude"][:]), np.asarray(raw["latitude"][:])
        u, v = (np.ma.filled(raw[key][last].astype(float), np.nan) for key in (u_name, v_name))
    rng = np.random.default_rng(0)
    for _ in range(200):
        j, i = rng.integers(field.lat.size), rng.integers(field.lon.size)
        offset = np.abs((lon - field.lon[i] + 180) % 360 - 180)
        column, row = int(offset.argmin()), int(np.abs(lat - field.lat[j]).argmin())
        assert offset[column] < 1e-4
        assert np.array_equal(field.u[j, i], u[row, column], equal_nan=True)
        assert np.array_equal(field.v[j, i], v[row, column], equal_nan=True)
