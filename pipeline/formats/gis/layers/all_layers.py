"""The layers of a run in lon/lat: names, descriptions and columns."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from pipeline.formats.gis.layers.chart_layers import (
    chart_areas,
    coast,
    depth_areas,
    hazards,
    islands,
    no_go,
)
from pipeline.formats.gis.layers.columns import (
    ROUTE_STEP_M,
    ZONE_STEP_M,
    Layer,
    Table,
    concatenated,
    integer,
    real,
    route_key,
    stack,
    text,
    to_lonlat,
)
from pipeline.formats.gis.layers.passage_layers import legs, passage
from pipeline.formats.shared.legs import legs as planned_legs
from pipeline.formats.shared.result import RunResult

# Maximum number of harmless turns shown per route: at true scale turns are simulated every few
# metres, and all of them would make a file of a gigabyte.
_MAX_TURNS = 2_000


def _routes(result: RunResult) -> Table:
    """Routes, one line each."""
    ranked = result.routes
    metrics = [r.metrics for r in ranked]
    return Table(
        to_lonlat(result, [shapely.LineString(r.route.path) for r in ranked], ROUTE_STEP_M),
        {
            **route_key(ranked),
            "homotopy": text([m.homotopy for m in metrics]),
            "way": text([m.way for m in metrics]),
            "fuel": real([m.fuel for m in metrics]),
            "fuel_per_distance": real([m.fuel_per_distance for m in metrics]),
            "length_m": real([m.length_m for m in metrics]),
            "clearance_m": real([m.clearance_m for m in metrics]),
            "duration_s": real([m.duration_s for m in metrics]),
            "speed_through_water_m_s": real([m.speed_m_s for m in metrics]),
            "optimality_gap": real([m.optimality_gap for m in metrics]),
            "trials": integer([m.trials for m in metrics]),
            "collisions": integer([m.collisions for m in metrics]),
            "filled_share": real([m.filled_share for m in metrics]),
            "uncharted_share": real([m.uncharted_share for m in metrics]),
        },
    )


def _path_points(result: RunResult) -> Table:
    """Vertices of the routes, each with the leg that leaves it; the goal has none."""
    ranked = result.routes
    tables = [planned_legs(r, result) for r in ranked]
    counts = [len(t.lonlat) for t in tables]
    return Table(
        shapely.points(stack([t.lonlat for t in tables])),
        {
            **route_key(ranked, counts),
            "sequence": integer(np.concatenate([[0], *(np.arange(1, n + 1) for n in counts)])[1:]),
            "course_deg": concatenated([t.course_deg for t in tables]),
            "leg_length_m": concatenated([t.length_m for t in tables]),
            "time_s": concatenated([t.time_s for t in tables]),
            "speed_over_ground_m_s": concatenated([t.speed_m_s for t in tables]),
            "speed_through_water_m_s": concatenated([t.through_water_m_s for t in tables]),
        },
    )


def _channels(result: RunResult) -> Table:
    """Channels of triangles, of planned and of rejected classes."""
    rows: list[tuple[str, int, str, str, npt.NDArray[np.float64]]] = []
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
    outlines = [_outline(triangles) for *_, triangles in rows]
    return Table(
        to_lonlat(result, outlines, ZONE_STEP_M),
        {
            "season": text([row[0] for row in rows]),
            "rank": integer([row[1] for row in rows]),
            "homotopy": text([row[2] for row in rows]),
            "rejected_because": text([row[3] for row in rows]),
            "triangles": integer([len(row[4]) for row in rows]),
        },
    )


def _soft_no_go(result: RunResult) -> Table:
    """Soft no-go zone of each route that has one, and the padding that it is made of."""
    ranked = tuple(r for r in result.routes if not r.route.soft_no_go.is_empty)
    scale = result.scene.projection.scale
    paddings = [np.asarray(r.route.padding_used)[:, 4] * scale for r in ranked]
    return Table(
        to_lonlat(result, [r.route.soft_no_go for r in ranked], ZONE_STEP_M),
        {
            **route_key(ranked),
            "homotopy": text([r.metrics.homotopy for r in ranked]),
            "padding_min_m": real([p.min(initial=np.inf) for p in paddings]),
            "padding_max_m": real([p.max(initial=-np.inf) for p in paddings]),
        },
    )


def _currents(result: RunResult) -> Table:
    """Current at the points of the source, towards east and north."""
    seasons = [entry.season for entry in result.plans]
    samples = [result.current_samples(season) for season in seasons]
    velocity = stack([v for _, v in samples])
    u, v = velocity[:, 0], velocity[:, 1]
    return Table(
        shapely.points(stack([lonlat for lonlat, _ in samples])),
        {
            "season": text(
                [s for s, (at, _) in zip(seasons, samples, strict=True) for _ in range(len(at))]
            ),
            "u": real(u),
            "v": real(v),
            "speed": real(np.hypot(u, v)),
            "direction": real(np.degrees(np.arctan2(u, v)) % 360),
        },
    )


def _contingency(result: RunResult) -> Table:
    """Points from which hard-over turns were simulated, and whether one met land."""
    ranked = result.routes
    turns = [result.evaluation.contingency[r.season, r.rank] for r in ranked]
    shown = [_shown(np.asarray(t.collided, dtype=bool)) for t in turns]
    points = [np.asarray(t.points)[chosen] for t, chosen in zip(turns, shown, strict=True)]
    collided = [np.asarray(t.collided)[chosen] for t, chosen in zip(turns, shown, strict=True)]
    return Table(
        shapely.points(result.scene.projection.to_lonlat(stack(points))),
        {
            **route_key(ranked, [len(p) for p in points]),
            "collided": np.concatenate([np.empty(0, dtype=bool), *collided]),
        },
    )


def _shown(collided: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
    """Indices of the turns to show: all that met land, and an even selection of the others."""
    harmless = np.flatnonzero(~collided)
    step = max(1, math.ceil(len(harmless) / _MAX_TURNS))
    return np.sort(np.concatenate([np.flatnonzero(collided), harmless[::step]]))


def _outline(triangles: npt.NDArray[np.float64]) -> BaseGeometry:
    """Merge triangles (n, 3, 2) into one area."""
    return shapely.union_all(shapely.polygons(np.asarray(triangles, dtype=float)))


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
