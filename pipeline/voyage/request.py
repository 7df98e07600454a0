"""The requests of a voyage, before it begins and under way: the tables of their options.

Of a voyage's options some go together, and some exclude each other.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any

from pipeline.errors import RequestError
from pipeline.voyage.positions import EXAMPLES, Position, read_end, read_position, read_stop
from pipeline.voyage.readers import (
    RANGE,
    above_0_m_s,
    described_file,
    dimension_m,
    read_charts,
    read_clearance_m,
    read_currents,
    read_members,
    read_months,
    read_name,
    read_padding_m,
    read_shortfall,
    read_station,
    read_variables,
    read_vessel,
    readable,
    speed_or_range,
    zoned_time,
)
from pipeline.voyage.table import Asker, Option, each, read, read_folder

if TYPE_CHECKING:
    from pipeline.scenario.catalogue import VesselSpec

STILL_WATER = ("still",)
"""The currents of a voyage in still water."""
SNAP_M = 500.0
"""How far a stop on land is moved to water, m: a town's name or a quay lies that far inland."""
# Largest numbers of points on the way, of months and of files that a page may ask for: more are a
# slip, or are given to the command line.
_MAX_VIA = 20
_MAX_MONTHS = 12
_MAX_FILES = 32
_FIELDS = "give a NetCDF, Zarr or GRIB file"
_vessel, _when, _water, _limits, _output = (
    partial(Option, group=group) for group in ("Vessel", "When", "Water", "Limits", "Output")
)
_time = partial(_when, kind="time", read=zoned_time)
_other = partial(Option, group="Other options")


@dataclass(frozen=True, kw_only=True)
class VoyageRequest:
    """A voyage to plan. An option that is left out is None or empty, and the run chooses.

    Speeds are in m/s, lengths in m, times in UTC. `speed` is the vessel's, or the lowest and the
    highest to choose from. `turning_circle` is its diameter, as in a ship's trial manoeuvres.
    """

    start: Annotated[
        Position,
        Option(
            group="",
            kind="place",
            read=read_end,
            example="12.80N 120.30E",
            help=f"Position at which the voyage begins: {EXAMPLES}.",
        ),
    ]
    goal: Annotated[
        Position,
        Option(
            group="",
            kind="place",
            read=read_end,
            example="7.70N 116.80E",
            help="Position at which it ends.",
        ),
    ]
    vessel: Annotated[
        "VesselSpec | None",
        _vessel(
            read=read_vessel,
            section="vessels",
            example="Its own figures",
            help="A vessel of the catalogue, or the path of a TOML file.",
        ),
    ] = None
    speed: Annotated[
        float | tuple[float, float] | None,
        _vessel(
            read=speed_or_range,
            example="12kn",
            help="Speed through water, such as 12kn or 6m/s, in place of {vessel}. Or a range, "
            "such as 4kn..9kn, also with {vessel}: the planner then chooses a speed for each leg, "
            "for least fuel between {depart} and {arrive_by}.",
        ),
    ] = None
    length: Annotated[
        float | None,
        _vessel(read=dimension_m, example="90m", help="Length of the vessel, as 90m, 300ft."),
    ] = None
    turning_circle: Annotated[
        float | None,
        _vessel(
            read=dimension_m,
            example="400m",
            help="Diameter of the turning circle, helm hard over, as 400m.",
        ),
    ] = None
    draught: Annotated[
        float | None,
        _vessel(
            read=dimension_m,
            example="4m; for depths",
            help="Draught, as 4m; charts with depths need it.",
        ),
    ] = None
    months: Annotated[
        tuple[str, ...],
        _when(
            read=read_months,
            name="month",
            most=_MAX_MONTHS,
            label="Months",
            example="2024-07, 2024-12",
            help="Month of the voyage, as 2024-07; may be repeated: each is a season.",
        ),
    ] = ()
    depart: Annotated[
        datetime | None,
        _time(
            label="Departure",
            example="2026-11-22T06:00Z",
            help="Departure with its time zone, as 2026-11-22T06:00Z, in place of {months}. The "
            "currents then change during the voyage, with the time steps of {currents} or with "
            "the service's hourly ones.",
        ),
    ] = None
    until: Annotated[
        datetime | None,
        _time(
            label="Latest departure",
            example="2026-11-24T06:00Z",
            help="Latest departure: the best one from {depart} until then is chosen.",
        ),
    ] = None
    arrive_by: Annotated[
        datetime | None,
        _time(
            example="2026-11-26T06:00Z",
            help="Latest arrival: the vessel leaves as late as possible, but not before {depart}; "
            "with a range of {speed} it leaves at {depart}.",
        ),
    ] = None
    currents: Annotated[
        tuple[str, ...],
        _water(
            kind="source",
            read=read_currents,
            most=_MAX_FILES,
            section="sources",
            help="A NetCDF, GRIB or Zarr file of currents, in place of the chosen ones; may be "
            "repeated for files that belong together, or given as a quoted pattern: 'daily*.nc'. "
            "Or a source of the catalogue; 'still' plans without currents.",
        ),
    ] = ()
    current_variables: Annotated[
        tuple[str, str] | None,
        _water(
            read=read_variables,
            metavar="U,V",
            label="Variables of the current",
            example="found by their names",
            help="The two variables of {currents} that are the current, east and north, or speed "
            "and direction, as water_u,water_v; by default they are found by their names.",
        ),
    ] = None
    via: Annotated[
        tuple[Position, ...],
        _limits(
            read=each(read_stop),
            most=_MAX_VIA,
            metavar="POSITION",
            label="Point on the way",
            help="Point that the route must pass, written like the start; may be repeated, in the "
            "order of passing. 'POSITION wait 6h' is an anchorage, where the vessel may wait for "
            "water or current.",
        ),
    ] = ()
    avoid: Annotated[
        tuple[dict[str, Any], ...],
        _limits(
            kind="file",
            read=each(
                described_file("give a vector file, such as GeoJSON", ("layer", "crs", "radius"))
            ),
            most=_MAX_FILES,
            metavar="FILE",
            layer="polygon",
            label="Shut areas, a vector file",
            help="GeoJSON or other vector file of areas that no route may enter; may be repeated. "
            "'FILE,layer=NAME', ',crs=EPSG:4326' and ',radius=50m' as for {charts}.",
        ),
    ] = ()
    havens: Annotated[
        Path | None,
        _limits(
            kind="file",
            read=readable("give a GeoJSON file of points"),
            metavar="FILE",
            layer="point",
            label="Havens, a file of points",
            help="GeoJSON or other file of points, or CSV with name, lon and lat: from where "
            "along the route is one of them reached {within} a time, or with the {endurance} that "
            "is left?",
        ),
    ] = None
    within: Annotated[
        str,
        _limits(
            label="A haven within",
            example="6h",
            help="Longest time to a haven, as 6h; needs {havens}.",
        ),
    ] = ""
    endurance: Annotated[
        str,
        _limits(
            example="48h",
            help="Time under way for which there is fuel at departure, as 2d; needs {havens}.",
        ),
    ] = ""
    waves: Annotated[
        tuple[Path, ...],
        _limits(
            kind="file",
            read=each(readable(_FIELDS)),
            most=_MAX_FILES,
            metavar="FILE",
            label="Wave heights, files",
            help="Files of the significant wave height, NetCDF, Zarr or GRIB; may be repeated. "
            "Water is shut while they are over {max_wave}; needs {depart}.",
        ),
    ] = ()
    max_wave: Annotated[
        float | None,
        _limits(
            read=dimension_m,
            label="Highest waves",
            example="1.2m",
            help="Greatest significant wave height in which the vessel goes, as 1.2m; by default "
            "that of the vessel. Needs {waves}.",
        ),
    ] = None
    wind: Annotated[
        tuple[Path, ...],
        _limits(
            kind="file",
            read=each(readable(_FIELDS)),
            most=_MAX_FILES,
            metavar="FILE",
            label="Wind, files",
            help="Files of the wind at 10 m, NetCDF, Zarr or GRIB; may be repeated. Water is shut "
            "while it is over {max_wind}; needs {depart}.",
        ),
    ] = ()
    max_wind: Annotated[
        float | None,
        _limits(
            read=above_0_m_s,
            label="Strongest wind",
            example="12m/s",
            help="Strongest mean wind in which the vessel goes, as 12m/s or 25kn; by default that "
            "of the vessel. Needs {wind}.",
        ),
    ] = None
    wait: Annotated[
        str,
        _limits(
            label="Longest wait for water to open",
            example="1d",
            help="Longest time to wait at the start, and wherever else the vessel can hold its "
            "place, until {waves} or {wind} open water, as 6h or 1d; never if left out.",
        ),
    ] = ""
    clearance_m: Annotated[
        float | None,
        _limits(
            read=read_clearance_m,
            name="clearance",
            label="Least clearance",
            example="500m; chosen if left out",
            help="Least distance from no-go areas, true metres; chosen if left out.",
        ),
    ] = None
    padding: Annotated[
        str | float | None,
        _limits(
            read=read_padding_m,
            example="adaptive",
            help="Room for hard-over turns around land: 'adaptive', as turns in the current need; "
            "'triangle', as published; 'none'; or the same true metres everywhere.",
        ),
    ] = None
    shortfall: Annotated[
        str,
        _limits(
            read=read_shortfall,
            label="Where no way keeps the padding",
            example="least",
            help="What to do where no way keeps adaptive {padding}: 'least' keeps as much as there "
            "is room for, and lists each stretch without room for a hard-over turn; 'refuse'.",
        ),
    ] = "least"
    adrift: Annotated[
        str,
        _limits(
            label="Off land without thrust, at least",
            example="6h",
            help="Least time that the current takes to carry a vessel without thrust to land, as "
            "6h, from anywhere on a route but near its two ends. Needs {months}, or still water.",
        ),
    ] = ""
    snap_m: Annotated[
        float,
        _limits(
            read=read_clearance_m,
            name="snap",
            label="Off land, at most",
            example="500m",
            help="How far a start, goal or point on land is moved to the nearest water that joins "
            "them all; the result says so. With 0 it is refused.",
        ),
    ] = SNAP_M
    charts: Annotated[
        tuple[dict[str, Any], ...],
        _water(
            kind="file",
            read=read_charts,
            most=_MAX_FILES,
            metavar="FILE",
            layer="polygon",
            label="Land, a vector file",
            help="A vector file or a folder of S-57 cells, in place of the chosen chart; may be "
            "repeated, also with osm-land, the world's land: what one of them shuts is shut. "
            "'FILE,layer=NAME', ',crs=EPSG:4326', ',radius=50m' (around its points and lines) and "
            "',accuracy=5m' say what the file does not.",
        ),
    ] = ()
    depths: Annotated[
        dict[str, str] | None,
        _water(
            kind="file",
            read=described_file("give a grid of depths, such as GEBCO's", ("positive",)),
            label="Depths, a grid",
            help="A grid of depths, NetCDF as of GEBCO, EMODnet or a model, S-102, BAG or GeoTIFF: "
            "too shallow water is no-go; needs {draught}. 'FILE,positive=up' (heights in metres), "
            "or 'down' (depths), says what the file does not.",
        ),
    ] = None
    datum: Annotated[
        str,
        _water(
            label="Chart datum",
            example="MLLW",
            help="Chart datum of the depths, as the tide's station names it, such as MLLW, where "
            "the chart does not state it; {tide} needs it with {depths}.",
        ),
    ] = ""
    tide: Annotated[
        tuple[str, ...],
        _limits(
            kind="source",
            read=each(read_station),
            most=_MAX_FILES,
            metavar="STATION",
            section="stations",
            label="Station of the tide",
            example="None",
            help="Tide station of the catalogue, a file of harmonic constants, or official water "
            "levels (S-104); may be repeated. Needs {draught}, {depart} and a chart with depths.",
        ),
    ] = ()
    members: Annotated[
        dict[str, Any] | None,
        _water(
            read=read_members,
            metavar="KIND",
            label="Members of the current",
            example="files, realization or 0.1m/s",
            help="Plan in currents that may each come true: 'files', if each file of {currents} "
            "is one, a dimension of them, such as 'realization', or 0.2m/s for the currents with "
            "random eddies of that speed (rms).",
        ),
    ] = None
    explain_gap: Annotated[
        bool,
        _output(
            kind="flag",
            label="Explain the optimality gap",
            help="Report the parts of the optimality gap; this may take as long as planning.",
        ),
    ] = False
    name: Annotated[
        str, _output(read=read_name, is_of_run=True, help="Name of the folder of results.")
    ] = ""
    output: Annotated[
        Path,
        _output(
            kind="folder",
            read=read_folder,
            is_of_run=True,
            help="Folder of all results; each scenario has its own folder in it.",
        ),
    ] = Path("outputs")
    offline: Annotated[
        bool, _water(kind="flag", is_of_run=True, help="Use no source that needs the network.")
    ] = False
    strict: Annotated[
        bool,
        _water(
            kind="flag",
            is_of_run=True,
            help="Plan nothing and exit with code 1 if a season's first choice of currents can't "
            "be used.",
        ),
    ] = False

    @property
    def is_still(self) -> bool:
        """Whether the voyage is planned in still water, so that its times do not matter."""
        return self.currents == STILL_WATER

    @property
    def chooses_speeds(self) -> bool:
        """Whether a speed is chosen for each leg."""
        return isinstance(self.speed, tuple)

    @property
    def is_steady(self) -> bool:
        """Whether the currents are monthly means or none, whether or not a departure is given."""
        has_hours = self.tide or self.waves or self.wind
        has_months = bool(self.chooses_speeds or has_hours) and bool(self.months)
        return self.depart is None or self.is_still or has_months


def read_voyage(given: Mapping[str, Any], asker: Asker, known: Sequence[str] = ()) -> VoyageRequest:
    """Read the options of a voyage; the faults spell them as `asker` does.

    Raises RequestError with a line for each fault, after those `known` before.
    """
    return read(VoyageRequest, given, asker, faults_of_pairs, known)


def faults_of_pairs(
    values: SimpleNamespace, asked: SimpleNamespace, at: SimpleNamespace
) -> Iterator[str]:
    """Yield what is wrong between the options of a voyage.

    `values` are those that could be read, `asked` all as they were given, `at` their names.
    """
    is_range = isinstance(values.speed, tuple) or RANGE in str(asked.speed)
    yield from _faults_of_vessel(asked, at, is_range=is_range)
    yield from _faults_of_times(values, asked, at, is_range=is_range)
    yield from _faults_of_months(asked, at, is_range=is_range)
    yield from _faults_of_files(asked, at, values.vessel)
    if values.tide:
        yield from _faults_of_stations(values.tide)


def _faults_of_vessel(
    asked: SimpleNamespace, at: SimpleNamespace, *, is_range: bool
) -> Iterator[str]:
    """Yield what is wrong between a vessel and its figures."""
    figures = {name: getattr(asked, name) for name in ("speed", "length", "turning_circle")}
    lacking = [getattr(at, name) for name, figure in figures.items() if not figure]
    if is_range and asked.vessel:
        del figures["speed"]
    named = {**figures, "draught": asked.draught}
    given = [getattr(at, name) for name, figure in named.items() if figure]
    if asked.vessel:
        if given:
            yield (
                f"{at.vessel} {asked.vessel} and {', '.join(given)} both describe the vessel; "
                "leave one out"
            )
    elif lacking:
        which = f"the vessel lacks {', '.join(lacking)}" if given else "no vessel"
        yield (
            f"{which}; give {at.vessel} NAME (`renew list`), {at.vessel} FILE, or its figures: "
            f"{at.speed} 12kn {at.length} 90m {at.turning_circle} 400m"
        )


def _faults_of_times(
    values: SimpleNamespace, asked: SimpleNamespace, at: SimpleNamespace, *, is_range: bool
) -> Iterator[str]:
    """Yield what is wrong between departure, arrival and speeds."""
    later = ("until", "arrive_by")
    for name in later:
        if getattr(asked, name) and not asked.depart:
            yield (
                f"{getattr(at, name)} needs {at.depart}, the earliest departure; add {at.depart}"
            )
    if is_range and not asked.arrive_by:
        lacking = at.arrive_by if asked.depart else f"{at.depart} and {at.arrive_by}"
        yield (
            f"{at.speed} {asked.speed} is a range, to save fuel between the times {at.depart} and "
            f"{at.arrive_by}; add {lacking}, or give one speed"
        )
    if asked.until and asked.arrive_by and not is_range:
        yield (f"{at.until} and {at.arrive_by} both say how to choose the departure; leave one out")
    for name in later:
        time = getattr(values, name)
        if values.depart is not None and time is not None and time <= values.depart:
            yield (
                f"{getattr(at, name)} {getattr(asked, name)} is not after {at.depart} "
                f"{asked.depart}; give a later time"
            )
    for name in ("tide", "waves", "wind"):
        if getattr(asked, name) and not asked.depart:
            option = getattr(at, name)
            yield f"{option} counts from the departure; add {at.depart} 2026-07-01T06:00Z"


def _faults_of_months(
    asked: SimpleNamespace, at: SimpleNamespace, *, is_range: bool
) -> Iterator[str]:
    """Yield what is wrong between times and currents."""
    is_still = tuple(map(str, asked.currents or ())) == STILL_WATER
    needs_time = is_range or asked.tide or asked.waves or asked.wind
    if asked.depart and asked.months and not needs_time:
        yield f"{at.depart} and {at.months} both say when; leave one out"
    if asked.until and is_range and asked.months:
        yield (
            f"{at.until} looks for the best departure in currents that change; leave it out, or "
            f"leave {at.months} out and give a file with time steps: {at.currents} FILE"
        )
    if asked.arrive_by and is_still and not needs_time:
        yield (
            f"{at.arrive_by} looks for the latest departure in currents that change; in still "
            f"water give {at.depart} alone, and depart earlier by the time by which the vessel is "
            "late"
        )
    if not (asked.months or is_still or asked.depart or asked.until or asked.arrive_by):
        yield (
            f"no {at.months}; give the month of the voyage, such as {at.months} 2024-07, which may "
            f"be repeated, with {at.currents} FILE {at.depart} 2024-07-01T06:00Z for currents that "
            f"change on the way, or plan without currents: {at.currents} still"
        )


def _faults_of_files(
    asked: SimpleNamespace, at: SimpleNamespace, vessel: "VesselSpec | None"
) -> Iterator[str]:
    """Yield what is wrong between havens and their limits, and between files and their options."""
    limits = [getattr(at, name) for name in ("within", "endurance") if getattr(asked, name)]
    if limits and not asked.havens:
        verb = "limit" if len(limits) > 1 else "limits"
        yield f"{', '.join(limits)} {verb} the way to a haven; add {at.havens} FILE"
    power = vessel and vessel.power
    if asked.havens and not limits and not (power and power.usable_j):
        yield f"{at.havens} needs a limit; add {at.within} 6h or {at.endurance} 2d, or both"
    for limit, file in (("max_wave", "waves"), ("max_wind", "wind")):
        if getattr(asked, limit) and not getattr(asked, file):
            yield f"{getattr(at, limit)} needs a forecast; add {getattr(at, file)} FILE"
    if asked.wait and not (asked.waves or asked.wind):
        yield f"{at.wait} waits for weather; add {at.waves} FILE or {at.wind} FILE"
    if asked.current_variables and not asked.currents:
        yield f"{at.current_variables} are those of files; add {at.currents} FILE"
    if asked.datum and not asked.charts and not asked.depths:
        yield (f"{at.datum} = {asked.datum!r} is of charted depths; add {at.depths} or {at.charts}")


def _faults_of_stations(stations: tuple[str, ...]) -> Iterator[str]:
    """Yield what is wrong in the files of stations of the tide."""
    from pipeline.scenario.model import TideSpec
    from pipeline.sources.tide_stations import stations_of

    try:
        stations_of(TideSpec(stations=stations))
    except RequestError as error:
        yield from error.faults


def _heading(degrees: float) -> float:
    """Check a true heading, degrees."""
    if not 0 <= degrees <= 360:
        raise ValueError(
            f"{degrees:g} is no true heading; give degrees from 0 to 360, clockwise from north"
        )
    return float(degrees)


@dataclass(frozen=True, kw_only=True)
class UnderWayRequest:
    """Where the vessel is, when, on which true heading (degrees), and what has changed.

    `departed` is when it left, if the plan does not say so. Without `currents` those of the plan
    hold. `name` is that of the new results.
    """

    results: Annotated[
        Path,
        Option(
            group="",
            kind="folder",
            metavar="RESULTS",
            help="Folder of a finished run, such as outputs/NAME.",
        ),
    ]
    at: Annotated[
        Position,
        _other(
            read=read_position,
            metavar="POSITION",
            help="Where the vessel is, as '119.95E 9.99N'.",
        ),
    ]
    time: Annotated[
        datetime,
        _other(read=zoned_time, metavar="TIME", help="When it is there, as 2026-11-22T09:30Z."),
    ]
    heading_deg: Annotated[
        float | None,
        _other(
            name="heading",
            kind="number",
            read=_heading,
            metavar="DEGREES",
            help="Its true heading, from which the route begins with a turn; by default it begins "
            "on the best heading.",
        ),
    ] = None
    currents: Annotated[
        tuple[str, ...],
        _other(
            kind="source",
            read=tuple,
            most=32,
            help="The new currents, as for `renew run`; by default those of the plan hold.",
        ),
    ] = ()
    season: Annotated[str, _other(help="The season that is sailed, if several were planned.")] = ""
    departed: Annotated[
        datetime | None,
        _other(
            read=zoned_time,
            metavar="TIME",
            help="When the vessel left, as 2026-11-22T06:00Z, if the plan has no departure.",
        ),
    ] = None
    name: Annotated[str, _other(help="Name of the folder of results.")] = ""
    offline: Annotated[bool, _other(kind="flag", help="Use no source that needs the network.")] = (
        False
    )
