"""What is not known about a run: currents, coasts, depths, and straits that are shut."""

from collections.abc import Collection, Iterator, Sequence
from typing import Protocol

from pipeline import model
from pipeline.model import ShoreCrossing
from pipeline.model.inputs import Note, Place, of_seasons
from pipeline.scenario.model import Scenario

# Shares of a route below this count as none: a thousandth, as percentages have one decimal.
_NONE = 5e-4
# Crossings whose positions agree to this many decimals of a degree (100 m) are one place.
_SAME_PLACE = 3


class Planned(Protocol):
    """A run's whole result, or its outcome."""

    @property
    def scenario(self) -> Scenario:
        """The scenario."""

    @property
    def fetched(self) -> model.Fetched:
        """Land and currents."""

    @property
    def evaluation(self) -> model.Evaluation:
        """The routes' figures."""

    @property
    def straits(self) -> tuple[model.ShutStrait, ...]:
        """The shut straits."""


def unknowns(planned: Planned) -> tuple[Note, ...]:
    """Note what is not known about a run's routes; nothing in a planar scenario."""
    if planned.scenario.is_planar:
        return ()
    rows = planned.evaluation.routes
    seasons = dict.fromkeys(row.season for row in rows)
    by_season = {
        season: _of_routes([row for row in rows if row.season == season]) for season in seasons
    }
    return (
        *_of_currents(planned, seasons),
        *crossing_notes(planned.evaluation.shore_crossings),
        *_of_chart(planned),
        *of_seasons(by_season),
        *_of_straits(planned.straits),
    )


def route_unknowns(planned: Planned, metrics: model.RouteMetrics) -> tuple[Note, ...]:
    """Note what is not known about one route."""
    if planned.scenario.is_planar:
        return ()
    crossings = [
        one
        for one in planned.evaluation.shore_crossings
        if (one.season, one.rank) == (metrics.season, metrics.rank)
    ]
    return (
        *_of_currents(planned, [metrics.season]),
        *crossing_notes(crossings),
        *_of_chart(planned),
        *_of_routes([metrics]),
    )


def lacks_current(planned: Planned, season: str) -> bool:
    """Whether the current on a season's best route is not known at all.

    It was left out, or its source has no figure on the whole route.
    """
    grid = next((one for one in planned.fetched.currents if one.season == season), None)
    best = next((row for row in planned.evaluation.routes if row.season == season), None)
    if grid is None or best is None:
        return False
    return grid.is_left_out or best.filled_share >= 1 - _NONE


def _of_currents(planned: Planned, seasons: Collection[str]) -> Iterator[Note]:
    """Yield a note on each season of which the current is not known at all."""
    for grid in planned.fetched.currents:
        if grid.season in seasons and lacks_current(planned, grid.season):
            yield Note.of("current-unknown", left_out=grid.is_left_out).about(grid.season)


def has_all_depths(metrics: model.RouteMetrics) -> bool:
    """Whether depths are charted all along a route."""
    return metrics.uncharted_share <= _NONE


def _of_chart(planned: Planned) -> Iterator[Note]:
    """Yield a note if the chart has no depths."""
    if planned.fetched.land.depths is None:
        yield Note.of("no-depths")


def _of_routes(rows: Sequence[model.RouteMetrics]) -> list[Note]:
    """Note how much of a season's routes lacks depths, and how much lacks data of the current."""
    found = []
    for kind, name in (("current-filled", "filled_share"), ("depth-uncharted", "uncharted_share")):
        shares = tuple((row.rank, share) for row in rows if (share := getattr(row, name)) > _NONE)
        if shares:
            found.append(Note.of(kind, first=rows[0].rank, shares=shares))
    return found


def _of_straits(straits: Sequence[model.ShutStrait]) -> Iterator[Note]:
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


def crossing_notes(crossings: Sequence[ShoreCrossing]) -> tuple[Note, ...]:
    """Return a note for each season on the places where its routes cross the second shoreline.

    Crossings of the best route come first; the longest come first within both groups.
    """
    return of_seasons(
        {
            season: [Note.of("second-shoreline", crossings=_crossing_places(crossings, season))]
            for season in dict.fromkeys(one.season for one in crossings)
        }
    )


def _crossing_places(crossings: Sequence[ShoreCrossing], season: str) -> tuple[Note, ...]:
    """Return the places of a season, each with its longest crossing and all routes that cross."""
    there: dict[tuple[float, float], list[ShoreCrossing]] = {}
    for one in crossings:
        if one.season == season:
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
