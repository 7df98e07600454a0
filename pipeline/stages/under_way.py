"""Finished runs as they lie in their folders, and the voyage under way that is made from one.

The scenario beside the results is run once more, as far as its plan; the store has all of it,
unless it was pruned. Land and current must be those of the results, by their hashes.
"""

import json
import math
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import shapely

import renew
from pipeline.errors import RequestError
from pipeline.findings.names import MANIFEST, SCHEMA_VERSION, safe_name, without_folders
from pipeline.findings.text import json_value
from pipeline.geo.projection import GEOD, Projection
from pipeline.machine.paths import expanded, shown, unreadable_reason
from pipeline.machine.store import Artefact, artefact_key
from pipeline.model import Case, CaseResult, Fetched, SimplifiedLand, VoyageBefore
from pipeline.model.inputs import current_hash, land_hash
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.model import Scenario, UnderWay
from pipeline.stages.choose import Chosen
from renew.underway.lead import abeam

# Distance from the plan beyond which a position is taken for a mistake, m.
_FURTHEST_M = 50_000.0
# Length of the step by which a true heading is turned into one of the plane, m.
_STEP_M = 100.0
# Keys of a scenario on which the plan does not depend.
_MAY_DIFFER = ("havens", "outputs", "title")


def scenario_before(voyage: UnderWay) -> Scenario:
    """Return the scenario whose plan the vessel sails, as it lies beside the results.

    Raises RequestError if it was edited since the run, so that its plan is not the one that is
    sailed.
    """
    finished = finished_season(Path(voyage.results), voyage.season)
    file, ran = finished.folder / "scenario.toml", finished.scenario
    scenario = departed = load_scenario(str(file))
    # The file leaves a departure open that the run has chosen.
    for season, as_run in zip(scenario.seasons, ran["seasons"], strict=False):
        if season.leaves_departure_open and as_run["departure"]:
            begin = datetime.fromisoformat(as_run["departure"])
            departed = departed.departing(season.name, begin, as_run["name"])
    now = json.loads(json.dumps(without_folders(json_value(departed.model_dump(mode="json")))))
    if edited := [key for key in now if key not in _MAY_DIFFER and now[key] != ran.get(key)]:
        raise RequestError(
            f"RESULTS: {shown(file)} has another {', '.join(edited)} than the scenario that was "
            "run: its plan is not the one that is sailed. Put back what manifest.json has under "
            "scenario_as_run, or plan from here by renew go"
        )
    return scenario


def case_sailed(voyage: UnderWay, chosen: Chosen) -> Chosen:
    """Return the case that is sailed alone, out of all that its scenario has.

    Raises RequestError if it can't be planned again, or its data are others now than those of the
    results.
    """
    where, name = f"RESULTS: {shown(voyage.results)}", voyage.season
    own = tuple(one for one in chosen.scenario.seasons if one.name == name)
    fetched = chosen.fetched
    key = fetched.current_keys.get(name)
    case = next((one for one in chosen.cases.value if one.name == name), None)
    if not own or key is None or case is None or case.follows:
        why = fetched.failures.get(name, "its scenario has no such season of its own")
        raise RequestError(f"{where} can't be made again: season {name!r}: {why}")
    departure = own[0].departure
    if departure is not None and departure != voyage.departed:
        raise RequestError(
            f"under_way.departed = {voyage.departed.isoformat()} is not the departure of the "
            f"plan, {departure.isoformat()}; give that one"
        )
    grids = tuple(one for one in fetched.currents if one.case == name)
    now = {"land": land_hash(fetched.land), "current": current_hash(grids[0])}
    then = finished_season(Path(voyage.results), name).hashes
    if changed := [kind for kind in now if now[kind] != then[kind]]:
        raise RequestError(
            f"{where} was planned with another {' and '.join(changed)} than its scenario finds "
            "now: give that plan's files their old content again, or plan from here by renew go"
        )
    notes = tuple(one for one in fetched.notes if not one.cases or name in one.cases)
    alone = replace(fetched, currents=grids, notes=notes, current_keys={name: key}, failures={})
    return replace(
        chosen,
        scenario=chosen.scenario.model_copy(update={"seasons": own}),
        fetched=alone,
        cases=Artefact(chosen.cases.key, (case,)),
    )


# Share by which the fuel of the plan made again may differ from that of the results.
_SAME_FUEL = 1e-6


@dataclass(frozen=True)
class PlanSailed:
    """The case that the vessel sails, its land and plan, and a key that stands for the plan."""

    voyage: UnderWay
    chosen: Chosen
    land: Artefact[SimplifiedLand]
    result: CaseResult
    key: str

    def __post_init__(self) -> None:
        """Refuse another plan than that of the results; RequestError."""
        finished = finished_season(Path(self.voyage.results), self.voyage.season)
        if not math.isclose(self.route.fuel, finished.fuel, rel_tol=_SAME_FUEL):
            raise RequestError(
                f"RESULTS: {shown(finished.folder)} has a plan of {finished.fuel:.6g} of fuel, and "
                f"made again from its scenario it needs {self.route.fuel:.6g}: it was made by "
                "another version of RENEW, or changed since; run the scenario again"
            )

    @property
    def case(self) -> Case:
        """The case that is sailed."""
        return self.chosen.cases.value[0]

    @property
    def route(self) -> renew.Route:
        """The route that is sailed."""
        return self.result.routes[0]

    def ahead(self, asked: Scenario) -> Scenario:
        """Return the scenario asked for, with the via points that are still ahead.

        Raises RequestError if the vessel is too far off the plan.
        """
        case, line = self.case, shapely.LineString(self.route.path)
        here = case.projection.to_plane(asked.start)
        place = abeam(self.route.path, self.route.times, here)
        off_m = case.projection.geodesic_length_m([here, place.point])
        if off_m > _FURTHEST_M:
            raise RequestError(
                f"start (--at) = {list(asked.start)} lies {off_m / 1000:.0f} km off the plan, and "
                f"at most {_FURTHEST_M / 1000:.0f} km are planned again; give the vessel's "
                "position, or plan from there by renew go"
            )
        places = np.array(case.via).reshape(-1, 2)
        along = shapely.line_locate_point(line, shapely.points(places), normalized=True)
        passed = {
            one
            for one, at in zip(self.chosen.scenario.via, np.atleast_1d(along), strict=True)
            if at <= place.along
        }
        via = tuple(one for one in asked.via if one not in passed)
        return asked.model_copy(update={"via": via})

    def data(self, asked: Scenario) -> Fetched:
        """Return the data of the plan for the case asked for, whose clock begins later."""
        (season,), fetched = asked.seasons, self.chosen.fetched
        (grid,), shift_s = fetched.currents, self._passed_s(asked)
        times_s = grid.times_s - shift_s if grid.changes else grid.times_s
        key = artefact_key("under way", fetched.current_keys[self.voyage.season], shift_s)
        return replace(
            fetched,
            currents=(replace(grid, case=season.name, times_s=times_s),),
            current_keys={season.name: key},
        )

    def keyed(self, asked: Scenario, data: Fetched) -> Fetched:
        """Return the data asked for, under keys that depend on the plan as well."""
        voyage = self.voyage.model_dump(mode="json", exclude={"results"})
        keys = {
            name: artefact_key("under way", key, self.key, voyage, self._passed_s(asked))
            for name, key in data.current_keys.items()
        }
        return replace(data, current_keys=keys)

    def before(self, asked: Scenario) -> VoyageBefore:
        """Return the plan on the clock of the scenario asked for."""
        case, route = self.case, self.route
        current, planar_s = case.current, self._passed_s(asked)
        if current.is_steady:
            planar_s /= case.projection.scale
        elif isinstance(current, renew.VaryingCurrent):
            current = renew.VaryingCurrent(current.slice_times - planar_s, current.slices)
        trajectory = route.trajectory - [planar_s, 0.0, 0.0, 0.0]
        route = replace(route, times=route.times - planar_s, trajectory=trajectory)
        return VoyageBefore(
            plan=renew.Plan((route,), ()),
            current=None if self.voyage.same_currents else current,
            start=case.start,
            via=case.via,
            heading_rad=_planar_heading(asked, self.voyage.heading_deg, case.projection),
            switch_above=self.voyage.switch_above,
        )

    def _passed_s(self, asked: Scenario) -> float:
        """Return the time since the vessel left, s."""
        departure = asked.seasons[0].departure
        if departure is None:
            raise ValueError("a scenario under way has a departure")
        return (departure - self.voyage.departed).total_seconds()


def _planar_heading(
    asked: Scenario, heading_deg: float | None, projection: Projection
) -> float | None:
    """Return a true heading at the start as one in the plane, rad anticlockwise from x."""
    if heading_deg is None:
        return None
    ahead = GEOD.fwd(*asked.start, heading_deg, _STEP_M)[:2]
    step = projection.to_plane(ahead) - projection.to_plane(asked.start)
    return math.atan2(step[1], step[0])


@dataclass(frozen=True)
class FinishedSeason:
    """A season that was planned: `scenario` and `season` are the tables that were run.

    `hashes` are the SHA-256 of its land and its current.
    """

    folder: Path
    scenario: dict[str, Any]
    season: dict[str, Any]
    hashes: dict[str, str]

    @property
    def departure(self) -> datetime | None:
        """The departure that was planned, if there is one."""
        text = self.season["departure"]
        return None if text is None else datetime.fromisoformat(text)

    def departed(self, given: datetime | None) -> datetime | None:
        """Return when the vessel left: as planned, or as given; RequestError if both are there."""
        planned = self.departure
        if planned is not None and given is not None and planned != given:
            raise RequestError(
                f"--departed: the plan is for the departure at {planned:%Y-%m-%dT%H:%M:%SZ}; leave "
                "the option out, or plan from where the vessel is"
            )
        return planned or given

    @property
    def fuel(self) -> float:
        """The fuel of the best route, in the planner's units; RequestError if it isn't there."""
        best = {"feature": "route", "rank": 1}
        try:
            features = _read(self._features)["features"]
            every = (one["properties"] for one in features)
            return float(next(one for one in every if best.items() <= one.items())["fuel"])
        except (KeyError, TypeError, ValueError, StopIteration, AttributeError) as error:
            raise _damaged(self._features, error) from None

    @property
    def _features(self) -> Path:
        stem = safe_name(f"{self.scenario['name']}-{self.season['name']}")
        return self.folder / f"{stem}.geojson"


def finished_season(results: Path, season: str) -> FinishedSeason:
    """Find a season in a folder of results; "" is the only one that was planned.

    Raises RequestError if the folder isn't one of a finished run, has no such season, or is that of
    a plane.
    """
    folder = expanded(results, "RESULTS")
    manifest = _read(folder / MANIFEST)
    try:
        if manifest["schema_version"] != SCHEMA_VERSION:
            raise RequestError(
                f"RESULTS: {shown(folder / MANIFEST)} has schema_version = "
                f"{manifest['schema_version']}, not {SCHEMA_VERSION}; run the scenario again"
            )
        scenario = manifest["scenario_as_run"]
        planned = [one["season"] for one in manifest["seasons"] if one["status"] == "planned"]
        tables = {one["name"]: one for one in scenario["seasons"]}
        if scenario["plane"] is not None:
            raise RequestError(
                f"RESULTS: {shown(folder)} is of a plane, where a vessel has no longitude and "
                "latitude; give the results of a chart"
            )
        inputs = manifest["inputs"]
        lands, currents = inputs["land"]["sha256"], inputs["currents"]
        hashes = {name: {"land": lands, "current": currents[name]["sha256"]} for name in planned}
    except (KeyError, TypeError) as error:
        raise _damaged(folder / MANIFEST, error) from None
    if not season and len(planned) == 1:
        season = planned[0]
    if season not in planned:
        known = ", ".join(planned)
        said = f"{season!r} was not planned" if season else "several seasons were planned"
        raise RequestError(f"--season: {said} in {shown(folder)}; give one of {known}")
    return FinishedSeason(folder, scenario, tables[season], hashes[season])


def _read(path: Path) -> dict[str, Any]:
    if reason := unreadable_reason(path):
        raise RequestError(
            f"RESULTS: {shown(path)} {reason}; give the folder of a finished run, such as "
            "outputs/NAME"
        )
    try:
        found = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise _damaged(path, error) from None
    if not isinstance(found, dict):
        raise _damaged(path, TypeError("it holds no object"))
    return found


def _damaged(path: Path, error: Exception) -> RequestError:
    """Return the error for a file that isn't as it was written."""
    return RequestError(
        f"RESULTS: {shown(path)} is damaged ({type(error).__name__}: {error}); run the scenario "
        "again"
    )
