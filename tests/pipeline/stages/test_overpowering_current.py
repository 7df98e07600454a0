"""Water whose current is as fast as the vessel is noted, with its place."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from pipeline.model import Credit, CurrentGrid
from pipeline.stages.overpowering_current import overpowering_notes

REGION = shapely.box(130.0, 30.0, 140.0, 40.0)


def grid(u: np.ndarray) -> CurrentGrid:
    """Return an eastward current on a grid of whole degrees that extends beyond the region."""
    lon, lat = np.arange(128.0, 143.0), np.arange(28.0, 43.0)
    return CurrentGrid(
        "winter", lon, lat, u[None], 0 * u[None], "2024-02", Credit("c", "current", "c", "")
    )


def test_share_strength_and_place() -> None:
    u = np.full((15, 15), 0.4)
    u[5, :] = 1.0  # 33 N: as fast as the vessel
    u[5, 7] = 1.6  # 135 E
    u[0, 0] = 3.0  # outside the region
    u[8:10, 3:6] = np.nan
    (note,) = overpowering_notes(grid(u), REGION, 1.0)
    lat = np.arange(31.0, 40.0)
    row, cell = np.cos(np.radians(33.0)), np.cos(np.radians(lat)).sum()
    land = 3 * np.cos(np.radians([36.0, 37.0])).sum()
    assert f"in {9 * row / (9 * cell - land):.1%} of the water" in note
    assert "up to 1.60 m/s at 135.00 E 33.00 N" in note
    assert note.startswith("winter: ")


@pytest.mark.parametrize("strength", [0.99, np.nan])
def test_no_note_where_the_current_is_weaker(strength: float) -> None:
    assert overpowering_notes(grid(np.full((15, 15), strength)), REGION, 1.0) == ()
