"""A vessel waits at an anchorage until there is water on the bar behind it, and then goes on."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import renew
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RunResult
from pipeline.machine.store import Artefact
from pipeline.model import Case
from pipeline.run import Outcome, run
from pipeline.scenario.loading import load_scenario, parse_scenario
from pipeline.stages.choose import Chosen, with_onward_legs
from pipeline.stages.fetch import FetchedData
from renew._types import BoolArray, FloatArray
from renew.inputs.openings import ReliedOnTide
from tests.clock_oracle import earliest_arrival
from tests.pipeline.stages.test_tides import EBB, GOAL, START, scenario_data
from tests.pipeline.tidal_run import run as tidal_run, tide

ANCHORAGE, ON_THE_BAR = [-71.02, 42.34], [-71.01, 42.333]
WAIT = timedelta(hours=9)
STEP = timedelta(minutes=12)
HIGH = datetime(2026, 11, 23, 1, 0, tzinfo=UTC)
LATE_S, LATENESS = 3600.0, 0.05


def voyage(folder: Path, via: object, departure: datetime = EBB) -> Outcome:
    season = {"name": "day", "departure": departure, "currents": ["still"]}
    asked = scenario_data(folder, seasons=[season], via=[via])
    return run(parse_scenario(asked, folder), folder / "outputs")


def table(outcome: Outcome, name: str = "metrics.csv") -> list[dict[str, str]]:
    with (outcome.directory / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def times(row: dict[str, str]) -> tuple[datetime, datetime]:
    return datetime.fromisoformat(row["departure"]), datetime.fromisoformat(row["arrival"])


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Give the run of a voyage that begins on the ebb, and waits."""
    folder = tmp_path_factory.mktemp("waiting")
    return voyage(folder, {"at": ANCHORAGE, "wait": "9h"})


@pytest.mark.usefixtures("plain_report")
def test_without_a_wait_every_way_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=r"every way may meet .* m of tide"):
        voyage(tmp_path, ANCHORAGE)
    short = voyage(tmp_path, {"at": ANCHORAGE, "wait": "1h"})
    assert short.exit_code != 0
    reasons = {plan.name: plan.failure for plan in short.result.results}
    assert reasons["day"] == ""
    assert reasons["day-onward"].endswith("or let the vessel wait longer at its anchorage")


def test_the_way_on_begins_when_the_bar_opens(outcome: Outcome) -> None:
    there, onward = (
        next(row for row in table(outcome) if row["season"] == name and row["rank"] == "1")
        for name in ("day", "day-onward")
    )
    (left, arrived), (goes_on, at_goal) = times(there), times(onward)
    assert left == EBB
    assert arrived < goes_on <= arrived + WAIT
    text = f"lies at anchor at 71.0200 W 42.3400 N from {arrived + timedelta(minutes=1):%Y-%m-%d}"
    assert text in " ".join(note_texts(outcome.fetched.notes) + list(outcome.choices))
    assert there["least_water_m"] == ""
    assert (
        min(float(onward[key]) for key in onward if "least_water" in key and "_at" not in key) >= 1
    )
    assert int(onward["collisions"]) == 0
    # The vessel burns fuel for the time under way only.
    for row, (begin, end) in ((there, times(there)), (onward, (goes_on, at_goal))):
        rate = 3.0**2
        assert float(row["fuel"]) == pytest.approx(rate * (end - begin).total_seconds(), rel=2e-3)


def test_each_file_has_the_hours_of_its_part(outcome: Outcome) -> None:
    rows = {row["season"]: times(row) for row in reversed(table(outcome))}
    places = {"day": (START, tuple(ANCHORAGE)), "day-onward": (tuple(ANCHORAGE), GOAL)}
    manifest = (outcome.directory / "manifest.json").read_text(encoding="utf-8")
    for season, (begin, end) in rows.items():
        gpx = (outcome.directory / f"bar-{season}.gpx").read_text(encoding="utf-8")
        found = [datetime.fromisoformat(one) for one in re.findall(r"<time>([^<]*)</time>", gpx)]
        assert {begin, end} <= set(found)
        rtz = (outcome.directory / f"bar-{season}.rtz").read_text(encoding="utf-8")
        assert f'etd="{begin:%Y-%m-%dT%H:%M:%SZ}"' in rtz
        # Its legs replace the path by fewer ones of at most 0.2 % more fuel.
        eta = datetime.fromisoformat(re.findall(r'eta="([^"]*)"', rtz)[-1])
        assert abs((eta - end).total_seconds()) <= 1 + 0.003 * (end - begin).total_seconds()
        path = outcome.directory / f"bar-{season}.geojson"
        geometries = [
            shapely.from_geojson(json.dumps(one["geometry"]))
            for one in json.loads(path.read_text(encoding="utf-8"))["features"]
        ]
        lines = [one for one in geometries if one.geom_type == "LineString"]
        assert lines
        for end_of, place in zip((0, -1), places[season], strict=True):
            assert shapely.get_coordinates(lines[0])[end_of] == pytest.approx(place, abs=1e-5)
        assert f"{begin:%Y-%m-%dT%H:%M:%SZ}" in manifest


@pytest.mark.usefixtures("plain_report")
def test_the_written_scenario_gives_the_same_voyage(outcome: Outcome, tmp_path: Path) -> None:
    again = run(load_scenario(str(outcome.directory / "scenario.toml")), tmp_path)
    assert table(again) == table(outcome)


def is_shut_for(case: Case, departure: float) -> Any:  # noqa: ANN401 - as the oracle takes it
    """Say which legs are shut, by this test's own rule: early, on time, late and for a turn."""
    depth, turn = case.tidal_depth, case.vessel.turn_period
    assert depth is not None
    kinds = depth.tide if isinstance(depth.tide, list) else [depth.tide] * len(depth.areas)
    relied = {one: ReliedOnTide(one, depth.surge, depth.lag) for one in set(kinds)}

    def is_shut(a: FloatArray, b: FloatArray, begin: FloatArray, end: FloatArray) -> BoolArray:
        shut = ~np.isfinite(end)
        legs = shapely.linestrings(np.stack([a, b], axis=1))
        for area, need, kind in zip(depth.areas, depth.needs, kinds, strict=True):
            at = np.flatnonzero(shapely.intersects(area, legs) & ~shut)
            late = np.maximum(LATE_S, LATENESS * (end[at] - departure))
            early = np.maximum(begin[at] - late, departure)
            hours = np.linspace(early, end[at] + late + turn, 25)
            shut[at] = relied[kind].heights(hours).min(axis=0) < need
        return shut

    return is_shut


def test_an_oracle_that_waits_at_that_node_does_not_arrive_earlier(outcome: Outcome) -> None:
    season, first = "day-onward", outcome.result.planned["day"]
    anchorage, goal = outcome.result.stops[1:]
    there, onward = (
        next(row for row in table(outcome) if row["season"] == name) for name in ("day", season)
    )
    arrived, chosen = ((one - EBB).total_seconds() for one in (times(there)[1], times(onward)[0]))

    def way_on(departure: float) -> float:
        fuel, _ = earliest_arrival(
            first.chart,
            first.current,
            first.vessel,
            anchorage,
            goal,
            departure,
            spacing=120.0,
            clearance=float(outcome.scenario.planner.clearance or 0.0),
            is_shut=is_shut_for(first, departure),
        )
        return fuel

    # Waiting at the anchorage's node, the oracle finds the bar shut until the vessel goes on.
    waits = np.arange(arrived, chosen - STEP.total_seconds() - 60.0, 5400.0)
    assert len(waits) > 2
    assert all(map(np.isinf, map(way_on, [*waits, chosen - STEP.total_seconds() - 60.0])))
    assert float(onward["fuel"]) <= 1.005 * way_on(chosen)


@pytest.mark.usefixtures("plain_report")
def test_no_wait_at_all_changes_nothing(tmp_path: Path) -> None:
    given = [tmp_path / name for name in ("point", "anchorage")]
    for folder in given:
        folder.mkdir()
    point, anchorage = (
        voyage(folder, via, HIGH)
        for folder, via in zip(given, (ANCHORAGE, {"at": ANCHORAGE, "wait": "0min"}), strict=True)
    )
    assert table(anchorage) == table(point)
    (one,), (other,) = (
        [one.plan for one in found.result.results if one.plan is not None]
        for found in (point, anchorage)
    )
    for route, same in zip(one.routes, other.routes, strict=True):
        np.testing.assert_array_equal(same.path, route.path)
        np.testing.assert_array_equal(same.trajectory, route.trajectory)


@pytest.mark.usefixtures("plain_report")
def test_a_vessel_leaves_before_its_anchorage_falls_dry(tmp_path: Path) -> None:
    found = voyage(tmp_path, {"at": ON_THE_BAR, "wait": "9h"}, HIGH)
    (choice,) = found.result.departures
    depth = found.result.planned["day"].tidal_depth
    assert depth is not None
    here = shapely.Point(found.result.stops[1:-1][0])
    shut = [area for area in depth.tidal_areas if shapely.dwithin(area.polygon, here, 7.0)]
    assert shut
    dry = min(area.next_hours(0.0)[1] for area in shut)  # type: ignore[index]
    last = (choice.first - HIGH).total_seconds() + choice.departures_s[-1]
    assert 0 <= dry - LATE_S - last <= STEP.total_seconds() + 60
    assert last < WAIT.total_seconds() / 2


def test_the_way_on_has_the_current_and_the_hours_of_its_own_clock() -> None:
    result: RunResult = tidal_run(tide(30), ())
    middle = [119.05, 9.53]
    via = result.scenario.model_validate(
        {**result.scenario.model_dump(exclude_unset=True), "via": [{"at": middle, "wait": "6h"}]}
    )
    area = renew.ShutArea(shapely.box(9e3, 0, 9.1e3, 10), 7200.0, 9000.0)
    anchorage = result.water.projection.to_plane(np.array([middle]))
    case = replace(result.planned["tide"], via=anchorage, areas=(area,))
    data = FetchedData(result.fetched, "land", {"tide": "current"}, {})
    given = Chosen(via, data, Artefact("cases", (case,)))
    split = with_onward_legs(given)
    season, onward = split.scenario.seasons
    assert (season.name, onward.name) == ("tide", "tide-onward")
    assert onward.departures is not None
    window = onward.departures.window
    assert timedelta(hours=6) - timedelta(minutes=11) < window <= timedelta(hours=6)
    assert season.departure is not None
    shift = (onward.departures.begin - season.departure).total_seconds()
    assert shift > 0
    first, second = split.case("tide"), split.case("tide-onward")
    np.testing.assert_allclose(
        second.current.velocity(case.start, 600.0),
        first.current.velocity(case.start, shift + 600.0),
        atol=1e-12,
    )
    assert second.areas[0].begin == pytest.approx(7200.0 - shift)
    assert set(split.data.current_keys) == {"tide", "tide-onward"}
    assert len(split.data.fetched.currents) == 2
    np.testing.assert_array_equal(first.goal, anchorage[0])
    np.testing.assert_array_equal(second.start, anchorage[0])
    assert second.follows == "tide"
