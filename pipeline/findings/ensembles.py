"""How sure a case's side is, for readers: sentences, and a row for each route and member."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from pipeline.findings import text
from pipeline.findings.result import RankedRoute, RunCase, RunResult
from pipeline.model import EnsembleFigures, Note, RouteMetrics

# Saving that is not worth a sentence, as a share of the mean fuel.
_NOTHING = 5e-4
# Largest number of members that are named.
_MAX_NAMED = 4
_CHOSEN_BY = {
    "mean": "mean fuel",
    "p90": "the fuel that nine in ten members don't exceed",
    "cvar90": "the mean fuel of the worst tenth of the members",
    "regret": "the largest excess over a member's best side",
}

ENSEMBLE_COLUMNS = ("season", "member", "weight", "rank", "way", "homotopy", "fuel", "is_best")
"""Fuel is in the planner's units, of the route in this member; empty where it can't be sailed."""


def has_ensembles(result: RunResult) -> bool:
    """Whether any case has members."""
    return any(one.ensemble is not None for one in result.results)


ENSEMBLE_FIGURES = ("members_count", "members_flips", "members_waiting_saves", "members_gap")
"""How sure a case's first route is: how many members there are, in how many of them another side
is the best, what is saved on average if the member is known before (the planner's fuel), and the
share by which any single route may have a smaller mean, at most."""


def way_text(one: RouteMetrics) -> str:
    """Name a route by its side, or by its rank where no island distinguishes it."""
    return one.main_passage or f"route {one.rank}"


def side_shares(found: EnsembleFigures, routes: Iterable[RouteMetrics]) -> str:
    """Say in what share of the members each side is the best, the likeliest first."""
    shares: dict[str, float] = {}
    for one in routes:
        shares[way_text(one)] = shares.get(way_text(one), 0.0) + found.share(one.rank)
    by_share = sorted(shares.items(), key=lambda side: -side[1])
    return "; ".join(f"{side} in {text.percent(share, 0)}" for side, share in by_share if share)


def close_sides(found: EnsembleFigures, routes: Sequence[RouteMetrics]) -> list[str]:
    """Return the other sides that are not surely dearer than the first route's."""
    sides = dict.fromkeys(way_text(one) for one in routes if one.rank in found.close)
    return [side for side in sides if side != way_text(routes[0])]


def sides_text(found: EnsembleFigures, routes: Sequence[RouteMetrics]) -> str:
    """Say whether the side is too close to call, and the shares of the sides."""
    is_close = "too close to call: " if close_sides(found, routes) else ""
    return is_close + side_shares(found, routes)


def ensemble_figures(found: EnsembleFigures, routes: Sequence[RouteMetrics]) -> dict[str, Any]:
    """Return the figures of a case's routes, by rank; None where one is not finite."""
    sides = {one.rank: way_text(one) for one in routes}
    flips = sum(sides.get(rank, sides[1]) != sides[1] for rank in found.best_in)
    figures = (found.waiting_saves, found.gap("mean"))
    known = (one if math.isfinite(one) else None for one in figures)
    return dict(zip(ENSEMBLE_FIGURES, (len(found.names), flips, *known), strict=True))


def flips_text(figures: Mapping[str, Any]) -> str:
    """Say in how many members another side is the best."""
    flips, count = figures["members_flips"], figures["members_count"]
    return f"the side flips in {flips or 'none'} of {count} members"


def ensemble_text(case: RunCase) -> tuple[str, ...]:
    """Say in sentences how sure the side is; empty without members."""
    found, routes = case.result.ensemble, case.routes
    return () if found is None or not routes else tuple(_sentences(found, routes))


def ensemble_notes(result: RunResult) -> tuple[Note, ...]:
    """Note how sure the side of each case with members is."""
    return tuple(
        Note.of("how-sure", said=said[0].removesuffix(".")).about(
            *result.scenario.season_if_several(case.name)
        )
        for case in result.cases
        if (said := ensemble_text(case))
    )


def _sentences(found: EnsembleFigures, routes: tuple[RankedRoute, ...]) -> Iterator[str]:
    """Yield what the members say of a case's routes."""
    metrics = [one.metrics for one in routes]
    best = way_text(metrics[0])
    others = close_sides(found, metrics)
    verdict = f"Surely {best}, by {_CHOSEN_BY[found.choose]}"
    if others:
        verdict = f"Too close to call between {best} and {' and '.join(others)}"
    yield (
        f"{verdict}: {flips_text(ensemble_figures(found, metrics))}, each of which may come true. "
        f"The best is {side_shares(found, metrics)}."
    )
    mean = found.statistic("mean", 1)
    if not math.isfinite(mean):
        yield "The route taken can't be sailed in every member."
    else:
        regret = found.statistic("regret", 1)
        p90, cvar = (found.statistic(name, 1) for name in ("p90", "cvar90"))
        most = ""
        if regret > _NOTHING * mean:
            share = text.at_most_percent(regret / mean)
            most = f" Where it is most wrong, another route needs {share} of that less."
        worst = ""
        if found.has_quantiles:
            worst = (
                f", and at most {text.at_most_percent(p90 / mean - 1)} more in nine members of ten"
                f"; the worst tenth needs {text.percent(cvar / mean - 1)} more"
            )
        yield f"The route taken needs {text.fuel(mean)} on average{worst}.{most}"
        if found.waiting_saves > _NOTHING * mean:
            worth = text.at_most_percent(found.waiting_saves / mean)
            yield (
                f"To know the member before the side is chosen would save {worth} on average: "
                "waiting for a better forecast is worth no more than that to this choice."
            )
        saves = [text.at_most_percent(1 - 1 / (1 + found.gap(name))) for name in ("mean", "cvar90")]
        worst = f", and at most {saves[1]} in the worst tenth" * found.has_quantiles
        yield f"Any other single route saves at most {saves[0]} of that{worst}."
    yield from _shut(found, routes)


def _shut(found: EnsembleFigures, routes: tuple[RankedRoute, ...]) -> Iterator[str]:
    """Yield in which members routes can't be sailed."""
    for one in routes:
        members = [(member, why) for rank, member, why in found.shut if rank == one.rank]
        if members:
            named = ", ".join(member for member, _ in members[:_MAX_NAMED])
            more = f" and {len(members) - _MAX_NAMED} more" * (len(members) > _MAX_NAMED)
            yield (
                f"{text.capitalised(way_text(one.metrics))} can't be sailed in {named}{more}: "
                f"{members[0][1]}."
            )


def ensemble_rows(result: RunResult) -> Iterator[dict[str, Any]]:
    """Yield a row for each route in each member, of all cases that have members."""
    for case in result.cases:
        found = case.result.ensemble
        if found is None:
            continue
        for at, (member, weight) in enumerate(
            zip(found.names, found.weights.tolist(), strict=True)
        ):
            for one in case.routes:
                fuel = float(found.fuels[one.rank - 1, at])
                yield {
                    "season": case.name,
                    "member": member,
                    "weight": weight,
                    "rank": one.rank,
                    "way": one.metrics.way,
                    "homotopy": one.metrics.homotopy,
                    "fuel": fuel if math.isfinite(fuel) else None,
                    "is_best": found.best_in[at] == one.rank,
                }
