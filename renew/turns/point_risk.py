"""Risk at every point of a path: where too many drawn turns reach land, padding is too small.

Padding is set for a channel: for travel between its passing edges' midpoints, in each triangle by
itself. Just outside V a path may take another heading, or lie in another triangle than the one
that an edge was padded for, and more turns than the risk allows may reach land from there.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely

from renew._types import BoolArray, FloatArray, IntArray
from renew.inputs.current import CurrentStatistics
from renew.kernels.capsules import nearest_on_segments
from renew.turns.contingency import stations
from renew.turns.passage_windows import passage_windows
from renew.turns.reach_quantile import TurnSampler, TurnsAtEdges
from renew.turns.soft_no_go import PaddedEdges
from renew.turns.verification import in_soft_endpoints
from renew.voyage.voyage import Voyage

# Distance between stations (share of v/ω), and the largest number of stations.
_SPACING, _MAX_STATIONS = 0.6, 1_000_000
# Margin (share of v/ω) by which padding grows beyond what it lacks: the path planned around it
# takes other headings.
_MARGIN = 0.05
# Largest number of turns that are held in memory at a time: 32 MB.
_MAX_TURNS = 4_000_000


class _Stations(NamedTuple):
    """Points (n, 2) along a path, the course (n,) rad and the current's statistics (n,) there."""

    points: FloatArray
    course: FloatArray
    current: CurrentStatistics

    def chosen(self, which: IntArray | BoolArray) -> _Stations:
        """Some of them."""
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
    """Constrained edges that too many turns along a path (n, 2) reach, and what padding lacks (m).

    From no station along it may more than a share `risk` of the drawn turns reach land: in
    currents drawn from the mean and spread in its triangle, one of `corners` (t, 3, 2), and on
    headings about its own. None where all stations meet the risk. Those in V around a start or
    goal that itself lies in V are left out: no padding there could help.
    """
    if not len(padded.edge):
        return None
    route = _stations(path, voyage, corners)
    route = route.chosen(~in_soft_endpoints(route.points, voyage, padded))
    speed = route.current.speed + 4 * route.current.speed_std
    furthest = 2 * voyage.vessel.turning_radius + speed * voyage.vessel.turn_period
    edges = np.stack([padded.start, padded.end], axis=1)
    row, edge = shapely.STRtree(shapely.linestrings(edges)).query(
        shapely.points(route.points), predicate="dwithin", distance=furthest
    )
    order = np.argsort(row, kind="stable")
    row, edge = row[order], edge[order]
    nearest = nearest_on_segments(route.points[row], padded.start[edge], padded.end[edge])
    towards = nearest - route.points[row]
    gap = np.linalg.norm(towards, axis=1)
    towards /= np.maximum(gap, 1e-300)[:, None]
    beyond, blamed = [np.zeros(0)], [np.zeros(0, dtype=np.int64)]
    for pairs in _parts(row, sampler.count):
        some, own = np.unique(row[pairs], return_inverse=True)
        near = route.chosen(some)
        asked = TurnsAtEdges(near.current, near.course, own, towards[pairs], voyage.vessel)
        reaches = sampler.reaches(asked)
        reaches -= gap[pairs, None]
        first = np.flatnonzero(np.diff(own, prepend=-1))
        # A turn counts that reaches any of the edges around; the one most reached is to blame.
        beyond.append(sampler.upper_quantile(np.maximum.reduceat(reaches, first), risk))
        order = np.lexsort((sampler.upper_quantile(reaches, risk), own))
        blamed.append(pairs.start + order[np.append(first[1:], len(own)) - 1])
    worst, pair = np.concatenate(beyond), np.concatenate(blamed)
    worst, pair = worst[worst > 0], pair[worst > 0]
    if not len(pair):
        return None
    lacking = (
        gap[pair] + worst - padded.padding[edge[pair]] + _MARGIN * voyage.vessel.turning_radius
    )
    return padded.edge[edge[pair]], lacking


def _stations(path: FloatArray, voyage: Voyage, corners: FloatArray) -> _Stations:
    """Stations along a path (n, 2), each with the current of the triangle (t, 3, 2) it lies in."""
    radius = voyage.vessel.turning_radius
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    points, course = stations(path, max(_SPACING * radius, length / _MAX_STATIONS))
    windows = passage_windows(voyage, points, points, points)
    found, triangle = shapely.STRtree(shapely.polygons(corners)).query(
        shapely.points(points), predicate="intersects"
    )
    found, first = np.unique(found, return_index=True)
    met, back = np.unique(triangle[first], return_inverse=True)
    # In each triangle from when the first of its stations is passed until the last is.
    within = np.tile([np.inf, -np.inf], (len(met), 1))
    np.minimum.at(within[:, 0], back, windows[found, 0])
    np.maximum.at(within[:, 1], back, windows[found, 1])
    current = voyage.waters.quick_current.statistics(corners[met], within)
    current = CurrentStatistics(*(of[back] for of in current))
    return _Stations(points[found], course[found], current)


def _parts(row: IntArray, draws: int) -> Iterator[slice]:
    """Slices of ascending rows (p,), each with all pairs of its rows and not too many turns."""
    bounds = np.append(np.flatnonzero(np.diff(row, prepend=-1)), len(row))
    begin = 0
    while begin < len(row):
        last = np.searchsorted(bounds, begin + _MAX_TURNS // draws, side="right") - 1
        end = max(int(bounds[last]), int(bounds[np.searchsorted(bounds, begin, side="right")]))
        yield slice(begin, end)
        begin = end
