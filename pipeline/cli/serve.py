"""The command `renew serve`: a page on this machine where voyages are planned on a map."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli import options
from pipeline.cli.failures import reported_errors
from pipeline.cli.terminal import say
from pipeline.errors import StageError

# Largest port; the least time, s, and memory, GB, with which anything can be planned.
_MAX_PORT, _MIN_LIMIT_S, _MIN_MEMORY_GB = 65_535, 1.0, 0.5
_MAX_WORKERS = 64


def serve(
    *,
    port: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=_MAX_PORT,
            help="Port of 127.0.0.1; 0 for any that is free. Left out, 8137 or any that is free.",
        ),
    ] = None,
    opens: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    output: options.Output = Path("outputs"),
    offline: options.Offline = False,
    limit: Annotated[
        float,
        typer.Option(min=_MIN_LIMIT_S, metavar="SECONDS", help="Time limit of a plan."),
    ] = 600.0,
    memory: Annotated[
        float,
        typer.Option(min=_MIN_MEMORY_GB, metavar="GB", help="Memory limit of a plan's process."),
    ] = 4.0,
    workers: Annotated[
        int, typer.Option(min=1, max=_MAX_WORKERS, help="Number of plans at a time.")
    ] = 1,
) -> None:
    """Serve a page on this machine where voyages are planned on a map; needs the extra `web`.

    It answers to 127.0.0.1 only, and to whom has the address that it prints.
    """
    with reported_errors():
        try:
            from pipeline.serve.start import Limits, serve as serve_page
        except ImportError as error:
            raise StageError(
                f"renew serve needs the extra `web` ({error}): pip install fastapi uvicorn"
            ) from error

        serve_page(
            output,
            port=port,
            offline=offline,
            limits=Limits(limit, memory, workers),
            on_ready=_say,
            opens=opens,
        )


def _say(address: str) -> None:
    """Print the first address."""
    typer.echo(address)
    say(
        "Open it in a browser on this machine. Who has it may plan here, so keep it to yourself. "
        "Ctrl-C ends.",
        err=True,
    )
