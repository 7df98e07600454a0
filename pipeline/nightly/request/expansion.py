"""Expand a night's file into its cases; all faults of the file are reported together."""

import glob
import os
import re
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import shapely

from pipeline.errors import Fault, RequestError
from pipeline.machine.paths import unreadable_reason
from pipeline.nightly.request.cases import Block, Cases, Member, Pair, doubled, read_pairs
from pipeline.nightly.request.config import CaseSpec, Departure, NightConfig
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import STILL, Season
from pipeline.scenario.strict import looks_like_path
from pipeline.sources.land.shapes import box_around
from pipeline.sources.registry import charted_land
from pipeline.stages.region import endpoints_on_land, require_covered

MAX_UNASKED = 100_000
"""Largest number of cases without --yes."""
_NO_NAME = re.compile(r"[^a-z0-9]+")
# Land is read within this distance of any start or goal, m.
_NEAR_M = 2_000.0


def expand(config: NightConfig, *, only: str | None = None, yes: bool = False) -> Cases:
    """Return the cases of a night.

    Parameters
    ----------
    only
        A case's name, or its first parts: only matching cases are planned.
    yes
        Allow more than 100,000 cases.

    Raises
    ------
    RequestError
        The file has unknown scenarios, vessels, seasons or cases, or faulty pairs; one line each.
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
    if len(cases) > MAX_UNASKED and not yes:
        sizes = ", ".join(f"{block.scenario.name} {block.size:,}" for block in cases.blocks)
        fault = (
            f": there are {len(cases):,} ({sizes}), more than {MAX_UNASKED:,}; give --yes to "
            "plan all of them"
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
