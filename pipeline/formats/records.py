"""Records of a run for machines: `manifest.json`, and each case's current as NetCDF.

A NetCDF file holds the current at the nodes of the planner's own grid, so that bilinear
interpolation between them gives exactly the planner's current. The grid is regular in the planner's
plane and not in degrees. `uo` and `vo` are (y, x), or (time, y, x) for a current that changes. Each
case has a file of its own, because cases may have sources on different grids, and GDAL, and so
QGIS, places a grid only if its lines are evenly spaced.
"""

import hashlib
import importlib.metadata
import json
import os
import platform
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyproj
import shapely

from pipeline.findings.names import SCHEMA_VERSION, without_folders
from pipeline.findings.note_words import caveats_json, note_json, note_texts, rejections
from pipeline.findings.result import RunCase, RunResult
from pipeline.findings.text import json_value, os_error, write_json
from pipeline.machine.store import code_commit, code_hash, file_hash
from pipeline.model import CurrentGrid
from pipeline.model.inputs import current_hash, land_hash
from pipeline.scenario.season import Period, period
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
            name: getattr(result.simplified, name)
            for name in ("original_vertices", "vertices", "tolerance_m", "margin_m")
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
        **_axes(projection.scale, table),
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


def _axes(scale: float, table: CurrentTable) -> dict[str, _Variable]:
    """Return the nodes' coordinates in the plane's CRS, at true scale."""
    return {
        name: (
            (name,),
            nodes * scale,
            {
                "standard_name": f"projection_{name}_coordinate",
                "long_name": f"{name} in the planner's plane",
                "units": "m",
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
    about = {**_TIME, "long_name": "middle of the period that the values represent"}
    return {"time": ((), middle, about)}


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
