"""First stage: land and currents from the sources, with their credits.

Each part is an artefact of its own. A season takes the first of its sources that can be asked,
reaches over the region and answers; which were passed over, and why, travels on as notes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from pipeline import store as artefact
from pipeline.errors import RequestError, StageError
from pipeline.model import CurrentGrid, Fetched, Land
from pipeline.sources.land.osm_adapter import OsmLand
from pipeline.sources.land.overlay import Stack
from pipeline.sources.registry import current_source, land_source
from pipeline.stages import planar as plane
from pipeline.stages.overpowering_current import outrun_note

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pipeline.scenario.model import Scenario, Season
    from pipeline.scenario.region import Region
    from pipeline.sources.interfaces import CurrentSource, LandSource
    from pipeline.store import Store

# Where in the store sources keep their files.
DOWNLOADS = "downloads"


@dataclass(frozen=True, slots=True)
class Parts:
    """What was fetched, the key of every part, and the seasons for which nothing was found."""

    fetched: Fetched
    land_key: str
    current_keys: Mapping[str, str]
    failures: Mapping[str, str]


def fetch(scenario: Scenario, store: Store, *, offline: bool = False) -> Parts:
    """Fetch land and every season's current.

    Raises
    ------
    RequestError
        No season has a source that could be asked.
    StageError
        Sources were asked, and none answered.
    """
    if scenario.region is None:
        return _planar(scenario)
    land = land_source(scenario.chart, scenario.vessel.draught_m)
    fetcher = _Fetcher(scenario.region, land, store, offline)
    found = {season.name: fetcher.current(season) for season in scenario.seasons}
    grids = tuple(got.grid for got in found.values() if got.grid is not None)
    failures = {
        name: f"no source of currents could be used: {'; '.join(got.passed_over)}"
        for name, got in found.items()
        if got.grid is None
    }
    if not grids:
        reasons = [f"season {name!r}: {why}" for name, why in failures.items()]
        asked = any(got.asked for got in found.values())
        raise StageError("; ".join(reasons)) if asked else RequestError(reasons)
    region, speed_m_s = scenario.region.shape, scenario.vessel.speed_m_s
    outruns = [note for grid in grids for note in outrun_note(grid, region, speed_m_s)]
    return Parts(
        fetched=Fetched(fetcher.land, grids, (*fetcher.land.notes, *_notes(found), *outruns)),
        land_key=fetcher.land_key,
        current_keys={name: got.key for name, got in found.items() if got.grid is not None},
        failures=failures,
    )


@dataclass(frozen=True, slots=True)
class _Got:
    """A season's current and its key, or none; and why sources before it were passed over.

    `asked` says that a source was asked and failed, which is not the request's fault.
    """

    grid: CurrentGrid | None
    key: str
    passed_over: tuple[str, ...]
    asked: bool


def _notes(found: Mapping[str, _Got]) -> tuple[str, ...]:
    """What a reader should know of the currents; each thing once.

    Of those that are not the preferred ones, why.
    """
    told: dict[str, list[str]] = {}
    for season, got in found.items():
        for note in got.grid.notes if got.grid is not None else ():
            told.setdefault(note, []).append(season)
        if got.grid is not None and got.passed_over:
            for reason in got.passed_over:
                told.setdefault(reason, []).append(season)
            used = f"planned on {got.grid.credit.name}, valid {got.grid.valid}"
            told.setdefault(used, []).append(season)
    return tuple(f"{', '.join(seasons)}: {what}" for what, seasons in told.items())


@dataclass(frozen=True)
class _Fetcher:
    """Asks the sources for one region."""

    region: Region
    land_source: LandSource
    store: Store
    offline: bool

    @cached_property
    def land_key(self) -> str:
        """Name of the land's artefact."""
        return artefact.key("land", self.land_source.identity, self._outline)

    @cached_property
    def land(self) -> Land:
        """Land near the region; fetched once it is needed, as it takes seconds."""
        return self._land(self.land_source)

    @cached_property
    def ground(self) -> Land:
        """Land proper: a chart's no-go is also shoals and what nobody charted."""
        return self._land(Stack((OsmLand(),)))

    def _land(self, source: LandSource) -> Land:
        """Take a source's land from the store, or fetch it."""
        key = artefact.key("land", source.identity, self._outline)
        return self.store.made("land", key, Land, lambda: source.land(self.region.shape))

    @cached_property
    def _outline(self) -> str:
        """The region as text that names it exactly."""
        return str(self.region.shape.wkt)

    def current(self, season: Season) -> _Got:
        """Take the first source that gives the season's current."""
        passed_over: list[str] = []
        asked = False
        for named in season.currents:
            source = current_source(named)
            key = artefact.key("current", source.identity(season), self._outline, season.name)
            # What was fetched before needs neither account nor network.
            grid = self.store.load("current", key, CurrentGrid)
            if grid is None and (refusal := self._refusal(source, named, season)):
                passed_over.append(refusal)
                continue
            if grid is None:
                try:
                    folder = self.store.folder(DOWNLOADS)
                    grid = source.current(self.region.shape, season, self.ground, folder)
                except (StageError, RequestError) as error:
                    asked = asked or isinstance(error, StageError)
                    passed_over.append("; ".join(str(error).splitlines()))
                    continue
                self.store.save("current", key, grid)
            return _Got(grid, key, tuple(passed_over), asked)
        return _Got(None, "", tuple(passed_over), asked)

    def _refusal(self, source: CurrentSource, named: str | tuple[str, ...], season: Season) -> str:
        """Say why a source can't be asked; empty when it can."""
        shape, folder = self.region.shape, self.store.root / DOWNLOADS
        uncovered = source.uncovered(shape, season)
        if uncovered or not source.asks_network(shape, season, folder):
            return uncovered
        if self.offline:
            return f"{named} needs the network; leave --offline out"
        return source.unavailable()


def _planar(scenario: Scenario) -> Parts:
    """Figures of a plane scenario; its artefacts are named by them."""
    figures = scenario.model_dump(mode="json", include={"plane", "scale"})
    keys = {
        season.name: artefact.key("current", season.model_dump(mode="json"), figures)
        for season in scenario.seasons
    }
    return Parts(plane.fetched(scenario), artefact.key("land", figures), keys, {})
