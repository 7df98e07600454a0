"""The results of a finished run, as they lie in its folder."""

import json
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from pipeline.errors import RequestError
from pipeline.findings.names import MANIFEST, SCHEMA_VERSION, season_stem
from pipeline.machine.paths import expanded, shown, unreadable_reason


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
        try:
            return float(self._best_route["properties"]["fuel"])
        except (KeyError, TypeError, ValueError, StopIteration, AttributeError) as error:
            raise _damaged(self._features, error) from None

    @property
    def _features(self) -> Path:
        """The file of the routes."""
        stem = season_stem(self.scenario["name"], self.season["name"])
        return self.folder / f"{stem}.geojson"

    @property
    def _best_route(self) -> dict[str, Any]:
        """Return the feature of the best route."""
        best = {"feature": "route", "rank": 1}
        features = _read(self._features)["features"]
        found: dict[str, Any] = next(
            one for one in features if best.items() <= one["properties"].items()
        )
        return found


def finished_season(results: Path, season: str) -> FinishedSeason:
    """Find a season in a folder of results; "" is the only one that was planned.

    Raises
    ------
    RequestError
        The folder isn't one of a finished run, has no such season, or is that of a plane.
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
    """Read an object of JSON from a folder of results."""
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
