"""Damaged charts, currents and depths end a run with some lines, whatever the libraries do."""

import json
import random
import shutil
import struct
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import shapely

from pipeline.sources.current_field import LandMask
from tests.pipeline.sources import depth_grids
from tests.pipeline.sources.mutations import ISLAND, MUTATIONS, copied, make_charts, make_currents
from tests.pipeline.synthetic_currents import dataset, sea
from tests.robustness.limits import draw, number
from tests.robustness.renew_processes import Renew
from tests.robustness.test_scenario_files import places_in

_REGION = """schema_version = 1
name = "damaged"
vessel = {{ length_m = 20, speed_m_s = 5, turn_rate_deg_s = 3, draught_m = 4 }}
start = {start}
goal = {goal}
[region]
bbox = {bbox}
[chart]
source = {{ path = "./{chart}", radius_m = 50, accuracy_m = 50, complete = true{crs} }}
tolerance_m = 500
{depths}
[[seasons]]
name = "summer"
valid = "2024-07-01"
currents = ["{currents}"]
[planner]
classes = 1
padding = "none"
"""
# Region, start and goal: beside the made-up island, and in Boston's harbour.
_AROUND_ISLAND = {"bbox": [118.3, 9.2, 119.7, 10.7], "start": [118.4, 9.4], "goal": [119.5, 9.3]}
_IN_BOSTON = {"bbox": [-70.99, 42.31, -70.96, 42.34], "start": [-70.985, 42.335]}
_BOSTON_GOAL = {"goal": [-70.965, 42.335]}
_ODD_JSON = (
    *("null", "true", '"x"', "-1", "0", "1e999", "[]", "{}", "[-1]", "[0, 0]", "NaN", '"<f9"'),
    *("[1e9, 1e9]", "[1000000000, 1000000000, 1000000000]", "18446744073709551616", '"|O"'),
    *('[["x", "<i4"]]', "[[[]]]", '"bytes"', '"regular"', "3.5", '"NaN"', '"AAAA"'),
)


def make_originals(folder: Path, mask: LandMask, cells: Path | None) -> dict[str, Path]:
    """Write undamaged files of all kinds, by their kind."""
    found = {**make_charts(folder, cells), **make_currents(folder, mask)}
    found |= _more_charts(folder)
    field = sea(np.arange(117.5, 121.0, 0.25), np.arange(8.5, 11.5, 0.25))
    data = dataset(field, field, times=["2024-07-01", "2024-07-02"])
    chunks = {name: {"chunks": (1, 6, 7)} for name in ("uo", "vo")}
    found["zarr3"] = folder / "three.zarr"
    data.to_zarr(found["zarr3"], zarr_format=3, consolidated=False, encoding=chunks)
    found["zarr-consolidated"] = folder / "consolidated.zarr"
    data.to_zarr(found["zarr-consolidated"], zarr_format=2, consolidated=True, encoding=chunks)
    found["zarr3-consolidated"] = folder / "consolidated-three.zarr"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it is not part of the format yet, though it is written
        data.to_zarr(found["zarr3-consolidated"], zarr_format=3, consolidated=True)
    found["zarr-shards"] = folder / "shards.zarr"
    shards = {name: {"chunks": (1, 4, 4), "shards": (1, 8, 8)} for name in ("uo", "vo")}
    data.to_zarr(found["zarr-shards"], zarr_format=3, consolidated=False, encoding=shards)
    for kind, form in (
        ("netcdf3-plain", "NETCDF3_CLASSIC"),
        ("netcdf3-data", "NETCDF3_64BIT_DATA"),
    ):
        found[kind] = folder / f"{kind}.nc"
        _write_netcdf3(found[kind], data, form)
    return found | _depths(folder)


def _write_netcdf3(path: Path, data: Any, form: Any) -> None:  # noqa: ANN401 - xarray, netCDF4
    """Write a dataset in one of the classic formats, with a time that has no end."""
    with netCDF4.Dataset(path, "w", format=form) as file:
        file.createDimension("time", None)
        for name in ("latitude", "longitude"):
            file.createDimension(name, data.sizes[name])
            axis = file.createVariable(name, "f8", (name,))
            axis.units = data[name].attrs["units"]
            axis[:] = data[name].values
        time = file.createVariable("time", "f8", ("time",))
        time.units = "days since 2024-07-01"
        time[:] = [0.0, 1.0]
        for name in ("uo", "vo"):
            values = file.createVariable(name, "f4", ("time", "latitude", "longitude"))
            values.units = "m s-1"
            values[:] = data[name].values


def _more_charts(folder: Path) -> dict[str, Path]:
    """Write charts in formats of text."""
    found = {}
    for suffix in (".kml", ".csv"):
        found[suffix] = folder / suffix[1:] / f"land{suffix}"
        found[suffix].parent.mkdir()
    ring = " ".join(f"{x},{y}" for x, y in ISLAND.exterior.coords)
    found[".kml"].write_text(
        '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>'
        "<name>island</name><Polygon><outerBoundaryIs><LinearRing><coordinates>"
        f"{ring}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>"
    )
    found[".csv"].write_text(f'id,WKT\n1,"{ISLAND.wkt}"\n')
    return found


def _depths(folder: Path) -> dict[str, Path]:
    """Write grids of depths: NetCDF of both kinds."""
    lon, lat = np.arange(118.0, 120.0, 0.05), np.arange(9.0, 11.0, 0.05)
    inside = shapely.contains_xy(ISLAND, *np.meshgrid(lon, lat))
    found = {}
    for kind, form in (("depths", "NETCDF4"), ("depths-classic", "NETCDF3_CLASSIC")):
        found[kind] = folder / f"{kind}.nc"
        heights = np.where(inside, 20, -50).astype("i2")
        data = depth_grids.dataset(lon, lat, heights, "elevation", units="m")
        data.to_netcdf(found[kind], format=form)  # type: ignore[call-overload]
    return found


def change_zarr(file: Path, rng: random.Random) -> None:
    """Change one of a store's metadata, or what its folder holds."""
    metadata = [
        one
        for one in file.rglob("*")
        if one.name in {"zarr.json", ".zarray", ".zattrs", ".zmetadata"}
    ]
    chunks = [one for one in file.rglob("*") if one.is_file() and one not in metadata]
    kind = rng.random()
    if kind < 0.6 or not chunks:
        path = rng.choice(metadata)
        text = path.read_text("utf-8")
        data = json.loads(text)
        places = places_in(data)
        if places:
            *upper, key = rng.choice(places)
            owner: Any = data
            for step in upper:
                owner = owner[step]
            if rng.random() < 0.2:
                del owner[key]
            else:
                owner[key] = json.loads(rng.choice(_ODD_JSON))
        path.write_text(json.dumps(data))
    elif kind < 0.7:
        for one in rng.sample(chunks, rng.randrange(1, len(chunks) + 1)):
            one.unlink()
    elif kind < 0.85:
        one = rng.choice(chunks)
        content = one.read_bytes()
        one.write_bytes(
            rng.choice((b"", content[: len(content) // 2], content + content, b"\xff" * 99))
        )
    else:
        one = rng.choice(chunks)
        one.unlink()
        rng.choice(
            (one.mkdir, lambda: one.symlink_to(one.name), lambda: one.symlink_to("/dev/zero"))
        )()


def change_s57(file: Path, rng: random.Random) -> None:
    """Change lengths and tags in the records of a cell (ISO 8211), or mix up its updates."""
    parts = sorted(file.glob("*.0??"))
    part = rng.choice(parts)
    content = bytearray(part.read_bytes())
    begins, at = [], 0
    while at + 5 <= len(content) and content[at : at + 5].isdigit() and int(content[at : at + 5]):
        begins.append(at)
        at += int(content[at : at + 5])
    kind, begin = rng.randrange(7), rng.choice(begins)
    if kind == 0:
        content[begin : begin + 5] = rng.choice((b"00000", b"99999", b"-0001", b"00024", b"     "))
    elif kind == 1:
        content[begin + 12 : begin + 17] = rng.choice((b"00000", b"99999", b"00024", b"abcde"))
    elif kind == 2:
        content[begin + 20 : begin + 24] = rng.choice((b"0000", b"9999", b"1104", b"5504"))
    elif kind == 3:
        size = int(content[begin : begin + 5])
        content[begin:begin] = content[begin : begin + size] * rng.choice((1, 2, 500))
    elif kind == 4:
        del content[begin : begin + int(content[begin : begin + 5])]
    elif kind == 5:
        content = bytearray(rng.choice(parts).read_bytes())
    else:
        # Numbers in the middle of a record: coordinates, references, counts.
        size = int(content[begin : begin + 5])
        for _ in range(rng.choice((1, 4, 50))):
            spot = begin + rng.randrange(24, max(size - 4, 25))
            content[spot : spot + 4] = struct.pack(
                "<i", rng.choice((0, -1, 2**31 - 1, -(2**31), 1))
            )
    part.write_bytes(content)


_CHANGES: dict[str, tuple[Callable[[Path, random.Random], None], ...]] = {
    **MUTATIONS,
    "s57": (*MUTATIONS["s57"], change_s57, change_s57, change_s57),
    "zarr": (*MUTATIONS["zarr"], change_zarr, change_zarr, change_zarr),
    **dict.fromkeys(
        ("zarr3", "zarr-consolidated", "zarr3-consolidated", "zarr-shards"),
        (*MUTATIONS["zarr"], change_zarr, change_zarr, change_zarr, change_zarr),
    ),
    **dict.fromkeys(("netcdf3-plain", "netcdf3-data", "depths-classic"), MUTATIONS["netcdf3"]),
    "depths": MUTATIONS["netcdf4"][:-2],
    **dict.fromkeys((".kml", ".csv"), MUTATIONS[".fgb"]),
}


def damaged_scenario(
    rng: random.Random, originals: dict[str, Path], kind: str, folder: Path
) -> str:
    """Write a scenario with a damaged file of a kind to a new folder; say what was done to it."""
    file = copied(originals[kind], folder)
    change = rng.choice(_CHANGES[kind])
    change(file, rng)
    is_depths, is_current = kind.startswith("depths"), _is_current(kind)
    is_boston = kind == "s57"
    chart = file.name
    if is_depths or is_current:
        chart = copied(originals[".geojson"], folder).name
    text = _REGION.format(
        **(_IN_BOSTON | _BOSTON_GOAL if is_boston else _AROUND_ISLAND),
        chart=chart,
        crs=', crs = "EPSG:4326"' if kind == ".csv" else "",
        depths=f'depths = "./{file.name}"' if is_depths else "",
        currents=f"./{file.name}" if is_current else "still",
    )
    (folder / "damaged.toml").write_text(text)
    return f"{kind}, {change.__name__}"


def _is_current(kind: str) -> bool:
    """Whether files of a kind are currents."""
    return kind.startswith(("netcdf", "zarr", "packed", "grib"))


def failures(folder: Path, originals: dict[str, Path], cases: range, renew: Renew) -> list[str]:
    """Run scenarios on damaged files; describe what went wrong."""
    found, kinds = [], list(originals)
    for case in cases:
        rng, place = draw("damaged files", case), folder / str(case)
        what = damaged_scenario(rng, originals, kinds[case % len(kinds)], place)
        arguments = ["run", "damaged.toml", "--offline"]
        ended = renew(arguments, place, limit_s=40.0)
        if why := ended.fault():
            found.append(f"damaged file {case}, {what}: {why}")
        shutil.rmtree(place)
    return found


@pytest.mark.slow
def test_many_damaged_files(tmp_path: Path, shared: Path) -> None:
    cells = shared / "data" / "charts"
    (tmp_path / "originals").mkdir()
    originals = make_originals(
        tmp_path / "originals", LandMask.world(), cells if cells.is_dir() else None
    )
    files = number("damaged_files", 200)
    with Renew() as renew:
        found = failures(tmp_path, originals, range(files), renew)
        print(f"{files} damaged files: {dict(renew.met)}")  # noqa: T201
    assert not found, "\n".join(found)
    assert renew.met["exit 0"] > files / 20
    assert renew.met["exit 2"] + renew.met["exit 1"] > files / 4
