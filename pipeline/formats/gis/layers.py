"""The eight layers of a run in lon/lat: names, descriptions and columns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from pipeline.formats.shared.legs import legs

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy.typing as npt
    from shapely.geometry.base import BaseGeometry

    from pipeline.formats.shared.result import RankedRoute, RunResult

# Maximum length, true metres, of a segment of a route. A straight line of the plane departs from
# the straight line in degrees by s²/8R·tan(latitude): by 0.1 m at 10 degrees, 0.2 m at 70.
_STEP_M = 2_000.0
# The same for the edges of zones, which are no more accurate than the chart.
_ZONE_STEP_M = 10_000.0
# Maximum number of harmless turns shown per route: at true scale turns are simulated every few
# metres, and all of them would make a file of a gigabyte.
_MAX_TURNS = 2_000


@dataclass(frozen=True)
class Table:
    """A layer's content: geometries, and columns of the same length in order."""

    geometry: npt.NDArray[np.object_]
    columns: Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class Layer:
    """A layer of the file: name, title and description for readers, and its content."""

    name: str
    title: str
    description: str
    geometry_type: str
    table: Callable[[RunResult], Table]


def _routes(result: RunResult) -> Table:
    """Routes, one line each."""
    ranked = result.routes
    metrics = [r.metrics for r in ranked]
    return Table(
        _to_lonlat(result, [shapely.LineString(r.route.path) for r in ranked], _STEP_M),
        {
            **_route_key(ranked),
            "homotopy": _text([m.homotopy for m in metrics]),
            "way": _text([m.way for m in metrics]),
            "fuel": _real([m.fuel for m in metrics]),
            "fuel_per_distance": _real([m.fuel_per_distance for m in metrics]),
            "length_m": _real([m.length_m for m in metrics]),
            "clearance_m": _real([m.clearance_m for m in metrics]),
            "duration_s": _real([m.duration_s for m in metrics]),
            "optimality_gap": _real([m.optimality_gap for m in metrics]),
            "trials": _integer([m.trials for m in metrics]),
            "collisions": _integer([m.collisions for m in metrics]),
            "filled_share": _real([m.filled_share for m in metrics]),
            "uncharted_share": _real([m.uncharted_share for m in metrics]),
        },
    )


def _waypoints(result: RunResult) -> Table:
    """Vertices of the routes, each with the leg that leaves it; the goal has none."""
    ranked = result.routes
    tables = [legs(r, result) for r in ranked]
    counts = [len(t.lonlat) for t in tables]
    return Table(
        shapely.points(_stack([t.lonlat for t in tables])),
        {
            **_route_key(ranked, counts),
            "sequence": _integer(np.concatenate([[0], *(np.arange(1, n + 1) for n in counts)])[1:]),
            "course_deg": _concatenated([t.course_deg for t in tables]),
            "leg_length_m": _concatenated([t.length_m for t in tables]),
            "time_s": _concatenated([t.time_s for t in tables]),
            "speed_over_ground_m_s": _concatenated([t.speed_m_s for t in tables]),
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
        _to_lonlat(result, outlines, _ZONE_STEP_M),
        {
            "season": _text([row[0] for row in rows]),
            "rank": _integer([row[1] for row in rows]),
            "homotopy": _text([row[2] for row in rows]),
            "rejected_because": _text([row[3] for row in rows]),
            "triangles": _integer([len(row[4]) for row in rows]),
        },
    )


def _islands(result: RunResult) -> Table:
    """Points on the islands by which ways are told apart."""
    islands = result.evaluation.islands
    places = np.array([[island.x, island.y] for island in islands]).reshape(-1, 2)
    return Table(
        shapely.points(result.scene.projection.to_lonlat(places)),
        {
            "number": _integer([island.number for island in islands]),
            "name": _text([island.name for island in islands]),
        },
    )


def _no_go(result: RunResult) -> Table:
    """Hard no-go zone, the same in every season."""
    polygons = result.simplified.polygons
    return Table(
        _multi(polygons),
        {"vertices": _integer([len(shapely.get_coordinates(p)) for p in polygons])},
    )


def _soft_no_go(result: RunResult) -> Table:
    """Soft no-go zone of each route that has one, and the padding that it is made of."""
    ranked = tuple(r for r in result.routes if not r.route.soft_no_go.is_empty)
    scale = result.scene.projection.scale
    paddings = [np.asarray(r.route.padding_used)[:, 4] * scale for r in ranked]
    return Table(
        _to_lonlat(result, [r.route.soft_no_go for r in ranked], _ZONE_STEP_M),
        {
            **_route_key(ranked),
            "homotopy": _text([r.metrics.homotopy for r in ranked]),
            "padding_min_m": _real([p.min(initial=np.inf) for p in paddings]),
            "padding_max_m": _real([p.max(initial=-np.inf) for p in paddings]),
        },
    )


def _currents(result: RunResult) -> Table:
    """Current at the points of the source, towards east and north."""
    seasons = [entry.season for entry in result.plans]
    samples = [result.current_samples(season) for season in seasons]
    velocity = _stack([v for _, v in samples])
    u, v = velocity[:, 0], velocity[:, 1]
    return Table(
        shapely.points(_stack([lonlat for lonlat, _ in samples])),
        {
            "season": _text(
                [s for s, (at, _) in zip(seasons, samples, strict=True) for _ in range(len(at))]
            ),
            "u": _real(u),
            "v": _real(v),
            "speed": _real(np.hypot(u, v)),
            "direction": _real(np.degrees(np.arctan2(u, v)) % 360),
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
        shapely.points(result.scene.projection.to_lonlat(_stack(points))),
        {
            **_route_key(ranked, [len(p) for p in points]),
            "collided": np.concatenate([np.empty(0, dtype=bool), *collided]),
        },
    )


def _shown(collided: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
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
        "hard-over turns that met land.",
        "LineString",
        _routes,
    ),
    Layer(
        "waypoints",
        "Waypoints",
        "Vertices of the routes, each with the leg that leaves it: course in degrees true, length "
        "in metres, time since departure in seconds, speed over ground in m/s.",
        "Point",
        _waypoints,
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
        _islands,
    ),
    Layer(
        "no_go",
        "Hard no-go zone",
        "Land as the planner uses it: simplified, and covering all of the source's land.",
        "MultiPolygon",
        _no_go,
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
        "land: all points where one did, and at most 2000 others per route.",
        "Point",
        _contingency,
    ),
)


def _route_key(
    ranked: tuple[RankedRoute, ...], repeats: list[int] | None = None
) -> dict[str, npt.NDArray[Any]]:
    """Columns season and rank, repeated for each of a route's features."""
    counts = [1] * len(ranked) if repeats is None else repeats
    return {
        "season": _text([r.season for r, n in zip(ranked, counts, strict=True) for _ in range(n)]),
        "rank": _integer([r.rank for r, n in zip(ranked, counts, strict=True) for _ in range(n)]),
    }


def _to_lonlat(
    result: RunResult, geometries: list[BaseGeometry], step_m: float
) -> npt.NDArray[np.object_]:
    """Transform planar geometries to lon/lat, with segments of at most `step_m` true metres.

    Areas become MultiPolygons.
    """
    array = np.empty(len(geometries), dtype=object)
    array[:] = geometries
    lonlat = result.scene.projection.geometry_to_lonlat(array, densify_m=step_m)
    areas = not all(shapely.get_type_id(lonlat) == shapely.GeometryType.LINESTRING)
    return _multi(lonlat) if areas else lonlat


def _outline(triangles: npt.NDArray[np.float64]) -> BaseGeometry:
    """Merge triangles (n, 3, 2) into one area."""
    return shapely.union_all(shapely.polygons(np.asarray(triangles, dtype=float)))


def _multi(areas: Any) -> npt.NDArray[np.object_]:  # noqa: ANN401 - any sequence of geometries
    """Make MultiPolygons of areas; lines and points that a union leaves are dropped."""
    multis = np.empty(len(areas), dtype=object)
    for index, area in enumerate(areas):
        parts = [p for p in shapely.get_parts(area) if isinstance(p, shapely.Polygon)]
        multis[index] = shapely.MultiPolygon(parts)
    return multis


def _text(values: list[str]) -> npt.NDArray[np.object_]:
    """Column of strings."""
    return np.array(values, dtype=object)


def _integer(values: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Column of whole numbers."""
    return np.array(values, dtype=np.int64)


def _real(values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Column of numbers; any that is not finite becomes NaN, which is written as NULL."""
    column = np.array(values, dtype=np.float64)
    column[~np.isfinite(column)] = np.nan
    return column


def _concatenated(columns: list[npt.NDArray[np.float64]]) -> npt.NDArray[np.float64]:
    """Columns of numbers, concatenated."""
    return _real(np.concatenate([np.empty(0), *columns]))


def _stack(points: list[npt.NDArray[np.float64]]) -> npt.NDArray[np.float64]:
    """Points (n, 2), concatenated."""
    return np.concatenate([np.empty((0, 2)), *points])
