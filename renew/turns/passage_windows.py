"""Windows of time in which a vessel may be where it passes: the padding holds in all of each."""

import numpy as np
import shapely

from renew._types import FloatArray
from renew.voyage.voyage import Voyage

# Largest number of points at which the time of passage is taken.
_MAX_POINTS = 2000


def passage_windows(
    voyage: Voyage, path: FloatArray, enter: FloatArray, leave: FloatArray
) -> FloatArray:
    """Windows (n, 2), s, between two places (n, 2) each of a path (m, 2).

    From when the vessel, if early, comes to the first, to when a turn that it begins at the last,
    if late, is over. In a steady current any window will do.
    """
    if voyage.current.is_steady or not len(enter):
        return np.zeros((len(enter), 2))
    line = shapely.LineString(path)
    line = shapely.segmentize(line, max(voyage.clock.step, line.length / _MAX_POINTS))
    points = shapely.get_coordinates(line)
    passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    places = shapely.points(np.stack([enter, leave], axis=1))
    times = np.interp(shapely.line_locate_point(line, places), passed, voyage.reading_times(points))
    begin, end = times.min(axis=1), times.max(axis=1)
    (early, _), (_, late) = voyage.early_and_late(begin), voyage.early_and_late(end)
    return np.stack([early, late + voyage.vessel.turn_period], axis=1)
