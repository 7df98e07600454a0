"""Stations of the tide: harmonic constants over chart datum, from files; and where each one counts.

Files are the tide-database's JSON (openwatersio/tide-database), NOAA's harmonic constants as JSON,
which have no datum, and a TOML file of the user's, which may name one of the others as `constants`
and add what it lacks. Official water levels (S-104) become stations with a zone, one for each zone
of like water.

A station counts in its zone, or near it by water. A spit parts the waters of two stations. Where
nothing lies between, a distance by water is the straight line. Behind land it is the shortest way
along a grid of cells with 16 directions, at most 3 % too long (Dijkstra's algorithm). Land outside
the extent is not known, and hides nothing.
"""

import json
import math
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import shapely
from pydantic import BaseModel, ConfigDict, Field, field_validator

import renew
from pipeline._types import FloatArray, Geometries
from pipeline.errors import Faults, RequestError, refuse_any
from pipeline.geo.projection import METRES_PER_DEGREE, Projection, position_text
from pipeline.machine.paths import NOT_THERE, expanded, shown as shown_path, unreadable_reason
from pipeline.model import Note
from pipeline.model.inputs import TideRange
from pipeline.scenario import catalogue, strict
from pipeline.scenario.model import TideSpec
from pipeline.scenario.strict import NonNegative, Number, near_miss, shown, validated
from pipeline.sources.water_levels import LevelSeries, has_levels, read_levels
from pipeline.texts import clean

# Least number of constants of a tide: M2, S2, K1 and O1.
_LEAST_CONSTANTS = 4
# Sum of amplitudes, m, that no place reaches: larger sums are in feet or centimetres. The largest
# range of the tide is 17 m, in the Bay of Fundy. At Boston, outside it, the sum is 1.23 times half
# of the range from LAT to HAT; so it is some 10.5 m in the bay.
_MOST_M = 12.0
_METRES = {"m", "metre", "metres", "meter", "meters", "metric"}
# Figures among a station's datums that are ranges or intervals, not levels.
_NO_LEVELS = {"GT", "MN", "DHQ", "DLQ", "HWI", "LWI"}
# Zone of a station that counts in the water around its position.
_AROUND = shapely.Polygon()
# A station's file has some kilobytes.
_MAX_BYTES = 4 << 20


@dataclass(frozen=True, slots=True)
class Station:
    """Constants of the tide at a place, over its chart datum.

    `datum` is the chart datum's name, `mean_level_m` mean sea level over it, and `datums` the
    levels of other datums over it, m. `zone` is the water (degrees) whose tide this is; if it is
    empty, the water around `position`. `ratio` and `offset_s` (positive is later) are those of a
    place that follows the station. Official levels are a `series`, instants (n,), s since 1970, and
    levels (n,), m, in place of constants.
    """

    name: str
    constants: Mapping[str, renew.Constant]
    position: tuple[float, float] | None = None
    datum: str = ""
    mean_level_m: float = math.nan
    datums: Mapping[str, float] = field(default_factory=dict)
    ratio: float = 1.0
    offset_s: float = 0.0
    zone: shapely.Polygon | shapely.MultiPolygon = _AROUND
    credit: str = ""
    series: tuple[FloatArray, FloatArray] | None = None

    @property
    def hours(self) -> tuple[datetime, datetime] | None:
        """First and last hour of official levels; None for constants, which have no end."""
        if self.series is None:
            return None
        first, last = (float(self.series[0][end]) for end in (0, -1))
        return datetime.fromtimestamp(first, UTC), datetime.fromtimestamp(last, UTC)

    def tide(self, epoch: datetime | np.datetime64) -> renew.Tide:
        """Return the heights, on a clock that is 0 at the epoch (UTC)."""
        if self.series is not None:
            instants, levels = self.series
            return LevelSeries(
                {}, 0.0, epoch, self.name, self.datum, instants=instants, levels=levels
            )
        return renew.Tide(
            self.constants,
            self.mean_level_m,
            epoch,
            name=self.name,
            datum=self.datum,
            ratio=self.ratio,
            offset=self.offset_s,
        )


def find_station(asked: str | Path) -> Station:
    """Read a station by its name in the catalogue, or by its path.

    Raises RequestError if it is not there, or its file can't be used: one line for each fault.
    """
    named = catalogue.stations()
    if str(asked) in named:
        return read_station(named[str(asked)])
    path = expanded(asked, "tide")
    if reason := unreadable_reason(path):
        known = f", and is no station of the catalogue: {near_miss(str(asked), named)}"
        known = known if reason == NOT_THERE else ""
        raise RequestError(f"tide: {shown_path(asked)} {reason}{known}")
    if has_levels(path):
        raise RequestError(
            f"tide: {shown_path(asked)} has levels at many places, and no constants of one station;"
            " give it as the --tide of a plan, or name a station here"
        )
    return read_station(path)


def read_station(path: Path) -> Station:
    """Read a station's file; RequestError with a line for each fault."""
    faults: list[str] = []
    try:
        station = _read(path, faults)
        faults += _faults(station)
    except RequestError as error:
        faults += error.faults
    refuse_any([f"{shown_path(path.name)}: {fault}" for fault in faults])
    return station


def _read(path: Path, faults: list[str]) -> Station:
    """Read a file of any form; add to the faults. RequestError if it has another form."""
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise RequestError("is too large for a station's constants; give a station's file")
        text = path.read_text("utf-8")
        data = tomllib.loads(text) if path.suffix == ".toml" else json.loads(text)
    except (OSError, ValueError, RecursionError) as error:
        kind = "TOML" if path.suffix == ".toml" else "JSON"
        raise RequestError(f"can't be read as {kind}: {error}; give a station's file") from None
    if path.suffix == ".toml":
        return _own(validated(OwnStation, data, folder=path.parent), path, faults)
    if isinstance(data, dict) and "HarmonicConstituents" in data:
        return _harcon(validated(_Harcon, data), path, faults)
    if isinstance(data, dict) and {"harmonic_constituents", "offsets"} & data.keys():
        return _entry(validated(_Entry, data), faults)
    raise RequestError(
        "is JSON without constants: it has neither 'harmonic_constituents' (tide-database) nor "
        "'HarmonicConstituents' (NOAA); give a station's file"
    )


def _faults(station: Station) -> Iterator[str]:
    """Say what a station lacks, and what can't be right."""
    if not station.datum or math.isnan(station.mean_level_m):
        yield (
            "the chart datum, or mean sea level over it, is missing; give a TOML file with `datum` "
            "and `mean_level_m` that names this file as `constants`"
        )
    amplitudes = [constant.amplitude for constant in station.constants.values()]
    moving = sum(amplitude > 0 for amplitude in amplitudes)
    if moving < _LEAST_CONSTANTS:
        yield (
            f"it has {moving} constants above 0 m, fewer than {_LEAST_CONSTANTS}; give all that "
            "are published"
        )
    if sum(amplitudes) > _MOST_M:
        yield (
            f"its amplitudes sum to {sum(amplitudes):.1f} m, above the {_MOST_M:g} m of any place, "
            "as feet or centimetres would; give metres"
        )
    try:
        level = 0.0 if math.isnan(station.mean_level_m) else station.mean_level_m
        replace(station, mean_level_m=level, name="").tide(np.datetime64(0, "s"))
    except renew.ParameterError as error:
        yield str(error)


def _by_name(
    rows: Iterable[tuple[str, float, float]], faults: list[str]
) -> dict[str, renew.Constant]:
    """Return constants by name; a name that is given twice is a fault."""
    rows = list(rows)
    counts = Counter(name for name, *_ in rows)
    faults += [f"{name} is given {n} times; leave one" for name, n in counts.items() if n > 1]
    return {name: renew.Constant(amplitude, phase) for name, amplitude, phase in rows}


class _Loose(BaseModel):
    """A table in a format that others define: unused keys are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)
    _clean_texts = field_validator("*")(strict.cleaned)


class _EntryRow(_Loose):
    name: str
    amplitude: NonNegative
    phase: Number


class _Entry(_Loose):
    """A station of the tide-database: metres, and phases at Greenwich, in UTC."""

    name: str
    latitude: strict.Latitude
    longitude: strict.Longitude
    type: Literal["reference", "subordinate"] = "reference"
    source: dict[str, Any] = {}
    chart_datum: str = ""
    datums: dict[str, Number] = {}
    offsets: dict[str, Any] = {}
    harmonic_constituents: tuple[_EntryRow, ...] = ()


def _entry(data: _Entry, faults: list[str]) -> Station:
    if data.type == "subordinate" or data.offsets:
        reference = shown(data.offsets.get("reference", "its reference station"))
        raise RequestError(
            "is a subordinate station, without constants of its own; give a TOML file that names "
            f"the file of {reference} as `constants`, with `ratio` and `offset_min`"
        )
    zero = data.datums.get(data.chart_datum, math.nan)
    levels = {name: at - zero for name, at in data.datums.items() if name not in _NO_LEVELS}
    return Station(
        name=data.name,
        constants=_by_name(
            ((row.name, row.amplitude, row.phase) for row in data.harmonic_constituents), faults
        ),
        position=(data.longitude, data.latitude),
        datum=data.chart_datum,
        mean_level_m=levels.get("MSL", math.nan),
        datums=levels,
        credit=", ".join(
            clean(str(data.source[key])) for key in ("name", "id") if data.source.get(key)
        ),
    )


class _HarconRow(_Loose):
    name: str
    amplitude: NonNegative
    phase: Number | None = Field(default=None, alias="phase_GMT")


class _Harcon(_Loose):
    """NOAA's harmonic constants of a station, as its service answers."""

    units: str
    """Unit of the amplitudes. Fetch the file with `harcon.json?units=metric`"""
    rows: tuple[_HarconRow, ...] = Field(alias="HarmonicConstituents")


def _harcon(data: _Harcon, path: Path, faults: list[str]) -> Station:
    if data.units.strip().lower() not in _METRES:
        faults.append(
            f"units = {shown(data.units)}: the amplitudes are not in metres; fetch the file with "
            "`harcon.json?units=metric`"
        )
    if any(row.phase is None for row in data.rows):
        faults.append(
            "phase_GMT is missing: phases of the local clock, or κ, differ from it; give those of "
            "Greenwich, which NOAA's service answers as phase_GMT"
        )
    rows = ((row.name, row.amplitude, row.phase or 0.0) for row in data.rows)
    return Station(
        name=path.stem,
        constants=_by_name(rows, faults),
        credit="US National Oceanic and Atmospheric Administration",
    )


class OwnConstant(strict.StrictModel):
    """A constituent in a file of the user's own."""

    amplitude_m: NonNegative
    phase_deg: Number


class OwnStation(strict.StrictModel):
    """A station of the user's own."""

    constants: dict[str, OwnConstant] | strict.PathText
    phases: Literal["UTC"] | None = None
    name: str = ""
    position: strict.LonLat | None = None
    datum: str = ""
    mean_level_m: Number | None = None
    ratio: NonNegative = 1.0
    offset_min: Number = 0.0
    zone: strict.LonLatRing = ()


def _own(data: OwnStation, path: Path, faults: list[str]) -> Station:
    """Return what a user's file says, and the file that it names."""
    if isinstance(data.constants, str):
        named = Path(data.constants)
        if reason := unreadable_reason(named):
            raise RequestError(f"constants = '{shown_path(named)}' {reason}")
        if named.suffix == ".toml":
            raise RequestError(f"constants = '{shown_path(named)}' is TOML; name a JSON file")
        base = _read(named, faults)
    else:
        if data.phases is None:
            faults.append(
                "phases is missing: those of the local clock, or κ, differ; give phase lags at "
                "Greenwich, and say so: phases = 'UTC'"
            )
        rows = ((name, row.amplitude_m, row.phase_deg) for name, row in data.constants.items())
        base = Station(path.stem, _by_name(rows, faults))
    if data.datum and data.datum != base.datum:
        # Another datum shifts the mean sea level by what the named file says; else it must be
        # given.
        shift = base.datums.get(data.datum, math.nan)
        levels = {} if math.isnan(shift) else {name: z - shift for name, z in base.datums.items()}
        base = replace(base, mean_level_m=base.mean_level_m - shift, datums=levels)
    return replace(
        base,
        name=data.name or base.name,
        position=data.position or base.position,
        datum=data.datum or base.datum,
        mean_level_m=base.mean_level_m if data.mean_level_m is None else data.mean_level_m,
        ratio=data.ratio,
        offset_s=60 * data.offset_min,
        zone=shapely.Polygon(data.zone),
    )


# Distance from a station, true metres, up to which its tide counts.
_REACH_M = 10_000.0
# Number of stations that a message names.
_MAX_NAMED = 3
# Number of cells along the longer side of an extent.
_CELLS = 120
# Share of a cell below which water in it counts as none.
_SLIVER = 1e-3
# Steps of a way along the grid, as cells to the right and up: 8 of 16, the others lead back.
_STEPS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2), (2, -1), (1, -2))


@lru_cache(maxsize=8)
def stations_of(spec: TideSpec) -> tuple[Station, ...]:
    """Read the stations of a scenario; RequestError with the faults of all."""
    faults = Faults()
    official = [path for asked in spec.stations if has_levels(path := Path(asked))]
    stations = [
        faults.collect(partial(find_station, asked))
        for asked in spec.stations
        if Path(asked) not in official
    ]
    zones = faults.collect(lambda: read_levels(official)) or ()
    refuse_any(faults.lines)
    return (
        *(
            Station(zone.source, {}, None, zone.datum, zone=zone.area, series=zone.series)
            for zone in zones
        ),
        *(station for station in stations if station is not None),
    )


def tide_range(spec: TideSpec) -> TideRange:
    """Return the least and greatest height of the tide relied on, over all stations."""
    tides = [station.tide(np.datetime64(0, "s")) for station in stations_of(spec)]
    return TideRange(
        min(tide.lowest for tide in tides) - spec.surge_m,
        max(tide.highest for tide in tides) - spec.surge_m,
    )


def tide_zones(
    stations: Sequence[Station], extent: shapely.Polygon, projection: Projection, land: Geometries
) -> tuple[list[shapely.Geometry], shapely.Geometry]:
    """Return the part of a planar extent, m, in which each station counts, given its `land` (n,).

    A station with a zone counts there. Elsewhere the nearest of the others by water counts, up to
    10 km from it. The second value is the water within 10 km of a station in a straight line, but
    not by water: no station counts there.
    """
    own = [projection.geometry_to_plane(station.zone, _REACH_M) for station in stations]
    rest = shapely.difference(extent, shapely.union_all(own))
    points = [
        None
        if station.position is None or not station.zone.is_empty
        else shapely.Point(projection.to_plane(station.position))
        for station in stations
    ]
    near = [point for point in points if point is not None]
    cells = shapely.get_parts(shapely.voronoi_polygons(shapely.MultiPoint(near), extend_to=extent))
    parts = list[shapely.Geometry]()
    for point, zone in zip(points, own, strict=True):
        if point is None:
            parts.append(shapely.intersection(zone, extent))
            continue
        cell = extent if len(near) == 1 else cells[shapely.intersects(cells, point)][0]
        circle = shapely.buffer(point, _REACH_M / projection.scale)
        parts.append(shapely.intersection(shapely.intersection(cell, circle), rest))
    far = shapely.Polygon()
    if near and len(land) and not rest.is_empty:
        far = _part_by_land(parts, points, rest, land, _REACH_M / projection.scale)
    return parts, far


def _part_by_land(
    zones: list[shapely.Geometry],
    points: Sequence[shapely.Point | None],
    rest: shapely.Polygon,
    land: Geometries,
    reach: float,
) -> shapely.Geometry:
    """Give each cell of water to the station nearest by water, where land is in the straight line.

    Changes `zones`. Returns the cells that lose their station, as every station is farther than
    `reach` by water. `points` are the stations that count in the `rest` of the extent. Water that
    is not joined with any of them keeps its zone: no route leads there.
    """
    which = np.array([at for at, point in enumerate(points) if point is not None])
    stations = shapely.get_coordinates([points[at] for at in which])
    boxes, places, apart = distances_by_water(stations, rest, land)
    least = apart.min(axis=0)
    by_water = np.where(least <= reach, which[apart.argmin(axis=0)], -1)
    by_line = np.full(len(boxes), -1)
    for at in which:
        by_line[shapely.contains_xy(zones[at], places)] = at
    moves = (by_water != by_line) & np.isfinite(least)
    for at in which:
        gained = shapely.union_all(boxes[moves & (by_water == at)])
        lost = shapely.union_all(boxes[moves & (by_line == at)])
        zones[at] = shapely.intersection(
            shapely.union(shapely.difference(zones[at], lost), gained), rest
        )
    return shapely.intersection(shapely.union_all(boxes[moves & (by_water < 0)]), rest)


def distances_by_water(
    stations: FloatArray, extent: shapely.Polygon, land: Geometries
) -> tuple[Geometries, FloatArray, FloatArray]:
    """Return cells (n,) with water, a place (n, 2) in each, and its distances (s, n) to stations.

    All is in planar metres; `stations` are (s, 2). A cell that no water joins with a station is
    infinitely far from it.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    xmin, ymin, xmax, ymax = extent.bounds
    side = max(xmax - xmin, ymax - ymin) / _CELLS
    nx, ny = math.ceil((xmax - xmin) / side), math.ceil((ymax - ymin) / side)
    column, row = (axis.ravel() for axis in np.meshgrid(np.arange(nx), np.arange(ny)))
    left, low = xmin + side * column, ymin + side * row
    boxes = shapely.box(left, low, left + side, low + side)
    dry = shapely.union_all(land)
    shapely.prepare(dry)
    places = np.stack([left, low], axis=1) + side / 2
    covered = np.flatnonzero(shapely.contains_xy(dry, places))
    rest = shapely.difference(boxes[covered], dry)
    is_wet = shapely.area(rest) > _SLIVER * side**2
    # The place of a cell without water is no number.
    places[covered] = np.nan
    places[covered[is_wet]] = shapely.get_coordinates(shapely.point_on_surface(rest[is_wet]))
    wet = np.isfinite(places[:, 0])
    number = np.where(wet, np.cumsum(wet) - 1, -1).reshape(ny, nx)
    boxes, places = boxes[wet], places[wet]
    # Stations are nodes after the cells. One on land, as on a pier, has the water nearest to it.
    offsets = np.linalg.norm(stations[:, None] - places[None], axis=2)
    begins = stations.copy()
    on_land = shapely.contains_xy(dry, stations)
    begins[on_land] = places[offsets[on_land].argmin(axis=1)]
    count, all_places = len(places), np.vstack([places, begins])
    pairs = [
        np.stack([np.full(count, count + at), np.arange(count)], axis=1)
        for at in range(len(stations))
    ]
    for right, up in _STEPS:
        here = number[max(-up, 0) : ny - max(up, 0), : nx - right]
        there = number[max(up, 0) : ny + min(up, 0), right:]
        both = np.stack([here.ravel(), there.ravel()], axis=1)
        pairs.append(both[(both >= 0).all(axis=1)])
    ends = np.concatenate(pairs)
    begin, end = ends[~shapely.intersects(dry, shapely.linestrings(all_places[ends]))].T
    # No way has length 0, which a sparse matrix would leave out.
    length = np.linalg.norm(all_places[end] - all_places[begin], axis=1) + 1e-9
    size = len(all_places)
    graph = coo_matrix((length, (begin, end)), shape=(size, size)).tocsr()
    apart = dijkstra(graph, directed=False, indices=np.arange(count, size))[:, :count]
    return boxes, places, apart + np.where(on_land, offsets.min(axis=1), 0.0)[:, None]


def level_notes(stations: Sequence[Station], surge_m: float) -> Iterator[Note]:
    """Yield notes on official levels: their hours, and stations whose tide is too high beside them.

    A station's tide is too high for water within its reach where the levels are at some hour lower
    by more than `surge_m`.
    """
    official = [station for station in stations if station.series is not None]
    for source, hours in {station.name: station.hours for station in official}.items():
        if hours is not None:
            yield Note.of("levels-relied-on", source=source, begin=hours[0], until=hours[1])
    for gauge in stations:
        if gauge.series is not None or gauge.position is None:
            continue
        tide, (lon, lat) = gauge.tide(np.datetime64(0, "s")), gauge.position
        up = _REACH_M / METRES_PER_DEGREE
        aside = up / math.cos(math.radians(lat))
        turns = np.linspace(0.0, 2 * np.pi, 65)
        reach = shapely.polygons(
            np.stack([lon + aside * np.cos(turns), lat + up * np.sin(turns)], axis=-1)
        )
        area = shapely.area(shapely.intersection([zone.zone for zone in official], reach))
        lower_m = np.zeros(len(official))
        for at in np.flatnonzero(area):
            instants, levels = official[at].series or ((), ())
            lower_m[at] = (tide.heights(np.asarray(instants)) - levels).max()
        if (is_lower := lower_m > surge_m).any():
            yield Note.of(
                "levels-below-tide",
                station=gauge.name,
                share=float(area[is_lower].sum() / area.sum()),
                most_m=float(lower_m.max()),
                surge_m=surge_m,
            )


def refuse_far_water(
    place: shapely.Point, stations: Sequence[Station], projection: Projection
) -> None:
    """Raise RequestError for tidal water at a planar place that no station counts for."""
    lonlat = projection.to_lonlat(shapely.get_coordinates(place)[0]).tolist()
    apart = sorted(
        (float(place.distance(shapely.Point(projection.to_plane(station.position)))), station.name)
        for station in stations
        if station.position is not None
    )
    named = [
        f"{name} ({d * projection.scale / 1000:.0f} km in a straight line)"
        for d, name in apart[:_MAX_NAMED]
    ]
    raise RequestError(
        f"tide.stations: the water at {position_text(*lonlat)} is deep enough for some hours only, "
        f"and no station counts there: the nearest is {', '.join(named) or 'none with a position'},"
        f" and {_REACH_M / 1000:g} km is the most. Add a station, "
        "or give one a zone in a TOML file"
    )
