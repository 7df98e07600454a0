"""Reading chart geometries, and operations on them in lon/lat degrees (repair, clip, buffer).

Errors of libraries about a damaged or hostile chart of the user's become one line. GDAL's drivers
that would obey a file, instead of only reading it, are not used. And a file that leads to another
file or to an address is refused before a library follows it: GDAL fetches a GeoJSON's CRS that is a
link, and reads what a virtual table of a GeoPackage names; PROJ opens the grids that a CRS names; a
view of a GeoPackage may never end.
"""

import glob
import hashlib
import json
import math
import mmap
import re
import sqlite3
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import numpy.typing as npt
import pyproj
import shapely
from shapely import affinity

from pipeline._types import BoolArray, FloatArray, Geometries, IntArray
from pipeline.errors import PipelineError, RequestError
from pipeline.geo.projection import MAX_EDGE_M, METRES_PER_DEGREE, Projection
from pipeline.machine.paths import packed_reason, require_readable
from pipeline.machine.store import file_hash
from pipeline.model import Note, PlaceName
from pipeline.scenario.strict import near_miss
from pipeline.texts import clean

# Distance outside the region's bounds up to which the chart is used, m: land outside may reach in
# once it is buffered or gaps are closed, and a map needs its surroundings.
BEYOND_M = 20_000.0

# Dimension of areas in shapely.
_AREA = 2
_TURN = 360.0
HALF_TURN = 180.0
"""Half a turn, degrees."""
# Whole turns, degrees, by which longitudes may differ.
_WHOLE_TURNS = (-_TURN, 0.0, _TURN)
# Segments per quarter circle: the buffer around a point has 16 corners.
_QUADRANT_SEGMENTS = 4
# Grid on which areas are merged and subtracted, degrees (1 cm): an overlap or gap that is narrower
# comes from rounding.
_GRID_DEG = 1e-7
NAME_COLUMNS = ("name", "objnam")
"""Columns that hold names of land, in lower case: the usual one, and the one of S-57 charts."""
MAX_NAME = 100
"""Length to which a name in a file is cut, characters."""


def box_around(region: shapely.Polygon, beyond_m: float = BEYOND_M) -> shapely.Polygon:
    """Return the region's bounds widened by metres; at most 360 degrees wide, poles included."""
    west, south, east, north = region.bounds
    lat_deg = beyond_m / METRES_PER_DEGREE
    south, north = max(south - lat_deg, -90.0), min(north + lat_deg, 90.0)
    cosine = math.cos(math.radians(max(abs(south), abs(north))))
    limit = (360 - (east - west)) / 2
    lon_deg = min(lat_deg / cosine, limit) if cosine > lat_deg / 360 else limit
    return shapely.box(west - lon_deg, south, east + lon_deg, north)


def meets_box(bounds: FloatArray, box: shapely.Polygon) -> BoolArray:
    """Say which bounds (n, 4), degrees, meet a box after a move by whole turns."""
    return np.asarray(np.any([_meets(bounds, box, turn) for turn in _WHOLE_TURNS], axis=0))


def _meets(bounds: FloatArray, box: shapely.Polygon, turn: float) -> BoolArray:
    """Say which bounds (n, 4), moved east by some degrees, meet a box."""
    west, south, east, north = box.bounds
    xmin, ymin, xmax, ymax = bounds.T
    meets: BoolArray = (
        (xmin + turn <= east) & (xmax + turn >= west) & (ymin <= north) & (ymax >= south)
    )
    return meets


def near_box(geometries: Geometries, box: shapely.Polygon) -> tuple[Geometries, IntArray]:
    """Return the geometries whose bounds meet a box, in its longitudes, and their indices.

    They are moved by whole turns; one that meets the box after two different moves comes twice.
    """
    bounds = shapely.bounds(geometries)
    near: list[Geometries] = [np.empty(0, dtype=object)]
    index: list[IntArray] = [np.empty(0, dtype=np.int64)]
    for turn in _WHOLE_TURNS:
        meets = _meets(bounds, box, turn)
        chosen = geometries[meets]
        if turn:
            chosen[:] = [affinity.translate(geometry, turn) for geometry in chosen]
        near.append(chosen)
        index.append(np.flatnonzero(meets))
    return np.concatenate(near), np.concatenate(index)


def joined_at_180(parts: Geometries) -> tuple[Geometries, BoolArray]:
    """Make longitudes continuous where they jump by more than half a turn; say in which parts (n,).

    No edge is that long: the part crosses 180 degrees (or 0), and its file has not split it there.
    """
    joined = parts.copy()
    west, _, east, _ = shapely.bounds(parts).T
    for at in np.flatnonzero(east - west > HALF_TURN):
        joined[at] = _continued(parts[at])
    return joined, ~shapely.equals_identical(joined, parts)


def _continued(part: shapely.Geometry) -> shapely.Geometry:
    """Continue the longitudes of a line, or of a polygon's rings.

    A ring that goes round a pole stays as it is, and so does an edge from -180 to 180 degrees.
    """
    is_area = shapely.get_dimensions(part) == _AREA
    lines: list[FloatArray] = []
    for line in (part.exterior, *part.interiors) if is_area else (part,):
        points = shapely.get_coordinates(line)
        steps = np.diff(points[:, 0])
        jumps = (np.abs(steps) > HALF_TURN) & (np.abs(steps) < _TURN - _GRID_DEG)
        turns = np.concatenate([[0.0], -np.cumsum(np.sign(steps) * jumps)])
        if not (is_area and turns[-1]):
            points[:, 0] += _TURN * turns
        if lines:  # a hole: moved by whole turns to its shell
            apart = lines[0][:, 0].mean() - points[:, 0].mean()
            points[:, 0] += _TURN * np.round(apart / _TURN)
        lines.append(points)
    return shapely.Polygon(lines[0], lines[1:]) if is_area else shapely.LineString(lines[0])


def repaired(geometries: Geometries, is_valid: BoolArray | None = None) -> tuple[Geometries, int]:
    """Make invalid areas valid, covering all that their rings enclose; count the invalid ones.

    A line of no length becomes a point. `is_valid` (n,) is computed if it isn't given.
    """
    is_invalid = ~(shapely.is_valid(geometries) if is_valid is None else is_valid)
    if not is_invalid.any():
        return geometries, 0
    valid = geometries.copy()
    is_area = shapely.get_dimensions(geometries) == _AREA
    for chosen, keeps_collapsed in ((is_invalid & is_area, False), (is_invalid & ~is_area, True)):
        valid[chosen] = shapely.make_valid(
            geometries[chosen], method="structure", keep_collapsed=keeps_collapsed
        )
    return valid, int((is_invalid & is_area).sum())


def in_plane(polygons: Sequence[shapely.Geometry] | Geometries, plane: Projection) -> Geometries:
    """Return the valid polygons of areas (lon/lat degrees) in a plane, long edges divided.

    They are repaired before, because dividing alone would drop half of a figure of eight, and
    afterwards, because what is valid in degrees may be invalid in the plane.
    """
    degrees, _ = repaired(np.array(polygons, dtype=object))
    return extract_polygons(repaired(plane.geometry_to_plane(degrees, MAX_EDGE_M))[0])


def repair_note(name: str, count: int) -> tuple[Note, ...]:
    """Note that areas of a source were invalid; nothing where there were none."""
    return (Note.of("areas-repaired", source=name, count=count),) if count else ()


def clipped(polygons: Geometries, box: shapely.Polygon) -> Geometries:
    """Cut valid areas along a box; those inside stay as they are."""
    shapely.prepare(box)
    crosses = ~shapely.covers(box, polygons)
    cut = shapely.intersection(polygons[crosses], box)
    return extract_polygons(np.concatenate([polygons[~crosses], cut]))


def flattened(geometries: Geometries | shapely.Geometry) -> Geometries:
    """Take the points, lines and polygons out of collections, however deeply they are nested."""
    geometries = np.atleast_1d(geometries)
    while (shapely.get_type_id(geometries) >= shapely.GeometryType.MULTIPOINT).any():
        geometries = shapely.get_parts(geometries)
    return geometries


def extract_polygons(geometries: Geometries | shapely.Geometry) -> Geometries:
    """Take the polygons out of any geometries, dropping points and lines that clipping left."""
    parts = flattened(geometries)
    is_polygon = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    return np.asarray(parts[is_polygon & ~shapely.is_empty(parts)])


def merged(geometries: Geometries | Sequence[shapely.Geometry]) -> shapely.Geometry:
    """Merge areas, closing the gaps that rounding leaves between neighbours."""
    return shapely.union_all(geometries, grid_size=_GRID_DEG)


def subtract(area: shapely.Geometry, taken: shapely.Geometry) -> shapely.Geometry:
    """Take one area from another, leaving no slivers where they touch."""
    return shapely.difference(area, taken, grid_size=_GRID_DEG)


def inner_lines(lines: Geometries, area: shapely.Geometry) -> Geometries:
    """Return the parts of lines that lie inside an area and not on its boundary."""
    inside = shapely.intersection(lines, area, grid_size=_GRID_DEG)
    inner = shapely.difference(inside, shapely.boundary(area), grid_size=_GRID_DEG)
    return np.asarray(inner[shapely.length(inner) > 0])


def buffered(geometries: Geometries, radius_m: npt.ArrayLike) -> Geometries:
    """Buffer geometries by true metres; the polygon around a point encloses its circle."""
    if len(geometries) == 0:
        return geometries
    box = shapely.box(*shapely.total_bounds(geometries))
    plane = Projection.for_region(box.buffer(0.01))
    planar = plane.geometry_to_plane(geometries)
    centres = shapely.get_coordinates(shapely.centroid(geometries))
    # The polygon's edges, not its corners, must be at the radius.
    edge_to_corner = math.cos(math.pi / (4 * _QUADRANT_SEGMENTS))
    radius = np.asarray(radius_m) * plane.point_scale(centres) / edge_to_corner
    grown = shapely.buffer(planar, radius, quad_segs=_QUADRANT_SEGMENTS)
    return np.asarray(plane.geometry_to_lonlat(grown))


def named_places(names: Sequence[object], geometries: Geometries) -> Iterator[PlaceName]:
    """Yield the names of areas (lon/lat degrees); points, lines and unnamed areas are left out.

    Of several areas under one name, such as a country's, only the largest has it.
    """
    for name, geometry in zip(names, geometries, strict=True):
        parts = extract_polygons(geometry)
        text = clean(name, MAX_NAME) if isinstance(name, str) else ""
        if not text or not len(parts):
            continue
        largest = parts[shapely.area(parts).argmax()]
        point = shapely.point_on_surface(largest)
        yield PlaceName(text, float(point.x), float(point.y), float(largest.area))


# Largest longitude and latitude, degrees. Longitudes are counted to 180 or to 360 degrees, and may
# lie half a turn beyond either range. Latitudes may lie beyond a pole by rounding.
MAX_LONLAT = (540.0, 90.01)
# Names of GDAL's own functions, with which some of its messages begin.
_FUNCTION = re.compile(r"\bOGR\w+\(\): ")
# Ends of GDAL's messages that are about its own options.
_ADVICE = re.compile(r"(\.; It might help|\. To avoid accepting|\. Further messages).*|\.$")
# Warnings that do not matter for land: on measures along lines, and on numbers of features.
_HARMLESS = re.compile(r"Measured \(M\) geometry types|Several features with id")
# Length to which a message of a library is cut, characters.
_MAX_REASON = 200


# GDAL's drivers that are used: each reads a file and its sidecar files alone. Of its others, some
# take a file's content for a command: to read other files or addresses, to start a program.
_DRIVERS = {"CSV", "ESRI Shapefile", "FlatGeobuf", "GPKG", "GeoJSON", "LIBKML", "S57"}
# No file needs the network: libcurl refuses this proxy before it opens a socket.
_NO_NETWORK = {"GDAL_HTTP_PROXY": "none://"}


@cache
def vector_library() -> ModuleType:
    """Import pyogrio with only those of GDAL's drivers that follow nothing in a file."""
    pyogrio = import_module("pyogrio")
    from pyogrio._ogr import _register_drivers  # it has no public function for this

    # GDAL looks at this option when it registers its drivers, which importing pyogrio does.
    unused = sorted(set(pyogrio.list_drivers()) - _DRIVERS)
    pyogrio.set_gdal_config_options({"GDAL_SKIP": ",".join(unused), **_NO_NETWORK})
    _register_drivers()
    return pyogrio


@contextmanager
def reading(what: str, remedy: str) -> Iterator[list[str]]:
    """Turn errors of libraries about a file into a RequestError, and list their warnings.

    Libraries raise errors of many kinds about damaged files; the text of each states the damage.
    """
    issued: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            yield issued
        except (PipelineError, MemoryError):
            raise
        except Exception as error:
            raise RequestError(f"{what} can't be read ({one_line(error)}); {remedy}") from error
        finally:
            said = dict.fromkeys(one_line(warning.message) for warning in caught)
            issued += [text for text in said if not _HARMLESS.match(text)]


def one_line(message: object) -> str:
    """Write a library's message in one line, without its own functions and options."""
    return clean(_ADVICE.sub("", _FUNCTION.sub("", clean(str(message)))), _MAX_REASON)


def reading_chart(path: Path) -> AbstractContextManager[list[str]]:
    """Turn errors about a chart's file into a RequestError, and list warnings."""
    return reading(str(path), "correct it, or export it again as GeoPackage, GeoJSON or Shapefile")


def layer_name(path: Path, name: str) -> str:
    """Return the name of the layer to read."""
    pyogrio = vector_library()
    names = [str(layer) for layer, kind in pyogrio.list_layers(path) if kind is not None]
    if not names:
        raise RequestError(
            f"{path} has no layer with geometries; correct it, or give the file that has the land"
        )
    if name and name not in names:
        raise RequestError(f"{path} has no layer {name!r}: {near_miss(name, names)}")
    if not name and len(names) != 1:
        raise RequestError(
            f"{path} has {len(names)} layers with geometries ({', '.join(names)}); name one, as "
            f"{path.name},layer={names[0]} or in a scenario "
            f'{{ path = "{path.name}", layer = "…" }}'
        )
    return name or names[0]


def crs_of(path: Path, given: str | None) -> pyproj.CRS:
    """Return the CRS of a layer, given as text."""
    if not given:
        raise RequestError(
            f"{path} does not give its CRS: add its .prj file, or name the CRS, for degrees as "
            f'{path.name},crs=EPSG:4326 or in a scenario {{ path = "{path.name}", crs = '
            '"EPSG:4326" }'
        )
    try:
        return pyproj.CRS.from_user_input(given)
    except pyproj.exceptions.CRSError as error:
        raise RequestError(f"{path} has a CRS that pyproj does not know ({error})") from error


# A GeoJSON's member "crs" that is an object, its letters escaped or not. GDAL takes JSON strictly.
_JSON_CRS = re.compile(
    rb'"(?:[Cc]|\\u00[46]3)(?:[Rr]|\\u00[57]2)(?:[Ss]|\\u00[57]3)"\s*:\s*(?={)', re.IGNORECASE
)
# Types of such a CRS that name it: the others are links.
_NAMED = {"name", "epsg", "ogc"}
# Number of bytes up to which such a CRS is read; a longer one counts as a link.
_MOST = 100_000
# Parts of a CRS that name another file: grids or a model for a shift of datum (EPSG:3857 has the
# grid "null", which is no file), or a list of definitions.
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
# First bytes of a GeoPackage, and of a FlatGeobuf.
_SQLITE = b"SQLite format 3\0"
_FLATGEOBUF = b"fgb"


def files_of(path: Path) -> tuple[Path, ...]:
    """Return a file and its sidecar files, as .dbf and .prj, which GDAL reads too.

    A packed file beside it, from which it may come, is none of them.
    """
    beside = path.parent.glob(f"{glob.escape(path.stem)}.*")
    own = (file for file in beside if not (file.is_dir() or packed_reason(file)))
    files = tuple(sorted({path, *own}))
    require_readable(files, path.name)
    return files


def hash_of(files: Iterable[Path]) -> str:
    """Return a hash of the names and the content of files."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.name.encode() + file_hash(file).encode())
    return digest.hexdigest()


def require_self_contained(path: Path) -> None:
    """Raise RequestError if a vector file would make GDAL read anything but itself.

    Its sidecar files, and the updates of an S-57 cell belong to it.
    """
    if not path.is_file() or not path.stat().st_size:
        return
    from pyogrio.util import vsi_path

    files = files_of(path)
    with path.open("rb") as file:
        head = file.read(len(_SQLITE))
    if vsi_path(path) != str(path):
        raise RequestError(f"{path} has '!' or ';' in its name, or names an archive: rename it")
    if head == _SQLITE:
        own = _of_geopackage(path)
    else:
        own = _of_flatgeobuf(path) if head.startswith(_FLATGEOBUF) else _of_geojson(path)
    projections = (file.read_text("latin-1") for file in files if file.suffix.lower() == ".prj")
    if any(_FILES.search(text) for text in (*own, *projections)):
        raise RequestError(f"{path} has a CRS that is in another file; export it in EPSG:4326")


def _of_geojson(path: Path) -> Iterator[str]:
    """Yield each CRS of a file that may be a GeoJSON."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        for member in _JSON_CRS.finditer(content):
            text = content[member.end() : member.end() + _MOST].decode(errors="replace")
            try:
                crs, _ = json.JSONDecoder().raw_decode(text)
            except ValueError:
                crs = {"type": "link"}  # damaged, or longer than any true CRS
            kinds = [str(value) for key, value in crs.items() if key.casefold() == "type"]
            if not {kind.casefold() for kind in kinds} <= _NAMED:
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
