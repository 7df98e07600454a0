"""Split each case at the anchorage where the vessel may wait, so that the way on is chosen, too.

The way to the anchorage is planned first, and keeps its season. The way on is a case with a season
of its own: its departure is chosen between the arrival and the end of the wait. So each part has
departure, arrival, hours early and late, water and files of its own. On the first part the route of
least fuel also arrives first, since the vessel has one speed; and a vessel that leaves later never
arrives earlier. So no other pair of parts needs less fuel, except by the steps between departures.

While the vessel lies at anchor there must be enough water, and it may lie in no shut area.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta
from functools import partial

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.machine.store import Artefact, artefact_key
from pipeline.model import Case, Note
from pipeline.model.case import MIN_LATENESS_S, true_duration_s
from pipeline.scenario.season import DepartureTimes
from pipeline.stages.choosing.chosen import Chosen, in_thread
from pipeline.stages.plan_case import planned
from renew.inputs.openings import Opening

# Least time between two departures from the anchorage, min.
_STEP_MIN = 10
# Largest number of departures from the anchorage, roughly.
_MOST = 48
_MINUTE_S = 60.0
# Number of characters to which a season's name is cut before an addition.
_NAME = 56


def with_onward_legs(given: Chosen) -> Chosen:
    """Return cases that end at the anchorage, and cases that go on; unchanged without one."""
    if given.scenario.anchorage is None:
        return given
    at, wait = given.scenario.anchorage
    cases = tuple(replace(case, goal=case.via[at], via=case.via[:at]) for case in given.cases.value)
    key = artefact_key("onward", given.cases.key)
    split = replace(given, cases=Artefact(key, cases))
    for case in given.cases.value:
        onward = replace(case, start=case.via[at], via=case.via[at + 1 :], follows=case.name)
        split = _split(split, split.case(case.name), onward, wait)
    return split


def _split(given: Chosen, first: Case, onward: Case, wait: timedelta) -> Chosen:
    """Add the case that goes on from the anchorage; none if there is no way to it."""
    plan = in_thread(partial(planned, first.copy(), given.scenario.planner)).plan
    if plan is None or first.departure is None:
        return given  # it is planned again, and says why
    arrival = true_duration_s(plan.best, first)
    # No vessel departs to the second.
    shift = _MINUTE_S * math.ceil(arrival / _MINUTE_S)
    wait_s = max(0.0, wait.total_seconds() + arrival - shift)
    step_min = max(_STEP_MIN, math.ceil(wait_s / _MINUTE_S / _MOST))
    waits = np.arange(0.0, wait_s + 1.0, step_min * _MINUTE_S)
    departures = DepartureTimes(
        first=first.departure + timedelta(seconds=shift),
        every=f"{step_min}min",
        count=_afloat(first, arrival, shift + waits),
    )
    season = next(one for one in given.scenario.seasons if one.name == first.name)
    label = f"{first.name[:_NAME]}-onward"
    keys = {
        "name": label,
        "title": f"{season.title or first.name}, onward from the anchorage",
        "departure": None,
        "departures": departures,
    }
    seasons = *given.scenario.seasons, season.model_copy(update=keys)
    scenario = given.scenario.model_copy(update={"seasons": seasons})
    return given.at_clock(scenario, onward.later(shift, label), first, shift, keeps=True)


def _afloat(case: Case, arrival: float, times: FloatArray) -> int:
    """Return how many of the departures (n,), s, come before the anchorage is shut; at least 1."""
    depth = case.tidal_depth
    areas: list[Opening] = [*case.areas, *(depth.tidal_areas if depth else ())]
    here, ends = shapely.Point(case.goal), times + MIN_LATENESS_S
    begins, shut = np.full(len(ends), arrival), np.zeros(len(ends), dtype=bool)
    for area in areas:
        if shapely.dwithin(area.polygon, here, case.vessel.length):
            shut |= area.is_shut(begins, ends)
    return max(1, int(np.argmax(shut)) if shut.any() else len(shut))


def waiting_notes(chosen: Chosen) -> Iterator[Note]:
    """Yield a note on each time at anchor."""
    waiting = {case.name: case for case in chosen.cases.value if case.follows}
    for choice in chosen.choices:
        if choice.season in waiting:
            case = waiting[choice.season]
            yield Note.of(
                "waits-at-anchor",
                place=case.water.place(case.start),
                begin=choice.first,
                until=choice.chosen,
            ).about(choice.season)
