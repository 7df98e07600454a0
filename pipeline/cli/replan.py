"""The command `renew replan`: plan the rest of a voyage again from where the vessel is."""

from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli import options
from pipeline.cli.failures import reported_errors

if TYPE_CHECKING:
    from pipeline.scenario.model import Scenario


def replan(
    results: options.Results,
    *,
    at: Annotated[
        str,
        typer.Option(metavar="POSITION", help="Where the vessel is, as '119.95E 9.99N'."),
    ],
    time: Annotated[
        str, typer.Option(metavar="TIME", help="When it is there, as 2026-11-22T09:30Z.")
    ],
    heading: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES",
            help="Its true heading, from which the route begins with a turn; by default it begins "
            "on the best heading.",
        ),
    ] = None,
    currents: Annotated[
        list[str] | None,
        typer.Option(
            help="The new currents, as for `renew run`; by default those of the plan hold."
        ),
    ] = None,
    season: options.OneSeason = "",
    departed: options.Departed = "",
    name: options.Name = "",
    offline: options.Offline = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Plan the rest of a voyage again from where the vessel is, in a folder beside RESULTS.

    The way that was planned is kept, unless it can't be sailed or another saves more than 2 % of
    the fuel ahead. The answer is no command to a vessel.
    """
    given = locals()
    with reported_errors():
        from pipeline.cli.reporting import run_to_end
        from pipeline.machine.paths import expanded
        from pipeline.run import run as run_scenario

        scenario, notes = _scenario(given)
        beside = expanded(results, "RESULTS").absolute().parent
        run = partial(run_scenario, scenario, beside, offline=offline, said=notes)
        run_to_end(run, scenario, notes, as_json=as_json, quiet=quiet)


def _scenario(given: dict[str, Any]) -> "tuple[Scenario, tuple[str, ...]]":
    """Return the scenario of the voyage ahead, given arguments by their names, with notes."""
    from pipeline.errors import RequestError
    from pipeline.underway.replan import UnderWayRequest, under_way_scenario
    from pipeline.voyage.times import zoned_time

    faults: list[str] = []
    now = zoned_time("--time", given["time"], faults)
    left = zoned_time("--departed", given["departed"], faults)
    if now is None and not faults:
        faults.append("--time is empty; give when the vessel is at --at, as 2026-11-22T09:30Z")
    if now is None or faults:
        raise RequestError(faults)
    return under_way_scenario(
        UnderWayRequest(
            results=given["results"],
            at=given["at"],
            time=now,
            heading_deg=given["heading"],
            currents=tuple(given["currents"] or ()),
            season=given["season"],
            departed=left,
            name=given["name"],
        )
    )
