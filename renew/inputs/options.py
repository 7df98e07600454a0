"""How a voyage is planned: the options of a plan, with their defaults and ranges."""

from dataclasses import dataclass, field, fields
from typing import Literal, TypeAlias, TypedDict, TypeGuard, get_args

import numpy as np

from renew.errors import ParameterError
from renew.inputs.figures import is_finite, is_number, shown

Padding: TypeAlias = Literal["adaptive", "none"] | float
DistinctBy: TypeAlias = Literal["auto"] | float
Method: TypeAlias = Literal["optimal", "sampled"]
Drift: TypeAlias = Literal["projected", "crab"]
RiskAt: TypeAlias = Literal["route", "point"]
Order: TypeAlias = Literal["fuel", "length", "depth-first"]

MAX_SEED = 2**63 - 1
"""Largest seed of draws."""

_CHOICES = {"method": Method, "drift": Drift, "order": Order, "risk_at": RiskAt}


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """How a voyage is planned; ``renew.plan(..., risk=0.1)`` changes one option.

    Parameters
    ----------
    classes : int
        Number of homotopy classes to give a route for, k >= 1; fewer where fewer can be sailed.
    risk : float
        1 - σ in (0, 1): the share of drawn turns that may reach beyond the padding. At least 1e-9,
        six standard deviations: below that no padding can be computed.
    padding : "adaptive", "none" or float
        Adaptive padding (paper), none, or the same width (m) on every constrained edge.
    clearance : float
        Floor on the padding (m).
    distinct_by : float or "auto"
        Classes that differ only by islands smaller than this (m) count as one, with its best path.
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
        Share of the time since departure by which the vessel may be early or late anywhere: with
        adaptive padding it can turn away at all these times. Of no effect in a steady current.
    min_lateness : float
        Time (s) by which it may be early or late at least, but not before the departure.

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
    distinct_by: DistinctBy = field(default=0.0)
    method: Method = field(default="optimal")
    samples: int = field(default=500, metadata={"ge": 1, "le": 1_000_000})
    drift: Drift = field(default="projected")
    seed: int = field(default=0, metadata={"ge": 0, "le": MAX_SEED})
    order: Order = field(default="fuel")
    risk_at: RiskAt = field(default="route")
    lateness: float = field(default=0.05, metadata={"ge": 0, "lt": 1})
    min_lateness: float = field(default=0.0, metadata={"ge": 0})

    def __post_init__(self) -> None:
        """Refuse options out of range; all faults at once."""
        faults = self._faults()
        if faults:
            raise ParameterError("; ".join(faults))

    @property
    def is_adaptive(self) -> bool:
        """Whether padding follows current, direction and vessel."""
        return self.padding == "adaptive"

    @property
    def min_width(self) -> float:
        """Width (m) that every padding has at least."""
        fixed = 0.0 if isinstance(self.padding, str) else float(self.padding)
        return max(fixed, self.clearance)

    def likely_width(self, turning_radius: float) -> float:
        """Width (m) that hardly any padding stays below: a turn is twice as wide as its radius."""
        return max(self.min_width, turning_radius if self.is_adaptive else 0.0)

    def _faults(self) -> list[str]:
        """What is wrong with the options."""
        found = [
            fault
            for name in ("classes", "samples", "seed")
            for fault in count_faults(name, getattr(self, name))
        ]
        for name, words, metres in (
            ("padding", ("adaptive", "none"), '"adaptive", "none" or finite metres of at least 0'),
            ("distinct_by", ("auto",), '"auto" or finite metres of at least 0'),
        ):
            value = getattr(self, name)
            if not is_one_of(value, words) and not is_length(value):
                found.append(f"{name} = {shown(value)} must be {metres}")
        if not is_length(self.clearance):
            found.append(f"clearance = {shown(self.clearance)} m must be finite and at least 0")
        least = RANGES["risk"]["ge"]
        if not (is_number(self.risk) and least <= self.risk < 1):
            found.append(f"risk = {shown(self.risk)} must lie between {least:g} and 1, as in 0.05")
        found += [fault for name in _CHOICES for fault in choice_faults(name, getattr(self, name))]
        if is_one_of(self.risk_at, ("point",)) and not is_one_of(self.padding, ("adaptive",)):
            found.append(f'risk_at = "point" needs padding = "adaptive", not {shown(self.padding)}')
        return found + punctuality_faults(self.lateness, self.min_lateness)


class Changes(TypedDict, total=False):
    """Options by name, in place of some of a `PlanOptions`."""

    classes: int
    risk: float
    padding: Padding
    clearance: float
    distinct_by: DistinctBy
    method: Method
    samples: int
    drift: Drift
    seed: int
    order: Order
    risk_at: RiskAt
    lateness: float
    min_lateness: float


RANGES = {one.name: one.metadata for one in fields(PlanOptions) if one.metadata}
"""Ranges of the options that have one."""


def count_faults(name: str, value: object) -> list[str]:
    """What is wrong with a whole number."""
    least, most = RANGES[name]["ge"], RANGES[name]["le"]
    if is_number(value) and isinstance(value, int | np.integer) and least <= value <= most:
        return []
    return [f"{name} = {shown(value)} must be a whole number from {least} to {most:,}"]


def choice_faults(name: str, value: object) -> list[str]:
    """What is wrong with an option that is one of some words."""
    words = get_args(_CHOICES[name])
    if is_one_of(value, words):
        return []
    return [f"{name} = {shown(value)} is not one of {', '.join(words)}"]


def punctuality_faults(lateness: object, min_lateness: object) -> list[str]:
    """What is wrong with how late the vessel may be."""
    found = []
    if not (is_finite(lateness) and 0 <= lateness < 1):
        found.append(f"lateness = {shown(lateness)} must be a share of at least 0 and below 1")
    if not is_length(min_lateness):
        found.append(f"min_lateness = {shown(min_lateness)} s must be finite and at least 0")
    return found


def is_one_of(value: object, words: tuple[str, ...]) -> bool:
    """Whether a value is one of some words."""
    return isinstance(value, str) and value in words


def is_length(value: object) -> TypeGuard[float]:
    """Whether a value is a finite number of metres, at least 0."""
    return is_finite(value) and value >= 0
