"""The chain of candidate waypoints whose legs cost least: few, short, and clear of V and land.

Two candidates see each other if the leg between them, drawn as it will be sailed, stays inside the
route's safe corridor and passes every hole of it on the same side as the path. To find that, and
the leg's clearance, takes long, and of all pairs few matter. So each leg first has a lower bound of
its cost, since it is no clearer than its ends; legs on the cheapest chains by these bounds are
examined, several at once, until every leg of the cheapest chain has been. Then no other chain can
be cheaper (Dellin and Srinivasa 2016, "A unifying formalism for shortest path problems with
expensive edge evaluations via lazy best-first search", ICAPS).
"""

import numpy as np
import numpy.typing as npt
import shapely

from pipeline._types import BoolArray, FloatArray, IntArray
from pipeline.formats.passage.candidates import Candidates
from pipeline.formats.passage.safe_corridor import SafeCorridor
from pipeline.formats.passage.tracks import Drawing
from pipeline.formats.shared.legs import metres_along

# Costs of a leg, added to the 1 that each leg costs: among chains of equally many legs the shorter
# one is taken, and a leg with half the wanted clearance costs one more, with a third two more. A
# clearance below the minimum share counts as that share.
_LENGTH_WEIGHT = 0.5
_CLEARANCE_WEIGHT = 1.0
_MIN_CLEARANCE_SHARE = 0.05
# Number of legs that are looked at together, at least, and as a share of those not yet known: a
# call takes as long as some dozens of legs.
_MIN_BATCH, _BATCH_SHARE = 60, 0.15


def cheapest_chain(
    candidates: Candidates, own: IntArray, corridor: SafeCorridor, drawing: Drawing
) -> Candidates:
    """Chain of candidates from the path's first point to its last at the least cost of its legs.

    The legs between the path's own points, with indices `own`, are always allowed.
    """
    lonlat = drawing.lonlat(candidates.xy)
    apart = np.linalg.norm(candidates.xy[:, None] - candidates.xy, axis=-1)
    length = candidates.along[own[-1]] - candidates.along[own[0]]
    shortest = 1 + _LENGTH_WEIGHT * apart / length
    allowed = np.full_like(apart, np.inf)
    allowed[own[:-1], own[1:]] = shortest[own[:-1], own[1:]] + _clearance_cost(0.0, corridor)

    ends = corridor.clearance(shapely.points(drawing.projection.to_plane(lonlat)))
    begin, end = _likely_legs(candidates, corridor)
    unknown = np.zeros(apart.shape, dtype=bool)
    unknown[begin, end] = True
    cost = allowed.copy()
    bound = _clearance_cost(np.minimum(ends[begin], ends[end]), corridor)
    cost[begin, end] = np.minimum(shortest[begin, end] + bound, allowed[begin, end])
    while True:
        chain, through = _shortest_path(cost, int(own[0]), int(own[-1]))
        if not unknown[chain[:-1], chain[1:]].any():
            return candidates[chain]
        begin, end = _least(through, unknown)
        lines = drawing.lines(lonlat[begin], lonlat[end])
        sees = shapely.covers(corridor.free, lines)
        if len(corridor.holes):
            sees &= _on_same_side(candidates, begin, end, lines, corridor)
        clear = np.full(len(begin), np.inf)
        clear[sees] = _clearance_cost(corridor.clearance(lines[sees]), corridor)
        cost[begin, end] = np.minimum(shortest[begin, end] + clear, allowed[begin, end])
        unknown[begin, end] = False


def _likely_legs(candidates: Candidates, corridor: SafeCorridor) -> tuple[IntArray, IntArray]:
    """Indices of pairs of candidates that may see each other: most are far apart."""
    begin, end = np.triu_indices(len(candidates), 1)
    # Candidates beside the path have the distance along it of the nearest point.
    onwards = candidates.along[end] > candidates.along[begin]
    begin, end = begin[onwards], end[onwards]
    for share in (0.5, 0.25, 0.75):
        point = candidates.xy[begin] + share * (candidates.xy[end] - candidates.xy[begin])
        near = shapely.contains_xy(corridor.free, point)
        begin, end = begin[near], end[near]
    return begin, end


def _clearance_cost(clearance: FloatArray | float, corridor: SafeCorridor) -> FloatArray:
    """What legs (k,) cost for having less than the wanted clearance, metres of the plane."""
    share = np.maximum(clearance / corridor.wanted_clearance, _MIN_CLEARANCE_SHARE)
    return np.asarray(_CLEARANCE_WEIGHT * (1 / share - 1))


def _shortest_path(cost: FloatArray, first: int, last: int) -> tuple[IntArray, FloatArray]:
    """Cheapest path from node `first` to `last`, by edges (n, n) from lower to higher numbers.

    Also returns the cost (n, n) of the cheapest path through each edge.
    """
    count = len(cost)
    to, previous = np.full(count, np.inf), np.zeros(count, dtype=np.int64)
    onwards = np.full(count, np.inf)
    to[first] = onwards[last] = 0.0
    for node in range(first + 1, count):
        costs = to[:node] + cost[:node, node]
        previous[node] = costs.argmin()
        to[node] = costs[previous[node]]
    for node in range(last - 1, -1, -1):
        onwards[node] = (cost[node, node + 1 :] + onwards[node + 1 :]).min()
    path = [last]
    while path[-1] != first:
        path.append(int(previous[path[-1]]))
    return np.array(path[::-1]), to[:, None] + cost + onwards


def _least(through: FloatArray, unknown: BoolArray) -> tuple[IntArray, IntArray]:
    """Indices of the unknown legs on the cheapest chains."""
    begin, end = np.nonzero(unknown)
    batch = min(len(begin), max(_MIN_BATCH, int(_BATCH_SHARE * len(begin))))
    chosen = np.argpartition(through[begin, end], batch - 1)[:batch]
    return begin[chosen], end[chosen]


def _on_same_side(
    candidates: Candidates,
    begin: IntArray,
    end: IntArray,
    lines: npt.NDArray[np.object_],
    corridor: SafeCorridor,
) -> BoolArray:
    """Whether legs (k,) pass every hole of the corridor on the same side as the path.

    Seen from the hole, the path and the leg then sweep the same angle; on different sides the
    angles differ by a whole turn.
    """
    same = np.ones(len(begin), dtype=bool)
    middles = shapely.get_coordinates(shapely.line_interpolate_point(lines, 0.5, normalized=True))
    along = np.union1d(metres_along(corridor.path), candidates.along)
    dense = shapely.get_coordinates(
        shapely.line_interpolate_point(shapely.LineString(corridor.path), along)
    )
    foot = np.searchsorted(along, candidates.along)
    for hole in corridor.holes:
        swept = np.unwrap(_direction(dense, hole))[foot]
        # From the path to the candidate, the short way.
        swept = swept + _wrapped(_direction(candidates.xy, hole) - swept)
        half = _wrapped(_direction(middles, hole) - swept[begin])
        leg = half + _wrapped(swept[end] - _direction(middles, hole))
        same &= np.abs(swept[end] - swept[begin] - leg) < np.pi
    return same


def _direction(points: FloatArray, origin: FloatArray) -> FloatArray:
    """Angles (n,) of points (n, 2) as seen from the origin, rad."""
    angle: FloatArray = np.arctan2(points[:, 1] - origin[1], points[:, 0] - origin[0])
    return angle


def _wrapped(angle: FloatArray) -> FloatArray:
    """Angles (n,) wrapped to -π to π."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
