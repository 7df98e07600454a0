"""Corridors to plan paths in, padded as a plan would pad them."""

from __future__ import annotations

from functools import cache

from renew.inputs.options import Padding, PlanOptions
from renew.paths.corridor import Corridor
from renew.planner.one_class import ClassPlanner
from renew.planner.problem import Problem
from renew.voyage.voyage import Voyage
from tests.strategies import random_scene, voyage_on


@cache
def corridor_in_scene(seed: int, padding: Padding = "adaptive") -> Corridor:
    """Corridor of the first class in a random scene."""
    chart, current, start, goal = random_scene(seed)
    return corridor_of(voyage_on(chart, start, goal, current), padding)


def corridor_of(voyage: Voyage, padding: Padding = "adaptive", *, place: int = 0) -> Corridor:
    """Corridor of a class of a voyage, by its place in the order of fuel."""
    options = PlanOptions(padding=padding)
    problem = Problem(voyage, options)
    channel = problem.enumerator(0.0).channels(place + 1)[place]
    return ClassPlanner(problem).corridor(channel)
