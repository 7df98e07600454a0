"""The land of the page's map, before and after its sharp coast is in the cache."""

from functools import reduce

import numpy as np
import pytest
import shapely

from pipeline.serve import land


def filled(rings: land.Rings) -> shapely.Geometry:
    """What the page fills by the even-odd rule."""
    polygons = (shapely.Polygon(np.reshape(ring, (-1, 2))).buffer(0) for ring in rings)
    return reduce(shapely.symmetric_difference, polygons, shapely.Polygon())


FAR = [
    pytest.param(place, 0.1, marks=pytest.mark.slow)
    for place in ((3, 6, 3), (2, 2, 1), (2, 0, 1), (2, 3, 2))
]


@pytest.mark.parametrize(("place", "off"), [((5, 26, 14), 0.15), *FAR])
def test_the_coarse_coast_is_that_of_the_sharp_land(
    place: tuple[int, int, int], off: float
) -> None:
    """On maps of Luzon, the Philippines, Europe, and on both sides of 180 degrees."""
    coarse, sharp = (filled(land._tile(*place, is_sharp=one)) for one in (False, True))
    islets = 0.002 * land.TILE_PX**2 * 16
    assert coarse.symmetric_difference(sharp).area < off * sharp.area + islets
    assert sharp.area > 0
