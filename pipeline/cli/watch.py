"""The command `renew watch`: whether a vessel is on its plan, from its positions."""

import io
import json
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli import options
from pipeline.cli.failures import exit_code, reported_errors
from pipeline.cli.terminal import say
from pipeline.errors import Faults, RequestError
from pipeline.machine.paths import shown

if TYPE_CHECKING:
    from pipeline.underway.watch import Watch

# Bytes read at a time, and time between two looks at a file that may grow, s.
_CHUNK, _PAUSE_S = 65_536, 0.5
_STDIN = "-"


def watch(
    results: options.Results,
    *,
    positions: Annotated[
        str,
        typer.Option(
            metavar="FILE",
            help="A file of NMEA 0183 (RMC) or JSON lines, which is followed as it grows; "
            "'-' is standard input.",
        ),
    ],
    once: Annotated[
        bool, typer.Option("--once", help="Read the file to its end only, and stop.")
    ] = False,
    season: options.OneSeason = "",
    departed: options.Departed = "",
    every: Annotated[
        str, typer.Option(help="Time after which the state is said again: 10min, 1h.")
    ] = "10min",
) -> None:
    """Read a vessel's positions, and print one JSON event a line: on plan, off plan, late, replan.

    It never commands a vessel, and opens no connection.
    """
    with reported_errors():
        watching = _watch(results, season, departed, every)
        from pipeline.underway.watch import summary

        code = 0
        try:
            for line in _lines(_chunks(positions, once=once)):
                _take(watching, line)
        except KeyboardInterrupt as error:
            code = exit_code(error)
        say(summary(watching.counts), err=True)
        raise typer.Exit(code)


def _watch(results: Path, season: str, departed: str, every: str) -> "Watch":
    """Return the watch that is asked for; all faults of the options are named at once."""
    from pipeline.scenario.times import interval
    from pipeline.stages.finished import finished_season
    from pipeline.underway.watch import watch_of
    from pipeline.voyage.times import zoned_time

    def every_s() -> float:
        try:
            return interval(every).total_seconds()
        except ValueError as error:
            raise RequestError(f"--every {error}") from None

    faults = Faults()
    late: list[str] = []
    left = zoned_time("--departed", departed, late)
    faults.lines += late
    seconds = faults.collect(every_s)
    finished = faults.collect(lambda: finished_season(results, season))
    if faults.lines or seconds is None or finished is None:
        raise RequestError(faults.lines)
    watching = watch_of(finished, left, seconds)
    if watching.departure is None:
        say("note: the plan has no departure: lateness is not watched; give --departed", err=True)
    return watching


def _take(watching: "Watch", line: bytes) -> None:
    """Print the events of a line, and say of the 1st, 10th, 100th ... broken one what it lacks."""
    from pipeline.underway.reports import Unread, reports

    for report in reports(line):
        for event in watching.take(report):
            typer.echo(json.dumps(event, ensure_ascii=False))
        broken = watching.counts["broken"]
        if isinstance(report, Unread) and report.kind == "broken" and _is_power_of_ten(broken):
            say(f"note: broken lines so far: {broken:,}; the last is {report.reason}", err=True)


def _is_power_of_ten(count: int) -> bool:
    """Whether a count is 1, 10, 100 ..."""
    return str(count).strip("0") == "1"


def _lines(chunks: Iterator[bytes]) -> Iterator[bytes]:
    """Cut a stream into lines."""
    from pipeline.underway.reports import LineCutter

    cutter = LineCutter()
    for chunk in chunks:
        yield from cutter.lines(chunk)
    yield from cutter.last()


def _chunks(positions: str, *, once: bool) -> Iterator[bytes]:
    """Yield what arrives on standard input or in a file."""
    if positions == _STDIN:
        with open(0, "rb", buffering=0, closefd=False) as stream:
            yield from iter(lambda: stream.read(_CHUNK), b"")
        return
    while True:
        with _opened(positions) as stream:
            yield from _of_file(stream, lambda: once or _is_replaced(stream, positions))
        if once:
            return


def _of_file(stream: io.FileIO, ends: Callable[[], bool]) -> Iterator[bytes]:
    """Yield what is in a file and what is added to it, until there is no more and it ends."""
    while True:
        if chunk := stream.read(_CHUNK):
            yield chunk
        elif ends():
            return
        else:
            time.sleep(_PAUSE_S)


def _opened(positions: str) -> io.FileIO:
    """Open the file of positions; RequestError if that is impossible."""
    try:
        return Path(positions).open("rb", buffering=0)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise RequestError(
            f"--positions: {shown(positions)} can't be read ({reason}); give a file of NMEA 0183 "
            "or JSON lines, or '-'"
        ) from None


def _is_replaced(stream: io.FileIO, positions: str) -> bool:
    """Whether another file is at the path now, or the file was cut short, as logs are rotated."""
    try:
        there = Path(positions).stat()
    except OSError:
        return False  # about to be replaced
    here = os.fstat(stream.fileno())
    return not os.path.samestat(there, here) or there.st_size < stream.tell()
