"""Traffic lanes that a line sails against; COLREGS rule 10 asks vessels to sail with them.

The planner does not know lanes: what it and others break is found afterwards, and said.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pyproj
import shapely

from pipeline._types import FloatArray
from pipeline.model import Place, Zone

_GEOD = pyproj.Geod(ellps="WGS84")
# Angle between course and lane, degrees, above which a vessel sails against it: one that crosses
# does so "as nearly as practicable at right angles".
_AGAINST_DEG = 120.0
# Longest step along a line, degrees, on which its course is taken as one: 10 km.
_STEP_DEG = 0.09
# Least true metres that count: less is a corner that is cut.
_LEAST_M = 50.0


class AgainstLane(NamedTuple):
    """A lane that is sailed against: its name, for how far, and the middle of the longest part."""

    name: str
    length_m: float
    place: Place


def against_lanes(line: FloatArray, zones: Sequence[Zone]) -> Iterator[AgainstLane]:
    """Yield the lanes among zones that a line (n, 2), lon/lat degrees, sails against."""
    dense = shapely.get_coordinates(shapely.segmentize(shapely.LineString(line), _STEP_DEG))
    course, _, _ = _GEOD.inv(*dense[:-1].T, *dense[1:].T)
    steps = shapely.linestrings(np.stack([dense[:-1], dense[1:]], axis=1))
    for zone in zones:
        if zone.course_deg is None:
            continue
        off_deg = np.abs((np.asarray(course) - zone.course_deg + 180) % 360 - 180)
        parts = shapely.get_parts(
            shapely.line_merge(
                shapely.union_all(shapely.intersection(steps[off_deg > _AGAINST_DEG], zone.area))
            )
        )
        lengths = [_GEOD.geometry_length(part) for part in parts]
        if sum(lengths) >= _LEAST_M:
            middle = parts[int(np.argmax(lengths))].interpolate(0.5, normalized=True)
            yield AgainstLane(zone.name, float(sum(lengths)), Place(middle.x, middle.y))
