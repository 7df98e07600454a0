"""A best route on which turns met land is named, with the place of the first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.formats.shared.note_words import note_texts
from pipeline.model import Evaluation
from pipeline.stages.compare import safety_notes
from tests.pipeline.formats import small_run


def test_turns_that_met_land_are_reported_with_the_first_place() -> None:
    result = small_run.parts()
    assert safety_notes(result) == ()
    turns = result.evaluation.contingency["winter", 1]
    collided = np.zeros(len(turns.points), dtype=bool)
    collided[[5, 9]] = True
    rows = tuple(
        replace(row, collisions=2 if row.season == "winter" else 0)
        for row in result.evaluation.routes
    )
    flown = {**result.evaluation.contingency, ("winter", 1): replace(turns, collided=collided)}
    (note,) = note_texts(safety_notes(replace(result, evaluation=Evaluation(rows, flown))))
    lon, lat = result.scene.projection.to_lonlat(turns.points[5])
    assert note.startswith("winter: not safe everywhere: 2 of ")
    assert f"met land, the first one from {lon:.4f} E {lat:.4f} N; it was planned" in note
