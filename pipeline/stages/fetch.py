"""First stage: fetch land and currents from their sources, with credits.

The land and each case's current are separate artefacts. A case uses its first source that is
available, covers the region and returns data. Its current keeps the names of the earlier sources
and the reasons why they were not used.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry import Polygon

from pipeline._types import BoolArray, FloatArray
from pipeline.errors import MachineError, PipelineError, RequestError, StageError
from pipeline.findings.note_words import note_text
from pipeline.findings.text import season_text
from pipeline.geo.projection import GEOD
from pipeline.machine.store import DOWNLOADS, Artefact, Store, artefact_key
from pipeline.model import CurrentGrid, Fetched, Land, Note, Place
from pipeline.model.inputs import LandSource, current_notes, of_cases
from pipeline.scenario.catalogue import has_world_land
from pipeline.scenario.model import Scenario
from pipeline.scenario.region import ChartSpec, Plane, Region
from pipeline.scenario.season import MAX_HOURS, Season, source_name
from pipeline.sources.combined_charts import Overlay
from pipeline.sources.current_field import land_freed_at_end
from pipeline.sources.land.osm import OsmLand
from pipeline.sources.registry import charted_land, current_source, weather_files, weather_grids
from pipeline.stages.places import avoided_zones, fetched_plane

# Default limit of a voyage in changing currents, as a multiple of the time that the vessel takes
# along the straight line in still water.
_LONGEST_WAY = 3.0
# Hours by which that limit is longer, because the tide may turn against a short voyage.
_DAY_HOURS = 24.0


def fetch(
    scenario: Scenario, store: Store, *, offline: bool = False, strict: bool = False
) -> Fetched:
    """Fetch land and every case's current; if `strict`, only from each case's first source.

    Raises RequestError if no case has a source that is available and covers the region; StageError
    if sources were tried and none returned data; or, if `strict`, a case would use another source
    than its first.
    """
    if scenario.plane is not None:
        return _plane_data(scenario, scenario.plane)
    if scenario.region is None:
        raise ValueError("the region is chosen before")
    data = _region_data(scenario, Fetcher(scenario.region, charted_land(scenario), store, offline))
    if strict:
        _refuse_stand_ins(data)
    return data


def _refuse_stand_ins(data: Fetched) -> None:
    """Raise StageError if a case has no source, or would use another than its first."""
    faults = [
        f"{season_text(grid.case)} would be {note_text(grid.stand_in_notes[0])}, which is not "
        "its first choice" + "".join(f"; {reason}" for _, reason in grid.passed_over)
        for grid in data.currents
        if grid.is_stand_in
    ]
    faults += [f"{season_text(name)}: {why}" for name, why in data.failures.items()]
    if faults:
        raise StageError("\n".join([*faults, "nothing was planned, as --strict asks"]))


def _region_data(scenario: Scenario, fetcher: "Fetcher") -> Fetched:
    """Fetch the land and currents of a scenario with a region."""
    seasons = [with_max_hours(season, scenario) for season in scenario.seasons]
    found, errors = dict[str, Artefact[CurrentGrid]](), dict[str, PipelineError]()
    with land_freed_at_end():
        for season in seasons:
            current = fetcher.current(season)
            if isinstance(current, Artefact):
                found[season.name] = current
            else:
                errors[season.name] = current
    failures = {name: str(error) for name, error in errors.items()}
    if not found:
        reasons = [f"{season_text(name)}: {why}" for name, why in failures.items()]
        asked = any(isinstance(error, StageError) for error in errors.values())
        raise StageError("; ".join(reasons)) if asked else RequestError(reasons)
    grids = tuple(current.value for current in found.values())
    region = fetcher.region.shape
    speeds_m_s = {one.name: scenario.vessel_in(one).speed_m_s for one in seasons}
    begins = {season.name: season.first_departure for season in seasons if season.is_changing}
    overpowering = [
        note
        for grid in grids
        for note in overpowering_notes(grid, region, speeds_m_s[grid.case], begins.get(grid.case))
    ]
    avoided, about_avoided = avoided_zones(scenario.avoid, region)
    notes = (*fetcher.land.notes, *about_avoided, *current_notes(grids), *overpowering)
    shown = (*fetcher.land.zones, *avoided)
    return Fetched(
        replace(fetcher.land, zones=shown),
        grids,
        notes,
        fetcher.surroundings(scenario.chart),
        land_key=fetcher.land_key,
        current_keys={name: current.key for name, current in found.items()},
        failures=failures,
    )


def with_weather(fetched: Fetched, scenario: Scenario) -> Fetched:
    """Return the data with wind and waves, as far as the vessel has limits for them.

    Raises RequestError if the files can't be used; all faults are listed.
    """
    if scenario.limits is None or scenario.region is None:
        return fetched
    # All that is made in a current is made in its weather.
    weather, current_keys = dict[str, dict[str, CurrentGrid]](), dict[str, str]()
    limits = scenario.weather_limits.model_dump()
    for season in scenario.seasons:
        clock = on_clock(season, scenario)
        weather[season.name] = weather_grids(scenario, clock)
        if key := fetched.current_keys.get(season.name):
            files = [source.identity(clock) for _, source in weather_files(scenario)]
            current_keys[season.name] = artefact_key("weather", key, limits, files)
    notes = {
        name: [note for grid in grids.values() for note in grid.notes]
        for name, grids in weather.items()
    }
    return replace(
        fetched,
        weather=weather,
        current_keys=current_keys,
        notes=(*fetched.notes, *of_cases(notes)),
    )


def on_clock(season: Season, scenario: Scenario) -> Season:
    """Return a season whose data change with time, with the hours that a voyage may last."""
    return with_max_hours(season.model_copy(update={"time_method": "changing"}), scenario)


def with_max_hours(season: Season, scenario: Scenario) -> Season:
    """Set `max_hours` to its default if the case's currents change and it has no limit."""
    if not season.is_changing or season.max_hours is not None:
        return season
    lon, lat = zip(*scenario.stops.values(), strict=True)
    apart_m = GEOD.line_length(lon, lat)
    straight_hours = apart_m / scenario.vessel_in(season).speed_m_s / 3600
    wait = scenario.anchorage[1] if scenario.anchorage else timedelta()
    hours = _LONGEST_WAY * straight_hours + _DAY_HOURS + wait / timedelta(hours=1)
    hours = min(math.ceil(hours), MAX_HOURS)
    return season.model_copy(update={"max_hours": hours})


@dataclass(frozen=True)
class Fetcher:
    """Fetches land and currents of one region."""

    region: Region
    land_source: LandSource
    store: Store
    offline: bool

    @cached_property
    def land_key(self) -> str:
        """The land's key in the store."""
        return artefact_key("land", self.land_source.identity, self._outline)

    @cached_property
    def land(self) -> Land:
        """Land near the region; fetched at the first use, because fetching takes seconds."""
        return self._stored_land(self.land_source)

    @cached_property
    def dry_land(self) -> Land:
        """Land above water only; a chart's no-go areas also include shoals and uncharted water."""
        return self._stored_land(Overlay((OsmLand(),)))

    def surroundings(self, chart: ChartSpec) -> tuple[Polygon, ...]:
        """Return land outside the region, for maps only; none if all charts are the user's."""
        if not has_world_land(chart):
            return ()
        from pipeline.sources.land.osm import large_polygon, surroundings

        key = artefact_key("surroundings", OsmLand().identity, self._outline)
        found = self.store.load_or_make(
            "surroundings", key, tuple, lambda: surroundings(self.region.shape)
        )
        large_polygon.cache_clear()  # nothing is fetched after this, and planning needs the memory
        return found

    def _stored_land(self, source: LandSource) -> Land:
        """Load a source's land from the store, or fetch it."""
        key = artefact_key("land", source.identity, self._outline)
        return self.store.load_or_make("land", key, Land, lambda: source.land(self.region.shape))

    @cached_property
    def _outline(self) -> str:
        """The region's outline as WKT, a part of the artefacts' keys."""
        return str(self.region.shape.wkt)

    def current(self, season: Season) -> Artefact[CurrentGrid] | StageError | RequestError:
        """Fetch a case's current from its first source that returns data; or say why there is none.

        It is a StageError if a source was tried and failed, so that the request is not at fault.
        """
        passed_over: list[tuple[str, str]] = []
        shape, downloads, was_tried = self.region.shape, self.store.root / DOWNLOADS, False
        for named in season.currents:
            source = current_source(named, season.members, season.current_variables)
            name = source_name(named)
            key = artefact_key("current", source.identity(season), self._outline, season.name)
            # A stored current needs neither account nor network.
            grid = self.store.load("current", key, CurrentGrid)
            if grid is None:
                refusal = source.refusal(name, shape, season, downloads, offline=self.offline)
                if refusal:
                    passed_over.append((name, refusal))
                    continue
                try:
                    folder = self.store.folder(DOWNLOADS)
                    grid = source.current(shape, season, self.dry_land, folder)
                except MachineError:
                    raise
                except (StageError, RequestError) as error:
                    was_tried = was_tried or isinstance(error, StageError)
                    passed_over.append((name, "; ".join(str(error).splitlines())))
                    continue
                self.store.save("current", key, grid)
            # Not stored: in another run a preferred source may be available again.
            return Artefact(key, replace(grid, passed_over=tuple(passed_over)))
        reasons = "; ".join(reason for _, reason in passed_over)
        text = f"no source of currents could be used: {reasons}"
        return StageError(text) if was_tried else RequestError(text)


def _plane_data(scenario: Scenario, plane: Plane) -> Fetched:
    """Return the data of a plane scenario, which has its land and currents as numbers."""
    figures = scenario.model_dump(mode="json", include={"plane", "scale"})
    keys = {
        season.name: artefact_key("current", season.model_dump(mode="json"), figures)
        for season in scenario.seasons
    }
    fetched = fetched_plane(plane, scenario.scale)
    return replace(fetched, land_key=artefact_key("land", figures), current_keys=keys)


# Time step for the interpolation of a changing current, s.
_STEP_S = 300.0


def overpowering_notes(
    grid: CurrentGrid, region: shapely.Polygon, speed_m_s: float, departure: datetime | None = None
) -> Iterator[Note]:
    """Yield notes on the share of a region's water with an overpowering current, and its maximum.

    The region is in lon/lat degrees, the vessel's speed through water in m/s. `departure` is the
    first departure, from which the current's times are counted. If a changing current overpowers
    the vessel only for some hours, the note lists them.
    """
    lon, lat = np.meshgrid(grid.lon, grid.lat)
    strength = np.hypot(grid.u, grid.v)
    is_water = np.isfinite(strength[0]) & shapely.contains_xy(region, lon, lat)
    always = is_water & (strength.min(axis=0) >= speed_m_s)
    sometimes = is_water & (strength.max(axis=0) >= speed_m_s) & ~always
    for kind, cells in (("water-shut", always), ("water-shut-for-hours", sometimes)):
        if not cells.any() or (cells is sometimes and departure is None):
            continue
        # The node with the strongest current.
        strongest = np.where(cells, strength.max(axis=0), -1.0)
        row, column = map(int, np.unravel_index(np.argmax(strongest), strongest.shape))
        yield Note.of(
            kind,
            share=_share(cells, is_water, lat),
            speed_m_s=speed_m_s,
            most_m_s=float(strongest[row, column]),
            place=Place(float(grid.lon[column]), float(grid.lat[row])),
            hours=tuple(
                tuple(departure + timedelta(seconds=end) for end in spell)
                for spell in _spells(grid, (row, column), speed_m_s)
            )
            if departure
            else (),
        ).about(grid.case)


def _share(some: BoolArray, water: BoolArray, lat: FloatArray) -> float:
    """Return the share of the water's area in some cells; a cell's width scales with cos(lat)."""
    area = np.cos(np.radians(lat))
    return float(area[some].sum() / area[water].sum())


def _spells(
    grid: CurrentGrid, where: tuple[int, int], speed_m_s: float
) -> Iterator[tuple[float, float]]:
    """Yield begin and end, s since departure, of periods when the node's current is too fast."""
    times = np.arange(max(0.0, grid.times_s[0]), grid.times_s[-1] + _STEP_S / 2, _STEP_S)
    row, column = where
    u, v = (np.interp(times, grid.times_s, part[:, row, column]) for part in (grid.u, grid.v))
    is_shut = np.concatenate([[False], np.hypot(u, v) >= speed_m_s, [False]])
    turns = np.flatnonzero(np.diff(is_shut)).tolist()
    last = len(times) - 1
    for first, end in list(pairwise(turns))[::2]:
        yield float(times[first]), float(times[min(end, last)])
