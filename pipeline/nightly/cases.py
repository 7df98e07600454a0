"""All cases of a night: the products of scenario, season, pair, departure, vessel and member.

Their order is that of planning: vessel, season, departure, member, pair. So neighbours share chart
and current. Pairs are read from a CSV file. All faults of a night's file are reported together.
"""

import csv
import glob
import hashlib
import itertools
import math
import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import shapely
from pydantic import TypeAdapter, ValidationError

from pipeline.errors import Fault, RequestError
from pipeline.machine.paths import shown, unreadable_reason
from pipeline.nightly.config import CaseSpec, Departure, NightConfig
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import STILL, Season
from pipeline.scenario.strict import Name, Point, looks_like_path, near_miss
from pipeline.sources.land.shapes import box_around
from pipeline.sources.registry import charted_land
from pipeline.stages.region import endpoints_on_land, require_covered

_LONLAT = ("start_lon", "start_lat", "goal_lon", "goal_lat")
_PLANE = ("start_x", "start_y", "goal_x", "goal_y")
# Largest size of a file, bytes: a million pairs are a file of 50 MB, and take 1 GB of memory.
_MAX_BYTES = 100 << 20
_NAME: TypeAdapter[str] = TypeAdapter(Name)
NONE = "-"
"""Stands for a name of a case that is left out; removed at the end of the name."""
# Dimensions of a block, in the order of a case's name after the scenario.
_DIMENSIONS = ("seasons", "pairs", "departures", "vessels", "members")
# Largest number of cases of a night: all are held in memory.
_MAX_CASES = 20_000
_NO_NAME = re.compile(r"[^a-z0-9]+")
# Land is read within this distance of any start or goal, m.
_NEAR_M = 2_000.0
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

    @property
    def size(self) -> int:
        """Number of cases."""
        return math.prod(len(getattr(self, dimension)) for dimension in _DIMENSIONS)

    def cases(self, offset: int) -> Iterator["NightCase"]:
        """Yield the cases in order; `offset` is the number of cases before the block."""
        voyages = itertools.product(
            self.vessels, self.seasons, self.departures, self.members, self.pairs
        )
        for index, (vessel, season, departure, member, pair) in enumerate(voyages, offset):
            yield NightCase(index, self, vessel, season, departure, member, pair)

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


@dataclass(frozen=True)
class NightCase:
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
    def current(self) -> tuple[int, str, str, str]:
        """Key of its current: the block's number, season, departure and member."""
        _, season, _, departure, _, member = self.names
        return self.block.number, season, departure, member


@dataclass(frozen=True)
class Cases:
    """All cases, by their index."""

    blocks: tuple[Block, ...]

    @cached_property
    def _all(self) -> list[NightCase]:
        """All cases in order."""
        cases = list[NightCase]()
        for block in self.blocks:
            cases += block.cases(len(cases))
        return cases

    def __len__(self) -> int:
        """Return the number of all cases."""
        return sum(block.size for block in self.blocks)

    def __getitem__(self, index: int) -> NightCase:
        """Return the case at an index."""
        return self._all[index]

    def __iter__(self) -> Iterator[NightCase]:
        """Yield all cases in order."""
        return iter(self._all)

    def chart_ranges(self) -> list[tuple[int, int]]:
        """Return the ranges (first, end) of cases that share a chart."""
        groups = itertools.groupby(self, lambda case: case.chart)
        sizes = [len(list(group)) for _, group in groups]
        return list(itertools.pairwise(itertools.accumulate(sizes, initial=0)))


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


# --- from a night's file to its cases ---


def expand(config: NightConfig, *, only: str | None = None) -> Cases:
    """Return the cases of a night.

    Parameters
    ----------
    only
        A case's name, or its first parts: only matching cases are planned.

    Raises
    ------
    RequestError
        The file has unknown scenarios, vessels, seasons or cases, faulty pairs, or too many cases;
        one line each.
    """
    faults: list[str] = []
    blocks = []
    for number, spec in enumerate(config.spec.cases):
        block, found = _Expansion(config, number, spec).block()
        faults += found
        if block is not None:
            blocks.append(block)
    faults += [
        config.located(
            f"cases[{other.number}].scenario",
            f" = {other.scenario.name!r}: asks for cases of cases[{one.number}] again; leave them "
            "out in one of the two",
        )
        for one, other in doubled(blocks)
    ]
    for number, voyage in enumerate(config.spec.voyages):
        for key, given in (("results", voyage.results), ("positions", voyage.positions)):
            if reason := unreadable_reason(config.here(given)):
                faults.append(config.located(f"voyages[{number}].{key}", f" = {given!r} {reason}"))
    if faults:
        raise RequestError(faults)
    cases = Cases(tuple(blocks))
    if only is not None:
        cases = _only(cases, only)
    if len(cases) > _MAX_CASES:
        sizes = ", ".join(f"{block.scenario.name} {block.size:,}" for block in cases.blocks)
        fault = (
            f": there are {len(cases):,} ({sizes}), more than {_MAX_CASES:,}; divide them among "
            "several files, each with its own output folder"
        )
        raise RequestError(config.located("cases", fault))
    return cases


class _Expansion:
    """Expands one [[cases]] table into a block."""

    def __init__(self, config: NightConfig, number: int, spec: CaseSpec) -> None:
        self._config, self._number, self._spec = config, number, spec
        self._faults: list[str] = []

    def block(self) -> tuple[Block | None, list[str]]:
        """Return the block and no faults, or None and the faults."""
        spec = self._spec
        vessels = self._vessels()
        members = self._members()
        scenario = self._scenario()
        if scenario is None:
            return None, self._faults
        if scenario.is_planar and (spec.members or spec.currents):
            self._fault(
                "members" if spec.members else "currents", "needs a chart; a plane has none"
            )
        seasons = self._seasons(scenario)
        pairs = self._pairs(scenario)
        departures: tuple[Departure | None, ...] = (None,)
        if spec.departures is not None:
            departures = spec.departures.departures()
        if self._faults:
            return None, self._faults
        return Block(
            self._number, scenario, vessels, seasons, departures, members, pairs
        ), self._faults

    def _fault(self, key: str, text: str) -> None:
        """Add a fault of a key, or one in the key's file."""
        where = f"cases[{self._number}].{key}"
        if isinstance(text, Fault):
            self._faults.append(text.behind(self._config.located(where, ": ")))
        else:
            self._faults.append(self._config.located(where, f": {text}"))

    def _here(self, path: str) -> str:
        """Return a path relative to the file's own folder."""
        return self._config.here(path)

    def _scenario(self) -> Scenario | None:
        """Load the scenario; files of its currents may not exist yet."""
        asked, about = self._spec.scenario, ""
        try:
            is_named = asked in catalogue.names("scenarios")
            path = catalogue.scenario_path(asked if is_named else self._named_or_path(asked))
            data = catalogue.read_toml(path)
            about = f"{asked!r}: "  # faults of the file are named by its path
            if self._spec.departures is not None:
                data = _with_times(data)
            scenario = parse_scenario(data, path.parent)
            require_covered(_without_files(scenario))
            return self._with_own_currents(scenario)
        except RequestError as error:
            for fault in error.faults:
                self._fault("scenario", f"{about}{fault}")
            return None

    def _named_or_path(self, asked: str) -> str:
        """Return the path relative to the file's folder, unless the text is a catalogue name."""
        path = self._here(asked)
        # Path.exists raises an error if a name is too long.
        return path if looks_like_path(asked) or os.path.exists(path) else asked  # noqa: PTH110

    def _with_own_currents(self, scenario: Scenario) -> Scenario:
        """Replace the scenario's currents with those of the table, if it has any."""
        if not self._spec.currents or scenario.is_planar:
            return scenario
        named = tuple(
            (self._here(one),) if looks_like_path(one) else one for one in self._spec.currents
        )
        for one in named:
            if isinstance(one, str) and one not in catalogue.names("sources"):
                raise RequestError(
                    [f"currents {catalogue.unknown('source', one, catalogue.names('sources'))}"]
                )
        seasons = tuple(
            season.model_copy(update={"currents": named}) for season in scenario.seasons
        )
        faults = [(one.name, fault) for one in seasons for fault in one.member_faults()]
        if faults:
            raise RequestError([f"season {name!r} {fault}" for name, fault in faults])
        return scenario.model_copy(update={"seasons": seasons})

    def _vessels(self) -> tuple[VesselSpec | None, ...]:
        """Return the vessels of the table, or None for the scenario's own."""
        if self._spec.vessels is None:
            return (None,)
        found = []
        for name in self._spec.vessels:
            try:
                found.append(catalogue.vessel(name))
            except RequestError as error:
                for fault in error.faults:
                    self._fault("vessels", fault)
        self._refuse_repeated("vessels", self._spec.vessels)
        return tuple(found)

    def _seasons(self, scenario: Scenario) -> tuple[Season, ...]:
        """Return the seasons that the table asks for."""
        known = {season.name: season for season in scenario.seasons}
        for key in ("via", "avoid", "tide"):
            if getattr(scenario, key):
                self._fault(
                    "scenario",
                    f"{scenario.name} has '{key}', which a night can't plan with; leave it out",
                )
        asked = known if self._spec.seasons is None else self._spec.seasons
        for name in asked:
            if name not in known:
                continue
            if known[name].speed is None and known[name].leaves_departure_open:
                self._fault(
                    "scenario" if self._spec.seasons is None else "seasons",
                    f"season {name!r} of {scenario.name} leaves its departure open; each departure "
                    "of a night is a case: give the season a 'departure' in place of 'departures' "
                    "or 'arrive_by', and list them in this table's 'departures'",
                )
            if known[name].speed is not None:
                self._fault(
                    "scenario" if self._spec.seasons is None else "seasons",
                    f"season {name!r} of {scenario.name} has 'speed' and its own times; a night "
                    "plans each case at the vessel's speed: leave out the season, or its 'speed' "
                    "and 'arrive_by'",
                )
        if self._spec.seasons is None:
            return scenario.seasons
        for name in self._spec.seasons:
            if name not in known:
                self._fault(
                    "seasons",
                    f"{name!r} is no season of {scenario.name}; there are: " + ", ".join(known),
                )
        self._refuse_repeated("seasons", self._spec.seasons)
        return tuple(known[name] for name in self._spec.seasons if name in known)

    def _members(self) -> tuple[Member | None, ...]:
        """Return a member for each file; a missing file is no fault, as it may arrive later."""
        if self._spec.members is None:
            return (None,)
        paths: list[str] = []
        for pattern in map(self._here, self._spec.members):
            paths += sorted(glob.glob(str(Path(pattern).expanduser()))) or [pattern]  # noqa: PTH207 - Path.glob takes no absolute pattern
        members = [Member(_name(Path(path).stem), path) for path in paths]
        self._refuse_repeated("members", [member.name for member in members])
        return tuple(members)

    def _pairs(self, scenario: Scenario) -> tuple[Pair | None, ...]:
        """Read the pairs; pairs outside the region are faults."""
        if self._spec.pairs is None:
            return (None,)
        pairs, faults = read_pairs(Path(self._here(self._spec.pairs)), is_planar=scenario.is_planar)
        if not scenario.is_planar and scenario.region is None:
            self._fault(
                "pairs", f"need a region that contains them; add a [region] to {scenario.name}"
            )
        elif pairs:
            faults = [*faults, *_outside(scenario, pairs, Path(self._spec.pairs).name)]
        for fault in faults:
            self._fault("pairs", fault)
        return pairs

    def _refuse_repeated(self, key: str, names: Sequence[str]) -> None:
        """Add a fault for each name that occurs twice."""
        for name in (name for name, count in Counter(names).items() if count > 1):
            self._fault(key, f"{name!r} comes twice; leave one out")


def _outside(scenario: Scenario, pairs: Sequence[Pair], file: str) -> list[str]:
    """Return a message for each start or goal outside a scenario's area."""
    import shapely

    area = scenario.area
    shapely.prepare(area)
    what = "plane" if scenario.is_planar else "region"
    bounds = ", ".join(f"{bound:g}" for bound in area.bounds)
    return [
        f"{file}, row {pair.row}: {name} = {list(place)} lies outside the {what} of "
        f"{scenario.name} ({bounds}); move it inside, or widen the {what}"
        for pair in pairs
        for name, place in (("start", pair.start), ("goal", pair.goal))
        if not area.covers(shapely.Point(place))
    ]


def _with_times(data: dict[str, Any]) -> dict[str, Any]:
    """Add a time to seasons that have changing currents or files of currents, but no time.

    It is replaced by each case's departure.
    """
    given = data.get("seasons")
    seasons = [
        {**_time(season), **season} if isinstance(season, dict) else season
        for season in (given if isinstance(given, list) else ())
    ]
    return {**data, "seasons": seasons} if seasons else data


def _time(season: dict[str, Any]) -> dict[str, Any]:
    """Return a provisional time for a season's table, if it may lack one."""
    if season.get("time_method") == "changing":
        is_open = {"departures", "arrive_by"} & season.keys()
        return {} if is_open else {"departure": datetime.fromtimestamp(0, UTC)}
    is_file = any(not isinstance(one, str) or looks_like_path(one) for one in _listed(season))
    return {"valid": "1970-01"} if is_file else {}


def _listed(season: dict[str, Any]) -> list[Any]:
    """Return the currents of a season's table, or [] if they are not a list."""
    currents = season.get("currents")
    return currents if isinstance(currents, list) else []


def _without_files(scenario: Scenario) -> Scenario:
    """Remove files of currents from a scenario, because a forecast may arrive later."""
    seasons = []
    for season in scenario.seasons:
        named = tuple(one for one in season.currents if isinstance(one, str))
        seasons.append(season.model_copy(update={"currents": named or (STILL,)}))
    return scenario.model_copy(update={"seasons": tuple(seasons)})


def _name(stem: str) -> str:
    """Return a member's name: the file's name reduced to lower-case letters, digits and '-'."""
    return _NO_NAME.sub("-", stem.lower()).strip("-")[:64] or "member"


def _only(cases: Cases, asked: str) -> Cases:
    """Return the cases whose names are or begin with `asked`; raise RequestError for none."""
    blocks = [kept for block in cases.blocks if (kept := block.named(asked)) is not None]
    if not blocks:
        example = cases[0].name
        raise RequestError(f"--only: no case is called {asked!r}; a name looks like {example!r}")
    return Cases(tuple(blocks))


def pairs_on_land(config: NightConfig, cases: Cases) -> list[Fault]:
    """Return a message for each start and goal on land."""
    faults = []
    for block in cases.blocks:
        if block.scenario.is_planar:
            continue
        file = config.spec.cases[block.number].pairs
        voyages = _voyages(block)
        for suspect in _suspects([scenario for scenario, _ in voyages]):
            scenario, row = voyages[suspect]
            key, where = ("pairs", f"{file}, row {row}: ") if row else ("scenario", "")
            faults += [
                config.located(f"cases[{block.number}].{key}", f": {where}{fault}")
                for fault in endpoints_on_land(scenario)
            ]
    return faults


def _voyages(block: Block) -> list[tuple[Scenario, int]]:
    """Return the scenario of each pair, with the pair's row; 0 for the scenario's own ends."""
    return [
        (block.scenario, 0)
        if pair is None
        else (block.scenario.model_copy(update={"start": pair.start, "goal": pair.goal}), pair.row)
        for pair in block.pairs
    ]


def _suspects(scenarios: Sequence[Scenario]) -> list[int]:
    """Return the indices of the voyages on one chart that have an end on land.

    All are tested together, which is quick; finding the nearest water for messages takes longer.
    """
    ends = shapely.points([end for one in scenarios for end in (one.start, one.goal)])
    around = box_around(shapely.box(*shapely.total_bounds(ends)), _NEAR_M)
    source = charted_land(scenarios[0])
    land = shapely.STRtree(source.land(around).polygons)
    found = land.query(ends, predicate="intersects")[0]
    return sorted(set((found // 2).tolist()))
