"""Plan a voyage in one call: make a scenario from the arguments, and run it."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from pipeline.errors import RequestError
from pipeline.run import run
from pipeline.running.outcome import Event, EventHandler, Outcome, ignore
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.model import Scenario
from pipeline.stages.choosing.coverage import uncovered_seasons
from pipeline.stages.projecting.endpoint_look import endpoints_on_land
from pipeline.voyage.quantities import RANGE
from pipeline.voyage.request import VoyageRequest, voyage_scenario
from pipeline.voyage.vessel_options import VesselFigures


def go(
    start: str | tuple[float, float],
    goal: str | tuple[float, float],
    *,
    vessel: str | VesselSpec | VesselFigures,
    months: Sequence[str] = (),
    depart: datetime | None = None,
    until: datetime | None = None,
    arrive_by: datetime | None = None,
    speeds_m_s: tuple[float, float] | None = None,
    currents: Sequence[str | Path] = (),
    via: Sequence[str | tuple[float, float]] = (),
    avoid: Sequence[Path] = (),
    clearance_m: float | None = None,
    charts: Path | None = None,
    depths: Path | None = None,
    name: str = "",
    output: Path = Path("outputs"),
    offline: bool = False,
    strict: bool = False,
    explain_gap: bool = False,
    on_event: EventHandler | None = None,
) -> Outcome:
    """Plan a voyage and write its results to `output/<name>/`, as `renew go` does.

    Parameters
    ----------
    start, goal
        (lon, lat) in degrees, or a text such as "12°48'N 120°18'E".
    vessel
        A name of the catalogue, the path of a TOML file, a `VesselSpec`, or `VesselFigures`.
    months
        Months as 'YYYY-MM'; each is a season.
    depart
        Departure with its time zone, in place of months; the currents then change on the way.
    until, arrive_by
        `until` is the latest departure: the best one from `depart` until then is chosen.
        `arrive_by` is the latest arrival: the vessel leaves as late as possible, but not before
        `depart`.
    speeds_m_s
        Lowest and highest speed through water, in place of the vessel's speed: the planner chooses
        a speed for each leg, so that the vessel leaves at `depart` and arrives by `arrive_by` with
        the least fuel. The currents are those of `months` if given, else they change on the way.
    currents
        Sources of the catalogue in order of preference, and files that belong together; ("still",)
        for no currents. By default they are chosen.
    via
        Positions that the route passes in this order, each like `start`.
    avoid
        Vector files of areas that no route may enter.
    clearance_m
        Minimum distance from the charted coast and its margin, true metres; by default an offing
        is chosen.
    charts
        A vector file or a folder of S-57 cells in place of OpenStreetMap's land.
    depths
        A grid of depths in NetCDF, such as GEBCO's or EMODnet's. Water that is too shallow for the
        vessel, whose draught must be given, is no-go.
    name
        Name of the scenario; by default it is made of the positions.
    explain_gap
        Report the parts of the optimality gap.
    output, offline, strict, on_event
        As in `pipeline.run.run`.

    Raises
    ------
    RequestError
        The request is wrong; the message has a line for each fault; nothing was written.
    StageError
        The voyage can't be planned for another reason, or the results can't be written.
    """
    request = VoyageRequest(
        positions=tuple(_text(place) for place in (start, goal)),
        vessel="" if isinstance(vessel, VesselFigures) else vessel,
        figures=vessel if isinstance(vessel, VesselFigures) else None,
        months=tuple(months),
        depart="" if depart is None else depart.isoformat(),
        until="" if until is None else until.isoformat(),
        arrive_by="" if arrive_by is None else arrive_by.isoformat(),
        speeds="" if speeds_m_s is None else RANGE.join(f"{one!r}m/s" for one in speeds_m_s),
        currents=tuple(map(str, currents)),
        via=tuple(_text(place) for place in via),
        avoid=tuple(avoid),
        clearance="" if clearance_m is None else f"{clearance_m!r}",
        charts=charts,
        depths=depths,
        name=name,
    )
    scenario, notes = voyage_scenario(request)
    scenario = scenario.explaining_gap() if explain_gap else scenario
    on_event = on_event or ignore
    for note in notes:
        on_event(Event("fetch", "note", detail=note))
    return run_voyage(scenario, output, offline=offline, strict=strict, on_event=on_event)


def run_voyage(
    scenario: Scenario,
    output: Path,
    *,
    offline: bool,
    strict: bool,
    on_event: EventHandler,
) -> Outcome:
    """Run a voyage's scenario, after a quick check of its currents and its stops."""
    if faults := [*uncovered_seasons(scenario), *endpoints_on_land(scenario)]:
        raise RequestError(faults)
    return run(scenario, output, offline=offline, strict=strict, on_event=on_event)


def _text(place: str | tuple[float, float]) -> str:
    """Return a position as text."""
    return place if isinstance(place, str) else f"{place[0]!r},{place[1]!r}"
