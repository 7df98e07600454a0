"""`routes.gpkg`: layers in lon/lat (EPSG:4326), GeoPackage 1.3.

GDAL writes 1.4 by default, which GDAL 3.6, common on desktops, reads only in part. Lines that
are straight in the planner's plane are split into short pieces first: a GIS, which draws straight
lines in degrees, then shows and measures the planned line.

The QGIS project inside refers to the file by its name: the file may be moved, but not renamed.
"""

import sqlite3
from collections.abc import Mapping, Sequence
from pathlib import Path

from pipeline.formats.gis import records
from pipeline.formats.gis.layer_file import check_count, dated, opened, system_errors, write_layer
from pipeline.formats.gis.layers.all_layers import LAYERS
from pipeline.formats.gis.qgis import project
from pipeline.formats.gis.qgis.styles import qml
from pipeline.formats.gis.qgis.view import view
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
    counts, columns = {}, {}
    with system_errors(path), dated(result.created):
        for layer in LAYERS:
            frame = layer.frame(result)
            counts[layer.name] = len(frame)
            columns[layer.name] = ["fid", *frame.columns.drop("geometry")]
            write_layer(
                path,
                frame,
                layer.name,
                layer.geometry_type,
                title=layer.title,
                description=layer.description,
            )
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
    """Add everything but the layers: provenance, meanings of columns, styles, the project."""
    records.create(database)
    content = manifest(result, ())
    del content["outputs"]  # not complete yet: this file is one of them
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
