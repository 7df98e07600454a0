"""The commands made from tables of options: `renew go`, `renew replan` and `renew serve`."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli import options
from pipeline.cli.failures import reported_errors
from pipeline.cli.terminal import say
from pipeline.errors import Faults, StageError
from pipeline.serve.options import ServerOptions
from pipeline.underway.request import UnderWayRequest
from pipeline.voyage.readers import EXAMPLES, halves
from pipeline.voyage.request import VoyageRequest, read_voyage
from pipeline.voyage.table import read, spelling


@options.with_options(VoyageRequest, without=("start", "goal"))
def go(
    positions: Annotated[
        list[str], typer.Argument(metavar="START GOAL", help=f"Two positions: {EXAMPLES}.")
    ],
    *,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    **given: Any,  # noqa: ANN401 - the options of a voyage
) -> None:
    """Plan a voyage from START to GOAL; region, chart and currents are chosen and reported.

    The scenario is written beside the results, for `renew run`.
    """
    with reported_errors():
        request = _request(positions, given)
        from pipeline.cli.reporting import run_to_end
        from pipeline.voyage.one_line import run_voyage, voyage_scenario

        scenario, notes = voyage_scenario(request)
        run = partial(run_voyage, request, scenario, said=notes)
        run_to_end(run, scenario, notes, as_json=as_json, quiet=quiet)


def _request(positions: Sequence[str], given: dict[str, Any]) -> VoyageRequest:
    """Return the voyage that was typed; RequestError with a line for each fault."""
    faults = Faults()
    start, goal = faults.collect(lambda: halves(positions)) or (None, None)
    return read_voyage({**given, "start": start, "goal": goal}, "command", faults.lines)


@options.with_options(UnderWayRequest)
def replan(
    *,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    **given: Any,  # noqa: ANN401 - the options of a voyage under way
) -> None:
    """Plan the rest of a voyage again from where the vessel is, in a folder beside RESULTS.

    The way that was planned is kept, unless it can't be sailed or another saves more than 2 % of
    the fuel ahead. The answer is no command to a vessel.
    """
    with reported_errors():
        from pipeline.cli.reporting import run_to_end
        from pipeline.machine.paths import expanded
        from pipeline.run import run as run_scenario
        from pipeline.stages.under_way import finished_season
        from pipeline.underway.replan import under_way_scenario

        faults = Faults()
        results = Path(given["results"])
        finished = faults.collect(lambda: finished_season(results, given["season"] or ""))
        at = spelling(UnderWayRequest, "command")
        request = read(UnderWayRequest, given, at, known=faults.lines)
        scenario, notes = under_way_scenario(request, finished)
        beside = expanded(results, at.results).absolute().parent
        run = partial(run_scenario, scenario, beside, offline=request.offline, said=notes)
        run_to_end(run, scenario, notes, as_json=as_json, quiet=quiet)


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
