"""What the classes of a plan share: computed once, and without overpowered water."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import Point, box

import renew
from renew.planner.problem import Problem
from tests.strategies import voyage_on

CHART = renew.Chart(box(0, 0, 100, 100), [Point(20, 20).buffer(4), Point(80, 80).buffer(1)])


class Race(renew.CurrentField):
    """2 m/s in the middle of the chart."""

    def __call__(self, points: np.ndarray) -> np.ndarray:
        distance = np.linalg.norm(points - 50, axis=-1)
        speed = 2 * np.exp(-((distance / 15) ** 4))
        return np.stack([speed, np.zeros_like(speed)], axis=-1)


def test_parts_are_computed_once_and_triangles_leave_overpowered_water_out() -> None:
    problem = Problem(voyage_on(CHART, (10, 50), (90, 50), Race()), renew.PlanOptions())
    assert problem.triangulation is problem.triangulation
    assert problem.fuel_bound is problem.fuel_bound
    closed = problem.overpowered_water
    assert closed.contains(Point(50, 50))
    covered = shapely.union_all(shapely.polygons(problem.triangulation.corners))
    assert covered.intersection(closed).area < 1e-3
    assert covered.area == pytest.approx(CHART.water.area - closed.area)
    # Two islands and the closed water each have a ray.
    assert len(problem.rays.island) == 3


def test_islands_below_the_least_size_name_no_class() -> None:
    problem = Problem(voyage_on(CHART), renew.PlanOptions(distinct_by=5.0))
    assert len(problem.rays.island) == 1
    assert problem.rays.omits_islands
    assert len(problem.enumerator(0.0).channels(20)) == 2
