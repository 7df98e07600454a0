"""Ways that no route takes: a lower bound on the fuel of some, and straits that are shut.

Between two close coasts there are many gaps, most of them between rocks and useless. Gaps are taken
in the order of their width, and each gap between two parts of the land joins them into one: wider
gaps between these two are skipped (Kruskal, *On the shortest spanning subtree of a graph*, 1956).
The remaining gaps are the bottlenecks: if they are wide enough, every strait is wide enough. The
detour around a shut gap depends on the smaller of the two parts.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from shapely import LineString, Point
from shapely.geometry.base import BaseGeometry

from pipeline._types import FloatArray, Geometries, IndexArray
from pipeline.geo.coast import in_small_pieces
from pipeline.model import (
    Case,
    CaseResult,
    ShutStrait,
    SimplifiedLand,
    Water,
    plan_options,
)
from pipeline.model.result import NumberedIsland
from pipeline.scenario.model import PlannerOptions
from renew.bounds.fuel_lower_bound import fuel_lower_bound
from renew.errors import Strait
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
# Largest length of the straight lines through a strait, in lengths of the best route: a much longer
# way would not need less fuel.
_LONGER = 1.05
# Largest distance between a strait's bank and the original land, as a multiple of the sum of margin
# and tolerance.
_AT_LAND = 1.1
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
    case: Case, result: CaseResult, main: NumberedIsland | None, options: PlannerOptions
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


def _with_price(voyage: Voyage, case: Case, result: CaseResult) -> Voyage:
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
        voyage,
        least_speed=speeds.least,
        price=max(0.0, -float(slope)),
        deadline=result.arrive_by_s,
    )


def strip_across(
    island: Point, best: LineString, others: Sequence[LineString], case: Case
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
    planned: Sequence[tuple[Case, CaseResult]],
    stops: FloatArray,
    simplified: SimplifiedLand,
    options: PlannerOptions,
) -> tuple[ShutStrait, ...]:
    """Return the important straits that margin, tolerance or padding shut, the widest first.

    A strait is important on two conditions. The land on both sides is larger than a hundredth of
    the distance between start and goal, so that a detour is longer by about as much. And the
    straight lines from start and goal to the strait are together hardly longer than a case's best
    route. Wider straits are added if adaptive padding fills them, so that the planner rejected
    classes.
    """
    best = [result.routes[0].length for _, result in planned if result.routes]
    if not best or planned[0][0].water.is_planar:
        return ()
    padding = plan_options(options).likely_width(
        max(case.vessel.turning_radius for case, _ in planned)
    )
    finder = _StraitFinder(planned[0][0].water, stops[0], stops[-1], simplified, padding)
    rejected = finder.rejected([result for _, result in planned])
    straits = [*rejected, *finder.shut(_LONGER * max(best))]
    return tuple(sorted(straits, key=lambda strait: -strait.width_m))


@dataclass(frozen=True)
class _StraitFinder:
    """Finds the straits of one chart; lengths are planar metres, or true metres if named `_m`.

    `padding` is the width that nearly all paddings exceed.
    """

    water: Water
    start: FloatArray
    goal: FloatArray
    simplified: SimplifiedLand
    padding: float

    @cached_property
    def _no_go(self) -> Geometries:
        """The hard no-go zone: disjoint polygons, the large ones in pieces."""
        return in_small_pieces(np.array(self.water.chart.no_go, dtype=object))

    @cached_property
    def _tree(self) -> shapely.STRtree:
        """A spatial index of the hard no-go zone."""
        return shapely.STRtree(self._no_go)

    @property
    def margins_m(self) -> float:
        """The largest width that margin and tolerance take from a strait, true metres."""
        return 2 * (self.simplified.margin_m + self.simplified.tolerance_m)

    @property
    def needed_m(self) -> float:
        """The width above which a strait is open, true metres, unless its padding is very wide."""
        return self.margins_m + 2 * self.padding * self.water.projection.scale

    def shut(self, longest: float) -> Iterator[ShutStrait]:
        """Yield the important shut straits that a route of at most this length can reach."""
        water, scale = self.water, self.water.projection.scale
        land = np.array(water.land, dtype=object)
        near = land[shapely.intersects(water.chart.extent, land)]
        least = _PART_SHARE * float(np.linalg.norm(self.goal - self.start))
        for line, part in narrow_gaps(near, self.needed_m / scale, self._is_shut):
            middle = line.mean(axis=0)
            way = sum(np.linalg.norm(middle - end) for end in (self.start, self.goal))
            is_inside = shapely.intersects_xy(water.chart.extent, *middle)
            if part < least or way > longest or not is_inside:
                continue
            by_margin = self._open_water(line) * scale <= _NO_WATER_M
            width_m = water.projection.geodesic_length_m(line)
            needed_m = self.margins_m if by_margin else self.needed_m
            if width_m <= _COVERED * needed_m:
                yield self._strait(middle, width_m, needed_m, is_margin=by_margin)

    def rejected(self, results: Iterable[CaseResult]) -> list[ShutStrait]:
        """Return the straits at which classes were rejected, each once with all its cases.

        Only straits wider than `needed_m` are returned, because `shut` finds the narrower ones. A
        strait that is wide enough for the padding of its own banks is left out, because other land
        shuts it.
        """
        found: list[ShutStrait] = []
        for result in results:
            for one in result.plan.rejected if result.plan else ():
                strait = self._padded(one.strait, result.name) if one.strait else None
                if strait is None or not self.needed_m < strait.width_m <= strait.needed_m:
                    continue
                same = next(
                    (i for i, other in enumerate(found) if self._is_same(strait, other)), None
                )
                if same is None:
                    found.append(strait)
                else:
                    found[same] = _combined(found[same], strait)
        return found

    def _is_same(self, one: ShutStrait, other: ShutStrait) -> bool:
        """Whether two straits are closer to each other than the larger of the widths they need."""
        apart_m = self.water.projection.geodesic_length_m(
            self.water.projection.to_plane([(one.lon, one.lat), (other.lon, other.lat)])
        )
        return apart_m <= max(one.needed_m, other.needed_m)

    def _padded(self, strait: Strait, case: str) -> ShutStrait | None:
        """Return the strait at which a case's class was rejected; None if a bank is not land.

        A planner's gap may end at a corner of its channel that has water beyond it.
        """
        land, projection = np.array(self.water.land, dtype=object), self.water.projection
        ends = shapely.points(strait.gap)
        _, to_land = shapely.STRtree(land).query_nearest(
            ends, return_distance=True, all_matches=False
        )
        if to_land.max() * projection.scale > _AT_LAND * self.margins_m / 2:
            return None
        taken_m = (strait.padding_left + strait.padding_right) * projection.scale
        width_m = projection.geodesic_length_m(strait.gap) + to_land.sum() * projection.scale
        return self._strait(
            strait.gap.mean(axis=0), width_m, self.margins_m + taken_m, is_margin=False,
            cases=(case,),
        )  # fmt: skip

    def _strait(
        self,
        middle: FloatArray,
        width_m: float,
        needed_m: float,
        *,
        is_margin: bool,
        cases: tuple[str, ...] = (),
    ) -> ShutStrait:
        """Return a strait whose middle is a planar point (2,)."""
        lon, lat = self.water.projection.to_lonlat(middle).tolist()
        return ShutStrait(
            lon, lat, float(width_m), float(needed_m), "margin" if is_margin else "padding", cases
        )

    def _is_shut(self, line: FloatArray) -> bool:
        """Whether margin, tolerance and padding leave no way through a gap (2, 2)."""
        scale = self.water.projection.scale
        width = float(np.linalg.norm(line[1] - line[0]))
        # A gap narrower than margins and padding is shut. Any other is measured.
        if width * scale < 2 * self.simplified.margin_m + 2 * self.padding * scale:
            return True
        return self._open_water(line) <= max(2 * self.padding, _NO_WATER_M / scale)

    def _open_water(self, line: FloatArray) -> float:
        """Return the length of a line (2, 2) that is outside the hard no-go zone."""
        gap, no_go = shapely.LineString(line), self._no_go
        taken = [shapely.intersection(gap, no_go[i]).length for i in self._tree.query(gap)]
        return float(gap.length - sum(taken))


def _combined(one: ShutStrait, other: ShutStrait) -> ShutStrait:
    """Combine two records of one strait: the larger needed width, and the cases of both."""
    seasons = tuple(dict.fromkeys((*one.seasons, *other.seasons)))
    return replace(max(one, other, key=lambda strait: strait.needed_m), seasons=seasons)


# Coasts are divided into pieces of this many segments, to measure distances between pieces.
_PIECE = 16


def narrow_gaps(
    land: Geometries, widest_m: float, is_shut: Callable[[FloatArray], bool]
) -> list[tuple[FloatArray, float]]:
    """Return the shut bottlenecks between parts of the land (valid planar polygons).

    Each has a line (2, 2) from coast to coast, and the size of the smaller part: the diagonal of
    its bounds. Gaps up to `widest_m` wide count, the narrowest first; `is_shut` takes a line.
    """
    from scipy.cluster.hierarchy import DisjointSet

    bodies = shapely.get_parts(shapely.disjoint_subset_union_all(land))
    if len(bodies) < 2:
        return []
    close, owner = _close_pairs(bodies, widest_m)
    parts, bounds = DisjointSet(range(len(bodies))), shapely.bounds(bodies).reshape(-1, 2, 2)
    gaps = []
    for coasts, pair in zip(close, owner.tolist(), strict=True):
        one, other = (parts[body] for body in pair)
        if one == other:
            continue
        line = shapely.get_coordinates(shapely.shortest_line(*coasts))
        if is_shut(line):
            both = bounds[[one, other]]
            gaps.append((line, float(np.linalg.norm(np.diff(both, axis=1), axis=-1).min())))
            parts.merge(one, other)
            bounds[parts[one]] = both[:, 0].min(axis=0), both[:, 1].max(axis=0)
    return gaps


def _close_pairs(bodies: Geometries, widest_m: float) -> tuple[Geometries, IndexArray]:
    """Return the closest pieces of coast (n, 2) of bodies that are close, and the bodies (n, 2).

    The closest bodies come first.
    """
    pieces, owner = _pieces(bodies)
    if not len(pieces):
        return np.empty((0, 2), dtype=object), np.empty((0, 2), dtype=np.intp)
    # By their boxes first: nearly all close pieces are neighbours on one coast.
    boxes = shapely.box(*(shapely.bounds(pieces) + widest_m * np.array([-1, -1, 1, 1])).T)
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
