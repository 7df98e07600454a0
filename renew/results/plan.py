"""What a plan consists of: routes, and the rejected classes with their reasons."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from renew._types import FloatArray
from renew.errors import (
    MomentSpelling,
    PlaceSpelling,
    PlanningError,
    Strait,
    Text,
    UnreachableError,
    in_seconds,
)
from renew.inputs.shut_area import ShutArea
from renew.results.drawing import Line, plan_html
from renew.results.route import OverpoweredHours, Route


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
    fuel_source : `unpadded_fuel`, or what computes it.
    """

    homotopy: str
    reason: str
    channel: FloatArray
    strait: Strait | None = None
    cause: PlanningError | None = None
    overpowered: tuple[OverpoweredHours, ...] = ()
    fuel_source: float | Callable[[], float] = field(default=math.inf, repr=False)

    @cached_property
    def unpadded_fuel(self) -> float:
        """What the class would need with no padding at all; inf if even so it has no path.

        Computed when first asked for: beside the fuel of the routes it says what the padding of its
        strait costs.
        """
        return self.fuel_source() if callable(self.fuel_source) else self.fuel_source

    @property
    def text(self) -> Text:
        """The reason with the places and moments that it names as values."""
        return self.cause.text if self.cause else Text(self.reason)

    def located_reason(self, place: PlaceSpelling, moment: MomentSpelling = in_seconds) -> str:
        """The reason with every place (2,), m, and moment spelled by functions, as in lon/lat."""
        return self.text.spelled(place, moment)

    def __reduce__(self) -> tuple[type[Rejected], tuple[object, ...]]:
        """Pickle the fuel instead of what it is made from: a current may be any function."""
        *others, _ = (getattr(self, one.name) for one in fields(self))
        return Rejected, (*others, self.unpadded_fuel)


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


class Departed(NamedTuple):
    """What one departure (s) came to: the best route's figures, or the cause why there is none."""

    departure: float
    arrival: float = math.inf
    fuel: float = math.inf
    path: FloatArray | None = None
    times: FloatArray | None = None
    homotopy: str = ""
    cause: PlanningError | None = None


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

    @classmethod
    def of(cls, found: Iterable[Departed], unproven: float, plan: Plan) -> Departures:
        """List what each departure came to, with the plan at the best of them."""
        departures, arrivals, fuels, paths, times, homotopies, causes = zip(*found, strict=True)
        return cls(
            np.array(departures, dtype=float),
            np.array(arrivals, dtype=float),
            np.array(fuels, dtype=float),
            paths,
            times,
            homotopies,
            causes,
            unproven,
            plan,
        )

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
