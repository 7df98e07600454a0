"""Layers of a GeoPackage file, written by geopandas and counted afterwards."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import datetime
from pathlib import Path

from pipeline.formats.gis.layers.frames import GeoDataFrame
from pipeline.formats.shared.os_errors import os_error


def write_layer(
    path: Path,
    frame: GeoDataFrame,
    layer: str,
    geometry_type: str,
    *,
    title: str,
    description: str,
    append: bool = False,
) -> None:
    """Write a frame as a new layer, or append it to one.

    SQLite does not wait for the disk: files are flushed before their folder takes its name.
    """
    from pyogrio import set_gdal_config_options

    set_gdal_config_options({"OGR_SQLITE_SYNCHRONOUS": "OFF"})
    frame.to_file(
        path,
        layer=layer,
        driver="GPKG",
        engine="pyogrio",
        index=False,
        mode="a" if append else "w",
        geometry_type=geometry_type,
        dataset_options={"VERSION": "1.3"},
        layer_options={
            "IDENTIFIER": title,
            "DESCRIPTION": description,
            "GEOMETRY_NAME": "geom",
            "FID": "fid",
        },
    )


@contextmanager
def dated(moment: datetime) -> Iterator[None]:
    """Date the layers that the block writes, so that the same run is the same file."""
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
        database.execute("PRAGMA synchronous = OFF")  # as `write_layer`
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
