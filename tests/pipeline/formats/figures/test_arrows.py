from __future__ import annotations

import numpy as np
import pytest
import shapely

from pipeline.findings.result import RunResult
from pipeline.formats.figures.map_marks import SpeedScale, arrows, speed_scale


def test_arrows_are_on_water_and_show_the_planners_current(result: RunResult) -> None:
    found = arrows(result.case("summer"))
    land = shapely.union_all(result.water.land)
    assert len(found.positions) > 150
    assert not shapely.intersects_xy(land, found.positions).any()
    assert found.velocity == pytest.approx(result.case("summer").case.current(found.positions))
    scale = speed_scale(result)
    assert found.speed.max() <= scale.limits[-1]
    for outline, low, high in zip(
        found.outlines(scale), (0.0, *scale.limits), scale.limits, strict=False
    ):
        inside = (found.speed > low) & (found.speed <= high)
        assert len(shapely.get_parts(outline)) == inside.sum()


def test_an_arrow_points_along_the_current(result: RunResult) -> None:
    found = arrows(result.case("winter"))
    whole = found.outlines(SpeedScale((10.0,)))[0]
    for arrow, position, velocity in zip(
        shapely.get_parts(whole), found.positions, found.velocity, strict=True
    ):
        corners = shapely.get_coordinates(arrow)
        tip = corners[np.argmax((corners - position) @ velocity)]
        ahead = (tip - position) / np.linalg.norm(tip - position)
        assert ahead == pytest.approx(velocity / np.linalg.norm(velocity), abs=1e-6)
    # Turned, not skewed.
    assert np.ptp(shapely.area(shapely.get_parts(whole))) < 1e-9 * whole.area
