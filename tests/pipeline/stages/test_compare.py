"""Routes on which turns met land, and those on weak tidal streams, are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.findings.note_words import note_texts
from pipeline.model import Measures
from pipeline.stages.compare import safety_notes, weak_stream_notes
from tests.pipeline import tidal_run
from tests.pipeline.formats import small_run
from tests.pipeline.results import with_result


def test_turns_that_met_land_are_reported_with_the_first_place() -> None:
    result = small_run.parts()
    assert not list(safety_notes(result))
    measures = result.case("winter").measures
    best, turns = measures.routes[0], measures.turns[0]
    collided = np.zeros(len(turns.points), dtype=bool)
    collided[[5, 9]] = True
    measures = Measures((replace(best, collisions=2),), (replace(turns, collided=collided),))
    (note,) = note_texts(safety_notes(with_result(result, "winter", measures=measures)))
    lon, lat = result.water.projection.to_lonlat(turns.points[5])
    assert note.startswith("winter: not safe everywhere: 2 of ")
    assert f"met land, the first one from {lon:.4f} E {lat:.4f} N; it was planned" in note


def test_routes_over_weak_constants_are_told_with_their_share() -> None:
    result = tidal_run.planned()
    (grid,) = result.fetched.currents
    assert list(weak_stream_notes(result)) == []
    lon = np.broadcast_to(grid.lon, grid.u[0].shape)
    for weak, share in ((lon < 119.0, None), (lon < 119.025, "22.2 %"), (lon > 0, "100.0 %")):
        other = replace(result.fetched, currents=(replace(grid, weak=weak),))
        notes = note_texts(weak_stream_notes(replace(result, fetched=other)))
        assert len(notes) == (share is not None)
        for note in notes:
            assert "tide: harmonic constants give less than 70% of the currents' variance" in note
            assert f"on {share} of route 1 and" in note
