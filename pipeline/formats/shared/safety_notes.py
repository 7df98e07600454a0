"""Where the vessel cannot turn away on a best route: a note for each season."""

import numpy as np

from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.text import season_name


def safety_notes(result: RunResult) -> tuple[str, ...]:
    """Name the seasons on whose best route the vessel cannot turn away everywhere, and where."""
    return tuple(
        f"not safe everywhere: {season_name(row.season)}, {row.collisions:,} of {row.trials:,} "
        f"hard-over turns along the best route met {row.no_go_name}, the first from "
        f"{_first_place(result, row.season)}; it was planned with padding = "
        f'{result.scenario.planner.padding!r}, and only "adaptive" is verified'
        for row in result.evaluation.routes
        if row.rank == 1 and row.collisions
    )


def _first_place(result: RunResult, season: str) -> str:
    """Name the first place of a season's best route from which a turn met land."""
    turns = result.evaluation.contingency[season, 1]
    return result.scene.place_text(np.asarray(turns.points)[np.asarray(turns.collided)][0])
