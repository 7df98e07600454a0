"""Notes on what is not known about routes, from their figures."""

from collections.abc import Iterator, Sequence

from pipeline import model
from pipeline.model import ShoreCrossing
from pipeline.model.inputs import Note, Place
from pipeline.scenario.catalogue import has_world_land
from pipeline.scenario.region import ChartSpec

NO_SHARE = 5e-4
"""Shares of a route below this count as none: percentages have one decimal."""
# Crossings whose positions agree to this many decimals of a degree (100 m) are one place.
_SAME_PLACE = 3


def has_all_depths(metrics: model.RouteMetrics) -> bool:
    """Whether depths are charted all along a route."""
    return metrics.uncharted_share <= NO_SHARE


def route_notes(rows: Sequence[model.RouteMetrics]) -> list[Note]:
    """Note how much of a case's routes lacks depths, and how much lacks data of the current."""
    found = []
    for kind, name in (("current-filled", "filled_share"), ("depth-uncharted", "uncharted_share")):
        every = ((row.rank, getattr(row, name)) for row in rows)
        if shares := tuple(one for one in every if one[1] > NO_SHARE):
            found.append(Note.of(kind, first=rows[0].rank, shares=shares))
    return found


def strait_notes(straits: Sequence[model.ShutStrait]) -> Iterator[Note]:
    """Yield a note on the shut straits, with the place of the widest."""
    if straits:
        widest = straits[0]
        yield Note.of(
            "straits-shut",
            count=len(straits),
            widest=Place(widest.lon, widest.lat),
            width_m=widest.width_m,
            needed_m=widest.needed_m,
        )


def crossing_notes(crossings: Sequence[ShoreCrossing], chart: ChartSpec) -> tuple[Note, ...]:
    """Return a note on the places where a case's routes cross the second shoreline, if any.

    Crossings of the best route come first; the longest come first within both groups.
    """
    kind = "second-shoreline" if has_world_land(chart) else "unlisted-land"
    return (Note.of(kind, crossings=_crossing_places(crossings)),) if crossings else ()


def _crossing_places(crossings: Sequence[ShoreCrossing]) -> tuple[Note, ...]:
    """Return the places, each with its longest crossing and all routes that cross."""
    there: dict[tuple[float, float], list[ShoreCrossing]] = {}
    for one in crossings:
        place = round(one.lon, _SAME_PLACE), round(one.lat, _SAME_PLACE)
        there.setdefault(place, []).append(one)
    found = [
        (min(one.rank for one in group) > 1, max(group, key=lambda one: one.length_m), group)
        for group in there.values()
    ]
    return tuple(
        Note.of(
            "crossing",
            length_m=longest.length_m,
            place=Place(longest.lon, longest.lat),
            routes=tuple(sorted({one.rank for one in group})),
        )
        for _, longest, group in sorted(found, key=lambda one: (one[0], -one[1].length_m))
    )
