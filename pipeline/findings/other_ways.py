"""Ways that no route takes: a lower bound on the fuel of some, and straits that are shut.

Between two close coasts there are many gaps, most of them between rocks and useless. Gaps are taken
in the order of their width, and each gap between two parts of the land joins them into one: wider
gaps between these two are skipped (Kruskal, *On the shortest spanning subtree of a graph*, 1956).
The remaining gaps are the bottlenecks: if they are wide enough, every strait is wide enough. The
detour around a shut gap depends on the smaller of the two parts.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Literal, NamedTuple

import numpy as np
import shapely
from shapely import LineString, Point
from shapely.geometry.base import BaseGeometry

from pipeline import model
from pipeline._types import FloatArray, Geometries, IndexArray
from pipeline.findings.shortcuts import shortcuts
from pipeline.findings.way_names import island_places
from pipeline.geo.coast import in_small_pieces
from pipeline.model.result import NumberedIsland
from pipeline.scenario.model import PlannerOptions
from renew.bounds.fuel_lower_bound import fuel_lower_bound
from renew.errors import Length
from renew.inputs.current import as_field
from renew.voyage.voyage import Voyage, Waters

# Number of lines that are drawn from the island in all directions. Each is widened to a strip, and
# the suitable strip with the least area is used.
_DIRECTIONS = 72
# Number of cells of the bound's finest grid; the grid is refined until the side is proven. With few
# cells, the front passes through narrow islands: the bound stays valid, but is lower.
_CELLS = 160_000
# The same for speeds chosen in a changing current, where the bound is loose on any grid.
_CELLS_AT_CHOICE = 16_000
# Width of the strip, as a share of the square root of the chart's area: three of the finest cells.
_WIDTH = 3 / math.sqrt(_CELLS)
# Minimum size of the land on either side of a strait, as a share of the voyage's distance.
_PART_SHARE = 0.01
# Largest length of a way through a strait, in lengths of the best route: a longer one would not
# save time. The quickest way round on the roadmap is to be among them, and may be longer by this.
_LONGER = 1.02
# A shut strait up to this multiple of the width that the planner needs is shut by its own banks.
# The excess allows for the errors of margin, tolerance and projection. A wider strait without water
# lies in enclosed water, which is land to the planner; the straits that enclose it are found
# separately.
_COVERED = 1.05
# Open width below which a gap is an artefact of rounding and not a way, true metres.
_NO_WATER_M = 1.0
# The search for a bound ends at this multiple of the best route's fuel. At the fuel itself it would
# prove the side, but would not say by how much.
_PLAIN = 1.01


def side_bound(
    case: model.Case, result: model.CaseResult, main: NumberedIsland | None, options: PlannerOptions
) -> float | None:
    """Bound the fuel, planner's units, of ways on the main island's other side; None if unknown.

    The best route crosses a line from the main island to the chart's edge; no route on the island's
    other side crosses it. A strip along that line is treated as land. The lower bound on fuel
    (:mod:`renew.bounds.fuel_lower_bound`) then holds for every way that avoids the strip, however
    close to land. If the bound is above the best route's fuel, no such way is better.
    """
    rows = result.measures.routes
    paths = [shapely.LineString(route.path) for route in result.routes]
    others = [
        path
        for row, path in zip(rows, paths, strict=True)
        if row.main_passage != rows[0].main_passage
    ]
    if main is None or not others:
        return None
    strip = strip_across(shapely.Point(main.x, main.y), paths[0], others, case)
    if strip is None:
        return None
    elsewhere = case.chart.with_open_water(case.chart.less(case.chart.open_water, strip))
    voyage = Voyage(
        Waters(elsewhere, as_field(case.current)),
        case.vessel,
        case.start,
        case.goal,
        options.drift,
        via=case.via,
    )
    voyage = _with_price(voyage, case, result)
    is_loose = voyage.price < math.inf and case.departure is not None
    cells = _CELLS_AT_CHOICE if is_loose else _CELLS
    fuel = fuel_lower_bound(voyage, cells, _PLAIN * result.routes[0].fuel)
    return fuel if math.isfinite(fuel) else None


def _with_price(voyage: Voyage, case: model.Case, result: model.CaseResult) -> Voyage:
    """Return the voyage with the case's choice of speeds, if it has one, at a price of time.

    The bound holds at any price (weak duality). The best price is nearly the slope of fuel over
    arrival time at the best route's arrival.
    """
    speeds, planned = case.speeds, result.plan
    if speeds is None or planned is None or planned.trade_off is None:
        return voyage
    arrivals, fuels = planned.trade_off.arrivals, planned.trade_off.fuels
    if len(arrivals) < 2:
        return voyage
    slope = np.interp(planned.best.times[-1], arrivals, np.gradient(fuels, arrivals))
    return replace(
        voyage, least_speed=speeds.least, price=max(0.0, -float(slope)), deadline=result.arrive_by_s
    )


def strip_across(
    island: Point, best: LineString, others: Sequence[LineString], case: model.Case
) -> BaseGeometry | None:
    """Return the smallest strip from an island to the chart's edge that `best` crosses.

    Its width is a share of the square root of the chart's area. No other route meets the strip, and
    all stops lie outside. None if there is no such strip.
    """
    extent = case.chart.extent
    reach, half = extent.length, _WIDTH * math.sqrt(extent.area) / 2
    ends = shapely.points(case.stops)
    strips = []
    for angle in 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS:
        far = (island.x + reach * math.cos(angle), island.y + reach * math.sin(angle))
        line = shapely.intersection(shapely.LineString([island, far]), extent)
        crossings = shapely.get_num_geometries(shapely.intersection(line, best))
        strip = line.buffer(half, cap_style="flat")
        if (
            line.geom_type == "LineString"
            and shapely.intersects(line, best)
            and crossings % 2 == 1
            and not shapely.intersects(strip, [*others, *ends]).any()
        ):
            strips.append(strip)
    return min(strips, key=lambda strip: strip.area, default=None)


def shut_straits(
    planned: Sequence[tuple[model.Case, model.CaseResult]],
    options: PlannerOptions,
    places: Sequence[model.PlaceName] = (),
) -> tuple[model.ShutStrait, ...]:
    """Return the important straits that margin, tolerance or padding shut.

    Of all, the straight lines from start and goal to the strait are together hardly longer than a
    case's best route. First come those of the ways that would be quicker, the best way first. The
    others separate areas of land larger than a hundredth of the distance between start and goal,
    and come by their width, the widest first. `places` are the chart's names of land.
    """
    found = [(case, result) for case, result in planned if result.routes]
    if not found or found[0][0].water.is_planar:
        return ()
    radius = max(case.vessel.turning_radius for case, _ in found)
    given = model.plan_options(options)
    likely = given.likely_width(radius)
    turns = 2 * radius if given.is_adaptive else 0.0
    water = found[0][0].water
    area = shapely.union_all([_reach(case, result) for case, result in found])
    area = shapely.intersection(water.chart.extent, area.convex_hull)
    finder = _StraitFinder(water, area, likely, max(likely, turns))
    paths = shapely.MultiLineString([one.path for _, result in found for one in result.routes])
    gaps = [
        gap
        for gap in finder.gaps([result for _, result in found])
        if not shapely.LineString(gap.line).intersects(paths)
    ]
    lines = np.array([gap.line for gap in gaps])
    share = np.array([math.dist(*gap.line) * water.projection.scale / gap.needed_m for gap in gaps])
    ways = shortcuts(found, area, lines, share, options.drift)
    known = (*places, *island_places(water))
    straits = dict[int, model.ShutStrait]()
    for number, way in enumerate(ways, 1):
        for at in sorted(way.straits - straits.keys(), key=lambda at: float(share[at])):
            beside = finder.beside(gaps[at].line, known)
            straits[at] = finder.told(gaps[at], saves=way.saves, way=number, beside=beside)
    least = _PART_SHARE * min(math.dist(case.start, case.goal) for case, _ in found)
    others = [
        finder.told(gap)
        for at, gap in enumerate(gaps)
        if at not in straits and finder.is_important(gap, least)
    ]
    return *straits.values(), *sorted(others, key=lambda strait: -strait.width_m)


def _reach(case: model.Case, result: model.CaseResult) -> shapely.Polygon:
    """Return a strip that holds every way hardly longer than the best route, planar metres.

    Such ways lie in an ellipse round start and goal, and the strip is as wide.
    """
    apart = math.dist(case.start, case.goal)
    longest = _LONGER * max(result.routes[0].length, apart)
    return shapely.LineString([case.start, case.goal]).buffer(math.sqrt(longest**2 - apart**2) / 2)


class _Gap(NamedTuple):
    """A strait with its line (2, 2) from shore to shore, planar metres.

    `part` is the size of the smaller part of the land beside it; `is_sure` is whether it is surely
    shut: a few of the others may be open to a vessel that does not pass them straight. The other
    attributes are as in ShutStrait.
    """

    line: FloatArray
    needed_m: float
    padding_m: float
    by: Literal["margin", "padding"] = "padding"
    seasons: tuple[str, ...] = ()
    part: float = math.inf
    is_sure: bool = True


@dataclass(frozen=True)
class _StraitFinder:
    """Finds the straits of one chart; lengths are planar metres, or true metres if named `_m`.

    `area` is where they count, `likely` the width that nearly all paddings exceed, and `turns` the
    one that hard-over turns or a clearance need beside a straight way in still water.
    """

    water: model.Water
    area: shapely.Polygon
    likely: float
    turns: float

    @cached_property
    def _no_go(self) -> Geometries:
        """The hard no-go zone: disjoint polygons, the large ones in pieces."""
        return in_small_pieces(np.array(self.water.chart.no_go, dtype=object))

    @cached_property
    def _tree(self) -> shapely.STRtree:
        """A spatial index of the hard no-go zone."""
        return shapely.STRtree(self._no_go)

    @cached_property
    def _land(self) -> shapely.STRtree:
        """A spatial index of the original land."""
        return shapely.STRtree(np.array(self.water.land, dtype=object))

    @cached_property
    def _coast(self) -> tuple[shapely.STRtree, IndexArray]:
        """A spatial index of short pieces of the land's coast, and the polygon of each."""
        pieces, owner = _pieces(self._land.geometries)
        return shapely.STRtree(pieces), owner

    def gaps(self, results: Sequence[model.CaseResult]) -> list[_Gap]:
        """Return the straits that padding shuts, each once.

        One at which classes were rejected is told with the figures of their refusals. It is left
        out if it is wide enough for the padding of its own banks: other land shuts it.
        """
        gaps = [*self._shut()]
        rejected = [
            (result.name, one.strait)
            for result in results
            for one in (result.plan.rejected if result.plan else ())
            if one.strait
        ]
        scale, lines = self.water.projection.scale, [gap.line for gap in gaps] if rejected else []
        known = {both: at for at, both in enumerate(self._shores(lines))}
        for case, strait in rejected:
            line = self.water.shores(strait.gap)
            # A corner of the channel may have water beyond it.
            if line is None:
                continue
            padding_m = (strait.padding_left + strait.padding_right) * scale
            needed_m = padding_m + self.water.true_m(Length(0.0, strait.gap))
            if math.dist(*line) * scale > needed_m:
                continue
            (shores,), told = self._shores([line]), _Gap(line, needed_m, padding_m)
            at = known.setdefault(shores, len(gaps))
            before = gaps[at] if at < len(gaps) else told
            if before.seasons:
                told = max(before, told, key=lambda gap: gap.needed_m)
            seasons = tuple(dict.fromkeys((*before.seasons, case)))
            gaps[at : at + 1] = [told._replace(seasons=seasons, part=before.part)]
        return gaps

    def _shores(self, lines: Sequence[FloatArray]) -> list[tuple[int, ...]]:
        """Return the numbers of the two polygons of land that each line (2, 2) joins, in order."""
        coast, owner = self._coast
        ends = shapely.points(np.array(lines).reshape(-1, 2))
        nearest = owner[coast.query_nearest(ends, all_matches=False)[1]].reshape(-1, 2)
        return [tuple(both) for both in np.sort(nearest, axis=1).tolist()]

    def beside(self, line: FloatArray, places: Sequence[model.PlaceName]) -> tuple[str, ...]:
        """Return the names of the land on the shores of a strait (2, 2): of its largest place."""
        lonlat = np.array([(place.lon, place.lat) for place in places]).reshape(-1, 2)
        points = shapely.points(self.water.projection.to_plane(lonlat))
        names = list[str]()
        for shore in self._land.geometries[list(*self._shores([line]))]:
            is_on = shapely.intersects(shore, points).tolist()
            on = [place for place, here in zip(places, is_on, strict=True) if here]
            names += [max(on, key=lambda place: place.area_deg2).name] if on else []
        return tuple(dict.fromkeys(names))

    def _shut(self) -> Iterator[_Gap]:
        """Yield the bottlenecks of the land that padding shuts, the narrowest first."""
        scale, land = self.water.projection.scale, self._land.geometries
        near = land[self._land.query(self.area, "intersects")]
        padding_m = 2 * self.turns * scale
        widest = 2 * self.water.added_m / scale + 2 * self.turns
        for line, part in narrow_gaps(near, widest, partial(self._is_shut, padding=self.turns)):
            if not shapely.intersects_xy(self.area, *line.mean(axis=0)):
                continue
            is_sure, open_m = self._is_shut(line, self.likely), self._open_water(line) * scale
            gap = _Gap(line, widest * scale, padding_m, part=part, is_sure=is_sure)
            yield gap if open_m > _NO_WATER_M else gap._replace(by="margin")

    def is_important(self, gap: _Gap, least: float) -> bool:
        """Whether a gap is shut by its own banks, parts of land that are not below a size."""
        # A wider one without water lies in water that others enclose.
        own_m = 2 * self.water.added_m if gap.by == "margin" else gap.needed_m
        width_m = math.dist(*gap.line) * self.water.projection.scale
        return gap.is_sure and gap.part >= least and width_m <= _COVERED * own_m

    def told(
        self, gap: _Gap, saves: float = 0.0, way: int = 0, beside: tuple[str, ...] = ()
    ) -> model.ShutStrait:
        """Return a gap for readers, with what a way through it saves."""
        projection = self.water.projection
        lon, lat = projection.to_lonlat(gap.line.mean(axis=0)).tolist()
        width_m = projection.geodesic_length_m(gap.line)
        of_gap = gap.needed_m, gap.padding_m, gap.by, gap.seasons
        return model.ShutStrait(lon, lat, width_m, *of_gap, saves, way, beside)

    def _is_shut(self, line: FloatArray, padding: float) -> bool:
        """Whether margin, tolerance and padding leave no way through a gap (2, 2)."""
        # A gap narrower than what surely is taken is shut. Any other is measured.
        if math.dist(*line) <= 2 * padding:
            return True
        return self._open_water(line) <= max(2 * padding, _NO_WATER_M / self.water.projection.scale)

    def _open_water(self, line: FloatArray) -> float:
        """Return the length of a line (2, 2) that is outside the hard no-go zone."""
        gap, no_go = shapely.LineString(line), self._no_go
        taken = [shapely.intersection(gap, no_go[i]).length for i in self._tree.query(gap)]
        return float(gap.length - sum(taken))


# Coasts are divided into pieces of this many segments, to measure distances between pieces.
_PIECE = 16
# Number of pieces whose neighbours are looked up at a time.
_BATCH = 4_096
# Shares of the largest width, up to which gaps are looked for in turn: the narrow ones join most of
# the land, and few pairs are left for the others.
_SHARES = np.array([1 / 16, 1 / 4, 1.0])


def narrow_gaps(
    land: Geometries, widest_m: float, is_shut: Callable[[FloatArray], bool]
) -> list[tuple[FloatArray, float]]:
    """Return the shut bottlenecks between parts of the land (valid planar polygons).

    Each has a line (2, 2) from coast to coast, and the size of the smaller part: the diagonal of
    its bounds. Gaps up to `widest_m` wide count, the narrowest first; `is_shut` takes a line.
    """
    bodies = shapely.get_parts(shapely.disjoint_subset_union_all(land))
    if len(bodies) < 2:
        return []
    pieces, owner = _pieces(bodies)
    tree, gaps, least = shapely.STRtree(pieces), list[tuple[FloatArray, float]](), -1.0
    # The number of each body's part is that of one of its bodies.
    part, bounds = np.arange(len(bodies)), shapely.bounds(bodies).reshape(-1, 2, 2)
    for widest in (widest_m * _SHARES).tolist():
        close = _close_pairs(tree, part[owner], owner, least, widest)
        least = widest
        for both in close.tolist():
            one, other = part[owner[both]].tolist()
            if one == other:
                continue
            line = shapely.get_coordinates(shapely.shortest_line(*pieces[both]))
            if is_shut(line):
                ends = bounds[[one, other]]
                gaps.append((line, float(np.linalg.norm(np.diff(ends, axis=1), axis=-1).min())))
                part[part == other] = one
                bounds[one] = ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)
    return gaps


def _close_pairs(
    tree: shapely.STRtree, part: IndexArray, owner: IndexArray, least: float, widest: float
) -> IndexArray:
    """Return the closest pieces of coast (n, 2) of bodies in different parts, the closest first.

    They are more than `least` and up to `widest` m apart. `part` and `owner` (p,) are the part and
    the body of each piece of the tree.
    """
    pieces, found = tree.geometries, list[tuple[IndexArray, IndexArray, FloatArray]]()
    # By their boxes first: nearly all close pieces are neighbours on one coast.
    boxes = shapely.box(*(shapely.bounds(pieces) + widest * np.array([-1, -1, 1, 1])).T)
    for begin in range(0, len(pieces), _BATCH):
        one, other = tree.query(boxes[begin : begin + _BATCH]) + np.array([[begin], [0]])
        differ = (owner[one] < owner[other]) & (part[one] != part[other])
        one, other = one[differ], other[differ]
        apart = shapely.distance(pieces[one], pieces[other])
        near = apart <= widest
        found.append((one[near], other[near], apart[near]))
    one, other, apart = (np.concatenate(columns) for columns in zip(*found, strict=True))
    order = np.lexsort((apart, owner[other], owner[one]))
    pairs = np.stack([owner[one[order]], owner[other[order]]], axis=-1)
    is_first = np.ones(len(pairs), dtype=bool)
    is_first[1:] = (pairs[1:] != pairs[:-1]).any(axis=1)
    nearest = order[is_first]
    nearest = nearest[apart[nearest] > least]
    nearest = nearest[np.argsort(apart[nearest], kind="stable")]
    return np.stack([one[nearest], other[nearest]], axis=-1)


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
