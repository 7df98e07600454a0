"""What a run prints: its progress, and at its end a table or JSON.

Progress is a bar on a terminal, lines of text elsewhere, or lines of JSON.
"""

import contextlib
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from typing import NoReturn

import typer

from pipeline.cli import terminal
from pipeline.cli.answer import answer
from pipeline.findings.names import figures
from pipeline.findings.note_words import caveats_json, note_json, note_texts, rejections
from pipeline.findings.result import RankedRoute
from pipeline.findings.text import json_value, season_text
from pipeline.machine.paths import short_path
from pipeline.run import STAGES, Event, EventHandler, Outcome, ignore
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
    scenario: Scenario,
    notes: Sequence[str] = (),
    *,
    quiet: bool = False,
    as_json: bool = False,
    verbose: bool = False,
) -> Iterator[EventHandler]:
    """Report notes on the scenario to standard error, then yield the handler of events.

    With `as_json` each event is a line of JSON. With `quiet` nothing is reported here; errors are
    reported at the end of the run. The stages' notes are reported with `verbose`, or as JSON: at
    the end the answer has those that matter.
    """
    if quiet:
        yield ignore
        return
    provider = _json_lines if as_json else _bar if sys.stderr.isatty() else _text_lines
    with provider(scenario) as on_event:
        for note in (*notes, *_machine_notes()):
            on_event(Event("fetch", "note", detail=note))
        yield on_event if verbose or as_json else partial(_but_notes, on_event)


def _but_notes(on_event: EventHandler, event: Event) -> None:
    """Pass an event on, unless it is a note of a stage."""
    if event.note is None:
        on_event(event)


def _machine_notes() -> Iterator[str]:
    from renew._compiled import cache_is_temporary

    if cache_is_temporary():
        yield (
            "machine code is cached in a temporary folder, and compiled again after a reboot: "
            "make ~/.cache writable, or set NUMBA_CACHE_DIR"
        )


@contextlib.contextmanager
def _bar(scenario: Scenario) -> Iterator[EventHandler]:
    """Show a bar with a step for each stage and each case."""
    steps = len(STAGES) - (scenario.havens is None) + len(scenario.seasons)
    with terminal.progress_bar(scenario.name) as bar:
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
    log = terminal.json_lines(sys.stderr).bind(scenario=scenario.name)
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
        terminal.log_event(
            log, event.status, {name: value for name, value in fields.items() if value}
        )

    with terminal.every(_HEARTBEAT_S, lambda: log.info("working", **state.fields())):
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

    with terminal.every(_HEARTBEAT_S, lambda: say(state.text)):
        yield on_event


class _State:
    """The current stage, its start time, and the cases that it has not finished yet."""

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


def run_to_end(
    run: Callable[..., Outcome],
    scenario: Scenario,
    notes: Sequence[str],
    *,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> NoReturn:
    """Run a scenario and show its progress; print the outcome, and exit with its code.

    The outcome is text, with more details if `verbose`, or JSON; if `quiet`, only the failures are
    printed.
    """
    with progress(scenario, notes, quiet=quiet, as_json=as_json, verbose=verbose) as on_event:
        outcome = run(on_event=on_event)
    if as_json:
        typer.echo(outcome_json(outcome))
    elif not quiet:
        typer.echo(answer(outcome, terminal.terminal_width(), verbose=verbose))
        verb = "Written to" if outcome.fresh else "Unchanged in"
        typer.echo(f"\n{verb} {short_path(outcome.directory)} ({outcome.seconds:.1f} s)")
    for failure in outcome.failures:
        terminal.say(f"error: {failure}", err=True)
    raise typer.Exit(outcome.exit_code)


def outcome_json(outcome: Outcome) -> str:
    """Return an outcome as JSON on one line; numbers that are not finite are null.

    Lengths are in true metres, durations in seconds. `files` of the best route are all files of its
    case. `files` of another route are those with all routes of the case: a GPX and a GeoJSON.
    """
    files = sorted(path.name for path in outcome.directory.iterdir() if path.is_file())
    fields = {
        "scenario": outcome.scenario.name,
        "directory": str(outcome.directory),
        "files": files,
        "routes": [_route(ranked, files) for ranked in outcome.result.routes],
        "rejected": [
            {"season": case.name, **rejection}
            for case in outcome.result.cases
            for rejection in rejections(case)
        ],
        "replanned": [
            {"season": result.name, **asdict(result.replanned)}
            for result in outcome.result.results
            if result.replanned is not None
        ],
        **caveats_json(outcome.result),
        "notes": note_texts(outcome.fetched.notes),
        "note_values": [note_json(note) for note in outcome.fetched.notes],
        "failures": list(outcome.failures),
    }
    return json.dumps(json_value(fields), ensure_ascii=False, allow_nan=False)


def _route(ranked: RankedRoute, files: list[str]) -> dict[str, object]:
    """Return one route's values and the files that contain it."""
    row, case, stem = ranked.metrics, ranked.case, ranked.case.stem
    passage = case.scenario.passage(case.name, round(row.duration_s))
    of_all = ("-all.gpx", ".geojson")
    of_best = (".rtz", ".gpx", *of_all, ".plan", ".waypoints")
    return {
        "season": case.name,
        **figures(row, "json"),
        "departure": passage and passage[0],
        "arrival": passage and passage[1],
        "files": [
            name
            for name in (f"{stem}{end}" for end in (of_best if row.rank == 1 else of_all))
            if name in files
        ],
    }
