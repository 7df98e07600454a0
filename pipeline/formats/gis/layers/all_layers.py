"""The layers of a run in lon/lat: names, descriptions and columns."""

import math

import numpy as np
import shapely

from pipeline._types import BoolArray, FloatArray, IndexArray
from pipeline.formats.gis.layers.chart_layers import (
    chart_areas,
    coast,
    depth_areas,
    hazards,
    islands,
    no_go,
)
from pipeline.formats.gis.layers.frames import (
    ROUTE_STEP_M,
    ZONE_STEP_M,
    GeoDataFrame,
    Layer,
    frame,
    route_key,
    to_lonlat,
)
from pipeline.formats.gis.layers.passage_layers import legs, passage
from pipeline.formats.shared.legs import legs as planned_legs
from pipeline.formats.shared.result import RunResult

# Maximum number of harmless turns shown per route: at true scale turns are simulated every few
# metres, and all of them would make a file of a gigabyte.
_MAX_TURNS = 2_000
# Figures of a route in its row, by their names in its metrics.
_MEASURED = (
    *("homotopy", "way", "fuel", "fuel_per_distance", "length_m", "clearance_m", "duration_s"),
    *("speed_m_s", "optimality_gap", "trials", "collisions", "filled_share", "uncharted_share"),
)


def _routes(result: RunResult) -> GeoDataFrame:
    """Routes, one line each."""
    ranked = result.routes
    measured = {name: [getattr(r.metrics, name) for r in ranked] for name in _MEASURED}
    lines = to_lonlat(result, [shapely.LineString(r.route.path) for r in ranked], ROUTE_STEP_M)
    routes = frame(lines, {**route_key(ranked), **measured})
    return routes.rename(columns={"speed_m_s": "speed_through_water_m_s"})


def _path_points(result: RunResult) -> GeoDataFrame:
    """Vertices of the routes, each with the leg that leaves it; the goal has none."""
    ranked = result.routes
    tables = [planned_legs(r, result) for r in ranked]
    return frame(
        [shapely.points(t.lonlat) for t in tables],
        {
            **route_key(ranked),
            "sequence": [np.arange(len(t.lonlat)) + 1 for t in tables],
            "course_deg": [t.course_deg for t in tables],
            "leg_length_m": [t.length_m for t in tables],
            "time_s": [t.time_s for t in tables],
            "speed_over_ground_m_s": [t.speed_m_s for t in tables],
            "speed_through_water_m_s": [t.through_water_m_s for t in tables],
        },
    )


def _channels(result: RunResult) -> GeoDataFrame:
    """Channels of triangles, of planned and of rejected classes."""
    rows: list[tuple[str, int, str, str, FloatArray]] = []
    for entry in result.plans:
        if entry.plan is None:
            continue
        rows += [
            (entry.season, r.rank, r.metrics.homotopy, "", r.route.channel)
            for r in result.season_routes(entry.season)
        ]
        # A rejected class has no route, so no rank among the routes.
        rows += [
            (entry.season, 0, r.homotopy, result.rejection_reason(entry.season, r), r.channel)
            for r in entry.plan.rejected
        ]
    outlines = [shapely.union_all(shapely.polygons(triangles)) for *_, triangles in rows]
    return frame(
        to_lonlat(result, outlines, ZONE_STEP_M),
        {
            "season": [row[0] for row in rows],
            "rank": [row[1] for row in rows],
            "homotopy": [row[2] for row in rows],
            "rejected_because": [row[3] for row in rows],
            "triangles": [len(row[4]) for row in rows],
        },
    )


def _soft_no_go(result: RunResult) -> GeoDataFrame:
    """Soft no-go zone of each route that has one, and the padding that it is made of."""
    ranked = [r for r in result.routes if not r.route.soft_no_go.is_empty]
    scale = result.scene.projection.scale
    paddings = [np.asarray(r.route.padding_used)[:, 4] * scale for r in ranked]
    return frame(
        to_lonlat(result, [r.route.soft_no_go for r in ranked], ZONE_STEP_M),
        {
            **route_key(ranked),
            "homotopy": [r.metrics.homotopy for r in ranked],
            "padding_min_m": [p.min(initial=np.inf) for p in paddings],
            "padding_max_m": [p.max(initial=-np.inf) for p in paddings],
        },
    )


def _currents(result: RunResult) -> GeoDataFrame:
    """Current at the points of the source, towards east and north."""
    seasons = [entry.season for entry in result.plans]
    samples = [result.current_samples(season) for season in seasons]
    currents = frame(
        [shapely.points(lonlat) for lonlat, _ in samples],
        {
            "season": seasons,
            "u": [velocity[:, 0] for _, velocity in samples],
            "v": [velocity[:, 1] for _, velocity in samples],
        },
    )
    currents["speed"] = np.hypot(currents.u, currents.v)
    currents["direction"] = np.degrees(np.arctan2(currents.u, currents.v)) % 360
    return currents


def _contingency(result: RunResult) -> GeoDataFrame:
    """Points from which hard-over turns were simulated, and whether one met land."""
    ranked, to_lonlat = result.routes, result.scene.projection.to_lonlat
    turns = [result.evaluation.contingency[r.season, r.rank] for r in ranked]
    shown = [_shown(np.asarray(t.collided, dtype=bool)) for t in turns]
    chosen = list(zip(turns, shown, strict=True))
    return frame(
        [shapely.points(to_lonlat(np.asarray(t.points)[index])) for t, index in chosen],
        {**route_key(ranked), "collided": [np.asarray(t.collided)[index] for t, index in chosen]},
    )


def _shown(collided: BoolArray) -> IndexArray:
    """Indices of the turns to show: all that met land, and an even selection of the others."""
    harmless = np.flatnonzero(~collided)
    step = max(1, math.ceil(len(harmless) / _MAX_TURNS))
    return np.sort(np.concatenate([np.flatnonzero(collided), harmless[::step]]))


LAYERS = (
    Layer(
        "routes",
        "Routes",
        "Least-fuel route of each homotopy class; rank 1 is the season's best. length_m and "
        "clearance_m are in true metres, fuel and fuel_per_distance in the planner's scaled "
        "units, optimality_gap is a share of the fuel, collisions counts those of the trials "
        "hard-over turns that met land or another no-go area.",
        "LineString",
        _routes,
    ),
    Layer(
        "passage",
        "Waypoints",
        "Waypoints of the routes, as in RTZ and GPX: few, and clear of the soft no-go zones; each "
        "with the leg that leaves it: course in degrees true, length in metres, time since "
        "departure in seconds, mean speed over ground in m/s.",
        "Point",
        passage,
    ),
    Layer(
        "legs",
        "Cross-track limits",
        "The water beside each leg of a route within its cross-track limits, which stays out of "
        "the soft no-go zone; none where start or goal lie in the soft no-go zone.",
        "MultiPolygon",
        legs,
    ),
    Layer(
        "path_points",
        "Points of the planned path",
        "Vertices of the routes as planned, each with the leg that leaves it: course in degrees "
        "true, length in metres, time since departure in seconds, speed over ground in m/s.",
        "Point",
        _path_points,
    ),
    Layer(
        "channels",
        "Channels",
        "Channel of triangles of each class; a rejected class has rank 0 and a reason.",
        "MultiPolygon",
        _channels,
    ),
    Layer(
        "islands",
        "Islands",
        "Islands by which the ways of the routes are told apart: their numbers in homotopy "
        "classes, and their names in the chart, if it has any.",
        "Point",
        islands,
    ),
    Layer(
        "coast",
        "Land",
        "Land as the source has it, before simplification.",
        "MultiPolygon",
        coast,
    ),
    Layer(
        "hazards",
        "Hazards",
        "Rocks, wrecks, obstructions and marks of the chart in water that is deep enough, with the "
        "room that is left around them: no-go.",
        "MultiPolygon",
        hazards,
    ),
    Layer(
        "chart_areas",
        "Areas of the chart",
        "Water too shallow for the vessel and areas that no chart covers, both no-go; restricted "
        "areas and traffic schemes, which may be entered; shut areas, with their hours.",
        "MultiPolygon",
        chart_areas,
    ),
    Layer(
        "depth_areas",
        "Depths",
        "Depth areas and dredged areas of the chart, by their least and greatest depth in metres "
        "at chart datum; none of a chart without depths.",
        "MultiPolygon",
        depth_areas,
    ),
    Layer(
        "no_go",
        "Hard no-go zone",
        "All that no route may enter, as the planner uses it: simplified, and covering all of the "
        "source's land, shallow water and hazards.",
        "MultiPolygon",
        no_go,
    ),
    Layer(
        "soft_no_go",
        "Soft no-go zones",
        "Water that a route avoids so that no hard-over turn can reach the hard no-go zone; "
        "padding in true metres.",
        "MultiPolygon",
        _soft_no_go,
    ),
    Layer(
        "currents",
        "Currents",
        "Surface current: u towards east, v towards north and speed in m/s; direction towards "
        "which it sets, in degrees true.",
        "Point",
        _currents,
    ),
    Layer(
        "contingency",
        "Contingency manoeuvres",
        "Points from which hard-over turns were simulated along each route, and whether one met "
        "land or another no-go area: all points where one did, and at most 2000 others per route.",
        "Point",
        _contingency,
    ),
)
