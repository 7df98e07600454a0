"""The commands `renew nightly check | run | status | show`: plan many cases, unattended."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.failures import reported_errors
from pipeline.cli.waiting import still_at_work

if TYPE_CHECKING:
    from pipeline.nightly.outcome import NightOutcome
    from pipeline.nightly.request.config import NightConfig

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
YesOption = Annotated[bool, typer.Option("--yes", help="Plan more than 100,000 cases.")]


@app.command()
def check(
    *,
    config: ConfigOption = None,
    output: NightOutputOption = None,
    only: OnlyOption = None,
    yes: YesOption = False,
) -> None:
    """List all faults of a night's file with their lines; write nothing."""
    with reported_errors(), still_at_work():
        from pipeline.errors import RequestError
        from pipeline.nightly.request.expansion import expand
        from pipeline.nightly.request.pairs_in_water import pairs_on_land

        loaded = _loaded(config, output)
        cases = expand(loaded, only=only, yes=yes)
        if faults := pairs_on_land(loaded, cases):
            raise RequestError(faults)
        sizes = ", ".join(f"{block.scenario.name} {block.size:,}" for block in cases.blocks)
        typer.echo(f"{loaded.path.name}: valid, {len(cases):,} cases ({sizes})")


@app.command()
def run(
    *,
    config: ConfigOption = None,
    output: NightOutputOption = None,
    only: OnlyOption = None,
    part: Annotated[
        str | None,
        typer.Option(metavar="I/N", help="Plan one share of N, as in a job array: 3/64."),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, such as tcp://host:8786.")
    ] = None,
    yes: YesOption = False,
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
        from pipeline.cli.night_progress import night_progress
        from pipeline.cli.night_watch import watched
        from pipeline.nightly.night import run_night

        _refuse_no_file(metrics)
        with night_progress() as on_event:

            def night() -> NightOutcome:
                return run_night(
                    _loaded(config, output),
                    only=only,
                    share=_share(part),
                    scheduler=scheduler,
                    yes=yes,
                    on_event=on_event,
                )

            outcome = watched(night, metrics=metrics, url=ping, on_event=on_event)
        typer.echo(outcome.message)
        raise typer.Exit(outcome.exit_code)


@app.command()
def status(*, config: ConfigOption = None, output: NightOutputOption = None) -> None:
    """Print the latest cycle, whether a job is at work, and its progress."""
    with reported_errors():
        from pipeline.nightly.status import status_lines

        for line in status_lines(_loaded(config, output).output):
            typer.echo(line)


@app.command()
def show(
    case: Annotated[str, typer.Argument(help="A case, or the first parts of its name.")],
    *,
    config: ConfigOption = None,
    output: NightOutputOption = None,
) -> None:
    """Print a case of the last cycle: its route, and what changed."""
    with reported_errors():
        from pipeline.nightly.status import case_lines

        for line in case_lines(_loaded(config, output).output, case):
            typer.echo(line)


def _loaded(config: Path | None, output: Path | None) -> NightConfig:
    """Load the night's file."""
    from pipeline.nightly.request.config import load_config

    return load_config(config, output)


def _is_regular(path: Path) -> bool:
    """Whether a path is a file or a folder, not a pipe; writing to a folder gives a note later."""
    return path.is_file() or path.is_dir()


def _refuse_no_file(metrics: Path | None) -> None:
    """Raise RequestError if the path is a pipe or device, which could block when it is read."""
    from pipeline.errors import RequestError
    from pipeline.machine.paths import shown

    # Not Path.exists, which raises an error if a name is too long.
    if metrics is not None and os.path.exists(metrics) and not _is_regular(metrics):  # noqa: PTH110
        raise RequestError([f"--metrics: {shown(metrics)} is no file; name one to replace"])


def _share(text: str | None) -> tuple[int, int]:
    """Read `--part` I/N as (i, n)."""
    from pipeline.errors import RequestError

    if text is None:
        return 1, 1
    found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        raise RequestError([f"--part = {text!r} is no share; give it as 3/64, from 1/64 to 64/64"])
    return int(found[1]), int(found[2])
