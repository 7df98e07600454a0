"""Explain why no class can be sailed, and find remedies: less padding, or more risk."""

import contextlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from renew.classes.dual_graph import Channel, widest_gap
from renew.classes.h_signature import shortened
from renew.errors import ClassName, InfeasibleError, Length, Text, TooLateError, UnreachableError
from renew.planner.one_class import ClassPlanner
from renew.results import Rejected, Route

# Number of tries to find the largest padding, and its precision as a share of a length.
_TRIES, _NEARLY = 6, 0.98
# Largest suggested risk, and the ratio to which it is exact.
_MAX_RISK, _RISK_STEP = 0.5, 0.01
# Number of quoted reasons, and of classes named with each.
_MAX_REASONS = 3
# Number of ways that are planned with other padding.
_MAX_WAYS = 4


def no_class_error(rejected: tuple[Rejected, ...], planner: ClassPlanner) -> UnreachableError:
    """Return the error if all classes were rejected, with the first reasons and remedies."""
    if not rejected:
        return UnreachableError(
            "the search for classes met none before it ended. To find a route: take "
            'order = "fuel", whose search is led towards the goal'
        )
    alike: dict[str, list[Rejected]] = {}
    for one in rejected:
        alike.setdefault(one.reason, []).append(one)
    reasons = [
        Text("{0}: {1}", (_named(group), group[0].text))
        for group in itertools.islice(alike.values(), _MAX_REASONS)
    ]
    left = len(alike) - _MAX_REASONS
    more = f" (and {left} more reason{'s' * (left > 1)})" if left > 0 else ""
    if all(isinstance(one.cause, TooLateError) for one in rejected):
        # Neither padding nor risk makes the vessel arrive much earlier.
        remedy = Text("take currents that reach further, or depart earlier")
    else:
        tried = Text.joined("; ", suggest_relaxations(planner, rejected))
        remedy = Text("{0}; or allow a smaller padding or clearance, or more classes", (tried,))
    count = f"all {len(rejected)} classes were" if len(rejected) != 1 else "the only class was"
    error = UnreachableError(
        f"{count} rejected: {{0}}{more}. To find a route: {{1}}",
        Text.joined("; ", reasons),
        remedy,
    )
    error.causes = tuple(one.cause for one in rejected if one.cause is not None)
    straits = tuple(one.strait for one in rejected if one.strait is not None)
    if len(straits) == len(rejected):
        error.straits = straits
    return error


def _named(group: list[Rejected]) -> Text:
    """Name the first of several classes, and count the others."""
    names = [_class_name(one) for one in group[:_MAX_REASONS]]
    more = f" and {len(group) - _MAX_REASONS} more" if len(group) > _MAX_REASONS else ""
    return Text(f"class{'es' * (len(group) > 1)} {{0}}{more}", (Text.joined(", ", names),))


def _class_name(one: Rejected | Route) -> Text:
    """Return the name of a class for a sentence."""
    return Text("{0}", (ClassName(shortened(one.homotopy)),))


def suggest_relaxations(planner: ClassPlanner, rejected: Sequence[Rejected]) -> list[Text]:
    """Return tried remedies that leave a route; the widest way through comes first."""
    options, search = planner.options, _RelaxationSearch(planner, rejected)
    triangulation = planner.problem.triangulation
    stops = [triangulation.locate(stop) for stop in planner.problem.voyage.stops]
    gap = min(widest_gap(triangulation, *both) for both in itertools.pairwise(stops))
    found = [Text("the widest way through has a gap of {0}", (Length(gap),))]
    if not isinstance(options.padding, str) and options.padding > 0:
        route = search.route(padding="adaptive")
        if route is not None:
            found.append(Text('padding = "adaptive" would leave one, {0}', (_description(route),)))
    if options.is_adaptive and options.risk < _MAX_RISK:
        found.append(Text(search.least_risk()))
    return found + search.largest_padding(options.min_width or math.inf)


class _RelaxationSearch:
    """Plans with other padding, to find how much less padding leaves a route.

    The ways of rejected classes are planned again, the widest first: a search for other classes
    would take a roadmap for each padding.
    """

    def __init__(self, planner: ClassPlanner, rejected: Sequence[Rejected]) -> None:
        self._problem, self._options = planner.problem, planner.options
        ways = [way for one in rejected for way in one.ways]
        self._ways = sorted(ways, key=_narrowest_gap, reverse=True)[:_MAX_WAYS]

    def route(self, **changes: Any) -> Route | None:  # noqa: ANN401 - as of PlanOptions
        """Return the route of the widest way that has one with changed options, or None."""
        options = replace(self._options, **changes)
        # Making room to turn takes long, and less padding leaves more room.
        planner = ClassPlanner(self._problem.with_options(options), thorough=False)
        for way in self._ways:
            with contextlib.suppress(InfeasibleError):
                return planner.route(planner.find(way))
        return None

    def least_risk(self) -> str:
        """Return as text the least risk, to 1 %, that leaves a route."""
        low, high = self._options.risk, _MAX_RISK
        if self.route(risk=high) is None:
            return f"a risk of {_MAX_RISK:g} would leave none of the widest ways"
        while high - low > _RISK_STEP:
            middle = math.ceil((low + high) / 2 / _RISK_STEP) * _RISK_STEP
            if middle >= high:
                break
            if self.route(risk=middle) is None:
                low = middle
            else:
                high = middle
        return f"a risk of {high:g} would leave one"

    def largest_padding(self, most: float) -> list[Text]:
        """Return as text the largest fixed padding up to `most` m, to 2 %, that leaves a route."""
        most = min(most, max(map(_narrowest_gap, self._ways), default=0.0) / 2)
        if not 0 < most < math.inf:
            return []
        low, high, best = 0.0, most, None
        # Each try takes as long as a plan, and a little less than `most` is usually enough.
        tried = _NEARLY * most
        for _ in range(_TRIES):
            route = self.route(padding=tried, clearance=0.0, risk_at="route")
            if route is None:
                high = tried
            else:
                low, best = tried, route
            if high - low <= (1 - _NEARLY) * most:
                break
            tried = (low + high) / 2
        if best is None:
            return []
        # In the unit of the option, whatever unit the message uses for lengths, and rounded down.
        safe = f"{low * (1 - 5e-4):.4g}"
        return [Text(f"padding = {safe} (planar m) would leave one, {{0}}", (_description(best),))]


def _narrowest_gap(way: Channel) -> float:
    """Return the width (m) of the narrowest passing edge of a channel."""
    widths = np.linalg.norm(way.left - way.right, axis=1)
    # At a via point the row has a passing edge of no length.
    return float(widths[widths > 0].min(initial=math.inf))


def _description(route: Route) -> Text:
    """Return a route's fuel and clearance as text."""
    return Text(
        f"class {{0}} for a fuel of {route.fuel:.6g}, {{1}} clear of no-go zones",
        (_class_name(route), Length(route.clearance)),
    )
