"""The pairs of features that a scenario can't have together, by the table `pairs.toml`.

A scenario may have every other pair. The scenario's checks and the reference are made from the
table, and a property test compares random scenarios with it; of a voyage of one line
`pipeline/voyage/request.py` checks it in the words of the options. What one feature needs (a
departure, a draught) is no pair: `loading` checks it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from pipeline.scenario.model import Scenario
from pipeline.scenario.season import Season
from pipeline.texts import table_beside

OF_THE_SCENARIO: dict[str, Callable[[Scenario], bool]] = {
    "a [plane]": lambda asked: asked.plane is not None,
    "no [plane]": lambda asked: asked.plane is None,
    "[region]": lambda asked: asked.region is not None,
    "a scale other than 1": lambda asked: asked.scale != 1,
    "[[avoid]]": lambda asked: bool(asked.avoid),
    "hours in [[avoid]]": lambda asked: any(area.has_hours for area in asked.avoid),
    "a [tide]": lambda asked: asked.tide is not None,
    "[limits]": lambda asked: asked.limits is not None,
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

    first: Sequence[str]
    second: Sequence[str]
    reason: str
    remedy: str = "leave one of the two out"


PAIRS = tuple(RefusedPair(**pair) for pair in table_beside(__file__, "pairs.toml")["pairs"])
"""The pairs that are refused; at most 15, and each for one reason."""


def met(called: Mapping[str, str]) -> Iterator[tuple[RefusedPair, str]]:
    """Yield the pairs of the table among features, and what is met, as each feature is called."""
    for pair in PAIRS:
        first, second = (
            " and ".join(called[name] for name in group if name in called)
            for group in (pair.first, pair.second)
        )
        if first and second:
            yield pair, f"{first} together with {second}"


def refusals(scenario: Scenario) -> Iterator[str]:
    """Yield a line for each pair of the table that a scenario has."""
    lines = dict[str, None]()
    for season in scenario.seasons:
        there = [name for name, holds in OF_THE_SCENARIO.items() if holds(scenario)]
        there += [name for name, holds in OF_A_SEASON.items() if holds(season)]
        for pair, both in met({name: name for name in there}):
            about = f"season {season.name!r} " if any(name in both for name in OF_A_SEASON) else ""
            lines[f"{about}has {both}: {pair.reason}; {pair.remedy}"] = None
    yield from lines
