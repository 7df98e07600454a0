"""The command `renew serve`: a page on this machine where voyages are planned on a map."""

from typing import Any

import typer

from pipeline.cli import options
from pipeline.cli.failures import reported_errors
from pipeline.cli.terminal import say
from pipeline.errors import StageError
from pipeline.serve.options import ServerOptions
from pipeline.voyage.table import read, spelling


@options.with_options(ServerOptions)
def serve(**given: Any) -> None:  # noqa: ANN401 - the options of a server
    """Serve a page on this machine where voyages are planned on a map; needs the extra `web`.

    It answers to 127.0.0.1 only, and to whom has the address that it prints.
    """
    with reported_errors():
        try:
            from pipeline.serve.start import serve as serve_page
        except ImportError as error:
            raise StageError(
                f"renew serve needs the extra `web` ({error}): pip install fastapi uvicorn"
            ) from error

        serve_page(read(ServerOptions, given, spelling(ServerOptions, "command")), on_ready=_say)


def _say(address: str) -> None:
    """Print the first address."""
    typer.echo(address)
    say(
        "Open it in a browser on this machine. Who has it may plan here, so keep it to yourself. "
        "Ctrl-C ends.",
        err=True,
    )
