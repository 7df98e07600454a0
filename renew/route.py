"""What a plan consists of: routes, and the rejected classes with their reasons."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from renew._types import FloatArray
from renew.bounds.fuel_lower_bound import fuel_lower_bound
from renew.drawing import Line, plan_html
from renew.errors import (
    MomentSpelling,
    PlaceSpelling,
    PlanningError,
    Strait,
    Text,
    UnreachableError,
    from_until,
    in_seconds,
)
from renew.inputs.shut_area import ShutArea
from renew.inputs.voyage import Voyage
from renew.kernels.traversal import visits


@dataclass(frozen=True, repr=False, eq=False)
class FuelBound:
    """The fuel that no route of a voyage can stay below, of any class, however close to land."""

    voyage: Voyage

    @cached_property
    def value(self) -> float:
        """The lower bound (fuel units); see :mod:`renew.bounds.fuel_lower_bound`."""
        return fuel_lower_bound(self.voyage)

    def __getstate__(self) -> dict[str, object]:
        """Pickle the bound instead of what it is made from: a current may be any function."""
        return {"value": self.value}

    def __setstate__(self, state: dict[str, object]) -> None:
        """Take the bound back as it was computed."""
        self.__dict__.update(state)


class OverpoweredHours(NamedTuple):
    """Water that the current shuts for a while, on the way of a class.

    At `place` (2,), m, it is nearly as strong as the vessel is fast, or stronger, from `begin`
    until `end` (s): part of the time in which she may be there, or comes there and has to wait. Of
    a stretch of such water it is the place where that lasts longest. The times are infinite where
    the current is held before its first time or after its last.
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

    @cached_property
    def channel(self) -> FloatArray:
        """Triangles (t, 3, 2) that the path crosses, from start to goal, in metres."""
        crossed = dict.fromkeys(visits(self.path, self.corners).triangle.tolist())
        return np.asarray(self.corners[list(crossed)])

    @cached_property
    def soft_no_go(self) -> BaseGeometry:
        """The soft no-go zone V of this class: its padded edges, buffered."""
        return _united([self.padding_used])[0]

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
        vars(route)["soft_no_go"] = zone


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


@dataclass(frozen=True, eq=False)
class Rejected:
    """A class without a route.

    Attributes
    ----------
    homotopy : its name.
    reason : why, as a sentence; `located_reason` spells its places in another way.
    channel : (t, 3, 2) metres, its triangles from start to goal.
    strait : where padding takes a whole gap, if that is the reason.
    cause : the error behind the reason; its places are in metres.
    overpowered : water on its way that the current shuts for a while, as of a route.
    """

    homotopy: str
    reason: str
    channel: FloatArray
    strait: Strait | None = None
    cause: PlanningError | None = None
    overpowered: tuple[OverpoweredHours, ...] = ()
    _compute_fuel: Callable[[], float] = field(default=lambda: math.inf, repr=False)

    @cached_property
    def unpadded_fuel(self) -> float:
        """What the class would need with no padding at all; inf if even so it has no path.

        Computed when first asked for: beside the fuel of the routes it says what the padding of its
        strait costs.
        """
        return self._compute_fuel()

    @property
    def text(self) -> Text:
        """The reason with the places and moments that it names as values."""
        return self.cause.text if self.cause else Text(self.reason)

    def located_reason(self, place: PlaceSpelling, moment: MomentSpelling = in_seconds) -> str:
        """The reason with every place (2,), m, and moment spelled by functions, as in lon/lat."""
        return self.text.spelled(place, moment)

    def __getstate__(self) -> dict[str, object]:
        """Pickle the fuel instead of what it is made from: a current may be any function."""
        fuel = self.unpadded_fuel
        return {**self.__dict__, "unpadded_fuel": fuel, "_compute_fuel": None}

    def __setstate__(self, state: dict[str, object]) -> None:
        """Take the fuel back as it was computed."""
        self.__dict__.update(state)


@dataclass(frozen=True, eq=False)
class TradeOff:
    """Least fuel by arrival, where speeds are chosen: what an hour later saves.

    Attributes
    ----------
    arrivals : (n,) s, ascending: from the earliest that the highest speed can make to where time is
        free, and more of it saves no more.
    fuels : (n,) fuel units, falling: that of the cheapest of the paths that the plan holds, or of
        the first few where the current changes, each at its best speeds for that arrival. At
        arrivals near the planned one another path may be a little cheaper, far from it by more: 5 %
        have been seen where time is free.
    """

    arrivals: FloatArray
    fuels: FloatArray


@dataclass(frozen=True, eq=False)
class Plan:
    """Routes, one per feasible class, least fuel first; and the classes without a route.

    `chosen` is the index of the best route: 0, except for the sampled method, which picks the class
    by the harmonic mean over its sampled paths (paper). `overpowering` is the water that was no-go
    because its current is as strong as the vessel is fast: empty, or polygons in metres. `shut` are
    areas that a way of less fuel might have met while they are shut.
    `trade_off` is there where speeds were chosen.
    """

    routes: tuple[Route, ...]
    rejected: tuple[Rejected, ...]
    chosen: int = 0
    overpowering: BaseGeometry = field(default_factory=shapely.MultiPolygon)
    shut: tuple[ShutArea, ...] = ()
    trade_off: TradeOff | None = None

    @property
    def best(self) -> Route:
        """The route to take."""
        if not self.routes:  # never from plan(), which raises; a Plan can be built by hand
            raise UnreachableError("the plan holds no route")
        return self.routes[self.chosen]

    def _repr_html_(self) -> str:
        """Return a map and a table for a notebook, without the optimality gap, which takes time."""
        if not self.routes:
            return f"<p>No route; {len(self.rejected)} classes were rejected.</p>"
        lines = [
            Line(
                route.path,
                route.channel,
                (
                    route.homotopy,
                    f"{route.fuel:.1f}",
                    f"{route.length:.1f} m",
                    f"{route.clearance:.1f} m",
                ),
            )
            for route in self.routes
        ]
        header = ("class", "fuel", "length", "clear of land")
        return plan_html(lines, self.chosen, self.best.soft_no_go, header)


@dataclass(frozen=True, eq=False)
class Departures:
    """The best route of each of some departures, and the best departure.

    Attributes
    ----------
    departures : (n,) s, ascending: those asked for, and those planned between them.
    arrivals : (n,) s; inf where no class can be sailed. No departure arrives later than a later
        one, but where padding for its own hours leaves less room.
    fuels : (n,) fuel units; inf where no class can be sailed.
    paths : the paths (m, 2), m; None where no class can be sailed.
    times : when the points of each path are passed (m,), s; None where there is none.
    homotopies : the name of each path's class; empty where there is none.
    causes : the error for which there is none; None where there is one.
    unproven : time (s) by which a departure between those planned may still beat the best one, to
        within the error of the paths that were found; inf where the current is as strong as the
        vessel in places.
    plan : all classes at the best departure.
    """

    departures: FloatArray
    arrivals: FloatArray
    fuels: FloatArray
    paths: tuple[FloatArray | None, ...]
    times: tuple[FloatArray | None, ...]
    homotopies: tuple[str, ...]
    causes: tuple[PlanningError | None, ...]
    unproven: float
    plan: Plan

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why there is none; empty where there is one."""
        return tuple("" if cause is None else str(cause) for cause in self.causes)

    @property
    def durations(self) -> FloatArray:
        """Times under way (n,), s."""
        return self.arrivals - self.departures

    @property
    def best(self) -> int:
        """Index of the departure that takes least fuel, the earliest of those that do."""
        return int(self.fuels.argmin())
