"""`manifest.json`: inputs, outputs, versions and hashes, so that a result can be reproduced."""

import hashlib
import importlib.metadata
import json
import os
import platform
import re
import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import shapely

from pipeline.formats.shared.note_words import note_json, note_texts, rejections
from pipeline.formats.shared.result import MAX_STRAITS, RunResult
from pipeline.formats.shared.text import json_value, write_json
from pipeline.machine.store import code_commit, code_hash, file_hash

SCHEMA_VERSION = 1
# Packages whose version can change a figure or a file.
_PACKAGES = (
    *("renew-planner", "contourpy", "copernicusmarine", "dask", "geopandas", "gpxpy", "jinja2"),
    *("lxml", "matplotlib", "netCDF4", "networkx", "numba", "numpy", "pydantic", "pyogrio"),
    *("pyproj", "roaring-landmask", "scipy", "shapely", "triangle", "xarray"),
)


# An absolute path inside a text, of at least two parts: no address, fraction or tag.
_ABSOLUTE = re.compile(r"(?<![\w/:.])/(?:[^\s/'\"]+/)+([^\s/'\",;]+)")


def write_manifest(result: RunResult, path: Path, outputs: Sequence[Path]) -> None:
    """Write the manifest of a run whose other files, already complete, are `outputs`."""
    write_json(path, manifest(result, outputs))


def manifest(result: RunResult, outputs: Sequence[Path]) -> dict[str, object]:
    """Everything that is needed to know, and to check, how a run's figures were made.

    Files are named without their folders, which mean nothing to other users.
    """
    content = {
        "schema_version": SCHEMA_VERSION,
        **provenance(result),
        "scenario_as_run": json_value(result.scenario.model_dump(mode="json")),
        "inputs": _inputs(result),
        "seasons": [
            {
                "season": entry.season,
                "status": "failed" if entry.failure else "planned",
                "failure": entry.failure,
                "classes": len(entry.plan.routes) if entry.plan else 0,
                "rejected": len(entry.plan.rejected) if entry.plan else 0,
                "rejections": json_value(rejections(result, entry.season)),
                "seconds": round(entry.seconds, 3),
                **_gap_shares(result, entry.season),
            }
            for entry in result.plans
        ],
        "unknown": note_texts(result.unknowns),
        "note_values": json_value([note_json(note) for note in result.fetched.notes]),
        "shut_straits": [json_value(asdict(strait)) for strait in result.straits[:MAX_STRAITS]],
        "shut_straits_in_all": len(result.straits),
        "timings_s": {stage: round(s, 3) for stage, s in result.timings.items()},
        "outputs": {
            path.name: {"bytes": path.stat().st_size, "sha256": file_hash(path)} for path in outputs
        },
    }
    return {key: without_folders(value) for key, value in content.items()}


def without_folders(value: object) -> object:
    """Return a value for JSON in whose texts files are named without their folders."""
    if isinstance(value, str):
        return Path(value).name if Path(value).is_absolute() else _ABSOLUTE.sub(r"\1", value)
    if isinstance(value, dict):
        return {key: without_folders(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [without_folders(one) for one in value]
    return value


def _gap_shares(result: RunResult, season: str) -> dict[str, object]:
    """The parts of a season's optimality gap, if they were asked for."""
    shares = result.evaluation.gap_shares_of(season)
    if shares is None:
        return {}
    return {"gap_shares": {"chart": shares.chart, "padding": shares.padding, "bound": shares.bound}}


def provenance(result: RunResult) -> dict[str, object]:
    """Sources, credits and versions of a run."""
    return {
        "scenario": result.scenario.name,
        "created_utc": result.created.isoformat(timespec="seconds"),
        "land_sources": [asdict(credit) for credit in result.fetched.land.credits],
        "current_sources": [
            {"season": grid.season, "valid": grid.valid, **asdict(grid.credit)}
            for grid in result.fetched.currents
        ],
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
    """An argument of a command line, without folders."""
    option, is_option, path = argument.partition("=")
    if is_option and Path(path).is_absolute():
        return f"{option}={Path(path).name}"
    return str(without_folders(argument))


@cache
def versions() -> dict[str, str]:
    """Versions of Python, of the installed packages, and of the C libraries they use."""
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    found["GEOS"] = shapely.geos_version_string
    found["PROJ"] = pyproj.proj_version_str
    return found


def _inputs(result: RunResult) -> dict[str, object]:
    """Hashes of the inputs; they are equal only if the inputs are."""
    scenario = json.dumps(
        json_value(result.scenario.model_dump(mode="json")), sort_keys=True, ensure_ascii=True
    )
    land = hashlib.sha256()
    for polygon in result.fetched.land.polygons:
        land.update(shapely.to_wkb(polygon, byte_order=1))
    return {
        "scenario": {"sha256": hashlib.sha256(scenario.encode()).hexdigest()},
        "land": {
            "sha256": land.hexdigest(),
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
            grid.season: {
                "sha256": _arrays_hash(grid.lon, grid.lat, grid.times_s, grid.u, grid.v),
                "shape": list(grid.u.shape),
                "valid": grid.valid,
                "files": dict(grid.files),
            }
            for grid in result.fetched.currents
        },
    }


def _arrays_hash(*arrays: np.ndarray[Any, np.dtype[np.float64]]) -> str:
    """SHA-256 of arrays, equal on every machine."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return digest.hexdigest()
