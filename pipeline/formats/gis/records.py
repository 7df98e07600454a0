"""Tables of the GeoPackage beside the layers: styles, column meanings, provenance, project."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime

from pipeline.formats.gis.layers.fields import FIELDS

_SCHEMAS = """
CREATE TABLE IF NOT EXISTS gpkg_extensions (
  table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL, definition TEXT NOT NULL,
  scope TEXT NOT NULL, CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name));
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
CREATE TABLE IF NOT EXISTS gpkg_data_columns (
  table_name TEXT NOT NULL,
  column_name TEXT NOT NULL,
  name TEXT,
  title TEXT,
  description TEXT,
  mime_type TEXT,
  constraint_name TEXT,
  CONSTRAINT pk_gdc PRIMARY KEY (table_name, column_name),
  CONSTRAINT gdc_tn UNIQUE (table_name, name));
CREATE TABLE IF NOT EXISTS gpkg_data_column_constraints (
  constraint_name TEXT NOT NULL,
  constraint_type TEXT NOT NULL,
  value TEXT,
  min NUMERIC,
  min_is_inclusive BOOLEAN,
  max NUMERIC,
  max_is_inclusive BOOLEAN,
  description TEXT,
  CONSTRAINT gdcc_ntv UNIQUE (constraint_name, constraint_type, value));
CREATE TABLE layer_styles (
  id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  f_table_catalog TEXT(256),
  f_table_schema TEXT(256),
  f_table_name TEXT(256),
  f_geometry_column TEXT(256),
  styleName TEXT(30),
  styleQML TEXT,
  styleSLD TEXT,
  useAsDefault BOOLEAN,
  description TEXT,
  owner TEXT(30),
  ui TEXT(30),
  update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')));
CREATE TABLE qgis_projects (name TEXT PRIMARY KEY, metadata BLOB, content BLOB);
"""
_EXTENSIONS = {
    "gpkg_metadata": (
        ("gpkg_metadata", "gpkg_metadata_reference"),
        "http://www.geopackage.org/spec121/#extension_metadata",
    ),
    "gpkg_schema": (
        ("gpkg_data_columns", "gpkg_data_column_constraints"),
        "http://www.geopackage.org/spec121/#extension_schema",
    ),
}
# Standard of the metadata's form: JSON.
_METADATA_STANDARD = "https://www.rfc-editor.org/rfc/rfc8259"


def create(database: sqlite3.Connection) -> None:
    """Create the tables and register their extensions."""
    database.executescript(_SCHEMAS)
    database.executemany(
        "INSERT INTO gpkg_extensions VALUES (?, NULL, ?, ?, 'read-write')",
        [
            (table, name, definition)
            for name, (tables, definition) in _EXTENSIONS.items()
            for table in tables
        ],
    )


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
