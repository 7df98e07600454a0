"""The way that a vessel under way still has before it, and the channel of triangles along it."""

import itertools
from typing import NamedTuple

import numpy as np
import shapely

from renew._types import FloatArray
from renew.classes.dual_graph import Channel, RoughPath, visits
from renew.planner.problem import Problem
from renew.voyage.voyage import Voyage, shares

# A vessel no farther off its path than this share of v/ω counts as on it.
_ON_PATH = 0.001
ON_TIME = 1e-6
"""Rounding of times, s."""
# A vessel off its path may come back to it at these distances ahead of the place abeam, in
# multiples of its distance from the path.
_BACK_AT = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)


class Abeam(NamedTuple):
    """The place on a path nearest to the vessel: a `point` (2,), m.

    `along` is its share of the path's length, `off` the vessel's distance from it, m; the vessel
    was due there at `due`, s.
    """

    point: FloatArray
    along: float
    off: float
    due: float

    def is_on_path(self, voyage: Voyage) -> bool:
        """Whether the vessel is on its path."""
        return self.off <= _ON_PATH * voyage.vessel.turning_radius

    def is_proven(self, voyage: Voyage, time: float, begun: float) -> bool:
        """Whether the plan's turns were simulated for a vessel that is here at a time (s).

        That is so on the path, if the vessel is no earlier or later than the plan allows for a
        voyage that began at `begun` (s).
        """
        late = max(voyage.lateness * (self.due - begun), voyage.min_lateness, ON_TIME)
        in_time = voyage.current.is_steady or abs(time - self.due) <= late
        return self.is_on_path(voyage) and in_time


def abeam(path: FloatArray, times: FloatArray, at: FloatArray) -> Abeam:
    """Return the place nearest to a point (2,) on a path (n, 2) passed at times (n,), s."""
    line = shapely.LineString(path)
    along = float(line.project(shapely.Point(at), normalized=True))
    off = float(line.distance(shapely.Point(at)))
    point = shapely.get_coordinates(line.interpolate(along, normalized=True))[0]
    return Abeam(point, along, off, float(np.interp(along, shares(path), times)))


def way_ahead(path: FloatArray, place: Abeam, voyage: Voyage) -> FloatArray | None:
    """Return the quickest way (n, 2) from a voyage's start back to a path (n, 2) and on along it.

    None where the vessel is off its path, and no straight leg over water leads back to it.
    """
    start, reached = voyage.start, shares(path)
    if place.is_on_path(voyage):
        return np.vstack([start, path[reached > place.along + 1e-9]])
    line = shapely.LineString(path)
    best, least = None, np.inf
    for multiple in _BACK_AT:
        along = min(place.along + multiple * place.off / line.length, 1.0)
        back = shapely.get_coordinates(line.interpolate(along, normalized=True))
        way = np.vstack([start, back, path[reached > along + 1e-9]])
        if shapely.intersects(shapely.LineString(way[:2]), voyage.chart.hard_no_go):
            continue
        duration = voyage.duration(way)
        if best is None or duration < least:
            best, least = way, duration
    return best


def track_ahead(trajectory: FloatArray, at: FloatArray, time: float) -> FloatArray:
    """Return the rest of a trajectory (m, 4) from a point (2,) on it passed at a time (s)."""
    reached = shares(trajectory[:, 1:3])
    along = shapely.LineString(trajectory[:, 1:3]).project(shapely.Point(at), normalized=True)
    due, _, _, heading = (np.interp(along, reached, column) for column in trajectory.T)
    rest = trajectory[reached > along + 1e-9] + [time - due, 0.0, 0.0, 0.0]
    return np.vstack([[time, *at, heading], rest])


def channel_along(path: FloatArray, problem: Problem) -> Channel | None:
    """Return the channel of the class of a path (n, 2); None if the path leaves the water."""
    pieces = problem.voyage.cut(path)
    parts = [part for piece in pieces if (part := _along(piece, problem)) is not None]
    if len(parts) < len(pieces):
        return None
    return Channel.joined(parts, problem.voyage.via) if len(pieces) > 1 else parts[0]


def _along(path: FloatArray, problem: Problem) -> Channel | None:
    """Return the channel of a path between two stops, a row of triangles without repeats."""
    mesh = problem.triangulation
    crossed = visits(path, mesh.corners).triangle
    row = list[int]()
    for triangle in crossed.tolist():
        # The triangles between two visits of the same triangle are left out.
        row = row[: row.index(triangle)] if triangle in row else row
        row.append(triangle)
    if not row or any(b not in mesh.neighbours[a] for a, b in itertools.pairwise(row)):
        return None
    word = problem.rays.word(path)
    channel = Channel.of(mesh, np.array(row), word)
    # A loop that was left out may have led round an island.
    if problem.rays.word(channel.midline(path[0], path[-1])) != word:
        return None
    return Channel(channel.triangles, channel.left, channel.right, word, RoughPath(path, crossed))
