"""`routes.gpkg`: layers in lon/lat (EPSG:4326), GeoPackage 1.3.

GDAL writes 1.4 by default, which GDAL 3.6, common on desktops, reads only in part. Lines that
are straight in the planner's plane are split into short pieces first: a GIS, which draws straight
lines in degrees, then shows and measures the planned line.

The QGIS project inside refers to the file by its name: the file may be moved, but not renamed.
"""

import json
import sqlite3
from collections.abc import Mapping, Sequence
from datetime import datetime
from importlib.resources import files
from pathlib import Path

from pipeline.formats.gis.fields import FIELDS
from pipeline.formats.gis.frames import check_count, dated, opened, system_errors, write_layer
from pipeline.formats.gis.layers import LAYERS
from pipeline.formats.gis.qgis import project
from pipeline.formats.gis.qgis.styles import qml
from pipeline.formats.gis.qgis.view import view
from pipeline.formats.manifest import manifest
from pipeline.formats.shared.result import RunResult

# Name of the project inside the file, as QGIS lists it.
PROJECT = "RENEW"

# Standard of the metadata's form: JSON.
_METADATA_STANDARD = "https://www.rfc-editor.org/rfc/rfc8259"


def write_geopackage(result: RunResult, path: Path) -> None:
    """Write all layers of a run to a new file at `path`."""
    counts, columns = {}, {}
    with system_errors(path), dated(result.created):
        for layer in LAYERS:
            frame = layer.frame(result)
            counts[layer.name] = len(frame)
            columns[layer.name] = ["fid", *frame.columns.drop("geometry")]
            about = layer.title, layer.description
            write_layer(path, frame, layer.name, layer.geometry_type, *about)
        with opened(path) as database:
            _add_records(database, result, columns, path.name)
            for name, count in counts.items():
                check_count(database, name, count)


def _add_records(
    database: sqlite3.Connection,
    result: RunResult,
    columns: Mapping[str, Sequence[str]],
    file_name: str,
) -> None:
    """Add everything beside the layers: provenance, meanings of columns, styles, the project."""
    script = files("pipeline.formats.gis") / "records.sql"
    database.executescript(script.read_text(encoding="utf-8"))
    content = manifest(result, ())
    del content["outputs"]  # not complete yet: this file is one of them
    _put_provenance(database, content)
    _put_meanings(database, columns)
    map_view = view(result)
    styles = [
        (layer.name, qml(layer.name, map_view, columns[layer.name]), layer.title)
        for layer in LAYERS
    ]
    _put_styles(database, styles)
    # Dated by the run, so that equal runs give equal files.
    stamp = (result.created.strftime("%Y-%m-%dT%H:%M:%S.000Z"),)
    database.execute("UPDATE gpkg_contents SET last_change = ?", stamp)
    database.execute("UPDATE layer_styles SET update_time = ?", stamp)
    database.execute("UPDATE gpkg_metadata_reference SET timestamp = ?", stamp)
    packed = project.qgz(result, map_view, columns, file_name)
    _put_project(database, PROJECT, packed, result.created)


def _put_provenance(database: sqlite3.Connection, content: Mapping[str, object]) -> None:
    """Store inputs, credits and versions as JSON in the metadata of the whole file."""
    row = database.execute(
        "INSERT INTO gpkg_metadata (md_scope, md_standard_uri, mime_type, metadata)"
        " VALUES ('dataset', ?, 'application/json', ?)",
        (_METADATA_STANDARD, json.dumps(content, ensure_ascii=False, allow_nan=False)),
    )
    database.execute(
        "INSERT INTO gpkg_metadata_reference (reference_scope, md_file_id)"
        " VALUES ('geopackage', ?)",
        (row.lastrowid,),
    )


def _put_meanings(database: sqlite3.Connection, columns: Mapping[str, Sequence[str]]) -> None:
    """Store the meanings of the layers' columns; software shows either the name or the title."""
    database.executemany(
        "INSERT INTO gpkg_data_columns (table_name, column_name, name, title, description)"
        " VALUES (?, ?, ?, ?, ?)",
        [
            (layer, name, FIELDS[name].alias, FIELDS[name].alias, FIELDS[name].meaning)
            for layer, names in columns.items()
            for name in names
        ],
    )


def _put_styles(database: sqlite3.Connection, styles: Sequence[tuple[str, str, str]]) -> None:
    """Store a default style for each layer, given as (layer, QML, description)."""
    database.executemany(
        "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name,"
        " f_geometry_column, styleName, styleQML, styleSLD, useAsDefault, description, owner)"
        " VALUES ('', '', ?, 'geom', 'RENEW', ?, '', 1, ?, 'RENEW')",
        styles,
    )
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description)"
        " VALUES ('layer_styles', 'attributes', 'Styles', 'How QGIS draws each layer')"
    )


def _put_project(database: sqlite3.Connection, name: str, packed: bytes, created: datetime) -> None:
    """Store a QGIS project as QGIS does: its .qgz in hexadecimal."""
    about = {"last_modified_time": created.strftime("%Y-%m-%dT%H:%M:%S"), "last_modified_user": ""}
    database.execute(
        "INSERT INTO qgis_projects (name, metadata, content) VALUES (?, ?, ?)",
        (name, json.dumps(about), packed.hex()),
    )
