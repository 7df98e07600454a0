"""Split each season at the anchorage where the vessel may wait, so that the way on is chosen, too.

The way to the anchorage is planned first, and keeps its season. The way on is a season of its own:
its departure is chosen between the arrival and the end of the wait. So each part has departure,
arrival, hours early and late, water and files of its own. On the first part the route of least fuel
also arrives first, since the vessel has one speed; and a vessel that leaves later never arrives
earlier. So no other pair of parts needs less fuel, except by the steps between the departures.

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
from pipeline.machine.store import Artefact, Store
from pipeline.model import Note, Scene
from pipeline.model.planning import true_duration_s
from pipeline.scenario.season import Season
from pipeline.scenario.times import DepartureTimes
from pipeline.stages.choosing.chosen import Chosen, in_thread
from pipeline.stages.seasons.one_season import MIN_LATENESS_S, plan_season
from renew.inputs.shut_areas import Area

# Departures from the anchorage: least time between them, and their largest number, roughly.
_STEP_MIN, _MOST = 10, 48
_MINUTE_S = 60.0
# Number of characters to which a season's name is cut before an addition.
_NAME = 56


def with_onward_legs(given: Chosen, store: Store) -> Chosen:
    """Return seasons that end at the anchorage, and seasons that go on; unchanged without one."""
    if given.scenario.anchorage is None:
        return given
    _, wait = given.scenario.anchorage
    split = given
    for season in given.scenario.seasons:
        if season.name in given.data.current_keys:
            split = _split(split, season, wait)
    # Tasks load the scene from the store.
    store.load_or_make("project", split.scene.key, Scene, lambda: split.scene.value)
    return split


def _split(given: Chosen, season: Season, wait: timedelta) -> Chosen:
    """Add the season that goes on from the anchorage; none if there is no way to it."""
    scene, name = given.scene.value, season.name
    # Values that planning caches in a tide are not stored.
    tides = {one: replace(depth) for one, depth in scene.tidal_depths.items()}
    planned = replace(scene, tidal_depths=tides)
    plan = in_thread(partial(plan_season, planned, name, given.scenario.planner)).plan
    if plan is None:
        return given  # it is planned again, and says why
    arrival = true_duration_s(plan.best, scene, name)
    # No vessel departs to the second.
    shift = _MINUTE_S * math.ceil(arrival / _MINUTE_S)
    wait_s = max(0.0, wait.total_seconds() + arrival - shift)
    step_min = max(_STEP_MIN, math.ceil(wait_s / _MINUTE_S / _MOST))
    waits = np.arange(0.0, wait_s + 1.0, step_min * _MINUTE_S)
    begin = scene.departures[name] + timedelta(seconds=shift)
    departures = DepartureTimes(
        first=begin,
        every=f"{step_min}min",
        count=_afloat(planned, name, arrival, shift + waits),
    )
    label = f"{name[:_NAME]}-onward"
    keys = {
        "name": label,
        "title": f"{season.title or name}, onward from the anchorage",
        "departure": None,
        "departures": departures,
    }
    seasons = *given.scenario.seasons, season.model_copy(update=keys)
    scenario = given.scenario.model_copy(update={"seasons": seasons})
    split = given.at_clock(scenario, name, label, shift, keeps=True)
    legs = replace(split.scene.value, onward={**scene.onward, label: name})
    return replace(split, scene=Artefact(split.scene.key, legs))


def _afloat(scene: Scene, season: str, arrival: float, times: FloatArray) -> int:
    """Return how many of the departures (n,), s, come before the anchorage is shut; at least 1."""
    depth = scene.tidal_depths.get(season)
    areas: list[Area] = [*scene.areas.get(season, ()), *(depth.tidal_areas if depth else ())]
    here, ends = shapely.Point(scene.leg(season).goal), times + MIN_LATENESS_S
    begins, shut = np.full(len(ends), arrival), np.zeros(len(ends), dtype=bool)
    for area in areas:
        if shapely.dwithin(area.polygon, here, scene.vessel.length):
            shut |= area.is_shut(begins, ends)
    return max(1, int(np.argmax(shut)) if shut.any() else len(shut))


def waiting_notes(chosen: Chosen) -> Iterator[Note]:
    """Yield a note on each time at anchor."""
    scene = chosen.scene.value
    for choice in chosen.choices:
        if scene.anchorage is not None and choice.season in scene.onward:
            yield Note.of(
                "waits-at-anchor",
                place=scene.place(scene.via[scene.anchorage]),
                begin=choice.first,
                until=choice.chosen,
            ).about(choice.season)
