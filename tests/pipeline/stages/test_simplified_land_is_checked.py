"""The check of simplified land."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from pipeline._types import Geometries
from pipeline.errors import StageError
from pipeline.stages.simplify import (
    check,
)
from tests.pipeline.archipelagos import PLANE

NO_ENDPOINTS = np.empty((0, 2))


def test_check_names_every_fault() -> None:
    land, none = _array(shapely.box(0, 0, 100, 100)), _array()
    good = _array(shapely.box(-1, -1, 101, 101))
    check(good, _array(shapely.box(1, 1, 99, 99)), land, np.array([[200.0, 200.0]]), PLANE)
    bowtie = _array(shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]))
    with pytest.raises(StageError) as caught:
        check(bowtie, bowtie, land, NO_ENDPOINTS, PLANE)
    assert "1 outer polygons are invalid" in str(caught.value)
    assert "1 inner polygons are invalid" in str(caught.value)
    half = _array(shapely.box(0, 0, 50, 100), shapely.box(50, 0, 60, 100))
    with pytest.raises(StageError) as caught:
        check(half, good, land, np.array([[50.0, 50.0], [150.0, 50.0]]), PLANE)
    assert "4000 m² of land are uncovered" in str(caught.value)
    assert "404 m² of inner land lie outside the land" in str(caught.value)
    # The middle of the uncovered part, which is the right half.
    lon, lat = PLANE.to_lonlat((80.0, 50.0))
    assert f"uncovered, at {lon:.4f} E {lat:.4f} N" in str(caught.value)
    lon, lat = PLANE.to_lonlat((200.0, 100.0))
    place = f"at {lon:.4f} E {lat:.4f} N"
    with pytest.raises(StageError, match=f"1 of starts and goals are covered by land, {place}"):
        check(shapely.buffer(good, 200), none, land, np.array([[200.0, 100.0]]), PLANE)


def _array(*polygons: shapely.Polygon) -> Geometries:
    return np.array(polygons, dtype=object)
