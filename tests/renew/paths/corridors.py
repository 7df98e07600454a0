"""Corridors to plan paths in, padded as a plan would pad them."""

from __future__ import annotations

from functools import cache

from renew.inputs.arguments import Padding
from renew.inputs.voyage import Voyage
from renew.padding.policy import PaddingPolicy
from renew.paths.corridor import Corridor
from renew.search.class_planner import ClassPlanner, PathMethod
from renew.search.problem import Problem
from tests.strategies import random_scene, voyage_on


@cache
def corridor_in_scene(seed: int, padding: Padding = "adaptive") -> Corridor:
    """Corridor of the first class in a random scene."""
    chart, current, start, goal = random_scene(seed)
    return corridor_of(voyage_on(chart, start, goal, current), padding)


def corridor_of(voyage: Voyage, padding: Padding = "adaptive", *, place: int = 0) -> Corridor:
    """Corridor of a class of a voyage, by its place in the order of fuel."""
    problem = Problem(voyage, distinct_by=0.0, order="fuel")
    policy = PaddingPolicy(padding, clearance=0.0, risk=0.05, seed=0)
    planner = ClassPlanner(problem, policy, PathMethod("optimal", samples=100, seed=0))
    return planner.corridor(problem.enumerator(0.0).channels(place + 1)[place])
