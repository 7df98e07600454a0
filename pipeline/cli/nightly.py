"""The commands `renew nightly check | run | status | show`: plan many cases, unattended."""

import os
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli import options
from pipeline.cli.failures import reported_errors
from pipeline.cli.terminal import still_at_work
from pipeline.errors import RequestError
from pipeline.machine.paths import shown

app = typer.Typer(
    help="Plan all cases of a night on the newest currents, and publish what changed.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
ConfigOption = Annotated[
    Path | None,
    typer.Option(
        help="The night's TOML file; by default one that comes with RENEW and runs offline."
    ),
]
NightOutputOption = Annotated[
    Path | None,
    typer.Option(help="Folder of all cycles, in place of the file's; outputs/nightly by default."),
]
OnlyOption = Annotated[
    str | None,
    typer.Option(
        metavar="CASE", help="A case's name, or its first parts: only matching cases are planned."
    ),
]


@app.command(cls=options.Command)
def check(
    *,
    config: ConfigOption = None,
    output: NightOutputOption = None,
    only: OnlyOption = None,
) -> None:
    """List all faults of a night's file with their lines; write nothing."""
    with reported_errors(), still_at_work():
        from pipeline.nightly.cases import expand, pairs_on_land
        from pipeline.nightly.config import load_config

        loaded = load_config(config, output)
        blocks = expand(loaded, only=only)
        if faults := pairs_on_land(loaded, blocks):
            raise RequestError(faults)
        count = sum(block.size for block in blocks)
        sizes = ", ".join(f"{block.scenario.name} {block.size:,}" for block in blocks)
        typer.echo(
            f"{loaded.path.name}: valid, {count:,} cases ({sizes}); files of currents and of "
            "voyages may still come, and are opened when the night runs"
        )


@app.command(cls=options.Command)
def run(
    *,
    config: ConfigOption = None,
    output: NightOutputOption = None,
    only: OnlyOption = None,
    scheduler: options.Scheduler = None,
    metrics: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Prometheus text file to replace at the end."),
    ] = None,
    ping: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            envvar="RENEW_PING",
            show_envvar=False,
            help="Address of a monitoring check: URL/start is requested, then URL or URL/fail. Or "
            "set the variable RENEW_PING.",
        ),
    ] = None,
) -> None:
    """Plan every case on the newest currents, and then point OUTPUT/latest at the results."""
    with reported_errors():
        from pipeline.cli.night_watch import night_progress, watched
        from pipeline.nightly.config import load_config
        from pipeline.nightly.night import run_night

        _require_file(metrics)
        on_event = night_progress()
        # The night's file is loaded inside, so that its faults are reported as a failed night.
        outcome = watched(
            lambda: run_night(
                load_config(config, output),
                only=only,
                scheduler=scheduler,
                on_event=on_event,
            ),
            metrics=metrics,
            url=ping,
            on_event=on_event,
        )
        typer.echo(outcome.message)
        raise typer.Exit(outcome.exit_code)


@app.command(cls=options.Command)
def status(*, config: ConfigOption = None, output: NightOutputOption = None) -> None:
    """Print the latest cycle, whether a job is at work, and its progress."""
    with reported_errors():
        from pipeline.nightly.config import load_config
        from pipeline.nightly.records import status_lines

        for line in status_lines(load_config(config, output).output):
            typer.echo(line)


@app.command(cls=options.Command)
def show(
    case: Annotated[str, typer.Argument(help="A case, or the first parts of its name.")],
    *,
    config: ConfigOption = None,
    output: NightOutputOption = None,
) -> None:
    """Print a case of the last cycle: its route, and what changed."""
    with reported_errors():
        from pipeline.nightly.config import load_config
        from pipeline.nightly.records import case_lines

        for line in case_lines(load_config(config, output).output, case):
            typer.echo(line)


def _require_file(metrics: Path | None) -> None:
    """Raise RequestError if the path is a pipe or device, which could block when it is read."""
    # Not Path.exists, which raises an error if a name is too long. A folder is reported later.
    if metrics is None or not os.path.exists(metrics) or metrics.is_file() or metrics.is_dir():  # noqa: PTH110
        return
    raise RequestError(f"--metrics: {shown(metrics)} is no file; name one to replace")
