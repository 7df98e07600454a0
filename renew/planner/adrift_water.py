"""Water that routes keep off, because a vessel without thrust would be on land too soon.

Only a route's centreline keeps off it: a vessel that is turned off its course for a while is soon
back. Around its two ends no route can keep off it, so the water is open there, as far from the end
as it takes to get out of it, and a little farther.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from renew._types import FloatArray
from renew.errors import Duration, InfeasibleError, Length, Text, UnreachableError
from renew.voyage.drift import Drift
from renew.voyage.voyage import Voyage

# Ratio to the distance at which the limit can just be kept up to which water around an end is open:
# else the only way out of it would lead through one point.
_ROOM = 1.25
# Number of places on a path, and along either side of the water around an end, at which the time is
# looked up for a message.
_PLACES = 200
_LATTICE = 40
# Step (s) in which a lower limit is suggested, and the share of the longest time that it is at
# most: the water of a limit is a little wider than it need be.
_STEP = 300.0
_SURELY = 0.97
# Number of halvings in which it is looked for.
_HALVINGS = 6
# Share of a chart's precision by which a path may seem to lie inside: triangles are snapped to it.
_SNAPPED = 8.0


@dataclass(frozen=True, eq=False)
class AdriftWater:
    """Water `closed` (m) to routes for a `limit` (s), and that left open around their ends."""

    drift: Drift
    limit: float
    closed: shapely.Geometry
    opened: shapely.Geometry
    longest: float

    @classmethod
    def of(cls, voyage: Voyage, limit: float, longest: float) -> "AdriftWater":
        """Return the water of a voyage; around its ends it is open for at most `longest` m.

        Raises UnreachableError if the limit can't be kept that near an end, or at a via point.
        """
        chart = voyage.chart
        drift = Drift.of(chart, voyage.table, chart.no_go, limit)
        swept = drift.water_within(limit)
        low = _areas(shapely.intersection(chart.water, swept, grid_size=chart.precision))
        kept = chart.less(chart.water, low)
        every = cls(drift, limit, low, shapely.MultiPolygon(), longest)
        for point in voyage.via:
            if shapely.intersects(low, shapely.Point(point)):
                raise UnreachableError(
                    "at a via point {0}; move it, or lower adrift", every.reason(point[None]).text
                )
        ends = (("start", voyage.start), ("goal", voyage.goal))
        opened = shapely.union_all([every._open_around(*end, kept) for end in ends])
        return cls(drift, limit, _areas(chart.less(low, opened)), opened, longest)

    def check(self, path: FloatArray) -> None:
        """Raise InfeasibleError if a path (n, 2) enters closed water, or leaves an end too late."""
        line, off = shapely.LineString(path), _SNAPPED * self.drift.chart.precision
        if self.closed.is_empty and self.opened.is_empty:
            return
        if shapely.intersects(self.closed, line):
            inside = shapely.intersection(line, self.closed)
            if inside.length > off:
                raise self.reason(path)
        ends = [part.length for part in shapely.get_parts(shapely.intersection(line, self.opened))]
        if max(ends, default=0.0) > self.longest:
            raise InfeasibleError(
                "from an end it takes {0} to where it can keep adrift = {1}; adrift_ends = {2}",
                Length(max(ends)),
                Duration(self.limit),
                Length(self.longest),
            )

    def reason(self, path: FloatArray) -> InfeasibleError:
        """Return the error for a path (n, 2) that leads through the water, with place and hours."""
        points = path
        if len(path) > 1:
            line = shapely.LineString(path)
            points = shapely.get_coordinates(shapely.segmentize(line, line.length / _PLACES))
        inside = points[shapely.intersects_xy(self.closed, points)]
        place, seconds = self._extreme(inside if len(inside) else points, np.argmin)
        return InfeasibleError(
            "without thrust from {0} the vessel is on land in {1}, and adrift = {2}",
            place,
            Duration(seconds),
            Duration(self.limit),
        )

    def _extreme(
        self, points: FloatArray, which: Callable[[FloatArray], np.intp]
    ) -> tuple[FloatArray, float]:
        """Return the place (2,) of points (n, 2) with the least or longest time, and that, s."""
        seconds, _ = self.drift.follow(points, np.zeros(len(points)), (self.limit, math.inf))
        at = int(which(seconds))
        return points[at], float(min(seconds[at], self.limit))

    def _open_around(self, name: str, end: FloatArray, kept: shapely.Geometry) -> shapely.Geometry:
        """Return the water around an end that is open; the limit is `kept` where it is not low."""
        here, chart = shapely.Point(end), self.drift.chart
        if not shapely.dwithin(self.closed, here, _SNAPPED * chart.precision):
            return shapely.MultiPolygon()
        far = _ROOM * shapely.distance(here, kept) if not kept.is_empty else math.inf
        while True:
            far = min(far, self.longest)
            parts = shapely.get_parts(shapely.intersection(chart.water, here.buffer(far)))
            around = parts[shapely.distance(parts, here).argmin()]
            if shapely.intersection(around, kept).area > 0:
                low = shapely.intersection(around, self.closed, grid_size=chart.precision)
                return _areas(low)
            if far >= self.longest:
                raise self._refusal(name, end, around)
            far *= _ROOM

    def _refusal(self, name: str, end: FloatArray, around: shapely.Geometry) -> UnreachableError:
        """Return the error if the limit can't be kept anywhere in the water around an end."""
        xmin, ymin, xmax, ymax = around.bounds
        lattice = np.meshgrid(np.linspace(xmin, xmax, _LATTICE), np.linspace(ymin, ymax, _LATTICE))
        points = np.stack(lattice, axis=-1).reshape(-1, 2)
        inside = points[shapely.contains_xy(around, points)]
        place, seconds = self._extreme(np.vstack([end, inside]), np.argmax)
        lower = _rounded(seconds)
        return UnreachableError(
            f"adrift = {{0}} can't be kept within {{1}} of the {name} {{2}}: there a vessel "
            f"without thrust is on land in {{3}} at the latest, from {{4}}. {{5}}aise adrift_ends, "
            f"or move the {name}",
            Duration(self.limit),
            Length(self.longest),
            end,
            Duration(seconds),
            place,
            Text("Lower adrift to {0}, r", (Duration(lower),)) if lower else Text("R"),
        )

    def no_way(self, path: FloatArray) -> UnreachableError:
        """Return the error if it shuts all ways; the shortest of them is a path (n, 2)."""
        low, high, chart = 0.0, self.limit, self.drift.chart
        ends = shapely.points(path[[0, -1]])
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            shut = shapely.difference(self.drift.water_within(middle), self.opened)
            parts = shapely.get_parts(chart.less(chart.water, shut))
            joins = shapely.dwithin(parts, ends[:, None], _SNAPPED * chart.precision).all(axis=0)
            low, high = (middle, high) if joins.any() else (low, middle)
        lower = _rounded(low)
        return UnreachableError(
            "all ways from {0} to {1} lead where a vessel adrift is on land too soon: on the "
            "shortest, {2}. {3}ove one of the two",
            *path[[0, -1]],
            self.reason(path).text,
            Text("Lower adrift to {0}, which leaves water for a way, or m", (Duration(lower),))
            if lower
            else Text("M"),
        )


def _areas(geometry: shapely.Geometry) -> shapely.MultiPolygon:
    """Return the polygons of a geometry; where areas only touch, the grid leaves lines."""
    parts = shapely.get_parts(geometry)
    return shapely.multipolygons(parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON])


def _rounded(seconds: float) -> float:
    """Return a limit (s) in round figures that a longest time leaves room for; 0 without one."""
    return _STEP * math.floor(_SURELY * seconds / _STEP)
