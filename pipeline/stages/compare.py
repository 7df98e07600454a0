"""Sixth stage: compare the routes of all seasons, and name the way that each takes."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from pipeline.formats.shared.departures_and_speeds import speed_notes
from pipeline.formats.shared.result import RunResult, addressed
from pipeline.machine.store import Made, Store, artefact_key
from pipeline.model import Note, Place, Say
from pipeline.stages.choose import Chosen, narrows_notes
from pipeline.stages.comparing import cautions
from pipeline.stages.comparing.other_ways import shut_straits, side_bounds
from pipeline.stages.comparing.way_names import with_way_names
from pipeline.stages.places import shut_notes
from pipeline.stages.plan import Planned
from pipeline.stages.simplify import SimplifiedLand


def compare(
    chosen: Chosen, land: Made[SimplifiedLand], planned: Made[Planned], store: Store, say: Say
) -> Made[RunResult]:
    """Name each route's way, bound the fuel of other ways, and find the straits that are shut.

    Returns the result with its notes on choices, data, land and routes.
    """
    options, scene = chosen.scenario.planner, chosen.scene.value
    plans, inputs = planned.value.plans, (planned.key, chosen.scene.key)
    named = with_way_names(planned.value.evaluation, scene, plans, chosen.parts.fetched.land.places)
    # One core finds the shut straits while the others compute bounds for the other sides.
    with ThreadPoolExecutor(max_workers=1) as pool:
        found = pool.submit(
            store.made,
            "straits",
            tuple,
            inputs,
            lambda: shut_straits(scene, land.value.simplified, plans, options),
        )
        sides = store.made(
            "sides",
            tuple,
            (*inputs, options.drift),
            lambda: side_bounds(scene, plans, named, options),
        ).value
        straits = found.result().value
    result = RunResult(
        chosen.scenario,
        chosen.parts.fetched,
        land.value.simplified,
        scene,
        plans,
        replace(named, side_bounds=sides),
        {},
        datetime.now(UTC),
        chosen.notes,
        straits,
        chosen.choices,
    )
    result = replace(result, choices=(*chosen.notes, *speed_notes(result)))
    notes = _notes(result)
    for note in notes:
        say(note)
    every = (*chosen.notes, *chosen.parts.fetched.notes, *land.value.notes, *notes)
    fetched = replace(chosen.parts.fetched, notes=addressed(every, result.scenario))
    return Made(artefact_key("compare", *inputs), replace(result, fetched=fetched))


def _notes(result: RunResult) -> tuple[Note, ...]:
    """Return the notes on the routes, on speeds and on unknowns."""
    return (
        *speed_notes(result),
        *safety_notes(result),
        *narrows_notes(result.scene, result.plans, result.scenario.planner),
        *shut_notes(result.scene, result.plans),
        *cautions.waiting_notes(result.scene, result.plans),
        *cautions.unresolved_strait_notes(result),
        *result.unknowns,
    )


def safety_notes(result: RunResult) -> tuple[Note, ...]:
    """Return a note for each season whose best route has a hard-over turn that meets no-go."""
    return tuple(
        Note.of(
            "not-safe-everywhere",
            collisions=row.collisions,
            turns=row.trials,
            no_go=row.no_go_name,
            place=_first_place(result, row.season),
            padding=result.scenario.planner.padding,
        ).about(row.season)
        for row in result.evaluation.routes
        if row.rank == 1 and row.collisions
    )


def _first_place(result: RunResult, season: str) -> Place:
    """Return the first place on a season's best route from which a hard-over turn met no-go."""
    turns = result.evaluation.contingency[season, 1]
    return result.scene.place(np.asarray(turns.points)[np.asarray(turns.collided)][0])
