"""What binds on the README's two voyages: the room that turns need, or the offing.

Each is planned as its page says and again without padding, at the same offing.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pipeline
from pipeline.run import Outcome, run
from pipeline.scenario.loading import load_scenario
from pipeline.stages.choose import room_notes
from tests.bench.figure import Figure, quoted


def figures() -> Iterator[Figure]:
    """Yield what turns need, and the turns that meet land with and without padding."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder)
        usv = pipeline.go(
            (120.30, 12.80),
            (116.80, 7.70),
            vessel="usv-7m",
            months=["2024-07"],
            name="usv",
            output=output,
            offline=True,
        )
        yield from _voyage("usv", usv)
        yield from _voyage("usv_bare", _unpadded(usv, output))
        season = run(load_scenario("palawan-season"), output, offline=True)
        yield from _voyage("season", season)
        yield from _voyage("season_bare", _unpadded(season, output))


def _unpadded(outcome: Outcome, output: Path) -> Outcome:
    """The same voyage at the same offing, without padding for turns."""
    planner = outcome.scenario.planner.model_copy(update={"padding": "none"})
    changed = {"planner": planner, "name": f"{outcome.scenario.name}-bare"}
    return run(outcome.scenario.model_copy(update=changed), output, offline=True)


def _voyage(name: str, outcome: Outcome) -> Iterator[Figure]:
    """Fuel and turns of the best route of each season, and what its room is for."""
    seasons = [season.name for season in outcome.scenario.seasons]
    for at, season in enumerate(seasons):
        key = f"{name}_{season}" if len(seasons) > 1 else name
        best = outcome.result.case(season).measures.routes[0]
        yield quoted(
            f"{key}: fuel, turns, turns that met land",
            **{
                f"{key}_fuel": best.fuel,
                f"{key}_turns": best.trials,
                f"{key}_collisions": best.collisions,
            },
        )
        for note in room_notes(
            outcome.result.water, outcome.result.results[at : at + 1], outcome.scenario.planner
        ):
            values: dict[str, Any] = dict(note.values)
            yield quoted(
                f"{key}: most that turns need, offing, m",
                **{f"{key}_most_padding": values["turns_m"], f"{key}_offing": values["offing_m"]},
            )
