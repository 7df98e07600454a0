"""Canals between seas: they are not in the land's water, or narrower than a ship turns.

`catalog/canals.csv` has, for each canal, a place at sea off either end, and the length of the
waterway between. Great circles to these places choose the canals to look at; the ways to them by
water are then found on a coarse grid of the world's land, so that no canal is named to whose ends
land bars the way.
"""

import csv
import math
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
import pyproj
import shapely

from pipeline.geo.projection import METRES_PER_DEGREE, bounds_of
from pipeline.model import Note, Place
from pipeline.scenario import catalogue
from pipeline.scenario.strict import Point
from pipeline.sources.current_field import LandMask
from pipeline.sources.land import osm
from pipeline.stages.water_grid import WaterGrid, widened_by

_GEOD = pyproj.Geod(ellps="WGS84")
# A canal is named if the way through it is at most this share of the way around.
_SHORTER = 0.8
# Where no way was found, canals on a way of this many direct distances are looked at.
_ROUNDABOUT = 2.0
# Margin of the grid around all places, as a share of the longest distance between them, for ways
# around capes; and its least, m.
_MARGIN_SHARE = 0.3
_MARGIN_M = 20_000.0
# Land smaller than this share of the grid's extent does not bar a way on it.
_LEAST_LAND = 1 / 600


class Canal(NamedTuple):
    """A canal: places at sea off both ends (lon, lat), and its length, m."""

    name: str
    ends: tuple[Point, Point]
    length_m: float

    def way_m(self, start: Point, goal: Point) -> tuple[float, Point, Point]:
        """Return the least length of a way through it, m, and its ends in the order of passing."""
        return min(
            (_apart_m(start, one) + self.length_m + _apart_m(other, goal), one, other)
            for one, other in (self.ends, self.ends[::-1])
        )


@cache
def canals() -> tuple[Canal, ...]:
    """Return the catalogue's canals."""
    with (catalogue.root() / "canals.csv").open(encoding="utf-8", newline="") as file:
        return tuple(
            Canal(
                row["name"],
                (
                    (float(row["one_lon"]), float(row["one_lat"])),
                    (float(row["other_lon"]), float(row["other_lat"])),
                ),
                1000.0 * float(row["length_km"]),
            )
            for row in csv.DictReader(file)
        )


def canal_notes(start: Point, goal: Point, around_m: float | None) -> Iterator[Note]:
    """Yield a note on the canal that joins two places (lon, lat) best, if one does.

    `around_m` is the length of the way found without it; None if there is none.
    """
    most_m = math.inf if around_m is None else _SHORTER * around_m
    if around_m is None:
        (by_water_m,) = _by_water_m((start, goal))
        most_m = min(_ROUNDABOUT * _apart_m(start, goal), _SHORTER * by_water_m)
    near = sorted((canal.way_m(start, goal), canal) for canal in canals())
    found: tuple[float, Note] | None = None
    for (least_m, one, other), canal in near:
        if least_m > (most_m if found is None else found[0]):
            break
        way_m = canal.length_m + sum(_by_water_m((start, one), (other, goal)))
        if way_m <= most_m and (found is None or way_m < found[0]):
            note = Note.of(
                "canal-left-out",
                canal=canal.name,
                way_m=way_m,
                begin=Place(*one),
                end=Place(*other),
            )
            found = way_m, note
    if found is not None:
        yield found[1]


def _by_water_m(*legs: tuple[Point, Point]) -> Iterator[float]:
    """Yield the lengths of legs by water on one coarse grid, m; inf where land bars one."""
    points = np.array(legs).reshape(-1, 2)
    far_m = max(_apart_m(tuple(points[0]), tuple(point)) for point in points[1:])
    bounds = widened_by(bounds_of(points), max(_MARGIN_SHARE * far_m, _MARGIN_M))
    least_deg = _LEAST_LAND * far_m / METRES_PER_DEGREE
    land = osm.polygons_near("Osm", shapely.box(*bounds), least_deg)[0][0]
    grid = WaterGrid.of(LandMask.of(land, bounds), bounds)
    for begin, end in legs:
        one, other = grid.water_near(*begin), grid.water_near(*end)
        ways = grid.shortest_paths(one, other) if one and other else []
        yield min((length_m for length_m, _ in ways), default=math.inf)


def _apart_m(one: Point, other: Point) -> float:
    """Return the length of the great circle between two places, m."""
    return float(_GEOD.inv(*one, *other)[2])
