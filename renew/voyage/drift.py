"""A vessel without thrust: when it meets land, and the water from which that is too soon."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from renew._compiled import for_kernels
from renew._types import BoolArray, FloatArray
from renew.inputs.chart_and_vessel import Chart, edges_of
from renew.kernels.current_table import CurrentTable, velocities
from renew.kernels.drift import Shore, drifted, shore_of

# Longest step, s, and the share of a cell of the current that a step crosses at most. With these,
# times are within a thousandth of those with a tenth of the step.
_LONGEST_STEP = 300.0
_STEP = 0.25
# Share of the time between two slices of a changing current that a step lasts at most.
_STEP_IN_TIME = 0.25
# Largest number of steps.
_MOST_STEPS = 5_000
# Number of cells along the longer side of the raster of the shore.
_CELLS = 400
# Least number of pieces of the current's table along the longer side of the chart: shores are cut
# into pieces of a quarter of them. The largest number is _CELLS.
_LEAST_CELLS = 40
# Number of times that a piece of shore is halved at most whose ends are carried far apart, and how
# far, in pieces.
_HALVINGS = 5
_APART = 2.0
# Number of pieces of the greatest drift, if the table is finer: with half of them, too, no
# place of drawn waters was missed.
_PIECES = 16
# Share of the greatest drift by which land and water are widened, and simplified within that: the
# tracks' errors are far below it.
_WIDER = 0.0025


@dataclass(frozen=True, eq=False)
class Drift:
    """The current of a chart, the land (polygons, m) that it carries vessels to, and a step (s)."""

    chart: Chart
    table: CurrentTable
    land: Sequence[Polygon]
    shore: Shore
    step: float

    @classmethod
    def of(
        cls, chart: Chart, table: CurrentTable, land: Iterable[Polygon], horizon: float
    ) -> "Drift":
        """Return the drift onto land for up to a horizon (s)."""
        polygons = list(land)
        table = table._replace(metres=chart.metres, metres_in=chart.metres_in)
        edges = edges_of(polygons)
        ends = for_kernels(edges[:, 0]), for_kernels(edges[:, 1])
        shore = shore_of(*ends, chart.bounds, _side(chart) / _CELLS)
        return cls(chart, table, polygons, shore, max(_step(table, chart), horizon / _MOST_STEPS))

    def follow(
        self, points: FloatArray, times: FloatArray, until: tuple[float, float]
    ) -> tuple[FloatArray, FloatArray]:
        """Return seconds (n,) until vessels at points (n, 2) from times (n,), s, meet land.

        It is inf where that takes longer than `until`: seconds, and the last time (s) at which the
        current is known. Also returns where they are then (n, 2).
        """
        seconds, ends = drifted(
            for_kernels(points), for_kernels(times), self.table, self.shore, self.step, until
        )
        ashore = self._on_land(points)
        seconds[ashore], ends[ashore] = 0.0, points[ashore]
        return seconds, ends

    def _on_land(self, points: FloatArray) -> BoolArray:
        """Whether points (n, 2) lie on any polygon; these may overlap."""
        found = np.zeros(len(points), dtype=bool)
        near = shapely.STRtree(self.land).query(shapely.points(points))[1]
        for k in np.unique(near).tolist():
            shapely.prepare(self.land[k])
            found |= shapely.intersects_xy(self.land[k], points)
        return found

    def water_within(self, limit: float) -> shapely.Geometry:
        """Return the water from which a steady current carries a vessel to land within a limit (s).

        It is all water that the shore sweeps over as it is carried backwards for that time: the
        way back from where a vessel meets land leads past every place from which it is met there.
        So no lattice can miss a tongue of it, and its edges are as sharp as the time jumps. It is
        wider by a hundredth of the greatest drift, at most.
        """
        reach = limit * self.table.strongest / float(self.chart.metres.min())
        cells = np.concatenate([np.diff(self.table.x), np.diff(self.table.y)])
        side = _side(self.chart)
        piece = float(np.clip(cells.min(), side / _CELLS, side / _LEAST_CELLS)) / 4
        piece = max(piece, reach / _PIECES)
        if not (len(self.land) and reach > 0):
            return shapely.MultiPolygon()
        wider = _WIDER * reach
        begin, end = self._onto_land(wider, piece).swapaxes(0, 1)
        pieces = max(4, math.ceil(reach / piece))
        # Between the simpler shore and the shore itself no water is left.
        along = end - begin
        aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
        aside *= 4 * wider / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
        corners = np.stack([begin, end, begin + aside, end + aside], axis=1)
        hulls = list[shapely.Geometry](shapely.convex_hull(shapely.multipoints(corners)))
        for left in reversed(range(_HALVINGS + 1)):
            one, other = (self._backwards(ends, limit, pieces) for ends in (begin, end))
            apart = np.linalg.norm(one - other, axis=2).max(axis=0) > _APART * piece
            done = np.ones_like(apart) if not left else ~apart
            corners = np.stack([one[:-1], other[:-1], one[1:], other[1:]], axis=2)[:, done]
            hulls += shapely.convex_hull(shapely.multipoints(corners.reshape(-1, 4, 2))).tolist()
            if done.all():
                break
            middle = (begin + end)[~done] / 2
            begin = np.concatenate([begin[~done], middle])
            end = np.concatenate([middle, end[~done]])
        flat = np.array(hulls, dtype=object)
        water = shapely.union_all(flat[shapely.area(flat) > 0])
        return shapely.simplify(shapely.buffer(water, wider, quad_segs=2), wider)

    def _onto_land(self, wider: float, piece: float) -> FloatArray:
        """Return pieces (n, 2, 2), m, of a simpler shore, up to twice `wider` m off land.

        Only pieces are wanted on which the current runs onto land.
        """
        land = shapely.buffer(np.array(self.land, dtype=object), wider, quad_segs=2)
        simple = shapely.orient_polygons(shapely.simplify(shapely.union_all(land), wider))
        edges = edges_of(shapely.get_parts(shapely.segmentize(simple, piece)).tolist())
        # Land is on the left of its outline.
        along = np.diff(edges, axis=1)
        places = edges[:, :1] + np.array([0.0, 0.5, 1.0])[:, None] * along
        velocity = self._velocity(places.reshape(-1, 2)).reshape(places.shape)
        left = along[..., 0] * velocity[..., 1] - along[..., 1] * velocity[..., 0]
        return np.asarray(edges[left.max(axis=1) > 0])

    def _velocity(self, points: FloatArray) -> FloatArray:
        """Return the steady current at points (n, 2), in metres of the plane per second."""
        velocity = velocities(self.table, for_kernels(points), np.zeros(len(points)))
        return np.asarray(velocity / self.chart.true_metres(points)[:, None])

    def _backwards(self, points: FloatArray, limit: float, pieces: int) -> FloatArray:
        """Return where points (n, 2) come from: (pieces + 1, n, 2), at even times up to a limit."""
        steps = math.ceil(limit / pieces / self.step)
        lasts, places = limit / pieces / steps, [points]
        for _ in range(pieces):
            place = places[-1]
            for _ in range(steps):
                half = place - lasts / 2 * self._velocity(place)
                place = place - lasts * self._velocity(half)
            places.append(place)
        return np.stack(places)


def _side(chart: Chart) -> float:
    """Return the longer side of a chart, m."""
    xmin, ymin, xmax, ymax = chart.bounds
    return max(xmax - xmin, ymax - ymin)


def _step(table: CurrentTable, chart: Chart) -> float:
    """Return the length of a step, s, in which a vessel adrift crosses little of the current."""
    cell = min(float(np.diff(table.x).min()), float(np.diff(table.y).min()))
    cell = min(cell, _side(chart) / _CELLS)
    step = min(_LONGEST_STEP, _STEP * cell / max(table.strongest, 1e-9))
    if not table.is_steady:
        step = min(step, _STEP_IN_TIME * float(np.diff(table.times).min()))
    return step
