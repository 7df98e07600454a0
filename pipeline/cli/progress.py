"""Tells how a run goes: a bar on a terminal, one JSON object a line elsewhere."""

from __future__ import annotations

import contextlib
import sys
from typing import TYPE_CHECKING

from pipeline.run import STAGES, Event

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import TextIO

    from pipeline.run import Listener

_WORDS = {
    "fetch": "Fetching land and currents",
    "simplify": "Simplifying the coast",
    "project": "Projecting",
    "plan": "Planning and proving",
    "write": "Writing",
}


@contextlib.contextmanager
def listening(scenario: str, seasons: int) -> Iterator[Listener]:
    """Give the listener that suits standard error."""
    stream = sys.stderr
    if stream.isatty():
        with _bar(scenario, seasons, stream) as listener:
            yield listener
    else:
        yield _lines(scenario, stream)


@contextlib.contextmanager
def _bar(scenario: str, seasons: int, stream: TextIO) -> Iterator[Listener]:
    """Show a bar: a step for each stage, and one for each season."""
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
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("Starting", total=len(STAGES) + seasons, scenario=scenario)

        def listen(event: Event) -> None:
            if event.status == "begun":
                progress.update(task, description=_WORDS[event.stage])
            elif event.status == "note":
                console.print(f"note: {event.detail}", markup=False, highlight=False)
            else:
                progress.advance(task)

        yield listen


def _lines(scenario: str, stream: TextIO) -> Listener:
    """Write each event as a line of JSON."""
    import structlog

    log = structlog.wrap_logger(
        structlog.WriteLogger(stream),
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.JSONRenderer(ensure_ascii=False),
        ],
    ).bind(scenario=scenario)

    def listen(event: Event) -> None:
        fields: dict[str, object] = {"stage": event.stage}
        if event.season:
            fields["season"] = event.season
        if event.detail:
            fields["detail"] = event.detail
        if event.status == "done" and event.seconds:
            fields["seconds"] = round(event.seconds, 3)
        level = {"failed": log.error, "note": log.warning}.get(event.status, log.info)
        level(event.status, **fields)

    return listen
