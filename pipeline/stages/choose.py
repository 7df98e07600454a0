"""Fourth stage: choose the offing and the departures that a scenario leaves open.

`pipeline.stages.choosing.region_search` chooses an open region before the first stage.
"""

from dataclasses import replace

from pipeline.machine.store import Store
from pipeline.model import Say
from pipeline.stages.choosing.departures import Chosen, choose_departures
from pipeline.stages.choosing.offing import Offing


def choose(given: Chosen, store: Store, say: Say) -> Chosen:
    """Return a complete scenario with its scene, and report each choice through `say`.

    Raises
    ------
    RequestError
        No season has a departure that can be planned.
    """
    chosen = choose_departures(_with_offing(given, store), store, say)
    for note in chosen.notes[len(given.notes) :]:
        say(note)
    return chosen


def _with_offing(given: Chosen, store: Store) -> Chosen:
    """Set the planner's clearance to the chosen offing if the scenario does not give one."""
    scenario, scene = given.scenario, given.scene
    if scenario.planner.clearance is not None or scenario.is_planar:
        return given
    accuracy_m = given.parts.fetched.land.accuracy_m
    inputs = scene.key, accuracy_m, scenario.fastest_vessel.model_dump()
    offing = store.made(
        "offing", Offing, inputs, lambda: Offing.of(scene.value, scenario, accuracy_m)
    ).value
    options = scenario.planner.model_copy(update={"clearance": offing.planar_m})
    complete = scenario.model_copy(update={"planner": options})
    return replace(given, scenario=complete, notes=(*given.notes, offing.note))
