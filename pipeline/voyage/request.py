"""Make the scenario of a one-line request; all faults of the request are reported together."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.errors import RequestError
from pipeline.machine.paths import resolved
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.loading import asked_currents, parse_scenario
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import STILL, Season
from pipeline.sources.registry import current_source
from pipeline.stages.choosing.coverage import least_region
from pipeline.voyage.departing import Departing, departing
from pipeline.voyage.months import read_months
from pipeline.voyage.positions import Position, read_positions, read_via
from pipeline.voyage.quantities import RANGE, length_m
from pipeline.voyage.vessel_options import VesselFigures, vessel_spec

# Datasets of the service with monthly means, the best first; the first that has the month is used.
_SERVICE = (
    "copernicus-glorys-monthly",
    "copernicus-forecast-monthly",
    "copernicus-glorys-climatology",
)


# The service's hourly dataset, with tide and Stokes drift, for currents that change on the way.
_SERVICE_STEPS = "copernicus-total-hourly"


@dataclass(frozen=True, slots=True)
class VoyageRequest:
    """A requested voyage; an option that was left out is empty.

    Attributes
    ----------
    positions : start and goal as command-line arguments: the first half is the start.
    vessel : a name of the catalogue, the path of a file, or a complete specification.
    figures : the vessel's speed and dimensions, in place of `vessel`.
    months : 'YYYY-MM', each a season.
    currents : sources of the catalogue in order of preference, and files that belong together;
        'still' plans without currents.
    clearance : a length; if "", an offing is chosen.
    charts : a vector file or a folder of S-57 cells.
    depths : a grid of depths in NetCDF.
    name : name of the scenario, and of its folder of results.
    depart : departure with its time zone, in place of months; the currents change on the way.
    until : the latest departure: the best one from `depart` until then is chosen.
    arrive_by : the latest arrival: the vessel departs as late as possible or, with a range of
        speeds, at `depart`.
    speeds : range of speeds through water to choose from, "4kn..9kn"; the currents are the monthly
        ones if months are given, else they change on the way.
    via : positions that the route passes in this order.
    avoid : vector files of areas that no route may enter.
    """

    positions: tuple[str, ...]
    vessel: str | VesselSpec = ""
    figures: VesselFigures | None = None
    months: tuple[str, ...] = ()
    currents: tuple[str, ...] = ()
    clearance: str = ""
    charts: Path | None = None
    depths: Path | None = None
    name: str = ""
    depart: str = ""
    until: str = ""
    arrive_by: str = ""
    speeds: str = ""
    via: tuple[str, ...] = ()
    avoid: tuple[Path, ...] = ()


def voyage_scenario(request: VoyageRequest) -> tuple[Scenario, tuple[str, ...]]:
    """Return the scenario of a request, without a region, and notes on ambiguous positions.

    Raises
    ------
    RequestError
        The message has a line for each fault.
    """
    faults: list[str] = []

    def part(read: Callable[[], Any]) -> Any:  # noqa: ANN401 - each part has its own type
        try:
            return read()
        except RequestError as error:
            faults.extend(error.faults)
            return None

    ends = part(lambda: read_positions(request.positions))
    via = part(lambda: read_via(request.via, ends[0].lon if ends else 0.0))
    vessel = part(lambda: _vessel(request))
    clearance_m = part(lambda: _clearance_m(request.clearance))
    departing_at = part(lambda: _departing(request))
    is_timed = bool(request.depart or request.until or request.arrive_by)
    is_steady = not is_timed or _has_steady_speeds(request)
    months = part(lambda: _months(request)) if is_steady else []
    if faults:
        raise RequestError(faults)
    start, goal = ends
    data: dict[str, Any] = {
        "schema_version": 1,
        "name": request.name or _name(start, goal),
        "title": f"{_spelled(start)} to {_spelled(goal)}",
        "vessel": vessel.model_dump(exclude_defaults=True),
        "start": [start.lon, start.lat],
        "goal": [goal.lon, goal.lat],
        "seasons": [departing_at.season(asked_currents(request.currents) or [_SERVICE_STEPS])]
        if departing_at is not None and not is_steady
        else [
            {
                **_season(month, title, request, (start, goal)),
                **(departing_at.passage if departing_at is not None else {}),
            }
            for month, title in months
        ],
    }
    if via:
        data["via"] = [[point.lon, point.lat] for point in via]
    if request.avoid:
        data["avoid"] = [{"path": str(resolved(path, "--avoid"))} for path in request.avoid]
    if clearance_m is not None:
        data["planner"] = {"clearance": clearance_m}
    if request.charts is not None:
        data["chart"] = {"source": {"path": str(resolved(request.charts, "--charts"))}}
    if request.depths is not None:
        chart = data.setdefault("chart", {})
        chart["depths"] = str(resolved(request.depths, "--depths"))
    notes = tuple(end.note for end in (*ends, *via) if end.note)
    return parse_scenario(data), notes


def _vessel(request: VoyageRequest) -> VesselSpec:
    """Return the requested vessel."""
    if not isinstance(request.vessel, str):
        return request.vessel
    figures = request.figures or VesselFigures()
    if request.speeds and not request.vessel:
        # The turning circle is given for the highest speed.
        figures = replace(figures, speed=request.speeds.partition(RANGE)[2])
    return vessel_spec(request.vessel, figures)


def _has_steady_speeds(request: VoyageRequest) -> bool:
    """Whether speeds are chosen in steady currents: monthly means or still water."""
    return bool(request.speeds) and (bool(request.months) or request.currents == (STILL,))


def _clearance_m(text: str) -> float | None:
    """Read the clearance, true metres; return None if it was left out."""
    if not text:
        return None
    try:
        metres = length_m(text)
    except ValueError as error:
        raise RequestError([f"--clearance {error}"]) from None
    if metres < 0:
        raise RequestError([f"--clearance {text} is below 0; give metres, 0 or more"])
    return metres


def _departing(request: VoyageRequest) -> Departing | None:
    """Read the times and speeds of a voyage; return None if no departure was given."""
    faults: list[str] = []
    found = None
    try:
        found = departing(request.depart, request.until, request.arrive_by, request.speeds)
    except RequestError as error:
        faults += error.faults
    if request.depart and request.months and not request.speeds:
        faults.append("--depart and --month both say when; leave one out")
    if request.until and _has_steady_speeds(request):
        faults.append(
            "--until looks for the best departure in currents that change; leave it out, or leave "
            "--month out and give a file with time steps: --currents FILE"
        )
    if request.depart and request.currents == (STILL,) and not request.speeds:
        faults.append(
            "--depart needs currents with time steps: give the file with --currents tide.nc, or "
            "leave --currents out for the service's"
        )
    if faults:
        raise RequestError(faults)
    return found


def _months(request: VoyageRequest) -> list[tuple[str, str]]:
    """Return the months with their titles; for still water without a month, [("", "")]."""
    titles = list(read_months(request.months).items())
    if titles or request.currents == (STILL,):
        return titles or [("", "")]
    fault = (
        "no --month; give the month of the voyage, such as --month 2024-07, which may be repeated, "
        "with --currents FILE --depart 2024-07-01T06:00Z for currents that change on the way, or "
        "plan without currents: --currents still"
    )
    raise RequestError([fault])


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


def _name(start: Position, goal: Position) -> str:
    """Return the name of a voyage, made of the degrees and minutes of start and goal."""
    return f"{_short(start)}-to-{_short(goal)}"


def _short(position: Position) -> str:
    """Return a position as part of a name: 12n48-120e18."""
    lon = (position.lon + 180) % 360 - 180
    parts = []
    for degrees, letters in ((position.lat, "ns"), (lon, "ew")):
        minutes = round(abs(degrees) * 60)
        parts.append(f"{minutes // 60}{letters[degrees < 0]}{minutes % 60:02d}")
    return "-".join(parts)


def _spelled(position: Position) -> str:
    """Return a position for a title: 12.80 N 120.30 E."""
    lon = (position.lon + 180) % 360 - 180
    return f"{abs(position.lat):.2f} {'NS'[position.lat < 0]} {abs(lon):.2f} {'EW'[lon < 0]}"
