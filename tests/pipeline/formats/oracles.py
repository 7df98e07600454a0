"""Legs drawn by other methods than those of the exchange formats."""

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.findings.result import RunResult
from pipeline.formats.passage.waypoints import Waypoints
from tests.true_scale import GEOD

_E = np.sqrt(GEOD.es)


def isometric(latitude: FloatArray) -> FloatArray:
    """Isometric latitude on WGS 84 of a latitude (degrees; Snyder 1987, eq. 3-7 by logarithms)."""
    sine = np.sin(np.radians(latitude))
    return np.asarray(np.arctanh(sine) - _E * np.arctanh(_E * sine))


def loxodrome(begin: FloatArray, end: FloatArray, count: int) -> FloatArray:
    """Points (count, 2) on the line of constant course: longitude is linear in isometric latitude.

    Along a parallel, every point has the isometric latitude of both ends.
    """
    low, high = float(isometric(begin[1])), float(isometric(end[1]))
    table = np.linspace(min(begin[1], end[1]), max(begin[1], end[1]), 20 * count)
    share = np.linspace(0, 1, count)
    latitude = np.interp(low + share * (high - low), isometric(table), table)
    return np.column_stack([begin[0] + share * (end[0] - begin[0]), latitude])


def geodesic(begin: FloatArray, end: FloatArray, count: int) -> FloatArray:
    """Points (count, 2) on the shortest line."""
    between = GEOD.npts(begin[0], begin[1], end[0], end[1], count - 2)
    points = np.vstack([begin, between, end])
    points[:, 0] = begin[0] + (points[:, 0] - begin[0] + 180) % 360 - 180
    return points


def drawn(points: Waypoints, step_m: float = 200.0) -> list[FloatArray]:
    """Every leg as lon/lat points about `step_m` apart."""
    curve = loxodrome if points.curve == "Loxodrome" else geodesic
    return [
        curve(begin, end, max(3, int(GEOD.inv(*begin, *end)[2] / step_m)))
        for begin, end in zip(points.lonlat[:-1], points.lonlat[1:], strict=True)
    ]


def in_plane(result: RunResult, line: FloatArray) -> shapely.LineString:
    """A lon/lat line in the planner's plane."""
    return shapely.LineString(result.water.projection.to_plane(line))


def beside(line: FloatArray, distance_m: FloatArray | float) -> FloatArray:
    """Points at a distance to port of a lon/lat line's points, to starboard if negative."""
    ahead = GEOD.inv(line[:-1, 0], line[:-1, 1], line[1:, 0], line[1:, 1])[0]
    azimuth = np.append(ahead, ahead[-1])
    longitude, latitude, _ = GEOD.fwd(
        line[:, 0], line[:, 1], azimuth - 90, np.broadcast_to(distance_m, len(line))
    )
    longitude = line[:, 0] + (longitude - line[:, 0] + 180) % 360 - 180
    return np.column_stack([longitude, latitude])


def quickest_s(points: Waypoints, result: RunResult) -> FloatArray:
    """Seconds of each leg for the vessel at its highest speed, heading into the cross-current.

    Summed over steps of 200 m on the ellipsoid. The clock of a current that changes runs along.
    """
    case = result.planned[points.ranked.season]
    speed, lines = case.vessel.speed, drawn(points)
    steps = [GEOD.inv(*line[:-1].T, *line[1:].T)[2] for line in lines]
    plane = [case.projection.to_plane(line) for line in lines]
    ahead = np.concatenate([np.diff(line, axis=0) for line in plane])
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    middles = np.concatenate([(line[:-1] + line[1:]) / 2 for line in plane])
    needed = np.concatenate(steps) / speed
    for _ in range(5):
        clock = np.cumsum(needed) - needed / 2
        velocity = case.current.velocity(middles, clock)
        along = (velocity * ahead).sum(axis=1)
        across = np.linalg.norm(velocity - along[:, None] * ahead, axis=1)
        needed = np.concatenate(steps) / (along + np.sqrt(speed**2 - across**2))
    ends = np.cumsum([len(step) for step in steps])[:-1]
    return np.array([part.sum() for part in np.split(needed, ends)])
