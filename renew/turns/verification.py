"""Verification of a path by hard-over turns, at the times when the vessel may be at each place.

The padding at a place holds for the whole window of time in which the vessel may be there.

Turns are simulated in the field, and none may touch land. That tests samples, and proves nothing:
only the bound on fuel has a proof (:mod:`renew.bounds`).

On request the risk is checked at every point as well. Padding is set for a channel: for travel
between its passing edges' midpoints, in each triangle by itself. Just outside V a path may take
another heading, or lie in another triangle than the one that an edge was padded for, and more of
the drawn turns than the risk allows may reach land from there.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely

from renew._compiled import for_kernels
from renew._types import BoolArray, FloatArray, IntArray
from renew.inputs.chart_and_vessel import Chart, Vessel
from renew.inputs.current import CurrentField, CurrentStatistics, TabulatedCurrent
from renew.kernels import capsules
from renew.kernels.turn_tracks import TurnsBegun
from renew.turns.contingency import fly_turns, perturbations, stations
from renew.turns.padding_model import PaddedEdges
from renew.turns.turn_reach import (
    MAX_DEVIATIONS,
    TurnReach,
    TurnSampler,
    TurnsAtEdges,
    furthest_reach,
)
from renew.voyage.fuel import speeds_along
from renew.voyage.voyage import Voyage

# Largest number of points at which the time of passage is taken.
_MAX_PASSAGE_POINTS = 2000


def passage_windows(
    voyage: Voyage, path: FloatArray, enter: FloatArray, leave: FloatArray
) -> FloatArray:
    """Return windows (n, 2), s, of the stretches of a path (m, 2) from `enter` to `leave` (n, 2).

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


# Margin (share of v/ω) added to land, so that another seed, or a place between two stations, shows
# no collision that the verification missed. When padding grows, this margin is added once more.
_MARGIN = 0.05
# Padding grows by this factor times what it lacks, because the new path meets another current.
_OVERSHOOT = 1.3
# Factor on the distance by which a perturbed current may carry a turn away: on the way the turn
# meets other currents than those around its beginning.
_ELSEWHERE = 2.0
# Distance between stations, as a share of v/ω.
_SPACING = 0.6
# Distance of a turn from an edge, in v/ω, beyond which it is not measured to fit padding.
_ENOUGH = 1.0
# How far off an edge's padding a station tells what padding the edge needs, as a share of v/ω.
_BESIDE = 0.5
# Largest number of stations.
_MAX_STATIONS = 1_000_000
# Number of headings of a turn, one every 15 degrees: chords leave its arc by under 1 % of v/ω.
STEPS = 24
# Deviations in which turns are simulated: the field itself, and the corners of the box from which
# contingency draws: a turn reaches furthest where the field deviates most.
_CORNERS = MAX_DEVIATIONS * np.array([[[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]]], dtype=float)
# The field, and deviations all round that box. In a current whose direction varies much, a turn may
# reach furthest between two corners.
AROUND = np.array(
    [[0, 0], [2, -2], [2, -1], [2, 0], [2, 1], [2, 2], [-2, 2], [-2, 0], [-2, -2]], dtype=float
)[None] * (MAX_DEVIATIONS / 2)
# Margin (share of v/ω) added to what padding lacks, because the new path has other headings.
_HEADING_MARGIN = 0.05
# Largest number of turns that are held in memory at a time: 32 MB.
_MAX_TURNS = 4_000_000


def colliding_edges(
    path: FloatArray,
    voyages: Sequence[Voyage],
    padded: PaddedEdges,
    reach: TurnReach,
    speeds: FloatArray | None = None,
    *,
    is_fitted: bool = False,
) -> tuple[IntArray, FloatArray] | None:
    """Return constrained edges that turns along a path touch, and the padding they lack (m).

    None if no turn touches an edge in any of the voyages. These are one voyage in several currents,
    each by its own clock. `reach` bounds how far a turn can get. Turns begun in the part of V
    around a start or goal that itself lies in V are left out: no padding there could help. Turns
    are simulated at the vessel's speed, or at the speeds (n - 1,) at which the legs are sailed; in
    the corners of their deviations, or all round them if padding is fitted to turns.
    """
    if not len(padded.edge):
        return None
    stations_near = _Near.along(path, voyages, padded, reach, speeds)
    chart = voyages[0].chart
    if not len(stations_near.close):
        return None
    found = [stations_near.touched(flown, chart, is_fitted) for flown in stations_near.flown]
    if not (short := [one for one in found if one]):
        return None
    edges, lacking = (np.concatenate(parts) for parts in zip(*short, strict=True))
    return edges, lacking


def needed_padding(
    path: FloatArray, voyages: Sequence[Voyage], padded: PaddedEdges, reach: TurnReach
) -> tuple[FloatArray, bool]:
    """Return the padding (e,), m, that turns along a path need of edges, and whether all are clear.

    From each station, an edge needs as much padding as the station is away from it, less the room
    that the station's turns leave; -inf where the path keeps well off the edge's padding. See
    :func:`colliding_edges` for the arguments.
    """
    stations_near = _Near.along(path, voyages, padded, reach)
    needed, is_clear = np.full(len(padded.edge), -np.inf), True
    if len(stations_near.close):
        for flown in stations_near.flown:
            edge, padding, room = stations_near.needs(flown, voyages[0].chart)
            np.maximum.at(needed, edge, padding)
            is_clear = is_clear and bool((room >= 0).all())
    return needed, is_clear


# Distance between stations where it is asked how large a turn is free, as a share of v/ω.
_CLOSELY = 0.25
# Number of steps in which turns are made smaller.
_STEPS = 20


def free_shares(
    path: FloatArray,
    voyages: Sequence[Voyage],
    edges: FloatArray,
    reach: TurnReach,
    speeds: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return stations along a path (n, 2), m, and the share of a full turn that is free at each.

    The share is that of the largest turning circle, in steps of 5 % of the vessel's own, with
    which no turn touches any of the edges (e, 2, 2): 1 where all turns are free. See
    :func:`colliding_edges` for the other arguments.
    """
    ends = for_kernels(edges[:, 0]), for_kernels(edges[:, 1])
    bare = PaddedEdges.of(*ends, np.zeros(len(edges)), np.arange(len(edges)))
    vessel = voyages[0].vessel
    spacing = _CLOSELY * vessel.turning_radius
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    along = np.append(np.arange(0.0, length, spacing), length)
    share, per_station = np.ones(len(along)), 1 if voyages[0].current.is_steady else 3
    near = _Near.along(path, voyages, bare, reach, speeds, spacing)
    for step in range(_STEPS, 0, -1):
        near = near.of_circle(step / _STEPS, vessel)
        near = near._replace(close=near.touching)
        share[np.minimum(near.close // per_station, len(along) - 1)] = (step - 1) / _STEPS
        if not len(near.close):
            break
    return along, share


class _Flown(NamedTuple):
    """The current in which turns are flown, when they begin (n,), s, and the room they need (m)."""

    field: CurrentField
    times: FloatArray
    margin: float


class _Near(NamedTuple):
    """Stations (n, 2) with the padded edges near them, and a bound on their turns' reach (n,), m.

    The edges of station i are `near[first[i]:first[i + 1]]`. Turns are flown from the stations
    `close` to edges.
    """

    points: FloatArray
    course: FloatArray
    speed: FloatArray
    furthest: FloatArray
    first: IntArray
    near: IntArray
    close: IntArray
    padded: PaddedEdges
    vessel: Vessel
    flown: tuple[_Flown, ...]

    @classmethod
    def along(
        cls,
        path: FloatArray,
        voyages: Sequence[Voyage],
        padded: PaddedEdges,
        reach: TurnReach,
        speeds: FloatArray | None = None,
        spacing: float | None = None,
    ) -> "_Near":
        """Return the stations of a path."""
        voyage = voyages[0]
        vessel = voyage.vessel
        if speeds is None:
            speeds = np.full(len(path) - 1, vessel.speed)
        margin = _MARGIN * vessel.turning_radius
        if spacing is None:
            spacing = spacing_along(path, _SPACING * vessel.turning_radius)
        points, course, times = passed_stations(path, spacing, voyage)
        flown = []
        for one in voyages:
            field, astray = _flown_in(one)
            is_alike = one is voyage or one.current.is_steady
            own = times if is_alike else passed_stations(path, spacing, one)[2]
            flown.append(_Flown(field, own, margin + astray))
        # Only turns within reach of land can touch it: most of a long way needs no simulation.
        furthest = reach(points)
        most = max(one.margin for one in flown)
        first, near = capsules.segments_near(points, furthest + most, padded.start, padded.end)
        close = np.flatnonzero(np.diff(first))
        close = close[~in_soft_endpoints(points[close], voyage, padded)]
        speed = speeds_along(points, path, speeds)
        edges = padded, vessel
        return cls(points, course, speed, furthest, first, near, close, *edges, tuple(flown))

    def of_circle(self, share: float, vessel: Vessel) -> "_Near":
        """Return the stations with a share of a vessel's turning circle; no wider than before.

        Both parts of the margin are as wide as the circle.
        """
        tighter = replace(vessel, turn_rate=vessel.turn_rate / share)
        narrower = tighter.turning_radius / self.vessel.turning_radius
        flown = tuple(one._replace(margin=one.margin * narrower) for one in self.flown)
        return self._replace(vessel=tighter, flown=flown)

    def needs(self, flown: _Flown, chart: Chart) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return edges near the path, the padding (p,) that they need, and their room (p,), m."""
        field, times, margin = flown
        start, end, padding = self.padded.start, self.padded.end, self.padded.padding
        beside = _BESIDE * self.vessel.turning_radius
        # Far off padding, only turns that may touch land tell anything.
        row = np.repeat(np.arange(len(self.points)), np.diff(self.first))
        apart = capsules.segment_distance(self.points[row], start[self.near], end[self.near])
        is_beside = np.zeros(len(self.points), dtype=bool)
        is_beside[row[apart <= padding[self.near] + beside]] = True
        is_beside[self._that_may_touch(flown, self.close[~is_beside[self.close]])] = True
        close = self.close[is_beside[self.close]]
        if not len(close):
            return close, np.zeros(0), np.zeros(0)
        turns, bounds, near = self._turns(close, field, times, AROUND)
        most = _ENOUGH * self.vessel.turning_radius
        room = capsules.track_distances(turns, bounds, near, start, end, most)
        between = capsules.track_distances(_between(turns), bounds, near, start, end, most)
        room = np.minimum(room, between)
        row = np.repeat(np.arange(len(close)), np.diff(bounds))
        if len(crossing := np.unique(row[room < 0])):
            deep = np.zeros(len(close))
            tracks = turns[crossing].reshape(-1, *turns.shape[2:])
            depths = _depths(tracks, chart, self.furthest.max())
            deep[crossing] = depths.reshape(len(crossing), -1).max(axis=1)
            room = np.where(room < 0, -deep[row], room)
        room -= margin
        apart = capsules.segment_distance(self.points[close][row], start[near], end[near])
        is_met = (apart <= padding[near] + beside) | (room < 0)
        return near[is_met], (apart - room)[is_met], room[is_met]

    @property
    def touching(self) -> IntArray:
        """Which of the close stations have turns that touch an edge."""
        if not len(self.close):
            return self.close
        found, start, end = list[IntArray](), self.padded.start, self.padded.end
        for field, times, margin in self.flown:
            turns, first, near = self._turns(self.close, field, times, AROUND)
            for lines in (turns, _between(turns)):
                radius = np.full(len(lines), margin)
                track, _ = capsules.tracks_touch(lines, first, near, start, end, radius)
                found.append(self.close[np.unique(track // lines.shape[1])])
        return np.unique(np.concatenate(found))

    def _that_may_touch(self, flown: _Flown, chosen: IntArray) -> IntArray:
        """Return those of chosen stations from which turns may touch land.

        From the others, the unperturbed turn stays so far off that no perturbed one can.
        """
        field, times, margin = flown
        drift = (self.furthest[chosen] - 2 * self.vessel.turning_radius) / 2
        off = _max_offset(self.points[chosen], field, self.vessel, drift, times[chosen])
        turns, bounds, near = self._turns(chosen, field, times, _CORNERS[:, :1])
        edges = self.padded.start, self.padded.end
        track, _ = capsules.tracks_touch(turns, bounds, near, *edges, margin + off)
        return np.asarray(chosen[np.unique(track // turns.shape[1])])

    def touched(
        self, flown: _Flown, chart: Chart, is_fitted: bool
    ) -> tuple[IntArray, FloatArray] | None:
        """Return edges that turns from close stations touch in a field, and what they lack (m)."""
        field, times, margin = flown
        close = self._that_may_touch(flown, self.close)
        if not len(close):
            return None
        start, end = self.padded.start, self.padded.end
        radius = np.full(len(close), margin)
        deviations = AROUND if is_fitted else _CORNERS
        turns, bounds, near = self._turns(close, field, times, deviations)
        edges, lacking = list[IntArray](), list[FloatArray]()
        for lines in (turns, _between(turns)) if is_fitted else (turns,):
            line, edge = capsules.tracks_touch(lines, bounds, near, start, end, radius)
            hit, back = np.unique(line, return_inverse=True)
            tracks = lines.reshape(-1, *lines.shape[2:])[hit]
            depths = _depths(tracks, chart, self.furthest.max())[back]
            edges.append(self.padded.edge[edge])
            lacking.append(_OVERSHOOT * depths + 2 * margin)
        touched = np.concatenate(edges)
        return (touched, np.concatenate(lacking)) if len(touched) else None

    def _turns(
        self, chosen: IntArray, field: CurrentField, times: FloatArray, deviations: FloatArray
    ) -> tuple[FloatArray, IntArray, IntArray]:
        """Return turns from chosen stations, and the edges near each, as `first` and `near`."""
        columns = self.points, self.course, times, self.speed
        begun = TurnsBegun(*(column[chosen] for column in columns))
        turns = fly_turns(begun, field, self.vessel, deviations, STEPS)
        counts = np.diff(self.first)[chosen]
        bounds = np.concatenate([[0], np.cumsum(counts)])
        edges = self.near[
            np.repeat(self.first[chosen] - bounds[:-1], counts) + np.arange(bounds[-1])
        ]
        return turns, bounds, edges


def _flown_in(voyage: Voyage) -> tuple[CurrentField, float]:
    """Return the current for simulated turns, and the error (m) that it may cause in their tracks.

    It is the table if that is fine, or if its error moves the tracks by little compared with the
    margin: a table of many slices may have to be coarse, to fit in memory.
    """
    table, vessel = voyage.table, voyage.vessel
    astray = _ELSEWHERE * table.error * vessel.turn_period
    if table.is_fine or astray > _MARGIN / 2 * vessel.turning_radius:
        return voyage.waters.quick_current, 0.0
    return TabulatedCurrent(table), astray


def spacing_along(path: FloatArray, least: float, most: int = _MAX_STATIONS) -> float:
    """Return the distance (m) between points along a path (n, 2): the least for up to `most`."""
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    return max(least, length / most)


def passed_stations(
    path: FloatArray, spacing: float, voyage: Voyage
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return stations (n, 2) along a path, courses (n,), rad, and times of passage (n,), s.

    In a changing current each station is listed three times: passed early, on time and late.
    """
    points, course = stations(path, spacing)
    times = voyage.reading_times(points)
    if voyage.current.is_steady:
        return points, course, times
    early, late = voyage.early_and_late(times)
    begin = np.stack([early, times, late], axis=1)
    return np.repeat(points, 3, axis=0), np.repeat(course, 3), begin.ravel()


def _between(turns: FloatArray) -> FloatArray:
    """Return lines (n, 2 steps, 9, 2) around the vessels of `AROUND`, at each step of a turn.

    Land between the tracks (n, turns, steps, 2) of two draws is met by a turn between them.
    """
    around = turns.reshape(len(turns), -1, 2, *turns.shape[2:])[:, 1:]
    rings = np.concatenate([around, around[:, :1]], axis=1)
    rings = rings.transpose(0, 2, 3, 1, 4)
    return np.ascontiguousarray(rings.reshape(len(turns), -1, *rings.shape[3:]))


def _max_offset(
    points: FloatArray, field: CurrentField, vessel: Vessel, drift: FloatArray, times: FloatArray
) -> FloatArray:
    """Return how far (n,), m, perturbations can carry a turn that drifts by `drift` (n,), m."""
    speed_change, direction_change = perturbations(points, field, vessel, _CORNERS[:, 1:2], times)
    return _ELSEWHERE * (vessel.turn_period * speed_change[:, 0] + drift * direction_change[:, 0])


def _depths(tracks: FloatArray, chart: Chart, most: float) -> FloatArray:
    """Return how deep each track (n, steps, 2) goes into the no-go zone (n,), up to `most` m."""
    points = tracks.reshape(-1, 2)
    inside = shapely.contains_xy(chart.hard_no_go, points)
    depth = np.zeros(len(points))
    depth[inside] = np.minimum(capsules.distances_within(points[inside], most, *chart.shore), most)
    return np.asarray(depth.reshape(tracks.shape[:2]).max(axis=1))


def in_soft_endpoints(points: FloatArray, voyage: Voyage, padded: PaddedEdges) -> BoolArray:
    """Whether points (n, 2) lie in the part of V around a start or goal inside V."""
    inside = np.zeros(len(points), dtype=bool)
    for endpoint in (voyage.start, voyage.goal):
        around = padded.around(endpoint)
        if len(around.edge):
            apart = capsules.segment_distance(points[:, None], around.start, around.end)
            inside |= (apart < around.padding).any(axis=1)
    return inside


class _Stations(NamedTuple):
    """Points (n, 2) along a path, the course (n,) rad and the current's statistics (n,) there."""

    points: FloatArray
    course: FloatArray
    current: CurrentStatistics

    def chosen(self, which: IntArray | BoolArray) -> "_Stations":
        """Return some of the stations."""
        current = CurrentStatistics(*(of[which] for of in self.current))
        return _Stations(self.points[which], self.course[which], current)


def risky_edges(
    path: FloatArray,
    voyage: Voyage,
    padded: PaddedEdges,
    corners: FloatArray,
    sampler: TurnSampler,
    risk: float,
) -> tuple[IntArray, FloatArray] | None:
    """Return constrained edges that too many turns along a path reach, and the padding they lack.

    No more than a share `risk` of the turns drawn at any station may reach land. Currents are drawn
    from the mean and spread in the station's triangle, one of `corners` (t, 3, 2), and headings
    about the station's course. None where all stations meet the risk. Stations in V around a start
    or goal that itself lies in V are left out: no padding there could help.
    """
    if not len(padded.edge):
        return None
    route = _stations(path, voyage, corners)
    route = route.chosen(~in_soft_endpoints(route.points, voyage, padded))
    furthest = furthest_reach(route.current, voyage.vessel)
    edges = np.stack([padded.start, padded.end], axis=1)
    row, edge = shapely.STRtree(shapely.linestrings(edges)).query(
        shapely.points(route.points), predicate="dwithin", distance=furthest
    )
    order = np.argsort(row, kind="stable")
    row, edge = row[order], edge[order]
    nearest = capsules.nearest_on_segments(route.points[row], padded.start[edge], padded.end[edge])
    towards = nearest - route.points[row]
    gap = np.linalg.norm(towards, axis=1)
    towards /= np.maximum(gap, 1e-300)[:, None]
    beyond, blamed = [np.zeros(0)], [np.zeros(0, dtype=np.int64)]
    for pairs in _batches(row, sampler.count):
        some, own = np.unique(row[pairs], return_inverse=True)
        near = route.chosen(some)
        asked = TurnsAtEdges(near.current, near.course, own, towards[pairs], voyage.vessel)
        reaches = sampler.reaches(asked)
        reaches -= gap[pairs, None]
        first = np.flatnonzero(np.diff(own, prepend=-1))
        # A turn counts if it reaches any of the edges around; the edge reached furthest is padded.
        beyond.append(sampler.upper_quantile(np.maximum.reduceat(reaches, first), risk))
        order = np.lexsort((sampler.upper_quantile(reaches, risk), own))
        blamed.append(pairs.start + order[np.append(first[1:], len(own)) - 1])
    worst, pair = np.concatenate(beyond), np.concatenate(blamed)
    worst, pair = worst[worst > 0], pair[worst > 0]
    if not len(pair):
        return None
    lacking = gap[pair] + worst - padded.padding[edge[pair]]
    lacking += _HEADING_MARGIN * voyage.vessel.turning_radius
    return padded.edge[edge[pair]], lacking


def _stations(path: FloatArray, voyage: Voyage, corners: FloatArray) -> _Stations:
    """Return stations along a path (n, 2), each with the current of its triangle (t, 3, 2)."""
    points, course = stations(path, spacing_along(path, _SPACING * voyage.vessel.turning_radius))
    windows = passage_windows(voyage, points, points, points)
    found, triangle = shapely.STRtree(shapely.polygons(corners)).query(
        shapely.points(points), predicate="intersects"
    )
    found, first = np.unique(found, return_index=True)
    met, back = np.unique(triangle[first], return_inverse=True)
    # A triangle's window lasts from the passage of its first station to that of its last one.
    within = np.tile([np.inf, -np.inf], (len(met), 1))
    np.minimum.at(within[:, 0], back, windows[found, 0])
    np.maximum.at(within[:, 1], back, windows[found, 1])
    current = voyage.waters.padded_for.statistics(corners[met], within)
    current = CurrentStatistics(*(of[back] for of in current))
    return _Stations(points[found], course[found], current)


def _batches(row: IntArray, draws: int) -> Iterator[slice]:
    """Yield slices of ascending rows (p,) that hold all pairs of their rows; few turns each."""
    bounds = np.append(np.flatnonzero(np.diff(row, prepend=-1)), len(row))
    begin = 0
    while begin < len(row):
        last = np.searchsorted(bounds, begin + _MAX_TURNS // draws, side="right") - 1
        end = max(int(bounds[last]), int(bounds[np.searchsorted(bounds, begin, side="right")]))
        yield slice(begin, end)
        begin = end
