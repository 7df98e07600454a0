"""Files for a GIS: `routes.gpkg`, with a QGIS project inside, and each case's `.geojson`.

GDAL writes version 1.4 of the format by default; GDAL 3.6, common on desktops, reads it only in
part. Lines that are straight in the planner's plane are split into short pieces first: a GIS, which
draws straight lines in degrees, then shows and measures the planned line.

The project opens as a finished map. Its layers are listed in a group per case, with land below;
land is drawn over the soft no-go zones, as in the paper. It refers to the file by its name: the
file may be moved, but not renamed.
"""

import io
import json
import sqlite3
import textwrap
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import shapely

from pipeline._types import FloatArray
from pipeline.findings.names import COLUMNS
from pipeline.findings.note_words import caveats_json
from pipeline.findings.result import RunCase, RunResult
from pipeline.findings.text import write_json
from pipeline.formats.appearance import COLOURS
from pipeline.formats.gis import layers
from pipeline.formats.gis.styles import (
    LONLAT,
    STYLES,
    View,
    inert,
    map_crs,
    one_line,
    qml,
    rendered,
    style,
    view,
)
from pipeline.formats.passage.waypoints import (
    attribution,
    case_waypoints,
    document_title,
    split_at_antimeridian,
    within_180,
)
from pipeline.formats.records import manifest

# Layers of a case's group -> whether the leading case shows them at first.
_CASE_LAYERS = {
    **dict.fromkeys(("passage", "routes", "legs"), True),
    **dict.fromkeys(("path_points", "contingency", "adrift"), False),
    **dict.fromkeys(
        ("narrow_stretches", "shore_crossings", "havens", "coverage", "diversions"), True
    ),
    "channels": False,
    "near_best": False,
    "soft_no_go": True,
    "currents": True,
}
# Geometry type of a layer -> QGIS's name for it.
_GEOMETRIES = {"LineString": "Line", "Point": "Point", "MultiPolygon": "Polygon"}
# Maximum number of characters of a line of credits on the map.
_WRAP = 100


def qgz(result: RunResult, view: View, tables: Mapping[str, Any], file_name: str) -> bytes:
    """Write the project as a .qgz; `tables` are the layers of the file `file_name`, by name."""
    crs = map_crs(result)
    view = replace(view, convergence=crs.convergence)
    texts = dict.fromkeys(credit.text for credit in result.credits)
    document = rendered(
        "project.qgs.jinja",
        title=one_line(result.scenario.title or result.scenario.name),
        crs=crs,
        lonlat=pyproj.CRS(LONLAT),
        layers=list(_project_layers(tables, view, file_name)),
        cases=view.cases,
        lead=view.lead,
        case_layers=_CASE_LAYERS,
        columns=_columns(tables),
        fields=COLUMNS,
        file_name=file_name,
        water=bytes.fromhex(COLOURS["water"].removeprefix("#")),
        result=result,
        credits=inert("\n".join(line for text in texts for line in textwrap.wrap(text, _WRAP))),
        times=[time for one in result.routes for time in layers.passage(one)],
        licences=dict.fromkeys(credit.licence for credit in result.credits if credit.licence),
    )
    stamp = result.created.timetuple()[:6]
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        entry = zipfile.ZipInfo("routes.qgs", stamp)
        entry.compress_type = zipfile.ZIP_DEFLATED
        archive.writestr(entry, document)
    return packed.getvalue()


def _columns(tables: Mapping[str, Any]) -> dict[str, list[str]]:
    """Return the columns of each layer in the file."""
    return {name: ["fid", *table] for name, table in tables.items()}


def _project_layers(
    tables: Mapping[str, Any], view: View, file_name: str
) -> Iterator[dict[str, Any]]:
    """Yield the layers of the project in their drawing order, the top one first.

    A layer is one case's part of a layer of the file, if it has any, or all of it. At first land,
    all best routes and one case in full are drawn. The leading case is below the others, since its
    best route is wider.
    """
    for name in [name for name in STYLES if name in tables]:
        shared = {
            "name": name,
            "layer": layers.LAYERS[name],
            # QGIS wants identifiers of more than ten characters.
            "identity": f"{name}_all_seasons",
            "geometry": _GEOMETRIES[layers.LAYERS[name]["geometry_type"]],
            "source": f"./{file_name}|layername={name}",
        }
        if name not in _CASE_LAYERS:
            yield {**shared, "case": None, "is_on": True, "style": style(name, view)}
            continue
        for case in sorted(view.cases, key=lambda case: case is view.lead):
            if (tables[name].season == case.name).any():
                yield {
                    **shared,
                    "identity": f"{name}_season_{case.number + 1}",
                    "case": case,
                    "is_on": name == "routes" or (case is view.lead and _CASE_LAYERS[name]),
                    "style": style(name, replace(view, cases=(case,))),
                    "source": f'{shared["source"]}|subset="season" = {_sql(case.name)}',
                }


def _sql(text: str) -> str:
    """Write text for SQL, odd characters in hexadecimal: QGIS parses the text of a source."""
    if text.replace("-", "").replace("_", "").isalnum():
        return f"'{text}'"
    return f"CAST(X'{text.encode('utf-8', 'replace').hex()}' AS TEXT)"


# Name of the project inside the file, as QGIS lists it.
PROJECT = "RENEW"

# Standard of the metadata's form: JSON.
_METADATA_STANDARD = "https://www.rfc-editor.org/rfc/rfc8259"


def write_geopackage(result: RunResult, path: Path) -> None:
    """Write the layers of a run that have features to a new file at `path`; routes always."""
    tables = {}
    with layers.system_errors(path), layers.dated(result.created):
        for name, about in layers.LAYERS.items():
            frame = layers.FRAMES[name](result)
            if frame.empty and name != "routes":
                continue
            tables[name] = frame.drop(columns="geometry")
            layers.write_layer(path, frame, name, about)
        with layers.opened(path) as database:
            _add_records(database, result, tables, path.name)
            for name, table in tables.items():
                layers.check_count(database, name, len(table))


def _add_records(
    database: sqlite3.Connection, result: RunResult, tables: Mapping[str, Any], file_name: str
) -> None:
    """Add everything besides the layers: provenance, meanings of columns, styles, the project."""
    columns = _columns(tables)
    script = files("pipeline.formats.gis") / "records.sql"
    database.executescript(script.read_text(encoding="utf-8"))
    # Inputs, credits and versions, as JSON in the metadata of the whole file.
    content = manifest(result, ())
    del content["outputs"]  # not complete yet: this file is one of them
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
    # Name and title are equal, because software shows one or the other.
    database.executemany(
        "INSERT INTO gpkg_data_columns (table_name, column_name, name, title, description)"
        " VALUES (?, ?, ?, ?, ?)",
        [
            (layer, name, COLUMNS[name].alias, COLUMNS[name].alias, COLUMNS[name].meaning)
            for layer, names in columns.items()
            for name in names
        ],
    )
    map_view = view(result)
    database.executemany(
        "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name,"
        " f_geometry_column, styleName, styleQML, styleSLD, useAsDefault, description, owner)"
        " VALUES ('', '', ?, 'geom', 'RENEW', ?, '', 1, ?, 'RENEW')",
        [
            (name, qml(name, map_view, of_layer), layers.LAYERS[name]["title"])
            for name, of_layer in columns.items()
        ],
    )
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description)"
        " VALUES ('layer_styles', 'attributes', 'Styles', 'How QGIS draws each layer')"
    )
    # Dated by the run, so that equal runs give equal files.
    stamp = (result.created.strftime("%Y-%m-%dT%H:%M:%S.000Z"),)
    database.execute("UPDATE gpkg_contents SET last_change = ?", stamp)
    database.execute("UPDATE layer_styles SET update_time = ?", stamp)
    database.execute("UPDATE gpkg_metadata_reference SET timestamp = ?", stamp)
    # QGIS stores a project as its .qgz in hexadecimal.
    modified = result.created.strftime("%Y-%m-%dT%H:%M:%S")
    about = {"last_modified_time": modified, "last_modified_user": ""}
    packed = qgz(result, map_view, tables, file_name)
    database.execute(
        "INSERT INTO qgis_projects (name, metadata, content) VALUES (?, ?, ?)",
        (PROJECT, json.dumps(about), packed.hex()),
    )


# Decimals of degrees, to resolve a centimetre: RFC 7946 asks for no more than is needed.
_DECIMALS = 7


def write_geojson(case: RunCase, path: Path) -> None:
    """Write a case's routes and their waypoints, best first.

    Routes have the geometry and columns of the GeoPackage's layer `routes`: their pieces, straight
    in degrees, lie within a metre of the planned line. Lines are cut at 180 degrees. The property
    `feature` of each feature is "route" or "waypoint".
    """
    routes = layers.FRAMES["routes"](case.run)
    routes = routes[routes.season == case.name]
    # A line across 180 degrees is drawn in parts.
    parts = (split_at_antimeridian(shapely.get_coordinates(line)) for line in routes.geometry)
    lines = [shapely.LineString(p[0]) if len(p) == 1 else shapely.MultiLineString(p) for p in parts]
    found = case_waypoints(case)
    waypoints = layers.waypoint_frame(found)
    waypoints["geometry_type"] = [points.curve for points in found for _ in points.lonlat]
    places = within_180(np.concatenate([points.lonlat for points in found]))
    collection = {
        "type": "FeatureCollection",
        "bbox": bounding_box(routes.total_bounds.reshape(2, 2)),
        "title": document_title(case),
        "credits": attribution(case.run),
        **caveats_json(case.run),
        "features": [
            *_features("route", routes.set_geometry(lines)),
            *_features("waypoint", waypoints.set_geometry(shapely.points(places))),
        ],
    }
    write_json(path, collection, indent=None)


def _features(kind: str, frame: layers.GeoDataFrame) -> list[dict[str, Any]]:
    """Return features of a kind, their coordinates rounded."""
    shapes = shapely.transform(frame.geometry.array, lambda points: np.round(points, _DECIMALS))
    frame = frame.set_geometry(shapes).assign(feature=kind)
    return list(frame.iterfeatures(na="null", drop_id=True))


def bounding_box(corners: FloatArray) -> list[float]:
    """Return west, south, east, north; west is greater than east if the box crosses 180 degrees."""
    (west, south), (east, north) = corners
    if east - west >= 360:
        west, east = -180.0, 180.0
    ends = within_180(np.array([[west, south], [east, north]]))
    # An eastern limit of 180 degrees must not become -180.
    ends[1, 0] = 180.0 if ends[1, 0] == -180 else ends[1, 0]
    return [float(value) for value in np.round(ends, _DECIMALS).ravel()]
