"""Figures beside the grid Dijkstra of :mod:`tests.yardstick`, around Palawan at true scale."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

import renew
from pipeline.geo.projection import Projection
from pipeline.machine.store import Store
from pipeline.model import Case, Fetched
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.model import Scenario
from pipeline.stages.fetch import fetch
from pipeline.stages.project import project
from pipeline.stages.simplify import simplify_land
from renew._types import FloatArray
from tests import yardstick
from tests.bench.clock import Took, warm
from tests.bench.figure import Figure

NAUTICAL_MILE = 1852.0
CLEARANCES_NM = (1, 3, 5)
PALAWAN = (118.6, 9.75)
"""A point in the middle of the island, lon/lat degrees."""
SIDES = {1: "east", -1: "west"}
"""Names of the wall's halves, as seen from the north-east."""
_TOUCH_M = 0.5


def figures() -> Iterator[Figure]:
    """Yield fuel and time beside the grid's, for each clearance and season."""
    scenario = load_scenario("palawan-usv")
    fetched = fetched_data(scenario)
    cases = cases_of(scenario, fetched)
    for miles in CLEARANCES_NM:
        clearance = miles * NAUTICAL_MILE
        barred = yardstick.keep_out(cases[0].water.land, clearance)
        for case in cases:
            yield from _Voyage(scenario, case, barred, clearance).figures()


@dataclass(frozen=True)
class _Voyage:
    """One case at one clearance (m)."""

    scenario: Scenario
    case: Case
    barred: shapely.Geometry
    clearance: float

    def figures(self) -> Iterator[Figure]:
        """Hours on the better side, hours on the other, and time."""
        grid_took, grid = warm(self._grid)
        took, plan = warm(self._plan)
        ours: dict[int, FloatArray] = {}
        for route in plan.routes:
            ours.setdefault(self._side(route.path), route.path)
        name = f"Palawan, {self.case.name}, {self.clearance / NAUTICAL_MILE:g} nm"
        by_grid = sorted((self._hours(path), side) for side, path in grid.items())
        for (hours, side), rank in zip(by_grid, ("better", "other"), strict=False):
            yield self._fuel(f"{name}: {rank} side, hours", hours, side, ours.get(side))
        yield _time(f"{name}: time as a share of the grid's", took, grid_took)

    def _grid(self) -> dict[int, FloatArray]:
        """The yardstick's best path on each side."""
        case = self.case
        return yardstick.Grid.over(
            case.chart.extent,
            self.barred,
            case.current,
            case.vessel.speed,
            case.start,
            case.goal,
        ).best_on_each_side(self._wall)

    def _plan(self) -> renew.Plan:
        """The planner's, with the scenario's own k and least size of islands that make a choice."""
        case, options = self.case, self.scenario.planner
        return renew.plan(
            case.chart,
            case.current,
            case.vessel,
            case.start,
            case.goal,
            classes=options.classes,
            distinct_by=options.distinct_by,
            padding="none",
            clearance=self.clearance,
        )

    @property
    def _wall(self) -> yardstick.Wall:
        """Through Palawan, square to the way."""
        way = self.case.goal - self.case.start
        middle = self.case.projection.to_plane(np.array(PALAWAN))
        return yardstick.Wall(middle, way / np.linalg.norm(way))

    def _side(self, path: FloatArray) -> int:
        """Side on which a path passes: that half of the wall which it crosses more often."""
        return int(np.sign(self._wall.halves(path[:-1], path[1:]).sum()))

    def _hours(self, path: FloatArray) -> float:
        """Score a path by the yardstick's own quadrature."""
        seconds = yardstick.passage_time(path, self.case.current, self.case.vessel.speed)
        return seconds / 3600

    def _fuel(self, name: str, limit: float, side: int, path: FloatArray | None) -> Figure:
        """Hours beside the grid's (fuel is as time at constant thrust); the coast as surveyed."""
        asked = f"<= {limit:.3f} {SIDES[side]}"
        if path is None:
            return Figure(name, asked, "no route", met=False)
        hours = self._hours(path)
        land = np.array(self.case.water.land)
        apart = float(shapely.distance(shapely.LineString(path), land).min())
        clear = apart >= self.clearance - _TOUCH_M
        said = "" if clear else f", {apart:.0f} m from land"
        return Figure(name, asked, f"{hours:.3f}{said}", clear and hours <= limit)


def _time(name: str, took: Took, limit: Took) -> Figure:
    """Time as a share, of the process (who else uses the machine is nothing to it) and the wall."""
    share, on_wall = took.cpu / limit.cpu, took.wall / limit.wall
    text = f"{share:.2f} (CPU {took.cpu:.2f} s of {limit.cpu:.2f} s; wall {on_wall:.2f})"
    return Figure(name, "<= 0.2", text, share <= 0.2)


def fetched_data(scenario: Scenario) -> Fetched:
    """Land, and both seasons' currents of the embedded table."""
    with tempfile.TemporaryDirectory() as folder:
        return fetch(scenario, Store(Path(folder)), offline=True).fetched


def cases_of(scenario: Scenario, fetched: Fetched) -> tuple[Case, ...]:
    """The planner's cases, as a run makes them."""
    if scenario.region is None:
        raise ValueError(f"{scenario.name} has no region")
    region = scenario.region
    simplified = simplify_land(
        fetched.land.polygons,
        region.shape,
        margin_m=scenario.chart.margin_m,
        accuracy_m=fetched.land.accuracy_m,
        endpoints=(scenario.start, scenario.goal),
        projection=Projection.for_region(region.shape, 1.0, region.crs),
    )
    return project(scenario, fetched, simplified)
