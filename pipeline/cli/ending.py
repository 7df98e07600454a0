"""Print the end of a run: its table, the folder of its results, and its failures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer

if TYPE_CHECKING:
    from pipeline.running.outcome import Outcome


def end(outcome: Outcome, *, as_json: bool = False, quiet: bool = False) -> NoReturn:
    """Print an outcome as a table or JSON, or only its failures if `quiet`; exit with its code."""
    if as_json:
        from pipeline.cli.outcome_json import outcome_json

        typer.echo(outcome_json(outcome))
    elif not quiet:
        from pipeline.cli.summary import season_table

        typer.echo(season_table(outcome))
        verb = "Written to" if outcome.fresh else "Unchanged in"
        typer.echo(f"\n{verb} {short_path(outcome.directory)} ({outcome.seconds:.1f} s)")
    for failure in outcome.failures:
        typer.echo(f"error: {failure}", err=True)
    raise typer.Exit(outcome.exit_code)


def short_path(path: Path) -> str:
    """Return a path relative to the working directory if it lies inside."""
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)
