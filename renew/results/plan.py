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
    strait : where padding fills a whole gap, if that is the reason.
    cause : the error behind the reason; its places are in metres.
    overpowered : water on its way that the current shuts for a while.
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
        """Fuel that the class would need without any padding; inf if it has no path even then.

        Computed when first asked for. Compared with the fuel of the routes, it shows what the
        padding of the class's strait costs.
        """
        return self.fuel_source() if callable(self.fuel_source) else self.fuel_source

    @property
    def text(self) -> Text:
        """The reason, with its places and moments kept as values that can be spelled."""
        return self.cause.text if self.cause else Text(self.reason)

    def located_reason(self, place: PlaceSpelling, moment: MomentSpelling = in_seconds) -> str:
        """The reason, with places (2,), m, and moments spelled by functions, such as in lon/lat."""
        return self.text.spelled(place, moment)

    def __reduce__(self) -> tuple[type[Rejected], tuple[object, ...]]:
        """Pickle the fuel, not its source: the current may be a function that can't be pickled."""
        *others, _ = (getattr(self, one.name) for one in fields(self))
        return Rejected, (*others, self.unpadded_fuel)


@dataclass(frozen=True, eq=False)
class TradeOff:
    """Least fuel for each arrival, where speeds are chosen: it shows what an hour more saves.

    Attributes
    ----------
    arrivals : (n,) s, ascending: from the earliest, at the highest speed, to the one after which a
        later arrival saves no more fuel.
    fuels : (n,) fuel units, falling: for each arrival the fuel of the plan's cheapest path, at its
        best speeds for that arrival. Where the current changes, only the first few paths are tried.
        Another path may be a little cheaper at arrivals near the planned one, and more so far from
        it: 5 % has been seen at the last arrival.
    """

    arrivals: FloatArray
    fuels: FloatArray


@dataclass(frozen=True, eq=False)
class Plan:
    """Routes, one per feasible class, least fuel first; and the classes without a route.

    `chosen` is the index of the best route: 0, except for the sampled method, which picks the class
    by the harmonic mean over its sampled paths (paper). `overpowering` is the water that was no-go
    because its current is as strong as the vessel is fast: empty, or polygons in metres. `shut` are
    areas that a route of less fuel might have entered while they are shut.
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
        if not self.routes:  # only if built by hand: plan() raises an error instead
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
    """Outcome of one departure (s): figures of the best route, or the error if there is none."""

    departure: float
    arrival: float = math.inf
    fuel: float = math.inf
    path: FloatArray | None = None
    times: FloatArray | None = None
    homotopy: str = ""
    cause: PlanningError | None = None


@dataclass(frozen=True, eq=False)
class Departures:
    """The best route of each departure that was planned, and the best departure.

    Attributes
    ----------
    departures : (n,) s, ascending: those asked for, and those planned between them.
    arrivals : (n,) s; inf where no class can be sailed. A departure arrives no later than
        those after it, unless the padding for its hours leaves it less room.
    fuels : (n,) fuel units; inf where no class can be sailed.
    paths : the paths (m, 2), m; None where no class can be sailed.
    times : when the points of each path are passed (m,), s; None where there is none.
    homotopies : the name of each path's class; empty where there is none.
    causes : the error that says why no class can be sailed; None where one can.
    unproven : time (s) by which a departure between those planned may still beat the best one, to
        within the error of the paths that were found; inf where the current reaches the vessel's
        speed in places.
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
        """Why no class can be sailed, by departure; empty where one can."""
        return tuple("" if cause is None else str(cause) for cause in self.causes)

    @property
    def durations(self) -> FloatArray:
        """Times under way (n,), s."""
        return self.arrivals - self.departures

    @property
    def best(self) -> int:
        """Index of the departure that takes least fuel, the earliest of those that do."""
        return int(self.fuels.argmin())
