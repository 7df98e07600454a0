"""`routes.gpkg` of a cycle: of each case the best route, and the best on each other side."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from datetime import datetime
from pathlib import Path

import numpy as np

from pipeline.formats.shared.os_errors import os_error
from pipeline.nightly.cycle.part import Row
from pipeline.nightly.publishing.changes import rows_of

GEOPACKAGE_FILE = "routes.gpkg"
LAYER = "routes"
_TEXT = ("case", "scenario", "season", "pair", "departure", "vessel", "member", "side", "class")
_FIGURES = (
    "fuel",
    "fuel_per_distance",
    "length_m",
    "duration_s",
    "clearance_m",
    "optimality_gap",
)
_CHUNK = 4096
# Date of the layer where the currents have none.
_NO_DATE = "1970-01-01T00:00:00.000Z"


def write_geopackage(routes_path: Path, path: Path, reference: datetime | None) -> None:
    """Write the layer from a cycle's routes; its date is the currents' reference time.

    Raises
    ------
    OSError
        The file can't be written, or is incomplete afterwards.
    """
    import pyogrio
    from pyogrio.errors import DataLayerError, DataSourceError, FeatureError

    path.unlink(missing_ok=True)
    count = 0
    try:
        for chunk in _chunks(routes_path):
            pyogrio.raw.write(
                path,
                np.array([row["geometry"] for row in chunk], dtype=object),
                _columns(chunk),
                np.array([*_TEXT, "rank", *_FIGURES, "arrival"]),
                layer=LAYER,
                driver="GPKG",
                geometry_type="LineString",
                crs="EPSG:4326",
                append=count > 0,
                dataset_options={"VERSION": "1.3"},
                layer_options={
                    "IDENTIFIER": "Routes of the night",
                    "DESCRIPTION": "Of each case the best route (rank 1) and the best on each other"
                    " side; routes.parquet has all",
                    "GEOMETRY_NAME": "geom",
                    "FID": "fid",
                },
            )
            count += len(chunk)
        with closing(sqlite3.connect(path)) as database, database:
            stamp = reference.strftime("%Y-%m-%dT%H:%M:%S.000Z") if reference else _NO_DATE
            database.execute("UPDATE gpkg_contents SET last_change = ?", (stamp,))
            found = database.execute(f'SELECT count(*) FROM "{LAYER}"').fetchone()[0]  # noqa: S608 - our own name
            if found != count:
                raise sqlite3.DatabaseError(f"it holds {found} of {count} routes")
    except (DataSourceError, DataLayerError, FeatureError, sqlite3.Error) as error:
        raise os_error(path, error) from error


def _chunks(routes_path: Path) -> Iterator[list[Row]]:
    """Give the routes that the layer shows, some thousands at a time."""
    chunk: list[Row] = []
    shown, case = set[str](), -1
    columns = ("index", *_TEXT, "rank", *_FIGURES, "arrival", "geometry")
    for row in rows_of(routes_path, columns):
        if row["index"] != case:
            shown, case = set(), row["index"]
        if row["side"] not in shown:
            shown.add(row["side"])
            chunk.append(row)
        if len(chunk) == _CHUNK:
            yield chunk
            chunk = []
    if chunk:
        yield chunk


def _columns(chunk: list[Row]) -> list[np.ndarray[tuple[int, ...], np.dtype[np.generic]]]:
    """Return the columns of some rows."""
    figures = [
        np.array([np.nan if row[name] is None else row[name] for row in chunk], dtype=float)
        for name in _FIGURES
    ]
    texts = [np.array([row[name] for row in chunk], dtype=object) for name in _TEXT]
    arrivals = np.array(
        [
            np.datetime64("NaT") if row["arrival"] is None else row["arrival"].replace(tzinfo=None)
            for row in chunk
        ],
        dtype="datetime64[ms]",
    )
    return [*texts, np.array([row["rank"] for row in chunk], dtype=np.int32), *figures, arrivals]
