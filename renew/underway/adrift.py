"""Hours adrift: how long until land, if the thrust is lost here.

From stations along a route a vessel without thrust is followed forward in the current, until its
place meets the no-go zone. The time until then can jump between neighbouring stations: one passes
an island, and the next one does not. So stations are added where neighbours differ; between them
nothing is proven.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from shapely import Polygon

from renew._types import FloatArray
from renew.errors import ParameterError, check_kind, is_finite, shown
from renew.inputs.chart_and_vessel import Chart
from renew.inputs.current import CurrentLike, as_field
from renew.results import Route
from renew.voyage.drift import Drift
from renew.voyage.voyage import early_and_late

# Number of stations along a route at first, and the largest number of times that the distance
# between two of them is halved.
_STATIONS = 400
_HALVINGS = 4
# Difference between neighbours, as a share of the shorter time, above which a station is added.
_JUMP = 0.25


@dataclass(frozen=True, slots=True)
class Adrift:
    """Hours adrift along a route.

    Attributes
    ----------
    points : (n, 2) m, the stations.
    along : (n,) m, true distances from the route's beginning.
    seconds : (n,) s until land, the least of a vessel that passes early, on time and late; inf
        where it meets none within the `horizon`, or before it leaves the chart.
    ends : (n, 2) m, where that vessel is then.
    horizon : s, for which it was followed, but not beyond `known_until`.
    known_until : s, on the current's clock: the end of its data; inf where there is none.
    """

    points: FloatArray
    along: FloatArray
    seconds: FloatArray
    ends: FloatArray
    horizon: float
    known_until: float

    @property
    def least(self) -> int:
        """The station with the least time."""
        return int(self.seconds.argmin())

    def ends_below(self, limit: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the first and the last stretch below a limit (s): its length, m, and least, s.

        Both are the whole route where it is below the limit everywhere. Without such a stretch the
        length is 0, and the least time that at the end.
        """
        kept = np.flatnonzero(self.seconds >= limit)
        first, last = (kept[0], kept[-1]) if len(kept) else (len(self.seconds) - 1, 0)
        begin, end = self.along[first], self.along[-1] - self.along[last]
        least = self.seconds[: first + 1].min(), self.seconds[last:].min()
        return (float(begin), float(least[0])), (float(end), float(least[1]))

    def share_below(self, limit: float) -> float:
        """Return the share of the route's length where the time is below a limit (s)."""
        weight = np.zeros(len(self.along))
        weight[:-1] += np.diff(self.along) / 2
        weight[1:] += np.diff(self.along) / 2
        return float(weight[self.seconds < limit].sum() / max(weight.sum(), 1e-300))


def adrift(
    route: Route,
    chart: Chart,
    current: CurrentLike,
    *,
    land: Iterable[Polygon] | None = None,
    horizon: float = 72 * 3600.0,
    lateness: float = 0.05,
    min_lateness: float = 0.0,
) -> Adrift:
    """Return how long a vessel that loses its thrust along a route drifts until it meets land.

    Parameters
    ----------
    route : Route
        As planned, with its times.
    chart : Chart
        Its extent; a vessel that leaves it meets no land. Its metres count (`point_scale`).
    current : CurrentField or callable
        What carries the vessel, m/s: the current, and leeway if that is added to it.
    land : iterable of Polygon, optional
        What it may not meet (m), by default the chart's no-go zone.
    horizon : float
        For how long it is followed (s).
    lateness, min_lateness : float
        In a current that changes it is also followed from a passage that is early and late, by a
        share of the time since departure, and at least by some seconds.

    Returns
    -------
    Adrift
        The times at stations.

    Raises
    ------
    ParameterError
        No route or chart, or figures out of range.
    """
    check_kind("route", route, Route)
    check_kind("chart", chart, Chart)
    faults = [
        f"{name} = {shown(value)} must be {what}"
        for name, value, what, is_right in (
            ("horizon", horizon, "a number of seconds above 0", _number(horizon) > 0),
            ("lateness", lateness, "0 or more, below 1", 0 <= _number(lateness) < 1),
            ("min_lateness", min_lateness, "0 s or more", _number(min_lateness) >= 0),
        )
        if not is_right
    ]
    if faults:
        raise ParameterError("; ".join(faults))
    field = as_field(current)
    polygons = chart.no_go if land is None else land
    drift = Drift.of(chart, field.table(chart.bounds), polygons, horizon)
    known = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(route.path, axis=0), axis=1))])

    until = float(horizon), float(field.span[1])

    def follow(share: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return points, seconds and ends of stations at shares (n,) of the route's length."""
        on_way = share * known[-1]
        points = np.stack([np.interp(on_way, known, x) for x in route.path.T], axis=-1)
        times = np.interp(on_way, known, route.times)
        passed = [times]
        if not field.is_steady:
            passed += early_and_late(times, float(route.times[0]), lateness, min_lateness)
        each = [drift.follow(points, one, until) for one in passed]
        seconds = np.stack([one for one, _ in each])
        worst, every = seconds.argmin(axis=0), np.arange(len(points))
        ends = np.stack([one for _, one in each])[worst, every]
        return points, seconds[worst, every], ends

    share = np.linspace(0.0, 1.0, _STATIONS + 1)
    found = [*follow(share)]
    for _ in range(_HALVINGS):
        # Where the times of neighbours differ so much, they may jump between them.
        less, most = np.sort(np.stack([found[1][:-1], found[1][1:]]), axis=0)
        between = np.flatnonzero(np.isfinite(less) & (most > (1 + _JUMP) * less))
        if not len(between):
            break
        more = (share[between] + share[between + 1]) / 2
        order = np.argsort(np.concatenate([share, more]), kind="stable")
        share = np.concatenate([share, more])[order]
        found = [np.concatenate(both)[order] for both in zip(found, follow(more), strict=True)]
    points, seconds, ends = found
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    lengths *= chart.true_metres((points[:-1] + points[1:]) / 2)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    return Adrift(points, along, seconds, ends, *until)


def _number(value: object) -> float:
    """Return a finite number; NaN, which no limit admits, for anything else."""
    return float(value) if is_finite(value) else math.nan
