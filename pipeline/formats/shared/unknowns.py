"""What a reader should know that is not known: depths, filled currents, straits that are shut."""

from collections.abc import Iterator, Sequence
from typing import Protocol

from pipeline.formats.shared.text import distance, percent, place
from pipeline.model import Evaluation, Fetched, RouteMetrics, ShutStrait, season_notes
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


def unknowns(planned: Planned) -> tuple[str, ...]:
    """Say what is not known of a run's routes, one sentence each; nothing of a plane's."""
    if planned.scenario.is_planar:
        return ()
    rows = planned.evaluation.routes
    seasons = dict.fromkeys(row.season for row in rows)
    by_season = {
        season: _of_routes([row for row in rows if row.season == season]) for season in seasons
    }
    return (*_of_chart(planned), *season_notes(by_season), *_of_straits(planned.straits))


def route_unknowns(planned: Planned, metrics: RouteMetrics) -> tuple[str, ...]:
    """Say what is not known of one route."""
    if planned.scenario.is_planar:
        return ()
    return (*_of_chart(planned), *_of_routes([metrics]))


def has_all_depths(metrics: RouteMetrics) -> bool:
    """Whether depths are charted all along a route; False in a chart without depths."""
    return metrics.uncharted_share <= _NONE


def _of_chart(planned: Planned) -> Iterator[str]:
    """Yield that a chart has no depths."""
    if planned.fetched.land.depths is None:
        yield "no depths in this chart: the draught was not used, and shoals are not avoided"


def _of_routes(rows: Sequence[RouteMetrics]) -> list[str]:
    """Say how much of a season's routes is without depths, and without figures of the current."""
    filled = _shares(rows, [row.filled_share for row in rows])
    blank = _shares(rows, [row.uncharted_share for row in rows])
    found = []
    if filled:
        found.append(
            f"the source of the current has no figure for {filled}: it was filled from the water "
            "around"
        )
    if blank:
        found.append(f"no depth is charted for {blank}")
    return found


def _shares(rows: Sequence[RouteMetrics], shares: Sequence[float]) -> str:
    """Spell the shares of the routes that have any: of the first, and the largest of the others."""
    some = [(row.rank, share) for row, share in zip(rows, shares, strict=True) if share > _NONE]
    texts = [f"{percent(share)} of route {rank}" for rank, share in some if rank == rows[0].rank]
    others = [one for one in some if one[0] != rows[0].rank]
    if others:
        rank, largest = max(others, key=lambda one: one[1])
        more = f" (the most of {len(others)} others)" if len(others) > 1 else ""
        texts.append(f"{percent(largest)} of route {rank}{more}")
    return " and ".join(texts)


def _of_straits(straits: Sequence[ShutStrait]) -> Iterator[str]:
    """Yield a sentence on the straits that are shut, with the place of the widest."""
    if not straits:
        return
    widest = straits[0]
    count = "1 strait is" if len(straits) == 1 else f"{len(straits)} straits are"
    yield (
        f"{count} shut by margin or padding, the widest at {place(widest.lon, widest.lat)}: "
        f"{distance(widest.width_m)} between its sides, and {distance(widest.needed_m)} are needed"
    )
