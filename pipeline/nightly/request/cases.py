"""All cases of a night: the products of scenario, season, pair, departure, vessel and member.

There may be a million cases, so each is created only when its index is accessed. Their order is
that of planning: vessel, season, departure, member, pair. So neighbours share chart and current.
"""

from __future__ import annotations

import bisect
import hashlib
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from pipeline.nightly.request.pairs import Pair
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import Season
from pipeline.sources.registry import land_source

if TYPE_CHECKING:
    from pipeline.nightly.request.config import NightConfig
    from pipeline.nightly.request.departures import Departure

NONE = "-"
"""Replaces a part of a case's name that is left out; removed at the end of the name."""
# Dimensions of a block, in the order of a case's name after the scenario.
_DIMENSIONS = ("seasons", "pairs", "departures", "vessels", "members")
# Keys that do not affect results.
_NO_RESULT = {"output", "keep", "limit_hours", "workers"}


@dataclass(frozen=True, slots=True)
class Member:
    """A member of an ensemble of currents: a file, and its name."""

    name: str
    path: str


@dataclass(frozen=True)
class Block:
    """The cases of one [[cases]] table; a dimension that was left out contains only None."""

    number: int
    scenario: Scenario
    vessels: tuple[VesselSpec | None, ...]
    seasons: tuple[Season, ...]
    departures: tuple[Departure | None, ...]
    members: tuple[Member | None, ...]
    pairs: tuple[Pair | None, ...]

    @cached_property
    def shape(self) -> tuple[int, int, int, int, int]:
        """Number of vessels, seasons, departures, members and pairs."""
        return (
            len(self.vessels),
            len(self.seasons),
            len(self.departures),
            len(self.members),
            len(self.pairs),
        )

    @property
    def size(self) -> int:
        """Number of cases."""
        return math.prod(self.shape)

    def case(self, index: int, offset: int) -> Case:
        """Return the case at an index in the block; `offset` is the number of cases before it."""
        rest, place = index, list[int]()
        for length in reversed(self.shape):
            rest, at = divmod(rest, length)
            place.append(at)
        pair, member, departure, season, vessel = place
        return Case(
            offset + index,
            self,
            self.vessels[vessel],
            self.seasons[season],
            self.departures[departure],
            self.members[member],
            self.pairs[pair],
        )

    @cached_property
    def names(self) -> tuple[frozenset[str], ...]:
        """Names in each dimension, to find whether two blocks have a case in common."""
        return (
            frozenset({self.scenario.name}),
            *(frozenset(map(_name_of, getattr(self, dimension))) for dimension in _DIMENSIONS),
        )

    def named(self, asked: str) -> Block | None:
        """Return the block of the cases whose names are or begin with `asked`, or None.

        Each dimension is searched separately, because the product may have billions of cases.
        """
        scenario, *wanted = asked.strip("/").split("/")
        kept: dict[str, Any] = {
            dimension: tuple(one for one in getattr(self, dimension) if _name_of(one) == name)
            for dimension, name in zip(_DIMENSIONS, wanted, strict=False)
        }
        beyond = wanted[len(_DIMENSIONS) :]
        if scenario != self.scenario.name or not all(kept.values()) or set(beyond) - {NONE}:
            return None
        return replace(self, **kept)


def _name_of(part: Season | Pair | Departure | VesselSpec | Member | None) -> str:
    """Return the name of a part of a case."""
    return NONE if part is None else part.name


@dataclass(frozen=True, slots=True)
class CurrentKey:
    """The properties of a case that determine its current."""

    block: int
    season: str
    departure: str
    member: str


@dataclass(frozen=True)
class Case:
    """One voyage to plan."""

    index: int
    block: Block
    vessel: VesselSpec | None
    season: Season
    departure: Departure | None
    member: Member | None
    pair: Pair | None

    @property
    def parts(self) -> tuple[str, str, str, str, str, str]:
        """Names of scenario, season, pair, departure, vessel and member."""
        others = (self.pair, self.departure, self.vessel, self.member)
        pair, departure, vessel, member = map(_name_of, others)
        return self.block.scenario.name, self.season.name, pair, departure, vessel, member

    @property
    def name(self) -> str:
        """The parts joined by slashes, without empty parts at the end."""
        parts = list(self.parts)
        while parts[-1] == NONE:
            parts.pop()
        return "/".join(parts)

    @property
    def chart(self) -> tuple[int, str]:
        """Key of its chart: the block's number, and the vessel for which the chart is made."""
        return self.block.number, self.parts[4]

    @property
    def current(self) -> CurrentKey:
        """Key of its current."""
        _, season, _, departure, _, member = self.parts
        return CurrentKey(self.block.number, season, departure, member)


@dataclass(frozen=True)
class Cases:
    """All cases, by their index."""

    blocks: tuple[Block, ...]

    @cached_property
    def _offsets(self) -> list[int]:
        """Index of each block's first case, followed by the number of all cases."""
        return [0, *itertools.accumulate(block.size for block in self.blocks)]

    def __len__(self) -> int:
        """Return the number of all cases."""
        return self._offsets[-1]

    def __getitem__(self, index: int) -> Case:
        """Return the case at an index; raise IndexError outside 0 to n - 1."""
        if not 0 <= index < len(self):
            raise IndexError(index)
        block = bisect.bisect_right(self._offsets, index) - 1
        return self.blocks[block].case(index - self._offsets[block], self._offsets[block])

    def __iter__(self) -> Iterator[Case]:
        """Yield all cases in order."""
        return (self[index] for index in range(len(self)))

    def chart_ranges(self) -> list[tuple[int, int]]:
        """Return the ranges (first, end) of cases that share a chart."""
        ranges = []
        for block, offset in zip(self.blocks, self._offsets[:-1], strict=True):
            each = block.size // len(block.vessels)
            ranges += [
                (offset + i * each, offset + (i + 1) * each) for i in range(len(block.vessels))
            ]
        return ranges


def matches(name: str, asked: str) -> bool:
    """Whether a case's name is `asked`, or begins with its parts."""
    wanted = asked.strip("/").split("/")
    parts = name.split("/")
    parts += [NONE] * (len(wanted) - len(parts))
    return parts[: len(wanted)] == wanted


def doubled(blocks: Sequence[Block]) -> list[tuple[Block, Block]]:
    """Return pairs of blocks that have cases with the same name."""
    return [
        (one, other)
        for one, other in itertools.combinations(blocks, 2)
        if not any(a.isdisjoint(b) for a, b in zip(one.names, other.names, strict=True))
    ]


def request_hash(config: NightConfig, cases: Cases) -> str:
    """Return a hash of all inputs of the results except the currents' data and the code.

    Charts, depths and pairs are represented by their content.
    """
    described = [
        config.table.model_dump_json(exclude=_NO_RESULT),
        *(text for block in cases.blocks for text in _described(block)),
    ]
    return hashlib.sha256("\n".join(described).encode()).hexdigest()


def _described(block: Block) -> Iterator[str]:
    """Yield texts that identify a block of cases."""
    scenario = block.scenario
    yield scenario.model_dump_json()
    yield str([block.vessels, block.members, block.pairs, [one.name for one in block.seasons]])
    if not scenario.is_planar:
        yield "\n".join(land_source(scenario.chart, scenario.vessel.draught_m).identity)
