"""What a reader should know that is not known: depths, filled currents, straits that are shut."""

from collections.abc import Iterator, Sequence
from typing import Protocol

from pipeline.model import Evaluation, Fetched, Note, Place, RouteMetrics, ShutStrait, of_seasons
from pipeline.scenario.model import Scenario

MAX_STRAITS = 10
"""Largest number of straits that are listed, the widest first."""

# Shares of a route below this count as none: a thousandth, as percentages have one decimal.
_NONE = 5e-4


class Planned(Protocol):
    """What a run planned: its whole result, or its outcome."""

    @property
    def scenario(self) -> Scenario:
        """The scenario."""
        ...

    @property
    def fetched(self) -> Fetched:
        """Land and currents."""
        ...

    @property
    def evaluation(self) -> Evaluation:
        """The routes' figures."""
        ...

    @property
    def straits(self) -> tuple[ShutStrait, ...]:
        """The straits that are shut."""
        ...


def unknowns(planned: Planned) -> tuple[Note, ...]:
    """Note what is not known of a run's routes; nothing of a plane's."""
    if planned.scenario.is_planar:
        return ()
    rows = planned.evaluation.routes
    seasons = dict.fromkeys(row.season for row in rows)
    by_season = {
        season: _of_routes([row for row in rows if row.season == season]) for season in seasons
    }
    return (*_of_chart(planned), *of_seasons(by_season), *_of_straits(planned.straits))


def route_unknowns(planned: Planned, metrics: RouteMetrics) -> tuple[Note, ...]:
    """Note what is not known of one route."""
    if planned.scenario.is_planar:
        return ()
    return (*_of_chart(planned), *_of_routes([metrics]))


def has_all_depths(metrics: RouteMetrics) -> bool:
    """Whether depths are charted all along a route; False in a chart without depths."""
    return metrics.uncharted_share <= _NONE


def _of_chart(planned: Planned) -> Iterator[Note]:
    """Yield that a chart has no depths."""
    if planned.fetched.land.depths is None:
        yield Note.of("no-depths")


def _of_routes(rows: Sequence[RouteMetrics]) -> list[Note]:
    """Note how much of a season's routes is without depths, and without figures of the current."""
    found = {
        "current-filled": [(row.rank, row.filled_share) for row in rows],
        "depth-uncharted": [(row.rank, row.uncharted_share) for row in rows],
    }
    some = {
        kind: tuple((rank, share) for rank, share in shares if share > _NONE)
        for kind, shares in found.items()
    }
    return [
        Note.of(kind, first=rows[0].rank, shares=shares) for kind, shares in some.items() if shares
    ]


def _of_straits(straits: Sequence[ShutStrait]) -> Iterator[Note]:
    """Yield a note on the straits that are shut, with the place of the widest."""
    if straits:
        widest = straits[0]
        yield Note.of(
            "straits-shut",
            count=len(straits),
            widest=Place(widest.lon, widest.lat),
            width_m=widest.width_m,
            needed_m=widest.needed_m,
        )
