"""The least padding that the rule can give an edge, and the water that it leaves to every route.

The rule (:mod:`renew.turns.padding_model`) pads an edge e for each triangle t that a path crosses
near it, by a quantile of the reach of drawn turns from t towards e, on a heading that depends on
the path. So a path in t stays at least g(t, e) off e, which is the least quantile over all
headings. A path that comes nearer to e than P(e) = min over t of max(distance of t from e, g(t, e))
breaks the rule.

g is bounded by those drawn turns that begin at least an angle γ off the heading, on one side of it.
As no drawn turn begins more than 20° off the heading, for every heading the turns on one of its
sides all begin at an angle β from the normal of e with γ <= |β| <= 180° - γ. A turn away from that
side reaches

    h(|β|) = v/ω (√(1 - r²) + sin |β|) + δ (arccos r + |β|)/ω,    r = -δ/v,

δ being the drift towards e. h rises up to |β| = arccos r and falls from there, so it is least at
either end; and it never falls as δ rises. So if more turns to a side than the risk allows drift by
δ or more, the quantile is no less than h at the worse end.

The claims on routes are proven in `docs/explanation/lower-bound.md`.
"""

import itertools
import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import shapely

from renew._compiled import kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.bounds.grids import turned_round, whole_grid, widened
from renew.bounds.travel_time import locate, mean_times
from renew.classes.dual_graph import without_dead_ends
from renew.classes.triangulation import Triangulation
from renew.inputs.current import CurrentStatistics
from renew.inputs.options import PlanOptions
from renew.turns.turn_reach import DrawnAside, TurnReach, TurnSampler
from renew.voyage.voyage import Voyage, Waters

# Largest padding that is considered, in multiples of v/ω: few triangles lie within it of an edge.
_MOST = 1.5
# Distance, as a share of an edge, within which a triangle counts as on the edge's line.
_FLAT = 1e-9
# Share by which paddings are lowered: a path may touch a triangle without crossing it.
_ROUNDING = 1e-6
# An edge lies behind other land if the point at some width straight off the edge is nearer to that
# land than this share of the width. Places on a long edge from which this is checked, and on a
# short edge.
_FREE, _PLACES, _MIDDLE = 0.99, (0.02, 0.5, 0.98), 0.5
# Number of cells of the grid on which travel times are estimated. Padding at a place counts if a
# route past it takes at most this multiple of the least time.
_CELLS, _SLACK = 16_000, 1.01
# Edges within this multiple of a turn's reach from a stop get no padding here, because padding that
# has grown there may contain the stop.
_GROWN = 2.0
# Places on a section, as shares, one of which keeps the clearance if the section is not narrow.
_SHARES = (0.5, 0.25, 0.75)
# Segments per quadrant of buffers, which lie within the true ones.
_SEGMENTS = 4
# Length of pieces of shore with reduced clearance, as a share of the clearance.
_PIECE = 0.25


def voyage_at_clearance(
    voyage: Voyage, triangulation: Triangulation, options: PlanOptions, reach: TurnReach
) -> Voyage:
    """Return the voyage in the least water that holds every route that the rule accepts.

    It is the water off the no-go zone, less the padding and the clearance that every route keeps
    off each edge of land. `reach` bounds the turns of the vessel.
    """
    chart = voyage.chart
    if len(chart.islands) > 1:
        # Areas that are shut for a while are land to this plan, but not to all routes.
        return voyage
    edges = triangulation.constrained_edges
    radius, clearance = voyage.vessel.turning_radius, options.clearance
    away = _GROWN * float(reach(voyage.stops).max()) + clearance / options.narrow_share
    lines = shapely.linestrings(edges) if len(edges) else np.array([], dtype=object)
    stops = shapely.multipoints(voyage.stops)
    width = max(options.min_width, radius if options.is_adaptive else 0.0)
    keep = _worth(voyage, edges[:, 0]) & ~shapely.dwithin(lines, stops, away)
    keep[keep] = _outermost(triangulation, width, edges[keep])
    lines, edges = lines[keep], edges[keep]
    padding = (1 - _ROUNDING) * _paddings(voyage, triangulation, options, edges)
    zone = [*shapely.buffer(lines[padding > 0], padding[padding > 0], quad_segs=_SEGMENTS)]
    if clearance > 0:
        if options.narrow_share < 1:
            yields = clearance / options.narrow_share + _PIECE * clearance
            lines = _outside(lines, _narrows(voyage, triangulation, clearance, yields, lines))
        zone += [*shapely.buffer(lines, (1 - _ROUNDING) * clearance, quad_segs=_SEGMENTS)]
    if not zone and chart.open_water is chart.water:
        return voyage
    own = chart.with_open_water(chart.less(chart.water, shapely.union_all(zone)))
    return replace(voyage, waters=Waters(own, voyage.current))


def _outside(lines: npt.NDArray[np.object_], area: shapely.Geometry) -> npt.NDArray[np.object_]:
    """Parts of lines (n,) that lie outside an area; few of them cross its edge."""
    shapely.prepare(area)
    lines = lines[~shapely.covers(area, lines)]
    crossing = shapely.intersects(area, lines)
    lines[crossing] = shapely.difference(lines[crossing], area)
    return lines


def _worth(voyage: Voyage, points: FloatArray) -> BoolArray:
    """Whether a route past each point (n, 2) is so quick that padding there may raise the bound.

    Times are estimates; the bound stays valid if padding is left out.
    """
    if not voyage.current.is_steady or len(voyage.via):
        return np.ones(len(points), dtype=bool)
    grid, ends = whole_grid(voyage, _CELLS), (voyage.start, voyage.goal)
    whole = np.zeros((grid.y.size, grid.x.size))
    for own, (begin, end) in ((grid, ends), (turned_round(grid, 0.0), ends[::-1])):
        whole += mean_times(own, begin, end)
    best = locate(grid, voyage.goal).corners(whole).min()
    nodes = widened(whole <= _SLACK * best, 1)
    column = np.clip(np.searchsorted(grid.x, points[:, 0]), 0, grid.x.size - 1)
    row = np.clip(np.searchsorted(grid.y, points[:, 1]), 0, grid.y.size - 1)
    return np.asarray(nodes[row, column])


def _outermost(triangulation: Triangulation, width: float, edges: FloatArray) -> BoolArray:
    """Edges (e, 2, 2) that face water: the point one width straight off is that far from land."""
    along = edges[:, 1] - edges[:, 0]
    # Water is on the left of an edge.
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    normal *= width / np.linalg.norm(along, axis=1, keepdims=True)
    free = np.zeros(len(edges), dtype=bool)
    is_long = np.linalg.norm(along, axis=1) > width
    for place in _PLACES:
        at = np.flatnonzero(is_long & ~free) if place != _MIDDLE else np.flatnonzero(~free)
        points = edges[at, 0] + place * along[at] + normal[at]
        near = triangulation.constrained_edge_tree.query(
            shapely.points(points), predicate="dwithin", distance=_FREE * width
        )[0]
        free[np.delete(at, near)] = True
    return free


def _narrows(
    voyage: Voyage,
    triangulation: Triangulation,
    clearance: float,
    reach: float,
    lines: npt.NDArray[np.object_],
) -> shapely.Geometry:
    """Area around triangles that may have a section without a place that keeps the clearance (m).

    Within `reach` (m) of such triangles the clearance may be reduced
    (:func:`renew.planner.hindrances.with_clearance`). Triangles that are further from all `lines`
    are left out.
    """
    ends = [triangulation.locate(stop) for stop in voyage.stops]
    inside = np.zeros(len(triangulation.triangles), dtype=bool)
    for first, last in itertools.pairwise(ends):
        inside |= without_dead_ends(triangulation.neighbours, first, last)
    corners, narrow = triangulation.corners, np.zeros(len(inside), dtype=bool)
    width, rows = reach / math.cos(math.pi / 32), np.flatnonzero(inside)
    near, _ = shapely.STRtree(lines).query(
        shapely.polygons(corners[rows]), predicate="dwithin", distance=width
    )
    inside[np.delete(rows, near)] = False
    for pivot in range(3):
        one, other = (pivot + 1) % 3, (pivot + 2) % 3
        # A section leads from the pivot, between two passing edges, to the edge opposite.
        is_fan = (triangulation.neighbours[:, [one, other]] >= 0).all(axis=1)
        left = np.flatnonzero(inside & is_fan & ~narrow)
        for share in _SHARES:
            own = corners[left]
            across = own[:, [pivot]] + share * (own[:, [one, other]] - own[:, [pivot]])
            near = triangulation.constrained_edge_tree.query(
                shapely.linestrings(across), predicate="dwithin", distance=clearance
            )[0]
            left = left[np.unique(near)]
        narrow[left] = True
    narrow[ends] = True
    return shapely.union_all(shapely.buffer(shapely.polygons(corners[narrow]), width))


def _paddings(
    voyage: Voyage, triangulation: Triangulation, options: PlanOptions, edges: FloatArray
) -> FloatArray:
    """Return a lower bound (e,), m, on the rule's padding of edges (e, 2, 2); 0 where none is."""
    if not options.is_adaptive:
        return np.full(len(edges), options.fixed_width)
    if voyage.choice.least < math.inf:
        # The rule's padding depends on the speeds that the vessel chooses.
        return np.zeros(len(edges))
    vessel, sampler = voyage.vessel, TurnSampler.for_risk(options.seed, options.risk)
    aside, *both = sampler.aside(options.risk)
    if not voyage.current.is_steady:
        # Within this speed of the current no turn drifts further away from an edge.
        tables = [one.table for one in voyage.in_members]
        strongest = max(table.strongest + table.error for table in tables)
        sure = all(one.weight[one.speed <= 0].sum() > one.least for one in both)
        reach = _least_reach(-strongest, aside, vessel.speed, vessel.turn_rate) if sure else 0.0
        return np.full(len(edges), reach)
    most = _MOST * vessel.turning_radius
    tree = shapely.STRtree(shapely.linestrings(edges) if len(edges) else [])
    shapes = shapely.polygons(triangulation.corners)
    triangle, edge = tree.query(shapes, predicate="dwithin", distance=most)
    apart = shapely.distance(shapes[triangle], tree.geometries[edge])
    met, row = np.unique(triangle, return_inverse=True)
    corners = triangulation.corners[met]
    padding = np.full(len(edges), most)
    statistics = voyage.waters.padded_for.statistics(corners)
    for drawn in both:
        _lower(
            padding, row, edge, apart, edges, corners, statistics, drawn, aside, vessel.speed,
            vessel.turn_rate,
        )  # fmt: skip
    return padding


@kernel
def _least_reach(drift: float, aside: float, speed: float, turn_rate: float) -> float:
    """Return h at its worse end, m, for a drift (m/s) towards the edge."""
    ratio = min(max(-drift / speed, -1.0), 1.0)
    furthest = speed / turn_rate * (math.sqrt(1.0 - ratio * ratio) + math.sin(aside))
    last = aside if drift >= 0 else math.pi - aside
    turn = furthest + drift * (math.acos(ratio) + last) / turn_rate
    return max(turn, drift * 2 * math.pi / turn_rate, 0.0)


@kernel
def _lower(
    padding: FloatArray,
    row: IntArray,
    edge: IntArray,
    apart: FloatArray,
    edges: FloatArray,
    corners: FloatArray,
    current: CurrentStatistics,
    drawn: DrawnAside,
    aside: float,
    speed: float,
    turn_rate: float,
) -> None:
    """Lower the padding (e,), m, to the bound from each triangle `row[p]`, `apart[p]` m away.

    The rows ascend.
    """
    count = len(drawn.speed)
    # The drift at which the reach equals the padding.
    least_drift = np.full(len(padding), np.inf)
    u, v, drift = np.empty(count), np.empty(count), np.empty(count)
    known = -1
    for p in range(len(row)):
        e, t = edge[p], row[p]
        if apart[p] >= padding[e]:
            continue
        if t != known:
            known = t
            for k in range(count):
                strength = max(0.0, current.speed[t] + current.speed_std[t] * drawn.speed[k])
                towards = current.direction[t] + current.direction_std[t] * drawn.turn[k]
                u[k], v[k] = strength * math.cos(towards), strength * math.sin(towards)
        nx, ny, is_left, is_right = _sides(edges[e], corners[t])
        # Turns are looked at along the normal that leads away from the triangle.
        for sign, is_there in ((-1.0, is_left), (1.0, is_right)):
            if not is_there:
                continue
            for k in range(count):
                drift[k] = sign * (u[k] * nx + v[k] * ny)
            sure = _sure_drift(drift, drawn, least_drift[e])
            reach = _least_reach(sure, aside, speed, turn_rate) if sure > -np.inf else 0.0
            if max(apart[p], reach) < padding[e]:
                padding[e] = max(apart[p], reach)
                least_drift[e] = sure if reach > apart[p] else np.inf


@kernel
def _sides(edge: FloatArray, corners: FloatArray) -> tuple[float, float, bool, bool]:
    """Return an edge's left normal, and whether a triangle has points on each side of its line.

    A triangle that is flat on the line counts as on both sides.
    """
    nx, ny = edge[0, 1] - edge[1, 1], edge[1, 0] - edge[0, 0]
    length = math.hypot(nx, ny)
    nx, ny = nx / length, ny / length
    off = (corners[:, 0] - edge[0, 0]) * nx + (corners[:, 1] - edge[0, 1]) * ny
    is_left, is_right = off.max() > _FLAT * length, off.min() < -_FLAT * length
    is_flat = not (is_left or is_right)
    return nx, ny, is_left or is_flat, is_right or is_flat


@kernel
def _sure_drift(drift: FloatArray, drawn: DrawnAside, enough: float) -> float:
    """Return the largest drift (m/s) that more draws (d,) reach than the risk allows; else -inf.

    It is infinite if that many draws reach `enough`. The array `drift` is overwritten.
    """
    if drawn.weight[drift >= enough].sum() > drawn.least:
        return math.inf
    beyond = 0.0
    while True:
        # Compiling a sort would take two seconds.
        k = drift.argmax()
        largest = drift[k]
        beyond += drawn.weight[k]
        if beyond > drawn.least or largest == -np.inf:
            return float(largest)
        drift[k] = -np.inf
