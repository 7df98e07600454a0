"""Scenes with moving storms: waves on a grid and steps of time, and an oracle that may wait."""

import heapq
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import map_coordinates
from shapely import Polygon, box

import renew
from renew._types import BoolArray, FloatArray
from renew.inputs.openings import OverLimit
from renew.request import Request
from tests.clock_oracle import sailed
from tests.moving_waters import Drifting
from tests.oracles import grid_graph
from tests.strategies import SIZE

VESSEL = renew.Vessel(speed=3.0, turn_rate=math.radians(10), length=5.0)
LIMIT = 1.2
"""Greatest wave height, m."""
LATENESS = 0.05
_WIDE, _HIGH, _CELL, _STEP = 40_000.0, 30_000.0, 2_000.0, 1_800.0
# Sea without a storm, m; seconds of the voyage without one, about.
_CALM, _VOYAGE_S = 0.5, 12_500.0
# A hard-over turn reaches two radii and the drift in its time; without that room a way would slip
# between two cells that touch at a corner, m. The corners of a square lie in all cells it touches.
_ROOM = 2.0 * VESSEL.turning_radius
_DRIFT = "projected"
_SIDES = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])


@dataclass(frozen=True, eq=False)
class StormyScene:
    """Islands, a current, and waves (nt, ny, nx), m, at nodes x, y (m) and times (s)."""

    chart: renew.Chart
    current: renew.CurrentField
    start: FloatArray
    goal: FloatArray
    times: FloatArray
    x: FloatArray
    y: FloatArray
    waves: FloatArray
    departure: float = 0.0

    @cached_property
    def shut(self) -> BoolArray:
        """Whether a cell (nt - 1, ny - 1, nx - 1) is shut between two steps."""
        worst = self.waves
        for axis in range(3):
            ahead = [slice(None)] * 3
            behind = [slice(None)] * 3
            ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
            worst = np.maximum(worst[tuple(ahead)], worst[tuple(behind)])
        return np.asarray(worst > LIMIT)

    @cached_property
    def areas(self) -> list[OverLimit]:
        """The shut cells with their hours."""
        found = []
        for row, column in np.ndindex(*self.shut.shape[1:]):
            state = np.concatenate([[False], self.shut[:, row, column], [False]])
            turns = np.flatnonzero(state[1:] != state[:-1])
            cell = box(self.x[column], self.y[row], self.x[column + 1], self.y[row + 1])
            for first, last in zip(turns[::2].tolist(), turns[1::2].tolist(), strict=True):
                most = self.waves[first : last + 1, row : row + 2, column : column + 2].max()
                hours = float(self.times[first]), float(self.times[last])
                found.append(OverLimit(cell, *hours, "waves", float(most), "m"))
        return found

    def request(self, **changes: object) -> Request:
        """What is asked of a plan."""
        return Request.of(
            self.chart,
            self.current,
            VESSEL,
            (self.start, self.goal),
            departure=self.departure,
            avoid=self.areas,
            changes={"classes": 4, "lateness": LATENESS, **changes},
        )

    def height(self, points: FloatArray, times: FloatArray) -> FloatArray:
        """Waves (n,), m, at points (n, 2), m, and times (n,), s; linear between the nodes."""
        places = [
            (times - self.times[0]) / _STEP,
            (points[:, 1] - self.y[0]) / _CELL,
            (points[:, 0] - self.x[0]) / _CELL,
        ]
        return np.asarray(map_coordinates(self.waves, places, order=1, mode="nearest"))

    def is_open(self, points: FloatArray, times: FloatArray) -> BoolArray:
        """Whether points (n, 2) are open to a vessel at times (n,), also early and late."""
        since = times - self.departure
        early, late = times - LATENESS * since, times + LATENESS * since + VESSEL.turn_period
        first, last = (
            np.clip((at // _STEP).astype(int), 0, len(self.shut) - 1) for at in (early, late)
        )
        total = np.pad(self.shut.cumsum(axis=0), ((1, 0), (0, 0), (0, 0)))
        is_open = np.ones(len(points), dtype=bool)
        for side in _SIDES:
            columns, rows = (
                np.clip((at // _CELL).astype(int), 0, len(axis) - 2)
                for at, axis in zip((points + _ROOM * side).T, (self.x, self.y), strict=True)
            )
            is_open &= total[last + 1, rows, columns] == total[first, rows, columns]
        return is_open

    def oracle(self, *, spacing: float = 500.0, radius: int = 7, waits: bool = True) -> float:
        """Earliest arrival (s) over a grid's edges, with waits at its nodes; inf without a way.

        A node has a label for each spell in which it is open, and waits there for an edge to open.
        At the start, as in a harbour, the vessel waits in any weather.
        """
        points, graph = grid_graph(
            self.chart, self.current, VESSEL, self.start, self.goal, spacing, radius=radius
        )
        graph = graph.tocsr()
        first, last = len(points) - 2, len(points) - 1
        begin, end = self._open_spells(points)
        labels = np.full(begin.shape, math.inf)
        queue = [
            (max(self.departure, since), first, number)
            for number, since in enumerate(begin[first].tolist())
            if math.isfinite(since) and (waits or since <= self.departure <= end[first, number])
        ]
        heapq.heapify(queue)
        done = np.zeros(begin.shape, dtype=bool)
        while queue:
            now, node, own = heapq.heappop(queue)
            if done[node, own]:
                continue
            done[node, own] = True
            if node == last:
                return float(now)
            legs = slice(graph.indptr[node], graph.indptr[node + 1])
            heads, lasts = graph.indices[legs], graph.data[legs]
            if not self.current.is_steady:
                at_once = np.full(len(heads), now)
                lasts = self._sailed(points[node], points[heads], at_once) - now
            for number in range(begin.shape[1]):
                leave, there = self._left_so_as_to_come(
                    points[node], points[heads], (now, begin[heads, number]), lasts
                )
                good = (there <= end[heads, number]) & (there < labels[heads, number])
                good &= (leave <= end[node, own]) if waits else (leave <= now + 1e-6)
                heads_now, leave, there = heads[good], leave[good], there[good]
                clear = self._is_clear(points[node], points[heads_now], leave, there)
                for head, time in zip(
                    heads_now[clear].tolist(), there[clear].tolist(), strict=True
                ):
                    labels[head, number] = time
                    heapq.heappush(queue, (time, head, number))
        return math.inf

    def _sailed(self, begin: FloatArray, ends: FloatArray, leave: FloatArray) -> FloatArray:
        """When edges (n,) end that are begun at times (n,), s, in a current that changes."""
        begun = np.broadcast_to(begin, ends.shape)
        return sailed(begun, ends, leave, self.current, VESSEL, _DRIFT, 2)

    def _left_so_as_to_come(
        self,
        begin: FloatArray,
        ends: FloatArray,
        times: tuple[float, FloatArray],
        lasts: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """When edges (n,) are begun and ended that begin and end no earlier than the times, s."""
        now, opens = times
        there = np.maximum(now + lasts, opens)
        leave = np.where(
            np.isfinite(lasts), there - np.where(np.isfinite(lasts), lasts, 0.0), math.inf
        )
        # In a current that changes an edge that is begun later takes another time.
        late = np.flatnonzero(np.isfinite(there) & (leave > now + 0.1))
        for _ in range(3 if len(late) and not self.current.is_steady else 0):
            there[late] = self._sailed(begin, ends[late], leave[late])
            leave[late] += np.maximum(opens[late] - there[late], 0.0)
        return leave, np.maximum(there, opens)

    def _open_spells(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Begin and end (n, most), s, of the spells in which nodes are open; to a minute."""
        clock = np.arange(self.departure, self.times[-1], 60.0)
        state = np.array(
            [self.is_open(np.broadcast_to(point, (len(clock), 2)), clock) for point in points]
        )
        padded = np.pad(state, ((0, 0), (1, 1)))
        change = np.diff(padded.astype(int), axis=1)
        most = int((change == 1).sum(axis=1).max())
        begin, end = np.full((len(points), most), math.inf), np.full((len(points), most), -math.inf)
        for node in range(len(points)):
            begins = np.flatnonzero(change[node] == 1)
            begin[node, : len(begins)] = clock[begins]
            end[node, : len(begins)] = clock[np.flatnonzero(change[node] == -1) - 1]
        return begin, end

    def _is_clear(
        self, begin: FloatArray, ends: FloatArray, leave: FloatArray, there: FloatArray
    ) -> BoolArray:
        clear = np.ones(len(ends), dtype=bool)
        # Every 200 m, so that an edge cuts no corner of a cell.
        longest = float(np.hypot(*(ends - begin).T).max(initial=0.0))
        for share in np.linspace(0, 1, math.ceil(longest / 200.0) + 1)[1:-1].tolist():
            clear &= self.is_open(begin + share * (ends - begin), leave + share * (there - leave))
        return clear


def moving_storms(seed: int) -> StormyScene:
    """Return a stormy scene in a current that changes: eddies drift through it, some strong."""
    scene, rng = stormy_scene(seed), np.random.default_rng([seed, 64])
    peak, period = rng.uniform(0.2, 0.9) * VESSEL.speed, rng.uniform(0.5, 3.0) * _VOYAGE_S
    eddies = Drifting(seed, peak, period)
    times = np.arange(0.0, scene.times[-1] + 1.0, _STEP)
    current = renew.VaryingCurrent(times, lambda at, time: eddies(at * (SIZE / _WIDE), time))
    return replace(scene, current=current)


def stormy_scene(seed: int) -> StormyScene:
    """Return a scene with a few islands, and storms that cross the way about when she does."""
    rng = np.random.default_rng([seed, 63])
    islands = []
    for _ in range(rng.integers(2, 6)):
        middle = rng.uniform([6_000, 4_000], [34_000, 26_000])
        angle = np.sort(rng.uniform(0, 2 * np.pi, 7))
        corners = middle + rng.uniform(800, 2_500) * np.column_stack([np.cos(angle), np.sin(angle)])
        islands.append(Polygon(corners).convex_hull)
    start = np.array([2_000.0, rng.uniform(5_000, 25_000)])
    goal = np.array([38_000.0, rng.uniform(5_000, 25_000)])
    times = np.arange(0.0, 86_400.0 + 1, _STEP)
    x, y = np.arange(0.0, _WIDE + 1, _CELL), np.arange(0.0, _HIGH + 1, _CELL)
    waves = np.full((len(times), len(y), len(x)), _CALM)
    for _ in range(rng.integers(1, 4)):
        share = rng.uniform(0.2, 0.8)
        place = start + share * (goal - start) + rng.normal(0, 2_000, 2)
        course, speed = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 3.0)
        velocity = speed * np.array([np.cos(course), np.sin(course)])
        size, top = rng.uniform(2_500, 7_000), rng.uniform(1.5, 4.0)
        for step, time in enumerate(times.tolist()):
            eye = place + velocity * (time - share * _VOYAGE_S)
            apart = np.hypot(x[None, :] - eye[0], y[:, None] - eye[1])
            waves[step] += top * np.exp(-((apart / size) ** 2) / 2)
    u, v = rng.normal(0, 0.2, 2).tolist()
    chart = renew.Chart(box(0, 0, _WIDE, _HIGH), islands)
    return StormyScene(chart, renew.UniformCurrent(u, v), start, goal, times, x, y, waves)
