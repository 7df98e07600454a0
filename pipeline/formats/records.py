"""Records of a run for machines: `manifest.json`, and each case's current as NetCDF and GRIB.

A NetCDF file holds the current at the nodes of the planner's own grid, so that bilinear
interpolation between them gives exactly the planner's current. The grid is regular in the planner's
plane and not in degrees. `uo` and `vo` are (y, x), or (time, y, x) for a current that changes. Each
case has a file of its own, because cases may have sources on different grids, and GDAL, and so
QGIS, places a grid only if its lines are evenly spaced.

Plotter programs such as OpenCPN draw GRIB 1 over the chart. It is written here and not by a
library, so that nobody need install ecCodes, of 175 MB: a file is a few headers and values of 16
bits. Source: the WMO's Manual on Codes (I.2: FM 92 GRIB, edition 1). OpenCPN needs the parameters
49 and 50. It shows noise where libraries pack a field of equal values in no bits.
"""

import hashlib
import importlib.metadata
import json
import math
import os
import platform
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyproj
import shapely

from pipeline._types import BoolArray, FloatArray, IndexArray
from pipeline.findings.names import SCHEMA_VERSION, without_folders
from pipeline.findings.note_words import caveats_json, note_json, note_texts, rejections
from pipeline.findings.result import RunCase, RunResult
from pipeline.findings.text import json_value, os_error, write_json
from pipeline.machine.store import code_commit, code_hash, file_hash
from pipeline.model import CurrentGrid
from pipeline.model.inputs import current_hash, land_hash
from pipeline.scenario.season import Period, period
from renew.inputs.current import as_field
from renew.kernels.current_table import CurrentTable

# Packages whose version can change a figure or a file.
_PACKAGES = (
    *("renew-planner", "contourpy", "copernicusmarine", "dask", "geopandas", "gpxpy", "jinja2"),
    *("lxml", "matplotlib", "netCDF4", "numba", "numpy", "pydantic", "pyogrio"),
    *("pyproj", "roaring-landmask", "scipy", "shapely", "xarray"),
)


def write_manifest(result: RunResult, path: Path, outputs: Sequence[Path]) -> None:
    """Write the manifest of a run whose other files, already complete, are `outputs`."""
    write_json(path, manifest(result, outputs))


def manifest(result: RunResult, outputs: Sequence[Path]) -> dict[str, object]:
    """Return everything that is needed to know, and to check, how a run's figures were made.

    Files are named without their folders, which mean nothing to other users.
    """
    content = {
        "schema_version": SCHEMA_VERSION,
        **provenance(result),
        "scenario_as_run": json_value(result.scenario.model_dump(mode="json")),
        "inputs": _inputs(result),
        "seasons": [
            {
                "season": case.name,
                "status": "failed" if case.result.failure else "planned",
                "failure": case.result.failure,
                "classes": len(case.plan.routes) if case.plan else 0,
                "rejected": len(case.plan.rejected) if case.plan else 0,
                "rejections": json_value(rejections(case)),
                "seconds": round(case.result.seconds, 3),
                **_gap_shares(case),
            }
            for case in result.cases
        ],
        **caveats_json(result),
        "note_values": json_value([note_json(note) for note in result.fetched.notes]),
        "shut_straits": [json_value(asdict(strait)) for strait in result.straits],
        "shut_straits_in_all": len(result.straits),
        "timings_s": {stage: round(s, 3) for stage, s in result.timings.items()},
        "outputs": {
            path.name: {"bytes": path.stat().st_size, "sha256": file_hash(path)} for path in outputs
        },
    }
    return {key: without_folders(value) for key, value in content.items()}


def _gap_shares(case: RunCase) -> dict[str, object]:
    """Return the parts of a case's optimality gap, if they were asked for."""
    shares = case.measures.gap_shares
    if shares is None:
        return {}
    parts = {"chart": shares.chart, "padding": shares.padding, "bound": shares.bound}
    return {"gap_shares": parts | ({"tide": shares.tide} if case.scenario.tide else {})}


def provenance(result: RunResult) -> dict[str, object]:
    """Return sources, credits and versions of a run."""
    return {
        "scenario": result.scenario.name,
        "created_utc": result.created.isoformat(timespec="seconds"),
        "land_sources": [asdict(credit) for credit in result.fetched.land.credits],
        "current_sources": [
            {"season": grid.case, "valid": grid.valid, **asdict(grid.credit)}
            for grid in result.fetched.currents
        ],
        "weather_sources": [asdict(credit) for credit in result.fetched.weather_credits],
        "notes": note_texts(result.fetched.notes),
        "command": shlex.join([Path(sys.argv[0]).name, *map(_named, sys.argv[1:])]),
        "code": {"commit": code_commit(), "plan_sha256": code_hash()},
        "platform": {
            "system": platform.system(),
            "release": platform.release(),
            "machine": platform.machine(),
            "cpus": os.cpu_count(),
        },
        "versions": versions(),
    }


def _named(argument: str) -> str:
    """Return an argument of a command line, without folders."""
    option, is_option, path = argument.partition("=")
    if is_option and Path(path).is_absolute():
        return f"{option}={Path(path).name}"
    return str(without_folders(argument))


@cache
def versions() -> dict[str, str]:
    """Return versions of Python, of the installed packages, and of the C libraries they use."""
    installed = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            installed[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    installed["GEOS"] = shapely.geos_version_string
    installed["PROJ"] = pyproj.proj_version_str
    return installed


def _inputs(result: RunResult) -> dict[str, object]:
    """Return hashes of the inputs; they are equal only if the inputs are."""
    scenario = json.dumps(
        json_value(result.scenario.model_dump(mode="json")), sort_keys=True, ensure_ascii=True
    )
    return {
        "scenario": {"sha256": hashlib.sha256(scenario.encode()).hexdigest()},
        "land": {
            "sha256": land_hash(result.fetched.land),
            "polygons": len(result.fetched.land.polygons),
            "accuracy_m": result.fetched.land.accuracy_m,
            "has_depths": result.fetched.land.depths is not None,
        },
        "simplified": {
            "original_vertices": result.simplified.original_vertices,
            "vertices": result.simplified.vertices,
            "tolerance_m": result.simplified.tolerance_m,
            "margin_m": result.simplified.margin_m,
        },
        "currents": {
            grid.case: {
                "sha256": current_hash(grid),
                "shape": list(grid.u.shape),
                "valid": grid.valid,
                "files": dict(grid.files),
            }
            for grid in result.fetched.currents
        },
    }


# A variable of a file: its dimensions, values and attributes.
_Variable: TypeAlias = tuple[tuple[str, ...], Any, Mapping[str, Any]]

_CONVENTIONS = "CF-1.11"
_REFERENCES = "RENEW: Risk- and Energy-Aware Navigation in Dynamic Waterways, AAAI 2026"
_COMMENT = (
    "The nodes are those of the planner: between them, in x and y, it interpolates bilinearly, and "
    "between times linearly. Beyond the source's water the values are filled from their neighbours."
)
_DEGREES = {
    "lat": {"standard_name": "latitude", "long_name": "latitude", "units": "degrees_north"},
    "lon": {"standard_name": "longitude", "long_name": "longitude", "units": "degrees_east"},
}
_FILLED = {
    "standard_name": "status_flag",
    "long_name": "whether the source of the current has a figure at the node",
    "flag_values": np.array([0, 1], dtype="i1"),
    "flag_meanings": "from_source filled_from_neighbours",
    "grid_mapping": "crs",
    "coordinates": "lat lon",
}
_TIME = {
    "standard_name": "time",
    "units": "seconds since 1970-01-01 00:00:00",
    "calendar": "standard",
    # Python's timestamps, and those of the libraries that read the file, ignore leap seconds.
    "units_metadata": "leap_seconds: none",
}


def write_currents(case: RunCase, path: Path) -> None:
    """Write the current of a case that has a grid to a new file at `path`.

    Raises OSError if the file can't be written.
    """
    import netCDF4

    grid, planned = case.source_grid, case.case
    table, projection = planned.current.table(planned.chart.bounds), planned.projection
    lonlat = projection.to_lonlat(np.stack(np.meshgrid(table.x, table.y), axis=-1))
    filled = ~grid.cells.at(lonlat.reshape(-1, 2)).reshape(lonlat.shape[:2])
    time = _time(grid, table, planned.departure)
    velocity = np.empty((len(table.times), *lonlat.shape), dtype="f4")
    for step, planar in enumerate(table.uv):
        velocity[step] = projection.rotate_to_lonlat(lonlat, planar)
    changes = len(table.times) > 1
    dimensions = ("time", "y", "x") if changes else ("y", "x")
    coordinates = "time lat lon" if time and not changes else "lat lon"
    plane = pyproj.CRS.from_user_input(projection.crs)
    content = {
        "crs": ((), np.int32(0), plane.to_cf() | {"long_name": "the planner's plane, conformal"}),
        **_axes(plane, projection.scale, table),
        "lon": (("y", "x"), lonlat[..., 0], _DEGREES["lon"]),
        "lat": (("y", "x"), lonlat[..., 1], _DEGREES["lat"]),
        "filled": (("y", "x"), filled.astype("i1"), _FILLED),
        **time,
    }
    for component, (name, direction) in enumerate((("uo", "eastward"), ("vo", "northward"))):
        about = {
            "standard_name": f"surface_{direction}_sea_water_velocity",
            "long_name": f"{direction} surface current",
            "units": "m s-1",
            "grid_mapping": "crs",
            "coordinates": coordinates,
            "ancillary_variables": "filled",
        }
        content[name] = (dimensions, (velocity if changes else velocity[0])[..., component], about)
    try:
        with netCDF4.Dataset(path, "w") as file:
            file.setncatts(_about(case, grid))
            for name, size in zip(("time", "y", "x"), velocity.shape, strict=False):
                if name in dimensions:
                    file.createDimension(name, size)
            for name, (of, values, attributes) in content.items():
                array, is_field = np.asarray(values), "x" in of and "y" in of
                variable = file.createVariable(name, array.dtype, of, zlib=is_field)
                variable.setncatts(attributes)
                variable[...] = array
    except RuntimeError as error:  # HDF5's
        raise os_error(path, error) from error


def _about(case: RunCase, grid: CurrentGrid) -> dict[str, str]:
    """Return global attributes, without empty ones."""
    made = case.run.created.strftime("%Y-%m-%dT%H:%M:%SZ")
    software = f"renew-planner {versions().get('renew-planner', '')}".strip()
    scenario, credit, valid = case.scenario, grid.credit, valid_period(grid)
    attributes = {
        "Conventions": _CONVENTIONS,
        "title": (f"Surface current of {scenario.title or scenario.name}: {case.title}"),
        "history": f"{made}: written by {software}",
        "source": credit.name,
        "references": _listed([credit.url, _REFERENCES]),
        "comment": _COMMENT,
        "license": credit.licence,
        "acknowledgement": credit.text,
        "date_created": made,
        "scenario": scenario.name,
        "season": case.name,
        "valid": grid.valid,
        "time_coverage_start": valid.begin.isoformat() if valid else "",
        "time_coverage_end": valid.end.isoformat() if valid else "",
        "notes": _listed(note_texts(grid.notes)),
    }
    # UTF-8 and C strings can't hold every character.
    return {
        name: text.encode("utf-8", "replace").decode().replace("\0", "\N{REPLACEMENT CHARACTER}")
        for name, text in attributes.items()
        if text
    }


def _axes(plane: pyproj.CRS, scale: float, table: CurrentTable) -> dict[str, _Variable]:
    """Return the nodes' coordinates in the plane's CRS, at true scale and in the CRS's own unit."""
    unit_m = plane.axis_info[0].unit_conversion_factor
    return {
        name: (
            (name,),
            nodes * (scale / unit_m),
            {
                "standard_name": f"projection_{name}_coordinate",
                "long_name": f"{name} in the planner's plane",
                "units": "m" if unit_m == 1 else f"{unit_m!r} m",
                "axis": name.upper(),
            },
        )
        for name, nodes in (("x", table.x), ("y", table.y))
    }


def _time(
    grid: CurrentGrid, table: CurrentTable, departure: datetime | None
) -> dict[str, _Variable]:
    """Return the times of a current that changes, or the one time of a steady one.

    A steady current whose time is not known has none: CF forbids a missing one.
    """
    if len(table.times) > 1:
        since = 0.0 if departure is None else departure.timestamp()
        about = {**_TIME, "long_name": "time", "axis": "T"}
        return {"time": (("time",), since + table.times, about)}
    valid = valid_period(grid)
    if valid is None:
        return {}
    middle = (valid.begin.timestamp() + valid.end.timestamp()) / 2
    return {
        "time": (
            (),
            middle,
            {**_TIME, "long_name": "middle of the period that the values represent"},
        )
    }


def valid_period(grid: CurrentGrid) -> Period | None:
    """Read the period of the values, or the first and last of several ('2024-01-03/2024-01-28').

    None for any other text, as sources name their periods freely, and for a current that changes,
    whose times are in the file.
    """
    first, _, last = grid.valid.partition("/")
    try:
        return None if grid.changes else Period(period(first).begin, period(last or first).end)
    except ValueError:
        return None


def _listed(texts: Iterable[str]) -> str:
    """Join texts that are not empty, each once."""
    return "; ".join(dict.fromkeys(text for text in texts if text))


# Nodes per cell of the source along each axis, as of the planner's grid.
_NODES_PER_CELL = 2
# Largest number of nodes: more make the overlay of a plotter slow.
_MAX_NODES = 250_000
# Difference below which a coordinate counts as a whole number of steps, millidegrees.
_ROUNDING = 1e-6
# Version of table 2, which has the parameters.
_TABLE = 2
# Parameters: the components of a current towards east and towards north.
_PARAMETERS = (49, 50)
# Code of a centre, process or grid that is not known.
_NONE = 255
# Code of the level: the surface.
_SURFACE = 1
# Code of the unit of time.
_HOURS = 1
# Code of a step that takes two bytes.
_LONG_STEP = 10
# Flags of section 1: a grid's description and a bitmap follow.
_HAS_GRID_AND_BITMAP = 0xC0
# Flag of the grid: its steps are given.
_HAS_STEPS = 0x80
# Flag of the grid: rows go from south to north.
_NORTHWARDS = 0x40
# Flag of the data: eight bits at their end are not used.
_PADDED = 0x08
# Bits of a packed value.
_BITS = 16
# Least span that the packed values cover, m/s.
_LEAST_SPAN_M_S = 1e-6


def fields_from(case: RunCase) -> datetime | None:
    """Return the time of the first field of a case's current; None if no time is known.

    It is the departure, or without one the middle of the period that the values represent.
    """
    departure = case.case.departure or case.spec.departure
    if departure is not None:
        return departure.astimezone(UTC)
    valid = valid_period(case.source_grid)
    return valid.begin + (valid.end - valid.begin) / 2 if valid else None


def write_grib(case: RunCase, path: Path) -> None:
    """Write the current of a case that has a grid, and a time, to a new file at `path`.

    The nodes are a regular grid in degrees, with the planner's current there; those outside its
    chart, and those for which the source has no figure, have no value.
    """
    begin, projection, field = fields_from(case), case.case.projection, as_field(case.case.current)
    if begin is None:
        raise ValueError(f"the current of {case.name!r} has no time")
    lon, lat, lonlat, known = _nodes(case)
    xy = projection.to_plane(lonlat)
    with path.open("wb") as file:
        minutes = np.rint(np.asarray(field.slice_times) / 60).astype(int).tolist()
        first = begin + timedelta(minutes=minutes[0])
        for seconds, minute in zip(field.slice_times, minutes, strict=True):
            planar = field.velocity(xy, float(seconds))
            east_north = projection.rotate_to_lonlat(lonlat, planar)
            for number, values in zip(_PARAMETERS, np.moveaxis(east_north, -1, 0), strict=True):
                product = _product(number, first, minute - minutes[0])
                file.write(_message(product, lon, lat, values, known))


def has_grib(case: RunCase) -> bool:
    """Whether a case's current has a time, and a value at a node; a small chart may hold none."""
    return fields_from(case) is not None and bool(_nodes(case)[-1].any())


def _nodes(case: RunCase) -> tuple[IndexArray, IndexArray, FloatArray, BoolArray]:
    """Return a case's nodes: both axes, millidegrees; lon/lat (ny, nx, 2); which have a value."""
    lon, lat = _axes_mdeg(case.source_grid)
    lonlat = np.stack(np.meshgrid(lon / 1000, lat / 1000), axis=-1)
    xy = case.case.projection.to_plane(lonlat)
    xmin, ymin, xmax, ymax = case.case.chart.bounds
    known = case.source_grid.cells.at(lonlat.reshape(-1, 2)).reshape(lonlat.shape[:2])
    known &= ((xy >= (xmin, ymin)) & (xy <= (xmax, ymax))).all(axis=-1)
    return lon, lat, lonlat, known


def _axes_mdeg(grid: CurrentGrid) -> tuple[IndexArray, IndexArray]:
    """Return a grid of nodes, whole millidegrees, over that of the source."""
    spans = [(float(axis[0]), float(axis[-1]), axis.size) for axis in (grid.lon, grid.lat)]
    nodes = [_NODES_PER_CELL * (count - 1) for _, _, count in spans]
    fewer = max(1.0, math.sqrt(math.prod(nodes) / _MAX_NODES))
    axes = []
    for (first, last, _), count in zip(spans, nodes, strict=True):
        step = math.ceil(1000 * (last - first) / count * fewer - _ROUNDING)
        begin = step * math.ceil(1000 * first / step - _ROUNDING)
        axes.append(np.arange(begin, 1000 * last + _ROUNDING, step).astype(np.intp))
    return axes[0], axes[1]


def _message(
    product: bytes, lon_mdeg: IndexArray, lat_mdeg: IndexArray, values: FloatArray, known: BoolArray
) -> bytes:
    """Encode a component (ny, nx), m/s, whose values are known at some nodes."""
    sections = b"".join(
        [product, _grid_section(lon_mdeg, lat_mdeg), _bitmap(known), _data(values[known]), b"7777"]
    )
    return b"GRIB" + _whole(8 + len(sections), 3) + b"\1" + sections


def _product(number: int, first: datetime, minutes: int) -> bytes:
    """Encode what a field is: a component at the surface, some minutes after the first field.

    Plotters take the fields of one reference time for one forecast. Its steps are whole hours: a
    field between them has a reference time of its own.
    """
    hours, rest = divmod(minutes, 60)
    first += timedelta(minutes=rest)
    century, year = divmod(first.year - 1, 100)
    fields = [_TABLE, _NONE, _NONE, _NONE, _HAS_GRID_AND_BITMAP, number, _SURFACE, 0, 0]
    fields += [year + 1, first.month, first.day, first.hour, first.minute]
    fields += [_HOURS, *divmod(hours, 256), _LONG_STEP if hours else 0, 0, 0, 0]
    return _section(bytes([*fields, century + 1, 0, 0, 0]))


def _grid_section(lon_mdeg: IndexArray, lat_mdeg: IndexArray) -> bytes:
    """Encode a regular grid whose rows run to the east, and from south to north."""
    first, last = (
        b"".join(_signed(int(axis[end]), 3) for axis in (lat_mdeg, lon_mdeg)) for end in (0, -1)
    )
    sizes, steps = (
        b"".join(_whole(int(one), 2) for one in pair)
        for pair in ((lon_mdeg.size, lat_mdeg.size), (np.diff(lon_mdeg)[0], np.diff(lat_mdeg)[0]))
    )
    plain = bytes([0, _NONE, 0]) + sizes + first + bytes([_HAS_STEPS]) + last + steps
    return _section(plain + bytes([_NORTHWARDS, 0, 0, 0, 0]))


def _bitmap(known: BoolArray) -> bytes:
    """Encode which nodes have a value."""
    bits = np.packbits(known.reshape(-1)).tobytes()
    padding = len(bits) % 2
    return _section(bytes([8 * (len(bits) + padding) - known.size, 0, 0]) + bits + b"\0" * padding)


def _data(values: FloatArray) -> bytes:
    """Pack values (n,) as multiples of a power of two above a reference."""
    least, reference = _ibm_below(float(values.min()))
    span = max(float(values.max()) - least, _LEAST_SPAN_M_S)
    power = math.ceil(math.log2(span / (2**_BITS - 1)))
    packed = np.rint((values - least) / 2.0**power).astype(">u2").tobytes()
    # A byte makes the section's length even.
    return _section(
        bytes([_PADDED]) + _signed(power, 2) + reference + bytes([_BITS]) + packed + b"\0"
    )


def _ibm_below(value: float) -> tuple[float, bytes]:
    """Return the largest IBM number of 32 bits up to a value, and its bytes."""
    power = max(math.floor(math.log(abs(value), 16)) + 1, -64) if value else 0
    fraction = math.floor(value / 16.0**power * 2**24)
    if fraction == -(2**24):
        power, fraction = power + 1, -(2**20)
    sign = 0x80 * (fraction < 0)
    return fraction / 2**24 * 16.0**power, bytes([sign + power + 64]) + _whole(abs(fraction), 3)


def _section(content: bytes) -> bytes:
    """Return a section: its length, then its content."""
    return _whole(3 + len(content), 3) + content


def _whole(number: int, size: int) -> bytes:
    """Encode a whole number that is not negative."""
    return number.to_bytes(size, "big")


def _signed(number: int, size: int) -> bytes:
    """Encode a whole number as its sign and its size."""
    sign = (number < 0) << (8 * size - 1)
    return _whole(abs(number) + sign, size)
