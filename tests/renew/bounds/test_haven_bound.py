"""The bound on the time to a haven is nowhere above the time of a real path."""

from __future__ import annotations

import numpy as np
import pytest

from renew.bounds.haven_bound import HavenBound
from renew.voyage.voyage import Voyage, Waters
from tests.clock_oracle import earliest_arrival
from tests.moving_waters import moving_scene
from tests.oracles import grid_dijkstra
from tests.strategies import PAPER_VESSEL, SIZE, random_scene

MOST = SIZE / PAPER_VESSEL.speed
RATE = PAPER_VESSEL.fuel_rate


@pytest.mark.parametrize(("seed", "peak"), [(1, 0.7), (2, 1.4)])
def test_no_grid_path_to_a_haven_is_quicker_than_the_bound(seed: int, peak: float) -> None:
    chart, current, start, goal = random_scene(seed, peak)
    voyage = Voyage(Waters(chart, current), PAPER_VESSEL, start, goal, "projected")
    bound = HavenBound.of(voyage, MOST, MOST)
    places = np.array([[SIZE - 40, SIZE - 12], [SIZE - 12, SIZE - 60], [SIZE / 2, SIZE - 12]])
    times = []
    for place in places:
        fuel, _ = grid_dijkstra(chart, current, PAPER_VESSEL, place, goal, 5.0)
        times.append(fuel / RATE)
    least = bound.at(places)
    assert (least <= times).all()
    # And it is of use: nowhere far below in currents that leave the vessel headway.
    if peak < 1:
        assert (least >= 0.9 * np.minimum(times, MOST)).all()


def test_in_a_current_that_changes_it_holds_for_any_departure() -> None:
    scene = moving_scene(4)
    waters = Waters(scene.chart, scene.current)
    voyage = Voyage(waters, PAPER_VESSEL, scene.start, scene.goal, scene.drift)
    bound = HavenBound.of(voyage, MOST, 3 * MOST)
    place = np.array([SIZE - 40.0, SIZE - 12.0])
    (least,) = bound.at(place[None])
    assert least > 0
    for departure in (0.0, 60.0, 150.0):
        fuel, _ = earliest_arrival(
            scene.chart,
            scene.current,
            PAPER_VESSEL,
            place,
            scene.goal,
            departure,
            spacing=5.0,
            drift=scene.drift,
        )
        assert least <= fuel / RATE


def test_off_the_chart_it_bounds_nothing() -> None:
    chart, current, start, goal = random_scene(1, 0.7)
    voyage = Voyage(Waters(chart, current), PAPER_VESSEL, start, goal, "projected")
    bound = HavenBound.of(voyage, MOST, MOST)
    xmin, ymin, xmax, ymax = chart.bounds
    rounded = np.nextafter([xmax, ymax], np.inf)
    places = np.array([[xmin - 1.0, start[1]], [start[0], ymin - 1.0], rounded])
    assert bound.at(places).tolist() == [0.0, 0.0, 0.0]
