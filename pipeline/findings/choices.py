"""When to leave, how fast, which side among members, how to go on under way: sentences and rows."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from pipeline import model
from pipeline._types import FloatArray
from pipeline.findings import text
from pipeline.findings.result import RankedRoute, RunCase, RunResult

AS_GOOD = 0.01
"""A departure that needs at most this share of fuel above the least counts as good."""

# Share of the time under way that is added or taken off to say what time is worth.
_MORE_OR_LESS = 0.1
# Smallest difference between two arrivals that counts, as a share of the time under way.
_IN_TIME = 5e-3
# Smallest difference in fuel that is mentioned, as a share of the fuel.
_NO_LESS_FUEL = 5e-4


def departure_text(choice: model.DepartureChoice) -> tuple[str, ...]:
    """Say in sentences when to leave."""
    if choice.arrive_by is not None:
        leave, by = text.exact_moment_text(choice.chosen), text.moment_text(choice.arrive_by)
        taking = text.hours(choice.least_s)
        return (f"Leave at {leave}, the latest departure that arrives by {by}, after {taking}.",)
    count = int(np.isfinite(choice.fuels).sum())
    first, last = (_moment(choice, at) for at in choice.departures_s[[0, -1]])
    best = (
        f"Leave at {text.moment_text(choice.chosen)}: of {count} departures planned from {first} "
        f"to {last} {_merit(choice)}."
    )
    sentences = [best]
    most = float(choice.fuels[np.isfinite(choice.fuels)].max())
    if count > 1:
        worst = int(np.where(np.isfinite(choice.fuels), choice.fuels, -np.inf).argmax())
        sentences.append(
            f"The dearest, at {_moment(choice, choice.departures_s[worst])}, needs "
            f"{text.percent(most / float(choice.fuels.min()) - 1)} more."
        )
        begin, end = choice.good_window(AS_GOOD)
        if end > begin:
            sentences.append(
                f"Every departure planned from {_moment(choice, begin)} to {_moment(choice, end)} "
                f"needs at most {text.percent(AS_GOOD, 0)} more than the best."
            )
    shut = len(choice.fuels) - count
    if shut:
        at = next(i for i, reason in enumerate(choice.reasons) if reason)
        sentences.append(
            f"{shut} of the departures planned can't be sailed; for example "
            f"{_moment(choice, choice.departures_s[at])}: {choice.reasons[at]}."
        )
    sentences.append(_proof(choice))
    return tuple(sentences)


def _merit(choice: model.DepartureChoice) -> str:
    """Say in which respect the best departure is the best."""
    lasts = text.hours(choice.least_s)
    if choice.has_speeds:
        return (
            f"it needs the least fuel to be there in time, at speeds chosen for {lasts} under way"
        )
    return f"it is under way for the least time, {lasts}, and needs the least fuel"


def _proof(choice: model.DepartureChoice) -> str:
    """Say what is proven about departures between the planned ones."""
    if choice.has_speeds:
        return (
            "Nothing is known about departures between these, because speeds are chosen for each."
        )
    if not math.isfinite(choice.unproven_s):
        return (
            "Nothing is known about departures between these: in places the current is as strong "
            "as the vessel, or an area is shut for some hours."
        )
    return (
        "Apart from the error of the paths, no other departure in this window saves more than "
        f"{text.at_most_hours(choice.unproven_s)}, because a later departure on the same water "
        "never arrives earlier. Smaller savings were searched for, but are not ruled out."
    )


def _moment(choice: model.DepartureChoice, seconds: float) -> str:
    """Write a time of the choice's clock, seconds, as a date."""
    return text.moment_text(choice.first + timedelta(seconds=float(seconds)))


@dataclass(frozen=True, eq=False)
class SpeedTradeOff:
    """Least fuel for each arrival, and the chosen arrival; durations are at true scale.

    Attributes
    ----------
    case : its name.
    departure, arrive_by : times of departure and of the latest allowed arrival, UTC.
    choice : the speeds that may be chosen.
    durations_s : (n,) seconds under way, ascending; the first is sailed at the highest speed.
    fuels : (n,) falling, in the planner's units.
    metrics : of the best route.
    slowest, fastest : its lowest and highest speed through water, m/s.
    """

    case: str
    departure: datetime
    arrive_by: datetime
    choice: model.SpeedChoice
    durations_s: FloatArray
    fuels: FloatArray
    metrics: model.RouteMetrics
    slowest: float
    fastest: float

    @property
    def duration_s(self) -> float:
        """Time under way of the best route, s."""
        return self.metrics.duration_s

    @property
    def fuel(self) -> float:
        """Fuel of the best route, in the planner's units."""
        return self.metrics.fuel

    def fuel_after(self, duration_s: float) -> float:
        """Return least fuel to reach the goal within a duration, s; NaN if that is too short."""
        return float(np.interp(duration_s, self.durations_s, self.fuels, left=np.nan))

    def moment(self, duration_s: float) -> datetime:
        """Return the time (UTC) after a duration, s."""
        return self.departure + timedelta(seconds=round(duration_s))


def trade_off(case: RunCase) -> SpeedTradeOff | None:
    """Return the trade-off of a case; None where no speeds were chosen, or no route was found."""
    plan, departure = case.plan, case.spec.departure
    if not case.routes or plan is None or plan.trade_off is None or departure is None:
        return None
    choice, route, metrics = case.case.speeds, case.routes[0].route, case.routes[0].metrics
    if choice is None:
        return None
    # True seconds for each second of the planner; durations are counted from the departure.
    stretch = metrics.duration_s / route.duration
    begin = departure.astimezone(UTC)
    return SpeedTradeOff(
        case=case.name,
        departure=begin,
        arrive_by=begin + timedelta(seconds=choice.within_s),
        choice=choice,
        durations_s=stretch * (plan.trade_off.arrivals - route.times[0]),
        fuels=plan.trade_off.fuels,
        metrics=metrics,
        slowest=float(route.speeds.min()),
        fastest=float(route.speeds.max()),
    )


def trade_offs(result: RunResult) -> tuple[SpeedTradeOff, ...]:
    """Return the trade-offs of all cases that have one."""
    found = map(trade_off, result.cases)
    return tuple(one for one in found if one is not None)


def trade_off_text(chosen: SpeedTradeOff) -> tuple[str, ...]:
    """Say in sentences how fast the vessel sails, and what more or less time is worth."""
    allowed = f"{chosen.choice.least:.3g}–{chosen.choice.most:.3g} m/s"
    low, high = text.speed_range(chosen.slowest, chosen.fastest)
    how = f"Speeds through water of {low}–{high} m/s, chosen from leg to leg among {allowed}, bring"
    if low == high:
        how = f"A speed of {low} m/s through water all the way, among {allowed}, brings"
    there = f"by {text.moment_text(chosen.arrive_by)}"
    if chosen.duration_s < (1 - _IN_TIME) * chosen.choice.within_s:
        there = (
            f"at {text.moment_text(chosen.moment(chosen.duration_s))}, before the deadline of "
            f"{text.moment_text(chosen.arrive_by)}"
        )
    return (f"{how} the vessel to the goal {there}, with the least fuel.", *_worth(chosen))


def speed_notes(result: RunResult) -> tuple[model.Note, ...]:
    """Note the speeds of each case in which they are chosen."""
    return tuple(
        model.Note.of("speeds-chosen", found=one).about(
            *result.scenario.season_if_several(one.case)
        )
        for one in trade_offs(result)
    )


def _worth(chosen: SpeedTradeOff) -> Iterator[str]:
    """Say what more and less time are worth, if there is a choice."""
    change = _MORE_OR_LESS * chosen.duration_s
    more, less = (chosen.fuel_after(chosen.duration_s + by) for by in (change, -change))
    said = []
    if chosen.fuel - more > _NO_LESS_FUEL * chosen.fuel:
        said.append(
            f"{text.hours(change)} more would save "
            f"{text.percent(1 - more / chosen.fuel)} of the fuel"
        )
    if less - chosen.fuel > _NO_LESS_FUEL * chosen.fuel:
        said.append(
            f"{text.hours(change)} less would take {text.percent(less / chosen.fuel - 1)} more"
        )
    if said:
        yield f"{'; '.join(said)}."
    first, last = chosen.durations_s[[0, -1]]
    if first < (1 - _IN_TIME) * chosen.duration_s:
        yield (
            f"At the highest speed the vessel could be there at "
            f"{text.moment_text(chosen.moment(first))}, for "
            f"{text.percent(chosen.fuels[0] / chosen.fuel - 1)} more fuel."
        )
    if last > (1 + _IN_TIME) * chosen.duration_s:
        yield (
            f"More time saves fuel until {text.moment_text(chosen.moment(last))}: an arrival then "
            f"takes {text.percent(1 - chosen.fuels[-1] / chosen.fuel)} less fuel."
        )


# Smallest fuel that is mentioned, as a share of the fuel planned.
_LEAST = 5e-5
# Smallest time that is mentioned, s.
_LEAST_S = 30.0
# Smallest distance that is mentioned, m.
_LEAST_M = 1.0


def replanned_notes(result: RunResult) -> Iterator[model.Note]:
    """Yield a note on the new plan of a voyage under way."""
    for one in result.results:
        if one.replanned is not None:
            yield model.Note.of("replanned", found=one.replanned).about(one.name)


def replanned_text(replan: model.ReplanFigures) -> tuple[str, ...]:
    """Say in sentences whether the planned way is kept, at what fuel, and what changed the fuel."""
    margin = "in the margin around land; the plan begins in the water, {} from there"
    moved = f", {margin.format(text.distance(replan.moved_m))}" if replan.moved_m > 0 else ""
    return f"{_answer(replan)}.", f"The vessel is {_place(replan)}{moved}.", f"{_causes(replan)}."


def _answer(replan: model.ReplanFigures) -> str:
    """Say which way to take, with the fuel of each side."""
    fuel = text.fuel(replan.fuel, replan)
    if replan.answer == "kept":
        return f"Kept: stay on the way that was planned, which needs {fuel} from here"
    if math.isfinite(replan.kept_fuel):
        return (
            f"Switched: take the other way, which needs {fuel} from here; the way that was "
            f"planned would need {text.fuel(replan.kept_fuel, replan)}"
        )
    reason = f" ({replan.kept_reason})" if replan.kept_reason else ""
    return (
        f"Switched: take the other way, which needs {fuel} from here; the way that was "
        f"planned can't be sailed from here{reason}"
    )


def _place(replan: model.ReplanFigures) -> str:
    """Say how far the vessel is off its plan, and how late or early."""
    off = (
        f"{text.distance(replan.off_m)} off its plan" if replan.off_m >= _LEAST_M else "on its plan"
    )
    if abs(replan.late_s) < _LEAST_S:
        return f"{off} and on time"
    early_or_late = "late" if replan.late_s > 0 else "early"
    return f"{off} and {text.hours(abs(replan.late_s))} {early_or_late}"


def _causes(replan: model.ReplanFigures) -> str:
    """Say what changed the fuel of the whole voyage."""
    changes = [
        f"{words} {'costs' if fuel > 0 else 'saves'} {text.fuel(abs(fuel), replan)}"
        for words, fuel in (
            ("being off the plan, late or early", replan.by_drift),
            ("the new forecast", replan.by_forecast),
            ("the way ahead, against the planned one,", -replan.saved),
        )
        if math.isfinite(fuel) and abs(fuel) > _LEAST * replan.planned_fuel
    ]
    if not math.isfinite(replan.by_drift):
        changes = ["no straight leg leads back to the planned way"]
    why = f": {', '.join(changes)}" if changes else ", as planned"
    planned = ""
    if replan.energy is not None:
        planned = f"The plan needed {text.fuel(replan.planned_fuel, replan)}, of which "
    return (
        f"{planned}{text.fuel(replan.burnt, replan)} is burnt; the whole voyage now needs "
        f"{text.fuel(replan.burnt + replan.fuel, replan)}{why}"
    )


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


ENSEMBLE_FIGURES = ("members_count", "members_flips", "members_waiting_saves", "members_gap")
"""How sure a case's first route is: how many members there are, in how many of them another side
is the best, what is saved on average if the member is known before (the planner's fuel), and by
what share the mean of another single route may be smaller, at most."""


def way_text(one: model.RouteMetrics) -> str:
    """Name a route by its side, or by its rank where no island distinguishes it."""
    return one.main_passage or f"route {one.rank}"


def side_shares(ensemble: model.EnsembleFigures, routes: Iterable[model.RouteMetrics]) -> str:
    """Say in what share of the members each side is the best, the likeliest first."""
    shares: dict[str, float] = {}
    for one in routes:
        shares[way_text(one)] = shares.get(way_text(one), 0.0) + ensemble.share(one.rank)
    by_share = sorted(shares.items(), key=lambda side: -side[1])
    return "; ".join(f"{side} in {text.percent(share, 0)}" for side, share in by_share if share)


def close_sides(ensemble: model.EnsembleFigures, routes: Sequence[model.RouteMetrics]) -> list[str]:
    """Return the other sides that are not surely dearer than the first route's."""
    sides = dict.fromkeys(way_text(one) for one in routes if one.rank in ensemble.close)
    return [side for side in sides if side != way_text(routes[0])]


def ensemble_figures(
    ensemble: model.EnsembleFigures, routes: Sequence[model.RouteMetrics]
) -> dict[str, Any]:
    """Return how sure a case's side is, by `ENSEMBLE_FIGURES`; None for what is not finite."""
    sides = {one.rank: way_text(one) for one in routes}
    flips = sum(sides.get(rank, sides[1]) != sides[1] for rank in ensemble.best_in)
    figures = (ensemble.waiting_saves, ensemble.gap("mean"))
    known = (one if math.isfinite(one) else None for one in figures)
    return dict(zip(ENSEMBLE_FIGURES, (len(ensemble.names), flips, *known), strict=True))


def flips_text(figures: Mapping[str, Any]) -> str:
    """Say in how many members another side is the best."""
    flips, count = figures["members_flips"], figures["members_count"]
    return f"the side flips in {flips or 'none'} of {count} members"


def ensemble_text(case: RunCase) -> tuple[str, ...]:
    """Say in sentences how sure the side is; empty without members."""
    ensemble, routes = case.result.ensemble, case.routes
    return () if ensemble is None or not routes else tuple(_sentences(ensemble, routes))


def ensemble_notes(result: RunResult) -> tuple[model.Note, ...]:
    """Note how sure the side of each case with members is."""
    return tuple(
        model.Note.of("how-sure", said=said[0].removesuffix(".")).about(
            *result.scenario.season_if_several(case.name)
        )
        for case in result.cases
        if (said := ensemble_text(case))
    )


def _sentences(ensemble: model.EnsembleFigures, routes: tuple[RankedRoute, ...]) -> Iterator[str]:
    """Yield sentences on a case's routes in the members of its current."""
    metrics = [one.metrics for one in routes]
    best = way_text(metrics[0])
    others = close_sides(ensemble, metrics)
    verdict = f"Surely {best}, by {_CHOSEN_BY[ensemble.choose]}"
    if others:
        verdict = f"Too close to call between {best} and {' and '.join(others)}"
    yield (
        f"{verdict}: {flips_text(ensemble_figures(ensemble, metrics))}, each of which may come "
        f"true. The best is {side_shares(ensemble, metrics)}."
    )
    mean = ensemble.statistic("mean", 1)
    if not math.isfinite(mean):
        yield "The route taken can't be sailed in every member."
    else:
        regret = ensemble.statistic("regret", 1)
        p90, cvar = (ensemble.statistic(name, 1) for name in ("p90", "cvar90"))
        most = ""
        if regret > _NOTHING * mean:
            share = text.at_most_percent(regret / mean)
            most = f" Where it is most wrong, another route needs {share} of that less."
        worst = ""
        if ensemble.has_quantiles:
            worst = (
                f", and at most {text.at_most_percent(p90 / mean - 1)} more in nine members of ten"
                f"; the worst tenth needs {text.percent(cvar / mean - 1)} more"
            )
        yield f"The route taken needs {text.fuel(mean, metrics[0])} on average{worst}.{most}"
        if ensemble.waiting_saves > _NOTHING * mean:
            worth = text.at_most_percent(ensemble.waiting_saves / mean)
            yield (
                f"To know the member before the side is chosen would save {worth} on average: "
                "waiting for a better forecast is worth no more than that to this choice."
            )
        saves = [
            text.at_most_percent(1 - 1 / (1 + ensemble.gap(name))) for name in ("mean", "cvar90")
        ]
        worst = f", and at most {saves[1]} in the worst tenth" * ensemble.has_quantiles
        yield f"Any other single route saves at most {saves[0]} of that{worst}."
    yield from _shut(ensemble, routes)


def _shut(ensemble: model.EnsembleFigures, routes: tuple[RankedRoute, ...]) -> Iterator[str]:
    """Yield in which members routes can't be sailed."""
    for one in routes:
        members = [(member, why) for rank, member, why in ensemble.shut if rank == one.rank]
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
        ensemble = case.result.ensemble
        if ensemble is None:
            continue
        for at, (member, weight) in enumerate(
            zip(ensemble.names, ensemble.weights.tolist(), strict=True)
        ):
            for one in case.routes:
                fuel = float(ensemble.fuels[one.rank - 1, at])
                yield {
                    "season": case.name,
                    "member": member,
                    "weight": weight,
                    "rank": one.rank,
                    "way": one.metrics.way,
                    "homotopy": one.metrics.homotopy,
                    "fuel": fuel if math.isfinite(fuel) else None,
                    "is_best": ensemble.best_in[at] == one.rank,
                }
