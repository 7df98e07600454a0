"""Layers as tables: their columns with names and meanings, and how a GeoPackage gets them."""

import sqlite3
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import datetime
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import shapely

from pipeline._types import ArrayLike, Geometries
from pipeline.findings.columns import COLUMNS
from pipeline.findings.result import RankedRoute, RunResult
from pipeline.findings.text import os_error

_TYPES = {"text": object, "time": object, "whole": int, "flag": bool, "number": float}


GeoDataFrame: TypeAlias = Any  # of geopandas, which has no types and takes long to import

ROUTE_STEP_M = 2_000.0
"""Maximum length, true metres, of a segment of a route.

A straight line of the plane departs from the straight line in degrees by s²/8R·tan(latitude): by
0.1 m at 10 degrees, 0.2 m at 70.
"""

ZONE_STEP_M = 10_000.0
"""Maximum length, true metres, of a segment of a zone's edge: the chart is no more accurate."""


@dataclass(frozen=True)
class Layer:
    """A layer of a file: name, title and description for readers, and its type of geometry."""

    name: str
    title: str
    description: str
    geometry_type: str


LAYERS = {
    name: Layer(name, **texts)
    for name, texts in tomllib.loads(
        files("pipeline.formats.gis").joinpath("layers.toml").read_text(encoding="utf-8")
    ).items()
}
"""The layers of `routes.gpkg`, by name, in their order in the file."""


def frame(
    geometry: Sequence[Any] | Geometries, columns: Mapping[str, Sequence[ArrayLike]]
) -> GeoDataFrame:
    """Make the frame of a layer.

    `geometry` has one geometry per feature, or one array of geometries per route or season. A
    column has one value, or one array of values, per entry of `geometry`. Numbers that are not
    finite become NaN, which is written as NULL.
    """
    import geopandas

    counts = [np.size(part) for part in geometry]
    joined = {
        name: _joined(values, counts, _TYPES[COLUMNS[name].type if name in COLUMNS else "number"])
        for name, values in columns.items()
    }
    return geopandas.GeoDataFrame(
        joined,
        geometry=_joined(geometry, counts, object),
        crs="EPSG:4326",
    )


def rows_frame(geometry: Geometries, rows: Sequence[Mapping[str, Any]]) -> GeoDataFrame:
    """Make the frame of a layer of one geometry per row of cells by column."""
    return frame(geometry, {name: [row[name] for row in rows] for name in (rows[:1] or [{}])[0]})


def columns_of(records: Sequence[object], *names: str, **renamed: str) -> dict[str, list[Any]]:
    """Return columns of some attributes of records; `renamed` gives the attribute of a column."""
    attributes = {**dict(zip(names, names, strict=True)), **renamed}
    return {column: [getattr(one, name) for one in records] for column, name in attributes.items()}


def route_key(ranked: Sequence[RankedRoute]) -> dict[str, list[ArrayLike]]:
    """Return columns that identify routes."""
    return columns_of(ranked, "season", "rank")


def to_lonlat(result: RunResult, geometries: Sequence[Any], step_m: float) -> Geometries:
    """Transform planar geometries to lon/lat, with segments of at most `step_m` true metres.

    Areas become MultiPolygons.
    """
    array = np.empty(len(geometries), dtype=object)
    array[:] = geometries
    lonlat = result.water.projection.geometry_to_lonlat(array, densify_m=step_m)
    areas = not all(shapely.get_type_id(lonlat) == shapely.GeometryType.LINESTRING)
    return multipolygons(lonlat) if areas else lonlat


def multipolygons(areas: Sequence[Any] | Geometries) -> Geometries:
    """Make MultiPolygons of areas; lines and points that a union leaves are dropped."""
    multis = np.full(len(areas), shapely.MultiPolygon(), dtype=object)
    parts, index = shapely.get_parts(np.array(areas, dtype=object), return_index=True)
    polygons = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    shapely.multipolygons(parts[polygons], indices=index[polygons], out=multis)
    return multis


def _joined(
    values: Sequence[Any] | Geometries, counts: Sequence[int], dtype: type
) -> npt.NDArray[Any]:
    """Join arrays; a single value is repeated by its count."""
    parts: list[npt.NDArray[Any]] = [
        np.broadcast_to(np.asarray(value, dtype=dtype), count)
        for value, count in zip(values, counts, strict=True)
    ]
    column = np.concatenate([np.empty(0, dtype=dtype), *parts])
    return np.where(np.isfinite(column), column, np.nan) if dtype is float else column


def write_layer(path: Path, frame: GeoDataFrame, layer: Layer, *, append: bool = False) -> None:
    """Write a frame as a new layer, or append it to one.

    SQLite does not wait for the disk here: all files are flushed together, when they are complete.
    """
    from pyogrio import set_gdal_config_options

    set_gdal_config_options({"OGR_SQLITE_SYNCHRONOUS": "OFF"})
    frame.to_file(
        path,
        layer=layer.name,
        driver="GPKG",
        engine="pyogrio",
        index=False,
        mode="a" if append else "w",
        geometry_type=layer.geometry_type,
        dataset_options={"VERSION": "1.3"},
        layer_options={
            "IDENTIFIER": layer.title,
            "DESCRIPTION": layer.description,
            "GEOMETRY_NAME": "geom",
            "FID": "fid",
        },
    )


@contextmanager
def dated(moment: datetime) -> Iterator[None]:
    """Date the layers that the block writes by the run, so that equal runs give equal files."""
    from pyogrio import set_gdal_config_options

    set_gdal_config_options({"OGR_CURRENT_DATE": moment.strftime("%Y-%m-%dT%H:%M:%S.000Z")})
    try:
        yield
    finally:
        set_gdal_config_options({"OGR_CURRENT_DATE": None})


@contextmanager
def opened(path: Path) -> Iterator[sqlite3.Connection]:
    """Open the file as a database, and commit what the block changes."""
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("PRAGMA synchronous = OFF")  # as in `write_layer`
        yield database


def check_count(database: sqlite3.Connection, layer: str, expected: int) -> None:
    """Count the features of a layer: on a full disk GDAL may close a file without an error."""
    found = database.execute(f'SELECT count(*) FROM "{layer}"').fetchone()[0]  # noqa: S608 - names are our own layers
    if found != expected:
        raise sqlite3.DatabaseError(f"layer {layer} holds {found} of {expected} features")


@contextmanager
def system_errors(path: Path) -> Iterator[None]:
    """Turn errors of GDAL and SQLite into an OSError."""
    from pyogrio.errors import DataLayerError, DataSourceError, FeatureError

    try:
        yield
    except (DataSourceError, DataLayerError, FeatureError, sqlite3.Error) as error:
        raise os_error(path, error) from error
