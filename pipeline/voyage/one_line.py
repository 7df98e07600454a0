"""Plan a voyage in one call: make its scenario from the request, and run it."""

import inspect
import math
import textwrap
from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from pipeline.errors import NoPlanError
from pipeline.findings.names import MANIFEST
from pipeline.findings.text import moment_text
from pipeline.machine.paths import short_path
from pipeline.run import Event, EventHandler, Outcome, ignore, run
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.loading import asked_currents, parse_scenario, scenario_text
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import STILL, Season, departure_name, period
from pipeline.scenario.strict import validated
from pipeline.sources.registry import current_source
from pipeline.stages.region import are_water_swapped, least_region, require_sailable
from pipeline.voyage import positions
from pipeline.voyage.request import SNAP_M, VoyageRequest, read_voyage
from pipeline.voyage.table import help_text, options, spelling

# Datasets of the service with monthly means, the best first; the first that has the month is used.
_SERVICE = (
    "copernicus-glorys-monthly",
    "copernicus-forecast-monthly",
    "copernicus-glorys-climatology",
)

# The service's hourly dataset, with tide and Stokes drift, for currents that change on the way.
_SERVICE_STEPS = "copernicus-total-hourly"
# Largest number of departures in the first sample of a window.
_MAX_DEPARTURES = 25
# Least time between two departures of that sample.
_MIN_STEP = timedelta(minutes=30)
# The planner adds departures until the best is known to this share of the window,
_PROVEN_SHARE = 1 / 48
# or to this time, if that is shorter.
_MAX_PROVEN = timedelta(hours=1)
_MINUTE = timedelta(minutes=1)
# Exponent of the fuel law of a vessel that is given by figures: the propeller law of displacement
# hulls, because its engine is not known.
_FUEL_EXPONENT = 3.0


def go(
    start: str | tuple[float, float],
    goal: str | tuple[float, float],
    *,
    vessel: str | VesselSpec | None = None,
    speed: str | tuple[float, float] = "",
    length: str = "",
    turning_circle: str = "",
    draught: str = "",
    months: Sequence[str] = (),
    depart: datetime | None = None,
    until: datetime | None = None,
    arrive_by: datetime | None = None,
    currents: Sequence[str | Path] = (),
    current_variables: str | Sequence[str] = "",
    via: Sequence[str | tuple[float, float]] = (),
    avoid: Sequence[str | Path] = (),
    havens: Path | None = None,
    within: str = "",
    endurance: str = "",
    clearance_m: float | None = None,
    padding: str | float | None = None,
    shortfall: str = "least",
    adrift: str = "",
    snap_m: float = SNAP_M,
    charts: str | Path | Sequence[str | Path] = (),
    depths: Path | None = None,
    datum: str = "",
    tide: Sequence[str | Path] = (),
    waves: Sequence[str | Path] = (),
    max_wave: str = "",
    wind: Sequence[str | Path] = (),
    max_wind: str = "",
    members: str = "",
    name: str = "",
    output: Path = Path("outputs"),
    offline: bool = False,
    strict: bool = False,
    on_event: EventHandler | None = None,
) -> Outcome:
    """Plan a voyage and write its results to `output/<name>/`, as `renew go` does.

    Positions are texts, or (lon, lat) in degrees; times have a zone. `vessel` may also be a
    `VesselSpec`. A range of speeds may also be a pair in m/s.

    Parameters
    ----------
    {parameters}
    on_event
        Called with each event of the run.

    Raises
    ------
    RequestError
        The request is wrong; the message has a line for each fault. Nothing was written but, of a
        voyage without a way, its scenario.
    StageError
        The voyage can't be planned for another reason, or the results can't be written.
    """
    request = read_voyage(dict(locals()), "python")
    scenario, notes = voyage_scenario(request)
    on_event = on_event or ignore
    for note in notes:
        on_event(Event("fetch", "note", detail=note))
    return run_or_keep(request, scenario, said=notes, on_event=on_event)


def _parameters() -> str:
    """Return the section of `go`'s docstring on its arguments, from the table of options."""
    at = spelling(VoyageRequest, "python")
    return "\n".join(
        f"{option.field}\n{textwrap.indent(textwrap.fill(help_text(option, at), 88), '    ')}"
        for option in options(VoyageRequest)
    )


go.__doc__ = inspect.cleandoc(str(go.__doc__)).replace("{parameters}", _parameters())


def run_voyage(request: VoyageRequest, scenario: Scenario, **reports: Any) -> Outcome:
    """Run a voyage's scenario, after a quick check of its currents and its stops.

    `reports` are the arguments of `pipeline.run.run` that report the run: `said`, `on_event`,
    `on_step` and `on_result`.
    """
    require_sailable(scenario)
    offline, strict = request.offline, request.strict
    return run(scenario, request.output, offline=offline, strict=strict, **reports)


def run_or_keep(request: VoyageRequest, scenario: Scenario, **reports: Any) -> Outcome:
    """Run a voyage's scenario; write the scenario of one that is refused, to be changed."""
    try:
        return run_voyage(request, scenario, **reports)
    except NoPlanError as error:
        folder = request.output / scenario.name
        if (folder / MANIFEST).exists():  # of an earlier run
            raise
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / "scenario.toml"
        file.write_text(scenario_text(scenario), encoding="utf-8")
        said = f"its scenario is in {short_path(file)}: change it there, and give it to renew run"
        raise type(error)([*error.faults, said]) from error


def voyage_scenario(request: VoyageRequest) -> tuple[Scenario, tuple[str, ...]]:
    """Return the scenario of a request, without a region, and notes on ambiguous positions.

    Raises RequestError with a line for each fault.
    """
    start, goal = positions.joined(request.start, request.goal)
    via = tuple(positions.continued(point, start.lon) for point in request.via)
    about = _given(members=request.members, current_variables=request.current_variables)
    planner = {"snap": request.snap_m, "shortfall": request.shortfall}
    planner |= _given(adrift=request.adrift)
    widths = {"clearance": request.clearance_m, "padding": request.padding}
    data: dict[str, Any] = {
        "schema_version": 1,
        "name": request.name or positions.voyage_name(start, goal),
        "title": f"{positions.spelled(start)} to {positions.spelled(goal)}",
        "vessel": _vessel(request).model_dump(exclude_defaults=True),
        "start": [start.lon, start.lat],
        "goal": [goal.lon, goal.lat],
        "via": [
            {"at": [one.lon, one.lat], "wait": one.wait} if one.wait else [one.lon, one.lat]
            for one in via
        ],
        "seasons": [season | about for season in _seasons(request, (start, goal))],
        "planner": planner | {key: width for key, width in widths.items() if width is not None},
        **_tables_of_files(request),
    }
    scenario = parse_scenario(data)
    places = (start, goal, *via)
    doubtful = [(place.lon, place.lat) for place in places if place.either_order]
    # How a position was read is no news if the other order of its figures is not possible.
    is_doubtful = bool(doubtful) and are_water_swapped(scenario, doubtful)
    notes = tuple(one.note for one in places if one.note and (is_doubtful or not one.either_order))
    has_hours = request.tide or request.waves or request.wind
    if request.until and request.is_still and not has_hours:
        notes += (
            "in still water no later departure needs less fuel: the vessel leaves at the first",
        )
    return scenario, notes


def _vessel(request: VoyageRequest) -> VesselSpec:
    """Return the requested vessel, by its name or its figures.

    Its turn rate is its highest speed divided by the radius of its turning circle.
    """
    if request.vessel is not None:
        return request.vessel
    speed = request.speed[1] if isinstance(request.speed, tuple) else request.speed
    circle_m = request.turning_circle
    assert speed is not None  # noqa: S101 - a request without a vessel has its figures
    assert circle_m is not None  # noqa: S101
    figures = {
        "speed_m_s": speed,
        "length_m": request.length,
        "draught_m": request.draught,
        "turn_rate_deg_s": math.degrees(speed / (circle_m / 2)),
        "fuel_exponent": _FUEL_EXPONENT,
        "origin": f"Figures of the request; turning circle {circle_m:g} m; propeller law",
    }
    return validated(VesselSpec, figures)


def _given(**entries: object) -> dict[str, Any]:
    """Return the entries of a table that are not empty."""
    return {key: entry for key, entry in entries.items() if entry}


def _tables_of_files(request: VoyageRequest) -> dict[str, Any]:
    """Return the tables of a scenario that name files: chart, areas to avoid, havens and tide."""
    depths = request.depths or {}
    chart = _given(
        source=list(request.charts),
        depths=depths.get("path"),
        depths_positive=depths.get("positive"),
        datum=request.datum,
    )
    limits = _given(within=request.within, endurance=request.endurance)
    return _given(
        chart=chart,
        avoid=list(request.avoid),
        havens=request.havens and {"path": str(request.havens), **limits},
        tide=request.tide and {"stations": list(request.tide)},
        limits=_given(
            waves=list(map(str, request.waves)),
            wave_m=request.max_wave,
            wind=list(map(str, request.wind)),
            wind_m_s=request.max_wind,
        ),
    )


def _seasons(
    request: VoyageRequest, ends: tuple[positions.Position, positions.Position]
) -> Iterator[dict[str, Any]]:
    """Yield the [[seasons]] tables: of each month, of still water, or of a departure."""
    if not request.is_steady:
        yield _changing_season(request)
        return
    # With a tide over the depths the departure is chosen within a window, also in a steady current.
    has_hours = request.tide or request.waves or request.wind
    when = _window(request) if has_hours else _passage(request)
    if not request.months:
        yield {"name": STILL, "title": "Still water", "currents": [STILL], **when}
    for month in request.months:
        yield {
            "name": month,
            "title": f"{period(month).begin:%B %Y}",
            "valid": month,
            "currents": asked_currents(request.currents) or _known_currents(month, ends),
            **when,
        }


def _passage(request: VoyageRequest) -> dict[str, Any]:
    """Return the keys of a season for departure, latest arrival and speeds."""
    least, most = request.speed if isinstance(request.speed, tuple) else (None, None)
    speed = _given(least=least, most=most)
    return _given(departure=request.depart, arrive_by=request.arrive_by, speed=speed)


def _window(request: VoyageRequest) -> dict[str, Any]:
    """Return the keys of a season for the departures to choose from, latest arrival and speeds."""
    passage = _passage(request)
    if request.depart is None or request.until is None:
        return passage
    window = request.until - request.depart
    step = max(_MIN_STEP, math.ceil(window / (_MAX_DEPARTURES - 1) / _MINUTE) * _MINUTE)
    departures = {
        "first": passage.pop("departure"),
        "every": f"{step // _MINUTE}min",
        "count": window // step + 1,
    }
    if window % step:  # the end of the window is a departure to choose from, too
        departures["last"] = request.until
    return passage | {"departures": departures}


def _changing_season(request: VoyageRequest) -> dict[str, Any]:
    """Return the [[seasons]] table of a voyage in changing currents.

    With a tide over the depths no bound is known for departures between those planned, so that
    `to_within` is left out.
    """
    begin = request.depart
    assert begin is not None  # noqa: S101 - currents change from a departure on
    title, when = f"Departure {moment_text(begin)}", _window(request)
    if request.arrive_by is not None:
        title = f"Arrival by {moment_text(request.arrive_by)}"
    if request.until is not None:
        title = f"Departure from {moment_text(begin)} to {moment_text(request.until)}"
        within = min((request.until - begin) * _PROVEN_SHARE, _MAX_PROVEN)
        if not (request.chooses_speeds or request.tide or request.waves or request.wind):
            when["to_within"] = f"{math.ceil(within / _MINUTE)}min"
    return {
        "name": departure_name(begin),
        "title": title,
        **when,
        "time_method": "changing",
        "currents": asked_currents(request.currents) or [_SERVICE_STEPS],
    }


def _known_currents(month: str, ends: tuple[positions.Position, positions.Position]) -> list[str]:
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
