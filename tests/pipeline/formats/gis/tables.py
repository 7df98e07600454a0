"""What the tests read from a GeoPackage."""

import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import geopandas

from pipeline.findings.result import RunResult
from pipeline.model import CaseResult

# Layers with features in the small run, with their types of geometry.
LAYERS = {
    "routes": "LineString",
    "passage": "Point",
    "legs": "MultiPolygon",
    "path_points": "Point",
    "channels": "MultiPolygon",
    "islands": "Point",
    "coast": "MultiPolygon",
    "region": "LineString",
    "no_go": "MultiPolygon",
    "soft_no_go": "MultiPolygon",
    "currents": "Point",
    "contingency": "Point",
}


# Figures of a route on a chart without depths, tide and members.
ROUTE_COLUMNS = {
    *("season", "rank", "homotopy", "way", "fuel", "fuel_per_distance", "length_m"),
    *("clearance_m", "duration_s", "optimality_gap"),
    *("trials", "collisions"),
    "filled_share",
}


def query(path: Path, sql: str) -> list[tuple[Any, ...]]:
    with closing(sqlite3.connect(path)) as database:
        return database.execute(sql).fetchall()


def layer(path: Path, name: str) -> geopandas.GeoDataFrame:
    """A layer without its CRS: areas and lengths are compared in degrees here."""
    return geopandas.read_file(path, layer=name).set_crs(None, allow_override=True)


def without_routes(result: RunResult) -> RunResult:
    results = tuple(CaseResult(one.name, None, "no way", 0.0) for one in result.results)
    return replace(result, results=results)
