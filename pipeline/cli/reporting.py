"""What a run prints: its progress, and at its end a table or JSON.

Progress is a bar on a terminal, lines of text elsewhere, or lines of JSON.
"""

import contextlib
import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from typing import NoReturn

import typer

from pipeline.cli.terminal import (
    every,
    json_lines,
    log_event,
    progress_bar,
    say,
    table,
    terminal_width,
)
from pipeline.findings import text
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
    """Show a bar with a step for each stage and each case."""
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


_HEAD = "season,rank,way,length {unit},duration,clearance,fuel,F/D,gap,turns"
# Number of the first columns that are left-aligned.
_LEFT_ALIGNED = 3
# If the longest route is shorter than this, lengths are in metres, not kilometres.
_SHORT_M = 10_000.0


def run_to_end(
    run: Callable[..., Outcome],
    scenario: Scenario,
    notes: Sequence[str],
    *,
    as_json: bool,
    quiet: bool,
) -> NoReturn:
    """Run a scenario and show its progress; print the outcome, and exit with its code.

    The outcome is a table or JSON; if `quiet`, only the failures are printed.
    """
    with progress(scenario, notes, quiet=quiet, as_json=as_json) as on_event:
        outcome = run(on_event=on_event)
    if as_json:
        typer.echo(outcome_json(outcome))
    elif not quiet:
        say(season_table(outcome, terminal_width()))
        verb = "Written to" if outcome.fresh else "Unchanged in"
        typer.echo(f"\n{verb} {short_path(outcome.directory)} ({outcome.seconds:.1f} s)")
    for failure in outcome.failures:
        say(f"error: {failure}", err=True)
    raise typer.Exit(outcome.exit_code)


def season_table(outcome: Outcome, width: int | None = None) -> str:
    """Return the run's table: for each case the best route on each side of the main island.

    Times of departure and routes over land of another chart stand above it; decisions and what is
    not known, below. Ways are wrapped where the table is wider than `width`, in characters.
    """
    lengths = [ranked.metrics.length_m for ranked in outcome.result.routes]
    unit = "m" if max(lengths, default=0.0) < _SHORT_M else "km"
    head = tuple(_HEAD.format(unit=unit).split(","))
    rows: list[tuple[str, ...]] = [head]
    passed: set[str] = set()
    for case in outcome.result.cases:
        if case.plan is None:
            blank = ("",) * (len(head) - _LEFT_ALIGNED)
            rows.append((text.season_name(case.name), "-", "not planned", *blank))
            continue
        seen: set[str] = set()
        for ranked in case.routes:
            row = ranked.metrics
            if row.main_passage not in seen:
                seen.add(row.main_passage)
                passed.update(name for passage in row.passages for name in passage.islands)
                rows.append(_row(ranked, 1.0 if unit == "m" else 1000.0))
    result = outcome.result
    crossed = [note for note in result.unknowns if note.kind == "second-shoreline"]
    apart = {*crossed, *result.narrow_notes}
    unknown = [note for note in result.unknowns if note not in apart]
    lines = list(_passages(outcome))
    lines += [f"OVER LAND of another chart: {line}\n" for line in note_texts(crossed)]
    lines += [f"NARROW: {line}\n" for line in note_texts(result.narrow_notes)]
    lines += table(rows, _LEFT_ALIGNED, width)
    lines += ["", *_unused_currents(outcome), *_unknown_currents(outcome)]
    for title, notes in (
        ("Decided:", dict.fromkeys((*result.decisions, *result.choices))),
        ("Not known:", unknown),
    ):
        lines += [title, *(f"- {line}" for line in note_texts(notes))] * bool(notes)
    if places := [
        f"{'island ' * (not island.name)}{island.label} at {island.place}"
        for island in result.islands
        if island.label in passed
    ]:
        lines.append(f"\nPassed: {'; '.join(places)}.")
    no_go = outcome.fetched.land.no_go_name
    lines += [
        f"\n{text.season_name(case.name)}: {text.gap_text(case.measures.gap_shares, no_go)}"
        for case in result.cases
        if case.measures.gap_shares is not None
    ]
    rejected = sum(len(case.plan.rejected) for case in result.cases if case.plan is not None)
    routes = text.count(len(result.routes), "route", "routes")
    classes = text.count(rejected, "rejected class", "rejected classes")
    reasons = f"; {classes}, with reasons" if rejected else ""
    sides = "The best route on each side of the main island. " if passed else ""
    lines.append(f"\n{sides}In report.html: {routes}{reasons}.")
    return "\n".join(lines)


def _passages(outcome: Outcome) -> Iterator[str]:
    """Yield a line for each case with a departure: when its best route leaves and arrives."""
    for ranked in outcome.result.routes:
        name = ranked.case.name
        passage = outcome.scenario.passage(name, round(ranked.metrics.duration_s))
        if ranked.rank == 1 and passage is not None:
            about = f"{name}: " if len(outcome.scenario.seasons) > 1 else ""
            leave, arrive = text.exact_moment_text(passage[0]), text.moment_text(passage[1])
            yield f"{about}Leave at {leave}, arrive at {arrive}.\n"


def _unused_currents(outcome: Outcome) -> Iterator[str]:
    """Yield one line on preferred currents that were not used, if there are any."""
    unused: dict[str, list[str]] = {}
    for grid in outcome.fetched.currents:
        for _, reason in grid.passed_over:
            unused.setdefault(reason, []).append(text.season_name(grid.case))
    if unused:
        reasons = (f"{', '.join(names)}: {reason}" for reason, names in unused.items())
        yield f"Currents NOT used: {'; '.join(reasons)}"


def _unknown_currents(outcome: Outcome) -> Iterator[str]:
    """Yield one line on the cases whose current is not known, if there are any."""
    lacking = [case.name for case in outcome.result.cases if case.lacks_current]
    if lacking:
        several = len(outcome.fetched.currents) > 1
        names = ", ".join(map(text.season_name, lacking)) if several else ""
        about = f": {names}" if names else ""
        yield f"Current NOT known{about}; nothing is proven for the real one"


def _row(ranked: RankedRoute, unit_m: float) -> tuple[str, ...]:
    """Return one route's cells; the last is "collisions/all" of the simulated hard-over turns.

    The case's best route has its fuel, each other route the percentage that it needs more.
    """
    row, case = ranked.metrics, ranked.case
    more = row.fuel / case.routes[0].metrics.fuel - 1
    kept = text.clearance(row.clearance_m) if row.has_land else "-"
    return (
        text.season_name(case.name),
        str(row.rank),
        row.way or "-",
        f"{row.length_m / unit_m:.1f}",
        text.days(row.duration_s) or text.hours(row.duration_s),
        kept,
        # Without the vessel's power it is a share of the fuel in still water.
        text.fuel(row.fuel, row).partition(" of ")[0] if row.rank == 1 else f"{100 * more:+.1f} %",
        f"{row.fuel_per_distance:.3f}",
        case.gap_figure(row) if math.isfinite(row.optimality_gap) else "-",
        f"{row.collisions}/{row.trials:,}" if row.has_land else "-",
    )


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
        "clock_worth": [
            {
                "season": case.name,
                "best_fuel": worth.best,
                "departure_plan_fuel": worth.frozen,
                "mean_plan_fuel": worth.mean,
                "shortest_path_fuel": worth.shortest,
                "fuel_bound": worth.bound,
            }
            for case in outcome.result.cases
            if (worth := case.measures.clock_worth) is not None
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
    of_best = (".rtz", ".gpx", *of_all, ".kml", ".plan", ".waypoints")
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
