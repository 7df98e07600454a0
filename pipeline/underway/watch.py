"""Say of a vessel's positions whether it is on its plan, and when to plan again.

What is said follows from the positions alone, in their order: the clock of this machine has no part
in it. So a watch that is begun again on the same positions says the same.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Literal

from pipeline.errors import RequestError
from pipeline.machine.paths import shown
from pipeline.stages.finished import FinishedSeason
from pipeline.stages.seasons.one_season import MIN_LATENESS_S
from pipeline.stages.write import MANIFEST
from pipeline.underway.reports import Fix, Unread
from pipeline.underway.track import RECEIVER_M, Place, Track

State = Literal["off_plan", "late"]

# A vessel moves at most by `_STRAY_M`, the error of a poor fix, and this many times its highest
# planned speed over ground, or this speed if that is higher, m/s: it may be carried or towed. It is
# silent for at most this time, s. Other positions are strays, unless the next one agrees.
_STRAY_M, _FASTER, _FAST_M_S, _SILENT_S = 200.0, 3.0, 25.0, 30 * 86_400.0
# Distance from the goal at which the voyage is over, m.
_ARRIVED_M = 100.0
# Least time from an event to the one that takes it back, s.
_LEAST_S = 60.0


@dataclass
class Watch:
    """The watch of one voyage.

    Parameters
    ----------
    track : the planned waypoints.
    names : the waypoints' names.
    departure : when the vessel left, s since 1970; None if unknown: lateness is then not watched.
    lateness : share of the time under way by which the vessel may be early or late.
    depends_on_time : whether the route is proven safe only at its times.
    every_s : time after which the state is said again, though it is the same, s.
    """

    track: Track
    names: tuple[str, ...]
    departure: float | None
    lateness: float
    depends_on_time: bool
    every_s: float = 600.0
    counts: Counter[str] = field(default_factory=Counter)
    _last: Fix | None = None
    _due_s: float | None = None
    _stray: Fix | None = None
    _said: frozenset[State] | None = None
    _said_at: float = 0.0
    _has_arrived: bool = False

    def take(self, report: Fix | Unread) -> Iterator[dict[str, Any]]:
        """Take the next report, count it, and yield the events that follow from it."""
        if isinstance(report, Unread):
            self.counts[report.kind] += 1
            return
        if self._last is not None and report.time == self._last.time:
            self.counts["repeated"] += 1  # by another talker, say
            return
        follows = self._follows(self._last, report)
        if not (follows or self._agrees(report)):
            self.counts["stray"] += 1
            self._stray = report
            return
        before, self._last, self._stray = self._last, report, None
        self.counts["position"] += 1
        if self._has_arrived:
            return
        passed = None if self.departure is None else report.time - self.departure
        if passed is not None and passed < 0:
            self.counts["early"] += 1
            return
        # A vessel that is late stays on the leg where it was, though another one that is due now
        # leads through the same water.
        expected = passed
        if follows and before is not None and self._due_s is not None:
            expected = self._due_s + report.time - before.time
        place = self.track.nearest(report.lon, report.lat, expected)
        self._due_s = place.due_s
        yield from self._events(report, place, passed)

    def _agrees(self, fix: Fix) -> bool:
        """Whether a position agrees with the stray one just before it."""
        return self._stray is not None and self._follows(self._stray, fix)

    def _follows(self, before: Fix | None, fix: Fix) -> bool:
        """Whether a vessel can come from one position to another in the time between them."""
        if before is None:
            return True
        passed = fix.time - before.time
        if not 0 < passed <= _SILENT_S:
            return False
        reach = _STRAY_M + max(_FASTER * self.track.most_m_s, _FAST_M_S) * passed
        return self.track.distance_m((before.lon, before.lat), (fix.lon, fix.lat)) <= reach

    def _events(self, fix: Fix, place: Place, passed: float | None) -> Iterator[dict[str, Any]]:
        """Yield the events at a position on the way."""
        is_last = place.leg == len(self.names) - 2  # a round trip begins near its goal
        self._has_arrived = is_last and place.ahead_m <= _ARRIVED_M
        late_s = 0.0 if passed is None else passed - place.due_s
        may_be_late_s = max(self.lateness * place.due_s, MIN_LATENESS_S)
        states: set[State] = set()
        if abs(place.off_m) > max(place.limit_m, RECEIVER_M):
            states.add("off_plan")
        if abs(late_s) > may_be_late_s:
            states.add("late")
        now, said = frozenset(states), self._said or frozenset()
        # Time goes back where the first positions were those of a clock that was wrong.
        worse, since = now - said, abs(fix.time - self._said_at)
        is_changed = self._said is None or self._has_arrived or (now != said and since >= _LEAST_S)
        if not (worse or is_changed or since >= self.every_s):
            return
        # What is taken back within a minute is not taken back yet.
        self._said = now if is_changed or since >= self.every_s else said | now
        self._said_at = fix.time
        about = {
            "time": _written(fix.time),
            "lon": round(fix.lon, 6),
            "lat": round(fix.lat, 6),
            "leg": f"{self.names[place.leg]} to {self.names[place.leg + 1]}",
            "off_m": round(abs(place.off_m), 1),
            "side": "starboard" if place.off_m > 0 else "port",
            "limit_m": round(place.limit_m, 1),
            "late_min": None if passed is None else round(late_s / 60, 1),
            "may_be_late_min": None if passed is None else round(may_be_late_s / 60, 1),
            "arrived": self._has_arrived,
        }
        void = {state for state in now if state == "off_plan" or self.depends_on_time}
        about["proof"] = "void" if void else "holds"
        for event in sorted(now) if now else ["on_plan"]:
            yield {"event": event, **about}
        if void & worse and not self._has_arrived:
            yield {"event": "replan", **about, "because": sorted(void)}


def watch_of(finished: FinishedSeason, departed: datetime | None, every_s: float) -> Watch:
    """Return the watch of a season's best route, which left when it was planned, or as given.

    Raises
    ------
    RequestError
        The season has a departure, and another one is given; or its files are damaged.
    """
    departure = finished.departed(departed)
    try:
        waypoints = finished.waypoints
        return Watch(
            Track.of(waypoints),
            tuple(str(one["properties"]["name"]) for one in waypoints),
            None if departure is None else departure.timestamp(),
            float(finished.scenario["planner"]["lateness"]),
            finished.depends_on_time,
            every_s,
        )
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise RequestError(
            f"RESULTS: files in {shown(finished.folder)} are damaged ({type(error).__name__}: "
            f"{error}), or of another version than {MANIFEST} says; run the scenario again"
        ) from None


def _written(time: float) -> str:
    """Write a time, s since 1970, to the second."""
    return f"{datetime.fromtimestamp(time, UTC):%Y-%m-%dT%H:%M:%SZ}"


# What is counted, for readers, in the order in which it is said.
_COUNTED = {
    "broken": "broken",
    "void": "without a position",
    "other": "of other kinds",
    "repeated": "positions for a time that had one",
    "stray": "positions where the vessel can't have been",
    "early": "before the departure",
}


def summary(counts: Counter[str]) -> str:
    """Say at the end how many positions were taken, and what was not."""
    rest = [f"{counts[kind]:,} {said}" for kind, said in _COUNTED.items() if counts[kind]]
    return "; ".join([f"positions: {counts['position']:,}", *rest])
