"""How commands print: lines that fit the terminal, lines of JSON without credentials, and bars."""

import contextlib
import re
import shutil
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TextIO

import typer

from pipeline.sources.copernicus.client import without_secrets
from pipeline.texts import with_texts

if TYPE_CHECKING:
    from rich.progress import Progress

# Least width to which text is wrapped, in characters.
_MIN_WIDTH = 40
# Least width of a table's wrapped column, in characters.
_MIN_COLUMN = 16
# The beginning of an entry of a list, whose further lines are indented.
_ENTRY = re.compile(r"- |! |  |error: |note: ")
# The space between a figure and its unit, where no line is broken.
_BEFORE_UNIT = re.compile(r"(?<=\d) (?=\S)")
# Time between two lines that say that a command is still at work, s.
_PAUSE_S = 30.0


def say(text: str, *, err: bool = False) -> None:
    """Print a text, wrapped if it goes to a terminal."""
    typer.echo(wrapped(text, terminal_width(err=err)), err=err)


def terminal_width(*, err: bool = False) -> int | None:
    """Return the width of the terminal, in characters; None for a file or a pipe."""
    stream = sys.stderr if err else sys.stdout
    return max(_MIN_WIDTH, shutil.get_terminal_size().columns) if stream.isatty() else None


def wrapped(text: str, width: int | None) -> str:
    """Break lines between words where they are longer than `width`; None keeps them."""
    if width is None:
        return text
    return "\n".join(
        textwrap.fill(
            _BEFORE_UNIT.sub("\N{NO-BREAK SPACE}", line),
            width,
            subsequent_indent="  " if _ENTRY.match(line) else "",
            break_long_words=False,
            break_on_hyphens=False,
        ).replace("\N{NO-BREAK SPACE}", " ")
        if len(line) > width
        else line
        for line in text.split("\n")
    )


def table(rows: Sequence[Sequence[str]], left: int, width: int | None) -> list[str]:
    """Return the lines of a table whose first `left` columns are aligned on their left.

    If it is wider than `width`, the last of these columns is wrapped.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    excess = 0 if width is None else sum(widths) + 2 * (len(widths) - 1) - width
    if excess > 0:
        widths[left - 1] = max(min(widths[left - 1], _MIN_COLUMN), widths[left - 1] - excess)
    lines = []
    for row in rows:
        parts = [row[left - 1]]
        if len(parts[0]) > widths[left - 1]:
            parts = textwrap.wrap(parts[0], widths[left - 1], break_on_hyphens=False)
        for part in parts:
            cells = [cell if part is parts[0] else "" for cell in row]
            cells[left - 1] = part
            lines.append(
                "  ".join(
                    cell.ljust(size) if i < left else cell.rjust(size)
                    for i, (cell, size) in enumerate(zip(cells, widths, strict=True))
                ).rstrip()
            )
    return lines


def json_lines(stream: TextIO) -> Any:  # noqa: ANN401 - a structlog logger, typed as it is bound
    """Return a logger that writes each event to a stream as a line of JSON."""
    import structlog

    return structlog.wrap_logger(
        structlog.WriteLogger(stream),
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            # A message may quote an address or a reply.
            lambda _logger, _method, said: {
                name: with_texts(one, without_secrets) for name, one in said.items()
            },
            structlog.processors.JSONRenderer(ensure_ascii=False),
        ],
    )


def log_event(log: Any, status: str, fields: dict[str, object]) -> None:  # noqa: ANN401 - of `json_lines`
    """Write an event of a run or a night as an error, a warning or information."""
    level = {"failed": log.error, "note": log.warning}.get(status, log.info)
    level(status, **fields)


def progress_bar(title: str) -> "Progress":
    """Return a bar with a title, the number of steps and the time, shown on a terminal only."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn(title.replace("{", "{{").replace("}", "}}"), style="bold", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.description}", markup=False),
        TimeElapsedColumn(),
    )
    return Progress(
        *columns, console=Console(file=sys.stderr), transient=True, disable=not sys.stderr.isatty()
    )


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
