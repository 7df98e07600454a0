"""Options and arguments of a plan, with their ranges and checks."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal, TypeAlias, TypedDict, TypeGuard, get_args

import numpy as np

from renew._types import FloatArray
from renew.errors import ParameterError, as_floats, check_kind, is_finite, is_number, shown
from renew.inputs.chart_and_vessel import Chart, Vessel
from renew.inputs.openings import ShutArea, TidalDepth

Padding: TypeAlias = Literal["adaptive", "triangle", "none"] | float
DistinctBy: TypeAlias = Literal["auto"] | float
Method: TypeAlias = Literal["optimal", "sampled"]
Drift: TypeAlias = Literal["projected", "crab"]
RiskAt: TypeAlias = Literal["route", "point"]
Order: TypeAlias = Literal["fuel", "length", "depth-first"]
Shortfall: TypeAlias = Literal["refuse", "least"]

MAX_SEED = 2**63 - 1
"""Largest seed of draws."""

_CHOICES = {
    "method": Method,
    "drift": Drift,
    "order": Order,
    "risk_at": RiskAt,
    "shortfall": Shortfall,
}


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """How a voyage is planned; ``renew.plan(..., risk=0.1)`` changes one option.

    Parameters
    ----------
    classes : int
        Number of homotopy classes to give a route for, k >= 1; fewer where fewer can be sailed.
    risk : float
        1 - σ in (0, 1): the share of drawn turns that may reach beyond the padding of a triangle.
        At least 1e-9, six standard deviations: below that no padding can be computed. Padding that
        is fitted to a route's turns begins with it, or with 0.05 if this is less, and where that
        costs much with 0.5 as well; then all deviations of the current up to two standard
        deviations must leave the turns clear of land.
    padding : "adaptive", "triangle", "none" or float
        Padding adapted to the current, the direction and the vessel: for each triangle that the way
        crosses (paper, ``"triangle"``), and then fitted to the turns of its own legs
        (``"adaptive"``); or none, or the same width (m) on every constrained edge.
    clearance : float
        Floor on the padding (m).
    narrow_share : float
        In passages too narrow for the clearance, the clearance is reduced to this share of the
        distance between land and the middle of the passage. 1: it is never reduced. The padding for
        turns is never reduced either.
    distinct_by : float or "auto"
        Classes that differ only by islands smaller than this (m) count as one class.
        "auto": only the few largest islands near the route tell classes apart; all other islands
        are ignored.
    method : {"optimal", "sampled"}
        Dynamic programming inside each class, or the paper's random chains.
    samples : int
        Chains a class, for ``"sampled"``.
    drift : {"projected", "crab"}
        Drift model of Eq. 4; see :mod:`renew.voyage.fuel`.
    seed : int
        Seed of all draws; the same seed gives the same plan.
    order : {"fuel", "length", "depth-first"}
        Which k classes: the cheapest or the shortest along their midlines, or the first of a
        depth-first search (paper).
    risk_at : {"route", "point"}
        Where adaptive padding meets the risk: on the way through each triangle (paper), or from
        every point of the final route as well, on its own heading.
    lateness : float
        Share of the time since departure by which the vessel may be early or late. With adaptive
        padding it can turn away at all these times. Has no effect in a steady current.
    min_lateness : float
        Time (s) by which it may be early or late at least, but not before the departure.
    gap_to : float
        Optimality gap of the best route at which the lower bound on fuel is tight enough, such as
        0.02: until then its grid is refined. With 0 it is as tight as about half a second of work
        makes it.
    shortfall : {"refuse", "least"}
        What to do where no way keeps the padding: refuse the voyage, or keep as much of the padding
        as there is room for, and list each stretch without; see :attr:`renew.Route.shortfalls`. A
        clearance yields only as far as `narrow_share` lets it.
    adrift : float, optional
        Time (s) that a vessel without thrust takes to land at least, from anywhere on a route, in a
        current that does not change; any if left out. Classes that can't keep it are rejected.
        Where it can't be had near start and goal, it counts from the first place to the last where
        it can.
    adrift_ends : float
        How far from start and goal these places lie at most (m); else the voyage is refused.

    Raises
    ------
    ParameterError
        Options out of range; names all of them.
    """

    # Ranges are given in the words of the scenario's models: ge is >=, le is <=, lt is <.
    classes: int = field(default=16, metadata={"ge": 1, "le": 10_000})
    risk: float = field(default=0.05, metadata={"ge": 1e-9, "lt": 1})
    padding: Padding = field(default="adaptive")
    clearance: float = field(default=0.0, metadata={"ge": 0})
    narrow_share: float = field(default=1.0, metadata={"ge": 0.01, "le": 1})
    distinct_by: DistinctBy = field(default=0.0)
    method: Method = field(default="optimal")
    samples: int = field(default=500, metadata={"ge": 1, "le": 1_000_000})
    drift: Drift = field(default="projected")
    seed: int = field(default=0, metadata={"ge": 0, "le": MAX_SEED})
    order: Order = field(default="fuel")
    risk_at: RiskAt = field(default="route")
    lateness: float = field(default=0.05, metadata={"ge": 0, "lt": 1})
    min_lateness: float = field(default=0.0, metadata={"ge": 0})
    gap_to: float = field(default=0.0, metadata={"ge": 0, "lt": 1})
    shortfall: Shortfall = field(default="refuse")
    adrift: float | None = field(default=None)
    adrift_ends: float = field(default=20_000.0, metadata={"ge": 0})

    def __post_init__(self) -> None:
        """Refuse options out of range; the error names all faults."""
        faults = self._faults()
        if faults:
            raise ParameterError("; ".join(faults))

    @property
    def is_adaptive(self) -> bool:
        """Whether padding follows current, direction and vessel."""
        return is_one_of(self.padding, ("adaptive", "triangle"))

    @property
    def may_fall_short(self) -> bool:
        """Whether padding may keep only as much as there is room for."""
        asked = is_one_of(self.shortfall, ("least",)) and is_one_of(self.method, ("optimal",))
        return asked and self.is_adaptive

    @property
    def fixed_width(self) -> float:
        """Width (m) of every padding before a clearance widens it; 0 if padding adapts."""
        return 0.0 if isinstance(self.padding, str) else float(self.padding)

    @property
    def min_width(self) -> float:
        """Least width (m) of any padding, except in narrows where the clearance is reduced."""
        return max(self.fixed_width, self.clearance)

    def likely_width(self, turning_radius: float, kept: float = 1.0) -> float:
        """Width (m) that nearly no padding falls below: a turn reaches further than its radius.

        Narrow water may leave only a share `kept` of it.
        """
        least = self.min_width if self.narrow_share == 1.0 else self.fixed_width
        return max(least, kept * turning_radius if self.is_adaptive else 0.0)

    def _faults(self) -> list[str]:
        faults = [
            fault
            for name in ("classes", "samples", "seed")
            for fault in count_faults(name, getattr(self, name))
        ]
        for name, words, metres in (
            (
                "padding",
                ("adaptive", "triangle", "none"),
                '"adaptive", "triangle", "none" or finite metres of at least 0',
            ),
            ("distinct_by", ("auto",), '"auto" or finite metres of at least 0'),
        ):
            value = getattr(self, name)
            if not is_one_of(value, words) and not is_length(value):
                faults.append(f"{name} = {shown(value)} must be {metres}")
        for name, unit in (("clearance", "m"), ("adrift", "s"), ("adrift_ends", "m")):
            value = getattr(self, name)
            if not is_length(value) and not (name == "adrift" and value is None):
                faults.append(f"{name} = {shown(value)} {unit} must be finite and at least 0")
        least, most = RANGES["narrow_share"].values()
        if not (is_number(self.narrow_share) and least <= self.narrow_share <= most):
            faults.append(
                f"narrow_share = {shown(self.narrow_share)} must lie between {least:g} and {most:g}"
            )
        least = RANGES["risk"]["ge"]
        if not (is_number(self.risk) and least <= self.risk < 1):
            faults.append(f"risk = {shown(self.risk)} must lie between {least:g} and 1, as in 0.05")
        if not (is_number(self.gap_to) and 0 <= self.gap_to < RANGES["gap_to"]["lt"]):
            faults.append(f"gap_to = {shown(self.gap_to)} must be 0 or more, below 1, as in 0.02")
        faults += [fault for name in _CHOICES for fault in choice_faults(name, getattr(self, name))]
        if is_one_of(self.risk_at, ("point",)) and not self.is_adaptive:
            faults.append(
                f'risk_at = "point" needs padding = "adaptive", not {shown(self.padding)}'
            )
        return faults + punctuality_faults(self.lateness, self.min_lateness)


class Changes(TypedDict, total=False):
    """Options by name that replace those of a `PlanOptions`."""

    classes: int
    risk: float
    padding: Padding
    clearance: float
    narrow_share: float
    distinct_by: DistinctBy
    method: Method
    samples: int
    drift: Drift
    seed: int
    order: Order
    risk_at: RiskAt
    lateness: float
    min_lateness: float
    gap_to: float
    shortfall: Shortfall
    adrift: float | None
    adrift_ends: float


RANGES = {option.name: option.metadata for option in fields(PlanOptions) if option.metadata}
"""Ranges of the options that have one."""


def count_faults(name: str, value: object) -> list[str]:
    """Faults of a whole number."""
    least, most = RANGES[name]["ge"], RANGES[name]["le"]
    if is_number(value) and isinstance(value, int | np.integer) and least <= value <= most:
        return []
    return [f"{name} = {shown(value)} must be a whole number from {least} to {most:,}"]


def choice_faults(name: str, value: object) -> list[str]:
    """Return the fault of an option whose value must be one of some words."""
    words = get_args(_CHOICES[name])
    if is_one_of(value, words):
        return []
    return [f"{name} = {shown(value)} is not one of {', '.join(words)}"]


def punctuality_faults(lateness: object, min_lateness: object) -> list[str]:
    """Faults of the shares and times by which the vessel may be late."""
    faults = []
    if not (is_finite(lateness) and 0 <= lateness < 1):
        faults.append(f"lateness = {shown(lateness)} must be a share of at least 0 and below 1")
    if not is_length(min_lateness):
        faults.append(f"min_lateness = {shown(min_lateness)} s must be finite and at least 0")
    return faults


def is_one_of(value: object, words: tuple[str, ...]) -> bool:
    """Whether a value is one of some words."""
    return isinstance(value, str) and value in words


def is_length(value: object) -> TypeGuard[float]:
    """Whether a value is a finite number of metres, at least 0."""
    return is_finite(value) and value >= 0


def is_row(value: object) -> TypeGuard[Sequence[Any] | FloatArray]:
    """Whether a value is a sequence, and not text."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


MAX_STATIONS = 1_000_000
"""Largest number of points along a route from which turns are simulated."""
MAX_DEPARTURES = 10_000
"""Largest number of departures that are asked for at once."""

ViaPoints: TypeAlias = Sequence[FloatArray | tuple[float, float]] | FloatArray


def check_objects(
    chart: Chart, vessel: Vessel, avoid: Sequence[ShutArea] = (), depth: TidalDepth | None = None
) -> None:
    """Refuse a chart, vessel, areas or depth of another type."""
    check_kind("chart", chart, Chart)
    check_kind("vessel", vessel, Vessel)
    if not is_row(avoid):
        raise ParameterError(f"avoid = {shown(avoid)} must be areas in a row, as in [area]")
    for at, area in enumerate(avoid):
        check_kind(f"avoid[{at}]", area, ShutArea)
    if depth is not None:
        check_kind("depth", depth, TidalDepth)


def check_turns(
    chart: Chart,
    vessel: Vessel,
    length: float,
    *,
    spacing: object,
    seed: object,
    late: tuple[object, object],
) -> None:
    """Refuse arguments with which :func:`renew.contingency` can't simulate turns.

    The path is `length` m long; `late` are the share of the time and the time (s) by which the
    vessel may be late.
    """
    check_objects(chart, vessel)
    faults = punctuality_faults(*late) + count_faults("seed", seed)
    if not (is_finite(spacing) and spacing > 0):
        faults.append(f"spacing = {shown(spacing)} m must be finite and above 0")
    elif length > MAX_STATIONS * spacing:
        faults.append(
            f"spacing = {spacing:g} m is too close for a path of {length:.4g} m: turns would begin "
            f"at more than {MAX_STATIONS:,} points; take {length / MAX_STATIONS:.2g} m or more"
        )
    if faults:
        raise ParameterError("; ".join(faults))


def check_seed(seed: object) -> None:
    """Refuse a value that can't be a seed."""
    for fault in count_faults("seed", seed):
        raise ParameterError(fault)


def as_point(name: str, value: FloatArray | tuple[float, float]) -> FloatArray:
    """Return a start or goal as an array (2,)."""
    point = as_floats(name, value)
    if point.shape != (2,) or not np.isfinite(point).all():
        raise ParameterError(f"{name} = {shown(value)} must be two finite numbers (m)")
    return point


def as_via(given: ViaPoints) -> FloatArray:
    """Return via points as an array (n, 2), m; the error names all faulty ones."""
    if not is_row(given):
        raise ParameterError(f"via = {shown(given)} must be points (m) in a row, as in [(x, y)]")
    points, faults = [], []
    for at, value in enumerate(given):
        try:
            points.append(as_point(f"via[{at}]", value))
        except ParameterError as error:
            faults.append(str(error))
    if faults:
        raise ParameterError("; ".join(faults))
    return np.array(points).reshape(-1, 2)


def as_departures(departures: Sequence[float] | FloatArray) -> FloatArray:
    """Return departures as an array (n,), s; refuse times that don't ascend."""
    times = as_floats("departures", departures)
    if times.ndim != 1 or not 1 <= times.size <= MAX_DEPARTURES or not np.isfinite(times).all():
        raise ParameterError(
            f"departures must be 1 to {MAX_DEPARTURES:,} finite times (s) in a row"
        )
    for at in np.flatnonzero(np.diff(times) <= 0).tolist():
        raise ParameterError(
            f"departures[{at + 1}] = {times[at + 1]:g} s does not come after "
            f"departures[{at}] = {times[at]:g} s"
        )
    return times
