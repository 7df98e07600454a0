"""`routes.gpkg`: layers in lon/lat (EPSG:4326), GeoPackage 1.3.

GDAL writes 1.4 by default, which GDAL 3.6, common on desktops, reads only in part. Straight lines
of the plane are split into short pieces first, so that a GIS, which draws straight lines in
degrees, shows and measures the planned line.

The QGIS project inside refers to the file by its name: it may be moved, but not renamed.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import shapely

from pipeline.formats.gis import records
from pipeline.formats.gis.layers.all_layers import LAYERS
from pipeline.formats.gis.qgis import project
from pipeline.formats.gis.qgis.styles import qml
from pipeline.formats.gis.qgis.view import view
from pipeline.formats.shared.os_errors import os_error
from pipeline.formats.shared.result import RunResult
from pipeline.formats.tables.manifest import manifest

# Name of the project inside the file, as QGIS lists it.
PROJECT = "RENEW"


def write_geopackage(result: RunResult, path: Path) -> None:
    """Write all layers of a run to a new file at `path`.

    Raises
    ------
    OSError
        The file can't be written, or is incomplete afterwards.
    """
    import pyogrio
    from pyogrio.errors import DataLayerError, DataSourceError, FeatureError

    counts, columns = {}, {}
    try:
        for layer in LAYERS:
            table = layer.table(result)
            counts[layer.name] = len(table.geometry)
            columns[layer.name] = ["fid", *table.columns]
            pyogrio.raw.write(
                path,
                shapely.to_wkb(table.geometry),
                list(table.columns.values()),
                np.array(list(table.columns)),
                layer=layer.name,
                driver="GPKG",
                geometry_type=layer.geometry_type,
                crs="EPSG:4326",
                append=False,
                dataset_options={"VERSION": "1.3"},
                layer_options={
                    "IDENTIFIER": layer.title,
                    "DESCRIPTION": layer.description,
                    "GEOMETRY_NAME": "geom",
                    "FID": "fid",
                },
            )
        with closing(sqlite3.connect(path)) as database, database:
            _add_records(database, result, columns, path.name)
            _check_counts(database, counts)
    except (DataSourceError, DataLayerError, FeatureError, sqlite3.Error) as error:
        raise os_error(path, error) from error


def _add_records(
    database: sqlite3.Connection,
    result: RunResult,
    columns: Mapping[str, Sequence[str]],
    file_name: str,
) -> None:
    """Add everything but the layers: provenance, meanings of columns, styles, the project."""
    records.create(database)
    content = manifest(result, ())
    del content["outputs"]  # this file is one of them
    records.put_provenance(database, content)
    for name, names in columns.items():
        records.put_meanings(database, name, names)
    map_view = view(result)
    records.put_styles(
        database,
        [
            (layer.name, layer.title, qml(layer.name, map_view, columns[layer.name]))
            for layer in LAYERS
        ],
    )
    records.put_dates(database, result.created)
    packed = project.qgz(result, map_view, columns, file_name)
    records.put_project(database, PROJECT, packed, result.created)


def _check_counts(database: sqlite3.Connection, counts: Mapping[str, int]) -> None:
    """Count the features in the file: on a full disk GDAL may close it without an error."""
    for name, expected in counts.items():
        found = database.execute(f'SELECT count(*) FROM "{name}"').fetchone()[0]  # noqa: S608 - names are our own layers
        if found != expected:
            raise sqlite3.DatabaseError(f"layer {name} holds {found} of {expected} features")
