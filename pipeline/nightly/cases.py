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
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import shapely
from pydantic import TypeAdapter, ValidationError

from pipeline.errors import Fault, RequestError, refuse_any
from pipeline.machine.paths import shown, unreadable_reason
from pipeline.nightly.config import CaseSpec, Departure, NightConfig
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import STILL, Currents, Season
from pipeline.scenario.strict import Name, Point, looks_like_path, near_miss
from pipeline.sources.land.shapes import box_around
from pipeline.sources.registry import charted_land
from pipeline.stages.region import endpoints_on_land, require_covered

_LONLAT = ("start_lon", "start_lat", "goal_lon", "goal_lat")
_PLANE = ("start_x", "start_y", "goal_x", "goal_y")
# Largest size of a file of pairs, bytes: far more pairs than the cases of a night.
_MAX_BYTES = 100 << 20
_NAME: TypeAdapter[str] = TypeAdapter(Name)
NONE = "-"
"""Stands for a part that the name of a case lacks; removed at the end of the name."""
# Dimensions of a block, in the order in which a case's name has them after the scenario.
_DIMENSIONS = ("seasons", "pairs", "departures", "vessels", "members")
# Largest number of cases of a night: all are held in memory.
_MAX_CASES = 20_000
_NO_NAME = re.compile(r"[^a-z0-9]+")
# Land is read within this distance of any start or goal, m.
_NEAR_M = 2_000.0
# Keys that do not affect results.
_NO_RESULT = {"output", "keep", "limit_hours", "workers"}
# Adds a fault of a key to those of a [[cases]] table.
_Refuse = Callable[[str, str], None]


@dataclass(frozen=True, slots=True)
class Pair:
    """Start and goal (lon/lat degrees, or metres in a plane), and the pair's row in the file."""

    name: str
    start: Point
    goal: Point
    row: int


def read_pairs(path: Path, *, is_planar: bool) -> tuple[tuple[Pair, ...], list[str]]:
    """Read a file of pairs; return the valid pairs and the faults."""
    keys = (*(_PLANE if is_planar else _LONLAT), "name")
    reason = unreadable_reason(path)
    if not reason and (size := path.stat().st_size) > _MAX_BYTES:
        reason = f"has {size >> 20:,} MB, more than {_MAX_BYTES >> 20}"
    if reason:
        return (), [f"{shown(path)} {reason}; give a CSV file with the columns {', '.join(keys)}"]
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        return (), [f"{shown(path)} can't be read as CSV: {error}; save it as CSV in UTF-8"]
    head = [cell.strip() for cell in rows[0]] if rows else []
    if of_head := _head_faults(head, keys):
        return (), [f"{path.name}, row 1: {fault}" for fault in of_head]
    pairs, faults = [], list[str]()
    for number, cells in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in cells):
            continue
        pair = None
        of_row = [f"has {len(cells)} cells, the header has {len(head)}; correct the row"]
        if len(cells) == len(head):
            row = dict(zip(head, cells, strict=True))
            pair, of_row = _pair(row, number, keys, is_planar=is_planar)
        faults += [Fault(f"row {number}", f": {fault}", f"{path.name}, ") for fault in of_row]
        if pair is not None:
            pairs.append(pair)
    faults += _repeated(path.name, pairs)
    if not pairs and not faults:
        faults.append(f"{path.name} has no pairs; add a row for each below the header")
    return tuple(pairs), faults


def _repeated(file: str, pairs: Iterable[Pair]) -> list[str]:
    """Return a message for each name that an earlier row has, too."""
    rows: dict[str, int] = {}
    return [
        f"{file}, row {pair.row}: name = {pair.name!r} is also the name of row {first}; rename one"
        for pair in pairs
        if (first := rows.setdefault(pair.name, pair.row)) != pair.row
    ]


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


@dataclass(frozen=True)
class Block:
    """The cases of one [[cases]] table; a dimension that was left out contains only None.

    Each of the `members` is the path of a file of currents.
    """

    number: int
    scenario: Scenario
    vessels: tuple[VesselSpec | None, ...]
    seasons: tuple[Season, ...]
    departures: tuple[Departure | None, ...]
    members: tuple[str | None, ...]
    pairs: tuple[Pair | None, ...]

    @property
    def size(self) -> int:
        """Number of cases."""
        return math.prod(len(getattr(self, dimension)) for dimension in _DIMENSIONS)

    def sources(self) -> Iterator[tuple[Season, tuple[Currents, ...]]]:
        """Yield each season with the sources of its currents: its own, or a member's file."""
        for season, member in itertools.product(self.seasons, self.members):
            yield season, sources_of(season, member)

    @cached_property
    def names(self) -> tuple[frozenset[str], ...]:
        """Names in each dimension, to find whether two blocks have a case in common."""
        return (
            frozenset({self.scenario.name}),
            *(frozenset(map(_name_of, getattr(self, dimension))) for dimension in _DIMENSIONS),
        )

    def named(self, asked: str) -> "Block | None":
        """Return the block of the cases whose names are or begin with `asked`, or None.

        Each dimension is searched on its own: before this, a block may have billions of cases.
        """
        scenario, *wanted = asked.strip("/").split("/")
        kept: dict[str, Any] = {
            dimension: tuple(part for part in getattr(self, dimension) if _name_of(part) == name)
            for dimension, name in zip(_DIMENSIONS, wanted, strict=False)
        }
        beyond = wanted[len(_DIMENSIONS) :]
        if scenario != self.scenario.name or not all(kept.values()) or set(beyond) - {NONE}:
            return None
        return replace(self, **kept)


def sources_of(season: Season, member: str | None) -> tuple[Currents, ...]:
    """Return sources of currents in order of preference: the season's own, or a member's file."""
    return season.currents if member is None else ((member,),)


def _name_of(part: Season | Pair | Departure | VesselSpec | str | None) -> str:
    """Return the name of a part of a case; that of a member is made of its file's name."""
    if isinstance(part, str):
        return _NO_NAME.sub("-", Path(part).stem.lower()).strip("-")[:64] or "member"
    return NONE if part is None else part.name


@dataclass(frozen=True)
class NightCase:
    """One voyage to plan; `index` is its place among all cases of the night."""

    index: int
    block: Block
    vessel: VesselSpec | None
    season: Season
    departure: Departure | None
    member: str | None
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


def all_cases(blocks: Iterable[Block]) -> Iterator[NightCase]:
    """Yield all cases of a night in order."""
    index = itertools.count()
    for block in blocks:
        for voyage in itertools.product(
            block.vessels, block.seasons, block.departures, block.members, block.pairs
        ):
            yield NightCase(next(index), block, *voyage)


def matches(name: str, asked: str) -> bool:
    """Whether a case's name is `asked`, or begins with its names."""
    wanted = asked.strip("/").split("/")
    parts = name.split("/")
    parts += [NONE] * (len(wanted) - len(parts))
    return parts[: len(wanted)] == wanted


def request_hash(config: NightConfig, blocks: Iterable[Block]) -> str:
    """Return a hash of all inputs of the results except the currents' data and the code.

    Charts, depths and pairs are represented by their content.
    """
    described = [config.spec.model_dump_json(exclude=_NO_RESULT)]
    for block in blocks:
        names = [season.name for season in block.seasons]
        described += [
            block.scenario.model_dump_json(),
            str([block.vessels, block.members, block.pairs, names]),
        ]
        if not block.scenario.is_planar:
            described += charted_land(block.scenario).identity
    return hashlib.sha256("\n".join(described).encode()).hexdigest()


# --- from a night's file to its cases ---


def expand(config: NightConfig, *, only: str | None = None) -> list[Block]:
    """Return the cases of a night, a block for each [[cases]] table.

    With `only`, a case's name or its first parts, only matching cases are planned. Raises
    RequestError if the file has unknown scenarios, vessels, seasons or cases, faulty pairs, or too
    many cases; one line each.
    """
    faults: list[str] = []
    blocks = [
        block
        for number, spec in enumerate(config.spec.cases)
        if (block := _block(config, number, spec, faults)) is not None
    ]
    faults += [
        config.located(
            f"cases[{other.number}].scenario",
            f" = {other.scenario.name!r}: asks for cases of cases[{first.number}] again; leave "
            "them out in one of the two",
        )
        for first, other in itertools.combinations(blocks, 2)
        if not any(a.isdisjoint(b) for a, b in zip(first.names, other.names, strict=True))
    ]
    refuse_any(faults)
    if only is not None:
        wanted = [kept for block in blocks if (kept := block.named(only)) is not None]
        if not wanted:
            example = next(all_cases(blocks)).name
            raise RequestError(f"--only: no case is called {only!r}; a name looks like {example!r}")
        blocks = wanted
    if (count := sum(block.size for block in blocks)) > _MAX_CASES:
        sizes = ", ".join(f"{block.scenario.name} {block.size:,}" for block in blocks)
        fault = (
            f": there are {count:,} ({sizes}), more than {_MAX_CASES:,}; divide them among "
            "several files, each with its own output folder"
        )
        raise RequestError(config.located("cases", fault))
    return blocks


def _block(config: NightConfig, number: int, spec: CaseSpec, faults: list[str]) -> Block | None:
    """Return the block of a [[cases]] table; None if it has faults, which are added to `faults`."""
    own_faults: list[str] = []

    def refuse(key: str, text: str) -> None:
        """Add a fault of a key, or one in the file that the key names."""
        where = f"cases[{number}].{key}"
        if isinstance(text, Fault):
            own_faults.append(text.behind(config.located(where, ": ")))
        else:
            own_faults.append(config.located(where, f": {text}"))

    vessels = _vessels(spec, refuse)
    members = _members(config, spec, refuse)
    scenario = _scenario(config, spec, refuse)
    block = None
    if scenario is not None:
        if scenario.is_planar and (spec.members or spec.currents):
            refuse("members" if spec.members else "currents", "needs a chart; a plane has none")
        seasons = _seasons(spec, scenario, refuse)
        pairs = _pairs(config, spec, scenario, refuse)
        departures = (None,) if spec.departures is None else spec.departures.departures()
        block = Block(number, scenario, vessels, seasons, departures, members, pairs)
    faults += own_faults
    return None if own_faults else block


def _scenario(config: NightConfig, spec: CaseSpec, refuse: _Refuse) -> Scenario | None:
    """Load the scenario; files of its currents may not exist yet."""
    asked, about = spec.scenario, ""
    try:
        # Path.exists raises an error if a name is too long.
        beside = config.here(asked)
        is_file = looks_like_path(asked) or os.path.exists(beside)  # noqa: PTH110
        is_named = asked in catalogue.names("scenarios") or not is_file
        path = catalogue.scenario_path(asked if is_named else beside)
        data = catalogue.read_toml(path)
        about = f"{asked!r}: "  # faults of the file are named by its path
        if spec.departures is not None:
            data = _with_times(data)
        scenario = parse_scenario(data, path.parent)
        require_covered(_without_files(scenario))
        return _with_own_currents(config, spec, scenario)
    except RequestError as error:
        for fault in error.faults:
            refuse("scenario", f"{about}{fault}")
        return None


def _with_own_currents(config: NightConfig, spec: CaseSpec, scenario: Scenario) -> Scenario:
    """Replace the scenario's currents with those of the table, if it has any."""
    if not spec.currents or scenario.is_planar:
        return scenario
    sources = catalogue.names("sources")
    for name in spec.currents:
        if not looks_like_path(name) and name not in sources:
            raise RequestError([f"currents {catalogue.unknown('source', name, sources)}"])
    named = tuple((config.here(name),) if looks_like_path(name) else name for name in spec.currents)
    seasons = tuple(season.model_copy(update={"currents": named}) for season in scenario.seasons)
    faults = [f"season {one.name!r} {fault}" for one in seasons for fault in one.member_faults()]
    refuse_any(faults)
    return scenario.model_copy(update={"seasons": seasons})


def _vessels(spec: CaseSpec, refuse: _Refuse) -> tuple[VesselSpec | None, ...]:
    """Return the vessels of the table, or None for the scenario's own."""
    if spec.vessels is None:
        return (None,)
    vessels = []
    for name in spec.vessels:
        try:
            vessels.append(catalogue.vessel(name))
        except RequestError as error:
            for fault in error.faults:
                refuse("vessels", fault)
    _refuse_repeated("vessels", spec.vessels, refuse)
    return tuple(vessels)


def _seasons(spec: CaseSpec, scenario: Scenario, refuse: _Refuse) -> tuple[Season, ...]:
    """Return the scenario's seasons that the table asks for."""
    for key in ("via", "avoid", "tide"):
        if getattr(scenario, key):
            refuse(
                "scenario",
                f"{scenario.name} has '{key}', which a night can't plan with; leave it out",
            )
    known = {season.name: season for season in scenario.seasons}
    asked = tuple(known) if spec.seasons is None else spec.seasons
    where = "scenario" if spec.seasons is None else "seasons"
    for name in asked:
        if name not in known:
            refuse(
                where, f"{name!r} is no season of {scenario.name}; there are: {', '.join(known)}"
            )
        elif known[name].speed is not None:
            refuse(
                where,
                f"season {name!r} of {scenario.name} has 'speed' and its own times; a night "
                "plans each case at the vessel's speed: leave out the season, or its 'speed' "
                "and 'arrive_by'",
            )
        elif known[name].leaves_departure_open:
            refuse(
                where,
                f"season {name!r} of {scenario.name} leaves its departure open; each departure "
                "of a night is a case: give the season a 'departure' in place of 'departures' "
                "or 'arrive_by', and list them in this table's 'departures'",
            )
    _refuse_repeated(where, asked, refuse)
    return tuple(known[name] for name in asked if name in known)


def _members(config: NightConfig, spec: CaseSpec, refuse: _Refuse) -> tuple[str | None, ...]:
    """Return the path of each member; a missing file is no fault, as it may arrive later."""
    if spec.members is None:
        return (None,)
    paths: list[str] = []
    for pattern in map(config.here, spec.members):
        paths += sorted(glob.glob(str(Path(pattern).expanduser()))) or [pattern]  # noqa: PTH207 - Path.glob takes no absolute pattern
    _refuse_repeated("members", [_name_of(path) for path in paths], refuse)
    return tuple(paths)


def _pairs(
    config: NightConfig, spec: CaseSpec, scenario: Scenario, refuse: _Refuse
) -> tuple[Pair | None, ...]:
    """Read the pairs; pairs outside the region are faults."""
    if spec.pairs is None:
        return (None,)
    file = Path(config.here(spec.pairs))
    pairs, faults = read_pairs(file, is_planar=scenario.is_planar)
    if not scenario.is_planar and scenario.region is None:
        refuse("pairs", f"need a region that contains them; add a [region] to {scenario.name}")
    elif pairs:
        area = scenario.area
        shapely.prepare(area)
        what = "plane" if scenario.is_planar else "region"
        bounds = ", ".join(f"{bound:g}" for bound in area.bounds)
        faults += [
            f"{file.name}, row {pair.row}: {name} = {list(place)} lies outside the {what} of "
            f"{scenario.name} ({bounds}); move it inside, or widen the {what}"
            for pair in pairs
            for name, place in (("start", pair.start), ("goal", pair.goal))
            if not area.covers(shapely.Point(place))
        ]
    for fault in faults:
        refuse("pairs", fault)
    return pairs


def _refuse_repeated(key: str, names: Iterable[str], refuse: _Refuse) -> None:
    """Add a fault for each name that occurs twice."""
    for name, count in Counter(names).items():
        if count > 1:
            refuse(key, f"{name!r} comes twice; leave one out")


def _with_times(data: dict[str, Any]) -> dict[str, Any]:
    """Add a time to seasons that need one and have none; each case's departure replaces it.

    The tables are those of a file, and not yet checked.
    """
    tables = data.get("seasons")
    if not isinstance(tables, list):
        return data
    seasons = []
    for season in tables:
        time: dict[str, Any] = {}
        if isinstance(season, dict):
            currents = season.get("currents")
            sources = currents if isinstance(currents, list) else ()
            is_changing = season.get("time_method") == "changing"
            has_clock = is_changing or "limits" in data
            if has_clock and not {"departures", "arrive_by"} & season.keys():
                time = {"departure": datetime.fromtimestamp(0, UTC)}
            if not is_changing and any(
                not isinstance(name, str) or looks_like_path(name) for name in sources
            ):
                time |= {"valid": "1970-01"}  # files
        seasons.append({**time, **season} if time else season)
    return {**data, "seasons": seasons}


def _without_files(scenario: Scenario) -> Scenario:
    """Remove files of currents from a scenario, because a forecast may arrive later."""
    seasons = []
    for season in scenario.seasons:
        named = tuple(source for source in season.currents if isinstance(source, str))
        seasons.append(season.model_copy(update={"currents": named or (STILL,)}))
    return scenario.model_copy(update={"seasons": tuple(seasons)})


def pairs_on_land(config: NightConfig, blocks: Iterable[Block]) -> list[Fault]:
    """Return a message for each start and goal on land."""
    faults = []
    for block in blocks:
        scenario = block.scenario
        if scenario.is_planar:
            continue
        voyages = [scenario if pair is None else pair for pair in block.pairs]
        ends = shapely.points([end for voyage in voyages for end in (voyage.start, voyage.goal)])
        around = box_around(shapely.box(*shapely.total_bounds(ends)), _NEAR_M)
        land = shapely.STRtree(charted_land(scenario).land(around).polygons)
        # All ends are tested at once, which is quick; to find the nearest water takes longer.
        for at in sorted(set(land.query(ends, predicate="intersects")[0] // 2)):
            pair, key, where = block.pairs[at], "scenario", ""
            if pair is not None:
                file = config.spec.cases[block.number].pairs
                key, where = "pairs", f"{file}, row {pair.row}: "
                scenario = scenario.model_copy(update={"start": pair.start, "goal": pair.goal})
            faults += [
                config.located(f"cases[{block.number}].{key}", f": {where}{fault}")
                for fault in endpoints_on_land(scenario)
            ]
    return faults
