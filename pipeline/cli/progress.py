"""Report the progress of a run: a bar on a terminal, one JSON object per line elsewhere."""

from __future__ import annotations

import contextlib
import sys
from typing import TYPE_CHECKING

from pipeline.run import STAGES, Event

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import TextIO

    from pipeline.run import EventHandler

_DESCRIPTIONS = {
    "fetch": "Fetching land and currents",
    "simplify": "Simplifying the coast",
    "project": "Projecting",
    "plan": "Planning and verifying",
    "write": "Writing",
}


@contextlib.contextmanager
def progress(scenario: str, seasons: int) -> Iterator[EventHandler]:
    """Provide the event handler that suits standard error."""
    stream = sys.stderr
    if stream.isatty():
        with _bar(scenario, seasons, stream) as on_event:
            yield on_event
    else:
        yield _lines(scenario, stream)


@contextlib.contextmanager
def _bar(scenario: str, seasons: int, stream: TextIO) -> Iterator[EventHandler]:
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
        task = bar.add_task("Starting", total=len(STAGES) + seasons, scenario=scenario)

        def on_event(event: Event) -> None:
            if event.status == "begun":
                bar.update(task, description=_DESCRIPTIONS[event.stage])
            elif event.status == "note":
                console.print(f"note: {event.detail}", markup=False, highlight=False)
            else:
                bar.advance(task)

        yield on_event


def _lines(scenario: str, stream: TextIO) -> EventHandler:
    """Return a handler that writes each event as a line of JSON."""
    import structlog

    log = structlog.wrap_logger(
        structlog.WriteLogger(stream),
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.JSONRenderer(ensure_ascii=False),
        ],
    ).bind(scenario=scenario)

    def on_event(event: Event) -> None:
        fields: dict[str, object] = {"stage": event.stage}
        if event.season:
            fields["season"] = event.season
        if event.detail:
            fields["detail"] = event.detail
        if event.status == "done" and event.seconds:
            fields["seconds"] = round(event.seconds, 3)
        level = {"failed": log.error, "note": log.warning}.get(event.status, log.info)
        level(event.status, **fields)

    return on_event
