"""Waypoints where the speed through water changes, so that a leg is sailed at about one speed.

They are put on the existing legs, so that the way stays the same.
"""

import itertools

import numpy as np
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.formats.passage.tracks import DECIMALS, Drawing, tracks
from renew.voyage.fuel import speeds_along

# Largest ratio of the highest to the lowest speed of a leg: to sail it at their mean instead
# changes fuel by a few thousandths, by the propeller law.
_SAME_SPEED = 1.1
# Number of places along a leg at which its speed is looked up, and the least number of them in its
# first and its last part.
_PLACES, _MIN_PART = 200, 10


def with_speed_changes(lonlat: FloatArray, route: renew.Route, drawing: Drawing) -> FloatArray:
    """Add points to waypoints (n, 2), degrees, where the speed of a route has changed by a tenth.

    Within each part of a leg, speeds then differ by a tenth at the most, or hardly more.
    """
    if route.speeds.max() <= _SAME_SPEED * route.speeds.min():
        return lonlat
    projection = drawing.projection
    found = [lonlat[:1]]
    for begin, end in itertools.pairwise(lonlat):
        drawn = tracks(begin[None], end[None], drawing.curve, projection, drawing.error_m)
        places = _places(drawn.xy)
        middles = (places[:-1] + places[1:]) / 2
        speeds = speeds_along(middles, np.asarray(route.path, dtype=float), route.speeds)
        shares = np.array(_changes(speeds)) / _PLACES
        found += [_at_shares(drawn.lonlat, drawn.xy, shares), end[None]]
    return np.concatenate(found)


def _places(line: FloatArray) -> FloatArray:
    """Points (_PLACES + 1, 2) evenly along a line."""
    shares = np.linspace(0.0, 1.0, _PLACES + 1)
    found = shapely.line_interpolate_point(shapely.LineString(line), shares, normalized=True)
    return np.asarray(shapely.get_coordinates(found))


def _changes(speeds: FloatArray) -> list[int]:
    """Indices of the speeds at which a new part of a leg begins."""
    changes = list[int]()
    least = most = speeds[0]
    for at, speed in enumerate(speeds):
        least, most = min(least, speed), max(most, speed)
        if most > _SAME_SPEED * least:
            changes.append(at)
            least = most = speed
    return [at for at in changes if _MIN_PART <= at <= len(speeds) - _MIN_PART]


def _at_shares(lonlat: FloatArray, xy: FloatArray, shares: FloatArray) -> FloatArray:
    """Positions (n, 2) at shares of a line's length in the plane, between its points."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1)))
    at = shares * along[-1]
    between = np.stack([np.interp(at, along, lonlat[:, axis]) for axis in (0, 1)], axis=-1)
    return np.round(between, DECIMALS)
