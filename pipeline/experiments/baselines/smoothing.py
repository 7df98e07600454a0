"""OMPL's simplifyMax, with which the paper smooths its baselines."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import ompl.geometric as og

from pipeline.experiments.baselines.candidate import Candidate

if TYPE_CHECKING:
    from pipeline.experiments.baselines.spaces import Space
    from renew._types import FloatArray
    from renew.classes.h_signature import Rays


def smoothed(space: Space, states: list[Any], rays: Rays, size: int) -> Candidate:
    """Simplify a path through states; `size` is that of the tree or roadmap it came from.

    simplifyMax shortens without regard to fuel, and may pull the path across an island.
    """
    started = time.process_time()
    path = og.PathGeometric(space.information)
    for state in states:
        path.append(state)
    before = rays.word(space.polyline(states))
    og.PathSimplifier(space.information).simplifyMax(path)
    after = space.polyline(path.getStates())
    seconds = time.process_time() - started
    return Candidate(after, size, True, rays.word(after) == before, seconds)  # noqa: FBT003


def with_smoothed(
    space: Space, points: FloatArray, rays: Rays, size: int, seconds: float
) -> list[Candidate]:
    """A polyline (n, 2), and the same simplified."""
    states = [space.state(point) for point in points]
    return [Candidate(points, size, seconds=seconds), smoothed(space, states, rays, size)]
