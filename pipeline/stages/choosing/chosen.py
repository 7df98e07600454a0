"""A request with what was chosen for it, and seasons whose clock begins at a chosen time."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import timedelta
from typing import TypeVar

import renew
from pipeline.machine.store import Artefact, artefact_key
from pipeline.model import DepartureChoice, Note, Scene
from pipeline.model.planning import speed_choices
from pipeline.scenario.model import Scenario
from pipeline.stages.fetch import FetchedData
from pipeline.stages.places import later
from pipeline.stages.tides import later_tides

_T = TypeVar("_T")


@dataclass(frozen=True)
class Chosen:
    """A complete scenario with its data and scene; the chosen departures, and notes on choices."""

    scenario: Scenario
    data: FetchedData
    scene: Artefact[Scene]
    choices: tuple[DepartureChoice, ...] = ()
    notes: tuple[Note, ...] = ()

    def at_clock(
        self, scenario: Scenario, name: str, label: str, shift: float, *, keeps: bool = False
    ) -> "Chosen":
        """Return the choice for a scenario in which a season's clock begins `shift` seconds later.

        The season is called `label` there. If it `keeps` the season, it also has it as it was, by
        its own name.
        """

        def renamed(by_season: Mapping[str, _T], value: _T | None = None) -> dict[str, _T]:
            """Return values by season, with the one of the label."""
            found: dict[str, _T] = {}
            for one, known in by_season.items():
                if one != name or keeps:
                    found[one] = known
                if one == name:
                    found[label] = known if value is None else value
            return found

        data, scene = self.data, self.scene.value
        begin = scene.departures[name] + timedelta(seconds=shift)
        current, depth = scene.currents[name], scene.tidal_depths.get(name)
        if isinstance(current, renew.VaryingCurrent):
            current = renew.VaryingCurrent(current.slice_times - shift, current.slices)
        own = [grid for grid in data.fetched.currents if grid.season == name]
        grids = {one.season: one for one in data.fetched.currents}
        moved = [replace(grid, season=label, times_s=grid.times_s - shift) for grid in own]
        notes = data.fetched.notes
        if not keeps:
            notes = tuple(
                one.about(*(label if of == name else of for of in one.seasons)) for one in notes
            )
        key = artefact_key("departures", data.current_keys[name], begin)
        fetched = replace(
            data.fetched,
            currents=tuple(renamed(grids, *moved).values()),
            notes=notes,
        )
        return replace(
            self,
            scenario=scenario,
            data=replace(data, fetched=fetched, current_keys=renamed(data.current_keys, key)),
            scene=Artefact(
                artefact_key("departures", self.scene.key, name, label, begin),
                replace(
                    scene,
                    currents=renamed(scene.currents, current),
                    current_cells=renamed(scene.current_cells),
                    areas=renamed(scene.areas, later(scene.areas.get(name, ()), shift)),
                    tidal_depths=renamed(scene.tidal_depths, depth and later_tides(depth, shift)),
                    departures=renamed(scene.departures, begin),
                    speeds=speed_choices(scenario),
                ),
            ),
        )


def in_thread(work: Callable[[], _T]) -> _T:
    """Call `work` in a thread: a signal handler must not raise inside compiled code."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(work).result()
