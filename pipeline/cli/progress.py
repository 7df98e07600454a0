"""Report the progress of a run: a bar on a terminal, lines of text elsewhere, or lines of JSON."""

import contextlib
import sys
import time
from collections.abc import Iterator, Sequence

from pipeline.cli.log_lines import every, json_lines, log_event, progress_bar
from pipeline.findings.note_words import note_json
from pipeline.findings.text import json_value, season_text
from pipeline.run import STAGES, Event, EventHandler, ignore
from pipeline.scenario.model import Scenario
from pipeline.sources.copernicus.client import without_secrets

_DESCRIPTIONS = {
    "fetch": "Fetching land and currents",
    "simplify": "Simplifying the coast",
    "project": "Projecting",
    "choose": "Choosing",
    "plan": "Planning and verifying",
    "compare": "Comparing the ways round",
    "cover": "Looking for ways to havens",
    "write": "Writing",
}


# Time between two lines that report that the run is still working, s.
_HEARTBEAT_S = 30.0


@contextlib.contextmanager
def progress(
    scenario: Scenario, notes: Sequence[str] = (), *, quiet: bool = False, as_json: bool = False
) -> Iterator[EventHandler]:
    """Report notes on the scenario to standard error, then yield the handler of events.

    With `as_json` each event is a line of JSON. With `quiet` nothing is reported here; errors are
    reported at the end of the run.
    """
    if quiet:
        yield ignore
        return
    provider = _json_lines if as_json else _bar if sys.stderr.isatty() else _text_lines
    with provider(scenario) as on_event:
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
def _bar(scenario: Scenario) -> Iterator[EventHandler]:
    """Show a bar with a step for each stage and each season."""
    steps = len(STAGES) - (scenario.havens is None) + len(scenario.seasons)
    with progress_bar(scenario.name) as bar:
        task = bar.add_task("Starting", total=steps)

        def on_event(event: Event) -> None:
            if event.status == "begun":
                if event.stage == STAGES[0]:
                    bar.reset(task)  # the stages start again when the region is widened
                bar.update(task, description=_DESCRIPTIONS[event.stage])
            elif event.status == "part":
                bar.update(task, description=f"{_DESCRIPTIONS[event.stage]} {event.detail}")
            elif event.status == "note":
                bar.console.print(f"note: {event.detail}", markup=False, highlight=False)
            else:
                bar.advance(task)

        yield on_event


@contextlib.contextmanager
def _json_lines(scenario: Scenario) -> Iterator[EventHandler]:
    """Write a line of JSON for each event, and one every _HEARTBEAT_S while the run works."""
    log = json_lines(sys.stderr).bind(scenario=scenario.name)
    state = _State(scenario)

    def on_event(event: Event) -> None:
        state.update(event)
        seconds = event.seconds if event.status == "done" else 0.0
        fields = {
            "stage": event.stage,
            "season": event.season,
            "detail": event.detail,
            "note": event.note and json_value(note_json(event.note)),
            "seconds": round(seconds, 3) if seconds else None,
        }
        log_event(log, event.status, {name: value for name, value in fields.items() if value})

    with every(_HEARTBEAT_S, lambda: log.info("working", **state.fields())):
        yield on_event


@contextlib.contextmanager
def _text_lines(scenario: Scenario) -> Iterator[EventHandler]:
    """Write a line for each stage and note, and one every _HEARTBEAT_S while the run works."""
    state = _State(scenario)

    def say(text: str) -> None:
        print(without_secrets(f"{scenario.name}: {text}"), file=sys.stderr, flush=True)  # noqa: T201 - to the user

    def on_event(event: Event) -> None:
        state.update(event)
        stage = _DESCRIPTIONS[event.stage]
        about = f", {season_text(event.season)}" if event.season else ""
        if event.status == "begun":
            say(stage)
        elif event.status == "note":
            say(f"note: {event.detail}")
        elif event.status == "failed":
            say(f"{stage}{about}: failed: {event.detail}")
        elif event.status == "done" and event.season:
            say(f"{stage}{about}: done")

    with every(_HEARTBEAT_S, lambda: say(state.text)):
        yield on_event


class _State:
    """The current stage, its start time, and the seasons that it has not finished yet."""

    def __init__(self, scenario: Scenario) -> None:
        self._all = tuple(season.name for season in scenario.seasons)
        self._stage, self._begun = "", time.monotonic()
        self._waiting = self._all

    def update(self, event: Event) -> None:
        """Update the state with an event."""
        if event.status == "begun":
            self._stage, self._begun, self._waiting = event.stage, time.monotonic(), self._all
        elif event.season:
            self._waiting = tuple(name for name in self._waiting if name != event.season)

    @property
    def text(self) -> str:
        """The state as text."""
        seconds = time.monotonic() - self._begun
        return f"{_DESCRIPTIONS.get(self._stage, 'Starting')}: at work for {seconds:.0f} s"

    def fields(self) -> dict[str, object]:
        """Return the state as the fields of a line of JSON."""
        return {
            "status": "working",
            "stage": self._stage,
            "seasons": self._waiting,
            "seconds": round(time.monotonic() - self._begun, 1),
        }
