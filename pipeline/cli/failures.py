"""Report errors as lines with an exit code, and end within seconds at Ctrl-C or SIGTERM."""

import _thread
import contextlib
import json
import os
import re
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType

import typer

from pipeline.cli.terminal import say
from pipeline.errors import MachineError, PipelineError, RequestError
from pipeline.texts import clean

MESSAGE = "stopped; finished stages are kept, run again to continue"
# Time for the main thread to clean up, s. Then the process ends, the system releases its locks, and
# the seasons' processes end, too.
_GRACE_S = 3.0
# Time between two attempts to interrupt the main thread, s.
_PAUSE_S = 0.05
# Time limit for the calls of `reporting_end`, s: a monitoring service may take ten to answer.
_END_REPORT_S = 20.0
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_SHOW_CURSOR = "\x1b[?25h"

_end_reports: list[Callable[[int], None]] = []
_UNEXPECTED = 3
# Number of the last frames of a traceback that are reported.
_FRAMES = 6
# Maximum length of an error's text, in characters.
_MAX_MESSAGE = 500
# Patterns of errors of Python and libraries that are the machine's fault, and their remedies.
_MACHINE = {
    r"MemoryError|bad_alloc|allocate memory|new thread|failed to map": "the memory ran out: free "
    "some, or raise the limit of this job (ulimit -v)",
    r"timestamp (too large|out of range)|timestamps before 1980": "this machine's clock gives no "
    "usable date: set it, and run again",
    r"No space left|quota exceeded": "no space is left for what is written: free some",
}
_REPORT = "see CONTRIBUTING.md of the project, or SECURITY.md if untrusted input can cause it"


class Stopped(KeyboardInterrupt):
    """A signal stopped the program; the exit code is 128 plus the signal's number."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.exit_code = 128 + number


@contextlib.contextmanager
def reporting_end(report: Callable[[int], None]) -> Iterator[None]:
    """Call `report` with the exit code if a signal arrives inside the `with` block.

    The call runs in a separate thread, before anything is cleaned up. The process ends when the
    call has returned, or after `_END_REPORT_S`.
    """
    _end_reports.append(report)
    try:
        yield
    finally:
        _end_reports.remove(report)


@contextlib.contextmanager
def ending_promptly() -> Iterator[None]:
    """Raise `Stopped` in the main thread at the first signal; then end without waiting for threads.

    C code may delay the signal's handler in the main thread, and an interpreter waits for its
    threads before it ends. So an extra thread ends the process if it still runs after `_GRACE_S`.
    """
    number, is_raised = 0, False
    reported = threading.Event()
    earlier_hook = sys.unraisablehook

    def handle(asked: int, frame: FrameType | None) -> None:
        nonlocal number, is_raised
        number = number or asked
        if not is_raised and not _is_in_compiler(frame):
            is_raised = True  # only once: `timeout` signals the process and its group
            raise Stopped(number)

    def raise_again(unraisable: "sys.UnraisableHookArgs") -> None:
        """Let `handle` raise again if `Stopped` was lost in a destructor or garbage collector."""
        nonlocal is_raised
        if isinstance(unraisable.exc_value, Stopped):
            is_raised = False
        else:
            earlier_hook(unraisable)

    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=_end_after_signal, args=(reader, reported), daemon=True).start()
    sys.unraisablehook = raise_again
    caught = [name for name in _SIGNALS if signal.getsignal(name) != signal.SIG_IGN]
    for name in caught:
        signal.signal(name, handle)
    try:
        yield
    finally:
        if number:
            reported.wait(_END_REPORT_S)
            _end(number)
        for name in caught:  # everything is cleaned up: a later signal ends the process at once
            signal.signal(name, lambda asked, _frame: _end(asked))


def _is_in_compiler(frame: FrameType | None) -> bool:
    """Whether Numba's compiler is running: an error raised in it crashes its callers in C."""
    while frame is not None:
        if "/numba/" in frame.f_code.co_filename:
            return True
        frame = frame.f_back
    return False


def _end_after_signal(reader: int, reported: threading.Event) -> None:
    """Wait for a signal; end the process if it still runs some seconds later."""
    while True:
        number = os.read(reader, 1)[0]
        if number in _SIGNALS:
            threading.Thread(target=_report_end, args=(128 + number, reported), daemon=True).start()
            deadline = time.monotonic() + _GRACE_S
            while time.monotonic() < deadline:
                time.sleep(_PAUSE_S)
                # The handler may not have raised yet.
                _thread.interrupt_main(signal.Signals(number))
            reported.wait(_END_REPORT_S)
            with contextlib.suppress(Exception):
                os.write(sys.stderr.fileno(), f"{MESSAGE}\n".encode())
            _end(number)


def _report_end(exit_code: int, reported: threading.Event) -> None:
    """Call the functions of `reporting_end`, and then set the event."""
    for report in tuple(_end_reports):
        with contextlib.suppress(Exception):
            report(exit_code)
    reported.set()


def _end(number: int) -> None:
    """End the process and its threads at once; show the terminal's cursor again."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            if stream.isatty():
                stream.write(_SHOW_CURSOR)
            stream.flush()
    os._exit(128 + number)


def exit_code_of(error: BaseException) -> int:
    """Return the exit code of a command that ended with this error."""
    if isinstance(error, PipelineError):
        return error.exit_code
    if isinstance(error, KeyboardInterrupt):
        return error.exit_code if isinstance(error, Stopped) else 128 + signal.SIGINT
    return MachineError.exit_code if _machine_fault(error) else _UNEXPECTED


def _machine_fault(error: BaseException | None) -> str:
    """Name the fault of the machine behind an unexpected error, with the remedy; "" if none."""
    while error is not None:
        text = f"{type(error).__name__}: {error}"
        if remedies := [said for sign, said in _MACHINE.items() if re.search(sign, text)]:
            return f"error: {remedies[0]}"
        error = error.__cause__ or error.__context__
    return ""


@contextlib.contextmanager
def reported_errors() -> Iterator[None]:
    """Turn errors into lines on standard error and an exit code."""
    try:
        yield
    except (typer.Exit, typer.Abort, BrokenPipeError):
        raise
    except PipelineError as error:
        for line in str(error).splitlines():
            say(f"error: {line}", err=True)
        for note in getattr(error, "__notes__", ()):
            say(f"note: {note}", err=True)
        raise typer.Exit(error.exit_code) from None
    except KeyboardInterrupt as error:
        typer.echo(MESSAGE, err=True)
        raise typer.Exit(exit_code_of(error)) from None
    except Exception as error:  # noqa: BLE001 - reported as unexpected
        typer.echo(_machine_fault(error) or _unexpected(error), err=True)
        raise typer.Exit(exit_code_of(error)) from None


def _unexpected(error: Exception) -> str:
    """Return one line of JSON about an unexpected error."""
    frames = traceback.extract_tb(error.__traceback__)[-_FRAMES:]
    fields = {
        "error": "unexpected",
        "type": type(error).__name__,
        "message": clean(str(error), _MAX_MESSAGE),
        "where": [
            # The last three parts of each path, to hide the user's folders.
            f"{'/'.join(Path(frame.filename).parts[-3:])}:{frame.lineno}"
            for frame in frames
        ],
        "version": program_version(),
        "report": _REPORT,
    }
    return json.dumps(fields)


@contextlib.contextmanager
def dating_earlier_results(output: Path, name: object) -> Iterator[None]:
    """Add a note to a RequestError if the output folder has earlier results of the scenario `name`.

    The note has their date.
    """
    try:
        yield
    except RequestError as error:
        from pipeline.findings.names import MANIFEST, output_directory

        with contextlib.suppress(Exception):  # no such results, or a name that can't be a folder's
            directory = output_directory(output, str(name))
            written = datetime.fromtimestamp((directory / MANIFEST).stat().st_mtime, UTC)
            error.add_note(
                f"nothing was written: the files in {directory} are those of an earlier run, of "
                f"{written:%Y-%m-%d %H:%M} UTC"
            )
        raise


def program_version() -> str:
    """Return the version, read from the source of `renew`: to import it takes half a second."""
    source = (Path(__file__).resolve().parents[2] / "renew" / "__init__.py").read_text("utf-8")
    return next(line.split('"')[1] for line in source.splitlines() if "__version__ =" in line)
