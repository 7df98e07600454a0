"""Candidate waypoints: the path's own points, corners of its bends, and points further off V."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from pipeline._types import FloatArray, IntArray
from pipeline.formats.passage.safe_corridor import SafeCorridor, cross

# Minimum bend, rad, for which the intersection of the legs around it becomes a candidate.
_MIN_BEND_RAD = 0.1
# Clearance of offset candidates, in wanted clearances: more than wanted, since legs cut corners.
_OFFSET_CLEARANCE = 1.4
# Half width, in wanted clearances, of the stretch of path in which only one narrows is looked for.
_NARROWS_WINDOW = 10


@dataclass(frozen=True)
class Candidates:
    """Candidate waypoints in order: `xy` (n, 2) planar, `along` (n,) metres of path to each."""

    xy: FloatArray
    along: FloatArray

    def __getitem__(self, chosen: IntArray | slice) -> Candidates:
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
    """Add corners and points further off V to a path's points, whose new indices are returned."""
    return _with_offsets(*_with_corners(path, corridor), corridor)


def _with_corners(path: Candidates, corridor: SafeCorridor) -> tuple[Candidates, IntArray]:
    """Add the points where the legs before a bend and those after it would intersect.

    So a rounded corner becomes one waypoint, on the outer side, with the turn's radius. Also
    returns the indices of the path's own points among the candidates.
    """
    legs = np.diff(path.xy, axis=0)
    course = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    before, after = np.triu_indices(len(legs), 1)
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
    """Points of the path between two distances along it where it is closest to V or land."""
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
