"""What the tests read from a GeoPackage."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import geopandas
import pyproj

from pipeline.findings.result import RunResult
from pipeline.model import CaseResult

GEOD = pyproj.Geod(ellps="WGS84")


LAYERS = {
    "routes": "LineString",
    "passage": "Point",
    "legs": "MultiPolygon",
    "path_points": "Point",
    "channels": "MultiPolygon",
    "islands": "Point",
    "coast": "MultiPolygon",
    "region": "LineString",
    "hazards": "MultiPolygon",
    "chart_areas": "MultiPolygon",
    "depth_areas": "MultiPolygon",
    "tidal_water": "MultiPolygon",
    "no_go": "MultiPolygon",
    "soft_no_go": "MultiPolygon",
    "currents": "Point",
    "contingency": "Point",
    "shore_crossings": "Point",
    "havens": "Point",
    "diversions": "LineString",
    "coverage": "LineString",
}


ROUTE_COLUMNS = {
    *("season", "rank", "homotopy", "way", "fuel", "fuel_per_distance", "length_m"),
    *("clearance_m", "duration_s", "optimality_gap"),
    *("trials", "collisions"),
    *("filled_share", "uncharted_share", "least_water_m", "least_water_at"),
    *("members_share", "members_mean_fuel"),
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
