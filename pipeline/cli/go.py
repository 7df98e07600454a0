"""The command `renew go`: plan a voyage from options, without a scenario file."""

import re
from functools import partial
from pathlib import Path
from typing import Any

from typer.core import TyperCommand

from pipeline.cli import options
from pipeline.cli.failures import reported_errors

# A minus and a digit or point, as in a negative number; no option begins with them.
_NEGATIVE = re.compile(r"-[\d.]")


class GroupedCommand(TyperCommand):
    """A command with groups of options, which parses negative numbers as arguments."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - of click, or of typer's own copy of it
        """Parse the arguments; a space before a minus hides it from the option parser."""
        return super().parse_args(ctx, [f" {a}" if _NEGATIVE.match(a) else a for a in args])

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - as above
        """Write arguments and options in groups, in the order in which the groups first occur."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for one in self.get_params(ctx):
            if (record := one.get_help_record(ctx)) is not None:
                is_argument = one.param_type_name == "argument"
                group = getattr(one, "rich_help_panel", None)
                name = "Arguments" if is_argument else group or "Other options"
                groups.setdefault(name, []).append(record)
        for name, records in groups.items():
            with formatter.section(name):
                formatter.write_dl(records)


def go(
    positions: options.Positions,
    *,
    vessel: options.Vessel = "",
    speed: options.Speed = "",
    length: options.Length = "",
    turning_circle: options.TurningCircle = "",
    draught: options.Draught = "",
    month: options.Months = None,
    depart: options.Depart = "",
    until: options.Until = "",
    arrive_by: options.ArriveBy = "",
    currents: options.Currents = None,
    via: options.Via = None,
    avoid: options.Avoid = None,
    clearance: options.Clearance = "",
    name: options.Name = "",
    charts: options.Charts = None,
    depths: options.Depths = None,
    output: options.Output = Path("outputs"),
    offline: options.Offline = False,
    strict: options.Strict = False,
    explain_gap: options.ExplainGap = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Plan a voyage from START to GOAL; region, chart and currents are chosen and reported.

    The scenario is written beside the results, for `renew run`.
    """
    with reported_errors():
        from pipeline.machine.paths import folder_to_write
        from pipeline.voyage.one_line import VoyageRequest, run_voyage, voyage_scenario
        from pipeline.voyage.vessel_options import RANGE, VesselFigures

        is_choice = RANGE in speed
        request = VoyageRequest(
            positions=tuple(positions),
            vessel=vessel,
            figures=VesselFigures("" if is_choice else speed, length, turning_circle, draught),
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
        from pipeline.cli.ending import run_to_end

        run = partial(run_voyage, scenario, output, offline=offline, strict=strict)
        run_to_end(run, scenario, notes, as_json=as_json, quiet=quiet)
