"""The best route of one class: it stays in the class, and if there is none the reason is given."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely import box

import renew
from renew.errors import InfeasibleError
from renew.inputs.options import Method, Padding, PlanOptions
from renew.planner.classes import ClassSearch
from renew.planner.one_class import ClassPlanner
from renew.planner.problem import Problem
from renew.voyage.voyage import Voyage
from tests.bounded_scenes import SCENES, eddy_scene
from tests.strategies import random_scene, voyage_on


def planner_of(
    voyage: Voyage, padding: Padding = "adaptive", method: Method = "optimal"
) -> ClassPlanner:
    options = PlanOptions(padding=padding, method=method, samples=200)
    return ClassPlanner(Problem(voyage, options))


@pytest.mark.parametrize("method", ["optimal", "sampled"])
def test_a_route_stays_in_its_class_and_padding_never_makes_it_cheaper(method: Method) -> None:
    planner = planner_of(random_scene(0).voyage, 1.5, method)
    problem = planner.problem
    planned = 0
    for channel in problem.enumerator(1.5).channels(6):
        try:
            route = planner.route(planner.find(channel))
        except InfeasibleError:
            continue
        planned += 1
        assert route.homotopy == channel.name
        assert problem.rays.word(route.path) == channel.word
        assert route.fuel == pytest.approx(problem.voyage.fuel(route.path))
        assert route.clearance >= 1.5
        assert planner.unpadded_fuel(channel) <= route.fuel * (1 + 1e-3)
    assert planned >= (2 if method == "optimal" else 1)


def test_a_path_that_slips_out_of_its_class_is_a_route_of_its_own_class() -> None:
    planner = planner_of(random_scene(0).voyage, 1.5)
    channel = planner.problem.enumerator(1.5).channels(1)[0]
    # No path in this channel has that word: as where a path slips past an islet.
    asked = replace(channel, word=(*channel.word, 99))
    route = planner.route(planner.find(asked))
    assert route.homotopy == channel.name
    assert route.fuel == pytest.approx(planner.find(channel).fuel, rel=0.01)
    search = ClassSearch(planner)
    search.add(asked)
    found = search.plan(4)
    assert [one.homotopy for one in found.routes] == [channel.name]
    assert [one.homotopy for one in found.rejected] == [asked.name]
    assert "slips into another class" in found.rejected[0].reason
    search.add(channel)
    again = search.plan(4)
    assert len(again.routes) == 1
    assert again.routes[0].fuel <= found.routes[0].fuel


def test_padding_grows_until_turns_are_clear() -> None:
    voyage = random_scene(3).voyage
    planner = planner_of(voyage)
    channel = planner.problem.enumerator(0.0).channels(1)[0]
    first = planner.corridor(channel).padded
    route = planner.route(planner.find(channel))
    padding = {tuple(row[:4]): row[4] for row in route.padding_used.tolist()}
    initial = np.column_stack([first.start, first.end, first.padding]).tolist()
    assert all(padding[tuple(row[:4])] >= row[4] for row in initial)
    assert (
        renew.contingency(route, voyage.chart, voyage.current, voyage.vessel, seed=5).collisions
        == 0
    )


def test_a_current_as_strong_as_the_vessel_on_every_path_is_refused() -> None:
    class Race(renew.CurrentField):
        """1.5 m/s against the passage in its middle, where the table's nodes see too little."""

        def __call__(self, points: np.ndarray) -> np.ndarray:
            strength = np.where(np.abs(points[..., 0] - 50.01) < 0.005, 1.5, 0.0)
            return np.stack([-strength, np.zeros_like(strength)], axis=-1)

    chart = renew.Chart(box(0, 0, 100, 100))
    voyage = voyage_on(chart, (10.0, 50.0), (90.0, 50.0), Race())
    planner = planner_of(voyage)
    assert planner.problem.overpowered_water.is_empty
    [channel] = planner.problem.enumerator(0.0).channels(1)
    path = np.array([[0.0, 10.0, 50.0, 0.0], [1.0, 50.01, 50.0, 0.0]])
    with pytest.raises(InfeasibleError, match=r"the current at \(50\.01, 50\) m runs at 1\.5 m/s"):
        planner.check_current(path)
    assert math.isfinite(shapely.LineString(planner.find(channel).path).length)


def test_a_path_that_padding_pushes_away_is_searched_for_elsewhere_in_its_class() -> None:
    """Unpadded, s2 passes close by an island; a grid out of V needs 193.42 through other eddies.

    Pushed off that island by 5.7 m of padding, the path near its first way needs 199.9.
    """
    best = eddy_scene(*SCENES[32]).plan(classes=1).best
    assert best.homotopy == "s2"
    assert best.fuel < 193.42 * 1.001
