"""Fourth stage: complete a scenario that leaves the offing, or when to leave, to the program.

Its region is chosen before the first stage, by `pipeline.stages.choosing.region_search`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from pipeline.model import Scene
from pipeline.scenario.model import Scenario
from pipeline.stages.choosing.departures import Chosen, choose_departures
from pipeline.stages.choosing.offing import Offing
from pipeline.stages.fetch import FetchedParts
from pipeline.storage.store import Made, Store


def choose(
    scenario: Scenario,
    parts: FetchedParts,
    scene: Made[Scene],
    store: Store,
    say: Callable[[str], None],
) -> Chosen:
    """Return a scenario that leaves nothing out, with its scene and notes on what was chosen.

    Raises
    ------
    RequestError
        No season is left: an arrival can't be made.
    """
    complete, notes = _with_offing(scenario, parts, scene, store)
    for note in notes:
        say(note)
    departed = choose_departures(complete, parts, scene, store, say)
    for note in departed.notes:
        say(note)
    return replace(departed, notes=(*notes, *departed.notes))


def _with_offing(
    scenario: Scenario, parts: FetchedParts, scene: Made[Scene], store: Store
) -> tuple[Scenario, tuple[str, ...]]:
    """Complete the planner's options by a clearance where it is left out; return a note, too."""
    if scenario.planner.clearance is not None or scenario.is_planar:
        return scenario, ()
    accuracy_m = parts.fetched.land.accuracy_m
    inputs = scene.key, accuracy_m, scenario.fastest_vessel.model_dump()
    offing = store.made(
        "offing", Offing, inputs, lambda: Offing.of(scene.value, scenario, accuracy_m)
    ).value
    options = scenario.planner.model_copy(update={"clearance": offing.planar_m})
    return scenario.model_copy(update={"planner": options}), (offing.note,)
