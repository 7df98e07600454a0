"""Sentences on a case: why to take this way, how sure that is, and how safe."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.findings import text
from pipeline.findings.result import RunCase
from pipeline.model import RouteMetrics

# Difference, as a share, below which two lengths are printed alike.
_SAME_LENGTH = 5e-4
# Difference, as a share, below which two figures of fuel are printed alike.
_SAME_FUEL = 5e-4
# Least share by which a bound exceeds the fuel that a sentence names.
_TELLING = 1e-3
_KILOMETRE_M = 1000.0
# A current is not mentioned if its mean speed is below this share of the vessel's, and no route
# gains or loses that much by it.
_NO_CURRENT = 0.01


# Why a route is taken though another needs less fuel: in narrow water, and by the sampled method.
_ROOMIER = "but leaves less room to turn hard over"
_LEAST_IN_THE_MEAN = "but its class needs more in the mean"


@dataclass(frozen=True)
class CaseFacts:
    """The facts for a case's sentences.

    `routes`, at least one, are best first; `current_speed` is the current's mean over the water,
    m/s. `other_sides_fuel` is a lower bound on the fuel of other sides than the best route's, if
    known. If the route `lacks_current`, the current on the way is not known, so nothing is proven.
    `is_narrow` says whether routes have stretches without room to turn.
    """

    routes: Sequence[RouteMetrics]
    current_speed: float = math.inf
    other_sides_fuel: float | None = None
    lacks_current: bool = False
    is_narrow: bool = False

    @property
    def best(self) -> RouteMetrics:
        """The route to take."""
        return self.routes[0]

    @property
    def rival(self) -> RouteMetrics | None:
        """Route to compare the best with: the best by another passage, else the next best.

        None if there is only one.
        """
        others = self.routes[1:]
        by_another = (r for r in others if r.main_passage != self.best.main_passage)
        return next(by_another, others[0] if others else None)

    @property
    def is_still(self) -> bool:
        """Whether there is no current to speak of."""
        gains = [abs(_gain(route)) for route in self.routes]
        return max([self.current_speed, *gains]) < _NO_CURRENT * self.best.speed_m_s

    def because(self) -> str:
        """Say in one sentence why the best route is the one to take."""
        rival = self.rival
        if rival is None:
            return "No other class that was planned has a route."
        cheapest = min(self.routes, key=lambda route: route.fuel)
        if cheapest.fuel < self.best.fuel * (1 - _SAME_FUEL):
            less = text.percent(1 - cheapest.fuel / self.best.fuel)
            why = _ROOMIER if self.is_narrow else _LEAST_IN_THE_MEAN
            return f"Route {cheapest.rank} needs {less} less fuel, {why}."
        than, _, island = rival.main_passage.partition(" ")
        if rival.main_passage == self.best.main_passage:
            than = "the next"
        elif not self.best.main_passage.endswith(f" {island}"):
            than = rival.main_passage
        length = _length_beside(self.best, rival, than)
        if self.lacks_current and self.best.length_m <= rival.length_m:
            return f"{length}."
        if self.is_still:
            return f"{length}; there is no current to speak of."
        return f"{length}, {_current_beside(self.best, rival, 1)}."

    def why_dearer(self, route: RouteMetrics) -> str:
        """Say in one sentence why a route needs more fuel than the best; empty if it doesn't."""
        if route.fuel <= self.best.fuel:
            return ""
        length = _length_beside(route, self.best, "the best route")
        if self.is_still or self.lacks_current:
            return f"{length}."
        return f"{length}, {_current_beside(route, self.best, -1)}."

    def lead(self) -> str:
        """Say how much more fuel the closest rival needs; empty where it needs no more."""
        rival = self.rival
        if rival is None or rival.fuel <= self.best.fuel:
            return ""
        more = text.percent(rival.fuel / self.best.fuel - 1)
        is_beside = rival.main_passage != self.best.main_passage
        way = f"best way {rival.main_passage}" if is_beside else "next best route"
        return f"The {way} needs {more} more fuel"

    def certainty(self) -> str:
        """Say whether the choice of side is proven; empty without a choice."""
        rival = self.rival
        if rival is None or rival.main_passage == self.best.main_passage:
            return ""
        if self.lacks_current:
            return "Not proven: the current on the way is not known."
        bound, best = self.other_sides_fuel, self.best
        if bound is not None and bound > best.fuel:
            more = bound / best.fuel - 1
            # The bound may be hardly above the best route's fuel.
            needs = f"at least {text.at_least_percent(more)} more" if more >= _TELLING else "more"
            return f"Proven in this current: any other side needs {needs}."
        # The gap is above the bound for all sides, which may be the better one.
        gap = best.optimality_gap if best.optimality_gap >= 0 else math.inf
        saved = 1 - 1 / (1 + gap)
        sides = "any"
        if bound is not None and 1 - bound / best.fuel <= saved:
            saved, sides = 1 - bound / best.fuel, "the other"
        if saved > text.USEFUL_GAP / (1 + text.USEFUL_GAP):
            return "Not proven: no useful bound on the fuel of the other side is known."
        most = text.at_most_percent(saved)
        return f"Not proven: a way on {sides} side may save up to {most}."

    def verdict(self) -> tuple[str, ...]:
        """Explain why the best route was chosen, how sure that is, and how safe it is."""
        best, others, rival = self.best, self.routes[1:], self.rival
        is_side = rival is not None and rival.main_passage != best.main_passage
        name = f"The way {best.main_passage}" if is_side else "The best route"
        sentences = [f"{name} is the one to take.", self.because()]
        if lead := self.lead():
            sentences.append(f"{lead}.")
        if certain := self.certainty():
            sentences.append(certain)
        shorter = [r for r in others if r.length_m < best.length_m * (1 - _SAME_LENGTH)]
        if shorter:
            shortest = min(shorter, key=lambda r: r.length_m)
            sentences.append(
                f"{text.count(len(shorter), 'class is', 'classes are')} shorter; the shortest "
                f"(rank {shortest.rank}) saves {text.distance(best.length_m - shortest.length_m)} "
                f"and needs {_difference(shortest.fuel, best.fuel)} fuel."
            )
        elif others:
            sentences.append("It is also the shortest route found.")
        sentences.append(_safety(best))
        if not self.lacks_current and math.isfinite(best.optimality_gap):
            sentences.append(_bound(best))
        return tuple(sentences)


def case_facts(case: RunCase) -> CaseFacts | None:
    """Gather the facts for a case's sentences; None without a route."""
    if not case.routes:
        return None
    speeds = np.hypot(*case.current_samples()[1].T)
    return CaseFacts(
        [one.metrics for one in case.routes],
        float(speeds.mean()) if len(speeds) else 0.0,
        case.run.side_bounds().get(case.name),  # waits for it
        case.lacks_current,
        is_narrow=bool(case.measures.narrow),
    )


def _length_beside(one: RouteMetrics, other: RouteMetrics, than: str) -> str:
    """Say how a route's length compares with another's, which is called `than`."""
    less = other.length_m - one.length_m
    if abs(less) <= _SAME_LENGTH * one.length_m:
        return f"As long as {than}"
    kilometres = abs(less) >= _KILOMETRE_M
    by = text.number(abs(less) / (_KILOMETRE_M if kilometres else 1.0), 3)
    unit = "km" if kilometres else "m"
    return f"{by} {unit} {'shorter' if less > 0 else 'longer'} than {than}"


def _current_beside(one: RouteMetrics, other: RouteMetrics, sign: int) -> str:
    """Say what the current does to the speed on two routes.

    `sign` is 1 if the first needs less fuel, and -1 if it needs more: it sets the conjunction.
    """
    ours, theirs = _gain(one), _gain(other)
    if _signed(ours) == _signed(theirs):
        return f"and the current {_effect(ours)} on both"
    less = sign * (other.length_m - one.length_m)
    if less < -_SAME_LENGTH * one.length_m:
        joined = "but"
    else:
        joined = "and" if sign * (ours - theirs) >= 0 else "although"
    is_alike = ours * theirs > 0 and round(theirs, 2) and round(ours, 2)
    there = f"{abs(theirs):.2f}" if is_alike else _effect(theirs)
    return f"{joined} the current {_effect(ours)} ({there} there)"


def _safety(best: RouteMetrics) -> str:
    """Return the clearance of the best route, and the result of its hard-over turns."""
    no_go = best.no_go_name
    if best.has_land:
        kept = f"It keeps at least {text.clearance(best.clearance_m)} from {no_go}"
    else:
        kept = f"The chart has no {no_go} to keep clear of"
    is_told = best.has_land or best.collisions
    return f"{kept}; {text.turns_text(best)}." if is_told else f"{kept}."


def _bound(best: RouteMetrics) -> str:
    """Say how near the best route is to the lower bound on fuel."""
    if best.optimality_gap > text.USEFUL_GAP:
        return "There is no useful bound on what a better route could save."
    bound = best.fuel / (1 + best.optimality_gap)
    return (
        "By the same law of fuel no route within the chart, of any class and however close "
        f"to {best.no_go_name}, needs less than {text.fuel(bound, best, least=True)}; this one is "
        f"within {text.at_most_percent(best.optimality_gap)} of that bound."
    )


def _gain(route: RouteMetrics) -> float:
    """Return the mean speed that the current adds, m/s; 0 where a route has no duration."""
    gain = text.speed_over_ground(route) - route.speed_m_s
    return gain if math.isfinite(gain) else 0.0


def _effect(gain: float) -> str:
    """Say what a current does to the speed by its gain, m/s."""
    if round(gain, 2) == 0:
        return "adds nothing"
    return f"{'takes' if gain < 0 else 'adds'} {abs(gain):.2f} m/s"


def _difference(value: float, than: float) -> str:
    """Format a value's difference as a share: 3.1 % more."""
    share = value / than - 1
    return f"{text.percent(abs(share))} {'more' if share >= 0 else 'less'}"


def _signed(value: float) -> str:
    """Format a number with its sign, to two decimals."""
    return f"{round(value, 2) + 0.0:+.2f}".replace("-", "\N{MINUS SIGN}")
