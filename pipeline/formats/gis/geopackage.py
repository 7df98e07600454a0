"""`routes.gpkg`: seven layers in lon/lat (EPSG:4326), GeoPackage 1.3.

GDAL writes 1.4 unless told otherwise, which the GDAL 3.6 of many a desktop reads only in part.
Straight lines of the plane are cut into short pieces first, so that a GIS, which draws straight
lines in degrees, shows and measures the line that was planned.
"""

from __future__ import annotations

import errno
import json
import shutil
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.formats.gis.layers import LAYERS
from pipeline.formats.manifest import provenance

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from pipeline.formats.result import RunResult

# A disk with less left is taken for full when a write fails; this is more than SQLite's journal.
_LITTLE_SPACE = 16 * 2**20

_METADATA_SCHEMA = """
CREATE TABLE IF NOT EXISTS gpkg_metadata (
  id INTEGER CONSTRAINT m_pk PRIMARY KEY ASC NOT NULL,
  md_scope TEXT NOT NULL DEFAULT 'dataset',
  md_standard_uri TEXT NOT NULL,
  mime_type TEXT NOT NULL DEFAULT 'text/xml',
  metadata TEXT NOT NULL DEFAULT '');
CREATE TABLE IF NOT EXISTS gpkg_metadata_reference (
  reference_scope TEXT NOT NULL,
  table_name TEXT,
  column_name TEXT,
  row_id_value INTEGER,
  timestamp DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  md_file_id INTEGER NOT NULL,
  md_parent_id INTEGER,
  CONSTRAINT crmr_mfi_fk FOREIGN KEY (md_file_id) REFERENCES gpkg_metadata(id),
  CONSTRAINT crmr_mpi_fk FOREIGN KEY (md_parent_id) REFERENCES gpkg_metadata(id));
"""
_METADATA_DEFINITION = "http://www.geopackage.org/spec121/#extension_metadata"
# What the metadata's form follows: JSON.
_METADATA_STANDARD = "https://www.rfc-editor.org/rfc/rfc8259"


def write_geopackage(result: RunResult, path: Path) -> None:
    """Write all layers of a run to a new file at `path`.

    Raises
    ------
    OSError
        The file can't be written, or what stands in it afterwards is not what was written.
    """
    import pyogrio
    from pyogrio.errors import DataLayerError, DataSourceError, FeatureError

    counts = {}
    try:
        for layer in LAYERS:
            table = layer.table(result)
            counts[layer.name] = len(table.geometry)
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
            _add_provenance(database, provenance(result))
            _check_counts(database, counts)
    except (DataSourceError, DataLayerError, FeatureError, sqlite3.Error) as error:
        # Neither library hands the system's own error on, so the disk is asked.
        full = shutil.disk_usage(path.parent).free < _LITTLE_SPACE
        number = errno.ENOSPC if full else errno.EIO
        raise OSError(number, f"{path.name}: {error}") from error


def _add_provenance(database: sqlite3.Connection, content: Mapping[str, object]) -> None:
    """Put sources, credits and versions into the file's metadata, as JSON for the whole file."""
    database.executescript(_METADATA_SCHEMA)
    row = database.execute(
        "INSERT INTO gpkg_metadata (md_scope, md_standard_uri, mime_type, metadata)"
        " VALUES (?, ?, ?, ?)",
        (
            "dataset",
            _METADATA_STANDARD,
            "application/json",
            json.dumps(content, ensure_ascii=False, allow_nan=False),
        ),
    )
    database.execute(
        "INSERT INTO gpkg_metadata_reference (reference_scope, md_file_id)"
        " VALUES ('geopackage', ?)",
        (row.lastrowid,),
    )
    database.execute(
        "CREATE TABLE IF NOT EXISTS gpkg_extensions (table_name TEXT, column_name TEXT,"
        " extension_name TEXT NOT NULL, definition TEXT NOT NULL, scope TEXT NOT NULL,"
        " CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name))"
    )
    database.executemany(
        "INSERT INTO gpkg_extensions VALUES (?, NULL, 'gpkg_metadata', ?, 'read-write')",
        [(t, _METADATA_DEFINITION) for t in ("gpkg_metadata", "gpkg_metadata_reference")],
    )


def _check_counts(database: sqlite3.Connection, counts: Mapping[str, int]) -> None:
    """Count what arrived: on a full disk GDAL may close a file without a word."""
    for name, expected in counts.items():
        found = database.execute(f'SELECT count(*) FROM "{name}"').fetchone()[0]  # noqa: S608 - names are our own layers
        if found != expected:
            raise sqlite3.DatabaseError(f"layer {name} holds {found} of {expected} features")
