"""The command `renew go`: plan a voyage from options, without a scenario file."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.cli import options
from pipeline.cli.failures import reported_errors

if TYPE_CHECKING:
    from pipeline.scenario.model import Scenario


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
    havens: options.Havens = None,
    within: options.Within = "",
    endurance: options.Endurance = "",
    clearance: options.Clearance = "",
    name: options.Name = "",
    charts: options.Charts = None,
    depths: options.Depths = None,
    datum: options.Datum = "",
    tide: options.Tide = None,
    members: options.Members = "",
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
    given = locals()
    with reported_errors():
        from pipeline.cli.reporting import run_to_end
        from pipeline.voyage.one_line import run_voyage

        scenario, notes = _scenario(given)
        scenario = scenario.explaining_gap() if explain_gap else scenario
        run = partial(run_voyage, scenario, output, offline=offline, strict=strict, said=notes)
        run_to_end(run, scenario, notes, as_json=as_json, quiet=quiet)


def _scenario(given: dict[str, Any]) -> "tuple[Scenario, tuple[str, ...]]":
    """Return the scenario of a voyage, given arguments and options by their names, with notes."""
    from pipeline.errors import Faults, RequestError
    from pipeline.machine.paths import folder_to_write
    from pipeline.voyage.one_line import voyage_scenario
    from pipeline.voyage.request import VoyageRequest

    request = VoyageRequest.of_options(given)
    faults = Faults()
    faults.collect(lambda: folder_to_write(given["output"], "--output"))
    made = faults.collect(lambda: voyage_scenario(request))
    if made is None or faults.lines:
        raise RequestError(faults.lines)
    return made
