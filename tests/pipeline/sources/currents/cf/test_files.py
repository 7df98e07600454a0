"""A user's own files: whatever their axes, names and units, the same water is read."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import RequestError
from pipeline.sources.currents.cf import grid as cf_grid
from pipeline.sources.currents.cf.contents import Contents, contents, found
from pipeline.sources.currents.cf.time import Steps
from tests.pipeline.seas import dataset, sea, write

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pipeline.sources.quality.field import Field

BOX = (117.0, 8.0, 122.0, 13.0)
LON, LAT = np.arange(100.0, 140.0, 0.5), np.arange(-10.0, 30.0, 0.5)
SEA = sea(LON, LAT)


def read(*paths: Path, weights: dict[int, float] | None = None, box: cf_grid.Bounds = BOX) -> Field:
    """Read a box out of files, the first step if nothing else is said."""
    held = contents(found([str(path) for path in paths]))
    return cf_grid.field(held, weights or {0: 1.0}, cf_grid.window(held, box))


def expected(of: Field = SEA, box: cf_grid.Bounds = BOX) -> Field:
    """Cut the box out of a field by comparing each node."""
    west, south, east, north = box
    x = np.array([west <= lon <= east for lon in of.lon])
    y = np.array([south <= lat <= north for lat in of.lat])
    return type(of)(of.lon[x], of.lat[y], of.u[y][:, x], of.v[y][:, x])


def agrees(one: Field, other: Field, within: float = 1e-6) -> None:
    """Hold a field against another."""
    for name in ("lon", "lat", "u", "v"):
        ours, theirs = getattr(one, name), getattr(other, name)
        assert ours.shape == theirs.shape, name
        assert np.allclose(ours, theirs, atol=within, equal_nan=True), name


# --- the same water, written in many ways -------------------------------------------------------


def _turned(data: xr.Dataset) -> xr.Dataset:
    lon = (data.longitude + 180) % 360 - 180
    return data.assign_coords(longitude=lon.assign_attrs(data.longitude.attrs))


def _renamed(u: str, v: str, standard: tuple[str, str] = ("", "")) -> xr.Dataset:
    return dataset(SEA, names=(u, v), standard=standard)


def _deep(levels: Sequence[float], units: str, positive: str) -> xr.Dataset:
    data = dataset(SEA)
    shallow = int(np.argmin(np.abs(levels)))
    layers = xr.concat([data * (1.0 if i == shallow else 0.1) for i in range(len(levels))], "depth")
    for name in ("uo", "vo"):
        layers[name].attrs = data[name].attrs
    layers = layers.transpose("time", "depth", "latitude", "longitude")
    return layers.assign_coords(
        depth=("depth", list(levels), {"units": units, "positive": positive})
    )


def _in(units: str, factor: float) -> xr.Dataset:
    data = dataset(SEA, units=units)
    for name in ("uo", "vo"):
        data[name] = (data[name] * factor).assign_attrs(data[name].attrs)
    return data


WAYS: dict[str, Callable[[], xr.Dataset]] = {
    "as it is": lambda: dataset(SEA),
    "latitudes descend": lambda: dataset(SEA).isel(latitude=slice(None, None, -1)),
    "longitudes descend": lambda: dataset(SEA).isel(longitude=slice(None, None, -1)),
    "longitudes -180 to 180": lambda: _turned(dataset(SEA)),
    "a turn further on": lambda: dataset(SEA).assign_coords(
        longitude=("longitude", LON + 360, {"units": "degrees_east"})
    ),
    "other order of axes": lambda: dataset(SEA).transpose("longitude", "time", "latitude"),
    "no time": lambda: dataset(SEA).isel(time=0, drop=True),
    "levels in metres": lambda: _deep([0.494, 1.54, 2.65], "m", "down"),
    "levels from below": lambda: _deep([-50.0, -10.0, 0.0], "m", "up"),
    "an ensemble of one": lambda: dataset(SEA).expand_dims("member", axis=1),
    "geostrophic": lambda: _renamed("ugos", "vgos"),
    "u and v": lambda: _renamed("u", "v"),
    "total": lambda: _renamed("utotal", "vtotal"),
    "upper case": lambda: _renamed("U", "V"),
    "standard names before names": lambda: _renamed(
        "current_e", "current_n", ("eastward_sea_water_velocity", "northward_sea_water_velocity")
    ),
    "surface standard names": lambda: _renamed(
        "a", "b", ("surface_eastward_sea_water_velocity", "surface_northward_sea_water_velocity")
    ),
    "x and y along lon and lat": lambda: _renamed(
        "c", "d", ("sea_water_x_velocity", "sea_water_y_velocity")
    ),
    "other variables beside": lambda: dataset(SEA).assign(
        uwind=dataset(SEA).uo.assign_attrs(standard_name="eastward_wind"),
        zos=dataset(SEA).uo.assign_attrs(standard_name="sea_surface_height_above_geoid"),
    ),
    "cm/s": lambda: _in("cm/s", 100),
    "km h-1": lambda: _in("km h-1", 3.6),
    "knots": lambda: _in("knots", 3600 / 1852),
    "m.s^-1": lambda: _in("m.s^-1", 1),
}


def test_the_third_format_of_zarr_is_read(tmp_path: Path) -> None:
    dataset(SEA).to_zarr(tmp_path / "sea", zarr_format=3, consolidated=False)
    agrees(read(tmp_path / "sea"), expected())


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
@pytest.mark.parametrize("way", WAYS)
def test_the_same_water_is_read(tmp_path: Path, way: str, suffix: str) -> None:
    path = write(tmp_path / f"sea{suffix}", WAYS[way]())
    agrees(read(path), expected())


def test_what_a_reader_should_know_is_noted(tmp_path: Path) -> None:
    for way, said in (
        ("geostrophic", "tide and wind drift are not in them"),
        ("km h-1", "uo is in km h-1: converted to m/s"),
        ("knots", "vo is in knots: converted"),
    ):
        held = contents((write(tmp_path / f"{way[:2]}.nc", WAYS[way]()),))
        assert any(said in note for note in held.notes), way
    for way in ("as it is", "u and v", "levels in metres"):
        assert contents((write(tmp_path / f"{way[:2]}.nc", WAYS[way]()),)).notes == ()
    deep = contents((write(tmp_path / "deep.nc", _deep([15.0], "m", "down")),))
    assert deep.notes == ("the currents are those at 15 m depth",)
    silent = dataset(SEA)
    for name in ("uo", "vo"):
        del silent[name].attrs["units"]
    assert any(
        "uo says no unit" in note
        for note in contents((write(tmp_path / "silent.nc", silent),)).notes
    )


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_packed_integers_and_their_fill_value(tmp_path: Path, suffix: str) -> None:
    holed = SEA.u.copy()
    holed[40:44, 40:50] = np.nan
    packing = {"dtype": "i2", "scale_factor": 1e-4, "add_offset": 0.05, "_FillValue": -32768}
    data = dataset(type(SEA)(LON, LAT, holed, SEA.v))
    path = write(tmp_path / f"packed{suffix}", data, uo=packing, vo=packing)
    whole = (100.0, -10.0, 139.5, 29.5)
    gaps = np.where(np.isnan(holed), np.nan, 1.0)
    agrees(read(path, box=whole), type(SEA)(LON, LAT, SEA.u * gaps, SEA.v * gaps), within=6e-5)


def test_classic_netcdf_is_read_too(tmp_path: Path) -> None:
    path = tmp_path / "classic.nc"
    dataset(SEA).to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")
    agrees(read(path), expected())


# --- across the seams ---------------------------------------------------------------------------

GLOBE = np.arange(0.0, 360.0, 2.0)
WORLD = sea(GLOBE, np.arange(-60.0, 61.0, 2.0), seed=4)


@pytest.mark.parametrize("first", [0.0, -180.0, 20.0])
@pytest.mark.parametrize("west", [-190.0, -21.0, 0.0, 170.0, 340.0])
@pytest.mark.parametrize("down", [False, True])
def test_a_region_across_a_seam_is_one_piece(
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


def test_a_longitude_that_comes_twice_is_taken_once(tmp_path: Path) -> None:
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
def test_a_window_has_every_node_inside_and_no_other(
    first: float, step: float, count: int, west: float, wide: float, *, down: bool
) -> None:
    lon = first + step * np.arange(count, dtype=float)
    lat = np.linspace(-60, 60, 41)
    held = Contents(
        files=(),
        lon=lon[::-1] if down else lon,
        lat=lat[::-1] if down else lat,
        u=(),
        v=(),
        steps=Steps(),
        u_places=(),
        v_places=(),
        notes=(),
        attributes={},
    )
    cut = cf_grid.window(held, (west, -30.0, west + wide, 30.0))
    numbers = [i for run in cut.columns for i in range(*run.indices(count))]
    assert len(numbers) == cut.lon.size
    assert (np.diff(cut.lon) > 0).all()
    for number, place in zip(numbers, cut.lon, strict=True):
        turns = (place - held.lon[number]) / 360
        assert abs(turns - round(turns)) < 1e-9
        assert west <= place <= west + wide
    inside = {
        round(float(value + 360 * turn), 6)
        for value in lon
        for turn in range(-3, 4)
        if west <= value + 360 * turn <= west + wide
    }
    assert len(cut.lon) >= len(inside) - 2 * (step * count >= 359)
    assert held.lat[cut.rows].tolist() == cut.lat.tolist() == [y for y in lat if -30 <= y <= 30]


# --- several files ------------------------------------------------------------------------------


def _days(count: int) -> list[Field]:
    return [sea(LON, LAT, seed=day) for day in range(count)]


def test_files_by_time_by_component_and_by_both_are_one(tmp_path: Path) -> None:
    fields = _days(4)
    days = [f"2024-07-0{day + 1}" for day in range(4)]
    whole = dataset(*fields, times=days)
    weights = {0: 0.5, 1: 0.0, 2: 0.25, 3: 0.25}
    reference = read(write(tmp_path / "whole.nc", whole), weights=weights)
    u = sum(w * f.u for w, f in zip(weights.values(), fields, strict=True))
    v = sum(w * f.v for w, f in zip(weights.values(), fields, strict=True))
    agrees(reference, expected(type(SEA)(LON, LAT, np.asarray(u), np.asarray(v))))
    by_time = [
        write(tmp_path / f"t{i}.nc", whole.isel(time=part))
        for i, part in enumerate(([2, 3], [0], [1]))
    ]
    agrees(read(*by_time, weights=weights), reference)
    agrees(read(tmp_path / "t?.nc", weights=weights), reference)
    parts = [write(tmp_path / "u.nc", whole[["uo"]]), write(tmp_path / "v.zarr", whole[["vo"]])]
    agrees(read(*parts, weights=weights), reference)
    both = [
        write(tmp_path / f"{name}{i}.nc", whole[[name]].isel(time=[i]))
        for name in ("uo", "vo")
        for i in range(4)
    ]
    agrees(read(*reversed(both), weights=weights), reference)


def test_a_gap_in_one_step_is_a_gap_in_the_mean(tmp_path: Path) -> None:
    first, second = _days(2)
    second.v[45, 45] = np.nan
    path = write(tmp_path / "two.nc", dataset(first, second, times=["2024-07-01", "2024-07-02"]))
    mean = read(path, weights={0: 0.5, 1: 0.5}, box=(122.0, 12.0, 123.0, 13.0))
    at = np.flatnonzero(mean.lon == LON[45]), np.flatnonzero(mean.lat == LAT[45])
    assert np.isnan(mean.u[at[1], at[0]]).all()
    assert np.isnan(mean.u).sum() == np.isnan(mean.v).sum() == 1


# --- what is refused, and why -------------------------------------------------------------------


def _no_velocity() -> xr.Dataset:
    data = dataset(SEA).rename(uo="thetao", vo="zos")
    data.thetao.attrs = {"standard_name": "sea_water_potential_temperature", "units": "degC"}
    del data.zos.attrs["standard_name"]
    return data


def _curvilinear() -> xr.Dataset:
    x, y = np.meshgrid(LON, LAT)
    axes = ("time", "y", "x")
    return xr.Dataset(
        {"uo": (axes, SEA.u[None], {"units": "m/s"}), "vo": (axes, SEA.v[None], {"units": "m/s"})},
        {"nav_lon": (("y", "x"), x + 0.1 * y), "nav_lat": (("y", "x"), y), "time": [0]},
    )


def _staggered() -> xr.Dataset:
    data = dataset(SEA)
    half = data.vo.assign_coords(
        longitude=("longitude", LON + 0.25, {"units": "degrees_east"})
    ).rename(longitude="longitude_v")
    return data.drop_vars("vo").assign(vo=half)


def _bounds_left_behind() -> xr.Dataset:
    data = dataset(SEA)
    data["lon_bnds"] = (("longitude", "nv"), np.stack([LON - 0.75, LON - 0.25], axis=1))
    data.longitude.attrs["bounds"] = "lon_bnds"
    return data


BAD: dict[str, tuple[Callable[[], xr.Dataset], list[str]]] = {
    "no velocity": (
        _no_velocity,
        [
            "no pair of current components among zos (no standard name), thetao (sea_water_pot",
            "eastward_sea_water_velocity and northward_sea_water_velocity",
            "uo/vo, ugos/vgos, u/v, utotal/vtotal",
        ],
    ),
    "one component": (lambda: dataset(SEA)[["uo"]], ["uo (eastward_sea_water_velocity)"]),
    "two pairs": (
        lambda: (
            dataset(SEA)
            .assign(uu=dataset(SEA).uo, vv=dataset(SEA).vo)
            .drop_vars(["uo"])
            .assign(uuu=dataset(SEA).uo)
        ),
        ["several variables are eastward_sea_water_velocity", "(uu, uuu, vo, vv)", "keep one"],
    ),
    "kelvin": (lambda: dataset(SEA, units="K"), ["uo is in 'K', not in m s-1", "true unit"]),
    "both components at once": (
        lambda: dataset(SEA, units="furlong/h"),
        ["uo is in 'furlong/h'", "vo is in 'furlong/h'"],
    ),
    "curvilinear": (_curvilinear, ["curvilinear (nav_lon is along y, x)", "cdo remapbil"]),
    "staggered": (_staggered, ["vo has other longitudes than uo", "staggered"]),
    "an ensemble": (
        lambda: xr.concat([dataset(SEA)] * 3, "member"),
        ["the dimension member (3)", "neither time, depth, latitude nor longitude"],
    ),
    "too deep": (
        lambda: _deep([92.3, 109.7], "m", "down"),
        ["uppermost level (depth) is 92.3 m deep", "surface"],
    ),
    "unsorted": (
        lambda: dataset(SEA).isel(latitude=[3, 1, 2, 0]),
        ["latitude neither ascends nor descends"],
    ),
    "a coordinate that is no number": (
        lambda: dataset(SEA).assign_coords(
            latitude=("latitude", np.where(LAT == 0, np.nan, LAT), {"units": "degrees_north"})
        ),
        ["latitude is no axis of a grid"],
    ),
    "bounds left behind": (_bounds_left_behind, ["longitude lies outside its own bounds"]),
}


@pytest.mark.parametrize("what", BAD)
def test_what_is_no_field_is_refused_with_what_was_found_and_what_is_needed(
    tmp_path: Path, what: str
) -> None:
    make, said = BAD[what]
    path = write(tmp_path / "bad.nc", make())
    with pytest.raises(RequestError) as caught:
        contents((path,))
    for words in ("bad.nc", *said):
        assert words in str(caught.value)


def test_files_that_are_missing_empty_cut_or_of_another_kind_are_all_told(tmp_path: Path) -> None:
    whole = write(tmp_path / "whole.nc", dataset(SEA)).read_bytes()
    (tmp_path / "cut.nc").write_bytes(whole[: len(whole) // 3])
    (tmp_path / "text.nc").write_text("lon,lat,u,v\n")
    (tmp_path / "empty.nc").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    with pytest.raises(RequestError) as caught:
        found([str(tmp_path / "absent.nc"), str(tmp_path / "*.grib")])
    assert "there is no file" in caught.value.faults[0]
    assert "no file fits the pattern" in caught.value.faults[1]
    names = ("cut.nc", "text.nc", "empty.nc", "folder")
    with pytest.raises(RequestError) as caught:
        contents(tuple(tmp_path / name for name in names))
    assert [fault.split()[0] for fault in caught.value.faults] == list(names)
    assert all("cdo -f nc copy" in fault for fault in caught.value.faults[1:])


@pytest.mark.parametrize(
    ("box", "said"),
    [
        ((99.74, 8, 122, 13), "west of 99.75 (the region reaches 99.74)"),
        ((117, -10.26, 122, 13), "south of -10.25"),
        ((117, 8, 139.76, 13), "east of 139.75"),
        ((117, 8, 122, 29.76), "north of 29.75"),
        ((-60, 8, -50, 13), "no figures there at all"),
        ((90, -20, 150, 40), "west of 99.75 (the region reaches 90) nor south of -10.25"),
    ],
)
def test_how_far_a_region_reaches_beyond_the_grid_is_told(
    tmp_path: Path, box: cf_grid.Bounds, said: str
) -> None:
    held = contents((write(tmp_path / "sea.nc", dataset(SEA)),))
    (fault,) = cf_grid.uncovered(held, box)
    assert said in fault
    assert cf_grid.uncovered(held, (99.76, -10.24, 139.74, 29.74)) == []


def test_a_region_round_the_far_side_of_the_grid_is_not_covered(tmp_path: Path) -> None:
    held = contents((write(tmp_path / "sea.nc", dataset(SEA)),))
    (fault,) = cf_grid.uncovered(held, (135.0, 0.0, 464.0, 10.0))
    assert "between 139.5 and 460 E" in fault


# --- memory -------------------------------------------------------------------------------------

BIG = """
import resource, sys
from pipeline.sources.currents.cf import grid as cf_grid
from pipeline.sources.currents.cf.contents import contents, found
import dask.array, netCDF4, numcodecs, xarray, zarr
held = contents(found(sys.argv[1:]))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
steps = len(held.steps.labels)
cut = cf_grid.window(held, (116.0, 7.0, 122.0, 13.0))
field = cf_grid.field(held, {i: 1 / steps for i in range(steps)}, cut)
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
    said = subprocess.run(
        [sys.executable, "-c", BIG, str(path)],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[5],
    ).stdout.split()
    assert 2 * 4 * steps * ny * nx > 6e9
    assert int(said[0]) < 200, "megabytes"
    # Step i has i/100 east and -i/50 north.
    assert [float(figure) for figure in said[1:]] == pytest.approx([0.445] * 2 + [-0.89] * 2)


def _axes(ny: int, nx: int) -> tuple[np.ndarray, np.ndarray]:
    return -90 + (np.arange(ny) + 0.5) / 12, -180 + (np.arange(nx) + 0.5) / 12


def _zarr(path: Path, shape: tuple[int, int, int], rows: slice, columns: slice) -> None:
    """Write the metadata of it all, and the chunks of one block only."""
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
def test_real_files_node_by_node(shared: Path, name: str, box: cf_grid.Bounds) -> None:
    file, u_name, v_name = REAL[name]
    path = shared / "data" / "currents" / file
    held = contents((path,))
    if cf_grid.uncovered(held, box):
        assert name == "cwb"
        return
    last = len(held.steps.labels) - 1
    field = cf_grid.field(held, {last: 1.0}, cf_grid.window(held, box))
    with netCDF4.Dataset(path) as raw:
        lon, lat = np.asarray(raw["longitude"][:]), np.asarray(raw["latitude"][:])
        u, v = (np.ma.filled(raw[key][last].astype(float), np.nan) for key in (u_name, v_name))
    rng = np.random.default_rng(0)
    for _ in range(200):
        j, i = rng.integers(field.lat.size), rng.integers(field.lon.size)
        away = np.abs((lon - field.lon[i] + 180) % 360 - 180)
        column, row = int(away.argmin()), int(np.abs(lat - field.lat[j]).argmin())
        assert away[column] < 1e-4
        assert np.array_equal(field.u[j, i], u[row, column], equal_nan=True)
        assert np.array_equal(field.v[j, i], v[row, column], equal_nan=True)


def test_no_message_holds_a_line_break_or_a_type(tmp_path: Path) -> None:
    for what, (make, _) in BAD.items():
        path = write(tmp_path / f"{what.replace(' ', '-')}.nc", make())
        with pytest.raises(RequestError) as caught:
            contents((path,))
        assert not re.search(r"\n|<class|Error\(", "".join(caught.value.faults))
