"""`routes.gpkg` of a cycle: each case's best route, and its best route on each other side."""

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import numpy as np

from pipeline.formats.gis.frames import (
    GeoDataFrame,
    check_count,
    opened,
    system_errors,
    write_layer,
)
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
# Date of the layer if the currents have none.
_NO_DATE = "1970-01-01T00:00:00.000Z"


def write_geopackage(routes_path: Path, path: Path, reference: datetime | None) -> None:
    """Write the layer from a cycle's routes; its date is the currents' reference time.

    Raises
    ------
    OSError
        The file can't be written, or is incomplete afterwards.
    """
    path.unlink(missing_ok=True)
    count = 0
    with system_errors(path):
        for chunk in _chunks(routes_path):
            write_layer(
                path,
                _frame(chunk),
                LAYER,
                "LineString",
                title="Routes of the night",
                description="The best route of each case (rank 1), and its best route on each "
                "other side; routes.parquet has all routes",
                append=count > 0,
            )
            count += len(chunk)
        with opened(path) as database:
            stamp = reference.strftime("%Y-%m-%dT%H:%M:%S.000Z") if reference else _NO_DATE
            database.execute("UPDATE gpkg_contents SET last_change = ?", (stamp,))
            check_count(database, LAYER, count)


def _chunks(routes_path: Path) -> Iterator[list[Row]]:
    """Yield the routes of the layer in chunks: the best route of each case on each side."""
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


def _frame(chunk: list[Row]) -> GeoDataFrame:
    """Return rows as a GeoDataFrame in lon/lat."""
    import geopandas

    # Without a zone: a GIS converts times with a zone to local time, and shows others unchanged.
    arrivals = [row["arrival"] and row["arrival"].replace(tzinfo=None) for row in chunk]
    return (
        geopandas.GeoDataFrame(
            chunk,
            columns=[*_TEXT, "rank", *_FIGURES],
            geometry=geopandas.GeoSeries.from_wkb([row["geometry"] for row in chunk]),
            crs="EPSG:4326",
        )
        .assign(arrival=np.array(arrivals, dtype="datetime64[ms]"))
        .astype({"rank": "int32", **dict.fromkeys(_FIGURES, float)})
    )
