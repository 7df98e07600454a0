"""Find the way that arrives first past water that opens and shuts, without a wait.

A place is shut to a vessel that is there on time, if it is shut while she, early or late, or a turn
that she begins there, may be in it. Between two such spells the place is open, and of all arrivals
in an open spell only the first counts: a way that bides its time by a detour may be missed. So a
search has one label for each place and open spell, its first arrival there. This is safe interval
path planning (Phillips & Likhachev, 2011), on the roadmap on which classes are found.

The way is a guide alone: it says past which water to go, and at which hours. What is shut when the
way passes beside it is closed like land, and the voyage is planned there as any other.
"""

import heapq
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from renew._compiled import for_kernels, kernel, small_kernel
from renew._types import BoolArray, FloatArray, IntArray
from renew.classes.k_best_paths import time_to_go
from renew.classes.roadmap import GOAL, START, Resolution, Roadmap
from renew.errors import UnreachableError
from renew.inputs.chart_and_vessel import Chart
from renew.inputs.openings import Opening
from renew.kernels.viterbi import Stream, leg_time
from renew.planner.one_class import ClassPlanner
from renew.planner.problem import Problem
from renew.voyage.voyage import Voyage

# Number of cells of the roadmap, and to how many cells along either axis its legs lead: in many
# directions, as a way past a storm is followed as it is.
_RESOLUTION = Resolution(5_000, 4)
# Half the width of the tube of water close to a way, in cells of the roadmap.
_TUBE = 1.5
# Cells of the raster of hours to a cell of the roadmap, along either axis.
_PER_CELL = 4
# More seconds than any voyage lasts; a sum of it and a time is still exact to a second.
_EVER = 1e9
# Time (s) after departure in which the hours of a tide are looked for.
_HORIZON = 30 * 86_400.0
# Largest number of times that a leg begins later, until all of it is open.
_TRIES = 12


class TimedWay(NamedTuple):
    """A way: its points (n, 2), m, and when the vessel passes each (n,), s."""

    points: FloatArray
    times: FloatArray

    def tube(self, chart: Chart) -> shapely.Geometry:
        """Return the water close to the way, a few cells of the roadmap to either side."""
        xmin, ymin, xmax, ymax = chart.bounds
        cell = math.sqrt((xmax - xmin) * (ymax - ymin) / _RESOLUTION.cells)
        return shapely.buffer(shapely.LineString(self.points), _TUBE * cell)

    def passing(self, areas: Sequence[Opening], voyage: Voyage) -> frozenset[Opening]:
        """Return the areas that are shut when the way passes beside them, early or late."""
        if not areas or len(self.points) < len(("start", "goal")):
            return frozenset()
        line = shapely.LineString(self.points)
        along = np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))]
        )
        middles = shapely.centroid(np.array([area.polygon for area in areas], dtype=object))
        place = shapely.line_locate_point(line, middles)
        begin, end = voyage.early_and_late(np.interp(place, along, self.times))
        end = end + voyage.vessel.turn_period
        hours = zip(areas, begin.tolist(), end.tolist(), strict=True)
        return frozenset(area for area, *each in hours if area.is_shut_within(*each))


def clock_way(planner: ClassPlanner, areas: Sequence[Opening]) -> TimedWay | None:
    """Return the way that arrives first from the departure of the planner's problem, or None."""
    voyage, parts = planner.problem.voyage, list[TimedWay]()
    departure = voyage.departure
    for at in range(len(voyage.stops) - 1):
        part = planner.problem.with_voyage(voyage.part(at, departure))
        way = _part_way(part, planner, areas)
        if way is None:
            return None
        parts.append(way)
        departure = float(way.times[-1])
    return TimedWay(*(np.concatenate(of) for of in zip(*parts, strict=True)))


def _part_way(problem: Problem, planner: ClassPlanner, areas: Sequence[Opening]) -> TimedWay | None:
    """Return the way of a voyage without via points."""
    voyage = problem.voyage
    try:
        graph = problem.scout(problem.likely_width).roadmap(_RESOLUTION)
    except UnreachableError:
        return None
    hours = _shut_hours(problem, planner, areas, graph.points)
    water = Stream(voyage.table, voyage.polar, voyage.clock)
    labels, last = _first_arrivals(graph, hours, water, time_to_go(graph))
    if last < 0:
        return None
    chain = [last]
    while labels.came_from[chain[-1]] >= 0:
        chain.append(int(labels.came_from[chain[-1]]))
    order = np.array(chain[::-1])
    return TimedWay(graph.points[labels.node[order]], labels.arrival[order])


class _ShutHours(NamedTuple):
    """When the cells of a raster are shut to a vessel on time.

    `origin` (2,) is the middle of the first cell, and `step` (2,) the cells' size, m; there are
    `columns` in a row. The spells of cell c are first[c] to first[c + 1], from `begin` to `end`, s.
    """

    origin: FloatArray
    step: FloatArray
    columns: int
    first: IntArray
    begin: FloatArray
    end: FloatArray


def _shut_hours(
    problem: Problem, planner: ClassPlanner, areas: Sequence[Opening], nodes: FloatArray
) -> tuple[_ShutHours, _ShutHours]:
    """Return when nodes (n, 2), and cells of a raster over the chart, are shut to a vessel on time.

    The nodes are the cells of a row of their own.
    """
    voyage = problem.voyage
    low, high = np.reshape(voyage.chart.bounds, (2, 2))
    cell = math.sqrt(float(np.prod(high - low)) / _RESOLUTION.cells) / _PER_CELL
    columns, rows = np.maximum(1, np.ceil((high - low) / cell)).astype(int).tolist()
    step = (high - low) / (columns, rows)
    x, y = np.meshgrid(
        low[0] + step[0] * (np.arange(columns) + 0.5), low[1] + step[1] * (np.arange(rows) + 0.5)
    )
    places = np.vstack([nodes, np.column_stack([x.ravel(), y.ravel()])])
    far = np.full(len(places), planner.options.min_width)
    if planner.options.is_adaptive:
        far = planner.problem.reach(places)
    # A cell stands for all of its points.
    far[len(nodes) :] += float(np.hypot(*step)) / 2
    tree = shapely.STRtree([area.polygon for area in areas])
    place, which = tree.query(shapely.points(places), predicate="dwithin", distance=far)
    spells = [area.hours(voyage.departure, voyage.departure + _HORIZON) for area in areas]
    first_of = np.concatenate([[0], np.cumsum([len(own) for own in spells])])
    # Each place with each spell of each area that it is near.
    count = np.diff(first_of)[which]
    at = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    begin, end = np.vstack([np.empty((0, 2)), *spells])[np.repeat(first_of[which], count) + at].T
    begin, end = _on_time(voyage, begin - voyage.vessel.turn_period, end)
    first, begin, end = _joined(np.repeat(place, count), begin, end, len(places))
    by_node = _ShutHours(low, step, len(nodes), first[: len(nodes) + 1], begin, end)
    return by_node, _ShutHours(low + step / 2, step, columns, first[len(nodes) :], begin, end)


def _on_time(voyage: Voyage, begin: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return when a vessel on time would, late or early, be somewhere from `begin` to `end`, s.

    It is the inverse of `Voyage.early_and_late`.
    """
    begun, share, least = voyage.departure - voyage.before, voyage.lateness, voyage.min_lateness
    first = begun + np.minimum((begin - begun) / (1 + share), begin - begun - least)
    last = begun + np.maximum((end - begun) / (1 - share), end - begun + least)
    return first, last


def _joined(
    cell: IntArray, begin: FloatArray, end: FloatArray, cells: int
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the spells of each cell in their order, with overlapping ones joined."""
    begin, end = (np.clip(times, -_EVER, _EVER) for times in (begin, end))
    order = np.lexsort((begin, cell))
    cell, begin, end = cell[order], begin[order], end[order]
    # Cells are set apart on one axis of time, so that one pass joins the spells of all.
    apart = 4 * _EVER * cell
    longest = np.maximum.accumulate(end + apart) - apart
    is_first = np.append(True, (cell[1:] > cell[:-1]) | (begin[1:] > longest[:-1]))[: len(cell)]
    is_last = np.append(is_first[1:], True)[: len(cell)]
    first = np.searchsorted(cell[is_first], np.arange(cells + 1))
    return first, for_kernels(begin[is_first]), for_kernels(longest[is_last])


class _Labels(NamedTuple):
    """Labels (m,): the node of each, its first arrival and until when it is open, s.

    `came_from` is the label before.
    """

    node: IntArray
    arrival: FloatArray
    until: FloatArray
    came_from: IntArray


class _Ways(NamedTuple):
    """A search at work: its roadmap, the raster of hours, the current, and its labels (m,).

    Those of a node are first[node] to first[node + 1].
    """

    graph: Roadmap
    first: IntArray
    shut: _ShutHours
    water: Stream
    labels: _Labels
    since: FloatArray
    is_done: BoolArray


@small_kernel
def _cell_at(shut: _ShutHours, x: float, y: float) -> int:
    """Return the cell of a point of the chart."""
    column = math.floor((x - shut.origin[0]) / shut.step[0] + 0.5)
    row = math.floor((y - shut.origin[1]) / shut.step[1] + 0.5)
    rows = (len(shut.first) - 1) // shut.columns
    return int(min(max(row, 0), rows - 1) * shut.columns + min(max(column, 0), shut.columns - 1))


@small_kernel
def _open_from(shut: _ShutHours, x: float, y: float, time: float) -> float:
    """Return the first time (s) from a time on at which a point of the chart is open."""
    cell = _cell_at(shut, x, y)
    for k in range(shut.first[cell], shut.first[cell + 1]):
        if shut.begin[k] < time < shut.end[k]:
            return float(shut.end[k])
    return time


@kernel
def _new_labels(shut: _ShutHours, first: IntArray) -> tuple[_Labels, FloatArray]:
    """Return a label for each open spell of each node, and since when it is open.

    The spells of a node are first[node] to first[node + 1]; nothing is reached yet.
    """
    count = first[-1]
    labels = _Labels(
        np.zeros(count, dtype=np.int64),
        np.full(count, np.inf),
        np.full(count, np.inf),
        np.full(count, -1, dtype=np.int64),
    )
    since = np.full(count, -np.inf)
    for node in range(len(first) - 1):
        spell = shut.first[node]
        for k in range(first[node], first[node + 1]):
            labels.node[k] = node
            if k > first[node]:
                since[k] = shut.end[spell - 1]
            if k < first[node + 1] - 1:
                labels.until[k] = shut.begin[spell]
            spell += 1
    return labels, since


@kernel
def _first_arrivals(
    graph: Roadmap,
    hours: tuple[_ShutHours, _ShutHours],
    water: Stream,
    to_go: FloatArray,
) -> tuple[_Labels, int]:
    """Return the labels of a search, and the goal's label that is reached first; -1 for none."""
    nodes, departure = len(graph.points), water.clock.departure
    shut, between = hours
    # A node has an open spell more than spells in which it is shut.
    first = shut.first + np.arange(nodes + 1)
    labels, since = _new_labels(shut, first)
    queue = [(np.inf, -1)]
    for k in range(first[START], first[START + 1]):
        begin = max(departure, since[k])
        if labels.until[k] >= begin and begin <= departure:
            labels.arrival[k] = begin
            heapq.heappush(queue, (begin + to_go[START], k))
    is_done = np.zeros(len(since), dtype=np.bool_)
    while len(queue) > 1:
        _, k = heapq.heappop(queue)
        if is_done[k]:
            continue
        is_done[k] = True
        node = labels.node[k]
        if node == GOAL:
            return labels, k
        ways = _Ways(graph, first, between, water, labels, since, is_done)
        _go_on(ways, k, to_go, queue)
    return labels, -1


@kernel
def _go_on(ways: _Ways, k: int, to_go: FloatArray, queue: list[tuple[float, int]]) -> None:
    """Follow all legs from a label that can be begun at once."""
    graph, labels = ways.graph, ways.labels
    node, now = labels.node[k], labels.arrival[k]
    for leg in range(graph.first[node], graph.first[node + 1]):
        other = graph.head[leg]
        for q in range(ways.first[other], ways.first[other + 1]):
            if ways.is_done[q] or labels.until[q] < now:
                continue
            leave, arrival = _over(
                graph, (node, other), (now, ways.since[q]), ways.shut, ways.water
            )
            if leave > now:
                break
            if arrival <= labels.until[q] and arrival < labels.arrival[q]:
                labels.arrival[q], labels.came_from[q] = arrival, k
                heapq.heappush(queue, (arrival + to_go[other], q))


@kernel
def _over(
    graph: Roadmap,
    ends: tuple[int, int],
    times: tuple[float, float],
    shut: _ShutHours,
    water: Stream,
) -> tuple[float, float]:
    """Return when to leave for a leg, and when it ends, s; infinite where the current shuts it.

    Of the `times` it begins no earlier than the first, and ends no earlier than the second; the
    water between its nodes is open while it is passed.
    """
    leave, since = times
    (ax, ay), (bx, by) = graph.points[ends[0]], graph.points[ends[1]]
    pieces = math.ceil(max(abs(bx - ax) / shut.step[0], abs(by - ay) / shut.step[1]))
    arrival = leave
    # In a changing current the leg's time depends on when it begins.
    for _ in range(_TRIES):
        arrival = leave + leg_time(ax, ay, bx, by, leave, water)
        if arrival == math.inf:
            break
        later = since - arrival
        for piece in range(1, pieces):
            share = piece / pieces
            time = leave + share * (arrival - leave)
            x, y = ax + share * (bx - ax), ay + share * (by - ay)
            later = max(later, _open_from(shut, x, y, time) - time)
        if later <= 0.0:
            return leave, arrival
        leave += later
    return leave, math.inf
