"""Fourth stage: choose the offing and the departures that a scenario leaves open.

`pipeline.stages.choosing.region` chooses an open region before the first stage.
"""

from dataclasses import replace

from pipeline.machine.store import Store
from pipeline.model import Note, Say
from pipeline.stages.choosing.departures import Chosen, choose_departures
from pipeline.stages.choosing.offing import with_offing


def choose(given: Chosen, store: Store, say: Say) -> Chosen:
    """Return a complete scenario with its scene, and report each choice through `say`.

    Raises
    ------
    RequestError
        No season has a departure that can be planned.
    """
    chosen = choose_departures(_with_offing(given), store, say)
    for note in chosen.notes[len(given.notes) :]:
        say(note)
    return chosen


def _with_offing(given: Chosen) -> Chosen:
    """Set the planner's clearance to the chosen offing if the scenario does not give one."""
    scenario, accuracy_m = given.scenario, given.parts.fetched.land.accuracy_m
    options = with_offing(scenario, given.scene.value, accuracy_m)
    if options is scenario.planner:
        return given
    note = Note.of(
        "offing-chosen",
        offing_m=(options.clearance or 0.0) * scenario.scale,
        narrow_share=options.narrow_share,
    )
    complete = scenario.model_copy(update={"planner": options})
    return replace(given, scenario=complete, notes=(*given.notes, note))
