"""What would let a plan succeed in which every class fell away: less padding, or more risk."""

from __future__ import annotations

import math
from typing import Protocol

from renew.classes.h_signature import shortened
from renew.padding.padding_model import Padding
from renew.route import Route

# The largest margin is sought by so many halvings, and the least risk up to this one, by as many.
_HALVINGS, _MOST_RISK = 6, 0.5


class Attempt(Protocol):
    """Plans with other margins: the best route of the first class that has one, or None."""

    def __call__(self, *, padding: Padding, clearance: float, risk: float) -> Route | None:
        """Try."""
        ...


def advise(
    attempt: Attempt, padding: Padding, clearance: float, risk: float, widest_gap: float
) -> list[str]:
    """What would leave a route, each tried out; the widest way through comes first."""
    found = [f"the widest way through has a gap of {widest_gap:.2f} m"]
    if not isinstance(padding, str) and padding > 0:
        route = attempt(padding="adaptive", clearance=clearance, risk=risk)
        if route is not None:
            found.append(f'padding = "adaptive" would leave one, {_described(route)}')
    if padding == "adaptive":
        found.append(_least_risk(attempt, clearance, risk))
    margin = clearance if isinstance(padding, str) else max(float(padding), clearance)
    found += _largest_margin(attempt, risk, min(margin or math.inf, widest_gap / 2))
    return found


def _least_risk(attempt: Attempt, clearance: float, risk: float) -> str:
    """The least risk, to 1 %, that leaves a route."""
    low, high = risk, _MOST_RISK
    if high <= low or attempt(padding="adaptive", clearance=clearance, risk=high) is None:
        return f"no risk up to {_MOST_RISK:g} would leave one"
    while high - low > 0.01:
        middle = math.ceil(50 * (low + high)) / 100
        if middle >= high:
            break
        if attempt(padding="adaptive", clearance=clearance, risk=middle) is None:
            low = middle
        else:
            high = middle
    return f"a risk of {high:g} would leave one"


def _largest_margin(attempt: Attempt, risk: float, most: float) -> list[str]:
    """The largest fixed padding up to `most` m that leaves a route, to 2 %, if one does."""
    if not 0 < most < math.inf:
        return []
    low, high, best = 0.0, most, None
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        route = attempt(padding=middle, clearance=0.0, risk=risk)
        if route is None:
            high = middle
        else:
            low, best = middle, route
    return [f"a padding of {low:.4g} m would leave one, {_described(best)}"] if best else []


def _described(route: Route) -> str:
    """Fuel and clearance of a route, in words."""
    name = shortened(route.homotopy)
    return f"class {name} for a fuel of {route.fuel:.6g}, {route.clearance:.2f} m off land"
