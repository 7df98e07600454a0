"""Vector files that lead to another file or to an address: refused before a library follows them.

GDAL fetches a GeoJSON's CRS that is a link, and reads what a virtual table of a GeoPackage names;
PROJ opens the grids that a CRS names; a view of a GeoPackage may never end.
"""

import glob
import json
import mmap
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from pyogrio.util import vsi_path

from pipeline.errors import RequestError
from pipeline.machine.paths import require_readable

# A GeoJSON's member "crs" that is an object, its letters escaped or not. GDAL takes JSON strictly.
_JSON_CRS = re.compile(
    rb'"(?:[Cc]|\\u00[46]3)(?:[Rr]|\\u00[57]2)(?:[Ss]|\\u00[57]3)"\s*:\s*(?={)', re.IGNORECASE
)
# Types of such a CRS that name it: the others are links.
_NAMED = {"name", "epsg", "ogc"}
# Number of bytes in which such a CRS ends.
_MOST = 100_000
# What names a file in a CRS: grids or a model of a shift of datum (that of EPSG:3857 is null), a
# list of definitions.
_FILES = re.compile(
    r'grids[\\"\s]*[=,](?![\\"\s]*@null[\s"\\])|\b(file|model|catalog|init)\s*=|parameterfile',
    re.IGNORECASE,
)
# Parts of a GeoPackage's schema that hold or index their own data.
_PLAIN = re.compile(
    r'create (table|(unique )?index|trigger|virtual table ("[^"]*"|\w+) using rtree)\b'
)
_LAYERS = (
    "SELECT lower(table_name) FROM gpkg_contents UNION "
    "SELECT lower(table_name) FROM gpkg_geometry_columns"
)
_SQLITE, _FLATGEOBUF, _ZIP = b"SQLite format 3\0", b"fgb", b"PK\x03\x04"


def files_of(path: Path) -> tuple[Path, ...]:
    """Return a file and its sidecar files, as .dbf and .prj, which GDAL reads too."""
    beside = path.parent.glob(f"{glob.escape(path.stem)}.*")
    files = tuple(sorted({path, *(one for one in beside if not one.is_dir())}))
    require_readable(files, path.name)
    return files


def require_self_contained(path: Path) -> None:
    """Raise RequestError if a vector file would make GDAL read anything but itself.

    Its sidecar files, and the updates of an S-57 cell belong to it.
    """
    if not path.is_file() or not path.stat().st_size:
        return
    files = files_of(path)
    with path.open("rb") as file:
        head = file.read(len(_SQLITE))
    if vsi_path(path) != str(path) or head.startswith(_ZIP):
        raise RequestError(
            f"{path} is an archive, or has '!' or ';' in its name: unpack or rename it"
        )
    if head == _SQLITE:
        own = _of_geopackage(path)
    else:
        own = _of_flatgeobuf(path) if head.startswith(_FLATGEOBUF) else _of_geojson(path)
    projections = (one.read_text("latin-1") for one in files if one.suffix.lower() == ".prj")
    if any(_FILES.search(text) for text in (*own, *projections)):
        raise RequestError(f"{path} has a CRS that is in another file; export it in EPSG:4326")


def _of_geojson(path: Path) -> Iterator[str]:
    """Yield each CRS of a file that may be a GeoJSON."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        for found in _JSON_CRS.finditer(content):
            text = content[found.end() : found.end() + _MOST].decode(errors="replace")
            try:
                crs, _ = json.JSONDecoder().raw_decode(text)
            except ValueError:
                crs = {"type": "link"}  # damaged, or as long as none is
            kinds = [str(value) for key, value in crs.items() if key.casefold() == "type"]
            if not {one.casefold() for one in kinds} <= _NAMED:
                raise RequestError(
                    f"{path} has a CRS that is a link, which is not followed: export it again with "
                    'the CRS\'s name, as in "crs": {"type": "name", "properties": {"name": '
                    '"urn:ogc:def:crs:OGC:1.3:CRS84"}}, or remove "crs" if it is in degrees'
                )
            yield json.dumps(crs, ensure_ascii=False)


def _of_flatgeobuf(path: Path) -> Iterator[str]:
    """Yield the header of a FlatGeobuf, which has its CRS."""
    with path.open("rb") as file:
        file.seek(8)
        yield file.read(int.from_bytes(file.read(4), "little")).decode("latin-1")


def _of_geopackage(path: Path) -> Iterator[str]:
    """Yield the CRSs of a GeoPackage; refuse views that are layers, and virtual tables."""
    with closing(sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True)) as database:
        parts = database.execute("SELECT lower(name), lower(sql) FROM sqlite_master WHERE sql > ''")
        odd = {name: sql for name, sql in parts if not _PLAIN.match(sql)}
        # A view that is neither a layer nor about layers is not run.
        idle = {
            name
            for name, sql in odd.items()
            if not name.startswith("gpkg_")
            and re.match(f'create view ("{re.escape(name)}"|{re.escape(name)}) ', sql)
        }
        refused = odd.keys() - idle
        if not refused:
            refused = idle & {name for (name,) in database.execute(_LAYERS)}
        if refused:
            raise RequestError(
                f"{path} has views or virtual tables as layers ({', '.join(sorted(refused))}), "
                "which may lead to other files or never end: export each as a table"
            )
        yield from map(str, database.execute("SELECT * FROM gpkg_spatial_ref_sys"))
