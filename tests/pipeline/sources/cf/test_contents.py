"""What the user's files contain: the same sea in all variants and divisions, or a refusal."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.model import Note
from pipeline.sources.cf.contents import find_files, read_contents
from pipeline.sources.current_field import Field
from tests.pipeline.sources.cf.sample_files import (
    LAT,
    LON,
    SEA,
    VARIANTS,
    assert_same,
    at_levels,
    expected,
    read,
    refusal,
)
from tests.pipeline.synthetic_currents import dataset, sea, write

# --- the same sea, written in many ways ---------------------------------------------------------


@pytest.mark.gate_share(7)
@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
@pytest.mark.parametrize("variant", VARIANTS)
def test_the_same_sea_is_read(tmp_path: Path, variant: str, suffix: str) -> None:
    path = write(tmp_path / f"sea{suffix}", VARIANTS[variant]())
    assert_same(read(path), expected())


def test_zarr_format_3_is_read(tmp_path: Path) -> None:
    dataset(SEA).to_zarr(tmp_path / "sea", zarr_format=3, consolidated=False)
    assert_same(read(tmp_path / "sea"), expected())


def test_classic_netcdf_is_read(tmp_path: Path) -> None:
    path = tmp_path / "classic.nc"
    dataset(SEA).to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")
    assert_same(read(path), expected())


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_packed_integers_and_their_fill_value(tmp_path: Path, suffix: str) -> None:
    u = SEA.u.copy()
    u[40:44, 40:50] = np.nan
    packing = {"dtype": "i2", "scale_factor": 1e-4, "add_offset": 0.05, "_FillValue": -32768}
    data = dataset(type(SEA)(LON, LAT, u, SEA.v))
    path = write(tmp_path / f"packed{suffix}", data, uo=packing, vo=packing)
    whole = (100.0, -10.0, 139.5, 29.5)
    gaps = np.where(np.isnan(u), np.nan, 1.0)
    assert_same(read(path, box=whole), type(SEA)(LON, LAT, SEA.u * gaps, SEA.v * gaps), within=6e-5)


def test_what_a_reader_should_know_is_noted(tmp_path: Path) -> None:
    for variant, text in (
        ("geostrophic", "without tide and wind drift"),
        ("km h-1", "uo is in km h-1: converted to m/s"),
        ("knots", "vo is in knots: converted"),
    ):
        path = write(tmp_path / f"{variant[:2]}.nc", VARIANTS[variant]())
        assert any(text in note for note in note_texts(read_contents((path,)).notes)), variant
    usual = write(tmp_path / "usual.nc", dataset(SEA))
    assert read_contents((usual,)).notes == ()
    deep = read_contents((write(tmp_path / "deep.nc", at_levels([15.0], "m", "down")),))
    assert deep.notes == (Note.of("current-at-depth", depth_m=15.0),)
    data = dataset(SEA)
    for name in ("uo", "vo"):
        del data[name].attrs["units"]
    notes = read_contents((write(tmp_path / "unitless.nc", data),)).notes
    assert any("uo has no unit" in note for note in note_texts(notes))


# --- several files ------------------------------------------------------------------------------


def _days(count: int) -> list[Field]:
    return [sea(LON, LAT, seed=day) for day in range(count)]


def test_files_by_time_by_component_and_by_both_are_combined(tmp_path: Path) -> None:
    fields = _days(4)
    days = [f"2024-07-0{day + 1}" for day in range(4)]
    whole = dataset(*fields, times=days)
    weights = {0: 0.5, 1: 0.0, 2: 0.25, 3: 0.25}
    reference = read(write(tmp_path / "whole.nc", whole), weights=weights)
    u = sum(w * f.u for w, f in zip(weights.values(), fields, strict=True))
    v = sum(w * f.v for w, f in zip(weights.values(), fields, strict=True))
    assert_same(reference, expected(type(SEA)(LON, LAT, np.asarray(u), np.asarray(v))))
    by_time = [
        write(tmp_path / f"t{i}.nc", whole.isel(time=part))
        for i, part in enumerate(([2, 3], [0], [1]))
    ]
    assert_same(read(*by_time, weights=weights), reference)
    assert_same(read(tmp_path / "t?.nc", weights=weights), reference)
    parts = [write(tmp_path / "u.nc", whole[["uo"]]), write(tmp_path / "v.zarr", whole[["vo"]])]
    assert_same(read(*parts, weights=weights), reference)
    both = [
        write(tmp_path / f"{name}{i}.nc", whole[[name]].isel(time=[i]))
        for name in ("uo", "vo")
        for i in range(4)
    ]
    assert_same(read(*reversed(both), weights=weights), reference)


# --- what is refused, and why -------------------------------------------------------------------


def _without_velocity() -> xr.Dataset:
    data = dataset(SEA).rename(uo="thetao", vo="zos")
    data.thetao.attrs = {"standard_name": "sea_water_potential_temperature", "units": "degC"}
    del data.zos.attrs["standard_name"]
    return data


def _staggered() -> xr.Dataset:
    data = dataset(SEA)
    half = data.vo.assign_coords(
        longitude=("longitude", LON + 0.25, {"units": "degrees_east"})
    ).rename(longitude="longitude_v")
    return data.drop_vars("vo").assign(vo=half)


BAD: dict[str, tuple[Callable[[], xr.Dataset], list[str]]] = {
    "no velocity": (
        _without_velocity,
        [
            "no pair of current components among zos (no standard name), thetao (sea_water_pot",
            "eastward_sea_water_velocity and northward_sea_water_velocity",
            "utotal/vtotal, uo/vo, ugos/vgos, u/v and the like",
        ],
    ),
    "one component": (lambda: dataset(SEA)[["uo"]], ["uo (eastward_sea_water_velocity)"]),
    "both components at once": (
        lambda: dataset(SEA, units="furlong/h"),
        ["uo is in 'furlong/h'", "vo is in 'furlong/h'"],
    ),
    "an ensemble": (
        lambda: xr.concat([dataset(SEA)] * 3, "member"),
        ["the dimension member (3)", "neither time, depth, latitude nor longitude"],
    ),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_components_are_refused_with_what_was_found_and_what_is_needed(
    tmp_path: Path, kind: str
) -> None:
    make, parts = BAD[kind]
    message = refusal(tmp_path, make)
    for part in ("bad.nc", *parts):
        assert part in message


def test_all_missing_and_unreadable_files_are_reported(tmp_path: Path) -> None:
    whole = write(tmp_path / "whole.nc", dataset(SEA)).read_bytes()
    (tmp_path / "cut.nc").write_bytes(whole[: len(whole) // 3])
    (tmp_path / "text.nc").write_text("lon,lat,u,v\n")
    (tmp_path / "empty.nc").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    with pytest.raises(RequestError) as caught:
        find_files([str(tmp_path / "absent.nc"), str(tmp_path / "*.grib")])
    assert "absent.nc does not exist; give a NetCDF, GRIB or Zarr file" in caught.value.faults[0]
    assert "no file matches the pattern" in caught.value.faults[1]
    names = ("cut.nc", "text.nc", "empty.nc", "folder")
    with pytest.raises(RequestError) as caught:
        read_contents(tuple(tmp_path / name for name in names))
    assert [fault.split(":")[0] for fault in caught.value.faults] == list(names)
    assert all("convert it to NetCDF" in fault for fault in caught.value.faults[1:])
