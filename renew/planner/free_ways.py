"""Find ways along which all hard-over turns are free, in water that padding shuts.

Padding leads the search well wherever the water is wide beside a turning circle. In tight water it
may shut every way, though a vessel that passes a gap obliquely, or with the current in its favour,
can turn away all the time. There, the water is covered with nodes closer than a turning circle, and
a leg is dropped if a turn that is begun on it touches land. The best paths over the legs that are
left are refined by a dynamic programme, over rows of points beside them, under the same condition
and one more: the vessel can round each corner.
"""

import math

import numpy as np
import shapely

from renew._types import BoolArray, FloatArray
from renew.classes.k_best_paths import nodes_of_rounded_path, time_from
from renew.classes.roadmap import GOAL, START, Resolution, Roadmap
from renew.planner.problem import Problem
from renew.planner.turn_test import LazyLegs, TurnTest

# Sizes of a cell, in v/ω: a finer roadmap is taken where the coarse one leads to no way.
CELLS = 0.8, 0.5
# Margins around land while ways are looked for, in v/ω. A way is verified with one between both:
# the wide one leads to ways that can be verified, the narrow one to others that may be better, and
# it alone is taken with the finer roadmap.
MARGINS = 0.07, 0.02
# To how many cells along either axis legs lead.
_REACH = 4
# Largest number of cells: a chart with sides of about a hundred v/ω.
_MAX_CELLS = 20_000
# Ratios to the best time that is still possible up to which turns are flown, in the field and in
# its deviations; further if there is no path among those legs whose corners can be rounded.
_AHEAD = ((1.02, 1.01), (1.05, 1.04), (1.2, 1.15))


def has_fine_roadmap(problem: Problem, cell: float) -> bool:
    """Whether a problem's water can be covered with cells of a size (v/ω)."""
    voyage = problem.voyage
    is_small = _cells(problem, cell) <= _MAX_CELLS
    return is_small and voyage.current.is_steady and not len(voyage.via)


def _cells(problem: Problem, cell: float) -> float:
    """Return the number of cells of a size (v/ω) that cover a problem's chart."""
    xmin, ymin, xmax, ymax = problem.voyage.chart.bounds
    side = cell * problem.voyage.vessel.turning_radius
    return float((xmax - xmin) * (ymax - ymin) / side**2)


def fine_roadmap(problem: Problem, cell: float) -> Roadmap:
    """Return a roadmap over a problem's water with cells of a size (v/ω)."""
    scout = problem.scout(problem.options.min_width)
    return scout.roadmap(Resolution(round(_cells(problem, cell)), _REACH))


class FreeWays:
    """A fine roadmap of a problem's water, from which legs without free turns are dropped.

    Turns are free by a margin (v/ω); they are known to be so on the legs `are_free` (2, m), such as
    those of a wider margin. Of each leg (m,), it knows the node at its begin, and the leg that
    leads back.
    """

    def __init__(
        self, problem: Problem, graph: Roadmap, margin: float, are_free: BoolArray | None = None
    ) -> None:
        self._problem, self._graph = problem, graph
        self._enumerator = problem.enumerator(problem.options.min_width)
        nodes = len(graph.points)
        self._tail = np.repeat(np.arange(nodes), np.diff(graph.first))
        number, back = self._tail * nodes + graph.head, graph.head * nodes + self._tail
        order = np.argsort(number)
        self._back = order[np.searchsorted(number, back, sorter=order)]
        legs = graph.points[self._tail], graph.points[graph.head]
        test = TurnTest(problem, graph.mesh, margin)
        self._legs = LazyLegs(test, legs, graph.time.copy(), are_free, closely=False)
        self.are_free = self._legs.are_free

    def paths(self, count: int, most: float) -> list[FloatArray]:
        """Return up to `count` paths (n, 2) over free legs, each for a fuel below `most`.

        The first one's corners can be rounded, if there is such a path; each other is the best of
        its class.
        """
        graph, turn_rate = self._graph, self._problem.voyage.vessel.turn_rate
        latest, found = most / self._problem.voyage.vessel.fuel_rate, list[FloatArray]()
        for ahead in _AHEAD:
            to_go = self._fly(ahead, latest)
            time = self._legs.flown_time
            nodes = nodes_of_rounded_path(graph, time, to_go, turn_rate)
            if len(nodes):
                found.append(np.vstack([graph.points[START], graph.points[nodes]]))
                break
        # Legs that were not flown are taken as shut.
        masked = graph._replace(time=time, back=time[self._back])
        others = self._enumerator.channels_on(masked, count - len(found))
        return [*found, *(one.found_by.points for one in others if one.found_by is not None)]

    def _fly(self, ahead: tuple[float, float], latest: float) -> FloatArray:
        """Fly turns on the legs of good paths, and return the least time (n,), s, to the goal."""
        graph = self._graph
        while True:
            time = self._legs.time
            to_go = time_from(graph, GOAL, time[self._back])
            whole = time_from(graph, START, time)[self._tail] + time + to_go[graph.head]
            best = float(to_go[START])
            if not best < latest or not self._legs.drop_shut(whole, best, ahead, latest):
                return np.asarray(to_go)

    def refined(self, path: FloatArray, margin: float) -> FloatArray | None:
        """Return a least-fuel path (n, 2) near a path of free legs, or None if there is none.

        Turns are free by a margin (v/ω), and corners can be rounded.
        """
        test = TurnTest(self._problem, self._graph.mesh, margin)
        vessel, found = self._problem.voyage.vessel, None
        for width in _WIDTHS:
            rows = _rows_beside(path, _APART * vessel.turning_radius, width * vessel.turning_radius)
            closer = _best_chain(rows, test, vessel.turn_rate)
            if closer is not None:
                path = found = closer
        return found


# Half-widths (v/ω) of the passes in which a path is refined.
_WIDTHS = (1.5, 0.6, 0.2)
# Distance between rows of points, in v/ω, and the number of points in each.
_APART = 1.2
_BESIDE = 9
# Share of half a leg within which the arc that rounds a corner ends.
_ROUNDED = 0.85
# Ratios to the best time that is still possible up to which turns are flown on rows of points.
_BARELY_AHEAD = 1.002, 1.0003


def _rows_beside(path: FloatArray, apart: float, width: float) -> FloatArray:
    """Return rows (n, p, 2) of points beside a path, up to a width (m); its ends stay."""
    line = shapely.LineString(path)
    count = max(2, math.ceil(line.length / apart)) + 1
    places = shapely.line_interpolate_point(line, np.linspace(0, 1, count), normalized=True)
    points = shapely.get_coordinates(places)
    ahead = np.gradient(points, axis=0)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1), 1e-300)[:, None]
    aside = np.tile(np.linspace(-width, width, _BESIDE), (count, 1))
    aside[[0, -1]] = 0.0
    normal = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    return np.asarray(points[:, None] + aside[..., None] * normal[:, None])


def _best_chain(rows: FloatArray, test: TurnTest, turn_rate: float) -> FloatArray | None:
    """Return the quickest path (n, 2) with a point of each row (n, p, 2), or None if there is none.

    Turns on all of its legs are free, and all of its corners can be rounded.
    """
    begin, end = np.broadcast_arrays(rows[:-1, :, None], rows[1:, None])
    time = test.times(begin, end)
    bends = _bends(begin, end, time, turn_rate)
    ends = begin.reshape(-1, 2), end.reshape(-1, 2)
    legs = LazyLegs(test, ends, time.ravel(), closely=True)
    while True:
        time = legs.time.reshape(time.shape)
        so_far = _least_times(time, bends)
        to_go = _least_times(time[::-1].swapaxes(1, 2), bends[::-1].swapaxes(1, 3))
        is_open = np.isfinite(time)
        both = so_far + to_go[::-1].swapaxes(1, 2)
        whole = np.where(is_open, both, np.inf) - np.where(is_open, time, 0.0)
        if not np.isfinite(whole.min()):
            return None
        if not legs.drop_shut(whole.ravel(), float(whole.min()), _BARELY_AHEAD):
            break
    before, last = np.unravel_index(so_far[-1].argmin(), so_far[-1].shape)
    chain = [int(last), int(before)]
    for at in range(len(time) - 2, -1, -1):
        can_bend = bends[at, :, chain[-1], chain[-2]]
        chain.append(int(np.where(can_bend, so_far[at, :, chain[-1]], np.inf).argmin()))
    return np.asarray(rows[np.arange(len(rows)), chain[::-1]])


def _bends(begin: FloatArray, end: FloatArray, time: FloatArray, turn_rate: float) -> BoolArray:
    """Whether a vessel can round the corner between two legs (n, p, p, 2): (n - 1, p, p, p).

    The arc has the radius at which it turns at its speed over ground, on the quicker of both legs.
    """
    length = np.linalg.norm(end - begin, axis=-1)
    along = (end - begin) / np.maximum(length, 1e-300)[..., None]
    radius = length / time / turn_rate
    one, other = along[:-1, :, :, None], along[1:, None]
    cos = (one * other).sum(-1)
    sin = np.abs(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])
    shorter = np.minimum(length[:-1, :, :, None], length[1:, None])
    wider = np.maximum(radius[:-1, :, :, None], radius[1:, None])
    # The arc takes the radius times the tangent of half the angle of both legs.
    return np.asarray(wider * sin <= _ROUNDED * (1 + cos) * shorter / 2)


def _least_times(time: FloatArray, bends: BoolArray) -> FloatArray:
    """Return the least time (n, p, p), s, of a chain up to and with each leg."""
    least = np.empty_like(time)
    least[0] = time[0]
    for at in range(1, len(time)):
        before = np.where(bends[at - 1], least[at - 1][:, :, None], np.inf).min(axis=0)
        least[at] = before + time[at]
    return least
