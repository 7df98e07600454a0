"""`python -m experiments`: the paper's tables again, with its baselines and rivals for least fuel.

Exit codes are those of `renew`: see `pipeline.cli.main`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from experiments.jobs import Result
from pipeline.cli.failures import ending_promptly, reported_errors
from pipeline.cli.terminal import still_at_work
from pipeline.machine.paths import short_path

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.command()
def experiments(
    *,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="Single gyre and 4-gyre, every planner, one seed, small budgets."
        ),
    ] = False,
    only: Annotated[
        list[str] | None,
        typer.Option(help="An environment, such as four-gyre; may be repeated. All if left out."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes at once; all processors if left out.")
    ] = None,
    output: Annotated[
        Path, typer.Option(help="Folder of all results; the experiments' own is in it.")
    ] = Path("outputs"),
) -> None:
    """Run the paper's experiments again and write OUTPUT/experiments/report.html."""
    with reported_errors(), still_at_work():
        from experiments.run import chosen_specs, run
        from pipeline.machine.paths import folder_to_write

        folder_to_write(output, "--output")
        specs = chosen_specs(quick=quick, only=only or ())
        report = run(specs, output, quick=quick, workers=workers, on_result=_report_progress)
        typer.echo(short_path(report))


def _report_progress(result: Result, done: int, in_all: int) -> None:
    """One line a run on standard error; on a terminal they replace each other."""
    failure = f": {result.failure}" if result.failure else ""
    line = f"[{done}/{in_all}] {result.job.name}{failure}"
    if sys.stderr.isatty():
        ending = "\n" if failure or done == in_all else ""
        typer.echo(f"\r\033[K{line}{ending}", err=True, nl=False)
    else:
        typer.echo(line, err=True)


if __name__ == "__main__":
    with ending_promptly():
        app()
