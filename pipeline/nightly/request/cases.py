"""All cases of a night: the products of scenario, season, pair, departure, vessel and member.

There may be a million cases, so each is created only when its index is accessed. Their order is
that of planning: vessel, season, departure, member, pair. So neighbours share chart and current.
Pairs are read from a CSV file.
"""

import bisect
import csv
import hashlib
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from pipeline.errors import Fault
from pipeline.machine.paths import shown, unreadable_reason
from pipeline.nightly.request.config import Departure, NightConfig
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import Season
from pipeline.scenario.strict import Name, Point, near_miss
from pipeline.sources.registry import charted_land

_LONLAT = ("start_lon", "start_lat", "goal_lon", "goal_lat")
_PLANE = ("start_x", "start_y", "goal_x", "goal_y")
# Largest size of a file, bytes: a million pairs are a file of 50 MB, and take 1 GB of memory.
_MAX_BYTES = 100 << 20
_NAME: TypeAdapter[str] = TypeAdapter(Name)
NONE = "-"
"""Stands for a name of a case that is left out; removed at the end of the name."""
# Dimensions of a block, in the order of a case's name after the scenario.
_DIMENSIONS = ("seasons", "pairs", "departures", "vessels", "members")
# Keys that do not affect results.
_NO_RESULT = {"output", "keep", "limit_hours", "workers"}


@dataclass(frozen=True, slots=True)
class Pair:
    """Start and goal (lon/lat degrees, or metres in a plane), and the pair's row in the file."""

    name: str
    start: Point
    goal: Point
    row: int


def read_pairs(path: Path, *, is_planar: bool) -> tuple[tuple[Pair, ...], list[str]]:
    """Read a file of pairs; return the valid pairs and the faults."""
    if reason := unreadable_reason(path) or _size_reason(path):
        return (), [
            f"{shown(path)} {reason}; give a CSV file with the columns {_columns(is_planar)}"
        ]
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        return (), [f"{shown(path)} can't be read as CSV: {error}; save it as CSV in UTF-8"]
    keys = (*(_PLANE if is_planar else _LONLAT), "name")
    head = [cell.strip() for cell in rows[0]] if rows else []
    if found := _head_faults(head, keys):
        return (), [f"{path.name}, row 1: {fault}" for fault in found]
    pairs, faults = [], list[str]()
    for number, cells in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in cells):
            continue
        pair = None
        found = [f"has {len(cells)} cells, the header has {len(head)}; correct the row"]
        if len(cells) == len(head):
            row = dict(zip(head, cells, strict=True))
            pair, found = _pair(row, number, keys, is_planar=is_planar)
        faults += [Fault(f"row {number}", f": {fault}", f"{path.name}, ") for fault in found]
        if pair is not None:
            pairs.append(pair)
    faults += _repeated(path, pairs)
    if not pairs and not faults:
        faults.append(f"{path.name} has no pairs; add a row for each below the header")
    return tuple(pairs), faults


def _head_faults(head: Sequence[str], keys: Sequence[str]) -> list[str]:
    """Return the faults of a header; no column is dropped unread."""
    if len(head) == 1 and ";" in head[0]:
        return ["is separated by ';'; separate by commas, with points in numbers: 119.90,10.00"]
    faults = [f"unknown column {one!r}: {near_miss(one, keys)}" for one in head if one not in keys]
    if lacking := [key for key in keys if key not in head]:
        faults.append(f"has no column {', '.join(lacking)}; the columns are {', '.join(keys)}")
    if len(set(head)) < len(head):
        faults.append("a column comes twice; leave one out")
    return faults


def _size_reason(path: Path) -> str:
    """Return a message if a file of pairs is too large, or ""."""
    size = path.stat().st_size
    large = f"has {size >> 20:,} MB, more than {_MAX_BYTES >> 20}"
    return large if size > _MAX_BYTES else ""


def _columns(is_planar: bool) -> str:  # noqa: FBT001 - called with a name's value
    return ", ".join((*(_PLANE if is_planar else _LONLAT), "name"))


def _pair(
    row: dict[str, str], number: int, keys: tuple[str, ...], *, is_planar: bool
) -> tuple[Pair | None, list[str]]:
    """Read a row; return the pair, or None if it has faults, and the faults."""
    faults, figures = [], []
    for key in keys[:-1]:
        try:
            figure = float(row[key])
        except ValueError:
            faults.append(f"{key} = {row[key]!r} is not a number; give it as 120.30")
            continue
        limit = math.inf if is_planar else 90.0 if key.endswith("lat") else 360.0
        lowest = -180.0 if key.endswith("lon") else -limit
        if not (math.isfinite(figure) and lowest <= figure <= limit):
            what = "metres" if is_planar else "degrees on earth"
            faults.append(f"{key} = {row[key]} is not a valid number of {what}; correct it")
        figures.append(figure)
    name = row["name"].strip()
    try:
        _NAME.validate_python(name)
    except ValidationError:
        faults.append(
            f"name = {name!r} is no name; use up to 64 lower-case letters, digits, - and _"
        )
    if not faults and figures[:2] == figures[2:]:
        faults.append("start and goal are the same place; give two")
    if faults:
        return None, faults
    return Pair(name, (figures[0], figures[1]), (figures[2], figures[3]), number), []


def _repeated(path: Path, pairs: list[Pair]) -> list[str]:
    """Return a message for each name that an earlier row has, too."""
    first: dict[str, int] = {}
    faults = []
    for pair in pairs:
        if pair.name in first:
            faults.append(
                f"{path.name}, row {pair.row}: name = {pair.name!r} is also the name of row "
                f"{first[pair.name]}; rename one"
            )
        first.setdefault(pair.name, pair.row)
    return faults


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

    def case(self, index: int, offset: int) -> "Case":
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

    def named(self, asked: str) -> "Block | None":
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
    """Return a name of a case."""
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
    def names(self) -> tuple[str, str, str, str, str, str]:
        """Names of scenario, season, pair, departure, vessel and member."""
        others = (self.pair, self.departure, self.vessel, self.member)
        pair, departure, vessel, member = map(_name_of, others)
        return self.block.scenario.name, self.season.name, pair, departure, vessel, member

    @property
    def name(self) -> str:
        """The names joined by slashes, without empty ones at the end."""
        names = list(self.names)
        while names[-1] == NONE:
            names.pop()
        return "/".join(names)

    @property
    def chart(self) -> tuple[int, str]:
        """Key of its chart: the block's number, and the vessel for which the chart is made."""
        return self.block.number, self.names[4]

    @property
    def current(self) -> CurrentKey:
        """Key of its current."""
        _, season, _, departure, _, member = self.names
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
    """Whether a case's name is `asked`, or begins with its names."""
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
        config.spec.model_dump_json(exclude=_NO_RESULT),
        *(text for block in cases.blocks for text in _described(block)),
    ]
    return hashlib.sha256("\n".join(described).encode()).hexdigest()


def _described(block: Block) -> Iterator[str]:
    """Yield texts that identify a block of cases."""
    scenario = block.scenario
    yield scenario.model_dump_json()
    yield str([block.vessels, block.members, block.pairs, [one.name for one in block.seasons]])
    if not scenario.is_planar:
        yield "\n".join(charted_land(scenario).identity)
