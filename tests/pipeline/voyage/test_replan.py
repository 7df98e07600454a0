"""A voyage planned again under way, from its results: the fuel, the files, refusals."""

import json
import math
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import renew
from pipeline.cli.main import app
from pipeline.errors import RequestError
from pipeline.findings.result import RunResult
from pipeline.model import ReplanFigures
from pipeline.run import run
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.model import Scenario
from pipeline.voyage.positions import read_position
from pipeline.voyage.request import UnderWayRequest
from pipeline.voyage.under_way import under_way_scenario
from tests.pipeline.results import result_of
from tests.pipeline.tidal_run import DEPARTURE
from tests.pipeline.voyage import sailing

# A place near the plan's, half an hour after the departure, and the time.
WEST, EAST = "West,119.015,9.515", "East,119.085,9.545"
AT, TIME = "119.0290,9.5224", "2026-11-22T06:50Z"


@pytest.fixture(scope="module")
def voyage(results: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a voyage in a tide, which these tests write beside, and a newer forecast."""
    voyage = sailing.copied(results, tmp_path_factory.mktemp("voyage") / "copy")
    sailing.tide_file(voyage.parent.parent / "newer.nc", faster=1.3)
    return voyage


@pytest.fixture(scope="module")
def best(voyage: Path) -> renew.Route:
    """The route that is sailed, as it was planned."""
    return result_of(load_scenario(str(voyage / "scenario.toml")), voyage.parent).routes[0].route


def under_way(voyage: Path, **changes: str | float | datetime | tuple[str, ...]) -> Scenario:
    """Return the scenario of a vessel that is at AT at TIME, or as asked."""
    asked: dict[str, Any] = {"time": datetime.fromisoformat(TIME), **changes}
    at = read_position(asked.pop("at", AT))
    return under_way_scenario(UnderWayRequest(results=voyage, at=at, **asked))[0]


def again(voyage: Path, **changes: Any) -> RunResult:
    """Plan again from AT at TIME, or as asked, and write nothing."""
    return result_of(under_way(voyage, **changes), voyage.parent)


def answer(result: RunResult) -> ReplanFigures:
    (plan,) = result.results
    assert plan.replanned is not None
    return plan.replanned


def place_of(voyage: Path, best: renew.Route, at: int) -> dict[str, Any]:
    """Where and when the vessel passes a point of its path, to the microsecond."""
    result = result_of(load_scenario(str(voyage / "scenario.toml")), voyage.parent)
    lon, lat = result.water.projection.to_lonlat(best.path[at]).tolist()
    passed = timedelta(seconds=float(best.times[at]))
    return {"at": f"{lon!r},{lat!r}", "time": DEPARTURE + passed}


def asked_on_terminal(voyage: Path, *args: str) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["replan", str(voyage), "--quiet", *args])
    return done.exit_code, done.stdout, done.stderr


def test_on_its_plan_the_vessel_sails_on_as_planned(voyage: Path, best: renew.Route) -> None:
    at = len(best.path) // 3
    result = again(voyage, **place_of(voyage, best, at), name="on-plan")
    found, (ahead, *_) = answer(result), result.routes
    share = (best.times[-1] - best.times[at]) / (best.times[-1] - best.times[0])
    assert found.answer == "kept"
    assert ahead.route.fuel == pytest.approx(best.fuel * share, rel=1e-5)
    assert np.allclose(ahead.route.path[1:], best.path[at + 1 :], atol=1e-6)
    assert ahead.metrics.collisions == 0
    assert found.off_m < 0.1
    assert abs(found.late_s) < 0.1
    assert not found.has_new_current


@pytest.mark.slow
def test_a_plan_whose_departure_was_chosen_is_sailed_on(voyage: Path, tmp_path: Path) -> None:
    """Its scenario leaves the departure open, as the scenario that was run did."""
    file = sailing.copied(voyage, tmp_path / "copy") / "scenario.toml"
    text = file.read_text()
    open_text = re.sub(
        r"^departure = .*$",
        'departures = { first = "2026-11-22T06:20:00Z", every = "10min", count = 3 }',
        text,
        count=1,
        flags=re.MULTILINE,
    ).replace('name = "strait"', 'name = "open"')
    assert open_text != text
    file.write_text(open_text)
    first = run(load_scenario(str(file)), tmp_path, offline=True)
    sailed = first.result.routes[0].route
    (choice,) = first.result.departures
    begun = choice.first + timedelta(seconds=choice.chosen_s)
    at = len(sailed.path) // 3
    place = place_of(first.directory, sailed, at)
    place["time"] = begun + timedelta(seconds=float(sailed.times[at]))
    found = again(first.directory, **place, name="on")
    assert answer(found).answer == "kept"
    assert np.allclose(found.routes[0].route.path[1:], sailed.path[at + 1 :], atol=1e-6)


def test_a_latest_arrival_is_dropped_and_that_is_said(voyage: Path, tmp_path: Path) -> None:
    folder = sailing.copied(voyage, tmp_path / "copy")
    manifest = json.loads((folder / "manifest.json").read_bytes())
    manifest["scenario_as_run"]["seasons"][0]["arrive_by"] = "2026-11-22T18:00:00Z"
    (folder / "manifest.json").write_text(json.dumps(manifest))
    time = datetime.fromisoformat(TIME)
    request = UnderWayRequest(results=folder, at=read_position(AT), time=time)
    (told,) = under_way_scenario(request)[1]
    assert told == "the latest arrival, 2026-11-22T18:00:00Z, is not asked of the way ahead"


def test_a_full_result_lies_beside_the_old(voyage: Path) -> None:
    outcome = run(under_way(voyage), voyage.parent, offline=True)
    assert outcome.directory == voyage.parent / "strait-at-2026-11-22t0650z"
    earlier = {path.name for path in voyage.iterdir()}
    assert {path.name for path in outcome.directory.iterdir()} == {
        one.replace("strait-tide", "strait-at-2026-11-22t0650z-tide") for one in earlier
    }
    assert (
        "Kept: stay on the way that was planned" in (outcome.directory / "report.html").read_text()
    )
    written = load_scenario(str(outcome.directory / "scenario.toml"))
    assert not run(written, voyage.parent, offline=True).fresh


def test_what_changed_the_fuel_adds_up(voyage: Path, best: renew.Route) -> None:
    found = answer(again(voyage, currents=(str(voyage.parent.parent / "newer.nc"),), name="b"))
    assert found.has_new_current
    assert found.by_forecast > 0
    assert found.planned_fuel == pytest.approx(best.fuel)
    ahead = found.planned_fuel + found.by_drift + found.by_forecast - found.saved
    assert found.burnt + found.fuel == pytest.approx(ahead, rel=1e-9)


def test_the_route_begins_on_the_vessels_heading(voyage: Path) -> None:
    result = again(voyage, heading_deg=270.0, name="westward")
    route, water = result.routes[0].route, result.water
    through = np.array([math.cos(route.trajectory[0, 3]), math.sin(route.trajectory[0, 3])])
    east, north = water.projection.rotate_to_lonlat(result.scenario.start, through)
    assert math.degrees(math.atan2(east, north)) % 360 == pytest.approx(270.0, abs=0.01)


@pytest.mark.slow
def test_a_plan_made_under_way_is_planned_again(voyage: Path) -> None:
    newer = (str(voyage.parent.parent / "newer.nc"),)
    first = run(under_way(voyage, currents=newer, name="once"), voyage.parent, offline=True)
    second = again(
        first.directory, at="119.0500,9.5198", time=datetime.fromisoformat("2026-11-22T07:20Z")
    )
    found = answer(second)
    assert second.scenario.name == "once-at-2026-11-22t0720z"
    assert found.planned_fuel == pytest.approx(first.result.routes[0].metrics.fuel)
    # The current is that of the first time, on a clock that begins later.
    was, now = (one.case("tide").case.current for one in (first.result, second))
    assert isinstance(was, renew.VaryingCurrent)
    assert isinstance(now, renew.VaryingCurrent)
    assert np.array_equal(was.slice_times - 1800.0, now.slice_times)
    bounds = first.result.water.chart.bounds
    assert np.array_equal(was.table(bounds).uv, now.table(bounds).uv)


def with_havens(voyage: Path, folder: Path, limit: str, *havens: str) -> Path:
    """Copy the results, and what is stored of their plan; their scenario has havens."""
    shutil.copytree(voyage.parent / ".artefacts", folder / ".artefacts")
    results = folder / "strait"
    shutil.copytree(voyage, results)
    (results / "havens.csv").write_text("\n".join(["name,lon,lat", *havens, ""]))
    with (results / "scenario.toml").open("a") as file:
        file.write(f'\n[havens]\npath = "havens.csv"\n{limit}\n')
    return results


def test_endurance_counts_from_the_first_departure(voyage: Path, tmp_path: Path) -> None:
    folder = with_havens(voyage, tmp_path, 'endurance = "2h"', "North,119.05,9.55")
    time = datetime.fromisoformat(TIME)
    asked = UnderWayRequest(results=folder, at=read_position(AT), time=time)
    scenario, _ = under_way_scenario(asked)
    assert scenario.havens is not None
    assert scenario.havens.endurance == "90min"
    with pytest.raises(RequestError, match=r"08:30 UTC is beyond havens.endurance = '2h'"):
        under_way_scenario(replace(asked, time=datetime.fromisoformat("2026-11-22T08:30Z")))


@pytest.mark.slow
@pytest.mark.usefixtures("plain_report")
def test_a_vessel_far_on_the_other_side_switches(voyage: Path) -> None:
    code, said, _ = asked_on_terminal(voyage, "--at", "119.035,9.545", "--time", TIME, "--json")
    ((found,), (first, *_)) = (json.loads(said)[key] for key in ("replanned", "routes"))
    assert code == 0
    assert found["answer"] == "switched"
    assert found["fuel"] < 0.98 * found["kept_fuel"]
    assert first["way"].startswith("north")


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["--at", "119.05,9.53"], ["start (--at) = [119.05, 9.53] lies on land", "nearest water"]),
        (["--at", "118.5,9.53"], ["start (--at) = [118.5, 9.53] lies 55 km outside", "renew go"]),
        (["--at", "nan,9.53"], ["--at 'nan,9.53' is not a position"]),
        (["--heading", "400"], ["--heading 400", "from 0 to 360"]),
        (["--heading", "nan"], ["--heading nan", "from 0 to 360"]),
        (["--time", "2026-11-22T06:10Z"], ["06:10 UTC is before the departure", "06:20 UTC"]),
        (["--time", "2026-11-22T06:50"], ["has no zone"]),
        (["--time", "2026-11-23T09:30Z"], ["no way from here", "give currents that reach further"]),
        (["--time", "2026-12-23T09:30Z"], ["tide.nc", "is not before its last step"]),
        (["--departed", "2026-11-22T06:00Z"], ["--departed", "2026-11-22T06:20:00Z"]),
        (["--currents", "none.nc"], ["'none.nc' does not exist"]),
        (["--season", "winter"], ["--season: 'winter' was not planned", "tide"]),
    ],
)
def test_a_wrong_request_is_refused_whole(voyage: Path, args: list[str], said: list[str]) -> None:
    given = dict(zip(args[::2], args[1::2], strict=True))
    before = set(voyage.parent.iterdir())
    asked = {"--at": AT, "--time": TIME, "--name": "wrong"} | given
    code, _, faults = asked_on_terminal(voyage, *(word for pair in asked.items() for word in pair))
    assert code == (1 if "no way" in said[0] else 2)
    assert all(one in faults for one in said), faults
    assert len(faults.splitlines()) == 1
    assert set(voyage.parent.iterdir()) == before


def test_where_no_way_leads_on_the_havens_in_reach_are_named(voyage: Path, tmp_path: Path) -> None:
    results = with_havens(voyage, tmp_path, 'within = "2h"', WEST, EAST)
    late = ("--at", AT, "--time", "2026-11-23T09:30Z", "--name", "late")
    code, _, faults = asked_on_terminal(results, *late)
    assert code == 1
    assert len(faults.splitlines()) == 1
    way = re.search(r"turn off to West \(in (\d+) min\); no way leads on:", faults)
    assert way is not None, faults
    # 1.7 km at 1.5 m/s through the water.
    assert 10 < int(way[1]) < 40
    assert "no way from here" in faults
    assert not (results.parent / "late").exists()


def _cut(folder: Path) -> None:
    file = folder / "outputs" / "strait" / "strait-tide.geojson"
    file.write_bytes(file.read_bytes()[:-200])


def _other_current(folder: Path) -> None:
    sailing.tide_file(folder / "tide.nc", faster=1.1)


def _other_plan(folder: Path) -> None:
    file = folder / "outputs" / "strait" / "scenario.toml"
    file.write_text(file.read_text().replace("clearance = 100.0", "clearance = 120.0"))


def _same_best_route(folder: Path) -> None:
    file = folder / "outputs" / "strait" / "scenario.toml"
    edited = file.read_text().replace("classes = 2", "classes = 1")
    assert edited != file.read_text()
    file.write_text(edited)


def _other_version(folder: Path) -> None:
    file = folder / "outputs" / "strait" / "strait-tide.geojson"
    content = json.loads(file.read_text())
    for one in content["features"]:
        if one["properties"].get("feature") == "route":
            one["properties"]["fuel"] *= 1.01
    file.write_text(json.dumps(content))


@pytest.mark.gate_share(1)
@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (_cut, "is damaged"),
        (_other_current, "was planned with another current"),
        (_other_plan, "has another planner than the scenario that was run"),
        (_same_best_route, "has another planner than the scenario that was run"),
        (_other_version, "made again from its scenario it needs"),
    ],
)
def test_results_that_are_not_what_they_were_are_refused(
    voyage: Path, tmp_path: Path, damage: Callable[[Path], None], said: str
) -> None:
    folder = tmp_path / "copy"
    results = sailing.copied(voyage, folder)
    damage(folder)
    before = set(results.parent.iterdir())
    code, _, faults = asked_on_terminal(results, "--at", AT, "--time", TIME)
    assert code == 2
    assert said in faults
    assert set(results.parent.iterdir()) == before
