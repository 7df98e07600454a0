"""Figures in words: how the report spells quantities, and the sentences made from them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pipeline.model import RouteMetrics, Zone

ABSENT = "–"
_LONG_M, _SHORT_M = 100_000.0, 1_000.0
_DAY_S, _HOUR_S, _MINUTE_S = 86_400.0, 3_600.0, 60.0
# Differences below this can't be seen in the figures as printed.
_SAME = 5e-4


def number(value: float | None, digits: int = 4) -> str:
    """Spell a number to significant digits without exponents, thousands parted: 1,235."""
    if value is None or not math.isfinite(value):
        return ABSENT
    magnitude = math.floor(math.log10(abs(value))) if value else 0
    return f"{value:,.{max(0, digits - 1 - magnitude)}f}"


def plain(value: float) -> str:
    """Spell a number that somebody chose, as they did: 2, 0.5, 1,000."""
    return f"{value:,.6g}"


def distance(metres: float | None) -> str:
    """Spell true metres: 712.1 km, 3.46 km, 820.4 m, 12.6 m."""
    if metres is None or not math.isfinite(metres):
        return ABSENT
    if metres >= _LONG_M:
        return f"{metres / 1000:,.1f} km"
    if metres >= _SHORT_M:
        return f"{metres / 1000:.2f} km"
    return f"{number(metres, 4 if metres >= 100 else 3)} m"


def hours(seconds: float) -> str:
    """Spell a duration in hours; what takes under one, in minutes or seconds."""
    if not math.isfinite(seconds):
        return ABSENT
    if seconds >= _HOUR_S:
        return f"{seconds / _HOUR_S:,.1f} h"
    if seconds >= 2 * _MINUTE_S:
        return f"{seconds / _MINUTE_S:.1f} min"
    return f"{seconds:.1f} s"


def days(seconds: float) -> str:
    """Spell a duration of days beside its hours: 8 d 6 h; empty under two days."""
    if not math.isfinite(seconds) or seconds < 2 * _DAY_S:
        return ""
    whole, rest = divmod(round(seconds / _HOUR_S), 24)
    return f"{whole} d {rest} h"


def percent(share: float, digits: int = 1) -> str:
    """Spell a share as a percentage: 2.3 %."""
    return f"{100 * share:.{digits}f} %" if math.isfinite(share) else ABSENT


def speed_over_ground(metrics: RouteMetrics) -> float:
    """Mean speed over ground (m/s), NaN where there is no duration."""
    return metrics.length_m / metrics.duration_s if metrics.duration_s > 0 else math.nan


def zone_words(zone: Zone) -> str:
    """Name a restricted area or a traffic scheme, and say what holds there if the chart does."""
    name = zone.name or ("Restricted area" if zone.kind == "restricted" else "Traffic scheme")
    return f"{name}: {zone.rule}" if zone.rule else name


def verdict(routes: Sequence[RouteMetrics], vessel_speed: float) -> tuple[str, ...]:
    """Say why the first of a season's routes won and how safe it is, a sentence each.

    `routes` are best first, at least one; `vessel_speed` is through water, m/s.
    """
    best, others = routes[0], routes[1:]
    sentences = [_against(best, rival, vessel_speed)] if (rival := _rival(best, others)) else []
    if not others:
        sentences.append("It is the only class of routes that could be sailed.")
    shorter = [r for r in others if r.length_m < best.length_m * (1 - _SAME)]
    if shorter:
        shortest = min(shorter, key=lambda r: r.length_m)
        sentences.append(
            f"{_count(len(shorter), 'class is', 'classes are')} shorter; the shortest of all (rank "
            f"{shortest.rank}) saves {distance(best.length_m - shortest.length_m)} and costs "
            f"{_difference(shortest.fuel, best.fuel)} fuel."
        )
    elif others:
        sentences.append("It is also the shortest of all found.")
    sentences.append(_safety(best))
    return tuple(sentences)


def _rival(best: RouteMetrics, others: Sequence[RouteMetrics]) -> RouteMetrics | None:
    """Pick what the best is held against: the best of another side, else the next best."""
    elsewhere = (r for r in others if r.side != best.side)
    return next(elsewhere, others[0] if others else None)


def _against(best: RouteMetrics, rival: RouteMetrics, vessel_speed: float) -> str:
    """Compare two routes: fuel, length, and what the current does to each."""
    if rival.side and rival.side != best.side:
        names = f"{best.side.capitalize()} about", f"the best way {rival.side} about"
    else:
        names = "The best route", "the next best"
    saved = (rival.fuel - best.fuel) / rival.fuel
    if saved >= 0:
        fuel = f"takes {percent(saved)} less fuel than {names[1]} (rank {rival.rank})"
    else:  # the sampled method chooses by its classes' means
        fuel = (
            f"was chosen by the mean of its class over {names[1]} (rank {rival.rank}), though "
            f"it takes {percent(-saved)} more fuel"
        )
    longer = best.length_m - rival.length_m
    if abs(longer) < _SAME * best.length_m:
        length = "on the same distance"
    else:
        length = f"though it is {distance(longer)} longer"
        if longer < 0:
            length = f"and is {distance(-longer)} shorter"
    ours, theirs = speed_over_ground(best), speed_over_ground(rival)
    if not (math.isfinite(ours) and math.isfinite(theirs)):
        return f"{names[0]} {fuel}, {length}."
    drifts = _signed(ours - vessel_speed), _signed(theirs - vessel_speed)
    if f"{ours:.2f}" == f"{theirs:.2f}":
        speeds = f"over the ground both make {ours:.2f} m/s on average ({drifts[0]} by the current)"
    else:
        speeds = (
            f"over the ground it makes {ours:.2f} m/s on average ({drifts[0]} by the current) "
            f"against {theirs:.2f} m/s ({drifts[1]})"
        )
    return f"{names[0]} {fuel}, {length}: {speeds}."


def _safety(best: RouteMetrics) -> str:
    """Say how far from land the best route stays and what its hard-over turns met."""
    clear = (
        f"It stays {distance(best.clearance_m)} or more from land"
        if math.isfinite(best.clearance_m)
        else "There is no land to stay clear of"
    )
    if best.collisions:
        turns = f"{best.collisions:,} of {best.trials:,} simulated hard-over turns met land"
    else:
        turns = f"none of {best.trials:,} simulated hard-over turns met land"
    gap = ""
    if math.isfinite(best.optimality_gap):
        bound = best.fuel / (1 + best.optimality_gap)
        gap = (
            f". No route of any class, however close to land, can need less than {number(bound)} "
            f"fuel: this one is within {percent(best.optimality_gap)} of that"
        )
    return f"{clear}; {turns}{gap}."


def _difference(value: float, than: float) -> str:
    """Spell how much more or less a value is, as a share: 3.1 % more."""
    share = value / than - 1
    return f"{percent(abs(share))} {'more' if share >= 0 else 'less'}"


def _signed(value: float) -> str:
    """Spell a difference with its sign, to two places."""
    return f"{value:+.2f}".replace("-", "\N{MINUS SIGN}")


def _count(count: int, one: str, many: str) -> str:
    """Spell a count with its noun."""
    return f"{count} {one if count == 1 else many}"
