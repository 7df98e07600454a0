"""Quantities as text, and the report's sentences made from them."""

from __future__ import annotations

import math
import re
from datetime import UTC, timedelta
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from pipeline.model import ClockWorth, GapShares, RouteMetrics, Zone

ABSENT = "–"
# A time on a current's clock in one of the planner's reasons.
_CLOCK_TIME = re.compile(
    r"\b(arrive at|known until|arrive_by =|leaves? at|there at) (-?[\d.]+(?:e\+?\d+)?) s\b"
)
# Distances, metres, from which kilometres are given with one decimal, and with two.
_ONE_DECIMAL_FROM_M, _KILOMETRES_FROM_M = 100_000.0, 1_000.0
_DAY_S, _HOUR_S, _MINUTE_S = 86_400.0, 3_600.0, 60.0
# Difference, as a share, below which two lengths, or two figures of fuel, are printed alike.
_SAME_LENGTH, _SAME_FUEL = 5e-4, 5e-4


def number(value: float | None, digits: int = 4) -> str:
    """Format a number to significant digits without exponent, with thousands separators: 1,235."""
    if value is None or not math.isfinite(value):
        return ABSENT
    magnitude = math.floor(math.log10(abs(value))) if value else 0
    return f"{value:,.{max(0, digits - 1 - magnitude)}f}"


def plain(value: float) -> str:
    """Format a number from a configuration without trailing zeros: 2, 0.5, 1,000."""
    return f"{value:,.6g}"


def distance(metres: float | None) -> str:
    """Format true metres: 712.1 km, 3.46 km, 820.4 m, 12.6 m."""
    if metres is None or not math.isfinite(metres):
        return ABSENT
    if metres >= _ONE_DECIMAL_FROM_M:
        return f"{metres / 1000:,.1f} km"
    if metres >= _KILOMETRES_FROM_M:
        return f"{metres / 1000:.2f} km"
    return f"{number(metres, 4 if metres >= 100 else 3)} m"


def hours(seconds: float) -> str:
    """Format a duration in hours; less than one, in minutes or seconds."""
    if not math.isfinite(seconds):
        return ABSENT
    if seconds >= _HOUR_S:
        return f"{seconds / _HOUR_S:,.1f} h"
    if seconds >= 2 * _MINUTE_S:
        return f"{seconds / _MINUTE_S:.1f} min"
    return f"{seconds:.1f} s"


def days(seconds: float) -> str:
    """Format a duration in days and hours: 8 d 6 h; empty below two days."""
    if not math.isfinite(seconds) or seconds < 2 * _DAY_S:
        return ""
    whole, rest = divmod(round(seconds / _HOUR_S), 24)
    return f"{whole} d {rest} h"


def percent(share: float, digits: int = 1) -> str:
    """Format a share as a percentage: 2.3 %."""
    return f"{100 * share:.{digits}f} %" if math.isfinite(share) else ABSENT


def place(lon: float, lat: float) -> str:
    """Format a position in degrees: 119.8710 E 11.5244 N."""
    return f"{lon:.4f} E {lat:.4f} N"


def shortened(text: str, limit: int) -> str:
    """Cut a text to at most `limit` characters, the last of which is then "…"."""
    return text if len(text) <= limit else f"{text[: limit - 1]}…"


def speed_over_ground(metrics: RouteMetrics) -> float:
    """Mean speed over ground, m/s; NaN without a duration."""
    return metrics.length_m / metrics.duration_s if metrics.duration_s > 0 else math.nan


def route_summary(metrics: RouteMetrics) -> str:
    """Say a route's way, length, duration and clearance: "west of island 1, 689.5 km, ..."."""
    parts = [metrics.way] if metrics.way else []
    parts += [distance(metrics.length_m), hours(metrics.duration_s)]
    if metrics.has_land:
        parts.append(f"{distance(metrics.clearance_m)} or more from land")
    return f"{', '.join(parts)}."


def zone_text(zone: Zone) -> str:
    """Name of a restricted area or traffic scheme, with its rule if the chart states one."""
    name = zone.name or ("Restricted area" if zone.kind == "restricted" else "Traffic scheme")
    return f"{name}: {zone.rule}" if zone.rule else name


def verdict(
    routes: Sequence[RouteMetrics],
    vessel_speed: float,
    gap: GapShares | None = None,
    worth: ClockWorth | None = None,
) -> tuple[str, ...]:
    """Explain in sentences why a season's best route was chosen, and how safe it is.

    `routes` are best first, at least one; `vessel_speed` is through water, m/s; `gap` says what the
    best one's optimality gap is made of, and `worth` what it saves by knowing how the current
    changes, where that is known.
    """
    best, others = routes[0], routes[1:]
    rival = closest_rival(routes)
    sentences = [_comparison(best, rival, vessel_speed)] if rival else []
    if not others:
        sentences.append("It is the only class that has a route.")
    shorter = [r for r in others if r.length_m < best.length_m * (1 - _SAME_LENGTH)]
    if shorter:
        shortest = min(shorter, key=lambda r: r.length_m)
        sentences.append(
            f"{_count(len(shorter), 'class is', 'classes are')} shorter; the shortest (rank "
            f"{shortest.rank}) saves {distance(best.length_m - shortest.length_m)} and needs "
            f"{_difference(shortest.fuel, best.fuel)} fuel."
        )
    elif others:
        sentences.append("It is also the shortest route found.")
    sentences.append(_safety(best))
    if gap is not None:
        sentences.append(gap_text(gap))
    if worth is not None:
        sentences.append(clock_text(worth))
    return tuple(sentences)


def gap_text(gap: GapShares) -> str:
    """Say in a sentence what an optimality gap is made of."""
    whole = gap.chart + gap.padding + gap.bound
    return (
        f"Of the optimality gap of {percent(whole)}, {percent(gap.chart)} is the chart's "
        f"(simplification, margin and offing), {percent(gap.padding)} is the padding's "
        f"(room for hard-over turns), and {percent(gap.bound)} the bound's own: no route off the "
        "land itself was found that is nearer to it."
    )


def clock_text(worth: ClockWorth) -> str:
    """Say in a sentence what it is worth to know how the current changes."""
    others = ", ".join(
        f"{name} {_sailed(fuel, worth.best)}"
        for name, fuel in (
            ("the plan on the current at departure", worth.frozen),
            ("the plan on its mean over the voyage", worth.mean),
            ("the shortest safe path", worth.shortest),
        )
    )
    return (
        f"Sailed in the changing current from the same departure on, {others}. No route at all "
        f"saves more than {percent(1 - worth.bound / worth.best)}."
    )


def _sailed(fuel: float, best: float) -> str:
    """Say what a plan needs when it is sailed, against the best route."""
    if not math.isfinite(fuel):
        return "can't be sailed"
    if abs(fuel / best - 1) < _SAME_FUEL:
        return "needs as much fuel as this route"
    return f"needs {_difference(fuel, best)} fuel than this route"


def closest_rival(routes: Sequence[RouteMetrics]) -> RouteMetrics | None:
    """Route to compare a season's best with: the best by another passage, else the next best.

    `routes` are best first; None if there is only one.
    """
    best, others = routes[0], routes[1:]
    by_another_passage = (r for r in others if r.main_passage != best.main_passage)
    return next(by_another_passage, others[0] if others else None)


def _comparison(best: RouteMetrics, rival: RouteMetrics, vessel_speed: float) -> str:
    """Compare two routes: fuel, length, and the current's effect on each."""
    if rival.main_passage != best.main_passage:
        names = f"The way {best.main_passage}", f"the best way {rival.main_passage}"
    else:
        names = "The best route", "the next best"
    saved = (rival.fuel - best.fuel) / rival.fuel
    if saved >= 0:
        fuel = f"needs {percent(saved)} less fuel than {names[1]} (rank {rival.rank})"
    else:  # the sampled method chooses by the mean of each class
        fuel = (
            f"was chosen over {names[1]} (rank {rival.rank}) by the mean fuel of its class, "
            f"although it needs {percent(-saved)} more fuel"
        )
    longer = best.length_m - rival.length_m
    if abs(longer) < _SAME_LENGTH * best.length_m:
        length = "over the same distance"
    elif longer > 0:
        length = f"although it is {distance(longer)} longer"
    else:
        length = f"and is {distance(-longer)} shorter"
    ours, theirs = speed_over_ground(best), speed_over_ground(rival)
    if not (math.isfinite(ours) and math.isfinite(theirs)):
        return f"{names[0]} {fuel}, {length}."
    gains = _signed(ours - vessel_speed), _signed(theirs - vessel_speed)
    if f"{ours:.2f}" == f"{theirs:.2f}":
        speeds = f"both average {ours:.2f} m/s over ground ({gains[0]} from the current)"
    else:
        speeds = (
            f"it averages {ours:.2f} m/s over ground ({gains[0]} from the current), "
            f"the other {theirs:.2f} m/s ({gains[1]})"
        )
    return f"{names[0]} {fuel}, {length}: {speeds}."


def _safety(best: RouteMetrics) -> str:
    """Clearance of the best route, result of its hard-over turns, and its optimality gap."""
    safe = (
        f"It keeps at least {distance(best.clearance_m)} from land"
        if best.has_land
        else "There is no land to keep clear of"
    )
    if best.collisions:
        safe += f"; {best.collisions:,} of {best.trials:,} simulated hard-over turns met land"
    elif best.has_land:
        safe += f"; none of {best.trials:,} simulated hard-over turns met land"
    gap = ""
    if math.isfinite(best.optimality_gap):
        bound = best.fuel / (1 + best.optimality_gap)
        gap = (
            f". No route of any class, however close to land, can need less fuel than "
            f"{number(bound)}; this one is within {percent(best.optimality_gap)} of that bound"
        )
    return f"{safe}{gap}."


def _difference(value: float, than: float) -> str:
    """Format a value's difference as a share: 3.1 % more."""
    share = value / than - 1
    return f"{percent(abs(share))} {'more' if share >= 0 else 'less'}"


def _signed(value: float) -> str:
    """Format a number with its sign, to two decimals."""
    return f"{value:+.2f}".replace("-", "\N{MINUS SIGN}")


def _count(count: int, one: str, many: str) -> str:
    """Format a count with its noun."""
    return f"{count} {one if count == 1 else many}"


def dated(reason: str, departure: datetime | None) -> str:
    """Write the seconds since departure in one of the planner's reasons as dates.

    They stay as they are where the current has no clock.
    """
    if departure is None:
        return reason

    def date(found: re.Match[str]) -> str:
        return f"{found[1]} {moment_text(departure + timedelta(seconds=float(found[2])))}"

    return _CLOCK_TIME.sub(date, reason)


def moment_text(moment: datetime) -> str:
    """Write a moment for readers: "2026-11-22 06:00 UTC"."""
    return f"{moment.astimezone(UTC):%Y-%m-%d %H:%M} UTC"
