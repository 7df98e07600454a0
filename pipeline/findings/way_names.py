"""Names of ways for navigators: "west of Palawan", "between islands 2 and 5".

An island has the chart's name, else the catalogue's (`island_places`), else its number in the
planner's homotopy classes (:mod:`renew.classes.h_signature`: the largest is 1), in all cases the
same. Of islands that share a name only the largest has it. Every name begins with the main island:
the largest that distinguishes two routes of which none is much dearer than the case's cheapest, or
any two; others follow only where they are needed.

A polygon of land is an island of the catalogue if it lies in the island's bounds, is about as
large, and contains the island's own point or reaches as far as the island on every side. If the
region cuts the island, only the sides inside the region are compared, and there must be two of them
unless the polygon contains the point. So a continent never has an island's name, and only one of
two pieces of an island can have it.
"""

import csv
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import combinations, islice

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray, Geometries, IndexArray
from pipeline.findings.result import DEAR
from pipeline.geo.projection import METRES_PER_DEGREE, bounds_of
from pipeline.model import CaseResult, Passage, PlaceName, RouteKey, Water
from pipeline.model.result import NumberedIsland, Side
from pipeline.scenario import catalogue
from renew.classes.h_signature import Rays, rays_that_matter

_COMPASS: tuple[Side, ...] = ("north", "east", "south", "west")
# Number of sampled points of a route.
_SAMPLES = 1000
# Share of a route's length within which a place counts as its start or goal.
_AT_END = 1e-6
# Points are abeam of an island if their distance from its centre is at most this multiple of the
# smallest distance.
_NEAR = 2.0


def way_names(
    water: Water, results: Sequence[CaseResult], places: Sequence[PlaceName]
) -> tuple[tuple[CaseResult, ...], tuple[NumberedIsland, ...], tuple[NumberedIsland, ...]]:
    """Name the way of each route; `places` are the chart's names of land.

    Returns the results with names, the islands in them, and the islands in names of classes.
    """
    routes = {
        (result.name, rank): route
        for result in results
        for rank, route in enumerate(result.routes, start=1)
    }
    namer = _WayNamer(water, routes, tuple(places))
    passages = {key: namer.passages(key) for key in routes}
    named = []
    for result in results:
        rows = (
            replace(row, passages=passages.get((result.name, row.rank), ()))
            for row in result.measures.routes
        )
        measures = replace(result.measures, routes=tuple(rows))
        named.append(replace(result, measures=measures))
    rejected = [one for result in results if result.plan for one in result.plan.rejected]
    return tuple(named), namer.islands(), namer.class_islands(_letters(rejected))


def _letters(classes: Iterable[renew.Route | renew.Rejected]) -> frozenset[int]:
    """Return the numbers in the names of classes, such as {1, 2} for "s2.p1"."""
    return frozenset(int(n) for one in classes for n in re.findall(r"\d+", one.homotopy))


class _WayNamer:
    """Names the ways of all routes of a run."""

    def __init__(
        self, water: Water, routes: dict[RouteKey, renew.Route], places: tuple[PlaceName, ...]
    ) -> None:
        self._water, self._routes, self._places = water, routes, places
        self._catalogued = island_places(water)
        self._rays = Rays.of(water.chart)
        # Winding number: passages north of an island eastward, less those westward. Two routes pass
        # an island on different sides exactly if these numbers differ.
        self._windings = {
            key: self._winding_numbers_of(route.path) for key, route in routes.items()
        }
        self._spelled = _letters(routes.values())
        self._used: set[int] = set()
        # Many routes need the same islands.
        self._abeam, self._gap = cache(self._direction_from), cache(self._line_between)

    def passages(self, key: RouteKey) -> tuple[Passage, ...]:
        """Return a route's passages: the main island first, the others in order of passing."""
        if self._main is None:
            return ()
        others = self._distinguishing(key, self._main)
        islands = [self._main, *sorted(others, key=lambda island: self._along(key, island))]
        self._used.update(islands)
        found = {one: Passage(self._side(key, one), (self._name(one),)) for one in islands}
        for one, other in self._straits(key, islands):
            found[one] = Passage("between", (self._name(one), self._name(other)))
            found.pop(other)
        return tuple(found.values())

    def islands(self) -> tuple[NumberedIsland, ...]:
        """Return the islands in the names so far, the largest first."""
        return tuple(self._numbered(one, self._names.get(one, "")) for one in sorted(self._used))

    def class_islands(self, rejected: frozenset[int]) -> tuple[NumberedIsland, ...]:
        """Return the islands that names of classes number, and that no name of a way has.

        `rejected` are the numbers in the names of rejected classes. Water with an overpowering
        current has numbers, too, and is left out.
        """
        known = (rejected | self._spelled) & set(self._rays.island.tolist())
        numbers = known - (self._used - set(self._names))
        return tuple(self._numbered(island) for island in sorted(numbers))

    def _numbered(self, island: int, name: str = "") -> NumberedIsland:
        """Return an island with its number, name and position."""
        point = self._point(island)
        place = self._water.place_text(point)
        if not name and self._places:
            place += f", {self._nearest(point)}"
        return NumberedIsland(island, name, float(point[0]), float(point[1]), place)

    @cached_property
    def _distinguishing_any(self) -> list[int]:
        """Islands that two routes of some case pass on different sides, the largest first."""
        return self._distinguishing_of(self._routes)

    def _distinguishing_of(self, keys: Iterable[RouteKey]) -> list[int]:
        """Return the islands that two of these routes pass on different sides in a case."""
        windings = {key: self._windings[key] for key in keys}
        cases = {case for case, _ in windings}
        return sorted(
            island
            for island in self._spelled & set(self._rays.island.tolist())
            if len({(case, of[island]) for (case, _), of in windings.items()}) > len(cases)
        )

    def _not_dear(self) -> Iterator[RouteKey]:
        """Yield the routes that are not much dearer than the cheapest of their case."""
        least: dict[str, float] = {}
        for (case, _), route in self._routes.items():
            least[case] = min(route.fuel, least.get(case, math.inf))
        for key, route in self._routes.items():
            if route.fuel <= (1 + DEAR) * least[key[0]]:
                yield key

    @cached_property
    def _main(self) -> int | None:
        """The main island; if the routes of no case differ, the largest on the way."""
        if self._distinguishing_any or not self._routes:
            telling = self._distinguishing_of(self._not_dear()) or self._distinguishing_any
            return next(iter(telling), None)
        best = next(iter(self._routes.values()))
        on_the_way = rays_that_matter(self._rays, best.path, 2).island.tolist()
        return next((one for one in on_the_way if self._is_passed(one, best.path)), None)

    def _is_passed(self, island: int, path: FloatArray) -> bool:
        """Whether an island is nearest somewhere along a path (n, 2), not at its start or goal."""
        line = shapely.LineString(path)
        nearest = shapely.get_coordinates(shapely.shortest_line(line, self._outline(island)))[0]
        along = line.project(shapely.Point(nearest), normalized=True)
        return bool(_AT_END < along < 1 - _AT_END)

    def _distinguishing(self, key: RouteKey, main: int) -> list[int]:
        """Return a few islands that, with the main one, distinguish a route in its case.

        Those beside the route come first: no other land lies between.
        """
        mine = self._windings[key]
        alike = [
            winding
            for other, winding in self._windings.items()
            if other != key and other[0] == key[0] and winding[main] == mine[main]
        ]
        path = shapely.LineString(self._routes[key].path)
        chosen = []
        while alike:
            differing = {
                i: sum(winding[i] != mine[i] for winding in alike) for i in self._distinguishing_any
            }
            useful = [i for i, routes in differing.items() if routes]
            if not useful:
                break
            best = max(useful, key=lambda i: (self._is_beside(i, path), differing[i], -i))
            chosen.append(best)
            alike = [winding for winding in alike if winding[best] == mine[best]]
        return chosen

    def _is_beside(self, island: int, path: shapely.LineString) -> bool:
        """Whether no other land lies between a path and an island."""
        between = shapely.shortest_line(path, self._outline(island))
        return len(self._land.query(between, "intersects")) == 1

    def _straits(self, key: RouteKey, islands: list[int]) -> Iterable[tuple[int, int]]:
        """Yield pairs of islands between which a route passes, the closest first, no island twice.

        A gap is skipped if another route of the case crosses it with other winding numbers, as
        "between A and B" would describe both.
        """
        gaps = {pair: self._gap(*pair) for pair in combinations(islands, 2)}
        free = set(islands)
        for pair, gap in sorted(gaps.items(), key=lambda item: item[1].length):
            through = {
                tuple(winding[island] for island in pair)
                for other, winding in self._windings.items()
                if other[0] == key[0] and _crosses(self._routes[other].path, gap)
            }
            mine = tuple(self._windings[key][island] for island in pair)
            is_between = through == {mine} and _crosses(self._routes[key].path, gap)
            if is_between and free.issuperset(pair):
                free.difference_update(pair)
                yield pair

    def _side(self, key: RouteKey, island: int) -> Side:
        """Return the compass point of the side on which a route passes an island.

        It is nearest to the mean direction from the island to all routes with this winding number.
        If there is just one other winding number, the mean direction to its routes is subtracted.
        """
        mine = self._windings[key][island]
        values = {winding[island] for winding in self._windings.values()}
        direction = self._direction(island, mine)
        if len(values) == 2:
            direction = direction - self._direction(island, *(values - {mine}))
        east, north = self._water.projection.rotate_to_lonlat(
            self._water.projection.to_lonlat(self._point(island)), direction
        )
        bearing = float(np.degrees(np.arctan2(east, north)))
        return _COMPASS[round(bearing / 90) % 4]

    def _direction(self, island: int, winding: int) -> FloatArray:
        """Return the mean direction (2,), abeam of an island, to the routes with this winding."""
        keys = [key for key, of in self._windings.items() if of[island] == winding]
        return np.asarray(np.mean([self._abeam(key, island) for key in keys], axis=0))

    def _direction_from(self, key: RouteKey, island: int) -> FloatArray:
        """Return the mean direction (2,) from an island to the points of a route abeam of it."""
        line = shapely.LineString(self._routes[key].path)
        points = line.interpolate(np.linspace(0, 1, _SAMPLES), normalized=True)
        vectors = shapely.get_coordinates(points) - self._centre(island)
        distance = np.linalg.norm(vectors, axis=1)
        near = distance <= _NEAR * max(float(distance.min()), 1e-9)
        return np.asarray((vectors[near] / np.maximum(distance[near], 1e-9)[:, None]).mean(axis=0))

    def _line_between(self, one: int, other: int) -> shapely.LineString:
        """Return the shortest line between two islands."""
        return shapely.shortest_line(self._outline(one), self._outline(other))

    def _along(self, key: RouteKey, island: int) -> float:
        """Return the distance along a route, planar m, at which it passes an island."""
        path = shapely.LineString(self._routes[key].path)
        return float(path.project(shapely.Point(self._centre(island))))

    def _winding_numbers_of(self, path: FloatArray) -> Counter[int]:
        """Count how often a path passes north of each island, eastward less westward."""
        winding: Counter[int] = Counter()
        for letter in self._rays.word(path):
            winding[abs(letter)] += 1 if letter > 0 else -1
        return winding

    def _name(self, island: int) -> str:
        return self._names.get(island, str(island))

    @cached_property
    def _names(self) -> dict[int, str]:
        """Names of the islands for the names of ways; all are different."""
        main = [] if self._main is None else [self._main]
        names: dict[int, str] = {}
        for find in (self._chart_name, self._catalogue_name):
            for island in sorted({*main, *self._distinguishing_any} - set(names)):
                name = find(island)
                if name and name not in names.values():
                    names[island] = name
        return names

    def _chart_name(self, island: int) -> str:
        """Return the chart's name of the largest named land on an island, or ""."""
        named = self._on(self._places, self._outline(island))
        return max(named, key=lambda place: place.area_deg2).name if named else ""

    def _catalogue_name(self, island: int) -> str:
        """Return the catalogue's name of the largest land on an island, or "".

        An offing may join islands to each other, and to a continent.
        """
        land, outline = self._original_land, self._outline(island)
        if not self._catalogued:
            return ""
        parts = land.geometries[land.query(outline, predicate="intersects")]
        if not len(parts):
            return ""
        named = self._on(self._catalogued, parts[shapely.area(parts).argmax()])
        return named[0].name if named else ""

    def _on(self, places: tuple[PlaceName, ...], area: shapely.Polygon) -> list[PlaceName]:
        """Return the places that lie in an area, planar metres."""
        lonlat = [(place.lon, place.lat) for place in places]
        points = self._water.projection.to_plane(np.array(lonlat).reshape(-1, 2))
        inside = shapely.contains_xy(area, *points.T)
        return [place for place, is_inside in zip(places, inside, strict=True) if is_inside]

    def _nearest(self, point: FloatArray) -> str:
        """Say how far the chart's nearest named land is from a point (2,), planar metres."""
        lonlat = [(place.lon, place.lat) for place in self._places]
        away = np.linalg.norm(self._water.projection.to_plane(np.array(lonlat)) - point, axis=1)
        at = int(away.argmin())
        return (
            f"{away[at] * self._water.projection.scale / 1000:,.1f} km from {self._places[at].name}"
        )

    def _point(self, island: int) -> FloatArray:
        """Return a point (2,) on an island."""
        at = int((self._rays.island == island).argmax())
        return np.array([self._rays.x[at], self._rays.y[at]])

    def _centre(self, island: int) -> FloatArray:
        """Return an island's centroid (2,), or a point on it if the centroid is in water."""
        outline = self._outline(island)
        centroid = outline.centroid
        is_inside = outline.contains(centroid)
        return shapely.get_coordinates(centroid)[0] if is_inside else self._point(island)

    def _outline(self, island: int) -> shapely.Polygon:
        """Return an island's polygon in the planner's chart."""
        found = self._land.query(shapely.Point(self._point(island)), predicate="intersects")
        polygon: shapely.Polygon = self._land.geometries[found[0]]
        return polygon

    @cached_property
    def _land(self) -> shapely.STRtree:
        return shapely.STRtree(self._water.chart.no_go)

    @cached_property
    def _original_land(self) -> shapely.STRtree:
        return shapely.STRtree(self._water.land)


def _crosses(path: FloatArray, gap: shapely.LineString) -> bool:
    """Whether a path (n, 2) crosses the line of a gap an odd number of times."""
    places = shapely.intersection(shapely.LineString(path), gap)
    return not places.is_empty and shapely.get_num_geometries(places) % 2 == 1


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
        return replace(self, lon=self.lon + by, bounds=(west + by, south, east + by, north))


@cache
def islands() -> tuple[Island, ...]:
    """Return the catalogue's islands."""
    with (catalogue.root() / "islands.csv").open(encoding="utf-8", newline="") as file:
        return tuple(
            Island(name, lon, lat, (west, south, east, north), area_km2)
            for name, *figures in islice(csv.reader(file), 1, None)
            for lon, lat, west, south, east, north, area_km2 in [map(float, figures)]
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
