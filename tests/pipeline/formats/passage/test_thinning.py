"""Thinning in simple corridors, where the fewest legs are obvious."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from pipeline.formats.passage.safe_corridor import Drawing, SafeCorridor
from pipeline.formats.passage.thinning import thin
from pipeline.geo.projection import Projection

# At 20 degrees east on the equator loxodromes are straight lines of the plane.
DRAWING = Drawing(Projection.at(20.0, 0.0), "Loxodrome", 0.01)


NOTHING = shapely.Polygon()


def corridor_of(
    path: list[tuple[float, float]],
    free: shapely.Polygon,
    blocked: shapely.Polygon = NOTHING,
    wanted_clearance: float = 1.0,
) -> SafeCorridor:
    shapely.prepare(free)
    last = len(path) - 1
    return SafeCorridor(np.array(path), free, blocked, wanted_clearance, free, 0, last, 0.01)


def thinned(path: list[tuple[float, float]], free: shapely.Polygon) -> list[list[float]]:
    chosen = thin(corridor_of(path, free), DRAWING)
    assert (np.diff(chosen.along) > 0).all()
    chain: list[list[float]] = np.round(chosen.xy, 3).tolist()
    return chain


def test_a_straight_path_is_one_leg() -> None:
    path = [(x, 0.0) for x in np.linspace(0, 1000, 30)]
    assert thinned(path, shapely.box(-10, -10, 1010, 10)) == [[0, 0], [1000, 0]]


def test_a_gentle_bend_is_one_leg_where_the_corridor_is_wide() -> None:
    path = [(x, 8 * np.sin(np.pi * x / 1000)) for x in np.linspace(0, 1000, 30)]
    line = shapely.LineString(path)
    assert len(thinned(path, line.buffer(10))) == 2
    assert 3 <= len(thinned(path, line.buffer(3))) <= 5


@pytest.mark.parametrize("side", [1, -1])
def test_an_islet_is_passed_on_the_paths_side(side: int) -> None:
    path = [
        (0.0, 0.0),
        (400.0, side * 40.0),
        (500.0, side * 45.0),
        (600.0, side * 40.0),
        (1000.0, 0.0),
    ]
    islet = shapely.Point(500, side * 20).buffer(5)
    free = shapely.LineString(path).buffer(60).difference(islet)
    chain = thinned(path, free)
    assert len(chain) > 2
    # Between chain and path there is no islet.
    both = shapely.union(shapely.LineString(chain), shapely.LineString(path))
    assert not shapely.intersects(shapely.polygonize([both]), islet)
    # Without the islet the straight way would do.
    assert len(thinned(path, shapely.LineString(path).buffer(60))) == 2


def test_a_rounded_corner_is_one_waypoint() -> None:
    angle = np.radians(np.arange(-90, -9, 4))
    arc = np.column_stack([500 + 100 * np.cos(angle), 100 + 100 * np.sin(angle)])
    ahead = np.array([-np.sin(angle[-1]), np.cos(angle[-1])])
    leg = arc[-1] + 500 * np.array([-np.sin(angle[-1]), np.cos(angle[-1])])
    path = [(0.0, 0.0), *map(tuple, arc), tuple(leg)]
    # The inside of the bend is no-go.
    free = shapely.LineString(path).buffer(50).difference(shapely.Point(500, 100).buffer(97))
    chain = thinned(path, free)
    assert len(chain) == 3
    # Where the first leg, drawn out, meets the last one.
    share = -leg[1] / ahead[1]
    assert chain[1] == pytest.approx([leg[0] + share * ahead[0], 0.0], abs=0.5)


def test_legs_keep_clear_of_a_shore_that_the_path_touches() -> None:
    path = [(0.0, 0.0), (300.0, 0.0), (500.0, 0.0), (1000.0, 0.0)]
    shore = shapely.Polygon([(300, 0.1), (500, 0.1), (450, 40), (350, 40)])
    free = shapely.LineString(path).buffer(10).difference(shore)
    assert thinned(path, free) == [[0, 0], [1000, 0]]
    chain = thin(corridor_of(path, free, shore, 5.0), DRAWING).xy
    assert len(chain) <= 4
    assert shapely.distance(shapely.LineString(chain), shore) > 2.5


def test_legs_between_two_shores_have_the_greatest_clearance() -> None:
    path = [(0.0, 0.0), (500.0, 0.0), (1000.0, 0.0)]
    shores = shapely.union(shapely.box(499, 0.1, 501, 40), shapely.box(499, -40, 501, -3.9))
    free = shapely.LineString(path).buffer(10).difference(shores)
    chain = thin(corridor_of(path, free, shores, 5.0), DRAWING).xy
    assert shapely.distance(shapely.LineString(chain), shores) > 1.5


def test_legs_that_bend_out_of_the_corridor_are_split() -> None:
    drawing = Drawing(Projection.at(20.0, 60.0), "Loxodrome", 0.01)
    # A plane's straight line of 100 km at 60 degrees north; a loxodrome sags by 300 m.
    path = np.array([[-50_000.0, 0.0], [50_000.0, 0.0]])
    free = shapely.LineString(path).buffer(30)
    shapely.prepare(free)
    chosen = thin(SafeCorridor(path, free, NOTHING, 1.0, free, 0, 1, 0.01), drawing)
    lonlat = drawing.lonlat(chosen.xy)
    assert 4 <= len(lonlat) <= 9
    assert shapely.covers(free, drawing.lines(lonlat[:-1], lonlat[1:])).all()


def test_a_path_that_touches_land_stays_as_planned() -> None:
    # The corridor is empty, so no other leg is known to be safe.
    path = [(0.0, 0.0), (50.0, 10.0), (100.0, 0.0)]
    assert thinned(path, shapely.Polygon()) == [list(p) for p in path]


def test_the_legs_in_v_stay_as_planned() -> None:
    path = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [30.0, 0.0], [40.0, 0.0], [50.0, 0.0]])
    wide = shapely.box(-5, -5, 55, 5)
    chosen = thin(SafeCorridor(path, wide, NOTHING, 1.0, wide, 2, 4, 0.01), DRAWING)
    assert chosen.xy[:, 0] == pytest.approx([0, 10, 20, 40, 50])
    everything = thin(SafeCorridor(path, wide, NOTHING, 1.0, wide, 5, 5, 0.01), DRAWING)
    assert everything.xy == pytest.approx(path)
