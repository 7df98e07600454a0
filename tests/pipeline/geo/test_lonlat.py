"""Positions as text, and where something is known on a grid."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from pipeline.geo.lonlat import DepthCover, KnownCells, position_text, share_without
from pipeline.geo.projection import Projection


@pytest.mark.parametrize(
    ("lon", "lat", "text"),
    [
        (119.871, 11.5244, "119.8710 E 11.5244 N"),
        (-70.9815, 42.3427, "70.9815 W 42.3427 N"),
        (-5.25, -36.5, "5.2500 W 36.5000 S"),
        (181.5, -17.0, "178.5000 W 17.0000 S"),
        (-181.0, 0.0, "179.0000 E 0.0000 N"),
    ],
)
def test_a_position_is_given_by_its_hemispheres(lon: float, lat: float, text: str) -> None:
    assert position_text(lon, lat) == text


# --- Cells with figures, and the share of a path outside them ---


LON, LAT = np.arange(5), np.array([10.0, 11.0, 12.0])
KNOWN = np.ones((3, 5), dtype=bool)
KNOWN[1, 2] = KNOWN[0, 0] = False
CELLS = KnownCells(LON.astype(float), LAT, KNOWN)


def test_a_cell_reaches_halfway_to_the_next_node() -> None:
    for place, expected in (
        ((2.0, 11.0), False),
        ((2.49, 11.49), False),
        ((2.51, 11.0), True),
        ((-0.49, 9.51), False),
        ((4.49, 12.49), True),
        ((4.51, 12.0), False),
        ((0.0, 9.4), False),
    ):
        assert CELLS.at(np.array([place])).tolist() == [expected], place


def test_areas_and_cells_count_together() -> None:
    cover = DepthCover((shapely.box(1.5, 10.5, 2.2, 11.5),), CELLS)
    places = np.array([(2.0, 11.0), (2.4, 11.0), (3.0, 11.0), (9.0, 11.0)])
    assert cover.at(places).tolist() == [True, False, True, False]
    assert DepthCover((shapely.box(8, 10, 10, 12),)).at(places).tolist() == [False] * 3 + [True]


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_the_share_is_that_of_the_length(scale: float) -> None:
    projection = Projection.for_region(shapely.box(0, 10, 4, 12), scale)
    path = projection.to_plane([(1.0, 11.0), (4.0, 11.0), (4.0, 12.0)])
    lengths = [projection.geodesic_length_m(path[i : i + 2]) for i in (0, 1)]
    share = share_without(path, projection, CELLS.at)
    assert share == pytest.approx(lengths[0] / 3 / sum(lengths), abs=2e-4)
    assert share_without(path, projection, lambda places: np.ones(len(places), dtype=bool)) == 0
