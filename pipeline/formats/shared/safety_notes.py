"""Where the vessel cannot turn away on a best route: a note for each season."""

import numpy as np

from pipeline.formats.shared.result import RunResult
from pipeline.model.notes import Note, Place


def safety_notes(result: RunResult) -> tuple[Note, ...]:
    """Name the seasons on whose best route the vessel cannot turn away everywhere, and where."""
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
    """The first place of a season's best route from which a turn met land."""
    turns = result.evaluation.contingency[season, 1]
    return result.scene.place(np.asarray(turns.points)[np.asarray(turns.collided)][0])
