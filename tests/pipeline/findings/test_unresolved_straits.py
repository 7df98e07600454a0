"""Straits on the way are found with their widths, and named if the current's grid is too coarse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyproj
import pytest
import shapely

from pipeline.findings.note_words import note_texts
from pipeline.findings.text import distance
from pipeline.stages.compare import straits_of, unresolved_strait_notes
from tests.pipeline.tidal_run import planned, run, tide

GEOD = pyproj.Geod(ellps="WGS84")
# Two islands from the south to the north of the region, a mile apart; and the margin of its chart.
SOUTH = shapely.box(119.045, 9.501, 119.055, 9.522)
NORTH = shapely.box(119.045, 9.539, 119.055, 9.559)
MARGIN_DEG = 0.0005


def test_a_strait_between_two_islands_is_found_with_its_width() -> None:
    result = run(tide(12), (SOUTH, NORTH))
    best = result.routes[0].route
    found = list(straits_of(best, result.water))
    gap = GEOD.inv(119.05, 9.522 + MARGIN_DEG, 119.05, 9.539 - MARGIN_DEG)[2]
    narrowest, (lon, lat) = min(found)
    assert narrowest == pytest.approx(gap, rel=0.02)
    assert 119.044 < lon < 119.056
    assert lat == pytest.approx(9.5305, abs=2e-3)
    # Cells of 0.01 degrees are 1.1 km: more than half of the strait.
    (note,) = note_texts(unresolved_strait_notes(result))
    assert f"is {distance(narrowest)} wide" in note
    assert "the tide in the strait is not resolved" in note
    grid = result.fetched.currents[0]
    fine = replace(
        grid,
        lon=np.linspace(grid.lon[0], grid.lon[-1], 29),
        lat=np.linspace(grid.lat[0], grid.lat[-1], 21),
        u=np.zeros((2, 21, 29)),
        v=np.zeros((2, 21, 29)),
        times_s=np.array([0.0, 1e5]),
    )
    resolved = replace(result, fetched=replace(result.fetched, currents=(fine,)))
    assert note_texts(unresolved_strait_notes(resolved)) == []


def test_the_way_round_one_island_has_no_strait() -> None:
    assert list(straits_of(planned().routes[0].route, planned().water)) == []
    assert note_texts(unresolved_strait_notes(planned())) == []
