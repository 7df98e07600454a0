"""Charts and currents that the cases of a night share; each is made once and stored."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Self, TypeVar

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.errors import StageError
from pipeline.findings.note_words import note_texts
from pipeline.machine.store import Artefact, Store, artefact_key, load_artefact, save_artefact
from pipeline.model import Case, Current, CurrentGrid, MemberCurrents, Water, planner_vessel
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import Season
from pipeline.scenario.strict import Point
from pipeline.sources.current_field import land_freed_at_end
from pipeline.sources.registry import charted_land
from pipeline.stages.fetch import Fetcher
from pipeline.stages.places import plane_current, plane_water
from pipeline.stages.project import members_of, planar_current, water_of
from pipeline.stages.region import chosen_region
from pipeline.stages.simplify import simplify

STAGE = "night-chart"
_Stored = TypeVar("_Stored", "NightChart", "NightCurrent")


_WIDTH = 480.0
# Tolerance to which lines of a map are simplified, in units of its frame.
_TOLERANCE = 0.4
# Least area of an island on a map, in square units of its frame: smaller ones can't be seen.
_LEAST_AREA = 0.6


@dataclass(frozen=True)
class SmallMap:
    """Land as an SVG path in a frame of `width` × `height`, and the planar origin and scale."""

    width: float
    height: float
    land: str
    west: float
    north: float
    per_metre: float

    @classmethod
    def of(cls, water: Water) -> Self:
        """Draw a chart's land, without details that are too small to see."""
        xmin, ymin, xmax, ymax = water.chart.bounds
        per_metre = _WIDTH / max(xmax - xmin, (ymax - ymin) / 1.4)
        empty = cls((xmax - xmin) * per_metre, (ymax - ymin) * per_metre, "", xmin, ymax, per_metre)
        land = shapely.simplify(np.array(water.chart.no_go, dtype=object), _TOLERANCE / per_metre)
        rings = [
            shapely.get_coordinates(ring)
            for polygon in land
            if polygon.area * per_metre**2 >= _LEAST_AREA
            for part in shapely.get_parts(polygon)
            for ring in (part.exterior, *part.interiors)
        ]
        path = "".join(f"{empty.path(ring)}Z" for ring in rings)
        return cls(empty.width, empty.height, path, xmin, ymax, per_metre)

    def path(self, xy: FloatArray) -> str:
        """Return points (n, 2), planar metres, as an SVG path."""
        simple = shapely.get_coordinates(
            shapely.simplify(shapely.LineString(xy), _TOLERANCE / self.per_metre)
        )
        x = (simple[:, 0] - self.west) * self.per_metre
        y = (self.north - simple[:, 1]) * self.per_metre
        points = [f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True)]
        return f"M{'L'.join(points)}"


@dataclass(frozen=True)
class NightChart:
    """A scenario's chart for one vessel, in the planner's plane, without currents.

    `scenario` has its region; `land_key` is the land's key in the store.
    """

    scenario: Scenario
    water: Water
    land_key: str
    accuracy_m: float
    small_map: SmallMap


@dataclass(frozen=True)
class NightCurrent:
    """A current in the planner's plane.

    `stand_in` is "" or says which current replaces the first choice, and why. `members` are there
    if it is the mean of several, and `left_out` says which of them can't be used, and why.
    """

    current: Current
    valid: str
    source: str
    stand_in: str
    members: MemberCurrents | None = None
    left_out: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ChartTask:
    """A task to make a chart; `ends` are the starts and goals of all pairs on it."""

    scenario: Scenario
    ends: tuple[Point, ...]
    store_root: Path
    path: Path

    def make(self) -> None:
        """Make the chart and store it, unless it is stored already."""
        if load_artefact(self.path, NightChart) is None:
            store = Store(self.store_root, "nightly")
            save_artefact(self.path, _chart(self.scenario, self.ends, store))


@dataclass(frozen=True, slots=True)
class CurrentTask:
    """A task to fetch one current of a chart; `label` names it in messages."""

    label: str
    season: Season
    chart_path: Path
    store_root: Path
    path: Path

    def make(self) -> None:
        """Fetch the current, project it to the chart's plane, and store it, unless it is stored.

        Raises
        ------
        StageError
            No source has the current, or the chart is missing.
        """
        if load_artefact(self.path, NightCurrent) is not None:
            return
        chart = loaded_chart(self.chart_path)
        save_artefact(self.path, _current(self, chart))


@lru_cache(maxsize=2)
def loaded_chart(path: Path) -> NightChart:
    """Load a stored chart; a worker keeps the last two in memory."""
    return _loaded(path, NightChart)


@lru_cache(maxsize=4)
def loaded_current(path: Path) -> NightCurrent:
    """Load a stored current; a worker keeps the last four in memory."""
    return _loaded(path, NightCurrent)


def _loaded(path: Path, kind: type[_Stored]) -> _Stored:
    """Load a chart or current that a task has stored; raise StageError if it can't be read."""
    found = load_artefact(path, kind)
    if found is None:
        raise StageError(f"can't read {path}; give all workers access to the same output folder")
    return found


def chart_key(scenario: Scenario, ends: Sequence[Point]) -> str:
    """Return the store's key of a scenario's chart on which `ends` stay in water."""
    names = {"region", "plane", "scale", "chart", "vessel", "start", "goal"}
    inputs = scenario.model_dump(mode="json", include=names)
    if scenario.is_planar:
        return artefact_key(STAGE, inputs)
    land = charted_land(scenario)
    planner = scenario.planner.model_dump(mode="json")
    return artefact_key(STAGE, land.identity, inputs, planner, list(ends))


def case_of(
    name: str, ends: tuple[Point | None, Point | None], chart: NightChart, current: NightCurrent
) -> Case:
    """Return a case on a chart; an end that is None is the scenario's own."""
    scenario, water = chart.scenario, chart.water
    given = np.array(
        [end or own for end, own in zip(ends, (scenario.start, scenario.goal), strict=True)]
    )
    start, goal = given if water.is_planar else water.projection.to_plane(given)
    return Case(
        name,
        water,
        planner_vessel(scenario.vessel),
        start,
        goal,
        current.current,
        under_keel_clearance_m=scenario.chart.under_keel_clearance_m,
        members=current.members,
    )


def _chart(scenario: Scenario, ends: Sequence[Point], store: Store) -> NightChart:
    """Fetch, simplify and project a scenario's chart, on which `ends` stay in water."""
    if scenario.is_planar:
        water = plane_water(scenario)
        return NightChart(scenario, water, "", 0.0, SmallMap.of(water))
    if scenario.region is None:
        region = chosen_region(scenario, store, offline=False)
        scenario = region.complete(scenario)
    fetcher = _fetcher(scenario, store)
    land = fetcher.land
    simplified = simplify(scenario, Artefact(fetcher.land_key, land), store, ends).value
    water = water_of(scenario, land, simplified)
    return NightChart(scenario, water, fetcher.land_key, land.accuracy_m, SmallMap.of(water))


def _fetcher(scenario: Scenario, store: Store) -> Fetcher:
    """Return the fetcher of land and currents in a scenario's region."""
    if scenario.region is None:
        raise StageError("the chart's region is yet to be chosen")
    land = charted_land(scenario)
    return Fetcher(scenario.region, land, store, offline=False)


@lru_cache(maxsize=1)
def _chart_fetcher(chart_path: Path, store_root: Path) -> Fetcher:
    """Return a chart's fetcher; cached, because it contains the land."""
    return _fetcher(loaded_chart(chart_path).scenario, Store(store_root, "nightly"))


def _current(task: CurrentTask, chart: NightChart) -> NightCurrent:
    """Fetch a current and project it to the chart's plane."""
    season = task.season
    if chart.scenario.is_planar:
        current = plane_current(season, chart.water.chart.extent)
        members = members_of(chart.water, chart.scenario, season, current, None)
        return NightCurrent(current, season.title or season.name, "numbers", "", members)
    with land_freed_at_end():
        found = _chart_fetcher(task.chart_path, task.store_root).current(season)
    if found.grid is None:
        reasons = "; ".join(passed.reason for passed in found.passed_over)
        raise StageError(f"no source of currents could be used: {reasons}")
    grid, water = found.grid, chart.water
    current = planar_current(grid, water.projection, water.chart.bounds)
    left_out = tuple(one for one in grid.notes if one.kind == "member-left-out")
    return NightCurrent(
        current,
        grid.valid,
        grid.credit.name,
        _stand_in(grid),
        members_of(water, chart.scenario, season, current, grid),
        tuple(note_texts(left_out)),
    )


def _stand_in(grid: CurrentGrid) -> str:
    """Return which current replaces the first choice, and why; "" if it is the first choice."""
    reasons = [passed.reason for passed in grid.passed_over]
    return "; ".join((*note_texts(grid.stand_in_notes), *reasons)) if grid.is_stand_in else ""
