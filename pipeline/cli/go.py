"""The command `renew go`: plan a voyage from options, without a scenario file."""

import re
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from pipeline.cli.ending import end
from pipeline.cli.failures import reported_errors
from pipeline.cli.options import (
    ChartsOption,
    CurrentsOption,
    ExplainGapOption,
    JsonOption,
    OfflineOption,
    OutputOption,
    QuietOption,
    StrictOption,
    VesselOption,
)

# A minus and a digit or point, as in a negative number; no option begins with them.
_NEGATIVE = re.compile(r"-[\d.]")


class NegativeFigures(TyperCommand):
    """A command that parses negative numbers as arguments, not as options."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - of click, or of typer's own copy of it
        """Parse the arguments; a space before a minus hides it from the option parser."""
        return super().parse_args(ctx, [f" {a}" if _NEGATIVE.match(a) else a for a in args])


def go(
    positions: Annotated[
        list[str],
        typer.Argument(
            metavar="START GOAL",
            help="Two positions: '120.30,12.80' (longitude first), '12.80N 120.30E', "
            "'12°48'N 120°18'E'.",
        ),
    ],
    *,
    vessel: VesselOption = "",
    speed: Annotated[
        str,
        typer.Option(
            help="Speed through water, such as 12kn or 6m/s, in place of --vessel. Or a range, "
            "such as 4kn..9kn, also with --vessel: the planner then chooses a speed for each leg, "
            "for least fuel between --depart and --arrive-by."
        ),
    ] = "",
    length: Annotated[str, typer.Option(help="Length of the vessel, as 90m, 300ft.")] = "",
    turning_circle: Annotated[
        str, typer.Option(help="Diameter of the turning circle, helm hard over, as 400m.")
    ] = "",
    draught: Annotated[str, typer.Option(help="Draught, as 4m; charts with depths need it.")] = "",
    month: Annotated[
        list[str] | None,
        typer.Option(help="Month of the voyage, as 2024-07; may be repeated: each is a season."),
    ] = None,
    depart: Annotated[
        str,
        typer.Option(
            help="Departure with its time zone, as 2026-11-22T06:00Z, in place of --month. The "
            "currents then change during the voyage, with the time steps of --currents or with "
            "the service's hourly ones."
        ),
    ] = "",
    until: Annotated[
        str,
        typer.Option(help="Latest departure: the best one from --depart until then is chosen."),
    ] = "",
    arrive_by: Annotated[
        str,
        typer.Option(
            help="Latest arrival: the vessel leaves as late as possible, but not before --depart; "
            "with a range of --speed it leaves at --depart."
        ),
    ] = "",
    currents: CurrentsOption = None,
    via: Annotated[
        list[str] | None,
        typer.Option(
            metavar="POSITION",
            help="Point that the route must pass, written like START; may be repeated, in the "
            "order of passing.",
        ),
    ] = None,
    avoid: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="GeoJSON or other vector file of areas that no route may enter; may be repeated.",
        ),
    ] = None,
    clearance: Annotated[
        str, typer.Option(help="Least distance from no-go areas, true metres; chosen if left out.")
    ] = "",
    name: Annotated[str, typer.Option(help="Name of the folder of results.")] = "",
    charts: ChartsOption = None,
    depths: Annotated[
        Path | None,
        typer.Option(
            help="A GEBCO or EMODnet grid (NetCDF): too shallow water is no-go; needs --draught."
        ),
    ] = None,
    output: OutputOption = Path("outputs"),
    offline: OfflineOption = False,
    strict: StrictOption = False,
    explain_gap: ExplainGapOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Plan a voyage from START to GOAL; region, chart and currents are chosen and reported.

    The scenario is written beside the results, for `renew run`.
    """
    with reported_errors():
        from pipeline.machine.paths import folder_to_write
        from pipeline.voyage.quantities import RANGE
        from pipeline.voyage.request import VoyageRequest, voyage_scenario
        from pipeline.voyage.vessel_options import VesselFigures

        is_choice = RANGE in speed
        figures = VesselFigures("" if is_choice else speed, length, turning_circle, draught)
        request = VoyageRequest(
            positions=tuple(positions),
            vessel=vessel,
            figures=figures,
            months=tuple(month or ()),
            depart=depart,
            until=until,
            arrive_by=arrive_by,
            speeds=speed if is_choice else "",
            currents=tuple(currents or ()),
            via=tuple(via or ()),
            avoid=tuple(avoid or ()),
            clearance=clearance,
            charts=charts,
            depths=depths,
            name=name,
        )
        folder_to_write(output, "--output")
        scenario, notes = voyage_scenario(request)
        scenario = scenario.explaining_gap() if explain_gap else scenario
        from pipeline.cli.progress import progress
        from pipeline.voyage.one_line import run_voyage

        with progress(scenario, notes, quiet=quiet) as on_event:
            outcome = run_voyage(
                scenario, output, offline=offline, strict=strict, on_event=on_event
            )
        end(outcome, as_json=as_json, quiet=quiet)
