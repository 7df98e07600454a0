"""The layers of a run in lon/lat, and how they are written to a GeoPackage.

`layers.toml` has their titles and descriptions.
"""

import math
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import shapely

import renew
from pipeline._types import ArrayLike, BoolArray, FloatArray, Geometries, IndexArray
from pipeline.findings.haven_rows import LAST_TURNS, haven_rows, haven_ways, stretch_line
from pipeline.findings.names import COLUMNS, figure_columns, figures
from pipeline.findings.result import RankedRoute, RunCase, RunResult, continued
from pipeline.findings.route_profile import Legs, legs as planned_legs
from pipeline.findings.text import moment_text, os_error
from pipeline.formats.passage.safe_corridor import tracks
from pipeline.formats.passage.waypoints import Waypoints, case_waypoints, limits_text, time_after
from pipeline.geo.projection import GEOD
from pipeline.model import Case
from pipeline.texts import table_beside

_TYPES = {"text": object, "time": object, "whole": int, "flag": bool, "number": float}


GeoDataFrame: TypeAlias = Any  # of geopandas, which has no types and takes long to import

ROUTE_STEP_M = 2_000.0
"""Maximum length, true metres, of a segment of a route.

A straight line of the plane departs from the straight line in degrees by s²/8R·tan(latitude): by
0.1 m at 10 degrees, 0.2 m at 70.
"""

ZONE_STEP_M = 10_000.0
"""Maximum length, true metres, of a segment of a zone's edge: the chart is no more accurate."""


LAYERS: dict[str, dict[str, str]] = table_beside(__file__, "layers.toml")
"""The layers of `routes.gpkg`, by name, in their order in the file: texts and type of geometry."""


def frame(
    geometry: Sequence[Any] | Geometries,
    columns: Mapping[str, Sequence[ArrayLike | datetime | None]],
) -> GeoDataFrame:
    """Make the frame of a layer, without columns that have no value in it.

    Figures of routes stay, unless they are optional. `geometry` has one geometry per feature, or
    one array of geometries per route or case. A column has one value, or one array of values, per
    entry of `geometry`. Numbers that are not finite become NaN, which is written as NULL; times are
    in UTC.
    """
    import geopandas
    import pandas as pd

    counts, table = [np.size(part) for part in geometry], dict[str, Any]()
    # A column is typed and chosen before the frame is made: each change of a frame copies it.
    for name, values in columns.items():
        about = COLUMNS[name]
        column = _joined(values, counts, _TYPES[about.type])
        is_filled = pd.notna(column) & (column.astype(object) != "")
        if is_filled.any() or not len(column) or (about.files and not about.optional):
            is_time = about.type == "time"
            table[name] = pd.array(column, dtype="datetime64[s, UTC]") if is_time else column
    return geopandas.GeoDataFrame(table, geometry=_joined(geometry, counts, object), crs=4326)


def rows_frame(geometry: Geometries, rows: Sequence[Mapping[str, Any]]) -> GeoDataFrame:
    """Make the frame of a layer whose features each have a geometry and a row of cells."""
    return frame(geometry, {name: [row[name] for row in rows] for name in (rows[:1] or [{}])[0]})


def columns_of(records: Sequence[object], *names: str, **renamed: str) -> dict[str, list[Any]]:
    """Return columns of some attributes of records; `renamed` gives the attribute of a column."""
    attributes = {**dict(zip(names, names, strict=True)), **renamed}
    return {column: [getattr(one, name) for one in records] for column, name in attributes.items()}


def route_key(ranked: Sequence[RankedRoute]) -> dict[str, list[ArrayLike]]:
    """Return columns that identify routes."""
    return columns_of(ranked, "season", "rank")


def to_lonlat(result: RunResult, geometries: Sequence[Any], step_m: float) -> Geometries:
    """Transform planar geometries to lon/lat, with segments of at most `step_m` true metres.

    Areas become MultiPolygons.
    """
    array = np.empty(len(geometries), dtype=object)
    array[:] = geometries
    lonlat = result.water.projection.geometry_to_lonlat(array, densify_m=step_m)
    areas = not all(shapely.get_type_id(lonlat) == shapely.GeometryType.LINESTRING)
    return multipolygons(lonlat) if areas else lonlat


def multipolygons(areas: Sequence[Any] | Geometries) -> Geometries:
    """Make MultiPolygons of areas; lines and points that a union leaves are dropped."""
    multis = np.full(len(areas), shapely.MultiPolygon(), dtype=object)
    parts, index = shapely.get_parts(np.array(areas, dtype=object), return_index=True)
    polygons = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    shapely.multipolygons(parts[polygons], indices=index[polygons], out=multis)
    return multis


def _joined(
    values: Sequence[Any] | Geometries, counts: Sequence[int], dtype: type
) -> npt.NDArray[Any]:
    """Join arrays; a single value is repeated by its count."""
    parts: list[npt.NDArray[Any]] = [
        np.broadcast_to(np.asarray(value, dtype=dtype), count)
        for value, count in zip(values, counts, strict=True)
    ]
    column = np.concatenate([np.empty(0, dtype=dtype), *parts])
    return np.where(np.isfinite(column), column, np.nan) if dtype is float else column


def write_layer(path: Path, frame: GeoDataFrame, name: str, about: Mapping[str, str]) -> None:
    """Write a frame as a new layer of a name, with a title, description and type of geometry.

    SQLite does not wait for the disk here: all files are flushed together, when they are complete.
    """
    from pyogrio import set_gdal_config_options

    set_gdal_config_options({"OGR_SQLITE_SYNCHRONOUS": "OFF"})
    frame.to_file(
        path,
        layer=name,
        driver="GPKG",
        engine="pyogrio",
        index=False,
        geometry_type=about["geometry_type"],
        dataset_options={"VERSION": "1.3"},
        layer_options={
            "IDENTIFIER": about["title"],
            "DESCRIPTION": about["description"],
            "GEOMETRY_NAME": "geom",
            "FID": "fid",
        },
    )


@contextmanager
def dated(moment: datetime) -> Iterator[None]:
    """Date the layers that the block writes by the run, so that equal runs give equal files."""
    from pyogrio import set_gdal_config_options

    set_gdal_config_options({"OGR_CURRENT_DATE": moment.strftime("%Y-%m-%dT%H:%M:%S.000Z")})
    try:
        yield
    finally:
        set_gdal_config_options({"OGR_CURRENT_DATE": None})


@contextmanager
def opened(path: Path) -> Iterator[sqlite3.Connection]:
    """Open the file as a database, and commit what the block changes."""
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("PRAGMA synchronous = OFF")  # as in `write_layer`
        yield database


def check_count(database: sqlite3.Connection, layer: str, expected: int) -> None:
    """Count the features of a layer: on a full disk GDAL may close a file without an error."""
    count = database.execute(f'SELECT count(*) FROM "{layer}"').fetchone()[0]  # noqa: S608 - names are our own layers
    if count != expected:
        raise sqlite3.DatabaseError(f"layer {layer} holds {count} of {expected} features")


@contextmanager
def system_errors(path: Path) -> Iterator[None]:
    """Turn errors of GDAL and SQLite into an OSError."""
    from pyogrio.errors import DataLayerError, DataSourceError, FeatureError

    try:
        yield
    except (DataSourceError, DataLayerError, FeatureError, sqlite3.Error) as error:
        raise os_error(path, error) from error


def coast(result: RunResult) -> GeoDataFrame:
    """Return the original land: the no-go areas without shallow, uncharted or hazardous water.

    Beyond the region land continues in less detail, so that the map does not show water there.
    """
    land = result.fetched.land
    water = [zone.area for zone in land.zones if zone.kind in {"shoal", "uncharted", "hazard"}]
    polygons = np.array(land.polygons, dtype=object)
    if water:
        # One overlay of all areas is faster than one for each of a chart's hundreds of islets.
        left = shapely.difference(shapely.union_all(polygons), shapely.union_all(water))
        polygons = shapely.get_parts(left)
        polygons = polygons[shapely.area(polygons) > 0]
    return _counted(continued(polygons, np.array(result.fetched.surroundings, dtype=object)))


def region_edge(result: RunResult) -> GeoDataFrame:
    """Return the edge of the region, or of a plane's extent."""
    edge = shapely.boundary(np.array([result.water.chart.extent], dtype=object))
    return frame([result.water.projection.geometry_to_lonlat(edge, ZONE_STEP_M)], {})


def depth_areas(result: RunResult) -> GeoDataFrame:
    """Return areas of equal depth."""
    areas = result.fetched.land.depth_areas
    columns = columns_of(areas, "kind", depth_min_m="least_m", depth_max_m="greatest_m")
    return frame(multipolygons([one.area for one in areas]), columns)


def islands(result: RunResult) -> GeoDataFrame:
    """Return points on the islands that distinguish the ways."""
    islands = result.islands
    places = np.array([[island.x, island.y] for island in islands]).reshape(-1, 2)
    points = shapely.points(result.water.projection.to_lonlat(places))
    return frame(points, columns_of(islands, "number", "name"))


def _tidal_water(result: RunResult) -> GeoDataFrame:
    """Return areas that the tide shuts for some hours, with the hours of each case's voyage."""
    areas = [
        (case, area)
        for case in result.cases
        if case.planned is not None and case.planned.tidal_depth is not None
        for area in case.planned.tidal_depth.tidal_areas
    ]
    return frame(
        to_lonlat(result, [area.polygon for _, area in areas], ZONE_STEP_M),
        {
            "season": [case.name for case, _ in areas],
            **columns_of([area for _, area in areas], "name", need_m="need"),
            "hours": [_open_hours(case, area) for case, area in areas],
        },
    )


def _over_limit(result: RunResult) -> GeoDataFrame:
    """Return water where wind or waves are over a limit, with the hours of each case's voyage."""
    areas = [
        (case.case, area)
        for case in result.cases
        if case.planned is not None
        for area in case.planned.areas
        if isinstance(area, renew.OverLimit) and math.isfinite(area.most)
    ]
    return frame(
        to_lonlat(result, [area.polygon for _, area in areas], ZONE_STEP_M),
        {
            "season": [case.name for case, _ in areas],
            **columns_of([area for _, area in areas], "name", "unit", worst="most"),
            "shut_from": [_dated(case, area.begin) for case, area in areas],
            "shut_until": [_dated(case, area.end) for case, area in areas],
        },
    )


def _dated(case: Case, seconds: float) -> datetime | None:
    """Return a moment on a case's clock; None where that is infinite or begins at no date."""
    moment = case.moment(seconds)
    return moment if isinstance(moment, datetime) else None


def _open_hours(case: RunCase, area: renew.TidalArea) -> str:
    """Write when an area has enough water, from a case's departure to a day after arrival."""
    ends = [float(one.route.times[-1]) for one in case.routes]
    hours = area.tide.high_enough(area.need, 0.0, max(ends, default=0.0) + _DAY_S)
    spans = [[_dated(case.case, end) for end in span] for span in hours.tolist()]
    written = [[moment_text(end) if end else "" for end in span] for span in spans]
    return ", ".join(map(" to ".join, written)) or "never"


def _zones(result: RunResult, *, are_hazards: bool) -> GeoDataFrame:
    """Return areas of the chart: hazards with the room around them, or all others."""
    zones = [one for one in result.fetched.land.zones if (one.kind == "hazard") == are_hazards]
    areas = multipolygons([zone.area for zone in zones])
    return frame(areas, columns_of(zones, "kind", "name", "rule"))


def _counted(polygons: Sequence[shapely.Polygon] | Geometries) -> GeoDataFrame:
    """Return areas with their numbers of vertices."""
    vertices = shapely.get_num_coordinates(np.array(polygons, dtype=object))
    return frame(multipolygons(polygons), {"vertices": vertices})


# Time after the last arrival for which the hours of tidal water are written, s.
_DAY_S = 86_400.0
# Maximum distance, true metres, between a leg and the line drawn for it.
_ERROR_M = 1.0

# Maximum number of harmless turns shown per route: at true scale turns are simulated every few
# metres, and all of them would make a file of a gigabyte.
_MAX_TURNS = 2_000


def _passage(result: RunResult) -> GeoDataFrame:
    """Return waypoints of the routes, each with the leg that leaves it; the goal has none."""
    return waypoint_frame(_waypoints(result)).drop(columns=["port_m", "starboard_m"])


def legs(result: RunResult) -> GeoDataFrame:
    """Return the water within each leg's cross-track limits."""
    found = _waypoints(result)
    of_points = ["name", "time_s", "turn_radius_m", "passed_at"]
    frame = waypoint_frame(found).drop(columns=of_points, errors="ignore")
    frame = frame[frame.course_deg.notna()].reset_index(drop=True)
    areas = [area for points in found for area in _areas(points, result)]
    return frame.set_geometry(multipolygons(areas), crs=frame.crs)


def waypoint_frame(found: Sequence[Waypoints]) -> GeoDataFrame:
    """Return waypoints of some routes, each with the leg that leaves it and its limits."""
    counts = [len(points.lonlat) for points in found]
    return frame(
        [shapely.points(points.lonlat) for points in found],
        {
            **route_key([points.ranked for points in found]),
            "sequence": [np.arange(count) + 1 for count in counts],
            "name": [points.names for points in found],
            **_leg_columns([points.ranked for points in found], found),
            "turn_radius_m": [points.radius_m for points in found],
            **columns_of(found, "port_m", "starboard_m"),
        },
    )


def passage(ranked: RankedRoute) -> tuple[datetime, ...]:
    """Return departure and arrival of a route, UTC; nothing without a departure."""
    case = ranked.case
    return case.scenario.passage(case.name, round(ranked.metrics.duration_s)) or ()


def _leg_columns(
    ranked: Sequence[RankedRoute], tables: Sequence[Waypoints | Legs]
) -> dict[str, list[Any]]:
    """Return columns of the legs that leave the points of routes, and when these are passed."""
    left = [one.case.spec.departure for one in ranked]
    return {
        **columns_of(
            tables,
            "course_deg",
            leg_length_m="length_m",
            time_s="time_s",
            speed_over_ground_m_s="speed_m_s",
            speed_through_water_m_s="through_water_m_s",
        ),
        "passed_at": [
            [at and time_after(at, float(seconds)) for seconds in table.time_s]
            for at, table in zip(left, tables, strict=True)
        ],
    }


def _waypoints(result: RunResult) -> list[Waypoints]:
    """Return waypoints of routes; none of a planar scenario, which lies nowhere on earth."""
    if result.scenario.is_planar:
        return []
    return [points for case in result.cases for points in case_waypoints(case)]


def _areas(points: Waypoints, result: RunResult) -> Geometries:
    """Return the area of each leg between its limits; empty where both are 0."""
    begin, end = points.lonlat[:-1], points.lonlat[1:]
    drawn = tracks(begin, end, points.curve, result.water.projection, _ERROR_M)
    line = drawn.lonlat
    ahead = np.asarray(GEOD.inv(*line[:-1].T, *line[1:].T)[0])
    # The last point of a leg has the course on which the leg arrives there.
    last = np.append(drawn.leg[1:] != drawn.leg[:-1], True)
    course = np.where(last, np.roll(np.append(ahead, 0.0), 1), np.append(ahead, 0.0))
    sides = []
    for turn, limits in ((-90, points.port_m), (90, points.starboard_m)):
        lon, lat, _ = GEOD.fwd(line[:, 0], line[:, 1], course + turn, limits[drawn.leg])
        lon = line[:, 0] + (lon - line[:, 0] + 180) % 360 - 180
        sides.append(np.stack([lon, lat], axis=-1))
    areas = [
        shapely.Polygon(np.vstack([sides[0][drawn.leg == leg], sides[1][drawn.leg == leg][::-1]]))
        for leg in range(len(begin))
    ]
    return np.asarray(shapely.make_valid(areas))


def _routes(result: RunResult) -> GeoDataFrame:
    """Return routes, one line each, with the figures that have values in this run."""
    ranked = result.routes
    rows = [figures(r.metrics, "layer") for r in ranked]
    lines = to_lonlat(result, [shapely.LineString(r.route.path) for r in ranked], ROUTE_STEP_M)
    columns = {name: [row[name] for row in rows] for name in figure_columns("layer")}
    passages = [passage(r) or (None, None) for r in ranked]
    columns |= {
        "departure": [begin for begin, _ in passages],
        "arrival": [end for _, end in passages],
        "current": [r.case.current_text for r in ranked],
        "caveats": [limits_text(r) for r in ranked],
    }
    return frame(lines, {**route_key(ranked), **columns})


def _path_points(result: RunResult) -> GeoDataFrame:
    """Return vertices of the routes, each with the leg that leaves it; the goal has none."""
    ranked = result.routes
    tables = [planned_legs(r) for r in ranked]
    return frame(
        [shapely.points(t.lonlat) for t in tables],
        {
            **route_key(ranked),
            "sequence": [np.arange(len(t.lonlat)) + 1 for t in tables],
            **_leg_columns(ranked, tables),
        },
    )


def _channels(result: RunResult) -> GeoDataFrame:
    """Return channels of triangles, of planned and of rejected classes."""
    channels: list[tuple[FloatArray, dict[str, Any]]] = []
    for case in result.cases:
        # A rejected class has no route, so no rank among the routes.
        for rank, homotopy, reason, triangles in (
            *((r.rank, r.metrics.homotopy, "", r.route.channel) for r in case.routes),
            *(
                (0, r.homotopy, case.rejection_reason(r), r.channel)
                for r in (case.plan.rejected if case.plan else ())
            ),
        ):
            row = {"season": case.name, "rank": rank, "homotopy": homotopy}
            row |= {"rejected_because": reason, "triangles": len(triangles)}
            channels.append((triangles, row))
    outlines = [shapely.union_all(shapely.polygons(triangles)) for triangles, _ in channels]
    return rows_frame(to_lonlat(result, outlines, ZONE_STEP_M), [row for _, row in channels])


def _soft_no_go(result: RunResult) -> GeoDataFrame:
    """Return each route's soft no-go zone, if any, with its least and greatest padding."""
    ranked = [r for r in result.routes if not r.route.soft_no_go.is_empty]
    scale = result.water.projection.scale
    paddings = [np.asarray(r.route.padding_used)[:, 4] * scale for r in ranked]
    return frame(
        to_lonlat(result, [r.route.soft_no_go for r in ranked], ZONE_STEP_M),
        {
            **route_key(ranked),
            "homotopy": [r.metrics.homotopy for r in ranked],
            "padding_min_m": [p.min(initial=np.inf) for p in paddings],
            "padding_max_m": [p.max(initial=-np.inf) for p in paddings],
            "turns_max_m": [scale * r.route.turn_padding.max(initial=-np.inf) for r in ranked],
        },
    )


def _near_best(result: RunResult) -> GeoDataFrame:
    """Return the water outside which every route needs over 1 % more fuel than the best."""
    found = [(case.name, case.measures.near_best) for case in result.cases]
    known = [(name, water) for name, water in found if water is not None and not water.is_empty]
    return frame(
        to_lonlat(result, [water for _, water in known], ZONE_STEP_M),
        {"season": [name for name, _ in known]},
    )


def _currents(result: RunResult) -> GeoDataFrame:
    """Return the current at the points of the source, towards east and north."""
    samples = [case.current_samples() for case in result.cases]
    currents = frame(
        [shapely.points(lonlat) for lonlat, _ in samples],
        {
            "season": [case.name for case in result.cases],
            "u": [velocity[:, 0] for _, velocity in samples],
            "v": [velocity[:, 1] for _, velocity in samples],
        },
    )
    currents["speed"] = np.hypot(currents.u, currents.v)
    currents["direction"] = np.degrees(np.arctan2(currents.u, currents.v)) % 360
    return currents


def _contingency(result: RunResult) -> GeoDataFrame:
    """Return points from which turns were simulated, and whether a turn from there met land."""
    ranked, to_lonlat = result.routes, result.water.projection.to_lonlat
    turns = [r.case.measures.turns[r.rank - 1] for r in ranked]
    shown = [_shown(np.asarray(t.collided, dtype=bool)) for t in turns]
    points = [np.asarray(t.points)[index] for t, index in zip(turns, shown, strict=True)]
    collided = [np.asarray(t.collided)[index] for t, index in zip(turns, shown, strict=True)]
    lonlat = [shapely.points(to_lonlat(places)) for places in points]
    return frame(lonlat, {**route_key(ranked), "collided": collided})


# Hours within which a vessel adrift is ashore, by which routes are cut.
_ASHORE_WITHIN_H = 1, 6, 24, 72


def _adrift(result: RunResult) -> GeoDataFrame:
    """Return parts of the routes from which a vessel without thrust is carried ashore."""
    found = [
        (ranked, shapely.LineString(part), hours)
        for ranked in result.routes
        for part, hours in ranked.case.adrift(ranked.rank, _ASHORE_WITHIN_H)
    ]
    lines = to_lonlat(result, [part for _, part, _ in found], ROUTE_STEP_M)
    key = route_key([ranked for ranked, _, _ in found])
    return frame(lines, {**key, "ashore_within_h": [hours for _, _, hours in found]})


def _marks(result: RunResult, kind: str) -> tuple[list[Any], dict[str, list[Any]]]:
    """Return what is measured at places of the routes, and the columns that identify these."""
    found = [(case.name, one) for case in result.cases for one in getattr(case.measures, kind)]
    marks = [one for _, one in found]
    return marks, {"season": [name for name, _ in found], **columns_of(marks, "rank")}


def _narrow_stretches(result: RunResult) -> GeoDataFrame:
    """Return the stretches of the routes without room for a hard-over turn."""
    stretches, key = _marks(result, "narrow")
    names = ("begin_m", "length_m", "width_m", "needed_m", "kept_m")
    lines = to_lonlat(result, [shapely.LineString(one.line) for one in stretches], ROUTE_STEP_M)
    return frame(lines, {**key, **columns_of(stretches, *names, turn_side="side")})


def _shore_crossings(result: RunResult) -> GeoDataFrame:
    """Return middles of the routes' parts over land of the second shoreline."""
    crossings, key = _marks(result, "shore_crossings")
    places = np.array([[one.lon, one.lat] for one in crossings]).reshape(-1, 2)
    return frame(shapely.points(places), {**key, **columns_of(crossings, "length_m")})


def _shown(collided: BoolArray) -> IndexArray:
    """Return the indices of the turns to show: each that met land, and some others, evenly."""
    harmless = np.flatnonzero(~collided)
    step = max(1, math.ceil(len(harmless) / _MAX_TURNS))
    return np.sort(np.concatenate([np.flatnonzero(collided), harmless[::step]]))


def _havens(result: RunResult) -> GeoDataFrame:
    """Return the havens of each case, with the reason why one is not used."""
    found = [
        (haven.place, {"season": name, "name": haven.name, "reason": reason})
        for name, coverage in result.coverages.items()
        for haven, reason in (
            *((haven, "") for haven in coverage.havens),
            *((haven, "no way was found to it") for haven, _ in coverage.left_out),
        )
    ]
    places = np.array([place for place, _ in found]).reshape(-1, 2)
    lonlat = result.water.projection.to_lonlat(places)
    return rows_frame(shapely.points(lonlat), [row for _, row in found])


def _diversions(result: RunResult) -> GeoDataFrame:
    """Return the ways to havens, one line each."""
    found = [(case.name, way) for case in result.cases for way in haven_ways(case).values()]
    ways = [way for _, way in found]
    names = ("haven", "length_m", "duration_s", "longest_s", "fuel", "bearing_deg")
    return frame(
        to_lonlat(result, [shapely.LineString(way.route.path) for way in ways], ROUTE_STEP_M),
        {
            "season": [name for name, _ in found],
            "diversion": [way.number for way in ways],
            "time_s": [way.turn_off_s for way in ways],
            **columns_of(ways, *names),
        },
    )


def _coverage(result: RunResult) -> GeoDataFrame:
    """Return the stretches of the best routes, each in one state."""
    found = [
        (one, row) for one in result.cases for row in haven_rows(one) if row.kind not in LAST_TURNS
    ]
    rows = [row for _, row in found]
    return frame(
        to_lonlat(result, [stretch_line(case, row) for case, row in found], ROUTE_STEP_M),
        {
            "season": [case.name for case, _ in found],
            **columns_of(rows, "begin_s", "end_s", "longest_s", "least_s", state="kind"),
            "haven": [row.way.haven if row.way else "" for row in rows],
            "diversion": [row.way.number if row.way else 0 for row in rows],
            "reason": [row.reason for row in rows],
        },
    )


FRAMES: dict[str, Callable[[RunResult], GeoDataFrame]] = {
    "routes": _routes,
    "passage": _passage,
    "legs": legs,
    "path_points": _path_points,
    "channels": _channels,
    "islands": islands,
    "coast": coast,
    "region": region_edge,
    "hazards": partial(_zones, are_hazards=True),
    "chart_areas": partial(_zones, are_hazards=False),
    "depth_areas": depth_areas,
    "tidal_water": _tidal_water,
    "over_limit": _over_limit,
    "no_go": lambda result: _counted(result.simplified.polygons),
    "soft_no_go": _soft_no_go,
    "near_best": _near_best,
    "currents": _currents,
    "contingency": _contingency,
    "adrift": _adrift,
    "narrow_stretches": _narrow_stretches,
    "shore_crossings": _shore_crossings,
    "havens": _havens,
    "diversions": _diversions,
    "coverage": _coverage,
}
"""Layer -> its content; a layer without features is not written, but for `routes`."""
