"""The fewest waypoints: a shortest path through candidates, by legs inside the safe corridor."""

from dataclasses import dataclass

import numpy as np
import shapely

from pipeline._types import BoolArray, FloatArray, Geometries, IntArray
from pipeline.findings.route_profile import metres_along
from pipeline.formats.passage.safe_corridor import Drawing, SafeCorridor, cross
from renew.kernels.capsules import wrapped

# Minimum bend, rad, for which the intersection of the legs around it becomes a candidate.
_MIN_BEND_RAD = 0.1
# Clearance of candidates beside the path, in wanted clearances: more, since legs cut corners.
_OFFSET_CLEARANCE = 1.4
# Of narrow places closer to each other than this, in wanted clearances, only one is taken.
_NARROWS_WINDOW = 10

# Costs of a leg, added to the 1 that each leg costs: among chains of equally many legs the shorter
# one is taken, and a leg with half the wanted clearance costs one more, with a third two more. A
# clearance below the minimum share counts as that share.
_LENGTH_WEIGHT = 0.5
_CLEARANCE_WEIGHT = 1.0
_MIN_CLEARANCE_SHARE = 0.05
# Minimum number of legs that are measured at once, because a call costs as much as some dozens.
_MIN_BATCH = 60
# Legs measured at once, as a share of those that are not measured yet.
_BATCH_SHARE = 0.05

# Maximum number of parts into which a leg is split when its drawn curve leaves the corridor.
_MAX_PARTS = 64


@dataclass(frozen=True)
class Candidates:
    """Candidate waypoints in order: `xy` (n, 2) planar, `along` (n,) metres of path to each."""

    xy: FloatArray
    along: FloatArray

    def __getitem__(self, chosen: IntArray | slice) -> "Candidates":
        """Select candidates."""
        return Candidates(self.xy[chosen], self.along[chosen])

    def __len__(self) -> int:
        """Count the candidates."""
        return len(self.xy)


def concatenated(*parts: Candidates) -> Candidates:
    """Concatenate candidates."""
    return Candidates(
        np.concatenate([part.xy for part in parts]), np.concatenate([part.along for part in parts])
    )


def with_candidates(path: Candidates, corridor: SafeCorridor) -> tuple[Candidates, IntArray]:
    """Add corners and points further off V to a path's points; also return the indices of these."""
    return _with_offsets(*_with_corners(path, corridor), corridor)


def _with_corners(path: Candidates, corridor: SafeCorridor) -> tuple[Candidates, IntArray]:
    """Add the points where the legs before a bend and those after it would intersect.

    So a rounded corner becomes one waypoint, on the outer side, with the turn's radius. Also
    returns the indices of the path's own points among the candidates.
    """
    legs = np.diff(path.xy, axis=0)
    course = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    # A via point where one part of a path ends and the next begins is there twice.
    moving = np.flatnonzero(legs.any(axis=1))
    before, after = moving[np.stack(np.triu_indices(len(moving), 1))]
    turn = course[after] - course[before]
    bend = (np.abs(turn) > _MIN_BEND_RAD) & (np.abs(turn) < np.pi / 2)
    before, after = before[bend], after[bend]
    gap = path.xy[after] - path.xy[before + 1]
    turned = cross(legs[before], legs[after])
    ahead, back = cross(gap, legs[after]) / turned, cross(gap, legs[before]) / turned
    corner = path.xy[before + 1] + ahead[:, None] * legs[before]
    # Legs are extended to at most twice their length: the short ones are parts of an arc.
    chosen = (ahead > 0) & (ahead <= 1) & (back < 0) & (back >= -1)
    chosen[chosen] = shapely.contains_xy(corridor.free, corner[chosen])
    corner, before, after = corner[chosen], before[chosen], after[chosen]
    nearest = path.along[0] + shapely.line_locate_point(
        shapely.LineString(path.xy), shapely.points(corner)
    )
    along = np.clip(nearest, path.along[before + 1], path.along[after])
    candidates = Candidates(np.vstack([path.xy, corner]), np.concatenate([path.along, along]))
    order = np.argsort(candidates.along, kind="stable")
    return candidates[order], np.flatnonzero(order < len(path.xy))


def _with_offsets(
    candidates: Candidates, own: IntArray, corridor: SafeCorridor
) -> tuple[Candidates, IntArray]:
    """Add candidates further off V and land, beside those close to them and beside narrows.

    Between two shores they lie where the clearance is greatest. Also returns the new indices of the
    path's own points.
    """
    if corridor.blocked.is_empty:
        return candidates, own
    close = concatenated(candidates, _narrows(corridor, *candidates.along[[0, -1]]))
    points = shapely.points(close.xy)
    nearest = shapely.get_coordinates(shapely.shortest_line(corridor.blocked, points))[::2]
    off = close.xy - nearest
    apart = np.linalg.norm(off, axis=1)
    chosen = np.flatnonzero((apart > 0) & (apart < corridor.wanted_clearance))
    close, off, apart = close[chosen], off[chosen], apart[chosen]
    steps = _OFFSET_CLEARANCE * corridor.wanted_clearance / apart[:, None] - 1
    tried = close.xy + np.array([1.0, 0.5, 0.25])[:, None, None] * steps * off
    clearance = np.where(
        shapely.contains_xy(corridor.free, tried[..., 0], tried[..., 1]),
        shapely.distance(corridor.blocked, shapely.points(tried)),
        0.0,
    )
    better = clearance.max(axis=0) > apart
    moved = tried[clearance.argmax(axis=0), np.arange(len(apart))][better]
    merged = Candidates(
        np.vstack([candidates.xy, moved]), np.append(candidates.along, close.along[better])
    )
    order = np.argsort(merged.along, kind="stable")
    return merged[order], np.flatnonzero(np.isin(order, own))


def _narrows(corridor: SafeCorridor, begin: float, end: float) -> Candidates:
    """Return points of the path between two distances along it where it is closest to V or land."""
    along = np.linspace(begin, end, max(2, int((end - begin) / corridor.wanted_clearance)))
    points = shapely.line_interpolate_point(shapely.LineString(corridor.path), along)
    clearance = corridor.clearance(points)
    windows = np.lib.stride_tricks.sliding_window_view(
        np.pad(clearance, _NARROWS_WINDOW, constant_values=np.inf), 2 * _NARROWS_WINDOW + 1
    )
    narrows = np.flatnonzero(
        (clearance < corridor.wanted_clearance) & (clearance == windows.min(axis=1))
    )
    return Candidates(shapely.get_coordinates(points[narrows]), along[narrows])


def cheapest_chain(
    candidates: Candidates, own: IntArray, corridor: SafeCorridor, drawing: Drawing
) -> Candidates:
    """Return the chain of candidates, from the path's start to its end, whose legs cost least.

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
    """Return indices of pairs of candidates whose leg may lie in the corridor: most do not."""
    begin, end = np.triu_indices(len(candidates), 1)
    # A candidate beside the path gets the distance along the path of the path's nearest point.
    onwards = candidates.along[end] > candidates.along[begin]
    begin, end = begin[onwards], end[onwards]
    for share in (0.5, 0.25, 0.75):
        point = candidates.xy[begin] + share * (candidates.xy[end] - candidates.xy[begin])
        near = shapely.contains_xy(corridor.free, point)
        begin, end = begin[near], end[near]
    return begin, end


def _clearance_cost(clearance: FloatArray | float, corridor: SafeCorridor) -> FloatArray:
    """Return the cost of legs (k,) for a clearance, metres of the plane, below the wanted one."""
    share = np.maximum(clearance / corridor.wanted_clearance, _MIN_CLEARANCE_SHARE)
    return np.asarray(_CLEARANCE_WEIGHT * (1 / share - 1))


def _shortest_path(cost: FloatArray, first: int, last: int) -> tuple[IntArray, FloatArray]:
    """Return the cheapest path from `first` to `last`, by edges (n, n) to ever higher nodes.

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
    """Return indices of the legs, of those not yet measured, on the cheapest chains."""
    begin, end = np.nonzero(unknown)
    batch = min(len(begin), max(_MIN_BATCH, int(_BATCH_SHARE * len(begin))))
    chosen = np.argpartition(through[begin, end], batch - 1)[:batch]
    return begin[chosen], end[chosen]


def _on_same_side(
    candidates: Candidates,
    begin: IntArray,
    end: IntArray,
    lines: Geometries,
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
        # Add the angle from the path to the candidate, between -π and π.
        swept = swept + wrapped(_direction(candidates.xy, hole) - swept)
        half = wrapped(_direction(middles, hole) - swept[begin])
        leg = half + wrapped(swept[end] - _direction(middles, hole))
        same &= np.abs(swept[end] - swept[begin] - leg) < np.pi
    return same


def _direction(points: FloatArray, origin: FloatArray) -> FloatArray:
    """Return angles (n,) of points (n, 2) as seen from the origin, rad."""
    angle: FloatArray = np.arctan2(points[:, 1] - origin[1], points[:, 0] - origin[0])
    return angle


def thin(corridor: SafeCorridor, drawing: Drawing) -> Candidates:
    """Choose the fewest waypoints, start and goal included, whose legs stay in the corridor.

    Legs on which the path leaves V at its start or enters it at its goal stay as planned.
    """
    first, last = corridor.first, corridor.last
    path = Candidates(corridor.path, metres_along(corridor.path))
    before = _split_legs(path[: first + 1], corridor.off_land, drawing)
    middle = _split_legs(path[first : last + 1], corridor.free, drawing)
    after = _split_legs(path[last:], corridor.off_land, drawing)
    if len(middle.xy) > 2:
        middle = cheapest_chain(*with_candidates(middle, corridor), corridor, drawing)
    # Each part ends where the next one begins.
    return concatenated(before[:-1], middle, after[1:])


def _split_legs(path: Candidates, region: shapely.Geometry, drawing: Drawing) -> Candidates:
    """Add points to legs whose drawn curves leave the region, until they stay inside."""
    if len(path.xy) < 2:
        return path
    lonlat = drawing.lonlat(path.xy)
    fits = shapely.covers(region, drawing.lines(lonlat[:-1], lonlat[1:]))
    shares = [
        np.zeros(1) if fits[leg] else _split_shares(path.xy[leg : leg + 2], region, drawing)
        for leg in range(len(fits))
    ]
    leg = np.repeat(np.arange(len(fits)), [len(share) for share in shares])
    share = np.concatenate([*shares, np.empty(0)])
    return Candidates(
        np.vstack([_interpolated(path.xy, leg, share[:, None]), path.xy[-1:]]),
        np.append(_interpolated(path.along, leg, share), path.along[-1]),
    )


def _interpolated(values: FloatArray, leg: IntArray, share: FloatArray) -> FloatArray:
    """Return values (n, ...) at shares of legs."""
    value: FloatArray = values[leg] + share * (values[leg + 1] - values[leg])
    return value


def _split_shares(leg: FloatArray, region: shapely.Geometry, drawing: Drawing) -> FloatArray:
    """Return shares at which the fewest equal parts of a leg (2, 2) begin that stay in the region.

    Only 0 if no such parts are found.
    """
    parts = 2
    while parts <= _MAX_PARTS:
        points = drawing.lonlat(leg[0] + np.linspace(0, 1, parts + 1)[:, None] * (leg[1] - leg[0]))
        if shapely.covers(region, drawing.lines(points[:-1], points[1:])).all():
            return np.arange(parts) / parts
        parts *= 2
    return np.zeros(1)
