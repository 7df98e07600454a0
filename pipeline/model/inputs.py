"""The interfaces of sources, and what they deliver: land, depths and currents, with their notes.

A note is something that a reader should know besides the result. It has a kind and values; the
words are made from these elsewhere.
"""

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

import renew
from pipeline._types import BoolArray, FloatArray
from pipeline.errors import RequestError
from pipeline.geo.projection import Bounds, DepthCover, KnownCells, position_text
from pipeline.scenario.season import Season
from pipeline.texts import clean, table_beside


@dataclass(frozen=True, slots=True)
class DepthArea:
    """Water of a chart between two depths in metres at chart datum, NaN where not charted.

    A negative depth dries. `area` is in lon/lat degrees.
    """

    kind: Literal["natural", "dredged"]
    least_m: float
    greatest_m: float
    area: BaseGeometry


@dataclass(frozen=True, slots=True)
class TideRange:
    """The least and the greatest height (m over chart datum) of the tide that is relied on."""

    lowest_m: float
    highest_m: float


NO_TIDE = TideRange(0.0, 0.0)
"""Water without a tide, always at chart datum."""


@dataclass(frozen=True, slots=True)
class DepthRule:
    """Which charted depths (m) are deep enough for a vessel.

    `safety_depth_m` is draught, squat and under-keel clearance, `tide` the range of the tide.
    """

    safety_depth_m: float
    tide: TideRange = NO_TIDE

    @property
    def least_m(self) -> float:
        """Depth below which water is never deep enough."""
        return self.safety_depth_m - self.tide.highest_m

    def need_m(self, depth_m: float) -> float:
        """Return the height of tide that water of a charted depth needs."""
        return self.safety_depth_m - depth_m

    def is_tidal(self, depth_m: float) -> bool:
        """Whether water of a charted depth is deep enough for some hours only."""
        return self.least_m <= depth_m < self.safety_depth_m - self.tide.lowest_m


@dataclass(frozen=True, slots=True)
class TidalWater:
    """Water that is deep enough for some hours only, and the height of tide that it needs.

    The height is in metres over chart datum, `area` in lon/lat degrees. `name` says what the chart
    shows there.
    """

    name: str
    need_m: float
    area: BaseGeometry


@dataclass(frozen=True, slots=True)
class Place:
    """A place in degrees, or in a plane's metres."""

    x: float
    y: float
    is_planar: bool = False

    @property
    def text(self) -> str:
        """The place for a reader."""
        return (
            f"({self.x:.6g}, {self.y:.6g}) m" if self.is_planar else position_text(self.x, self.y)
        )


@dataclass(frozen=True, slots=True)
class Note:
    """Something that a reader should know; `pipeline.findings.note_words` puts it in words.

    `kind` is one of the kinds for which there are words. `values` are the figures by their names:
    numbers, names, places, dates, other notes, tuples of them; units are in the names. `cases` are
    those that the note is about; empty if it is about all.
    """

    kind: str
    values: tuple[tuple[str, object], ...] = ()
    cases: tuple[str, ...] = ()

    @classmethod
    def of(cls, kind: str, **values: object) -> "Note":
        """Return a note of a kind; its texts are cleaned, as they may quote a file or a library."""
        cleaned = ((k, clean(v) if isinstance(v, str) else v) for k, v in values.items())
        return cls(kind, tuple(cleaned))

    @property
    def is_decision(self) -> bool:
        """Whether it reports a choice that a name, an order or a default made, not the user."""
        return self.kind in DECIDED

    def about(self, *cases: str) -> "Note":
        """Return the note about some cases."""
        return replace(self, cases=cases)


KINDS: dict[str, list[str]] = table_beside(__file__, "notes.toml")
"""Kinds of notes by their group."""
DECIDED, NOT_KNOWN = frozenset(KINDS["decided"]), frozenset(KINDS["unknown"])

Say = Callable[[Note], None]
"""Reports a note while a stage is at work."""


def of_cases(notes: Mapping[str, Iterable[Note]]) -> tuple[Note, ...]:
    """Merge notes by case: each note occurs once, and names all its cases."""
    cases: dict[Note, list[str]] = {}
    for case, own in notes.items():
        for note in dict.fromkeys(own):
            cases.setdefault(note, []).append(case)
    return tuple(note.about(*names) for note, names in cases.items())


@dataclass(frozen=True, slots=True)
class Credit:
    """A source that was used, and the credit line that its licence requires."""

    name: str
    kind: Literal["land", "current"]
    text: str
    licence: str
    url: str = ""
    retrieved: str = ""


@dataclass(frozen=True, slots=True)
class Zone:
    """An area of a chart to be shown on maps (lon/lat degrees).

    A `shoal` is too shallow for the vessel, a `hazard` lies in water that is deep enough, an
    `uncharted` area is covered by no source. All three are no-go, and also among the polygons of
    their Land. A `restricted` area and a `traffic` scheme may be entered; `rule` is the chart's
    rule there for a passing vessel, if any. The user's areas are `shut` at the hours of their
    rule. The traffic of a lane has a true course; None where it is not known.
    """

    kind: Literal["shoal", "hazard", "uncharted", "restricted", "traffic", "shut"]
    name: str
    rule: str
    area: BaseGeometry
    course_deg: float | None = None


@dataclass(frozen=True, slots=True)
class PlaceName:
    """A chart's name for some land: a point on it (degrees), and how large it is (square degrees).

    Areas are compared with each other only.
    """

    name: str
    lon: float
    lat: float
    area_deg2: float


@dataclass(frozen=True, slots=True)
class Land:
    """All that no route may enter (lon/lat degrees), in the region and a little beyond.

    That is land and, on charts with depths, also shallow water, hazards and uncharted areas.
    `accuracy_m` is how far the source's coast may lie from the true one, in metres. `credits` has
    one entry per source, `notes` are about the chart, `zones` are areas to be shown. `second_shore`
    is the land of an independent shoreline, where there is one: no route need avoid it, but a route
    crosses it only where the two shorelines disagree. A route that gets further than `refused_m`
    (m) into this land is refused. `places` are the chart's names of land, where it has any.
    `depths` says where the chart has depths; None where it has none at all. `depth_areas` are its
    areas of equal depth, where it has any. `tidal_water` is deep enough for some hours; `datum` is
    the chart datum of the depths, "" where the chart does not state it.
    """

    polygons: tuple[Polygon, ...]
    credits: tuple[Credit, ...]
    accuracy_m: float
    notes: tuple[Note, ...] = ()
    zones: tuple[Zone, ...] = ()
    second_shore: tuple[Polygon, ...] = ()
    refused_m: float = math.inf
    places: tuple[PlaceName, ...] = ()
    depths: DepthCover | None = None
    depth_areas: tuple[DepthArea, ...] = ()
    tidal_water: tuple[TidalWater, ...] = ()
    datum: str = ""

    @property
    def no_go_name(self) -> str:
        """Readers' word for areas that no route may enter."""
        return no_go_name(has_depths=self.depths is not None)


def no_go_name(*, has_depths: bool) -> str:
    """Readers' word for areas that no route may enter: with depths they are more than land."""
    return "no-go areas" if has_depths else "land"


@dataclass(frozen=True, slots=True, eq=False)
class MemberGrid:
    """A member of a current on its source's grid: `u`, `v` (nt, ny, nx), m/s to east and north.

    `weight` is how likely it is; the sum over all members is 1.
    """

    name: str
    u: FloatArray
    v: FloatArray
    weight: float


@dataclass(frozen=True, slots=True)
class CurrentGrid:
    """A case's surface current on a lon/lat grid, at one or several times.

    Attributes
    ----------
    lon, lat : (nx,) and (ny,), ascending, degrees.
    u, v : (nt, ny, nx), m/s to east and to north; NaN where the source has no water, which is the
        same at all times.
    times_s : (nt,), ascending, seconds since the case's departure; one if the current is steady.
    valid : the time that the field is valid for, as the source names it.
    notes : about the field, for a reader.
    files : names and hashes of the files it came from.
    climatology_for : the case's own time, if a climatology stands in for that time; else "".
    passed_over : sources that the scenario prefers to this one, in its order, each with the
        reason why it could not be used, in one line.
    members : the fields of which this one is the mean, on the same nodes and at the same times.
    weak : (ny, nx), of tidal streams: where their constants explain too little of the variance of
        the currents that they were fitted to.
    """

    case: str
    lon: FloatArray
    lat: FloatArray
    u: FloatArray
    v: FloatArray
    valid: str
    credit: Credit
    notes: tuple[Note, ...] = ()
    files: tuple[tuple[str, str], ...] = ()
    climatology_for: str = ""
    passed_over: tuple[tuple[str, str], ...] = ()
    times_s: FloatArray = field(default_factory=lambda: np.zeros(1))
    weak: BoolArray | None = None
    members: tuple[MemberGrid, ...] = ()

    @property
    def cells(self) -> KnownCells:
        """Which of its cells have a figure."""
        return KnownCells(self.lon, self.lat, np.isfinite(self.u[0]) & np.isfinite(self.v[0]))

    @property
    def changes(self) -> bool:
        """Whether it changes during the voyage."""
        return len(self.times_s) > 1

    @property
    def at_departure(self) -> tuple[FloatArray, FloatArray]:
        """The components (ny, nx) at departure, linear between the times around it."""
        if not self.changes:
            return self.u[0], self.v[0]
        after = int(np.clip(np.searchsorted(self.times_s, 0.0), 1, len(self.times_s) - 1))
        begin, end = self.times_s[after - 1 : after + 1]
        share = float(np.clip(-begin / (end - begin), 0.0, 1.0))
        u, v = ((1 - share) * part[after - 1] + share * part[after] for part in (self.u, self.v))
        return u, v

    @property
    def is_left_out(self) -> bool:
        """Whether its case was planned without a current, as in still water."""
        return any(note.kind == "still-water" for note in self.notes)

    @property
    def is_stand_in(self) -> bool:
        """Whether this is not the current that the scenario asks for first."""
        return bool(self.passed_over or self.climatology_for)

    @property
    def stand_in_notes(self) -> tuple[Note, ...]:
        """The current that the case was planned in, if that is not its first choice."""
        source, valid, asked = self.credit.name, self.valid, self.climatology_for
        if asked:
            return (Note.of("climatology-stands-in", source=source, valid=valid, asked=asked),)
        used = Note.of("current-stands-in", source=source, valid=valid)
        return (used,) if self.passed_over else ()


@dataclass(frozen=True, slots=True, eq=False)
class LimitedField:
    """Wind or waves (nt, ny, nx) at lon (nx,), lat (ny,) and `times_s` (nt,) since departure.

    `name` is as messages call it; above the `limit`, in its `unit`, the vessel does not go.
    """

    name: str
    unit: str
    limit: float
    lon: FloatArray
    lat: FloatArray
    times_s: FloatArray
    values: FloatArray

    def at(self, lonlat: FloatArray, times_s: FloatArray) -> FloatArray:
        """Return the values (n,) at lon/lat (n, 2) and times (n,), s, linear between nodes.

        Beyond the nodes and the times the nearest one's counts.
        """
        from scipy.interpolate import RegularGridInterpolator

        axes = (self.times_s, self.lat, self.lon)
        places = (times_s, lonlat[:, 1], lonlat[:, 0])
        inside = [np.clip(at, axis[0], axis[-1]) for at, axis in zip(places, axes, strict=True)]
        return np.asarray(RegularGridInterpolator(axes, self.values)(np.column_stack(inside)))


def bilinear(grid: CurrentGrid, lonlat: FloatArray, step: int = 0) -> FloatArray:
    """Interpolate east and north velocity (..., 2), m/s, bilinearly at lon/lat (..., 2).

    `step` is the index of one of the grid's times. Gaps are filled first. Points beyond the grid
    get the value at its nearest edge.
    """
    east, north = np.moveaxis(fill_gaps(np.stack([grid.u[step], grid.v[step]], axis=-1)), -1, 0)
    return renew.GriddedCurrent(grid.lon, grid.lat, east, north)(lonlat)


def fill_gaps(field: FloatArray) -> FloatArray:
    """Fill the NaN of a field (ny, nx, 2) outward from its values, ring by ring.

    A filled cell is the mean of those of its eight neighbours that are known. Known values stay
    unchanged.
    """
    from scipy import ndimage

    field = np.array(field, dtype=float)
    known = np.isfinite(field).all(axis=-1)
    if not known.any():
        raise RequestError("the current has no values at all; name another source in 'currents'")
    field[~known] = 0.0
    ring_and_middle = np.ones((3, 3))
    while not known.all():
        count = ndimage.convolve(known.astype(float), ring_and_middle, mode="constant")
        total = ndimage.convolve(field, ring_and_middle[..., None], mode="constant")
        ring = ~known & (count > 0)
        field[ring] = total[ring] / count[ring][:, None]
        known |= ring
    return field


@dataclass(frozen=True, slots=True)
class Fetched:
    """Data from the sources: land, and one current grid per case.

    Attributes
    ----------
    currents : empty for a plane scenario, which gives its current as numbers.
    notes : about the data, and about preferred sources that were passed over.
    surroundings : land outside the region (lon/lat degrees), coarse and for maps only; empty where
        no source has the world's land.
    land_key, current_keys : the keys of the land and of each case's current in the store.
    failures : the reasons why cases have no current, by case.
    weather : wind and waves by case, and by the keys of their limits.
    """

    land: Land
    currents: tuple[CurrentGrid, ...]
    notes: tuple[Note, ...] = ()
    surroundings: tuple[Polygon, ...] = ()
    land_key: str = ""
    current_keys: Mapping[str, str] = field(default_factory=dict)
    failures: Mapping[str, str] = field(default_factory=dict)
    weather: Mapping[str, Mapping[str, CurrentGrid]] = field(default_factory=dict)

    @property
    def weather_credits(self) -> tuple[Credit, ...]:
        """The sources of wind and waves, each once."""
        every = (grid.credit for grids in self.weather.values() for grid in grids.values())
        return tuple(dict.fromkeys(every))

    @property
    def stand_in_notes(self) -> tuple[Note, ...]:
        """Notes that only name a current used in place of a first choice."""
        return of_cases({grid.case: grid.stand_in_notes for grid in self.currents})


def current_notes(currents: Iterable[CurrentGrid]) -> tuple[Note, ...]:
    """Notes on the currents of all cases, and on the sources passed over for them."""
    return of_cases(
        {
            grid.case: (
                *[Note.of("current-changes", steps=len(grid.times_s))] * grid.changes,
                *grid.notes,
                *(
                    Note.of("source-passed-over", source=source, reason=reason)
                    for source, reason in grid.passed_over
                ),
                *grid.stand_in_notes,
            )
            for grid in currents
        }
    )


@dataclass(frozen=True, slots=True)
class Issue:
    """Which issue of its data a source has now.

    `reference` is the reference time of a forecast or analysis (aware, UTC), `last_step` its last
    time step, `first_step` the first that is of use; each None where the source does not say it.
    `digest` is a hash of the data, or of a version that stands for them.
    """

    reference: datetime | None
    first_step: datetime | None
    last_step: datetime | None
    digest: str


class LandSource(Protocol):
    """Land polygons for a region."""

    @property
    def identity(self) -> tuple[str, ...]:
        """Everything but the region that the land depends on: releases, file hashes."""
        ...

    def land(self, region: Polygon) -> Land:
        """Return the land near a region (lon/lat degrees)."""
        ...


class CurrentSource(Protocol):
    """Surface currents for a region and a case; by default local, without an account."""

    def needs_network(self, region: Polygon, case: Season, folder: Path) -> bool:
        """Whether `current` would download, given the files cached in the folder."""
        del region, case, folder
        return False

    def identity(self, case: Season) -> tuple[str, ...]:
        """Everything but the region that the current depends on: dataset, time, file hashes."""
        ...

    def unavailable_reason(self) -> str:
        """Say why the source can't be used now, with the remedy; empty when it can."""
        return ""

    def uncovered_reason(self, region: Polygon, case: Season) -> str:
        """Say for which part of the region or case there are no data, with the remedy, or ""."""
        del region, case
        return ""

    def covered_bounds(self, region: Polygon, case: Season) -> Bounds | None:
        """Return the bounds of the part of a region's bounds for which there are data, or None.

        Where a source can't be read there is no such part; `uncovered_reason` says why.
        """
        ...

    def refusal(
        self, name: str, region: Polygon, case: Season, folder: Path, *, offline: bool
    ) -> str:
        """Say why the source, of a name, can't be used now, with the remedy; empty when it can."""
        uncovered = self.uncovered_reason(region, case)
        if uncovered or not self.needs_network(region, case, folder):
            return uncovered
        if offline:
            return f"{name} needs the network; leave --offline out"
        return self.unavailable_reason()

    def issue(self, case: Season) -> Issue:
        """Return which issue of the data there is now.

        Raises StageError if the service does not say it; RequestError if the user's own file is not
        there, or invalid.
        """
        ...

    def current(self, region: Polygon, case: Season, land: Land, folder: Path) -> CurrentGrid:
        """Return the current of a case in a region, lon/lat degrees, on the source's own grid.

        Gaps in the data are checked against the land near the region; downloads are cached in the
        folder. Raises StageError if the data could not be downloaded, or failed the acceptance
        check; RequestError if the user's own file is invalid.
        """
        ...


def land_hash(land: Land) -> str:
    """Return the SHA-256 of a land's polygons."""
    digest = hashlib.sha256()
    for polygon in land.polygons:
        digest.update(shapely.to_wkb(polygon, byte_order=1))
    return digest.hexdigest()


def current_hash(grid: CurrentGrid) -> str:
    """Return the SHA-256 of a current's nodes, times and velocities, equal on every machine."""
    digest = hashlib.sha256()
    for array in (grid.lon, grid.lat, grid.times_s, grid.u, grid.v):
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return digest.hexdigest()
