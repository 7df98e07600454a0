"""Cross-track limits and turns in simple cases, against values computed by hand."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import renew
from pipeline.formats.passage.safe_corridor import (
    Obstacles,
    SafeCorridor,
    Tracks,
    cross_track_limits,
    turning_radii,
)
from pipeline.geo.projection import Projection
from pipeline.model import Case, Water
from tests.strategies import PAPER_VESSEL

CAP = 50.0
NOTHING = shapely.MultiPolygon()


def obstacles(*no_go: shapely.Polygon) -> Obstacles:
    """A chart from -200 to 300 m both ways."""
    chart = renew.Chart(shapely.box(-200, -200, 300, 300), no_go)
    water = Water(chart, no_go, Projection.at(0.0, 0.0))
    still = renew.UniformCurrent(0.0, 0.0)
    return Obstacles(Case("still", water, PAPER_VESSEL, np.zeros(2), np.ones(2), still))


def legs(*points: tuple[float, float]) -> Tracks:
    """Straight legs from point to point."""
    xy = np.repeat(np.array(points), 2, axis=0)[1:-1]
    return Tracks(xy, xy, np.repeat(np.arange(len(points) - 1), 2))


EAST = legs((0.0, 0.0), (100.0, 0.0))
WEST = legs((100.0, 0.0), (0.0, 0.0))
NORTH_BANK = shapely.box(-150, 30, 250, 40)


@pytest.mark.parametrize(
    ("track", "soft", "port", "starboard"),
    [
        (EAST, NOTHING, CAP, CAP),
        (EAST, NORTH_BANK, 30, CAP),
        (WEST, NORTH_BANK, CAP, 30),
        (EAST, shapely.box(-150, -20, 250, -10), CAP, 10),
        # Ahead of the leg, to port: 30 on and 40 aside.
        (EAST, shapely.box(130, 40, 200, 200), CAP, CAP),
        (EAST, shapely.box(120, 15, 200, 200), 25, CAP),
        # Behind it.
        (EAST, shapely.box(-100, 0.5, -12, 100), 12, CAP),
        # A pond around the leg, and a leg all in V: nothing is promised.
        (EAST, shapely.box(-50, -50, 150, 50).difference(shapely.box(-9, -8, 150, 7)), 7, 8),
        (EAST, shapely.box(-90, -90, 190, 90), 0, 0),
        (EAST, shapely.box(50, -5, 60, 5), 0, 0),
    ],
)
def test_limits_are_the_distances_to_either_side(
    track: Tracks, soft: shapely.Polygon, port: float, starboard: float
) -> None:
    found = cross_track_limits(track, soft, obstacles(), CAP)
    assert [*found[0], *found[1]] == pytest.approx([port, starboard], abs=0.02)


def test_land_and_the_edge_of_the_chart_are_limits() -> None:
    island = obstacles(shapely.box(40, 20, 60, 25))
    assert cross_track_limits(EAST, NOTHING, island, CAP)[0] == pytest.approx(20)
    at_the_edge = legs((0.0, -190.0), (100.0, -190.0))
    assert cross_track_limits(at_the_edge, NOTHING, island, CAP)[1] == pytest.approx(10)


def test_legs_may_not_be_drawn_beyond_the_edge_of_the_chart() -> None:
    on_chart = obstacles().clipped_to_chart(shapely.LineString([(0, 295), (100, 295)]).buffer(20))
    assert on_chart.bounds[3] == 300
    inside = shapely.LineString([(0, 0), (100, 0)]).buffer(20)
    assert obstacles().clipped_to_chart(inside) is inside


def test_every_leg_has_its_own_limits() -> None:
    track = legs((0.0, 0.0), (100.0, 0.0), (100.0, 100.0))
    port, starboard = cross_track_limits(track, shapely.box(120, -100, 130, 200), obstacles(), CAP)
    assert port == pytest.approx([20, CAP])
    assert starboard == pytest.approx([20, 20])


def turned(free: shapely.Polygon, radius: float, corner: float = 100.0) -> float:
    """Radius of the turn by 90 degrees to port at (corner, 0), the legs 100 m and 80 m long."""
    shapely.prepare(free)
    corridor = SafeCorridor(np.zeros((2, 2)), free, shapely.Polygon(), 1.0, free, 0, 1, 0.01)
    track = legs((corner - 100, 0.0), (corner, 0.0), (corner, 80.0))
    (found,) = turning_radii(track, corridor, radius)
    return float(found)


def test_turns_are_halved_until_they_fit() -> None:
    wide = shapely.box(-500, -500, 500, 500)
    assert turned(wide, 30.0) == 30
    # The shorter leg's half is 40 m: the tangent of a turn by 90 degrees is its radius.
    assert turned(wide, 50.0) == 25
    # A shoal inside the bend, at 9 m from both legs.
    shoal = shapely.box(70, 9, 91, 30)
    assert turned(wide.difference(shoal), 30.0) == 15
    assert turned(shapely.Polygon(), 30.0) == 0


def test_limits_are_the_nearest_of_all_edges_to_each_side() -> None:
    # The oracle looks at the parts of all edges inside each side's area.
    random = np.random.default_rng(4)
    rocks = [shapely.Point(*random.uniform(-150, 250, 2)).buffer(3) for _ in range(120)]
    way = np.cumsum(random.uniform(-20, 40, (6, 2)), axis=0)
    track = legs(*map(tuple, way))
    rocks = [rock for rock in rocks if rock.distance(shapely.LineString(way)) > 1]
    soft, around = shapely.MultiPolygon(rocks), obstacles()
    found = np.array(cross_track_limits(track, soft, around, CAP))
    for side, sign in enumerate((1, -1)):
        for leg, line in enumerate(track.lines):
            begin, end = way[leg], way[leg + 1]
            ahead = (end - begin) / np.linalg.norm(end - begin) * CAP
            aside = sign * np.array([-ahead[1], ahead[0]])
            corners = [begin - ahead, end + ahead, end + ahead + aside, begin - ahead + aside]
            within = shapely.intersection(shapely.Polygon(corners), soft.boundary)
            expected = min(CAP, line.distance(within)) if not within.is_empty else CAP
            assert found[side, leg] == pytest.approx(expected)
