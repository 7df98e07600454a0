"""The command `renew go`: plan a voyage from options, without a scenario file."""

from functools import partial
from pathlib import Path

from pipeline.cli import options
from pipeline.cli.failures import reported_errors


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
        from pipeline.cli.ending import run_to_end
        from pipeline.errors import Faults, RequestError
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
        faults = Faults()
        faults.part(lambda: folder_to_write(output, "--output"))
        made = faults.part(lambda: voyage_scenario(request))
        if made is None or faults.lines:
            raise RequestError(faults.lines)
        scenario, notes = made
        scenario = scenario.explaining_gap() if explain_gap else scenario
        run = partial(run_voyage, scenario, output, offline=offline, strict=strict)
        run_to_end(run, scenario, notes, as_json=as_json, quiet=quiet)
