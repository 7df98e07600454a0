"""Charts and currents as users have them, and seeded damage to them."""

import json
import random
import re
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pyogrio
import shapely

from pipeline.sources.current_field import LandMask
from tests.pipeline.sources.cf.grib_files import write_grib
from tests.pipeline.synthetic_currents import coastal, dataset, sea, write

ISLAND = shapely.Polygon(
    [(118.6, 9.5), (119.4, 9.6), (119.3, 10.4), (118.7, 10.3)],
    [[(118.9, 9.9), (119.1, 9.9), (119.0, 10.1)]],
)
# What stands for a number, or a word, in damaged text.
_ODD_VALUES = (
    *("NaN", "Infinity", "-1e12", "1e300", "1e999", "91", "181", "0", "null", "true", '"10"', "[]"),
    *("{}", "[[1, 2]]", "1e-320", "9" * 400, "", '"\\u0000"'),
)
_ODD_NUMBERS = (np.nan, np.inf, -np.inf, 1e30, -1e30, 1e300, 0.0, -1.0, 361.0, 1e-300)
_ODD_ATTRIBUTES: tuple[Any, ...] = (
    *("", "x", "days since the flood", "m/s", "degrees_east", "since", "\u00e9" * 300, 5, np.nan),
    *(np.array([1.0, 2.0]), np.array([], dtype=float), 1e300, np.int8(-1), "360_day", "time"),
)


def make_charts(folder: Path, cells: Path | None) -> dict[str, Path]:
    """Write an island in several formats; with S-57 cells where these are there."""
    rock, wall = shapely.Point(119.6, 10.6), shapely.LineString([(119.6, 9.2), (119.6, 9.4)])
    many = [shapely.affinity.translate(ISLAND, 0.01 * i, 0.0) for i in range(20)]
    found = {}
    for suffix in (".geojson", ".gpkg", ".shp", ".fgb"):
        geometries = [*many, rock, wall] if suffix in {".geojson", ".gpkg"} else many
        kind = "Unknown" if suffix in {".geojson", ".gpkg"} else "Polygon"
        place = folder / suffix[1:]
        place.mkdir()
        pyogrio.raw.write(
            place / f"land{suffix}",
            shapely.to_wkb(np.array(geometries, dtype=object)),
            field_data=[np.arange(len(geometries))],
            fields=["id"],
            geometry_type=kind,
            crs="EPSG:4326",
        )
        found[suffix] = place / f"land{suffix}"
    if cells is not None:
        found["s57"] = folder / "s57"
        found["s57"].mkdir()
        for file in sorted(cells.glob("US5BOSCD.*")):
            shutil.copyfile(file, found["s57"] / file.name)
    return found


def make_currents(folder: Path, mask: LandMask) -> dict[str, Path]:
    """Write a sea around Palawan in several formats."""
    field = coastal(sea(np.arange(108.0, 130.0, 0.5), np.arange(0.0, 20.0, 0.5), seed=2), mask)
    data = dataset(field, field, field, times=["2024-07-01", "2024-07-02", "2024-07-03"])
    packed = {"dtype": "i2", "scale_factor": 1e-3, "_FillValue": -32767, "zlib": True}
    classic = folder / "classic.nc"
    data.to_netcdf(classic, engine="netcdf4", format="NETCDF3_64BIT")
    return {
        "netcdf4": write(folder / "plain.nc", data),
        "packed": write(folder / "packed.nc", data, uo=packed, vo=packed),
        "netcdf3": classic,
        "zarr": write(folder / "store.zarr", data),
        "grib1": write_grib(folder / "edition1.grb", data, 1),
        "grib2": write_grib(folder / "edition2.grb", data, 2),
    }


def copied(file: Path, folder: Path) -> Path:
    """Copy a file with its sidecar files, or a folder, to another folder."""
    if file.is_dir():
        return shutil.copytree(file, folder / file.name)
    folder.mkdir(parents=True, exist_ok=True)
    for part in file.parent.glob(f"{file.stem}.*"):
        shutil.copyfile(part, folder / part.name)
    return folder / file.name


def parts(file: Path) -> list[Path]:
    """List a file and its sidecar files, or the files of a folder."""
    if file.is_dir():
        return sorted(part for part in file.rglob("*") if part.is_file())
    return sorted(file.parent.glob(f"{file.stem}.*"))


# --- damage to any file -------------------------------------------------------------------------


def flip_bytes(file: Path, rng: random.Random) -> None:
    """Change some bytes, more often near the beginning, where the structure is."""
    part = rng.choice(parts(file))
    content = bytearray(part.read_bytes())
    for _ in range(rng.choice((1, 1, 2, 5, 20, 100)) if content else 0):
        within = len(content) if rng.random() < 0.5 else min(len(content), 2048)
        content[rng.randrange(within)] = rng.randrange(256)
    part.write_bytes(content)


def truncate(file: Path, rng: random.Random) -> None:
    """Cut a file off."""
    part = rng.choice(parts(file))
    content = part.read_bytes()
    part.write_bytes(content[: rng.randrange(len(content) + 1)])


def overwrite(file: Path, rng: random.Random) -> None:
    """Replace a block by zeros, by ones, or by another part of the file."""
    part = rng.choice(parts(file))
    content = bytearray(part.read_bytes())
    if content:
        at, length = rng.randrange(len(content)), rng.choice((4, 64, 512, 4096))
        end = min(at + length, len(content))
        source = rng.randrange(len(content))
        block = rng.choice((b"\0" * length, b"\xff" * length, content[source : source + length]))
        content[at:end] = block[: end - at]
        part.write_bytes(content)


def remove(file: Path, rng: random.Random) -> None:
    """Remove one of several files."""
    others = [part for part in parts(file) if part != file]
    if others:
        rng.choice(others).unlink()
    else:
        truncate(file, rng)


# --- damage to the structure --------------------------------------------------------------------


def change_text(file: Path, rng: random.Random) -> None:
    """Replace, repeat or remove a token of a text file, such as GeoJSON or Zarr's metadata."""
    files = [part for part in parts(file) if part.suffix in {".geojson", ".json"}]
    files += [part for part in parts(file) if part.name in {".zarray", ".zattrs", ".zgroup"}]
    part = rng.choice(files)
    text = part.read_text("utf-8")
    for _ in range(rng.choice((1, 1, 3))):
        tokens = _tokens(text)
        begin, end = tokens[rng.randrange(len(tokens))]
        token = text[begin:end]
        new = rng.choice((rng.choice(_ODD_VALUES), rng.choice(_ODD_VALUES), token * 2, ""))
        text = text[:begin] + new + text[end:]
        if not text.strip():
            break
    part.write_text(text, encoding="utf-8")


def _tokens(text: str) -> list[tuple[int, int]]:
    """Begin and end of each number, string and bracket in a text; of all of it where none is."""
    found = re.finditer(r'-?\d[\d.eE+-]*|"[^"]*"|[\[\]{},:]|\w+', text)
    return [match.span() for match in found] or [(0, len(text))]


def change_geojson(file: Path, rng: random.Random) -> None:
    """Change one geometry of a GeoJSON file: its type, or the depth or number of its points."""
    data = json.loads(file.read_text("utf-8"))
    geometry = rng.choice(data["features"])["geometry"]
    ring = geometry["coordinates"][0] if geometry["type"] == "Polygon" else geometry["coordinates"]
    point = ring[0] if isinstance(ring[0], list) else ring

    def retype() -> None:
        kinds = ("Polygon", "MultiPolygon", "LineString", "Point", "MultiPoint", "Circle", None)
        geometry["type"] = rng.choice(kinds)

    changes: tuple[Callable[[], object], ...] = (
        retype,
        lambda: geometry.update(coordinates=rng.choice(([], [[]], [[[]]], None, "here", 5))),
        lambda: geometry.update(coordinates=[geometry["coordinates"]]),
        ring.pop,
        ring.clear,
        ring.reverse,
        lambda: point.append(rng.choice((5, None, "up", [1]))),
        point.pop,
        lambda: point.__setitem__(0, rng.choice((None, "119", 1e12, -1e300, [118], True))),
        lambda: data["features"].append(rng.choice((None, 5, {}, {"type": "Feature"}, []))),
        lambda: data.update(features=rng.choice(([], None, {}, "none"))),
        lambda: data.update(crs=rng.choice((5, {}, {"type": "name", "properties": {"name": "x"}}))),
    )
    rng.choice(changes)()
    file.write_text(json.dumps(data), encoding="utf-8")


def change_geopackage(file: Path, rng: random.Random) -> None:
    """Change the tables of a GeoPackage."""
    commands = (
        "UPDATE gpkg_geometry_columns SET srs_id = 999999",
        "UPDATE gpkg_geometry_columns SET geometry_type_name = 'POINT'",
        "UPDATE gpkg_geometry_columns SET column_name = 'nowhere'",
        "UPDATE gpkg_contents SET data_type = 'attributes'",
        "UPDATE gpkg_contents SET min_x = 'x', max_x = NULL",
        "UPDATE gpkg_spatial_ref_sys SET definition = 'nonsense'",
        "UPDATE gpkg_spatial_ref_sys SET definition = '', organization = 'NONE'",
        "DELETE FROM gpkg_contents",
        "DELETE FROM gpkg_geometry_columns",
        "DELETE FROM gpkg_spatial_ref_sys",
        "DELETE FROM land",
        "UPDATE land SET geom = NULL",
        "UPDATE land SET geom = x'00' WHERE fid = 1",
        "UPDATE land SET geom = 'text' WHERE fid = 2",
        "UPDATE land SET geom = zeroblob(60) WHERE fid = 3",
        "UPDATE land SET geom = substr(geom, 1, 50) WHERE fid = 4",
        "DROP TABLE rtree_land_geom",
        "DROP TABLE gpkg_contents",
        "DROP TABLE land",
    )
    with closing(sqlite3.connect(file, isolation_level=None)) as base:
        base.execute("PRAGMA trusted_schema = ON")
        # The triggers of its spatial index need functions that SQLite itself does not have.
        triggers = base.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'")
        for (name,) in triggers.fetchall():
            base.execute(f'DROP TRIGGER "{name}"')
        for command in rng.sample(commands, rng.choice((1, 1, 2))):
            with suppress(sqlite3.Error):
                base.execute(command)


def change_netcdf(file: Path, rng: random.Random) -> None:
    """Change values or attributes of a NetCDF file."""
    with netCDF4.Dataset(file, "a") as data:
        data.set_auto_maskandscale(False)
        for _ in range(rng.choice((1, 1, 2))):
            variable = data[rng.choice(list(data.variables))]
            rng.choice((_change_values, _change_attribute, _change_attribute))(variable, rng)


def _change_values(variable: Any, rng: random.Random) -> None:  # noqa: ANN401 - netCDF4 has no types
    """Change values of a variable: one, all, their order, or their size."""
    values = np.asarray(variable[:])
    flat = values.reshape(-1)
    with np.errstate(all="ignore"):
        odd = np.asarray(rng.choice(_ODD_NUMBERS)).astype(values.dtype)
        changes: tuple[Callable[[], object], ...] = (
            lambda: flat.__setitem__(rng.randrange(flat.size), odd),
            lambda: flat.fill(odd),
            lambda: flat.__setitem__(slice(None), flat[::-1].copy()),
            lambda: flat.__setitem__(slice(1, None), flat[:-1].copy()),
            lambda: flat.__setitem__(slice(None), np.sort(flat)[rng.randrange(flat.size)]),
            lambda: flat.__setitem__(slice(None), (flat * 1e6).astype(flat.dtype)),
        )
        rng.choice(changes)()
    variable[:] = values


def _change_attribute(variable: Any, rng: random.Random) -> None:  # noqa: ANN401 - as above
    """Change or remove an attribute of a variable."""
    known = [*variable.ncattrs(), "units", "calendar", "scale_factor", "missing_value", "bounds"]
    known += ["standard_name", "positive", "axis", "coordinates", "climatology", "valid_range"]
    name = rng.choice([name for name in known if name != "_FillValue"])
    if name in variable.ncattrs() and rng.random() < 0.3:
        variable.delncattr(name)
    else:
        variable.setncattr(name, rng.choice(_ODD_ATTRIBUTES))


def build_netcdf(file: Path, rng: random.Random) -> None:
    """Write another file with odd dimensions, types and groups in a file's place."""
    file.unlink()
    kinds = ("f4", "f8", "i2", "i8", "u1", "S1", str)
    with netCDF4.Dataset(file, "w") as root:
        data = root.createGroup("surface") if rng.random() < 0.1 else root
        names = ["time", "latitude", "longitude"] + ["depth"] * (rng.random() < 0.3)
        for name in names:
            size = rng.choice((0, 1, 2, 3, 40, 40, 400, 10**6, 10**9))
            data.createDimension(name, size if rng.random() < 0.9 else None)
            if rng.random() < 0.9:
                kind = rng.choice(kinds) if rng.random() < 0.2 else "f8"
                axis = data.createVariable(name, kind, (name,))
                axis.units = {"time": "days since 2024-07-01", "depth": "m"}.get(
                    name, "degrees_north" if name == "latitude" else "degrees_east"
                )
                if kind == "f8" and 0 < size <= 10**6:
                    low, high = {"latitude": (0, 20), "longitude": (108, 130)}.get(name, (0, size))
                    axis[:] = np.linspace(low, high, size)
        kind = rng.choice(kinds) if rng.random() < 0.2 else "f4"
        order = rng.sample(names, len(names)) if rng.random() < 0.3 else names
        order = order[: rng.choice((2, 3, 4, 4))]
        for name in ("uo", "vo"):
            data.createVariable(name, kind, order, zlib=rng.random() < 0.3 and kind is not str)
            data[name].units = "m/s"


_ANY = (flip_bytes, flip_bytes, truncate, overwrite)
MUTATIONS: dict[str, tuple[Callable[[Path, random.Random], None], ...]] = {
    ".geojson": (flip_bytes, truncate, change_text, change_text, change_geojson, change_geojson),
    ".gpkg": (*_ANY, change_geopackage, change_geopackage),
    ".shp": (*_ANY, remove),
    ".fgb": _ANY,
    "s57": (*_ANY, remove),
    "netcdf4": (*_ANY, change_netcdf, change_netcdf, change_netcdf, build_netcdf, build_netcdf),
    "packed": (*_ANY, change_netcdf),
    "netcdf3": (*_ANY, change_netcdf),
    "grib1": _ANY,
    "grib2": _ANY,
    "zarr": (*_ANY, change_text, change_text, remove),
}
