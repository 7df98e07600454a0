from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from pipeline.findings.result import RunResult, continued


def test_land_and_what_continues_it_become_one() -> None:
    land = np.array([shapely.box(0, 0, 1, 1), shapely.box(5, 5, 6, 6)], dtype=object)
    around = np.array([shapely.box(0.9, 0.2, 3, 0.8), shapely.box(8, 8, 9, 9)], dtype=object)
    found = continued(land, around)
    assert len(found) == 3
    expected = shapely.union_all([*land, *around])
    assert shapely.union_all(found).symmetric_difference(expected).area < 1e-12


def test_without_surroundings_nothing_changes(result: RunResult) -> None:
    assert list(result.drawn_land) == list(result.water.land)


def test_land_that_the_plane_cannot_hold_is_left_out(result: RunResult) -> None:
    near, far = shapely.box(121.0, 9.0, 121.2, 9.3), shapely.box(-61.5, -11.0, -60.0, -9.0)
    fetched = replace(result.fetched, surroundings=(near, far))
    drawn = replace(result, fetched=fetched).drawn_land
    assert len(drawn) in {len(result.water.land) + 1, len(result.water.land) + 2}
    assert np.isfinite(shapely.bounds(drawn)).all()
