"""First stage: land and currents from the sources, with their credits.

Each part is an artefact of its own. A season takes the first of its sources that can be asked,
reaches over the region and answers; which were passed over, and why, travels on as notes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from pipeline import artefact, plane
from pipeline.errors import RequestError, StageError
from pipeline.model import CurrentGrid, Fetched, Land
from pipeline.sources import current_source, land_source

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pipeline.artefact import Store
    from pipeline.scenario import Region, Scenario, Season
    from pipeline.sources import CurrentSource


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
    fetcher = _Fetcher(scenario.region, scenario.chart.source, store, offline)
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
    return Parts(
        fetched=Fetched(fetcher.land, grids, _notes(found)),
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
    """What a reader should know of currents that are not the preferred ones; each thing once."""
    told: dict[str, list[str]] = {}
    for season, got in found.items():
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
    land_name: str
    store: Store
    offline: bool

    @cached_property
    def land_key(self) -> str:
        """Name of the land's artefact."""
        return artefact.key("land", land_source(self.land_name).identity, self._outline)

    @cached_property
    def land(self) -> Land:
        """Land near the region; fetched once it is needed, as it takes seconds."""
        source = land_source(self.land_name)
        return self.store.made("land", self.land_key, Land, lambda: source.land(self.region.shape))

    @cached_property
    def _outline(self) -> str:
        """The region as text that names it exactly."""
        return str(self.region.shape.wkt)

    def current(self, season: Season) -> _Got:
        """Take the first source that gives the season's current."""
        passed_over: list[str] = []
        asked = False
        for name in season.currents:
            source = current_source(name)
            key = artefact.key("current", source.identity(season), self._outline, season.name)
            # What was fetched before needs neither account nor network.
            grid = self.store.load("current", key, CurrentGrid)
            if grid is None and (refusal := self._refusal(source, name, season)):
                passed_over.append(refusal)
                continue
            if grid is None:
                asked = True
                try:
                    folder = self.store.folder("downloads")
                    grid = source.current(self.region.shape, season, self.land, folder)
                except StageError as error:
                    passed_over.append(str(error))
                    continue
                self.store.save("current", key, grid)
            return _Got(grid, key, tuple(passed_over), asked)
        return _Got(None, "", tuple(passed_over), asked)

    def _refusal(self, source: CurrentSource, name: str, season: Season) -> str:
        """Say why a source can't be asked; empty when it can."""
        if self.offline and source.uses_network:
            return f"{name} needs the network; leave --offline out"
        return source.uncovered(self.region.shape, season) or source.unavailable()


def _planar(scenario: Scenario) -> Parts:
    """Figures of a plane scenario; its artefacts are named by them."""
    figures = scenario.model_dump(mode="json", include={"plane", "scale"})
    keys = {
        season.name: artefact.key("current", season.model_dump(mode="json"), figures)
        for season in scenario.seasons
    }
    return Parts(plane.fetched(scenario), artefact.key("land", figures), keys, {})
