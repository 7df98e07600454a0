"""The table of pairs of features that a scenario can't have together, each with its reason.

A scenario may have every other pair. The scenario's checks and the reference are made from this
table, and a property test compares random scenarios with it. What one feature needs (a departure, a
draught) is no pair: `loading` checks it.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from pipeline.scenario.model import Scenario
from pipeline.scenario.season import Season

OF_THE_SCENARIO: dict[str, Callable[[Scenario], bool]] = {
    "a [plane]": lambda asked: asked.plane is not None,
    "no [plane]": lambda asked: asked.plane is None,
    "[region]": lambda asked: asked.region is not None,
    "a scale other than 1": lambda asked: asked.scale != 1,
    "[[avoid]]": lambda asked: bool(asked.avoid),
    "hours in [[avoid]]": lambda asked: any(area.has_hours for area in asked.avoid),
    "a [tide]": lambda asked: asked.tide is not None,
    "[limits]": lambda asked: asked.limits is not None,
    "a wait in [limits]": lambda asked: bool(asked.limits and asked.limits.wait_s),
    "[havens]": lambda asked: asked.havens is not None,
    "[under_way]": lambda asked: asked.under_way is not None,
    "via points": lambda asked: bool(asked.via),
    "a wait at an anchorage": lambda asked: asked.anchorage is not None,
    "planner.adrift": lambda asked: asked.planner.adrift is not None,
    "planner.method = 'sampled'": lambda asked: asked.planner.method == "sampled",
    "another planner.order than 'fuel'": lambda asked: asked.planner.order != "fuel",
}
"""Features of a whole scenario, as a message names them."""

OF_A_SEASON: dict[str, Callable[[Season], bool]] = {
    "sources in 'currents'": lambda asked: bool(asked.currents),
    "a current as numbers": lambda asked: not asked.currents,
    "time_method = 'changing'": lambda asked: asked.is_changing,
    "'departures'": lambda asked: asked.departures is not None,
    "'to_within'": lambda asked: asked.to_within is not None,
    "'arrive_by'": lambda asked: asked.arrive_by is not None,
    "'speed'": lambda asked: asked.speed is not None,
    "'speed' in a current that changes": lambda asked: (
        asked.speed is not None and asked.is_changing
    ),
    "'members'": lambda asked: asked.members is not None,
}
"""Features of one season, as a message names them."""


class RefusedPair(NamedTuple):
    """Two groups of features: no feature of the first goes together with one of the second."""

    first: tuple[str, ...]
    second: tuple[str, ...]
    reason: str
    remedy: str = "leave one of the two out"


_CHOICES_OF_TIME = ("'departures'", "'arrive_by'", "'speed'")
_HOURS = ("hours in [[avoid]]", "a [tide]", "[limits]")
_AT_TRUE_SCALE = "plan at true scale, scale = 1"

PAIRS = (
    RefusedPair(
        ("a [plane]",),
        (
            *("[region]", "[[avoid]]", "a [tide]", "[limits]", "[havens]", "[under_way]"),
            "sources in 'currents'",
        ),
        "nothing in a plane lies in lon/lat, and it has neither depths nor sources",
        "leave one of the two out; a plane has obstacles, and a current as 'gyre' or 'uniform'",
    ),
    RefusedPair(
        ("no [plane]",),
        ("a current as numbers",),
        "'gyre' and 'uniform' are along the axes of a plane",
        "name sources in 'currents', or add a [plane]",
    ),
    RefusedPair(
        ("time_method = 'changing'",),
        ("a current as numbers",),
        "such a current doesn't change",
        "name 'currents'",
    ),
    RefusedPair(
        ("a scale other than 1",),
        ("time_method = 'changing'", "'speed'", *_HOURS, "[havens]", "[under_way]"),
        "at that scale times under way are not the true ones, and the tide would change during a "
        "turn by hard rudder",
        _AT_TRUE_SCALE,
    ),
    RefusedPair(
        ("'members'",),
        ("'arrive_by'", "'speed'", "a wait at an anchorage"),
        "each member has times of its own, so no single choice arrives in time in all members",
    ),
    RefusedPair(
        ("'members'",),
        _HOURS,
        "each member passes at hours of its own",
        "leave 'members' out, or the hours: 'from' and 'until', the [tide] or the [limits]",
    ),
    RefusedPair(
        ("[havens]",),
        (*_HOURS, "'members'", "'speed'"),
        "ways to havens are proven in one current, which would be the mean of the members alone, "
        "at the vessel's own speed, and know no hours at which water is shut",
    ),
    RefusedPair(
        ("planner.adrift",),
        ("time_method = 'changing'",),
        "in a current that changes, the water from which a vessel drifts ashore too soon is "
        "another at each hour",
        "leave 'adrift' out, and read the hours adrift of each route, or plan in a month's mean",
    ),
    RefusedPair(
        ("a wait at an anchorage", "a wait in [limits]"),
        _CHOICES_OF_TIME,
        "the wait leaves a time to choose, each of the others another, and a plan chooses only one",
        "give the season one 'departure' alone, or leave the wait out",
    ),
    RefusedPair(
        ("[under_way]",),
        ("a wait at an anchorage", "a wait in [limits]", *_CHOICES_OF_TIME, "'members'"),
        "the plan that is sailed has one current, one speed and one departure",
        "plan from here without [under_way]",
    ),
    RefusedPair(
        ("'to_within'",),
        ("'speed'", "'arrive_by'"),
        "what another departure may save can't be proven where speeds are chosen, or where some "
        "departures arrive too late",
        "leave 'to_within' out, or give departures that stand closer",
    ),
    RefusedPair(
        ("planner.method = 'sampled'",),
        ("via points", *_CHOICES_OF_TIME),
        "the paper's random chains begin at a given time and end at the goal",
        "leave them out, or give planner.method = 'optimal'",
    ),
    RefusedPair(
        ("another planner.order than 'fuel'",),
        ("via points",),
        "classes through via points are found by fuel",
        "leave them out, or give planner.order = 'fuel'",
    ),
    RefusedPair(
        ("via points",),
        ("'speed' in a current that changes",),
        "a speed for each leg is searched for on one clock from start to goal",
        "leave one of the two out, or plan from one via point to the next with an arrival at each",
    ),
)
"""The pairs that are refused; at most 15, and each for one reason."""


def refusals(scenario: Scenario) -> Iterator[str]:
    """Yield a line for each pair of the table that a scenario has."""
    for pair in PAIRS:
        lines = dict.fromkeys(_line(pair, scenario, season) for season in scenario.seasons)
        yield from filter(None, lines)


def _line(pair: RefusedPair, scenario: Scenario, season: Season) -> str:
    """Return the line on a pair in a season; "" where the season lacks one of the two."""
    first, second = (
        [
            name
            for name in group
            if (
                OF_THE_SCENARIO[name](scenario)
                if name in OF_THE_SCENARIO
                else OF_A_SEASON[name](season)
            )
        ]
        for group in (pair.first, pair.second)
    )
    if not (first and second):
        return ""
    of_a_season = any(name in OF_A_SEASON for name in (*first, *second))
    about = f"season {season.name!r} " if of_a_season else ""
    have = f"has {' and '.join(first)} together with {' and '.join(second)}"
    return f"{about}{have}: {pair.reason}; {pair.remedy}"
