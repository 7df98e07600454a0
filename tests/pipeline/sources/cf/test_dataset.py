"""Damaged and odd files of currents are refused with one line, whatever the libraries raise."""

import json
import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import shapely

from pipeline.errors import RequestError
from pipeline.model import Land
from pipeline.scenario.season import Season
from pipeline.sources.cf import dataset as probing
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.cf.dataset import missing_bytes
from tests.pipeline.sources.cf.deadly_files import stand_in_probe
from tests.pipeline.sources.cf.sample_files import LAT, LON, SEA, read
from tests.pipeline.synthetic_currents import dataset, write

REGION = shapely.box(118.3, 9.3, 119.2, 10.4)
AXES = {
    "time": ([0.0], "days since 2024-07-01"),
    "latitude": (LAT, "degrees_north"),
    "longitude": (LON, "degrees_east"),
}


def refusal(path: Path | str) -> str:
    """Return the line with which files are refused before a run, and check their identity."""
    files = (str(path),)
    season = Season(name="summer", valid="2024-07-01", currents=(files,))
    source = CfFiles(files)
    assert source.identity(season)
    line = source.uncovered_reason(REGION, season)
    assert line
    assert line.isprintable()
    return line


def build(
    path: Path,
    axes: dict[str, tuple[Any, Any]] | None = None,
    *,
    kind: Any = "f4",  # noqa: ANN401 - what netCDF4 takes as a type
    axis_kind: Any = "f8",  # noqa: ANN401 - the same
    group: str = "",
    sizes: dict[str, int] | None = None,
    **options: object,
) -> Path:
    """Write a file of currents without values, with these axes, types and sizes."""
    axes = {**AXES, **(axes or {})}
    with netCDF4.Dataset(path, "w") as root:
        data = root.createGroup(group) if group else root
        for name, (values, units) in axes.items():
            data.createDimension(name, (sizes or {}).get(name, len(values)))
            axis = data.createVariable(name, axis_kind, (name,))
            axis.units = units
            if axis_kind is str:
                axis[:] = np.array([str(value) for value in values], dtype=object)
            elif len(values) == axis.size > 0:
                axis[:] = values
        for name in ("uo", "vo"):
            # The options are those of the call, whatever the stubs say.
            data.createVariable(name, kind, tuple(axes), **options).units = "m/s"  # type: ignore[call-overload]
    return path


def latitudes(values: object) -> dict[str, tuple[Any, Any]]:
    """Replace the latitudes of a file."""
    return {"latitude": (values, "degrees_north")}


def times(values: object, units: object) -> dict[str, tuple[Any, Any]]:
    """Replace the times of a file."""
    return {"time": (values, units)}


def with_compound(path: Path) -> Path:
    """Write components that are pairs of numbers."""
    with netCDF4.Dataset(path, "w") as data:
        for name, (values, _) in AXES.items():
            data.createDimension(name, len(values))  # type: ignore[arg-type]  # an array
        pair = data.createCompoundType(np.dtype([("a", "f4"), ("b", "i4")]), "pair")
        for name in ("uo", "vo"):
            data.createVariable(name, pair, tuple(AXES))
    return path


def with_attribute(path: Path, name: str, value: object) -> Path:
    """Write a file one of whose components has an odd attribute."""
    write(path, dataset(SEA))
    with netCDF4.Dataset(path, "a") as data:
        data["uo"].setncattr(name, value)
    return path


HUGE = {"latitude": 10**6, "longitude": 10**6}
BAD: dict[str, tuple[Callable[[Path], Path], list[str]]] = {
    "an empty axis": (lambda p: build(p, latitudes([])), ["uo is empty", "latitude"]),
    "an axis of one": (lambda p: build(p, latitudes([9.5])), ["latitude is no axis", "1 values"]),
    "NaN in an axis": (
        lambda p: build(p, latitudes(np.where(LAT == 0, np.nan, LAT))),
        ["latitude is no axis"],
    ),
    "a value twice": (
        lambda p: build(p, latitudes(np.where(LAT == 0, 0.5, LAT))),
        ["latitude neither ascends nor descends, or has values twice"],
    ),
    "metres as latitudes": (
        lambda p: build(p, latitudes(LAT * 1e5)),
        ["latitude reaches from -1e+06", "no degrees of latitude"],
    ),
    "axes of text": (lambda p: build(p, axis_kind=str), ["holds text, not numbers"]),
    "components of characters": (lambda p: build(p, kind="S1"), ["uo holds text, not numbers"]),
    "components of pairs": (with_compound, ["uo holds another type, not numbers"]),
    "groups alone": (
        lambda p: build(p, group="surface"),
        ["among no variables; needed", "groups (surface) are not read", "ncks -G : -g surface"],
    ),
    "times that are none": (
        lambda p: build(p, times([0.0], "days after lunch")),
        ["time is no time: units 'days after lunch'", "hours since"],
    ),
    "units of time as a number": (lambda p: build(p, times([0.0], 5)), ["time is no time"]),
    "times beyond the calendar": (
        lambda p: build(p, times([1e30], "days since 2024-07-01")),
        ["time is no time"],
    ),
    "the end of all time": (
        lambda p: build(p, times([364.9999999], "days since 9999-01-01")),
        ["time is no time"],
    ),
    "the year 9964": (
        lambda p: build(p, times([2.9e6], "days since 2024-07-01")),
        ["time reaches the year 9964"],
    ),
    "a time that is NaN": (
        lambda p: build(p, times([np.nan], "days since 2024-07-01")),
        ["not finite"],
    ),
    "the same time twice": (
        lambda p: build(p, times([0.0, 0.0], "days since 2024-07-01")),
        ["two steps of 2024-07-01"],
    ),
    "a million times a million nodes": (
        lambda p: build(p, sizes=HUGE),
        ["has 1,000,000 values, more than 500,000"],
    ),
    "too many nodes in the region": (
        lambda p: build(
            p,
            {
                "latitude": (np.linspace(9, 11, 5000), "degrees_north"),
                "longitude": (np.linspace(118, 120, 5000), "degrees_east"),
            },
        ),
        ["nodes in the region, more than 2,000,000", "coarser"],
    ),
    "one chunk of 1.5 GB": (
        lambda p: build(
            p,
            {
                "latitude": (np.linspace(-80, 80, 20_000), "degrees_north"),
                "longitude": (np.linspace(-180, 180, 20_000), "degrees_east"),
            },
            chunksizes=(1, 20_000, 20_000),
            zlib=True,
        ),
        ["uo is stored in chunks of 1,525 MB", "nccopy -c"],
    ),
    "numbers as a standard name": (
        lambda p: with_attribute(p, "standard_name", np.array([1.0, 2.0])),
        ["no pair of current components", "uo ([1. 2.])"],
    ),
    "a number as a unit": (lambda p: with_attribute(p, "units", 5), ["uo is in '5'"]),
}


@pytest.mark.gate_share(8)
@pytest.mark.parametrize("kind", BAD)
def test_odd_files_are_refused_without_reading_what_they_declare(tmp_path: Path, kind: str) -> None:
    make, parts = BAD[kind]
    path = make(tmp_path / "odd.nc")
    tracemalloc.start()
    line = refusal(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    for part in ("odd.nc: ", *parts):
        assert part in line
    assert peak < 200e6


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
@pytest.mark.parametrize("file_format", ["NETCDF4", "NETCDF3_64BIT"])
def test_truncated_files_are_refused(tmp_path: Path, share: float, file_format: Any) -> None:  # noqa: ANN401
    path = tmp_path / "field.nc"
    dataset(SEA).to_netcdf(path, engine="netcdf4", format=file_format)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    assert "field.nc: it can't be read" in refusal(path)


@pytest.mark.parametrize("damage", ["no metadata", "broken metadata", "a FIFO", "a huge shape"])
def test_damaged_zarr_stores_are_refused(tmp_path: Path, damage: str) -> None:
    path = write(tmp_path / "field.zarr", dataset(SEA))
    array = path / "latitude" / ".zarray"
    if damage == "no metadata":
        array.unlink()
    elif damage == "broken metadata":
        array.write_text("{")
    elif damage == "a FIFO":
        chunk = path / "uo" / "0.0.0"
        chunk.unlink()
        os.mkfifo(chunk)
        assert "uo/0.0.0 is a FIFO" in refusal(path)
        return
    else:
        array.write_text(json.dumps({**json.loads(array.read_text()), "shape": [10**12]}))
    assert "field.zarr: " in refusal(path)


@pytest.mark.parametrize("damage", ["a chunk of ones", "text as a scale"])
def test_damage_to_values_is_refused_when_they_are_read(tmp_path: Path, damage: str) -> None:
    if damage == "text as a scale":
        path = with_attribute(tmp_path / "field.nc", "scale_factor", "x")
    else:
        path = write(tmp_path / "field.zarr", dataset(SEA))
        chunk = path / "uo" / "0.0.0"
        chunk.write_bytes(b"\xff" * chunk.stat().st_size)
    files = (str(path),)
    season = Season(name="summer", valid="2024-07-01", currents=(files,))
    source = CfFiles(files)
    assert source.uncovered_reason(REGION, season) == ""
    with pytest.raises(RequestError, match=rf"{path.name}: it can't be read: .*; fetch it again"):
        source.current(REGION, season, Land((), (), 0.0), tmp_path)


def test_a_link_to_nothing_is_refused_with_what_it_leads_to(tmp_path: Path) -> None:
    (tmp_path / "dangling.nc").symlink_to("nowhere.nc")
    said = refusal(tmp_path / "dangling.nc")
    assert "link to nowhere.nc, which does not exist" in said


def test_a_folder_that_is_no_store_is_not_searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def searched(*arguments: object) -> None:
        raise AssertionError(arguments)

    monkeypatch.setattr(Path, "rglob", searched)
    assert "neither NetCDF, Zarr, GRIB nor S-100" in refusal(tmp_path)


# --- Classic NetCDF files that end too early are found: the library reads zeros beyond their end.


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


# --- Files on which the HDF5 library hangs or crashes are found in a process of their own.


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put a function in the probe's place: no file is known to crash every version of a library."""
    monkeypatch.setattr(probing, "probe", stand_in_probe)
    monkeypatch.setattr(probing, "_load_libraries", float)
    monkeypatch.setattr(probing, "_FILE_S", 2.0)


@pytest.mark.usefixtures("stand_in")
def test_each_fatal_file_is_named_and_the_others_are_not(tmp_path: Path) -> None:
    names = ("a.nc", "crash.nc", "b.nc", "hang.nc", "crash-too.nc", "c.nc")
    files = [tmp_path / name for name in names]
    for file in files:
        file.write_bytes(b"\x89HDF")
    found = probing.fatal_files(files)
    assert [file.name for file in found] == ["crash.nc", "hang.nc", "crash-too.nc"]
    assert "the HDF5 library ends by SIGSEGV on it" in found[files[1]]
    assert "the HDF5 library hangs on it; fetch it again" in found[files[3]]


def test_whole_and_cut_files_are_left_to_the_reader(tmp_path: Path) -> None:
    whole = write(tmp_path / "whole.nc", dataset(SEA))
    cut = tmp_path / "cut.nc"
    cut.write_bytes(whole.read_bytes()[:5000])
    assert probing.fatal_files([whole, cut]) == {}
