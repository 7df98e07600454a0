"""What the page's interactive map draws, as plain data for JSON.

Everything lies in the planner's own plane, at true scale: angles are true, and no meridian cuts
the water in two. `encode` says how places and figures are written, `scripts/data.js` reads them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.formats.report.encode import Lattice, coarser, series, within
from pipeline.formats.shared.text import zone_words

if TYPE_CHECKING:
    import numpy.typing as npt

    from pipeline.formats.shared.result import RankedRoute, RunResult
    from pipeline.model import RouteKey

    FloatArray = npt.NDArray[np.float64]

_MOST_VERTICES = 60_000
_MOST_ARROWS = 7_000
# Arrows stand at most this many to a cell of the current's own grid, along each side.
_ARROWS_A_CELL = 2.0
_MOST_TURNS = 80
# A soft no-go zone is drawn to this share of the chart's longer side, all routes' together to so
# many vertices.
_SOFT_DETAIL, _MOST_SOFT_VERTICES = 1 / 3000, 40_000
_POINTS_BEST, _POINTS = 200, 100


def map_data(result: RunResult, speed_limits: tuple[float, ...]) -> dict[str, object]:
    """Gather coast, grid, currents and routes; `speed_limits` (m/s) part the arrows' colours."""
    scene = result.scene
    lattice = Lattice.of(scene.chart.bounds, scene.projection.scale)
    shoals = scene.projection.geometry_to_plane(np.array(result.shoals, dtype=object))
    return {
        "stepM": lattice.step_m,
        "planar": result.scenario.is_planar,
        "extent": lattice.rings(np.array([scene.chart.extent], dtype=object)),
        "land": _areas(result, np.array(scene.land, dtype=object), lattice),
        "shoals": _areas(result, shoals, lattice),
        "zones": _zones(result, lattice),
        "grid": _grid(result, lattice),
        "start": lattice.line(scene.start[None, :]),
        "goal": lattice.line(scene.goal[None, :]),
        "speedLimits": list(speed_limits),
        "seasons": _seasons(result, lattice),
    }


def _areas(result: RunResult, areas: npt.NDArray[np.object_], lattice: Lattice) -> list[list[int]]:
    """Cut areas of the plane to the chart and write their rings."""
    if not len(areas):
        return []
    inside = within(areas, result.scene.chart.extent)
    return lattice.rings(coarser(inside, lattice.step, _MOST_VERTICES))


def _zones(result: RunResult, lattice: Lattice) -> list[dict[str, object]]:
    """Write restricted areas and traffic schemes: their areas in the chart, and their own edges.

    Where the chart cuts an area it has no edge.
    """
    extent = result.scene.chart.extent
    zones: list[dict[str, object]] = []
    for zone, area in result.open_zones:
        seen = coarser(np.array([area]), lattice.step, _MOST_VERTICES)[0]
        edges = shapely.line_merge(shapely.intersection(shapely.boundary(seen), extent))
        zones.append(
            {
                "kind": zone.kind,
                "words": zone_words(zone),
                "area": lattice.rings(np.array([shapely.intersection(seen, extent)])),
                "edges": [
                    lattice.line(shapely.get_coordinates(edge))
                    for edge in shapely.get_parts(edges)
                    if edge.length > 0
                ],
            }
        )
    return zones


def _grid(result: RunResult, lattice: Lattice) -> list[dict[str, object]]:
    """Write meridians and parallels, or lines of even metres, each with its label's place."""
    from pipeline.formats.figures.graticule import graticule

    scene, is_planar = result.scene, result.scenario.is_planar
    return [
        {
            "label": line.label,
            "meridian": line.is_meridian,
            "foot": lattice.line(np.array([line.foot])),
            "parts": [lattice.line(part) for part in line.parts],
        }
        for line in graticule(scene.projection, scene.chart.extent, in_metres=is_planar)
    ]


def _seasons(result: RunResult, lattice: Lattice) -> list[dict[str, object]]:
    """Write each season's current and routes."""
    soft = _soft_no_go(result)
    return [
        {
            "title": result.season_title(entry.season),
            "current": _current(result, entry.season, lattice),
            "routes": [
                {
                    **_route(result, ranked, lattice),
                    "soft": lattice.rings(soft[ranked.season, ranked.rank]),
                }
                for ranked in result.season_routes(entry.season)
            ],
        }
        for entry in result.plans
    ]


def _soft_no_go(result: RunResult) -> dict[RouteKey, npt.NDArray[np.object_]]:
    """Soft no-go zone of each route, in the plane and the chart: coarser where there are many."""
    chart = result.scene.chart
    xmin, ymin, xmax, ymax = chart.bounds
    detail = _SOFT_DETAIL * max(xmax - xmin, ymax - ymin)
    zones = np.array([ranked.route.soft_no_go for ranked in result.routes], dtype=object)
    zones = shapely.simplify(zones, detail)
    zones = coarser(zones, 2 * detail, _MOST_SOFT_VERTICES)
    return {
        (ranked.season, ranked.rank): within(zones[i : i + 1], chart.extent)
        for i, ranked in enumerate(result.routes)
    }


def _route(result: RunResult, ranked: RankedRoute, lattice: Lattice) -> dict[str, object]:
    """Write a route: places with what is met there, and its hard-over turns."""
    from pipeline.formats.shared.along import along

    places = along(ranked, result, points=_POINTS_BEST if ranked.rank == 1 else _POINTS)
    whole = lattice.whole(result.scene.projection.to_plane(places.lonlat))
    turns, hits = _turns(result, ranked)
    return {
        "rank": ranked.rank,
        "side": ranked.metrics.side,
        "places": [int(value) for value in np.diff(whole, axis=0, prepend=0).ravel()],
        "lon": series(np.round(places.lonlat[:, 0], 5)),
        "lat": series(np.round(places.lonlat[:, 1], 5)),
        "time": series(places.time_s),
        "distance": series(places.distance_m),
        "course": series(places.course_deg),
        "fuel": series(places.fuel),
        "speed": series(places.speed_m_s),
        "current": series(places.current_along_m_s),
        "clearance": series(places.clearance_m),
        "turns": lattice.line(turns),
        "hits": lattice.line(hits),
    }


def _turns(result: RunResult, ranked: RankedRoute) -> tuple[FloatArray, FloatArray]:
    """Places (n, 2) where hard-over turns began: some of those that met nothing, all others."""
    found = result.evaluation.contingency.get((ranked.season, ranked.rank))
    if found is None:
        return np.empty((0, 2)), np.empty((0, 2))
    clear = found.points[~found.collided]
    every = max(1, math.ceil(len(clear) / _MOST_TURNS))
    return clear[::every], found.points[found.collided]


def _current(result: RunResult, season: str, lattice: Lattice) -> dict[str, object] | None:
    """Write the planner's own current on an even lattice over the water, in whole cm/s.

    `u` and `v` are along the plane's axes, row by row from below; 0, 0 is land or still water.
    """
    scene = result.scene
    if season not in scene.currents:
        return None
    field = scene.currents[season]
    xmin, ymin, xmax, ymax = scene.chart.bounds
    spacing = max(_own_spacing(field), math.sqrt((xmax - xmin) * (ymax - ymin) / _MOST_ARROWS))
    columns, rows = max(1, int((xmax - xmin) / spacing)), max(1, int((ymax - ymin) / spacing))
    x = xmin + spacing * (0.5 + np.arange(columns))
    y = ymin + spacing * (0.5 + np.arange(rows))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    velocity = np.asarray(field(places), dtype=float)
    velocity[~_on_water(result, places)] = 0.0
    whole = np.rint(100 * velocity).astype(np.int64)
    return {
        "corner": lattice.line(np.array([[x[0], y[0]]])),
        "spacing": spacing / lattice.step,
        "columns": columns,
        "u": [int(value) for value in whole[:, 0]],
        "v": [int(value) for value in whole[:, 1]],
    }


def _own_spacing(field: object) -> float:
    """How far apart arrows must stand to say no more than the current's grid does; 0 if any."""
    import renew

    if not isinstance(field, renew.GriddedCurrent):
        return 0.0
    steps = [np.diff(axis) for axis in (field.x, field.y) if len(axis) > 1]
    return min((float(step.min()) for step in steps), default=0.0) / _ARROWS_A_CELL


def _on_water(result: RunResult, places: FloatArray) -> npt.NDArray[np.bool_]:
    """Whether places (n, 2) lie in the chart and not on land."""
    chart, land = result.scene.chart, np.array(result.scene.land, dtype=object)
    water = np.asarray(shapely.contains_xy(chart.extent, places))
    # The land is the query, since shapely prepares that one, and a coast may be long.
    on_land = shapely.STRtree(shapely.points(places)).query(land, predicate="intersects")[1]
    water[on_land] = False
    return water
