"""Data of the page's interactive map, encoded as differences and ready for JSON.

A coast of 50,000 vertices then takes half a megabyte of JSON, decoded in milliseconds.

A report's coordinates are in the planner's own plane at true scale: angles are true, and nothing is
cut at 180 degrees. Those for a map of the world are degrees, continuous across 180.
`scripts/data.js` decodes both.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray, Geometries, IntArray
from pipeline.findings.haven_rows import LAST_TURNS, haven_rows, stretch_line
from pipeline.findings.result import RankedRoute, RunCase, RunResult
from pipeline.findings.route_profile import route_profile
from pipeline.findings.text import fuel_unit, zone_text
from pipeline.formats.figures.map_marks import graticule, on_water
from pipeline.geo.coast import within
from pipeline.geo.projection import Projection
from pipeline.model import RouteKey, Water
from renew.results import unite_soft_no_go

# Minimum steps along a chart's longer side; at most ten times as many: 1 m each on 700 km.
_MIN_STEPS = 2e5
# Number of steps in the range of a series: the page never shows a fifth digit.
_SERIES_STEPS = 50_000

# Number of cells along each side of the chart, at whose corners positions are given: between them
# they are interpolated, on 30 degrees to within 0.01 minute.
_CELLS = 40
# Unit of the positions, degrees: a thousandth of a minute.
_UNIT_DEG = 1 / 60_000
# Step on a map of the world, degrees: about 1 m.
_GLOBE_UNIT_DEG = 1e-5
# Width of the whole world on a web map: pixels at zoom 0, and metres of Mercator's plane.
_WORLD_PX, _WORLD_M = 256, math.tau * 6_378_137
# Length to which the chart's edges are divided on a map of the world, as a share of its outline.
_EDGE_SHARE = 1 / 200


@dataclass(frozen=True)
class Lattice:
    """Coordinates as whole steps from the chart's lower left corner.

    `origin` (2,) and `step` are in planar metres; `step_m` is the step in metres at true scale, a
    power of ten. With `globe`, points are given in longitude and latitude instead, in steps of
    `unit` degrees.
    """

    origin: FloatArray
    step: float
    step_m: float
    globe: Projection | None = None

    @property
    def unit(self) -> float:
        """Size of a step on the map, true metres or degrees."""
        return self.step_m if self.globe is None else _GLOBE_UNIT_DEG

    @classmethod
    def of(
        cls,
        bounds: tuple[float, float, float, float],
        scale: float,
        globe: Projection | None = None,
    ) -> Self:
        """Choose the step for a chart's bounds (planar metres) at a scale."""
        xmin, ymin, xmax, ymax = bounds
        side_m = max(xmax - xmin, ymax - ymin) * scale
        step_m = 10.0 ** math.floor(math.log10(side_m / _MIN_STEPS))
        return cls(np.array([xmin, ymin]), step_m / scale, step_m, globe)

    def to_steps(self, points: FloatArray) -> IntArray:
        """Round planar points (n, 2) to whole steps (n, 2)."""
        if self.globe is not None:
            return np.rint(self.globe.to_lonlat(points) / self.unit).astype(np.int64)
        return np.rint((points - self.origin) / self.step).astype(np.int64)

    def line(self, points: FloatArray) -> list[int]:
        """Return flat x, y, dx, dy, …: the first point, then the moves that are not zero."""
        moves = np.diff(self.to_steps(points), axis=0, prepend=0)
        keep = np.asarray(moves.any(axis=1))
        keep[:1] = True
        return moves[keep].ravel().tolist()

    def rings(self, areas: Geometries) -> list[list[int]]:
        """Return every ring of polygons (n,); outer rings anticlockwise, holes clockwise.

        Rings are not closed by repeating the first point; those smaller than a step are dropped.
        """
        polygons = shapely.orient_polygons(shapely.get_parts(areas))
        is_polygon = shapely.get_type_id(polygons) == shapely.GeometryType.POLYGON
        rings = shapely.get_rings(polygons[is_polygon])
        lines = (self.line(shapely.get_coordinates(ring)[:-1]) for ring in rings)
        return [line for line in lines if len(line) >= 6]


def series(values: FloatArray) -> dict[str, object]:
    """Return values (n,) as `{"step": s, "moves": [...]}`; moves are None if any value is infinite.

    The last value is exact unless it is small beside the others.
    """
    if not np.isfinite(values).all():
        return {"step": 1.0, "moves": None}
    reach = float(np.abs(values).max(initial=0.0))
    last = abs(float(values[-1])) if len(values) else 0.0
    # The last value is a whole number of steps, so fuel and time end at the route's own figures.
    step = (last if last > 0.1 * reach else reach) / _SERIES_STEPS or 1.0
    moves = np.diff(np.rint(values / step).astype(np.int64), prepend=0)
    return {"step": step, "moves": moves.tolist()}


def coarser(areas: Geometries, tolerance: float, max_vertices: int) -> Geometries:
    """Simplify geometries (n,) with a growing tolerance until they have at most `max_vertices`.

    Islets smaller than the tolerance become empty. There are at most twenty rounds.
    """
    for _ in range(20):
        excess = shapely.get_num_coordinates(areas).sum() / max_vertices
        if excess <= 1:
            break
        west, south, east, north = shapely.bounds(areas).T
        visible = np.maximum(east - west, north - south) >= tolerance
        areas = np.where(visible, shapely.simplify(areas, tolerance), shapely.Polygon())
        # A round visits all vertices: a larger factor takes fewer rounds where they are many.
        tolerance *= 4 if excess > 8 else 2
    return areas


def place_on_map(water: Water, place: FloatArray) -> str:
    """Return a planar place (2,) for a button: "x,y", true metres from the lower left corner."""
    xmin, ymin, _, _ = water.chart.bounds
    x, y = (np.asarray(place) - [xmin, ymin]) * water.projection.scale
    return f"{x:.0f},{y:.0f}" if max(abs(x), abs(y)) >= 1e4 else f"{x:.6g},{y:.6g}"


def positions(result: RunResult, lattice: Lattice) -> dict[str, object] | None:
    """Return longitudes and latitudes at the corners of a grid over the chart.

    None in a plane, and on a map of the world, whose places are positions.

    Row by row from below, to a thousandth of a minute. Longitudes run on beyond 180 degrees.
    """
    if result.scenario.is_planar or lattice.globe is not None:
        return None
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    x, y = np.linspace(xmin, xmax, _CELLS + 1), np.linspace(ymin, ymax, _CELLS + 1)
    corners = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    lon, lat = result.water.projection.to_lonlat(corners).T
    lon = np.degrees(np.unwrap(np.radians(lon).reshape(len(y), len(x)), axis=1))
    lon = np.degrees(np.unwrap(np.radians(lon), axis=0)).ravel()
    whole = np.rint(np.stack([lon, lat]) / _UNIT_DEG).astype(np.int64)
    return {
        "cells": _CELLS,
        "size": [side * lattice.step_m / lattice.step for side in (xmax - xmin, ymax - ymin)],
        **{
            name: {"step": _UNIT_DEG, "moves": np.diff(one, prepend=0).tolist()}
            for name, one in zip(("lon", "lat"), whole, strict=True)
        },
    }


_MAX_VERTICES = 60_000
_MAX_ARROWS = 7_000
# Maximum number of arrows along each side of a cell of the current's own grid.
_MAX_ARROWS_PER_CELL = 2.0
# Maximum number of harmless turns shown per route.
_MAX_TURNS = 80
# Tolerance of simplified soft no-go zones, as a share of the chart's longer side.
_SOFT_TOLERANCE = 1 / 3000
# Maximum number of vertices of all routes' soft no-go zones together.
_MAX_SOFT_VERTICES = 40_000
# The room for turns is given beside the route: up to its padding times this factor.
_BESIDE = 1.5
# Number of vertices above which the hard no-go zone is simplified.
_MAX_NO_GO_VERTICES = 25_000
# Tolerance of the simplified hard no-go zone, as a share of the chart's longer side.
_NO_GO_TOLERANCE = 1 / 20_000
# Width of the land that is shown around the chart, as a share of its longer side.
_SHEET_SHARE = 0.6
# Maximum number of vertices of that land.
_MAX_BEYOND_VERTICES = 15_000
# Number of points along the best route.
_POINTS_BEST = 200
# Number of points along another route.
_POINTS = 100


def map_data(
    result: RunResult, speed_limits: tuple[float, ...], *, on_globe: bool = False
) -> dict[str, object]:
    """Gather coast, grid, currents and routes; `speed_limits` (m/s) are those of the classes.

    With `on_globe`, for a map of the world in Mercator's projection.
    """
    water, (start, *via, goal) = result.water, result.stops
    globe = water.projection if on_globe else None
    lattice = Lattice.of(water.chart.bounds, water.projection.scale, globe)
    extent = water.chart.extent
    if on_globe:
        extent = shapely.segmentize(extent, extent.length * _EDGE_SHARE)
    shoals, hazards = (
        water.projection.geometry_to_plane(np.array(areas, dtype=object))
        for areas in (result.no_go_water("shoal"), result.no_go_water("hazard"))
    )
    named = {island.number for island in result.islands}
    return {
        "step": lattice.unit,
        "globe": on_globe,
        "planar": result.scenario.is_planar,
        "noGoName": result.fetched.land.no_go_name,
        "origin": [float(value) * water.projection.scale for value in lattice.origin],
        "extent": lattice.rings(np.array([extent], dtype=object)),
        **_beyond(result, lattice),
        "land": _areas(result, np.array(water.land, dtype=object), lattice),
        "noGo": _no_go(result, lattice),
        "shoals": _areas(result, shoals, lattice),
        "hazards": _areas(result, hazards, lattice),
        "zones": _zones(result, lattice),
        "grid": _grid(result, lattice),
        "start": lattice.line(start[None, :]),
        "goal": lattice.line(goal[None, :]),
        "via": lattice.line(np.array(via).reshape(-1, 2)),
        "islands": [
            {
                "label": island.label,
                "names": island in result.islands,
                "below": island in result.class_islands and island.number in named,
                "place": lattice.line(np.array([[island.x, island.y]])),
            }
            for island in (*result.islands, *result.class_islands)
        ],
        "positions": positions(result, lattice),
        "speedLimits": list(speed_limits),
        "seasons": _seasons(result, lattice),
    }


def _areas(result: RunResult, areas: Geometries, lattice: Lattice) -> list[list[int]]:
    """Return rings of planar areas, clipped to the chart."""
    if not len(areas):
        return []
    inside = within(areas, result.water.chart.extent)
    return lattice.rings(coarser(inside, lattice.step, _MAX_VERTICES))


def _beyond(result: RunResult, lattice: Lattice) -> dict[str, object]:
    """Return what the map shows outside the chart: a sheet of water, and the land on it.

    Empty where no land is known outside: no water is drawn there; and on a map of the world.
    """
    if not result.fetched.surroundings or lattice.globe is not None:
        return {"sheet": [], "beyond": []}
    extent = result.water.chart.extent
    xmin, ymin, xmax, ymax = extent.bounds
    reach = _SHEET_SHARE * max(xmax - xmin, ymax - ymin)
    sheet = shapely.box(xmin - reach, ymin - reach, xmax + reach, ymax + reach)
    shapely.prepare(extent)
    land = result.drawn_land[~shapely.covers(extent, result.drawn_land)]
    land = shapely.difference(within(land, sheet), extent)
    return {
        "sheet": lattice.rings(np.array([sheet], dtype=object)),
        "beyond": lattice.rings(coarser(land, lattice.step, _MAX_BEYOND_VERTICES)),
    }


def _no_go(result: RunResult, lattice: Lattice) -> list[list[int]]:
    """Return rings of the hard no-go zone in a screen's detail; none in a plane, which has land."""
    if result.scenario.is_planar:
        return []
    no_go = within(np.array(result.water.chart.no_go, dtype=object), result.water.chart.extent)
    xmin, ymin, xmax, ymax = result.water.chart.bounds
    tolerance = _NO_GO_TOLERANCE * max(xmax - xmin, ymax - ymin)
    return lattice.rings(coarser(no_go, tolerance, _MAX_NO_GO_VERTICES))


def _zones(result: RunResult, lattice: Lattice) -> list[dict[str, object]]:
    """Open zones: their areas inside the chart, and their edges except where the chart ends."""
    extent = result.water.chart.extent
    zones: list[dict[str, object]] = []
    for zone, area in result.open_zones:
        simple = coarser(np.array([area]), lattice.step, _MAX_VERTICES)[0]
        edges = shapely.line_merge(shapely.intersection(shapely.boundary(simple), extent))
        zones.append(
            {
                "kind": zone.kind,
                "text": zone_text(zone),
                "area": lattice.rings(np.array([shapely.intersection(simple, extent)])),
                "edges": [
                    lattice.line(shapely.get_coordinates(edge))
                    for edge in shapely.get_parts(edges)
                    if edge.length > 0
                ],
            }
        )
    return zones


def _grid(result: RunResult, lattice: Lattice) -> list[dict[str, object]]:
    """Return meridians and parallels, or a grid in metres, each with the position of its label."""
    water = result.water
    return [
        {
            "label": line.label,
            "meridian": line.is_meridian,
            "foot": lattice.line(np.array([line.foot])),
            "parts": [lattice.line(part) for part in line.parts],
        }
        for line in graticule(water.projection, water.chart.extent, in_metres=water.is_planar)
    ]


def _seasons(result: RunResult, lattice: Lattice) -> list[dict[str, object]]:
    """Return current and routes of each case."""
    soft = _soft_no_go(result)
    return [
        {
            "title": case.title,
            "current": _current(case, lattice),
            "havens": haven_lines(case, lattice.line),
            "nearBest": lattice.rings(np.array([_near_best(case)])),
            "routes": [
                {
                    **_route(ranked, lattice),
                    **side,
                    "soft": lattice.rings(soft[case.name, ranked.rank]),
                    "turnRoom": lattice.rings(turn_room(ranked)),
                }
                for ranked, side in zip(case.routes, numbered_sides(case), strict=True)
            ],
        }
        for case in result.cases
    ]


def numbered_sides(case: RunCase) -> list[dict[str, int | float]]:
    """Return each route's side, numbered from 0 by its best route, and its fuel above the best.

    A route's `excess` is a share; `isSide` is true of the best route of a side.
    """
    passages: dict[str, int] = {}
    found: list[dict[str, int | float]] = []
    for row in (ranked.metrics for ranked in case.routes):
        is_side = row.main_passage not in passages
        side = passages.setdefault(row.main_passage, len(passages))
        excess = row.fuel / case.routes[0].metrics.fuel - 1
        found.append({"side": side, "isSide": is_side, "excess": excess})
    return found


def _near_best(case: RunCase) -> shapely.Geometry:
    """Return the water of a case's nearly best routes, simplified; empty where it is not known."""
    water = case.measures.near_best or shapely.Polygon()
    xmin, ymin, xmax, ymax = case.run.water.chart.bounds
    return shapely.simplify(water, _SOFT_TOLERANCE * max(xmax - xmin, ymax - ymin))


def _soft_no_go(result: RunResult) -> dict[RouteKey, Geometries]:
    """Return soft no-go zone of each route in the plane, simplified and clipped to the chart."""
    chart = result.water.chart
    xmin, ymin, xmax, ymax = chart.bounds
    tolerance = _SOFT_TOLERANCE * max(xmax - xmin, ymax - ymin)
    unite_soft_no_go([ranked.route for ranked in result.routes])
    zones = np.array([ranked.route.soft_no_go for ranked in result.routes], dtype=object)
    # Zones have tens of thousands of vertices: keeping their topology would take ten times as long.
    zones = shapely.make_valid(shapely.simplify(zones, tolerance, preserve_topology=False))
    zones = coarser(zones, 2 * tolerance, _MAX_SOFT_VERTICES)
    return {
        (ranked.case.name, ranked.rank): within(zones[i : i + 1], chart.extent)
        for i, ranked in enumerate(result.routes)
    }


def turn_room(ranked: RankedRoute) -> Geometries:
    """Return what of a soft no-go zone hard-over turns need, beside the route, if that is less."""
    padded, turns = ranked.route.padding_used, ranked.route.turn_padding
    if not (padded[:, 4] > turns).any():
        return np.empty(0, dtype=object)
    lines = shapely.linestrings(padded[:, :4].reshape(-1, 2, 2))
    path = shapely.LineString(ranked.route.path)
    beside = (turns > 0) & shapely.dwithin(lines, path, _BESIDE * padded[:, 4].max())
    areas = shapely.buffer(lines[beside], turns[beside], quad_segs=4)
    return within(np.array([shapely.union_all(areas)]), ranked.case.run.water.chart.extent)


def _route(ranked: RankedRoute, lattice: Lattice) -> dict[str, object]:
    """Return a route: its profile along it, and its hard-over turns."""
    profile = route_profile(ranked, points=_POINTS_BEST if ranked.rank == 1 else _POINTS)
    projection = ranked.case.run.water.projection
    whole = lattice.to_steps(projection.to_plane(profile.lonlat))
    turns, hits = _turns(ranked)
    weather = dict.fromkeys(("waves", "wind"), np.full(len(profile.time_s), np.inf))
    weather |= {
        one.name: one.at(profile.lonlat, profile.time_s) for one in ranked.case.case.weather
    }
    size, unit = fuel_unit(ranked.metrics.fuel, ranked.metrics)
    return {
        "rank": ranked.rank,
        "way": ranked.metrics.way,
        "places": np.diff(whole, axis=0, prepend=0).ravel().tolist(),
        "lon": series(np.round(profile.lonlat[:, 0], 5)),
        "lat": series(np.round(profile.lonlat[:, 1], 5)),
        "time": series(profile.time_s),
        "distance": series(profile.distance_m),
        "course": series(profile.course_deg),
        "fuel": series(size * profile.fuel),
        "fuelUnit": unit.partition(" of ")[0],
        "speed": series(profile.speed_m_s),
        "current": series(profile.current_along_m_s),
        "clearance": series(profile.clearance_m),
        "least": ranked.metrics.clearance_m if ranked.metrics.has_land else None,
        "waves": series(weather["waves"]),
        "wind": series(weather["wind"]),
        "turns": lattice.line(turns),
        "hits": lattice.line(hits),
        "marked": [
            {"role": role, "places": lattice.line(line)}
            for role, lines in ranked.case.marked(ranked.rank).items()
            for line in lines
        ],
        "shores": lattice.line(projection.to_plane(ranked.case.crossings(ranked.rank))),
    }


def _turns(ranked: RankedRoute) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 2) where hard-over turns begin: all harmful ones, some of the harmless."""
    turns = ranked.case.measures.turns[ranked.rank - 1]
    harmless = turns.points[~turns.collided]
    step = max(1, math.ceil(len(harmless) / _MAX_TURNS))
    return harmless[::step], turns.points[turns.collided]


def _current(case: RunCase, lattice: Lattice) -> dict[str, object] | None:
    """Return the planner's own current on a regular lattice over the water, in whole cm/s.

    A changing current is given at departure. `u` and `v` are along the map's axes, row by
    row from below; 0, 0 is land or still water. Its spacing is in true metres, or in pixels at
    zoom 0 on a map of the world, where the lattice is regular in Mercator's projection.
    """
    if case.planned is None:
        return None
    field, bounds = case.planned.current, case.planned.chart.bounds
    spacing = max(_min_spacing(field), math.sqrt(shapely.box(*bounds).area / _MAX_ARROWS))
    if lattice.globe is None:
        points, columns = _lattice(bounds, spacing)
        velocity = np.asarray(field(points), dtype=float)
        shown = spacing * lattice.step_m / lattice.step
    else:
        centre = lattice.globe.central_longitude
        web = Projection(f"+proj=webmerc +lon_0={centre} +datum=WGS84", central_longitude=centre)
        extent = lattice.globe.geometry_to_lonlat(case.planned.chart.extent)
        drawn = web.geometry_to_plane(extent).bounds
        spacing *= math.sqrt(shapely.box(*drawn).area / shapely.box(*bounds).area)
        places, columns = _lattice(drawn, spacing)
        lonlat, shown = web.to_lonlat(places), spacing * _WORLD_PX / _WORLD_M
        points = lattice.globe.to_plane(lonlat)
        velocity = lattice.globe.rotate_to_lonlat(lonlat, field(points))
    velocity[~on_water(case.run.water, points)] = 0.0
    whole = np.rint(100 * velocity).astype(np.int64)
    return {
        "corner": lattice.line(points[:1]),
        "spacing": shown,
        "columns": columns,
        "u": whole[:, 0].tolist(),
        "v": whole[:, 1].tolist(),
    }


def _lattice(bounds: tuple[float, ...], spacing: float) -> tuple[FloatArray, int]:
    """Return the points (n, 2) of a lattice in a box, row by row from below, and its columns."""
    xmin, ymin, xmax, ymax = bounds
    columns, rows = max(1, int((xmax - xmin) / spacing)), max(1, int((ymax - ymin) / spacing))
    x = xmin + spacing * (0.5 + np.arange(columns))
    y = ymin + spacing * (0.5 + np.arange(rows))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), columns


def _min_spacing(field: object) -> float:
    """Return the spacing of arrows at which they show all of the current's grid; 0 without one."""
    if isinstance(field, renew.VaryingCurrent):
        return _min_spacing(field.slices[0]) if field.slices else 0.0
    if not isinstance(field, renew.GriddedCurrent):
        return 0.0
    steps = [np.diff(axis) for axis in (field.x, field.y) if len(axis) > 1]
    return min((float(step.min()) for step in steps), default=0.0) / _MAX_ARROWS_PER_CELL


def haven_lines(case: RunCase, line: Callable[[FloatArray], list[int]]) -> dict[str, Any] | None:
    """Return what the map shows of a case's havens, encoded by `line`; None without havens."""
    coverage = case.coverage
    if coverage is None:
        return None
    return {
        "havens": [
            {"name": haven.name, "place": line(haven.place[None, :])} for haven in coverage.havens
        ],
        "ways": [line(np.asarray(one.route.path)) for one in coverage.diversions],
        "stretches": [
            {"state": row.kind, "places": line(np.asarray(stretch_line(case, row).coords))}
            for row in haven_rows(case)
            if row.kind not in LAST_TURNS
        ],
    }
