"""Class by class, in order, until there are as many routes as were asked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from renew.classes.channel import Channel, Transition
from renew.classes.h_signature import Word
from renew.errors import InfeasibleError
from renew.padding.policy import PaddingPolicy
from renew.route import Rejected, Route
from renew.search.class_planner import ClassPlanner, PathMethod
from renew.search.problem import Problem

# Largest number of rounds in which channels around blocked transitions are looked for.
_MAX_ROUNDS = 64


@dataclass(frozen=True)
class ClassResults:
    """Routes, least fuel first, and the rejected classes."""

    routes: tuple[Route, ...]
    rejected: tuple[Rejected, ...]


def plan_classes(
    problem: Problem, policy: PaddingPolicy, method: PathMethod, classes: int
) -> ClassResults:
    """Plan the first k classes, and those that take the place of rejected ones.

    A channel that is blocked at some place is looked for again around all places found blocked, in
    rounds, until a round finds no other. What a strait's padding blocks for one class it mostly
    blocks for all, so that the rounds soon hold k classes that can be sailed. Where they don't,
    there may be classes that no round looked into, because what is blocked for others was assumed
    to be blocked for them, or a passing edge to be too narrow: these are then planned for
    themselves, up to k. A class is rejected, with its first reason, when no channel of it is left.
    """
    results = _Results(ClassPlanner(problem, policy, method))
    # Hardly any padding is less than v/ω: a turn is twice as wide.
    likely = problem.voyage.vessel.turning_radius if policy.is_adaptive else 0.0
    enumerator = problem.enumerator(max(policy.min_width, likely))
    blocked: set[Transition] = set()
    seen_all = False
    for _ in range(_MAX_ROUNDS):
        known = len(blocked)
        channels = enumerator.channels(classes, blocked)
        for channel in channels:
            blocked |= results.add(channel)
        seen_all = known == 0 and enumerator.sees_all and len(channels) < classes
        if len(blocked) == known or seen_all:
            break
    if len(results.routes) < classes and not seen_all:
        for channel in problem.enumerator(0.0).channels(classes):
            if channel.word not in results.rejected:
                results.add(channel)
    routes = sorted(results.routes.values(), key=lambda route: route.fuel)
    rejected = (
        rejected for word, rejected in results.rejected.items() if word not in results.routes
    )
    return ClassResults(tuple(routes[:classes]), tuple(rejected))


class _Results:
    """What each class has come to so far: a route, or the first reason against it."""

    def __init__(self, planner: ClassPlanner) -> None:
        self._planner = planner
        self.routes: dict[Word, Route] = {}
        self.rejected: dict[Word, Rejected] = {}
        self._given_up: set[Word] = set()

    def add(self, channel: Channel) -> set[Transition]:
        """Plan a class in one more channel; return the transition that blocks it, if one does."""
        word = channel.word
        if word in self.routes or word in self._given_up:
            return set()
        try:
            self.routes[word] = self._planner.route(channel)
        except InfeasibleError as error:
            rejected = Rejected(
                homotopy=channel.name,
                reason=str(error),
                channel=self._planner.problem.triangulation.corners[channel.triangles],
                strait=error.strait,
                cause=error,
                _compute_fuel=partial(self._planner.unpadded_fuel, channel),
            )
            self.rejected.setdefault(word, rejected)
            if error.strait is not None:
                return {error.strait.transition}
            self._given_up.add(word)
        return set()
