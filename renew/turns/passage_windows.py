"""Windows of time: when a vessel may be at a place on its path, be it early, on time or late.

The padding of a place holds throughout the window of the place. During the window the vessel may
also meet a shut area, either on its path or in a turn that it begins at the place. A full turn is
taken to carry the vessel as far as :class:`renew.turns.turn_reach.TurnReach` says, for as long as
the turn lasts. The vessel can get no farther, so a path that is found free of the area is safe.
"""

import numpy as np
import shapely

from renew._types import FloatArray
from renew.inputs.chart import ShutArea
from renew.turns.turn_reach import TurnReach
from renew.voyage.voyage import Voyage

# Largest number of points at which the time of passage is taken.
_MAX_PASSAGE_POINTS = 2000
# Distance between the points at which a path is looked at, as a share of v/ω, and their largest
# number.
_SPACING, _MAX_POINTS = 0.5, 20_000


def passage_windows(
    voyage: Voyage, path: FloatArray, enter: FloatArray, leave: FloatArray
) -> FloatArray:
    """Windows (n, 2), s, of the stretches of a path (m, 2) from `enter` to `leave` (n, 2).

    A window opens when an early vessel comes to the first place of the stretch. A late vessel may
    begin a turn at the last place; the window closes when this turn is over. In a steady current
    the times do not matter, and all windows are 0.
    """
    if voyage.current.is_steady or not len(enter):
        return np.zeros((len(enter), 2))
    line = shapely.LineString(path)
    line = shapely.segmentize(line, max(voyage.clock.step, line.length / _MAX_PASSAGE_POINTS))
    points = shapely.get_coordinates(line)
    passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    places = shapely.points(np.stack([enter, leave], axis=1))
    times = np.interp(shapely.line_locate_point(line, places), passed, voyage.reading_times(points))
    begin, end = times.min(axis=1), times.max(axis=1)
    (early, _), (_, late) = voyage.early_and_late(begin), voyage.early_and_late(end)
    return np.stack([early, late + voyage.vessel.turn_period], axis=1)


def meeting(
    line: FloatArray,
    times: FloatArray,
    area: ShutArea,
    voyage: Voyage,
    reach: TurnReach | float,
) -> tuple[FloatArray, float, float] | None:
    """Place (2,) where a vessel may be in a shut area, from when and until when (s); or None.

    The vessel passes the points of a line (n, 2) at times (n,), s; a turn carries it `reach` m.
    """
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    spacing = max(_SPACING * voyage.vessel.turning_radius, length / _MAX_POINTS)
    points, passed = _densified(line, times, spacing)
    early, late = voyage.early_and_late(passed)[0], voyage.early_and_late(passed)[1]
    far = reach(points) if isinstance(reach, TurnReach) else np.full(len(points), reach)
    is_near = shapely.distance(shapely.points(points), area.polygon) <= far + spacing
    # The vessel may also be in the area between two points. So each point's time reaches from the
    # point before it to the point behind it.
    begin = np.append(early[:1], early[:-1])
    end = np.append(late[1:], late[-1:]) + voyage.vessel.turn_period
    met = np.flatnonzero(is_near & (begin < area.end) & (end > area.begin))
    if not len(met):
        return None
    return points[met[0]], float(begin[met].min()), float(end[met].max())


def _densified(
    line: FloatArray, times: FloatArray, spacing: float
) -> tuple[FloatArray, FloatArray]:
    """Points (m, 2) on a line, at most `spacing` (m) apart, with their times (m,), s."""
    lengths = np.linalg.norm(np.diff(line, axis=0), axis=1)
    pieces = np.maximum(1, np.ceil(lengths / spacing)).astype(int)
    leg = np.repeat(np.arange(len(lengths)), pieces)
    share = (np.arange(len(leg)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[leg]
    points = line[leg] + share[:, None] * (line[leg + 1] - line[leg])
    passed = times[leg] + share * (times[leg + 1] - times[leg])
    return np.vstack([points, line[-1:]]), np.append(passed, times[-1:])
