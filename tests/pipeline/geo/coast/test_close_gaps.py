"""Gaps between rocks and islands are closed, and passages between endpoints stay open."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from pipeline.geo.coast.close_gaps import close_gaps

SEA = shapely.box(0, 0, 100_000, 100_000)
NO_ENDPOINTS = np.empty((0, 2))


@pytest.mark.parametrize(("gap", "is_closed"), [(900.0, True), (700.0, False)])
def test_no_route_passes_between_rocks_closer_than_the_gap(gap: float, is_closed: bool) -> None:
    rocks = shapely.multipolygons(
        [shapely.box(x, 50_000, x + 50, 50_050) for x in (50_000, 50_850)]
    )
    closed = close_gaps(rocks, SEA, gap, NO_ENDPOINTS, 500.0)
    between = shapely.LineString([(50_450, 49_000), (50_450, 51_000)])
    assert shapely.intersects(closed.polygons, between).any() == is_closed
    assert len(closed.polygons) == (1 if is_closed else 2)


def test_a_ring_of_rocks_is_barred_and_the_pool_inside_is_filled() -> None:
    angle = np.linspace(0, 2 * math.pi, 24, endpoint=False)
    middles = 50_000 + 3_000 * np.column_stack([np.cos(angle), np.sin(angle)])
    ring = shapely.multipolygons(shapely.box(*(middles - 20).T, *(middles + 20).T))
    closed = close_gaps(ring, SEA, 1_000.0, np.array([[10.0, 10.0], [99_000.0, 99_000.0]]), 500.0)
    (atoll,) = closed.polygons
    assert not atoll.interiors
    assert atoll.covers(shapely.Point(50_000, 50_000))
    # An endpoint in the pool keeps it as water, and the widest way out open.
    open_ring = close_gaps(
        ring, SEA, 1_000.0, np.array([[10.0, 10.0], [50_000.0, 50_000.0]]), 500.0
    )
    apart = 3_000 * 2 * math.sin(math.pi / 24)
    assert min(opening.width_m for opening in open_ring.openings) == pytest.approx(apart, abs=50)
    water = SEA.difference(shapely.union_all(open_ring.polygons))
    part = [p for p in shapely.get_parts(water) if p.covers(shapely.Point(50_000, 50_000))]
    assert part[0].covers(shapely.Point(10, 10))


def test_merging_joins_islets_but_closes_no_strait_between_large_islands() -> None:
    large = [
        shapely.box(10_000, 10_000, 40_000, 90_000),
        shapely.box(42_500, 10_000, 90_000, 90_000),
    ]
    islet = shapely.box(41_000, 50_000, 41_100, 50_100)  # in the strait, nearer to the western one
    lone = shapely.box(8_000, 50_000, 8_100, 50_100)
    land = shapely.multipolygons([*large, islet, lone])
    endpoints = np.array([[41_800.0, 5_000.0], [41_800.0, 95_000.0]])
    closed = close_gaps(land, SEA, 500.0, endpoints, 500.0, merge_m=4_000.0)
    assert len(closed.polygons) == 2, "both islets merged with the western island"
    assert not any(opening.reopened for opening in closed.openings)
    strait = shapely.LineString([(41_800, 5_000), (41_800, 95_000)])
    assert not shapely.intersects(closed.polygons, strait).any()
