"""Padding that grows for the triangles a path really crosses, and for its turns."""

import numpy as np
import pytest

from renew.inputs.options import Padding, PlanOptions
from renew.paths.corridor import Corridor
from renew.paths.least_fuel_path import path_near, path_through_sections, refined_path
from renew.planner.grow import PaddingGrowth, grown
from renew.planner.problem import Problem
from renew.turns.padding_model import PaddedEdges, PaddingModel
from tests.renew.paths.scenes import corridor_in_scene


def growth_of(corridor: Corridor, padding: Padding = "adaptive") -> PaddingGrowth:
    voyage = corridor.voyage
    options = PlanOptions(padding=padding)
    problem = Problem(voyage, options)
    model = PaddingModel(problem.triangulation, voyage.waters.quick_current, voyage.vessel, options)
    return PaddingGrowth(problem, model)


def corridor_and_bulging_path(seed: int) -> tuple[Corridor, np.ndarray]:
    """Corridor of a random scene, and a path through triangles beside its channel."""
    corridor = corridor_in_scene(seed)
    start, goal = corridor.voyage.start, corridor.voyage.goal
    rng = np.random.default_rng(seed)
    middle = corridor.channel.midline(start, goal)
    path = np.vstack([start, middle[1:-1] + rng.normal(0, 8, middle[1:-1].shape), goal])
    return corridor, path


@pytest.mark.parametrize("seed", [0, 1, 3, 4])
def test_padding_grown_by_what_it_lacks_for_a_path_lacks_nothing_more(seed: int) -> None:
    corridor, path = corridor_and_bulging_path(seed)
    growth = growth_of(corridor)
    shortfall = growth.crossed_shortfall(corridor, path)
    assert shortfall is not None
    (stage,) = shortfall
    assert stage is not None
    edges, lacking = stage
    assert set(edges.tolist()) <= set(corridor.padded.edge.tolist())
    assert (lacking > 0).all()
    wider = grown(corridor, shortfall)
    assert growth.crossed_shortfall(wider, path) is None
    assert (wider.padded.padding >= corridor.padded.padding).all()
    # Everything else stays as it was.
    assert wider.channel is corridor.channel


def test_pieces_of_edges_that_keep_a_clearance_never_lack_padding() -> None:
    corridor, path = corridor_and_bulging_path(0)
    padded = corridor.padded
    pieces = padded.cut(5.0)
    # As in narrows: the whole edges are padded for turns, and pieces keep a clearance beside them.
    corridor = corridor.with_padding([PaddedEdges.stacked([padded, pieces])])
    growth = growth_of(corridor)
    shortfall = growth.crossed_shortfall(corridor, path)
    assert shortfall is not None
    assert growth.crossed_shortfall(grown(corridor, shortfall), path) is None


def test_a_path_in_its_channel_lacks_nothing() -> None:
    corridor, _ = corridor_and_bulging_path(0)
    midline = corridor.channel.midline(corridor.voyage.start, corridor.voyage.goal)
    assert growth_of(corridor).crossed_shortfall(corridor, midline) is None


def test_only_adaptive_padding_grows_where_turns_touch_land() -> None:
    # Without padding the least-fuel path touches land.
    corridor = corridor_in_scene(0, "none")
    path = refined_path(corridor, path_near(corridor, path_through_sections(corridor)))
    shortfall = growth_of(corridor).shortfall(corridor, path)
    assert shortfall is not None
    assert shortfall[0] is not None
    assert (shortfall[0][1] > 0).all()
    assert growth_of(corridor, 1.0).shortfall(corridor, path) is None
