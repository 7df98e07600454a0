"""What a plan consists of: routes with their figures, and rejected classes with their reasons.

While a plan is at work, it tells its steps, and the paths that it has found so far.
"""

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field, fields
from functools import cached_property
from html import escape
from typing import Literal, NamedTuple

import numpy as np
import shapely

from renew._types import FloatArray
from renew.bounds.fuel_lower_bound import FuelBound
from renew.classes.dual_graph import Channel, visits
from renew.errors import PlanningError, Strait, Text, UnreachableError, from_until
from renew.inputs.openings import LeastWater, Opening
from renew.request import Request

# Width of the map, CSS pixels; its height follows, up to twice as much.
_WIDTH = 420.0
# Colours of the routes, best first (Okabe and Ito: distinguishable with any colour vision).
_COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
# Number of routes that are drawn and listed.
_MAX_ROUTES = len(_COLOURS)


class OverpoweredHours(NamedTuple):
    """Water that the current shuts for a while, on the way of a class.

    From `begin` until `end` (s) the current at `place` (2,), m, is nearly as strong as the vessel
    is fast, or stronger, and the vessel may be there or may have to wait there. In a stretch of
    such water, `place` is where these hours last longest. The times are infinite where the current
    is held before its first time or after its last.
    """

    place: FloatArray
    begin: float
    end: float

    @property
    def text(self) -> Text:
        """The hours as a text that names their moments on the current's clock."""
        return from_until(self.begin, self.end, on=" on")


class Shortfall(NamedTuple):
    """A stretch of a route on which not every hard-over turn is free, from `begin` to `end`.

    Both are metres along the route's path. A full turn there needs up to `needed` metres to a side;
    at the tightest place there is room for a turn that needs `kept` metres, in steps of 5 %: in
    still water these are the diameter of the turning circle, and of the one that fits.
    """

    begin: float
    end: float
    needed: float
    kept: float


# Steps of the share that falls short, by which routes are compared.
_STEPS = 20


@dataclass(frozen=True, eq=False)
class Route:
    """The least-fuel path found in one homotopy class.

    Attributes
    ----------
    path : (n, 2) metres, start to goal.
    trajectory : (m, 4) of t (s), x, y (m) and heading (rad): the path as it is steered, with times
        on the current's clock.
    fuel : Eq. 4 along the path (fuel units; seconds for the paper's vessel).
    length : metres; true ones on a chart with a `point_scale`.
    clearance : least distance from the path to the hard no-go zone (m); inf on an empty chart.
    duration : time under way by the drift model (s).
    times : (n,) s, when the path's points are passed, on the current's clock; the first is the
        departure.
    speeds : (n - 1,) m/s, the speed through water at which each leg of the path is sailed.
    fuel_bound : the least fuel that any route can need; computed when first asked for.
    homotopy : the class's name: islands passed on their +y side, in order. "s2.p1" leaves the
    second to starboard and then the first to port; the largest island is 1.
    corners : (t, 3, 2) metres, the triangles in which its path was planned.
    padding_used : (e, 5) x0, y0, x1, y1, padding: every constrained edge next to the channel (m).
    turn_padding : (e,) m, what of it hard-over turns need; where it is wider, the clearance is.
    harmonic_mean : harmonic mean of the fuel of the class's sampled paths (sampled method), or
        the path's own fuel.
    starts_in_soft_no_go, ends_in_soft_no_go : the first or the last legs lie partly in V.
    overpowered : water on the class's way that the current shuts for a while, in the order in which
        it is passed: the route is the best without waiting.
    least_water : where the tide exceeds the need least; None without tidal depths on the way.
    shortfalls : stretches without room for a hard-over turn, in order; known if the plan may keep
        less than the padding (`shortfall="least"`), and empty where every turn is free.
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
    turn_padding: FloatArray
    harmonic_mean: float
    starts_in_soft_no_go: bool
    ends_in_soft_no_go: bool
    overpowered: tuple[OverpoweredHours, ...] = ()
    least_water: LeastWater | None = None
    shortfalls: tuple[Shortfall, ...] = ()
    _zone: list[shapely.Geometry] = field(default_factory=list, init=False, repr=False)

    @cached_property
    def channel(self) -> FloatArray:
        """Triangles (t, 3, 2) that the path crosses, from start to goal, in metres."""
        crossed = dict.fromkeys(visits(self.path, self.corners).triangle.tolist())
        return np.asarray(self.corners[list(crossed)])

    @property
    def soft_no_go(self) -> shapely.Geometry:
        """The soft no-go zone V of this class: its padded edges, buffered."""
        if not self._zone:
            unite_soft_no_go([self])
        return self._zone[0]

    @property
    def lacking(self) -> tuple[int, float]:
        """The greatest share of a turn for which there is no room, in steps, and metres of it."""
        worst = max((1 - one.kept / one.needed for one in self.shortfalls), default=0.0)
        return round(_STEPS * worst), sum(one.end - one.begin for one in self.shortfalls)

    @property
    def fuel_per_distance(self) -> float:
        """Fuel per metre of path (the paper's F/D)."""
        return self.fuel / self.length

    @property
    def optimality_gap(self) -> float:
        """Share by which the fuel exceeds the lower bound over all classes of the chart, >= 0.

        The bound knows no padding and no turning circle: the gap includes what safety costs.
        """
        return self.fuel_bound.gap(self.fuel)


def unite_soft_no_go(routes: Sequence[Route]) -> None:
    """Compute V of several routes together, which takes half the time, and keep it with them.

    Routes on one chart share most of their padded edges: edges of the same routes are united once.
    """
    if all(route._zone for route in routes):  # noqa: SLF001 - kept by an earlier call
        return
    padded = [route.padding_used[route.padding_used[:, 4] > 0] for route in routes]
    rows, row = np.unique(np.vstack(padded), axis=0, return_inverse=True)
    shared = np.zeros((len(rows), len(padded)), dtype=bool)
    shared[row.ravel(), np.repeat(np.arange(len(padded)), [len(edges) for edges in padded])] = True
    members, group = np.unique(shared, axis=0, return_inverse=True)
    lines = shapely.linestrings(rows[:, :4].reshape(-1, 2, 2))
    capsules = shapely.buffer(lines, rows[:, 4], quad_segs=16)
    parts = [shapely.union_all(capsules[group.ravel() == number]) for number in range(len(members))]
    for at, route in enumerate(routes):
        # Most islands' paddings are apart: only parts that meet are overlaid.
        own = [parts[number] for number in np.flatnonzero(members[:, at])]
        zone = shapely.disjoint_subset_union_all(own) if own else shapely.MultiPolygon()
        route._zone[:] = [zone]  # noqa: SLF001


@dataclass(frozen=True, eq=False)
class Rejected:
    """A class without a route.

    Attributes
    ----------
    homotopy : its name.
    reason : why, as a sentence; `text.spelled` spells its places in another way.
    channel : (t, 3, 2) metres, its triangles from start to goal.
    strait : where padding fills a whole gap, if that is the reason.
    cause : the error behind the reason; its places are in metres.
    overpowered : water on its way that the current shuts for a while.
    ways : its channels in which no path was found; empty after unpickling.
    fuel_source : `unpadded_fuel`, or a function that computes it.
    """

    homotopy: str
    reason: str
    channel: FloatArray
    strait: Strait | None = None
    cause: PlanningError | None = None
    overpowered: tuple[OverpoweredHours, ...] = ()
    ways: tuple[Channel, ...] = field(default=(), repr=False)
    fuel_source: float | Callable[[], float] = field(default=math.inf, repr=False)

    @classmethod
    def of_route(cls, route: Route, cause: PlanningError) -> "Rejected":
        """Return the class of a route that was found, and can't be taken."""
        return cls(route.homotopy, str(cause), route.channel, cause=cause, fuel_source=route.fuel)

    def __post_init__(self) -> None:
        """Drop tracebacks: they hold the variables of the search, of megabytes, and themselves."""
        error: BaseException | None = self.cause
        while error is not None:
            error.__traceback__ = None
            error = error.__cause__ or error.__context__

    @cached_property
    def unpadded_fuel(self) -> float:
        """Fuel that the class would need without any padding; inf if it has no path even then.

        Computed when first asked for. Compared with the routes' fuel, it shows what the padding
        costs.
        """
        return self.fuel_source() if callable(self.fuel_source) else self.fuel_source

    @property
    def text(self) -> Text:
        """The reason, with its places and moments kept as values that can be spelled."""
        return self.cause.text if self.cause else Text(self.reason)

    def __reduce__(self) -> "tuple[type[Rejected], tuple[object, ...]]":
        """Pickle the fuel, not its source: the current may be a function that can't be pickled."""
        *others, _, _ = (getattr(self, attribute.name) for attribute in fields(self))
        return Rejected, (*others, (), self.unpadded_fuel)


@dataclass(frozen=True, eq=False)
class TradeOff:
    """Least fuel for each arrival, where speeds are chosen: it shows what an hour more saves.

    Attributes
    ----------
    arrivals : (n,) s, ascending: from the earliest, at the highest speed, to the one after which a
        later arrival saves no more fuel.
    fuels : (n,) fuel units, falling: for each arrival the fuel of the plan's cheapest path, at its
        best speeds for that arrival. Where the current changes, only the first few paths are tried.
        Another path may be a little cheaper at arrivals near the planned one, and much cheaper at
        distant ones: 5 % has been seen at the last arrival.
    """

    arrivals: FloatArray
    fuels: FloatArray


@dataclass(frozen=True, repr=False, eq=False)
class Plan:
    """Routes, one per feasible class, least fuel first; and the classes without a route.

    `chosen` is the index of the best route: 0, except for the sampled method, which picks the class
    by the harmonic mean over its sampled paths (paper). `overpowering` is the water that was no-go
    because its current is as strong as the vessel is fast: empty, or polygons in metres. `shut` are
    areas that a route of less fuel might have entered while they are shut.
    `trade_off` is there where speeds were chosen. `voyage` is what was asked, for `renew.replan`; a
    pickle is without it, because a current may be any function.
    """

    routes: tuple[Route, ...]
    rejected: tuple[Rejected, ...]
    chosen: int = 0
    overpowering: shapely.Geometry = field(default_factory=shapely.MultiPolygon)
    shut: tuple[Opening, ...] = ()
    trade_off: TradeOff | None = None
    voyage: Request | None = None

    def __getstate__(self) -> dict[str, object]:
        """Return what a pickle holds."""
        return {**vars(self), "voyage": None}

    @property
    def best(self) -> Route:
        """The route to take."""
        if not self.routes:  # only if built by hand: plan() raises an error instead
            raise UnreachableError("the plan holds no route")
        return self.routes[self.chosen]

    def __repr__(self) -> str:
        """Return the figures of the first routes, in ten lines at most."""
        shown = self.routes[:_MAX_ROUTES]
        rows = [f"  {one.homotopy}: fuel {one.fuel:.1f}, {one.length:.1f} m" for one in shown]
        routes, classes = len(self.routes), len(self.rejected)
        head = (
            f"{routes} route{'s' * (routes != 1)}, {classes} class{'es' * (classes != 1)} rejected"
        )
        return "\n".join([head, *rows, *["  ..."] * (len(self.routes) > len(shown))])

    def _repr_html_(self) -> str:
        """Return a map and a table for a notebook, without the optimality gap, which takes time."""
        if not self.routes:
            return f"<p>No route; {len(self.rejected)} classes were rejected.</p>"
        return _plan_html(self)


@dataclass(frozen=True, eq=False)
class Departures:
    """The best route of each departure that was planned, and the best departure.

    Attributes
    ----------
    departures : (n,) s, ascending: the departures asked for, and more planned between them.
    arrivals : (n,) s; inf where no class can be sailed. A departure arrives no later than later
        departures, unless the padding for its hours leaves it less room.
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
        """Index of the departure of least fuel; of equals, the earliest."""
        return int(self.fuels.argmin())


def _plan_html(plan: Plan) -> str:
    """Return a map of routes over their channels, and their figures; best first, six at most."""
    shown = plan.routes[:_MAX_ROUTES]
    points = np.concatenate(
        [route.path for route in shown] + [route.channel.reshape(-1, 2) for route in shown]
    )
    low, high = points.min(axis=0), points.max(axis=0)
    scale = _WIDTH / max(high[0] - low[0], (high[1] - low[1]) / 2, 1e-9)
    width, height = ((high - low) * scale).tolist()

    def place(xy: FloatArray) -> str:
        pixels = np.stack([(xy[:, 0] - low[0]) * scale, (high[1] - xy[:, 1]) * scale], axis=1)
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in pixels)

    water = [f'<polygon points="{place(triangle)}"/>' for one in shown for triangle in one.channel]
    zones = [
        f'<polygon points="{place(np.asarray(part.exterior.coords))}"/>'
        for part in shapely.get_parts(plan.best.soft_no_go)
        if part.geom_type == "Polygon"
    ]
    paths = [
        f'<polyline points="{place(route.path)}" stroke="{_COLOURS[rank]}" '
        f'stroke-width="{3 if rank == plan.chosen else 1.5}"/>'
        for rank, route in reversed(list(enumerate(shown)))
    ]
    ends = [
        f'<circle cx="{xy.split(",")[0]}" cy="{xy.split(",")[1]}" r="4"/>'
        for xy in (place(shown[0].path[[0]]), place(shown[0].path[[-1]]))
    ]
    rows = [
        f'<tr><td><span style="color:{_COLOURS[rank]}" aria-hidden="true">━</span> {rank + 1}</td>'
        f"<td>{escape(route.homotopy)}</td><td>{route.fuel:.1f}</td>"
        f"<td>{route.length:.1f} m</td><td>{np.floor(10 * route.clearance) / 10:.1f} m</td></tr>"
        for rank, route in enumerate(shown)
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" width="{width:.0f}" '
        f'height="{height:.0f}" viewBox="-6 -6 {width + 12:.1f} {height + 12:.1f}" '
        'style="max-width:100%;height:auto;background:#fff">'
        f"<title>{len(shown)} routes, the best as the thickest line</title>"
        f'<g fill="#e3eff8" stroke="#c4d9e8" stroke-width="0.5">{"".join(water)}</g>'
        f'<g fill="#f2b134" fill-opacity="0.45">{"".join(zones)}</g>'
        f'<g fill="none" stroke-linejoin="round">{"".join(paths)}</g>'
        f'<g fill="#222">{"".join(ends)}</g></svg>'
        "<table><thead><tr><th></th><th>class</th><th>fuel</th><th>length</th>"
        f"<th>clear of land</th></tr></thead><tbody>{''.join(rows)}</tbody></table>"
    )


@dataclass(frozen=True, slots=True)
class Step:
    """A step of a plan.

    "class": a way round the islands is tried; "padding": hard-over turns along it meet land, so its
    padding grows; "path": it has a `path` (n, 2), planar metres, whose turns are clear. Later steps
    may find a better one of the same class.
    """

    kind: Literal["class", "padding", "path"]
    path: FloatArray | None = None


_watcher: ContextVar[Callable[[Step], None] | None] = ContextVar("watcher", default=None)


@contextlib.contextmanager
def watched(watcher: Callable[[Step], None] | None) -> Iterator[None]:
    """Have the plans of this thread tell their steps inside the `with` block; None: to nobody."""
    earlier = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(earlier)


def tell(step: Step) -> None:
    """Tell a step to the watcher, if there is one."""
    watcher = _watcher.get()
    if watcher is not None:
        watcher(step)
