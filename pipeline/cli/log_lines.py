"""Lines and bars on standard error that show what a command does; they hide credentials."""

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator, MutableMapping
from typing import TYPE_CHECKING, Any, TextIO

from pipeline.sources.copernicus.client import without_secrets

if TYPE_CHECKING:
    from rich.progress import Progress

# Time between two lines, s.
_PAUSE_S = 30.0


def json_lines(stream: TextIO) -> Any:  # noqa: ANN401 - a structlog logger, typed as it is bound
    """Return a logger that writes each event to a stream as a line of JSON."""
    import structlog

    return structlog.wrap_logger(
        structlog.WriteLogger(stream),
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            _hide_secrets,
            structlog.processors.JSONRenderer(ensure_ascii=False),
        ],
    )


def _hide_secrets(
    logger: object, method: str, fields: MutableMapping[str, Any]
) -> MutableMapping[str, Any]:
    """Hide credentials in all texts of an event; a message may quote an address or a reply."""
    del logger, method
    return {name: _hidden(value) for name, value in fields.items()}


def _hidden(value: object) -> object:
    """Return the value with credentials hidden in its texts."""
    if isinstance(value, str):
        return without_secrets(value)
    if isinstance(value, dict):
        return {name: _hidden(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_hidden(one) for one in value]
    return value


def log_event(log: Any, status: str, fields: dict[str, object]) -> None:  # noqa: ANN401 - of `json_lines`
    """Write an event of a run or a night as an error, a warning or information."""
    level = {"failed": log.error, "note": log.warning}.get(status, log.info)
    level(status, **fields)


def progress_bar(title: str) -> "Progress":
    """Return a bar on standard error with a title, the number of steps, and the time."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn(title.replace("{", "{{").replace("}", "}}"), style="bold", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.description}", markup=False),
        TimeElapsedColumn(),
    )
    return Progress(*columns, console=Console(file=sys.stderr), transient=True)


@contextlib.contextmanager
def every(seconds: float, say: Callable[[], None]) -> Iterator[None]:
    """Call a function regularly, in a separate thread, inside the `with` block."""
    ended = threading.Event()

    def beat() -> None:
        while not ended.wait(seconds):
            say()

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@contextlib.contextmanager
def still_at_work() -> Iterator[None]:
    """Write a line on standard error every _PAUSE_S inside the `with` block."""
    begun = time.monotonic()

    def say() -> None:
        seconds = time.monotonic() - begun
        print(f"still at work, after {seconds:.0f} s", file=sys.stderr, flush=True)  # noqa: T201 - to the user

    with every(_PAUSE_S, say):
        yield
