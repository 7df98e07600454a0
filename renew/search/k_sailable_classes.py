"""Class by class, in order, until there are as many routes as were asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from renew.classes.channels import Channel, ChannelSearch, Move
from renew.classes.h_signature import Word
from renew.errors import InfeasibleError
from renew.route import Rejected, Route
from renew.search.class_planner import ClassSearch

# Rounds of the search for ways around places found shut.
_MOST_ROUNDS = 64


@dataclass(frozen=True)
class Examined:
    """Routes, least fuel first, and the classes that fell away."""

    routes: tuple[Route, ...]
    rejected: tuple[Rejected, ...]


def examine(
    likely: ChannelSearch,
    every: Callable[[], ChannelSearch],
    search: ClassSearch,
    classes: int,
) -> Examined:
    """Outcomes of the first k classes, and of those that take the place of fallen ones.

    A channel that is shut at some place is looked for again around all places found shut, in
    rounds, until a round finds none shut. What a strait's padding shuts to one class it mostly
    shuts to all, so that the rounds soon hold k classes that can be sailed. Where they don't,
    classes that no round looked into, since what is shut to others was taken to be shut to them or
    a passing edge to be too narrow, are then examined for themselves, up to k. A class falls away,
    with its first reason, when no channel of it is left.
    """
    outcomes = _Outcomes(search)
    shut: set[Move] = set()
    for _ in range(_MOST_ROUNDS):
        known = len(shut)
        for channel in likely.channels(classes, shut):
            shut |= outcomes.add(channel)
        if len(shut) == known:
            break
    if len(outcomes.routes) < classes:
        for channel in every().channels(classes, roughly=True):
            if channel.word not in outcomes.fell:
                outcomes.add(channel)
    routes = sorted(outcomes.routes.values(), key=lambda route: route.fuel)
    fell = (rejected for word, rejected in outcomes.fell.items() if word not in outcomes.routes)
    return Examined(tuple(routes[:classes]), tuple(fell))


class _Outcomes:
    """What became of each class so far: a route, or the first reason for which it fell."""

    def __init__(self, search: ClassSearch) -> None:
        self._search = search
        self.routes: dict[Word, Route] = {}
        self.fell: dict[Word, Rejected] = {}
        self._given_up: set[Word] = set()

    def add(self, channel: Channel) -> set[Move]:
        """Examine a class by one more channel; return the move that shuts it, if one does."""
        word = channel.word
        if word in self.routes or word in self._given_up:
            return set()
        try:
            self.routes[word] = self._search.route(channel)
        except InfeasibleError as error:
            corners = self._search.waters.triangulation.corners[channel.triangles]
            rejected = Rejected(
                channel.name,
                str(error),
                corners,
                error.strait,
                lambda: self._search.unpadded_fuel(channel),
            )
            self.fell.setdefault(word, rejected)
            if error.strait is not None:
                return {error.strait.move}
            self._given_up.add(word)
        return set()
