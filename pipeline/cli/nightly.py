"""The commands `renew nightly check | run | status | show`: plan many cases, unattended."""

from pathlib import Path

import typer

from pipeline.cli import options
from pipeline.cli.terminal import still_at_work
from pipeline.errors import refuse_any

app = options.group(
    help="Plan all cases of a night on the newest currents, and publish what changed."
)


@options.command(app, "nightly check")
def check(
    *, config: Path | None = None, output: Path | None = None, only: str | None = None
) -> None:
    """List all faults of a night's file with their lines; write nothing."""
    with still_at_work():
        from pipeline.nightly.cases import expand, pairs_on_land
        from pipeline.nightly.config import load_config

        loaded = load_config(config, output)
        blocks = expand(loaded, only=only)
        refuse_any(pairs_on_land(loaded, blocks))
        count = sum(block.size for block in blocks)
        sizes = ", ".join(f"{block.scenario.name} {block.size:,}" for block in blocks)
        typer.echo(
            f"{loaded.path.name}: valid, {count:,} cases ({sizes}); files of currents and of "
            "voyages may still come, and are opened when the night runs"
        )


@options.command(app, "nightly run")
def run(
    *,
    config: Path | None = None,
    output: Path | None = None,
    only: str | None = None,
    scheduler: str | None = None,
    ping: str | None = None,
) -> None:
    """Plan every case on the newest currents, and then point OUTPUT/latest at the results."""
    from pipeline.cli.night_watch import night_progress, watched
    from pipeline.nightly.config import load_config
    from pipeline.nightly.night import run_night

    on_event = night_progress()
    # The night's file is loaded inside, so that its faults are reported as a failed night.
    outcome = watched(
        lambda: run_night(
            load_config(config, output), only=only, scheduler=scheduler, on_event=on_event
        ),
        url=ping,
        on_event=on_event,
    )
    typer.echo(outcome.message)
    raise typer.Exit(outcome.exit_code)


@options.command(app, "nightly status")
def status(*, config: Path | None = None, output: Path | None = None) -> None:
    """Print the latest cycle, whether a job is at work, and its progress."""
    from pipeline.nightly.config import load_config
    from pipeline.nightly.records import status_lines

    for line in status_lines(load_config(config, output).output):
        typer.echo(line)


@options.command(app, "nightly show")
def show(case: str, *, config: Path | None = None, output: Path | None = None) -> None:
    """Print a case of the last cycle: its route, and what changed."""
    from pipeline.nightly.config import load_config
    from pipeline.nightly.records import case_lines

    for line in case_lines(load_config(config, output).output, case):
        typer.echo(line)
