"""What was found of a checked route, in sentences."""

import math
from collections.abc import Iterator

from pipeline.findings import text
from pipeline.model import Place
from pipeline.voyage.check import CheckedRoute
from pipeline.voyage.route_file import GivenRoute

# Number of places that are named in a sentence.
_FEW = 3
# Share by which fuels may differ and count as the same: two searches for one path differ by less.
_SAME = 1e-4


def checked_lines(one: CheckedRoute, route: GivenRoute) -> Iterator[str]:
    """Yield the answer for one case, in sentences."""
    row, took_s = one.given.metrics, float(one.passed_s[-1])
    named = f" {route.name!r}" * bool(route.name)
    yield (
        f"{text.season_name(one.given.season)}: {route.form}{named}, "
        f"{text.distance(row.length_m)}, {text.duration(took_s)}, fuel {text.fuel(row.fuel, row)}"
    )
    no_go = row.no_go_name
    for land in one.crossed[:_FEW]:
        yield (
            f"OVER LAND: {text.distance(land.length_m)} of {land.name or no_go} at "
            f"{land.place.text}"
        )
    if len(one.crossed) > _FEW:
        yield f"OVER LAND at {len(one.crossed) - _FEW} more places"
    if one.nearest is not None:
        yield f"Nearest {no_go}: {text.clearance(row.clearance_m)}, at {one.nearest.text}"
    yield from (f"SHUT: {said}" for said in one.shut)
    for lane in one.against:
        how_far = text.distance(lane.length_m)
        yield f"AGAINST the {lane.zone.name}: for {how_far}, at {lane.place.text}"
    if row.collisions:
        places = ", ".join(place.text for place in one.met[:_FEW])
        more = f" and {len(one.met) - _FEW} more places" * (len(one.met) > _FEW)
        yield (
            f"NOT SAFE EVERYWHERE: {row.collisions:,} of {row.trials:,} hard-over turns meet "
            f"{no_go}, from {places}{more}"
        )
    else:
        yield f"All {row.trials:,} hard-over turns are clear of {no_go}"
    if math.isfinite(row.adrift_s):
        place = Place(row.adrift_lon, row.adrift_lat)
        yield (
            f"WITHOUT THRUST ashore in {text.duration(row.adrift_s)} from {place.text}; within 6 h "
            f"from {text.percent(row.adrift_share)} of the way"
        )
    yield from _compared(one)


def _compared(one: CheckedRoute) -> Iterator[str]:
    """Yield how the given route compares with the routes of a plan."""
    if one.why_not:
        which = "of any side" if one.best is None else "of its side"
        yield f"No safe route {which} beside it: {one.why_not}"
    beside = {"of its side": one.same_side, "of all": one.best}
    if one.same_side is one.best:
        beside = {"of its side and of all": one.best}
    for which, other in beside.items():
        if other is not None:
            more = one.given.metrics.fuel / other.metrics.fuel - 1
            size = f"{text.percent(abs(more), 2)} {'above' if more > 0 else 'below'}"
            way = f", {other.metrics.way}" * bool(other.metrics.way)
            yield (
                f"{size if abs(more) > _SAME else 'As much fuel as'} the least-fuel route "
                f"{which} that keeps room to turn: {text.fuel(other.metrics.fuel, other.metrics)}, "
                f"{text.distance(other.metrics.length_m)}{way}"
            )
