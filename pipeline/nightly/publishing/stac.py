"""`item.json`: a cycle as a static STAC item, for catalogues (https://stacspec.org, 1.1.0).

It is written without pystac, which would not make the code shorter, and whose `Link` would turn the
relative `self` into an absolute path. The tests read the item with pystac and check the schemas.
"""

import json
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

import pyarrow.parquet as pq
import shapely

from pipeline.nightly.cycle.earlier import CASES_FILE
from pipeline.nightly.cycle.look_back import HISTORY_FILE
from pipeline.nightly.publishing.changes import CHANGES_FILE
from pipeline.nightly.publishing.geopackage import GEOPACKAGE_FILE
from pipeline.nightly.publishing.merging import ROUTES_FILE
from pipeline.nightly.publishing.page import PAGE_FILE

ITEM_FILE = "item.json"
_VERSION = "1.1.0"
_PARQUET = "application/vnd.apache.parquet"
_ASSETS = {
    "cases": (CASES_FILE, _PARQUET, "One row per case: its best route, and what changed", ["data"]),
    "routes": (ROUTES_FILE, _PARQUET, "One row per route", ["data"]),
    "geopackage": (
        GEOPACKAGE_FILE,
        "application/geopackage+sqlite3",
        "The best routes, for a GIS",
        ["data"],
    ),
    "changes": (CHANGES_FILE, "text/csv", "What changed since the cycle before", ["metadata"]),
    "history": (HISTORY_FILE, _PARQUET, "All cycles' cases and figures", ["metadata"]),
    "page": (PAGE_FILE, "text/html", "What to look at", ["overview"]),
}


def item_text(cycle: str, moment: datetime, routes_path: Path, counts: Mapping[str, int]) -> str:
    """Return a cycle's item as JSON; `moment` is the time of the currents or else of the night."""
    box = _bounds(routes_path)
    item = {
        "type": "Feature",
        "stac_version": _VERSION,
        "stac_extensions": [],
        "id": cycle,
        "geometry": shapely.geometry.mapping(shapely.box(*box)),
        "bbox": list(box),
        "properties": {
            "datetime": moment.strftime("%Y-%m-%dT%H:%M:%SZ"),
            "title": f"Routes of the night {cycle}",
            **{f"renew:{outcome}": count for outcome, count in counts.items()},
        },
        "links": [{"rel": "self", "href": f"./{ITEM_FILE}", "type": "application/geo+json"}],
        "assets": {
            key: {"href": f"./{name}", "type": kind, "title": title, "roles": roles}
            for key, (name, kind, title, roles) in _ASSETS.items()
        },
    }
    return json.dumps(item, indent=2) + "\n"


def _bounds(routes_path: Path) -> tuple[float, float, float, float]:
    """Return the bounds (west, south, east, north) of all routes, degrees."""
    file = pq.ParquetFile(routes_path)
    bounds = []
    for group in range(file.num_row_groups):
        column = file.read_row_group(group, ["geometry"])["geometry"].to_pylist()
        if column:
            bounds.append(shapely.total_bounds(shapely.from_wkb(column)).tolist())
    west, south, east, north = zip(*bounds, strict=True)
    return min(west), min(south), max(east), max(north)
