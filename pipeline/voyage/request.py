"""The requests of a voyage, before it begins and under way; `options.toml` describes their options.

An option's annotation has its type and, if it is not taken as it is given, its reader. Of a
voyage's options some go together, and some exclude each other.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any

from pipeline.errors import RequestError
from pipeline.voyage import readers
from pipeline.voyage.positions import Position, read_end, read_position, read_stop, spelled
from pipeline.voyage.table import Asker, each, read, read_folder, spelling

if TYPE_CHECKING:
    from pipeline.scenario.catalogue import VesselSpec

STILL_WATER = ("still",)
"""The currents of a voyage in still water."""
SNAP_M = 500.0
"""How far a stop on land is moved to water, m: a town's name or a quay lies that far inland."""
_FIELDS = "give a NetCDF, Zarr or GRIB file"


@dataclass(frozen=True, kw_only=True)
class VoyageRequest:
    """A voyage to plan. An option that is left out is None or empty, and the run chooses.

    Speeds are in m/s, lengths in m, times in UTC. `speed` is the vessel's, or the lowest and the
    highest to choose from. `turning_circle` is its diameter, as in a ship's trial manoeuvres.
    """

    start: Annotated[Position, read_end]
    goal: Annotated[Position, read_end]
    vessel: Annotated["VesselSpec | None", readers.read_vessel] = None
    speed: Annotated[float | tuple[float, float] | None, readers.speed_or_range] = None
    length: Annotated[float | None, readers.dimension_m] = None
    turning_circle: Annotated[float | None, readers.dimension_m] = None
    draught: Annotated[float | None, readers.dimension_m] = None
    months: Annotated[tuple[str, ...], readers.read_months] = ()
    depart: Annotated[datetime | None, readers.zoned_time] = None
    until: Annotated[datetime | None, readers.zoned_time] = None
    arrive_by: Annotated[datetime | None, readers.zoned_time] = None
    currents: Annotated[tuple[str, ...], readers.read_currents] = ()
    current_variables: Annotated[tuple[str, str] | None, readers.read_variables] = None
    via: Annotated[tuple[Position, ...], each(read_stop)] = ()
    avoid: Annotated[
        tuple[dict[str, Any], ...],
        each(
            readers.described_file(
                "give a vector file, such as GeoJSON", ("layer", "crs", "radius")
            )
        ),
    ] = ()
    havens: Annotated[Path | None, readers.readable("give a GeoJSON file of points")] = None
    within: Annotated[str, readers.read_interval] = ""
    endurance: Annotated[str, readers.read_interval] = ""
    waves: Annotated[tuple[Path, ...], each(readers.readable(_FIELDS))] = ()
    max_wave: Annotated[float | None, readers.dimension_m] = None
    wind: Annotated[tuple[Path, ...], each(readers.readable(_FIELDS))] = ()
    max_wind: Annotated[float | None, readers.above_0_m_s] = None
    clearance_m: Annotated[float | None, readers.read_clearance_m] = None
    padding: Annotated[str | float | None, readers.read_padding_m] = None
    shortfall: Annotated[str, readers.read_shortfall] = "least"
    adrift: Annotated[str, readers.read_interval] = ""
    snap_m: Annotated[float, readers.read_clearance_m] = SNAP_M
    charts: Annotated[tuple[dict[str, Any], ...], readers.read_charts] = ()
    depths: Annotated[
        dict[str, str] | None,
        readers.described_file("give a grid of depths, such as GEBCO's", ("positive",)),
    ] = None
    datum: str = ""
    tide: Annotated[tuple[str, ...], each(readers.read_station)] = ()
    members: Annotated[dict[str, Any] | None, readers.read_members] = None
    name: Annotated[str, readers.read_name] = ""
    output: Annotated[Path, read_folder] = Path("outputs")
    offline: bool = False
    strict: bool = False

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
    request = read(VoyageRequest, given, asker, faults_of_pairs, known)
    if faults := list(_refused(request, spelling(VoyageRequest, asker))):
        raise RequestError(faults)
    return request


def _refused(request: VoyageRequest, at: SimpleNamespace) -> Iterator[str]:
    """Yield the options that don't go together, by the scenarios' table of pairs."""
    from pipeline.scenario.pairs import met

    waits, changes = any(point.wait for point in request.via), not request.is_steady
    speeds = request.chooses_speeds and f"{at.speed} LEAST..MOST"
    called = {
        "a [tide]": request.tide and at.tide,
        "[limits]": (request.waves and at.waves) or (request.wind and at.wind),
        "[havens]": request.havens and at.havens,
        "planner.adrift": request.adrift and at.adrift,
        "via points": request.via and at.via,
        "a wait at an anchorage": waits and f"a wait in {at.via}",
        "'members'": request.members and at.members,
        "'departures'": request.until and at.until,
        "'arrive_by'": request.arrive_by and at.arrive_by,
        "'speed'": speeds,
        "'speed' in a current that changes": changes and speeds,
        "time_method = 'changing'": changes and f"{at.depart} (currents that change)",
    }
    if request.members and request.members.get("along") and request.is_still:
        yield f"{at.members} are those of files; add {at.currents} FILE, or give a speed: 0.2m/s"
    for pair, both in met({feature: option for feature, option in called.items() if option}):
        yield f"{both}: {pair.reason}; leave one of the two out"
    has_clock = changes or request.tide or request.waves or request.wind
    if waits and not (request.depart and has_clock):
        yield (
            f"a wait in {at.via} waits for nothing: give {at.depart} with {at.tide}, {at.waves}, "
            f"{at.wind} or {at.currents} FILE, which change with time, or leave the wait out"
        )


def faults_of_pairs(
    values: SimpleNamespace, asked: SimpleNamespace, at: SimpleNamespace
) -> Iterator[str]:
    """Yield what is wrong between the options of a voyage.

    `values` are those that could be read, `asked` all as they were given, `at` their names.
    """
    is_range = isinstance(values.speed, tuple) or readers.RANGE in str(asked.speed)
    yield from _faults_of_vessel(asked, at, is_range=is_range)
    yield from _faults_of_times(values, asked, at, is_range=is_range)
    yield from _faults_of_months(asked, at, is_range=is_range)
    yield from _faults_of_files(asked, at, values.vessel)
    if values.start and values.goal and values.via:
        yield from _faults_of_via((values.start, values.goal), values.via, at.via)
    if values.tide:
        yield from _faults_of_stations(values.tide)


def _faults_of_vessel(
    asked: SimpleNamespace, at: SimpleNamespace, *, is_range: bool
) -> Iterator[str]:
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
    if asked.current_variables and not asked.currents:
        yield f"{at.current_variables} are those of files; add {at.currents} FILE"
    if asked.datum and not asked.charts and not asked.depths:
        yield (f"{at.datum} = {asked.datum!r} is of charted depths; add {at.depths} or {at.charts}")


def _faults_of_via(ends: Sequence[Position], via: Sequence[Position], option: str) -> Iterator[str]:
    """Yield points in another sea than start and goal, unless these are one harbour: a slip."""
    from pyproj import Geod

    direct, *away = (
        float(Geod(ellps="WGS84").inv(one.lon, one.lat, other.lon, other.lat)[2]) / 1000
        for one, other in (ends, *((point, end) for point in via for end in ends))
    )
    for point, off in zip(via, map(min, away[::2], away[1::2]), strict=True):
        if direct > 10 and off > max(1_000, 10 * direct):
            yield (
                f"{option} {spelled(point)} lies {off:,.0f} km from start and goal, which are "
                f"{direct:,.0f} km apart; correct it, or plan to it and from it as two voyages"
            )


def _faults_of_stations(stations: tuple[str, ...]) -> Iterator[str]:
    from pipeline.scenario.model import TideSpec
    from pipeline.sources.tide_stations import stations_of

    try:
        stations_of(TideSpec(stations=stations))
    except RequestError as error:
        yield from error.faults


def _heading(degrees: float) -> float:
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

    results: Path
    at: Annotated[Position, read_position]
    time: Annotated[datetime, readers.zoned_time]
    heading_deg: Annotated[float | None, _heading] = None
    currents: Annotated[tuple[str, ...], tuple] = ()
    season: str = ""
    departed: Annotated[datetime | None, readers.zoned_time] = None
    name: str = ""
    offline: bool = False
