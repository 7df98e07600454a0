"""Fewest waypoints: a shortest path over the pairs of places on a route that see each other.

Two places see each other where the leg between them, drawn as it will be sailed, stays in the
route's lane and passes what lies in the lane on the same side as the path.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.formats.exchange.safe_corridor import cross
from pipeline.formats.exchange.tracks import tracks
from pipeline.formats.shared.legs import metres_along

if TYPE_CHECKING:
    import numpy.typing as npt
    from shapely.geometry.base import BaseGeometry

    from pipeline.formats.exchange.safe_corridor import Lane
    from pipeline.formats.exchange.tracks import Curve
    from pipeline.geo.projection import Projection

    FloatArray = npt.NDArray[np.float64]
    IntArray = npt.NDArray[np.int64]
    BoolArray = npt.NDArray[np.bool_]

# A millimetre: what is written is what was examined.
DECIMALS = 8
# Bends sharper than this (rad) are worth a place where the legs before and after them meet.
_SHARP = 0.1
# A leg of the path whose chord is the lane's trouble is cut into so many parts at the most.
_MOST_PARTS = 64
# Of two chains of equally many legs the shorter one is taken. A leg with half the useful room
# counts for one more, with a third for two; less than the least share is no room at all.
_WEIGHT_OF_LENGTH = 0.5
_WEIGHT_OF_ROOM = 1.0
_LEAST_SHARE = 0.05
# Places are moved to where they have so much more room than is useful, for legs cut corners.
_ASIDE = 1.4
# Narrows that are nearer to each other than so many useful rooms are one.
_NARROWS_APART = 10


@dataclass(frozen=True)
class Places:
    """Places along a path, in order: `xy` (n, 2) planar, `along` (n,) metres of path to each."""

    xy: FloatArray
    along: FloatArray

    def __getitem__(self, chosen: IntArray | slice) -> Places:
        """Some of the places."""
        return Places(self.xy[chosen], self.along[chosen])


@dataclass(frozen=True)
class Drawing:
    """How legs are drawn."""

    projection: Projection
    curve: Curve
    error_m: float

    def lonlat(self, xy: FloatArray) -> FloatArray:
        """Degrees (n, 2) of planar points, as they will be written."""
        return np.round(self.projection.to_lonlat(xy), DECIMALS)

    def lines(self, begin: FloatArray, end: FloatArray) -> npt.NDArray[np.object_]:
        """Legs from degrees (k, 2) to degrees (k, 2), as lines of the plane."""
        return tracks(begin, end, self.curve, self.projection, self.error_m).lines


def thin(lane: Lane, drawing: Drawing) -> Places:
    """Choose the fewest places whose legs stay in the lane, start and goal among them.

    Legs with which the path leaves or enters V at its ends are kept as planned.
    """
    first, last = lane.first, lane.last
    path = Places(lane.path, metres_along(lane.path))
    before = _cut(path[: first + 1], lane.lawful, drawing)
    middle = _cut(path[first : last + 1], lane.free, drawing)
    after = _cut(path[last:], lane.lawful, drawing)
    if len(middle.xy) > 2:
        middle = _fewest(*_with_aside(*_with_corners(middle, lane), lane), lane, drawing)
    # Each ends where the next one begins.
    return _joined(before[:-1], middle, after[1:])


def _joined(*parts: Places) -> Places:
    """Places one after the other."""
    return Places(
        np.concatenate([part.xy for part in parts]), np.concatenate([part.along for part in parts])
    )


def _cut(path: Places, region: BaseGeometry, drawing: Drawing) -> Places:
    """Add places to legs whose chords leave the region, until they don't."""
    if len(path.xy) < 2:
        return path
    lonlat = drawing.lonlat(path.xy)
    fits = shapely.covers(region, drawing.lines(lonlat[:-1], lonlat[1:]))
    shares = [
        np.zeros(1) if fits[leg] else _shares(path.xy[leg : leg + 2], region, drawing)
        for leg in range(len(fits))
    ]
    leg = np.repeat(np.arange(len(fits)), [len(share) for share in shares])
    share = np.concatenate([*shares, np.empty(0)])
    return Places(
        np.vstack([_between(path.xy, leg, share[:, None]), path.xy[-1:]]),
        np.append(_between(path.along, leg, share), path.along[-1]),
    )


def _between(values: FloatArray, leg: IntArray, share: FloatArray) -> FloatArray:
    """Values (n, ...) at shares of legs."""
    value: FloatArray = values[leg] + share * (values[leg + 1] - values[leg])
    return value


def _shares(leg: FloatArray, region: BaseGeometry, drawing: Drawing) -> FloatArray:
    """Into which shares to cut a leg (2, 2); a leg that itself leaves the region stays whole."""
    parts = 2
    while parts <= _MOST_PARTS:
        points = drawing.lonlat(leg[0] + np.linspace(0, 1, parts + 1)[:, None] * (leg[1] - leg[0]))
        if shapely.covers(region, drawing.lines(points[:-1], points[1:])).all():
            return np.arange(parts) / parts
        parts *= 2
    return np.zeros(1)


def _with_corners(path: Places, lane: Lane) -> tuple[Places, IntArray]:
    """Add the points where the legs before a bend and those after it would meet.

    A rounded corner becomes one waypoint, on the outer side, with the turn's radius at it. Also
    returns the indices of the path's own places among them all.
    """
    legs = np.diff(path.xy, axis=0)
    course = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    before, after = np.triu_indices(len(legs), 1)
    turn = course[after] - course[before]
    bend = (np.abs(turn) > _SHARP) & (np.abs(turn) < np.pi / 2)
    before, after = before[bend], after[bend]
    gap = path.xy[after] - path.xy[before + 1]
    turned = cross(legs[before], legs[after])
    ahead, back = cross(gap, legs[after]) / turned, cross(gap, legs[before]) / turned
    corner = path.xy[before + 1] + ahead[:, None] * legs[before]
    # No leg is drawn out to more than twice its length: the short ones are parts of an arc.
    chosen = (ahead > 0) & (ahead <= 1) & (back < 0) & (back >= -1)
    chosen[chosen] = shapely.contains_xy(lane.free, corner[chosen])
    corner, before, after = corner[chosen], before[chosen], after[chosen]
    nearest = path.along[0] + shapely.line_locate_point(
        shapely.LineString(path.xy), shapely.points(corner)
    )
    reached = np.clip(nearest, path.along[before + 1], path.along[after])
    places = Places(np.vstack([path.xy, corner]), np.concatenate([path.along, reached]))
    order = np.argsort(places.along, kind="stable")
    places = places[order]
    return places, np.flatnonzero(order < len(path.xy))


def _with_aside(places: Places, own: IntArray, lane: Lane) -> tuple[Places, IntArray]:
    """Add places beside those that are near V or land, and beside the path where it is nearest.

    They have more room: between two shores, as much as there is.
    """
    if lane.blocked.is_empty:
        return places, own
    cramped = _joined(places, _narrows(lane, *places.along[[0, -1]]))
    points = shapely.points(cramped.xy)
    nearest = shapely.get_coordinates(shapely.shortest_line(lane.blocked, points))[::2]
    off = cramped.xy - nearest
    apart = np.linalg.norm(off, axis=1)
    chosen = np.flatnonzero((apart > 0) & (apart < lane.useful))
    cramped, off, apart = cramped[chosen], off[chosen], apart[chosen]
    steps = _ASIDE * lane.useful / apart[:, None] - 1
    tried = cramped.xy + np.array([1.0, 0.5, 0.25])[:, None, None] * steps * off
    room = np.where(
        shapely.contains_xy(lane.free, tried[..., 0], tried[..., 1]),
        shapely.distance(lane.blocked, shapely.points(tried)),
        0.0,
    )
    better = room.max(axis=0) > apart
    moved = tried[room.argmax(axis=0), np.arange(len(apart))][better]
    beside = Places(np.vstack([places.xy, moved]), np.append(places.along, cramped.along[better]))
    order = np.argsort(beside.along, kind="stable")
    return beside[order], np.flatnonzero(np.isin(order, own))


def _narrows(lane: Lane, begin: float, end: float) -> Places:
    """Places of the path, from so many metres to so many, where it comes nearest to V or land."""
    done = np.linspace(begin, end, max(2, int((end - begin) / lane.useful)))
    points = shapely.line_interpolate_point(shapely.LineString(lane.path), done)
    room = lane.room(points)
    beside = np.lib.stride_tricks.sliding_window_view(
        np.pad(room, _NARROWS_APART, constant_values=np.inf), 2 * _NARROWS_APART + 1
    )
    least = np.flatnonzero((room < lane.useful) & (room == beside.min(axis=1)))
    return Places(shapely.get_coordinates(points[least]), done[least])


def _fewest(places: Places, own: IntArray, lane: Lane, drawing: Drawing) -> Places:
    """Go from the path's first place to its last by the fewest legs, of these by the shortest.

    Legs that want room count for more. Those between its own places stand as they are planned.
    """
    room = _room(places, lane, drawing)
    sees = np.isfinite(room)
    sees[own[:-1], own[1:]] = True
    apart = np.linalg.norm(places.xy[:, None] - places.xy, axis=-1)
    step = 1 + _WEIGHT_OF_LENGTH * apart / (places.along[own[-1]] - places.along[own[0]])
    step += _WEIGHT_OF_ROOM * (1 / np.maximum(room / lane.useful, _LEAST_SHARE) - 1)
    cost, came = np.full(len(places.xy), np.inf), np.zeros(len(places.xy), dtype=np.int64)
    cost[own[0]] = 0.0
    for at in range(own[0] + 1, len(cost)):
        ways = np.where(sees[:at, at], cost[:at] + step[:at, at], np.inf)
        came[at] = np.argmin(ways)
        cost[at] = ways[came[at]]
    chain = [int(own[-1])]
    while chain[-1] != own[0]:
        chain.append(int(came[chain[-1]]))
    return places[np.array(chain[::-1])]


def _room(places: Places, lane: Lane, drawing: Drawing) -> FloatArray:
    """Room of the leg from place i to place j > i (n, n); -inf where they don't see each other."""
    begin, end = np.triu_indices(len(places.xy), 1)
    # Places beside the path count as reached where it is nearest.
    onwards = places.along[end] > places.along[begin]
    begin, end = begin[onwards], end[onwards]
    for share in (0.5, 0.25, 0.75):  # quick: most pairs are far apart
        point = places.xy[begin] + share * (places.xy[end] - places.xy[begin])
        near = shapely.contains_xy(lane.free, point)
        begin, end = begin[near], end[near]
    lonlat = drawing.lonlat(places.xy)
    lines = drawing.lines(lonlat[begin], lonlat[end])
    good = shapely.covers(lane.free, lines)
    if len(lane.holes):
        good &= _same_side(places, begin, end, lines, lane)
    room = np.full((len(places.xy), len(places.xy)), -np.inf)
    room[begin[good], end[good]] = lane.room(lines[good])
    return room


def _same_side(
    places: Places,
    begin: IntArray,
    end: IntArray,
    lines: npt.NDArray[np.object_],
    lane: Lane,
) -> BoolArray:
    """Whether legs pass every hole of the lane on the same side as the path (k,).

    Seen from the hole, the way along the path turns by as much as the leg does, or by a whole turn
    more or less.
    """
    same = np.ones(len(begin), dtype=bool)
    middles = shapely.get_coordinates(shapely.line_interpolate_point(lines, 0.5, normalized=True))
    reached = np.union1d(metres_along(lane.path), places.along)
    dense = shapely.get_coordinates(
        shapely.line_interpolate_point(shapely.LineString(lane.path), reached)
    )
    foot = np.searchsorted(reached, places.along)
    for hole in lane.holes:
        swept = np.unwrap(_bearing(dense, hole))[foot]
        # From the path to the place, the short way.
        swept = swept + _short(_bearing(places.xy, hole) - swept)
        half = _short(_bearing(middles, hole) - swept[begin])
        leg = half + _short(swept[end] - _bearing(middles, hole))
        same &= np.abs(swept[end] - swept[begin] - leg) < np.pi
    return same


def _bearing(points: FloatArray, origin: FloatArray) -> FloatArray:
    """Angles (n,) at which points (n, 2) are seen from the origin, in rad."""
    angle: FloatArray = np.arctan2(points[:, 1] - origin[1], points[:, 0] - origin[0])
    return angle


def _short(angle: FloatArray) -> FloatArray:
    """Angles (n,) brought to -π to π."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
