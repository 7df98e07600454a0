"""Report errors on the command line: one line for each, and an exit code."""

import contextlib
import json
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperGroup

from pipeline.cli.interruption import MESSAGE, exit_code
from pipeline.errors import PipelineError, shortened

_UNEXPECTED = 3
# Number of the last frames of a traceback that are reported.
_FRAMES = 6
# Maximum length of an error's text, in characters.
_MAX_MESSAGE = 500
_REPORT = "see CONTRIBUTING.md of the project, or SECURITY.md if untrusted input can cause it"


class BriefRefusals(TyperGroup):
    """A command group that shortens long arguments in its error messages."""

    def make_context(self, *args: Any, **kwargs: Any) -> Any:  # noqa: ANN401 - of click, or of typer's own copy of it
        """Parse the arguments before the command."""
        with _brief_refusals():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401 - as above
        """Parse the command's own arguments, and run it."""
        with _brief_refusals():
            return super().invoke(ctx)


@contextlib.contextmanager
def _brief_refusals() -> Iterator[None]:
    """Shorten click's messages about invalid arguments."""
    try:
        yield
    except Exception as error:
        # Depending on its version, typer raises click's class of usage errors or its own copy.
        if hasattr(error, "format_message") and isinstance(getattr(error, "message", None), str):
            error.message = shortened(error.message)  # type: ignore[attr-defined]
        raise


def exit_code_of(error: BaseException) -> int:
    """Return the exit code of a command that ended with this error."""
    if isinstance(error, PipelineError):
        return error.exit_code
    return exit_code(error) if isinstance(error, KeyboardInterrupt) else _UNEXPECTED


@contextlib.contextmanager
def reported_errors() -> Iterator[None]:
    """Turn errors into lines on standard error and an exit code."""
    try:
        yield
    except (typer.Exit, typer.Abort, BrokenPipeError):
        raise
    except PipelineError as error:
        for line in str(error).splitlines():
            typer.echo(f"error: {line}", err=True)
        for note in getattr(error, "__notes__", ()):
            typer.echo(f"note: {note}", err=True)
        raise typer.Exit(error.exit_code) from None
    except KeyboardInterrupt as error:
        typer.echo(MESSAGE, err=True)
        raise typer.Exit(exit_code(error)) from None
    except Exception as error:  # noqa: BLE001 - reported as unexpected
        typer.echo(_unexpected(error), err=True)
        raise typer.Exit(_UNEXPECTED) from None


def _unexpected(error: Exception) -> str:
    """Return one line of JSON about an unexpected error."""
    from pipeline.cli.version import program_version

    frames = traceback.extract_tb(error.__traceback__)[-_FRAMES:]
    fields = {
        "error": "unexpected",
        "type": type(error).__name__,
        "message": " ".join(str(error).split())[:_MAX_MESSAGE],
        "where": [f"{_short(frame.filename)}:{frame.lineno}" for frame in frames],
        "version": program_version(),
        "report": _REPORT,
    }
    return json.dumps(fields)


def _short(filename: str) -> str:
    """Return the last three parts of a path, to hide the user's folders."""
    return "/".join(Path(filename).parts[-3:])
