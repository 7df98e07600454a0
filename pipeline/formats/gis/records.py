"""Tables of the GeoPackage beside the layers: styles, column meanings, provenance, project."""

import json
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from importlib.resources import files

from pipeline.formats.gis.layers.fields import FIELDS

# Standard of the metadata's form: JSON.
_METADATA_STANDARD = "https://www.rfc-editor.org/rfc/rfc8259"


def create(database: sqlite3.Connection) -> None:
    """Create the tables and register their extensions."""
    script = files("pipeline.formats.gis") / "records.sql"
    database.executescript(script.read_text(encoding="utf-8"))


def put_provenance(database: sqlite3.Connection, content: Mapping[str, object]) -> None:
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


def put_meanings(database: sqlite3.Connection, layer: str, columns: Iterable[str]) -> None:
    """Store the meanings of a layer's columns; software shows either the name or the title."""
    database.executemany(
        "INSERT INTO gpkg_data_columns (table_name, column_name, name, title, description)"
        " VALUES (?, ?, ?, ?, ?)",
        [
            (layer, column, FIELDS[column].alias, FIELDS[column].alias, FIELDS[column].meaning)
            for column in columns
        ],
    )


def put_styles(database: sqlite3.Connection, styles: Sequence[tuple[str, str, str]]) -> None:
    """Store a default style for each layer, given as (layer, description, QML)."""
    database.executemany(
        "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name,"
        " f_geometry_column, styleName, styleQML, styleSLD, useAsDefault, description, owner)"
        " VALUES ('', '', ?, 'geom', 'RENEW', ?, '', 1, ?, 'RENEW')",
        [(layer, text, description) for layer, description, text in styles],
    )
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description)"
        " VALUES ('layer_styles', 'attributes', 'Styles', 'How QGIS draws each layer')"
    )


def put_dates(database: sqlite3.Connection, created: datetime) -> None:
    """Date layers, styles and provenance by the run, so that the same run is the same file."""
    stamp = (created.strftime("%Y-%m-%dT%H:%M:%S.000Z"),)
    database.execute("UPDATE gpkg_contents SET last_change = ?", stamp)
    database.execute("UPDATE layer_styles SET update_time = ?", stamp)
    database.execute("UPDATE gpkg_metadata_reference SET timestamp = ?", stamp)


def put_project(database: sqlite3.Connection, name: str, packed: bytes, created: datetime) -> None:
    """Store a QGIS project as QGIS does: its .qgz in hexadecimal."""
    about = {"last_modified_time": created.strftime("%Y-%m-%dT%H:%M:%S"), "last_modified_user": ""}
    database.execute(
        "INSERT INTO qgis_projects (name, metadata, content) VALUES (?, ?, ?)",
        (name, json.dumps(about), packed.hex()),
    )
