"""Report the progress of a run: a bar on a terminal, one JSON object per line elsewhere."""

import contextlib
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from typing import TextIO

from pipeline.formats.shared.note_words import note_json
from pipeline.formats.shared.writing import json_value
from pipeline.running.outcome import STAGES, Event, EventHandler, ignore
from pipeline.scenario.model import Scenario

_DESCRIPTIONS = {
    "fetch": "Fetching land and currents",
    "simplify": "Simplifying the coast",
    "project": "Projecting",
    "choose": "Choosing",
    "plan": "Planning and verifying",
    "compare": "Comparing the ways round",
    "write": "Writing",
}


# Time between two lines that report that the run is still working, s.
_HEARTBEAT_S = 30.0


@contextlib.contextmanager
def progress(
    scenario: Scenario, notes: Sequence[str] = (), *, quiet: bool = False
) -> Iterator[EventHandler]:
    """Report notes on the scenario to standard error, then yield the handler of events.

    If quiet, nothing is reported here; errors are reported at the end of the run.
    """
    if quiet:
        yield ignore
        return
    seasons = [season.name for season in scenario.seasons]
    provider = _bar if sys.stderr.isatty() else _lines
    with provider(scenario.name, seasons, sys.stderr) as on_event:
        for note in (*notes, *_machine_notes()):
            on_event(Event("fetch", "note", detail=note))
        yield on_event


def _machine_notes() -> Iterator[str]:
    """Yield notes for the user on this machine."""
    from renew._compiled import cache_is_temporary

    if cache_is_temporary():
        yield (
            "machine code is cached in a temporary folder, and compiled again after a reboot: "
            "make ~/.cache writable, or set NUMBA_CACHE_DIR"
        )


@contextlib.contextmanager
def _bar(scenario: str, seasons: Sequence[str], stream: TextIO) -> Iterator[EventHandler]:
    """Show a bar with a step for each stage and each season."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(file=stream)
    columns = (
        TextColumn("{task.fields[scenario]}", style="bold", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.description}", markup=False),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("Starting", total=len(STAGES) + len(seasons), scenario=scenario)

        def on_event(event: Event) -> None:
            if event.status == "begun":
                if event.stage == STAGES[0]:
                    bar.reset(task)  # the stages start again when the region is widened
                bar.update(task, description=_DESCRIPTIONS[event.stage])
            elif event.status == "part":
                bar.update(task, description=f"{_DESCRIPTIONS[event.stage]} {event.detail}")
            elif event.status == "note":
                console.print(f"note: {event.detail}", markup=False, highlight=False)
            else:
                bar.advance(task)

        yield on_event


@contextlib.contextmanager
def _lines(scenario: str, seasons: Sequence[str], stream: TextIO) -> Iterator[EventHandler]:
    """Write a line of JSON for each event, and one every _HEARTBEAT_S while the run works."""
    from pipeline.cli.json_lines import json_lines

    log = json_lines(stream).bind(scenario=scenario)
    state = _State(seasons)

    def on_event(event: Event) -> None:
        state.update(event)
        fields: dict[str, object] = {"stage": event.stage}
        if event.season:
            fields["season"] = event.season
        if event.detail:
            fields["detail"] = event.detail
        if event.note:
            fields["note"] = json_value(note_json(event.note))
        if event.status == "done" and event.seconds:
            fields["seconds"] = round(event.seconds, 3)
        level = {"failed": log.error, "note": log.warning}.get(event.status, log.info)
        level(event.status, **fields)

    ended = threading.Event()

    def beat() -> None:
        while not ended.wait(_HEARTBEAT_S):
            log.info("working", **state.fields())

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield on_event
    finally:
        ended.set()
        thread.join()


class _State:
    """The current stage, its start time, and the seasons that it has not finished yet."""

    def __init__(self, seasons: Sequence[str]) -> None:
        self._all = tuple(seasons)
        self._stage, self._begun = "", time.monotonic()
        self._waiting = self._all

    def update(self, event: Event) -> None:
        """Update the state with an event."""
        if event.status == "begun":
            self._stage, self._begun, self._waiting = event.stage, time.monotonic(), self._all
        elif event.season:
            self._waiting = tuple(name for name in self._waiting if name != event.season)

    def fields(self) -> dict[str, object]:
        """Return the state as the fields of a line of JSON."""
        return {
            "status": "working",
            "stage": self._stage,
            "seasons": self._waiting,
            "seconds": round(time.monotonic() - self._begun, 1),
        }
