"""Environments from their files, and their scenes in planar metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import shapely

from experiments.environments.coarse import coarse
from experiments.environments.model import Case, EnvironmentSpec
from pipeline.errors import RequestError
from pipeline.findings.result import RunResult
from pipeline.geo.projection import Projection
from pipeline.machine.store import Store
from pipeline.model import CaseResult, Fetched, SimplifiedLand, planner_vessel
from pipeline.scenario import catalogue
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.model import Scenario
from pipeline.scenario.strict import near_miss, validated
from pipeline.stages.fetch import fetch
from pipeline.stages.places import fetched_plane, unsimplified
from pipeline.stages.project import project
from pipeline.stages.simplify import simplify_land
from renew._types import FloatArray
from renew.voyage.voyage import Voyage, Waters

FOLDER = Path(__file__).resolve().parents[1] / "catalog"
"""Folder of the environments' files."""


@dataclass(frozen=True)
class Environment:
    """An environment, and its scenario's run as far as to the plans, which are made here."""

    spec: EnvironmentSpec
    result: RunResult

    @property
    def waters(self) -> str:
        """Which chart and which currents these are."""
        fetched = self.result.fetched
        names = [credit.text for credit in fetched.land.credits]
        names += dict.fromkeys(f"{grid.credit.text} ({grid.valid})" for grid in fetched.currents)
        if self.result.water.is_planar:
            names.append("currents as given in the environment's file")
        return "; ".join(names)

    def voyage(self, case: Case) -> Voyage:
        """The voyage of a case, m and m/s."""
        planned, chart = self.result.planned[case.season], self.result.water.chart
        if case.vertices is not None:
            ends = np.stack([planned.start, planned.goal])
            chart = coarse(chart, planned.water.land, case.vertices, ends)
        waters = Waters(chart, planned.current)
        return Voyage(waters, planned.vessel, planned.start, planned.goal, "projected")

    def side(self, path: FloatArray) -> str:
        """On which side of the spec's island a path passes; empty if it names none."""
        if self.spec.island is None:
            return ""
        middle = self.result.water.projection.to_plane(np.array([self.spec.island]))[0]
        way = self.result.stops[-1] - self.result.stops[0]
        square = np.array([-way[1], way[0]]) * np.sign(-way[1])
        # The half-line that leads from the island eastward, square to the way, is met or not.
        line = shapely.LineString([middle, middle + square])
        return "east" if line.intersects(shapely.LineString(path)) else "west"

    def options(self, case: Case) -> dict[str, object]:
        """Options of `renew.plan` for a case."""
        return {
            "classes": self.spec.classes,
            # As published; the default is fitted to the turns of a route as well.
            "padding": "triangle" if case.padding == "adaptive" else case.padding,
            "clearance": case.clearance,
            "distinct_by": self.result.scenario.planner.distinct_by,
        }


def names() -> tuple[str, ...]:
    """Names of all environments."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def load_spec(name: str) -> EnvironmentSpec:
    """Load and check an environment's file.

    Raises
    ------
    RequestError
        There is none of that name, or it is invalid: one line for each fault.
    """
    if name not in names():
        raise RequestError([f"no environment {name!r}: {near_miss(name, names())}"])
    data = catalogue.read_toml(FOLDER / f"{name}.toml")
    spec = validated(EnvironmentSpec, data, lambda line: f"environment {name!r}: {line}")
    cases = [case.name for case in spec.cases]
    faults = [
        f"environment {name!r}: published case {row.case!r} is none: {near_miss(row.case, cases)}"
        for row in spec.published
        if row.case not in cases
    ]
    if faults:
        raise RequestError(faults)
    return spec


def load_environment(spec: EnvironmentSpec, store: Store) -> Environment:
    """Load an environment's scene: as given in metres, or from chart and currents, offline."""
    scenario = _scenario(spec)
    if scenario.plane is not None:
        fetched = fetched_plane(scenario.plane, scenario.scale)
        simplified = unsimplified(fetched.land)
    else:
        fetched = fetch(scenario, store, offline=True)
        simplified = _simplified(scenario, fetched)
    cases = project(scenario, fetched, simplified)
    return Environment(
        spec,
        RunResult(
            scenario,
            fetched,
            simplified,
            cases[0].water,
            {case.name: case for case in cases},
            tuple(CaseResult(season.name, None, "", 0.0) for season in scenario.seasons),
            {},
            datetime.now(UTC),
        ),
    )


def _scenario(spec: EnvironmentSpec) -> Scenario:
    """The environment's scenario, with its own currents, its own scale, and its seasons only."""
    if isinstance(spec.scenario, str):
        data = catalogue.read_toml(catalogue.scenario_path(spec.scenario))
    else:
        data = dict(spec.scenario)
    _check_seasons(spec, [season.get("name") for season in data.get("seasons", [])])
    wanted = {case.season for case in spec.cases}
    data["seasons"] = [season for season in data["seasons"] if season["name"] in wanted]
    if spec.currents:
        data["seasons"] = [
            {**season, "currents": list(spec.currents)} for season in data["seasons"]
        ]
    if spec.scale is not None:
        data["scale"] = spec.scale
    return parse_scenario(data)


def _check_seasons(spec: EnvironmentSpec, known: Sequence[str]) -> None:
    """Refuse cases of seasons that the scenario does not have."""
    faults = [
        f"environment {spec.name!r}: case {case.name!r} has season {case.season!r}: "
        f"{near_miss(case.season, known)}"
        for case in spec.cases
        if case.season not in known
    ]
    if faults:
        raise RequestError(faults)


def _simplified(scenario: Scenario, fetched: Fetched) -> SimplifiedLand:
    """The chart's land, simplified as for any run."""
    if scenario.region is None:
        raise RequestError([f"environment {scenario.name!r}: its scenario needs a region"])
    return simplify_land(
        fetched.land.polygons,
        scenario.region.shape,
        margin_m=scenario.chart.margin_m,
        accuracy_m=fetched.land.accuracy_m,
        tolerance_m=scenario.chart.tolerance_m,
        turning_radius_m=planner_vessel(scenario.vessel).turning_radius * scenario.scale,
        endpoints=(scenario.start, scenario.goal),
        projection=Projection.for_region(scenario.region.shape),
    )
