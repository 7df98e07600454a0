"""Which station of the tide counts where: in its zone, or near it by water.

A spit parts the waters of two stations. Where nothing lies between, a distance by water is the
straight line. Behind land it is the shortest way along a grid of cells with 16 directions, at most
3 % too long (Dijkstra's algorithm). Land outside the extent is not known, and hides nothing.
"""

import math
from collections.abc import Sequence
from functools import lru_cache, partial

import numpy as np
import shapely

from pipeline._types import FloatArray, Geometries
from pipeline.errors import Faults, RequestError
from pipeline.geo.lonlat import position_text
from pipeline.geo.projection import Projection
from pipeline.model.depths import TideRange
from pipeline.scenario.tide import TideSpec
from pipeline.sources.tides.station import Station, find_station

# Distance from a station, true metres, up to which its tide counts.
_REACH_M = 10_000.0
# Number of stations that a message names.
_MAX_NAMED = 3
# Number of cells along the longer side of an extent.
_CELLS = 120
# Share of a cell below which water in it counts as none.
_SLIVER = 1e-3
# Half of the 16 directions of a way along the grid: cells to the right, and up.
_STEPS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2), (2, -1), (1, -2))


@lru_cache(maxsize=8)
def stations_of(spec: TideSpec) -> tuple[Station, ...]:
    """Read the stations of a scenario; RequestError with the faults of all."""
    faults = Faults()
    found = [faults.collect(partial(find_station, asked)) for asked in spec.stations]
    if faults.lines:
        raise RequestError(faults.lines)
    return tuple(station for station in found if station is not None)


def tide_range(spec: TideSpec) -> TideRange:
    """Return the least and greatest height of the tide relied on, over all stations."""
    tides = [station.tide(np.datetime64(0, "s")) for station in stations_of(spec)]
    return TideRange(
        min(tide.lowest for tide in tides) - spec.surge_m,
        max(tide.highest for tide in tides) - spec.surge_m,
    )


def tide_zones(
    stations: Sequence[Station],
    extent: shapely.Polygon,
    projection: Projection,
    land: Geometries,
) -> tuple[list[shapely.Geometry], shapely.Geometry]:
    """Return the part of a planar extent, m, in which each station counts, given its `land` (n,).

    A station with a zone counts there. Elsewhere the nearest of the others by water counts, within
    10 km of it. The second part is within 10 km of one by the straight line alone: none counts.
    """
    zones = [shapely.Polygon(one.zone) if one.zone else shapely.Polygon() for one in stations]
    own = [projection.geometry_to_plane(zone, _REACH_M) for zone in zones]
    rest = shapely.difference(extent, shapely.union_all(own))
    points = [
        None
        if one.zone or one.position is None
        else shapely.Point(projection.to_plane(one.position))
        for one in stations
    ]
    near = [point for point in points if point is not None]
    cells = shapely.get_parts(shapely.voronoi_polygons(shapely.MultiPoint(near), extend_to=extent))
    found = list[shapely.Geometry]()
    for point, zone in zip(points, own, strict=True):
        if point is None:
            found.append(shapely.intersection(zone, extent))
            continue
        cell = extent if len(near) == 1 else cells[shapely.intersects(cells, point)][0]
        circle = shapely.buffer(point, _REACH_M / projection.scale)
        found.append(shapely.intersection(shapely.intersection(cell, circle), rest))
    far = shapely.Polygon()
    if near and len(land) and not rest.is_empty:
        far = _part_by_land(found, points, rest, land, _REACH_M / projection.scale)
    return found, far


def _part_by_land(
    zones: list[shapely.Geometry],
    points: Sequence[shapely.Point | None],
    rest: shapely.Polygon,
    land: Geometries,
    reach: float,
) -> shapely.Geometry:
    """Give cells of the water to other zones where the straight line to a station crosses land.

    Return those that no station counts for, since it is farther than its reach by water.
    `points` are the stations that count in the `rest` of the extent. Water that is joined with none
    of them keeps its zone: no route leads there.
    """
    which = np.array([at for at, point in enumerate(points) if point is not None])
    stations = shapely.get_coordinates([points[at] for at in which])
    boxes, places, apart = distances_by_water(stations, rest, land)
    least = apart.min(axis=0)
    by_water = np.where(least <= reach, which[apart.argmin(axis=0)], -1)
    by_line = np.full(len(boxes), -1)
    for at in which:
        by_line[shapely.contains_xy(zones[at], places)] = at
    moves = (by_water != by_line) & np.isfinite(least)
    for at in which:
        gained = shapely.union_all(boxes[moves & (by_water == at)])
        lost = shapely.union_all(boxes[moves & (by_line == at)])
        zones[at] = shapely.intersection(
            shapely.union(shapely.difference(zones[at], lost), gained), rest
        )
    return shapely.intersection(shapely.union_all(boxes[moves & (by_water < 0)]), rest)


def distances_by_water(
    stations: FloatArray, extent: shapely.Polygon, land: Geometries
) -> tuple[Geometries, FloatArray, FloatArray]:
    """Return cells (n,) with water, a place (n, 2) in each, and m (s, n) from stations (s, 2).

    All is planar. A cell that no water joins with a station is infinitely far from it.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    xmin, ymin, xmax, ymax = extent.bounds
    side = max(xmax - xmin, ymax - ymin) / _CELLS
    nx, ny = math.ceil((xmax - xmin) / side), math.ceil((ymax - ymin) / side)
    column, row = (axis.ravel() for axis in np.meshgrid(np.arange(nx), np.arange(ny)))
    left, low = xmin + side * column, ymin + side * row
    boxes = shapely.box(left, low, left + side, low + side)
    dry = shapely.union_all(land)
    shapely.prepare(dry)
    places = np.stack([left, low], axis=1) + side / 2
    covered = np.flatnonzero(shapely.contains_xy(dry, places))
    rest = shapely.difference(boxes[covered], dry)
    is_wet = shapely.area(rest) > _SLIVER * side**2
    # The place of a cell without water is no number.
    places[covered] = np.nan
    places[covered[is_wet]] = shapely.get_coordinates(shapely.point_on_surface(rest[is_wet]))
    wet = np.isfinite(places[:, 0])
    number = np.where(wet, np.cumsum(wet) - 1, -1).reshape(ny, nx)
    boxes, places = boxes[wet], places[wet]
    # Stations are nodes after the cells. One on land, as on a pier, has the water nearest to it.
    offsets = np.linalg.norm(stations[:, None] - places[None], axis=2)
    begins = stations.copy()
    on_land = shapely.contains_xy(dry, stations)
    begins[on_land] = places[offsets[on_land].argmin(axis=1)]
    count, all_places = len(places), np.vstack([places, begins])
    pairs = [
        np.stack([np.full(count, count + at), np.arange(count)], axis=1)
        for at in range(len(stations))
    ]
    for right, up in _STEPS:
        here = number[max(-up, 0) : ny - max(up, 0), : nx - right]
        there = number[max(up, 0) : ny + min(up, 0), right:]
        both = np.stack([here.ravel(), there.ravel()], axis=1)
        pairs.append(both[(both >= 0).all(axis=1)])
    ends = np.concatenate(pairs)
    begin, end = ends[~shapely.intersects(dry, shapely.linestrings(all_places[ends]))].T
    # No way has length 0, which a sparse matrix would leave out.
    length = np.linalg.norm(all_places[end] - all_places[begin], axis=1) + 1e-9
    size = len(all_places)
    graph = coo_matrix((length, (begin, end)), shape=(size, size)).tocsr()
    apart = dijkstra(graph, directed=False, indices=np.arange(count, size))[:, :count]
    return boxes, places, apart + np.where(on_land, offsets.min(axis=1), 0.0)[:, None]


def refuse_far_water(
    place: shapely.Point, stations: Sequence[Station], projection: Projection
) -> None:
    """Raise RequestError for tidal water at a planar place that no station counts for."""
    lonlat = projection.to_lonlat(shapely.get_coordinates(place)[0]).tolist()
    apart = sorted(
        (float(place.distance(shapely.Point(projection.to_plane(one.position)))), one.name)
        for one in stations
        if one.position is not None
    )
    named = [
        f"{name} ({d * projection.scale / 1000:.0f} km in a straight line)"
        for d, name in apart[:_MAX_NAMED]
    ]
    raise RequestError(
        f"tide.stations: the water at {position_text(*lonlat)} is deep enough for some hours only, "
        f"and no station counts there: the nearest is {', '.join(named) or 'none with a position'},"
        f" and {_REACH_M / 1000:g} km is the most. Add a station, "
        "or give one a zone in a TOML file"
    )
