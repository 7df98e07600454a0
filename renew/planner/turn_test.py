"""Tell on which straight legs all hard-over turns are free, for a search that tries many legs.

The verification (:mod:`renew.turns.verification`) measures how near each turn comes to each edge.
Here turns are only seen to leave the water of a raster, as the search needs thousands. So a path
that is found must still be verified.
"""

import math

import numpy as np

from renew._compiled import for_kernels
from renew._types import BoolArray, FloatArray
from renew.classes.legs import Mesh
from renew.classes.roadmap import grid_triangles
from renew.inputs.current import TabulatedCurrent
from renew.kernels.turn_tracks import TurnsBegun, WaterRaster, drop_shore, turns_stay_on
from renew.planner.problem import Problem
from renew.turns.contingency import crab_heading, perturbations
from renew.turns.verification import AROUND, STEPS
from renew.voyage.fuel import ground_speed

# Spacing of the raster, in v/ω.
_RASTER = 0.08
# Width of the rim along the end of the chart where no path is looked for, in v/ω.
_RIM = 0.3
# Distance between the places of a leg from which turns are flown, in v/ω.
_SPACING = 0.6
# Places on a leg, and their weights, at which it is timed: Gauss's rule of three points.
_PLACES = (0.1127, 0.5, 0.8873)
_WEIGHTS = (5 / 18, 8 / 18, 5 / 18)


class TurnTest:
    """Tests legs in a problem's steady current, with a `margin` (v/ω) around land."""

    def __init__(self, problem: Problem, mesh: Mesh, margin: float) -> None:
        from scipy.ndimage import distance_transform_cdt

        self._voyage = problem.voyage
        self._field = TabulatedCurrent(problem.voyage.table)
        radius, options = problem.voyage.vessel.turning_radius, problem.options
        xmin, ymin, xmax, ymax = problem.voyage.chart.bounds
        spacing = _RASTER * radius
        x, y = np.arange(xmin, xmax, spacing), np.arange(ymin, ymax, spacing)
        wanted = np.ones((len(y), len(x)), dtype=bool)
        is_water = grid_triangles(x, y, mesh._replace(clearance=0.0), wanted) >= 0
        water = WaterRaster(is_water.astype(np.int64), float(x[0]), float(y[0]), spacing)
        edges = problem.triangulation.constrained_edges
        start, end = for_kernels(edges[:, 0]), for_kernels(edges[:, 1])
        drop_shore(water, start, end, margin * radius)
        off_land = distance_transform_cdt(water.off_land, metric="chessboard").astype(np.int64)
        # Without any land, all are -1.
        off_land[off_land < 0] = max(off_land.shape)
        self._water = water._replace(off_land=off_land)
        self._sailed = water
        if options.narrow_share == 1.0:
            drop_shore(self._sailed, start, end, options.clearance)
        # A path along the end of the chart has no room to round its corners.
        ends = np.stack([problem.voyage.start, problem.voyage.goal])
        inside = min((ends - [xmin, ymin]).min(), ([xmax, ymax] - ends).min())
        rim = int(min(inside, _RIM * radius) / spacing)
        is_rim = wanted
        is_rim[rim : len(y) - rim, rim : len(x) - rim] = False
        self._sailed.off_land[is_rim] = 0

    def times(self, begin: FloatArray, end: FloatArray) -> FloatArray:
        """Return the time (...) along legs (..., 2), s; inf where they leave the water."""
        voyage, time = self._voyage, np.zeros(begin.shape[:-1])
        length = np.linalg.norm(end - begin, axis=-1)
        along = (end - begin) / np.maximum(length, 1e-300)[..., None]
        length = length * voyage.chart.true_metres((begin + end) / 2)
        for place, weight in zip(_PLACES, _WEIGHTS, strict=True):
            points = begin + place * (end - begin)
            velocity = self._field.velocity(points, np.float64(0.0))
            speed = ground_speed(velocity, along, voyage.vessel.speed, voyage.drift)
            is_open = self._is_sailed(points) & (speed > 0)
            time += weight * np.where(is_open, length / np.where(is_open, speed, 1.0), np.inf)
        return time

    def are_free(
        self, begin: FloatArray, end: FloatArray, deviations: FloatArray, *, closely: bool
    ) -> BoolArray:
        """Whether turns from places on each leg (n, 2) stay on water, in currents that deviate.

        Either the places divide a leg closely, its ends included, or each is the middle of a piece.
        """
        vessel, along = self._voyage.vessel, end - begin
        length = np.linalg.norm(along, axis=1)
        pieces = np.ceil(length / (_SPACING * vessel.turning_radius)).clip(min=1).astype(np.int64)
        count = pieces + closely
        row = np.repeat(np.arange(len(begin)), count)
        step = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
        share = (step if closely else step + 0.5) / pieces[row]
        points = begin[row] + share[:, None] * along[row]
        course = np.arctan2(along[:, 1], along[:, 0])[row]
        times, speeds = np.zeros(len(row)), np.full(len(row), vessel.speed)
        begun = TurnsBegun(points, course, times, speeds)
        heading = crab_heading(points, course, self._field, speeds, times)
        changes = perturbations(points, self._field, vessel, deviations, times)
        turn_rate, table = vessel.turn_rate, self._field.nodes
        steps = STEPS if closely else STEPS // 2
        stay = turns_stay_on(self._water, begun, heading, changes, table, turn_rate, steps)
        is_free = np.ones(len(begin), dtype=bool)
        is_free[row[~stay]] = False
        return is_free

    def _is_sailed(self, points: FloatArray) -> BoolArray:
        """Whether points (..., 2) lie on water of the chart, as far off land as is asked."""
        off_land, west, south, spacing = self._sailed
        column, row = np.moveaxis(np.rint((points - [west, south]) / spacing).astype(int), -1, 0)
        rows, columns = off_land.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        is_open = off_land[row.clip(0, rows - 1), column.clip(0, columns - 1)] > 0
        return np.asarray(inside & is_open)


class LazyLegs:
    """Legs from `begin` to `end` (m, 2), on which turns are flown only where a search needs it.

    `time` (m,) in s becomes inf where turns are not free. Turns are first flown in the field, on
    legs that may be part of a path up to `ahead[0]` times as long as the best that is left; then in
    its deviations, up to `ahead[1]` (lazy shortest paths; Dellin and Srinivasa, 2016). Both are
    known to be free on the legs `are_free` (2, m), which grow.
    """

    def __init__(
        self,
        test: TurnTest,
        legs: tuple[FloatArray, FloatArray],
        time: FloatArray,
        are_free: BoolArray | None = None,
        *,
        closely: bool,
    ) -> None:
        self.time = time
        self.are_free = np.zeros((2, len(time)), dtype=bool) if are_free is None else are_free
        self._test, self._closely = test, closely
        self._begin, self._end = legs
        self._is_flown = np.zeros((2, len(time)), dtype=bool)

    @property
    def flown_time(self) -> FloatArray:
        """Time (m,), s; inf for legs on which not all turns have been flown."""
        return np.where(self._is_flown.all(axis=0), self.time, np.inf)

    def drop_shut(
        self, whole: FloatArray, best: float, ahead: tuple[float, float], latest: float = math.inf
    ) -> bool:
        """Fly turns on some legs, and drop those that are not free; whether any were flown.

        `whole` (m,) is the time, s, of the best path with each leg, and `best` the least of these.
        No leg is flown for a path that takes longer than the `latest`.
        """
        deviations = AROUND[:, :1], AROUND[:, 1:]
        levels = zip(ahead, deviations, self._is_flown, self.are_free, strict=True)
        for ratio, level, is_flown, are_free in levels:
            chosen = ~is_flown & (whole <= min(ratio * best, latest))
            if chosen.any():
                is_flown[chosen] = True
                legs = np.flatnonzero(chosen & ~are_free)
                begin, end = self._begin[legs], self._end[legs]
                are_free[legs] = self._test.are_free(begin, end, level, closely=self._closely)
                self.time[chosen & ~are_free] = np.inf
                return True
        return False
