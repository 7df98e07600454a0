"""Plan a voyage in one call: make its scenario from the request, and run it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from pipeline.errors import Faults, RequestError
from pipeline.findings.result import RunResult
from pipeline.run import Event, EventHandler, Outcome, ignore, run
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.loading import asked_currents, parse_scenario, require_currents
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import STILL, Season
from pipeline.scenario.strict import Name
from pipeline.sources.registry import current_source
from pipeline.stages.plan_case import OnStep, ignore_step
from pipeline.stages.region import are_water_swapped, least_region, require_sailable
from pipeline.voyage.named_files import tables_of
from pipeline.voyage.positions import Position, read_positions, read_via, spelled, voyage_name
from pipeline.voyage.request import VoyageRequest
from pipeline.voyage.times import Departing, departing, read_months
from pipeline.voyage.vessel_options import RANGE, VesselFigures, read_clearance_m, vessel_spec

# Datasets of the service with monthly means, the best first; the first that has the month is used.
_SERVICE = (
    "copernicus-glorys-monthly",
    "copernicus-forecast-monthly",
    "copernicus-glorys-climatology",
)

# The service's hourly dataset, with tide and Stokes drift, for currents that change on the way.
_SERVICE_STEPS = "copernicus-total-hourly"


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
    havens: Path | None = None,
    within: str = "",
    endurance: str = "",
    clearance_m: float | None = None,
    charts: Path | None = None,
    depths: Path | None = None,
    datum: str = "",
    tide: Sequence[str | Path] = (),
    members: str = "",
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
    havens
        A file of points: from where along the best route is one of them reached in time?
    within, endurance
        Longest time to a haven, and time under way for which there is fuel at departure: "6h".
        With `havens` one of the two is needed.
    clearance_m
        Minimum distance from the charted coast and its margin, true metres; by default an offing
        is chosen.
    charts
        A vector file or a folder of S-57 cells in place of OpenStreetMap's land.
    depths
        A grid of depths in NetCDF, such as GEBCO's or EMODnet's. Water that is too shallow for the
        vessel, whose draught must be given, is no-go.
    datum
        Chart datum of the depths, such as "MLLW", where the chart does not state it.
    tide
        Stations of the catalogue, and files of harmonic constants: water that is too shallow for
        some hours may be passed in the others. Needs `depart`, and depths by `charts` or `depths`.
    members
        "files", a dimension of the files, or a speed such as "0.2m/s", as in `renew go --members`.
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
        havens=havens,
        within=within,
        endurance=endurance,
        clearance="" if clearance_m is None else f"{clearance_m!r}",
        charts=charts,
        depths=depths,
        datum=datum,
        tide=tuple(map(str, tide)),
        members=members,
        name=name,
    )
    scenario, notes = voyage_scenario(request)
    scenario = scenario.explaining_gap() if explain_gap else scenario
    on_event = on_event or ignore
    for note in notes:
        on_event(Event("fetch", "note", detail=note))
    return run_voyage(
        scenario, output, offline=offline, strict=strict, on_event=on_event, said=notes
    )


def run_voyage(
    scenario: Scenario,
    output: Path,
    *,
    offline: bool,
    strict: bool,
    on_event: EventHandler,
    on_step: OnStep = ignore_step,
    on_result: Callable[[RunResult], None] | None = None,
    said: Sequence[str] = (),
) -> Outcome:
    """Run a voyage's scenario, after a quick check of its currents and its stops."""
    require_sailable(scenario)
    return run(
        scenario,
        output,
        offline=offline,
        strict=strict,
        on_event=on_event,
        on_step=on_step,
        on_result=on_result,
        said=said,
    )


def _text(place: str | tuple[float, float]) -> str:
    """Return a position as text."""
    return place if isinstance(place, str) else f"{place[0]!r},{place[1]!r}"


def voyage_scenario(request: VoyageRequest) -> tuple[Scenario, tuple[str, ...]]:
    """Return the scenario of a request, without a region, and notes on ambiguous positions.

    Raises
    ------
    RequestError
        The message has a line for each fault.
    """
    faults = Faults()
    ends = faults.collect(lambda: read_positions(request.positions))
    via = faults.collect(lambda: read_via(request.via, ends[0].lon if ends else 0.0))
    vessel = faults.collect(lambda: _vessel(request))
    clearance_m = faults.collect(lambda: read_clearance_m(request.clearance))
    departing_at = faults.collect(lambda: _departing(request))
    is_timed = bool(request.depart or request.until or request.arrive_by)
    is_steady = not is_timed or _is_still(request) or _has_steady_months(request)
    months = faults.collect(lambda: _months(request)) if is_steady else []
    files = faults.collect(lambda: tables_of(request))
    members = faults.collect(lambda: request.member_key) or {}
    faults.collect(lambda: require_currents(request.currents))
    faults.collect(lambda: _require_name(request.name))
    if faults.lines or ends is None or via is None or vessel is None or files is None:
        raise RequestError(faults.lines)
    start, goal = ends
    data: dict[str, Any] = {
        "schema_version": 1,
        "name": request.name or voyage_name(start, goal),
        "title": f"{spelled(start)} to {spelled(goal)}",
        "vessel": vessel.model_dump(exclude_defaults=True),
        "start": [start.lon, start.lat],
        "goal": [goal.lon, goal.lat],
        "seasons": [
            departing_at.season(
                asked_currents(request.currents) or [_SERVICE_STEPS], has_tide=bool(request.tide)
            )
        ]
        if departing_at is not None and not is_steady
        else [
            {
                **_season(month, title, request, (start, goal)),
                **_when(departing_at, request),
            }
            for month, title in months or []
        ],
    }
    data["seasons"] = [{**season, **members} for season in data["seasons"]]
    if via:
        data["via"] = [point.key for point in via]
    if clearance_m is not None:
        data["planner"] = {"clearance": clearance_m}
    scenario = parse_scenario({**data, **files})
    notes = tuple(_position_notes(scenario, (*ends, *via)))
    if request.until and _is_still(request) and not request.tide:
        notes += (
            "in still water no later departure needs less fuel: the vessel leaves at the first",
        )
    return scenario, notes


def _position_notes(scenario: Scenario, places: Sequence[Position]) -> Iterator[str]:
    """Yield notes on how positions were read; none if only one order of the figures is possible."""
    doubtful = [(place.lon, place.lat) for place in places if place.either_order]
    is_doubtful = bool(doubtful) and are_water_swapped(scenario, doubtful)
    for place in places:
        if place.note and (is_doubtful or not place.either_order):
            yield place.note


def _vessel(request: VoyageRequest) -> VesselSpec:
    """Return the requested vessel."""
    if not isinstance(request.vessel, str):
        return request.vessel
    figures = request.figures or VesselFigures()
    if request.speeds and not request.vessel:
        # The turning circle is given for the highest speed.
        figures = replace(figures, speed=request.speeds.partition(RANGE)[2])
    return vessel_spec(request.vessel, figures)


def _require_name(name: str) -> None:
    """Raise RequestError if a name can't be a scenario's."""
    try:
        TypeAdapter(Name).validate_python(name or "unnamed")
    except ValidationError:
        raise RequestError(
            f"--name = {name!r} is not a name: use up to 64 lower-case letters, digits, '-' and '_'"
        ) from None


def _is_still(request: VoyageRequest) -> bool:
    """Whether the voyage is planned in still water, so that its times do not matter."""
    return request.currents == (STILL,)


def _has_steady_months(request: VoyageRequest) -> bool:
    """Whether a voyage with a departure has steady currents: monthly means or still water."""
    return bool(request.speeds or request.tide) and (bool(request.months) or _is_still(request))


def _when(departing_at: Departing | None, request: VoyageRequest) -> dict[str, Any]:
    """Return a steady season's keys for its departure; with a tide, for a window of departures."""
    if departing_at is None:
        return {}
    return departing_at.window if request.tide else departing_at.passage


def _departing(request: VoyageRequest) -> Departing | None:
    """Read the times and speeds of a voyage; return None if no departure was given."""
    faults = Faults()
    found = faults.collect(
        lambda: departing(request.depart, request.until, request.arrive_by, request.speeds)
    )
    if request.tide and not request.depart:
        faults.lines.append("--tide counts from the departure; add --depart 2026-07-01T06:00Z")
    if request.depart and request.months and not (request.speeds or request.tide):
        faults.lines.append("--depart and --month both say when; leave one out")
    if request.until and request.speeds and request.months:
        faults.lines.append(
            "--until looks for the best departure in currents that change; leave it out, or leave "
            "--month out and give a file with time steps: --currents FILE"
        )
    if request.arrive_by and _is_still(request) and not (request.speeds or request.tide):
        faults.lines.append(
            "--arrive-by looks for the latest departure in currents that change; in still water "
            "give --depart alone, and depart earlier by the time by which the vessel is late"
        )
    if faults.lines:
        raise RequestError(faults.lines)
    return found


def _months(request: VoyageRequest) -> list[tuple[str, str]]:
    """Return the months with their titles; for still water without a month, [("", "")]."""
    titles = list(read_months(request.months).items())
    if titles or _is_still(request):
        return titles or [("", "")]
    fault = (
        "no --month; give the month of the voyage, such as --month 2024-07, which may be repeated, "
        "with --currents FILE --depart 2024-07-01T06:00Z for currents that change on the way, or "
        "plan without currents: --currents still"
    )
    raise RequestError(fault)


def _season(
    month: str, title: str, request: VoyageRequest, ends: tuple[Position, Position]
) -> dict[str, Any]:
    """Return the [[seasons]] table of a month, or of still water if the month is ""."""
    if not month:
        return {"name": STILL, "title": "Still water", "currents": [STILL]}
    return {
        "name": month,
        "title": title,
        "valid": month,
        "currents": asked_currents(request.currents) or _known_currents(month, ends),
    }


def _known_currents(month: str, ends: tuple[Position, Position]) -> list[str]:
    """Return the sources of the catalogue with currents of a month between start and goal.

    The service comes first; without an account, a table that comes with RENEW replaces it.
    """
    start, goal = ends
    between = least_region((start.lon, start.lat), (goal.lon, goal.lat))
    tables = [
        name
        for name in catalogue.names("sources")
        if isinstance(catalogue.source(name), catalogue.EmbeddedTableSpec)
    ]

    def covers(name: str) -> bool:
        season = Season(name=month, valid=month, currents=(name,))
        return not current_source(name).uncovered_reason(between, season)

    service = [name for name in _SERVICE if covers(name)]
    return [*service[:1], *filter(covers, tables)] or [_SERVICE[0]]
