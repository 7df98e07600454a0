"""A route: the least-fuel path found in one class, with its figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from renew._types import FloatArray
from renew.bounds.fuel_lower_bound import fuel_lower_bound
from renew.errors import Text, from_until
from renew.kernels.traversal import visits
from renew.voyage.voyage import Voyage


@dataclass(frozen=True, repr=False, eq=False)
class FuelBound:
    """The fuel that no route of a voyage can stay below, of any class, however close to land.

    It is worked out from the voyage when it is first asked for, or known already.
    """

    source: Voyage | float

    @cached_property
    def value(self) -> float:
        """The lower bound (fuel units); see :mod:`renew.bounds.fuel_lower_bound`."""
        return fuel_lower_bound(self.source) if isinstance(self.source, Voyage) else self.source

    def __reduce__(self) -> tuple[type[FuelBound], tuple[float]]:
        """Pickle the bound instead of what it is made from: a current may be any function."""
        return FuelBound, (self.value,)


class OverpoweredHours(NamedTuple):
    """Water that the current shuts for a while, on the way of a class.

    At `place` (2,), m, it is nearly as strong as the vessel is fast, or stronger, from `begin`
    until `end` (s): part of the time in which the vessel may be there, or comes there and has to
    wait. Of a stretch of such water it is the place where that lasts longest. The times are
    infinite where the current is held before its first time or after its last.
    """

    place: FloatArray
    begin: float
    end: float

    @property
    def text(self) -> Text:
        """The hours as a text that names their moments on the current's clock."""
        return from_until(self.begin, self.end, on=" on")


@dataclass(frozen=True, eq=False)
class Route:
    """The least-fuel path found in one homotopy class.

    Attributes
    ----------
    path : (n, 2) metres, start to goal.
    trajectory : (m, 4) of t (s), x, y (m) and heading (rad): the path as it is steered, with times
        on the current's clock.
    fuel : Eq. 4 along the path (fuel units; seconds for the paper's vessel).
    length : metres.
    clearance : least distance from the path to the hard no-go zone (m); inf on an empty chart.
    duration : time under way by the drift model (s).
    times : (n,) s, when the path's points are passed, on the current's clock; the first is the
        departure.
    speeds : (n - 1,) m/s, the speed through water at which each leg of the path is sailed.
    fuel_bound : the least fuel that any route can need; computed when first asked for.
    homotopy : the class's name: islands passed on their +y side, in order, "s2.p1" leaving the
        second to starboard and then the first to port; the largest island is 1.
    corners : (t, 3, 2) metres, the triangles in which its path was planned.
    padding_used : (e, 5) x0, y0, x1, y1, padding: every constrained edge next to the channel (m).
    harmonic_mean : harmonic mean of the fuel of the class's sampled paths (sampled method), or
        the path's own fuel.
    starts_in_soft_no_go, ends_in_soft_no_go : the first or the last leg lies partly in V.
    overpowered : water on the class's way that the current shuts for a while, in the order in which
        it is passed: the route is the best without waiting.
    """

    path: FloatArray
    trajectory: FloatArray
    fuel: float
    length: float
    clearance: float
    duration: float
    times: FloatArray
    speeds: FloatArray
    fuel_bound: FuelBound
    homotopy: str
    corners: FloatArray
    padding_used: FloatArray
    harmonic_mean: float
    starts_in_soft_no_go: bool
    ends_in_soft_no_go: bool
    overpowered: tuple[OverpoweredHours, ...] = ()
    _zone: list[BaseGeometry] = field(default_factory=list, init=False, repr=False)

    @cached_property
    def channel(self) -> FloatArray:
        """Triangles (t, 3, 2) that the path crosses, from start to goal, in metres."""
        crossed = dict.fromkeys(visits(self.path, self.corners).triangle.tolist())
        return np.asarray(self.corners[list(crossed)])

    @property
    def soft_no_go(self) -> BaseGeometry:
        """The soft no-go zone V of this class: its padded edges, buffered."""
        if not self._zone:
            unite_soft_no_go([self])
        return self._zone[0]

    @property
    def fuel_per_distance(self) -> float:
        """Fuel per metre of path (the paper's F/D)."""
        return self.fuel / self.length

    @property
    def optimality_gap(self) -> float:
        """Share by which the fuel exceeds the lower bound over all classes of the chart, >= 0.

        The bound knows no padding and no turning circle: the gap includes what safety costs.
        """
        bound = self.fuel_bound.value
        return max(0.0, self.fuel / bound - 1) if bound > 0 else math.inf


def unite_soft_no_go(routes: Sequence[Route]) -> None:
    """Compute V of several routes together, which takes half the time, and keep it with them."""
    zones = _united([route.padding_used for route in routes])
    for route, zone in zip(routes, zones, strict=True):
        route._zone[:] = [zone]  # noqa: SLF001 - kept for the next to ask


def _united(paddings: Sequence[FloatArray]) -> list[BaseGeometry]:
    """V of each of several routes, of its edges (e, 5): x0, y0, x1, y1, padding.

    Routes on one chart share most of their padded edges: those of the same routes are united once.
    """
    padded = [edges[edges[:, 4] > 0] for edges in paddings]
    route = np.repeat(np.arange(len(padded)), [len(edges) for edges in padded])
    if not len(route):
        return [shapely.MultiPolygon() for _ in padded]
    rows, row = np.unique(np.vstack(padded), axis=0, return_inverse=True)
    shared = np.zeros((len(rows), len(padded)), dtype=bool)
    shared[row.ravel(), route] = True
    members, group = np.unique(shared, axis=0, return_inverse=True)
    lines = shapely.linestrings(rows[:, :4].reshape(-1, 2, 2))
    capsules = shapely.buffer(lines, rows[:, 4], quad_segs=16)
    parts = [shapely.union_all(capsules[group.ravel() == one]) for one in range(len(members))]
    # Most islands' paddings are apart: only what meets is overlaid.
    return [
        shapely.disjoint_subset_union_all([parts[one] for one in np.flatnonzero(members[:, at])])
        for at in range(len(padded))
    ]
