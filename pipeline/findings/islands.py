"""Islands of a scene: their names in the catalogue, and the narrow gaps between them.

A polygon of land is an island of the catalogue on three conditions. It lies in the island's bounds
and is about as large. It contains the island's own point, or reaches as far as the island on every
side. If the region cuts the island, only the sides inside the region are compared, and there must
be two of them unless the polygon contains the point. So a continent never has an island's name, and
only one of two pieces of an island can have it.

Between two close coasts there are many gaps, most of them between rocks and useless. Gaps are taken
in the order of their width, and each gap between two parts of the land joins them into one: wider
gaps between these two are skipped (Kruskal, *On the shortest spanning subtree of a graph*, 1956).
The remaining gaps are the bottlenecks: if they are wide enough, every strait is wide enough. The
detour around a shut gap depends on the smaller of the two parts.
"""

import csv
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import shapely

from pipeline._types import FloatArray, Geometries, IndexArray
from pipeline.geo.projection import METRES_PER_DEGREE, bounds_of
from pipeline.model import PlaceName, Water
from pipeline.scenario import catalogue

# Largest distance between a side and the catalogue's, degrees: the catalogue is drawn at 1:10m,
# where outlines are off by kilometres.
_OFF_DEG = 0.05
# The same for a large island, as a share of its extent.
_OFF_SHARE = 0.1
# Least area of a polygon, in areas of the island: the catalogue's outlines can lie far from the
# coast.
_LEAST = 0.4
# Largest area of a polygon, in areas of the island.
_MOST = 1.6
# Least area of a piece of an island that the region cuts.
_LEAST_PIECE = 0.02
# Number of compared sides that is enough without the island's point.
_SIDES = 2
# Step of points on an island's bounds, because the sides are curved in the plane, true metres.
_FRAME_STEP_M = 50_000.0
# Signs of west, south, east and north: outwards is positive.
_OUTWARDS = np.array([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True, slots=True)
class Island:
    """An island of the catalogue: a point on it, its west, south, east and north sides, area."""

    name: str
    lon: float
    lat: float
    bounds: tuple[float, float, float, float]
    area_km2: float

    def moved(self, turns: int) -> "Island":
        """Return the island with its longitudes shifted by whole turns."""
        west, south, east, north = self.bounds
        by = 360.0 * turns
        return Island(
            self.name, self.lon + by, self.lat, (west + by, south, east + by, north), self.area_km2
        )


@cache
def islands() -> tuple[Island, ...]:
    """Return the catalogue's islands."""
    with catalogue.islands().open(encoding="utf-8", newline="") as file:
        return tuple(
            Island(
                row["name"],
                float(row["lon"]),
                float(row["lat"]),
                (float(row["west"]), float(row["south"]), float(row["east"]), float(row["north"])),
                float(row["area_km2"]),
            )
            for row in csv.DictReader(file)
        )


def island_places(water: Water) -> tuple[PlaceName, ...]:
    """Return a place for each polygon of land that is an island of the catalogue."""
    return () if water.is_planar or not water.land else tuple(_Finder(water).places())


@dataclass(frozen=True)
class _Finder:
    """Finds islands in one chart."""

    water: Water

    def places(self) -> Iterator[PlaceName]:
        """Yield a point and the name of each polygon that is an island."""
        found: dict[int, Island] = {}
        for island in self._in_region():
            at = self._polygon(island)
            if at is not None and self._fits_better(at, island, found.get(at)):
                found[at] = island
        for at, island in found.items():
            point = shapely.get_coordinates(shapely.point_on_surface(self._land[at]))[0]
            lon, lat = self.water.projection.to_lonlat(point).tolist()
            area_deg2 = island.area_km2 * 1e6 / METRES_PER_DEGREE**2
            yield PlaceName(island.name, lon, lat, area_deg2)

    def _in_region(self) -> Iterator[Island]:
        """Yield the islands whose bounds meet the region's, in its longitudes."""
        west, south, east, north = self._region
        for island in islands():
            at_home = island.moved(round(((west + east) / 2 - island.lon) / 360))
            bounds = at_home.bounds
            if bounds[0] < east and bounds[2] > west and bounds[1] < north and bounds[3] > south:
                yield at_home

    def _polygon(self, island: Island) -> int | None:
        """Return the index of an island's polygon; None without one, or if several fit."""
        plane = self.water.projection
        point = shapely.Point(plane.to_plane(np.array([island.lon, island.lat])))
        near = self._alike(self._tree.query(point, "intersects"), island, sides=0)
        if not len(near):
            frame = plane.geometry_to_plane(shapely.box(*island.bounds), _FRAME_STEP_M)
            near = self._alike(self._tree.query(frame, "intersects"), island, sides=_SIDES)
        return int(near[0]) if len(near) == 1 else None

    def _alike(self, near: IndexArray, island: Island, sides: int) -> IndexArray:
        """Return the polygons that can be an island by their areas and bounds.

        If `sides` is not 0, at least `sides` sides of the island must be inside the region, and
        all of these must agree with the polygon's.
        """
        expected = np.array(island.bounds)
        is_seen = _OUTWARDS * (np.array(self._region) - expected) >= 0
        if is_seen.sum() < sides:
            return near[:0]
        size = self._area_km2[near] / island.area_km2
        near = near[(size <= _MOST) & (size >= (_LEAST if is_seen.all() else _LEAST_PIECE))]
        beyond = _OUTWARDS * (self._bounds(near) - expected)
        off = _OFF_DEG + _OFF_SHARE * np.tile(expected[2:] - expected[:2], 2)
        fits = (beyond <= off).all(axis=1)
        if sides:
            fits &= (beyond[:, is_seen] >= -off[is_seen]).all(axis=1)
        return np.asarray(near[fits])

    def _fits_better(self, at: int, island: Island, than: Island | None) -> bool:
        """Whether a polygon's area is closer to an island's than to another's."""
        if than is None:
            return True
        area = float(self._area_km2[at])
        return abs(math.log(area / island.area_km2)) < abs(math.log(area / than.area_km2))

    def _bounds(self, near: IndexArray) -> FloatArray:
        """Return the west, south, east and north sides (n, 4) of polygons, degrees."""
        if not len(near):
            return np.empty((0, 4))
        # Hulls keep the outermost points and have few others, so this is quicker.
        hulls = shapely.convex_hull(self._land[near])
        points, owner = shapely.get_coordinates(hulls, return_index=True)
        lonlat = self.water.projection.to_lonlat(points)
        first = np.searchsorted(owner, np.arange(len(near)))
        sides = (np.minimum.reduceat(lonlat, first), np.maximum.reduceat(lonlat, first))
        return np.hstack(sides)

    @cached_property
    def _area_km2(self) -> FloatArray:
        return np.asarray(shapely.area(self._land)) * self.water.projection.scale**2 / 1e6

    @cached_property
    def _land(self) -> Geometries:
        return np.array(self.water.land, dtype=object)

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree(self._land)

    @cached_property
    def _region(self) -> tuple[float, float, float, float]:
        """The region's west, south, east and north side, degrees."""
        corners = shapely.get_coordinates(self.water.chart.extent)
        return bounds_of(self.water.projection.to_lonlat(corners))


# Coasts are divided into pieces of this many segments, to measure distances between pieces.
_PIECE = 16


@dataclass(frozen=True, slots=True)
class Gap:
    """A gap between two parts of the land, planar metres.

    `line` (2, 2) leads from coast to coast, `part_m` is the size of the smaller part: the diagonal
    of its bounds.
    """

    line: FloatArray
    part_m: float

    @property
    def width_m(self) -> float:
        """Width of the gap."""
        return float(np.linalg.norm(self.line[1] - self.line[0]))


def narrow_gaps(
    land: Geometries, widest_m: float, is_shut: Callable[[FloatArray], bool]
) -> list[Gap]:
    """Return the shut bottlenecks between parts of the land (valid planar polygons).

    Gaps up to `widest_m` wide count, the narrowest first; `is_shut` takes a gap's line (2, 2).
    """
    from scipy.cluster.hierarchy import DisjointSet

    bodies = shapely.get_parts(shapely.disjoint_subset_union_all(land))
    if len(bodies) < 2:
        return []
    close, owner = _close_pairs(bodies, widest_m)
    parts, bounds = DisjointSet(range(len(bodies))), shapely.bounds(bodies).reshape(-1, 2, 2)
    found = []
    for coasts, pair in zip(close, owner.tolist(), strict=True):
        one, other = (parts[body] for body in pair)
        if one == other:
            continue
        line = shapely.get_coordinates(shapely.shortest_line(*coasts))
        if is_shut(line):
            both = bounds[[one, other]]
            found.append(Gap(line, float(np.linalg.norm(np.diff(both, axis=1), axis=-1).min())))
            parts.merge(one, other)
            bounds[parts[one]] = both[:, 0].min(axis=0), both[:, 1].max(axis=0)
    return found


def _close_pairs(bodies: Geometries, widest_m: float) -> tuple[Geometries, IndexArray]:
    """Return the closest pieces of coast (n, 2) of bodies that are close, and the bodies (n, 2).

    The closest bodies come first.
    """
    pieces, owner = _pieces(bodies)
    if not len(pieces):
        return np.empty((0, 2), dtype=object), np.empty((0, 2), dtype=np.intp)
    # By their boxes first: nearly all close pieces are neighbours on one coast.
    boxes = shapely.box(*(shapely.bounds(pieces) + widest_m * _OUTWARDS).T)
    one, other = shapely.STRtree(pieces).query(boxes)
    differ = owner[one] < owner[other]
    one, other = one[differ], other[differ]
    apart = shapely.distance(pieces[one], pieces[other])
    near = apart <= widest_m
    one, other, apart = one[near], other[near], apart[near]
    order = np.lexsort((apart, owner[other], owner[one]))
    pairs = np.stack([owner[one[order]], owner[other[order]]], axis=-1)
    is_first = np.ones(len(pairs), dtype=bool)
    is_first[1:] = (pairs[1:] != pairs[:-1]).any(axis=1)
    nearest = order[is_first]
    nearest = nearest[np.argsort(apart[nearest], kind="stable")]
    both = np.stack([one[nearest], other[nearest]], axis=-1)
    return pieces[both], owner[both]


def _pieces(bodies: Geometries) -> tuple[Geometries, IndexArray]:
    """Divide the coasts of bodies into lines (n,) of some segments, with their bodies (n,)."""
    rings, body = shapely.get_rings(bodies, return_index=True)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    number = np.arange(len(points)) - np.searchsorted(ring, ring)
    last = np.searchsorted(ring, ring, side="right") - 1
    begins = np.flatnonzero((number % _PIECE == 0) & (np.arange(len(points)) < last))
    counts = np.minimum(_PIECE, last[begins] - begins) + 1
    piece = np.repeat(np.arange(len(begins)), counts)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    lines = shapely.linestrings(points[begins[piece] + within], indices=piece)
    return np.atleast_1d(lines), body[ring[begins]]
