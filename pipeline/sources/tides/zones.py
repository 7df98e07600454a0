"""Which station of the tide counts where: in its zone, or near it."""

from collections.abc import Sequence
from functools import lru_cache, partial

import numpy as np
import shapely

from pipeline._types import Geometries
from pipeline.errors import Faults, RequestError
from pipeline.geo.lonlat import position_text
from pipeline.geo.projection import Projection
from pipeline.model.depths import TideRange
from pipeline.scenario.tide import TideSpec
from pipeline.sources.tides.by_water import distances_by_water
from pipeline.sources.tides.station import Station, find_station

# Distance from a station, true metres, up to which its tide counts.
_REACH_M = 10_000.0
# Number of stations that a message names.
_MAX_NAMED = 3


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
