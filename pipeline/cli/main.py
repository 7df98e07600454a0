"""The command line: `renew run|plot|list|show|check`.

Exit code 0: done. 1: a season failed, the others are written; or a stage failed. 2: the request is
wrong, nothing is written. Results go to standard output; progress, notes and errors to standard
error.
"""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.errors import PipelineError
from pipeline.formats.figures.kinds import Form, Kind

if TYPE_CHECKING:
    from collections.abc import Iterator

app = typer.Typer(
    name="renew",
    help="Vessel routes that are safe and cheap in ocean currents.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

ScenarioArgument = Annotated[
    str, typer.Argument(help="A name in the catalogue (`renew list`) or the path of a TOML file.")
]

OutputOption = Annotated[
    Path, typer.Option(help="Folder of all results; each scenario has its own folder in it.")
]
OfflineOption = Annotated[
    bool, typer.Option("--offline", help="Use no source that needs the network.")
]
ChartsOption = Annotated[
    Path | None,
    typer.Option(help="A vector file or a folder of S-57 cells, in place of the scenario's chart."),
]
CurrentsOption = Annotated[
    list[Path] | None,
    typer.Option(
        help="A NetCDF file or Zarr store of currents, in place of the scenario's; may be repeated "
        "for files that belong together, or given as a quoted pattern: 'daily/*.nc'."
    ),
]


def main() -> None:
    """Entry point `renew`."""
    app()


@contextlib.contextmanager
def _reported_errors() -> Iterator[None]:
    """Turn expected errors into lines on standard error and an exit code."""
    try:
        yield
    except PipelineError as error:
        for line in str(error).splitlines():
            typer.echo(f"error: {line}", err=True)
        raise typer.Exit(error.exit_code) from None
    except KeyboardInterrupt:
        typer.echo("stopped; finished stages are kept, run again to continue", err=True)
        raise typer.Exit(130) from None


def _version(asked: bool) -> None:  # noqa: FBT001 - typer calls it with the option's value
    if asked:
        from pipeline.cli.version import program_version

        typer.echo(f"renew {program_version()}")
        raise typer.Exit


@app.callback()
def options(
    *,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Vessel routes that are safe and cheap in ocean currents."""
    del version


@app.command()
def run(
    scenario: ScenarioArgument,
    *,
    output: OutputOption = Path("outputs"),
    offline: OfflineOption = False,
    charts: ChartsOption = None,
    currents: CurrentsOption = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, such as tcp://host:8786.")
    ] = None,
) -> None:
    """Plan a scenario's routes and write them to OUTPUT/<scenario>/."""
    with _reported_errors():
        from pipeline.loading import load_scenario

        # Before the heavy imports, so that a wrong request is reported at once.
        notes: list[str] = []
        wanted = load_scenario(
            scenario, charts=charts, currents=currents or (), on_note=notes.append
        )
        from pipeline.cli.progress import progress
        from pipeline.cli.summary import season_table
        from pipeline.run import Event
        from pipeline.run import run as run_scenario

        with progress(wanted.name, len(wanted.seasons)) as on_event:
            for note in notes:
                on_event(Event("fetch", "note", detail=note))
            outcome = run_scenario(
                wanted, output, offline=offline, scheduler=scheduler, on_event=on_event
            )
        typer.echo(season_table(outcome))
        verb = "Written to" if outcome.fresh else "Unchanged in"
        typer.echo(f"\n{verb} {_short(outcome.directory)} ({outcome.seconds:.1f} s)")
        for failure in outcome.failures:
            typer.echo(f"error: {failure}", err=True)
        raise typer.Exit(outcome.exit_code)


@app.command()
def plot(
    scenario: ScenarioArgument,
    *,
    season: Annotated[
        list[str] | None, typer.Option(help="A season; may be repeated. All seasons if left out.")
    ] = None,
    figure: Annotated[
        list[Kind] | None,
        typer.Option(help="What to draw; may be repeated. Everything if left out."),
    ] = None,
    form: Annotated[Form, typer.Option("--format", help="Format of the files.")] = Form.PNG,
    output: OutputOption = Path("outputs"),
    offline: OfflineOption = False,
    charts: ChartsOption = None,
    currents: CurrentsOption = None,
) -> None:
    """Draw a scenario's figures to OUTPUT/<scenario>/figures/.

    They show the results of an earlier run; what has not been planned yet is planned first.
    """
    with _reported_errors():
        from pipeline.loading import load_scenario

        notes: list[str] = []
        wanted = load_scenario(
            scenario, charts=charts, currents=currents or (), on_note=notes.append
        )
        from pipeline.cli.plot import plot as plot_scenario
        from pipeline.cli.progress import progress
        from pipeline.run import Event

        with progress(wanted.name, len(wanted.seasons)) as on_event:
            for note in notes:
                on_event(Event("fetch", "note", detail=note))
            drawn = plot_scenario(
                wanted,
                output,
                seasons=season or (),
                kinds=figure or (),
                form=form,
                offline=offline,
                on_event=on_event,
            )
        for file in drawn.files:
            typer.echo(_short(file))
        for failure in drawn.failures:
            typer.echo(f"error: {failure}", err=True)
        raise typer.Exit(1 if drawn.failures else 0)


@app.command("list")
def list_entries() -> None:
    """List the catalogue: scenarios, vessels, sources."""
    with _reported_errors():
        from pipeline.scenario import catalogue

        for section in catalogue.SECTIONS:
            typer.echo(f"{section}:")
            for name in catalogue.names(section):
                typer.echo(f"  {name:<26} {catalogue.entry(section, name).get('title', '')}")


@app.command()
def show(
    name: Annotated[str, typer.Argument(help="An entry of the catalogue, or a file.")],
) -> None:
    """Print an entry of the catalogue as TOML, to read or to start a new one from."""
    with _reported_errors():
        from pipeline.scenario import catalogue

        path = catalogue.entry_path(name)
        catalogue.read_toml(path)
        typer.echo(path.read_text(encoding="utf-8"), nl=False)


@app.command()
def check(
    file: Annotated[str, typer.Argument(help="A scenario's file, or its name.")],
) -> None:
    """List all faults of a scenario's file; only a run also checks it against its chart."""
    with _reported_errors():
        from pipeline.loading import load_scenario

        found = load_scenario(file, on_note=lambda note: typer.echo(f"note: {note}", err=True))
        seasons = ", ".join(season.name for season in found.seasons)
        typer.echo(
            f"{found.name}: valid ({seasons}; vessel {found.vessel.name}; 1:{found.scale:g})"
        )


def _short(path: Path) -> str:
    """Return the path as it would be typed in this folder."""
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)


if __name__ == "__main__":
    sys.exit(app())
