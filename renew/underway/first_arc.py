"""The first arc of a vessel under way: from the heading that it has onto its way.

It turns by its turn rate, to either side, in the current as it is, until it can hold a straight
course to a point of the way ahead. (Without a current: a Dubins path of an arc and a line.)
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely

from renew._types import FloatArray
from renew.kernels.capsules import wrapped
from renew.turns.contingency import crab_heading, fly_turns
from renew.voyage.voyage import Voyage, shares

# Number of headings tried in a full turn, and the arc's turn rate as a share of the vessel's, which
# leaves room for rounding the last step.
_STEPS, _RATE = 180, 0.99
# Least distance ahead, in v/ω, at which an arc may join the way, and further ones that are tried.
_NEAREST, _JOINED_AT = 2.0, (3.0, 6.0, 12.0, 24.0)
# The current is not perturbed.
_AS_IT_IS = np.zeros((1, 1, 2))


class Arc(NamedTuple):
    """An arc: rows (m, 4) of t (s), x, y (m) and heading (rad); and the way (n, 2) from its end.

    `arrival` is when the vessel would come to the end of the way, s, by the table of the current.
    """

    rows: FloatArray
    way: FloatArray
    arrival: float


def first_arcs(heading: float, path: FloatArray, voyage: Voyage) -> list[Arc]:
    """Return arcs from a voyage's start and heading (rad) onto a path (n, 2), the quickest first.

    No arc touches land or leaves the chart. Behind each arc a straight leg leads to a point ahead.
    """
    vessel = replace(voyage.vessel, turn_rate=_RATE * voyage.vessel.turn_rate)
    tracks = _tracks(heading, replace(voyage, vessel=vessel))
    times = voyage.departure + np.arange(_STEPS + 1) * vessel.turn_period / _STEPS
    ahead, length = shares(path), float(shapely.LineString(path).length)
    radius = voyage.vessel.turning_radius / length
    found = list[Arc]()
    joints = {min(multiple * radius, 1.0) for multiple in _JOINED_AT}
    for along in sorted({*joints, min(max(ahead[1], _NEAREST * radius), 1.0)}):
        joint = np.array([np.interp(along, ahead, axis) for axis in path.T])
        rest = path[ahead > along + 1e-9]
        for side, track in zip((1.0, -1.0), tracks, strict=True):
            rows = _until_towards(joint, track, times, heading, side, voyage)
            if rows is None or not _is_clear(rows[:, 1:3], voyage):
                continue
            way = np.vstack([rows[-1, 1:3], joint, rest])
            onwards = replace(voyage, start=way[0]).leaving(float(rows[-1, 0]))
            found.append(Arc(rows, way, onwards.departure + onwards.duration(way)))
    return sorted(found, key=lambda one: one.arrival)


def _tracks(heading: float, voyage: Voyage) -> FloatArray:
    """Return the tracks (2, steps + 1, 2) of full turns to port and to starboard from the start."""
    vessel, begin = voyage.vessel, np.array([voyage.departure])
    start, field = voyage.start[None], voyage.waters.quick_current
    # In a current slower than the vessel, each course over ground has one heading.
    through = vessel.speed * np.array([[np.cos(heading), np.sin(heading)]])
    course = np.arctan2(*(through + field.velocity(start, begin)).T[::-1])
    return np.asarray(fly_turns(start, course, field, vessel, _AS_IT_IS, begin, _STEPS)[0])


def _until_towards(
    joint: FloatArray,
    track: FloatArray,
    times: FloatArray,
    heading: float,
    side: float,
    voyage: Voyage,
) -> FloatArray | None:
    """Return the rows (m, 4) of a turn up to where the vessel heads for a point; None if nowhere.

    The turn has a track (n, 2) and times (n,); its `side` is 1 to port, and -1 to starboard.
    """
    course = np.arctan2(*(joint - track).T[::-1])
    speeds = np.full(len(track), voyage.vessel.speed)
    headings = heading + side * np.linspace(0.0, 2 * np.pi, len(track))
    wanted = crab_heading(track, course, voyage.current, speeds, times)
    lacking = wrapped(side * (wanted - headings))
    # The difference changes sign where the vessel heads for the point; its jump at half a turn does
    # not count.
    crosses = (lacking[:-1] > 0) & (lacking[1:] <= 0) & (lacking[:-1] - lacking[1:] < np.pi)
    if not crosses.any():
        return None
    last = int(crosses.argmax())
    share = lacking[last] / (lacking[last] - lacking[last + 1])
    end = track[last] + share * (track[last + 1] - track[last])
    # A step of nearly no length is joined to the one before.
    kept = np.arange(last + 1 if share > 0.1 or last == 0 else last)
    return np.vstack(
        [
            np.column_stack([times[kept], track[kept], headings[kept]]),
            [
                times[last] + share * (times[last + 1] - times[last]),
                *end,
                headings[last] + share * (headings[last + 1] - headings[last]),
            ],
        ]
    )


def _is_clear(track: FloatArray, voyage: Voyage) -> bool:
    """Whether a track (n, 2) stays in the chart and off land."""
    line, chart = shapely.LineString(track), voyage.chart
    return bool(chart.extent.covers(line)) and not shapely.intersects(line, chart.hard_no_go)
