"""Water that routes keep off, because a vessel without thrust would be on land too soon.

Only a route's centreline keeps off it: a vessel that is turned off its course for a while is soon
back. Around its two ends no route can keep off it, so the water is open there, as far from the end
as it takes to get out of it, and a little farther.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import shapely

from renew._types import FloatArray
from renew.errors import Duration, InfeasibleError, Length, Text, UnreachableError
from renew.voyage.drift import Drift
from renew.voyage.voyage import Voyage

# Ratio to the distance at which the limit can just be kept up to which water around an end is open:
# else the only way out of it would lead through one point.
_ROOM = 1.25
# Number of places on a path at which the time is looked up for a message.
_PLACES = 200
# Number of halvings in which a lower limit is found, and the step (s) in which it is suggested.
_HALVINGS = 6
_STEP = 300.0
# Multiple of a chart's precision by which a path may seem to lie inside: triangles are snapped.
_SNAPPED = 8.0


@dataclass(frozen=True, eq=False)
class AdriftWater:
    """Water `closed` (m) to the routes of a voyage for a `limit` (s), and `opened` at its ends.

    Where the limit can't be kept `longest` m from an end, or at a via point, `cramped` is that
    place (2,), and the distance there.
    """

    voyage: Voyage
    drift: Drift
    limit: float
    longest: float
    closed: shapely.MultiPolygon
    opened: shapely.Geometry
    cramped: tuple[FloatArray, float] | None = None

    @classmethod
    def of(cls, voyage: Voyage, limit: float, longest: float) -> "AdriftWater":
        """Return the water of a voyage; around its ends it is open for at most `longest` m."""
        chart = voyage.chart
        drift = Drift.of(chart, voyage.table, chart.no_go, limit)
        swept = shapely.intersection(
            chart.water, drift.water_within(limit), grid_size=chart.precision
        )
        low, opened = _areas(swept), list[shapely.Geometry]()
        water = cls(voyage, drift, limit, longest, low, shapely.MultiPolygon())
        kept = chart.less(chart.water, low)
        for stop in voyage.stops:
            if shapely.dwithin(low, shapely.Point(stop), _SNAPPED * chart.precision):
                far = 0.0 if (voyage.via == stop).all(axis=1).any() else longest
                around = water._around(stop, kept) if far else None
                if around is None:
                    return replace(water, cramped=(stop, far))
                opened.append(around)
        around = shapely.union_all(opened)
        return replace(water, closed=_areas(chart.less(low, around)), opened=around)

    def check(self, path: FloatArray) -> None:
        """Raise InfeasibleError, with place and time, if a path (n, 2) enters closed water."""
        line, off = shapely.LineString(path), _SNAPPED * self.voyage.chart.precision
        if shapely.length(shapely.intersection(line, self.closed)) > off:
            raise self.reason(path)

    def reason(self, path: FloatArray) -> InfeasibleError:
        """Return the error for a path (n, 2) that leads through the water, with place and time."""
        line, points = shapely.LineString(path), path
        if line.length > 0:
            points = shapely.get_coordinates(shapely.segmentize(line, line.length / _PLACES))
        inside = points[shapely.intersects_xy(self.closed, points)]
        points = inside if len(inside) else points
        seconds, _ = self.drift.follow(points, np.zeros(len(points)), (self.limit, math.inf))
        least = int(seconds.argmin())
        return InfeasibleError(
            "without thrust from {0} the vessel is on land in {1}, and adrift = {2}",
            points[least],
            Duration(float(min(seconds[least], self.limit))),
            Duration(self.limit),
        )

    def no_way(self, path: FloatArray) -> UnreachableError:
        """Return the error if it shuts all ways, of which a path (n, 2) is one, or at a place."""
        low, high, voyage = 0.0, self.limit, self.voyage
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            other = AdriftWater.of(voyage, middle, self.longest)
            low, high = (middle, high) if other.leaves_a_way() else (low, middle)
        lower = _STEP * math.floor(low / _STEP)
        where, remedy = Text("on any way from {0} to {1}", (voyage.start, voyage.goal)), ""
        if self.cramped:
            where = Text("within {1} of {0}", (self.cramped[0], Length(self.cramped[1])))
            remedy = "raise adrift_ends, "
        return UnreachableError(
            f"adrift = {{0}} can't be kept {{1}}: {{2}}. {{3}}{remedy}or move a stop",
            Duration(self.limit),
            where,
            self.reason(path).text,
            Text("Lower adrift to {0}, " if lower else "Leave adrift out, ", (Duration(lower),)),
        )

    def leaves_a_way(self) -> bool:
        """Whether water that is not closed joins the ends of the voyage."""
        chart = self.voyage.chart
        parts = shapely.get_parts(chart.less(chart.water, self.closed))
        ends = shapely.points(self.voyage.stops)[:, None]
        joined = shapely.dwithin(parts, ends, _SNAPPED * chart.precision).all(axis=0)
        return self.cramped is None and bool(joined.any())

    def _around(self, end: FloatArray, kept: shapely.Geometry) -> shapely.Geometry | None:
        """Return the water to open around an end, from where `kept` water is reached; or None."""
        here, chart = shapely.Point(end), self.voyage.chart
        far = shapely.distance(here, kept) if not kept.is_empty else math.inf
        while far < self.longest:
            far = min(_ROOM * far, self.longest)
            parts = shapely.get_parts(shapely.intersection(chart.water, here.buffer(far)))
            around = parts[shapely.distance(parts, here).argmin()]
            if shapely.intersection(around, kept).area > 0:
                return shapely.intersection(around, self.closed, grid_size=chart.precision)
        return None


def _areas(geometry: shapely.Geometry) -> shapely.MultiPolygon:
    """Return the polygons of a geometry; where areas only touch, the grid leaves lines."""
    parts = shapely.get_parts(geometry)
    return shapely.multipolygons(parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON])
