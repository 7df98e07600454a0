"""A request with what was chosen for it, and cases whose clock begins at a chosen time."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

from pipeline.machine.store import Artefact, artefact_key
from pipeline.model import Case, DepartureChoice, Note
from pipeline.scenario.model import Scenario
from pipeline.stages.fetch import FetchedData

_T = TypeVar("_T")


@dataclass(frozen=True)
class Chosen:
    """A complete scenario with its data and cases; the chosen departures, and notes on choices."""

    scenario: Scenario
    data: FetchedData
    cases: Artefact[tuple[Case, ...]]
    choices: tuple[DepartureChoice, ...] = ()
    notes: tuple[Note, ...] = ()

    def case(self, name: str) -> Case:
        """Return the case of a name."""
        return next(case for case in self.cases.value if case.name == name)

    def at_clock(
        self, scenario: Scenario, begun: Case, earlier: Case, shift: float, *, keeps: bool = False
    ) -> "Chosen":
        """Return the choice with the case `begun`, whose clock begins `shift` seconds later.

        It takes the place of the `earlier` case, or stands behind it if that is kept. The scenario
        has its season.
        """
        name, label, data = earlier.name, begun.name, self.data
        fetched, keys, cases = data.fetched, dict[str, str](), list[Case]()
        key = artefact_key("departures", data.current_keys[name], begun.departure)
        for case in self.cases.value:
            is_it = case.name == name
            if keeps or not is_it:
                keys[case.name] = data.current_keys[case.name]
                cases.append(case)
            if is_it:
                keys[label] = key
                cases.append(begun)
        grids = []
        for grid in fetched.currents:
            is_it = grid.season == name
            if keeps or not is_it:
                grids.append(grid)
            if is_it:
                grids.append(replace(grid, season=label, times_s=grid.times_s - shift))
        notes = fetched.notes
        if not keeps:
            notes = tuple(
                one.about(*(label if of == name else of for of in one.seasons)) for one in notes
            )
        return replace(
            self,
            scenario=scenario,
            data=replace(
                data,
                fetched=replace(fetched, currents=tuple(grids), notes=notes),
                current_keys=keys,
            ),
            cases=Artefact(
                artefact_key("departures", self.cases.key, name, label, begun.departure),
                tuple(cases),
            ),
        )


def in_thread(work: Callable[[], _T]) -> _T:
    """Call `work` in a thread: a signal handler must not raise inside compiled code."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(work).result()
