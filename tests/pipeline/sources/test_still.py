"""Still water."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from pydantic import ValidationError

from pipeline.findings.note_words import note_texts
from pipeline.model import Land
from pipeline.scenario.season import Season
from pipeline.sources.registry import current_source

STILL = Season(name="still", currents=("still",))
REGION = shapely.box(170, -20, 190, -10)


def test_it_is_zero_over_the_whole_region_and_says_so() -> None:
    source = current_source("still")
    grid = source.current(REGION, STILL, Land((), (), 0.0), Path())
    assert (grid.lon[0], grid.lat[0], grid.lon[-1], grid.lat[-1]) == REGION.bounds
    assert not np.any([grid.u, grid.v])
    assert source.covered_bounds(REGION, STILL) == REGION.bounds
    assert any("without currents" in note for note in note_texts(grid.notes))


def test_it_needs_nothing() -> None:
    source = current_source("still")
    assert not source.needs_network(REGION, STILL, Path())
    assert source.unavailable_reason() == source.uncovered_reason(REGION, STILL) == ""


def test_only_still_water_needs_no_time() -> None:
    assert STILL.valid == ""
    with pytest.raises(ValidationError, match="lacks 'valid'"):
        Season(name="some", currents=("still", "embedded-palawan"))
