"""Seasons whose current has members: eddies, a run with its files, and keys that don't agree."""

import csv
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import renew
from pipeline.errors import RequestError
from pipeline.findings.choices import ensemble_text
from pipeline.findings.result import RunResult
from pipeline.formats.report.page import gather, render
from pipeline.run import run
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.season import MembersSpec
from pipeline.stages.project import stirred
from tests.pipeline.formats.page import Page
from tests.pipeline.results import plain_pages
from tests.pipeline.small_plane import small_plane

SPEC = {"spread": 0.1, "eddy_km": 0.05, "count": 5}


def table(members: dict[str, Any] | None = None, **season: Any) -> dict[str, Any]:
    """Return a small plane whose only season has members."""
    given = tomllib.loads(small_plane("members", classes=2))
    given["planner"] |= {"padding": "none", "clearance": 8.0}  # half of the time
    given["seasons"][0] |= {"members": SPEC if members is None else members, **season}
    return given


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("members")


@pytest.fixture(scope="module")
def result(folder: Path) -> RunResult:
    with plain_pages():
        return run(parse_scenario(table()), folder).result


@pytest.mark.parametrize("is_changing", [False, True])
def test_eddies_have_the_asked_speed_and_no_mean(is_changing: bool) -> None:
    x = np.linspace(0, 1e5, 41)
    base: renew.GriddedCurrent | renew.VaryingCurrent = renew.GriddedCurrent(
        x, x, np.full((41, 41), 0.3), np.zeros((41, 41))
    )
    if is_changing:
        base = renew.VaryingCurrent([0.0, 9.0], [base, base])
    spec = MembersSpec(spread=0.2, eddy_km=15.0, count=30)
    found = stirred(base, spec, (0, 0, 1e5, 1e5), 1.0, 0)
    points = np.random.default_rng(0).uniform(0, 1e5, (400, 2))
    flow = np.array([one.velocity(points, 4.0) for one in found.currents])
    off = flow - base.velocity(points, 4.0)
    assert np.abs(off.mean(axis=0)).max() < 1e-12
    assert np.sqrt((off**2).sum(axis=-1).mean()) == pytest.approx(0.2, rel=0.1)
    # A stream function has no divergence, but for the grid's.
    one = found.currents[0]
    step = 2500.0
    east, north = np.array([step, 0.0]), np.array([0.0, step])
    inside = points * 0.8 + 1e4
    slope = (one(inside + east) - one(inside - east))[:, 0]
    slope += (one(inside + north) - one(inside - north))[:, 1]
    turn = (one(inside + east) - one(inside - east))[:, 1]
    turn -= (one(inside + north) - one(inside - north))[:, 0]
    assert np.sqrt((slope**2).mean()) < 0.1 * np.sqrt((turn**2).mean())
    with pytest.raises(RequestError, match=r"eddy_km = 0\.5 is too short for a region of this"):
        stirred(base, MembersSpec(spread=0.2, eddy_km=0.5), (0, 0, 1e5, 1e5), 1.0, 0)
    again = stirred(base, spec, (0, 0, 1e5, 1e5), 1.0, 0)
    assert np.array_equal(
        again.currents[3].velocity(points, 0.0), found.currents[3].velocity(points, 0.0)
    )


def test_a_run_writes_what_each_route_needs_in_each_member(result: RunResult, folder: Path) -> None:
    found = result.case("still").result.ensemble
    assert found is not None
    with (folder / "members" / "ensemble.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 5 * len(result.routes)
    members = result.planned["still"].members
    assert members is not None
    currents = dict(zip(found.names, members.currents, strict=True))
    for row in rows[:6]:
        route = result.routes[int(row["rank"]) - 1].route
        vessel = result.cases[0].case.vessel
        fuel = renew.fuel(route.path, currents[row["member"]], vessel)
        assert float(row["fuel"]) == pytest.approx(fuel)
    with (folder / "members" / "metrics.csv").open(newline="", encoding="utf-8") as file:
        metrics = list(csv.DictReader(file))
    for row in metrics:
        own = [float(one["fuel"]) for one in rows if one["rank"] == row["rank"]]
        best = [one["is_best"] for one in rows if one["rank"] == row["rank"]]
        assert float(row["members_mean_fuel"]) == pytest.approx(np.mean(own))
        assert float(row["members_cvar90_fuel"]) == pytest.approx(max(own))
        assert float(row["members_share"]) == pytest.approx(best.count("True") / 5)
    first, sides = metrics[0], [one.metrics.main_passage for one in result.routes]
    best_in = [sides[int(one["rank"]) - 1] for one in rows if one["is_best"] == "True"]
    assert first["members_count"] == "5"
    assert int(first["members_flips"]) == sum(side != sides[0] for side in best_in)
    assert float(first["members_gap"]) == found.gap("mean")
    assert float(first["members_waiting_saves"]) == found.waiting_saves >= 0
    assert metrics[1]["members_gap"] == ""
    assert sum(float(row["members_share"]) for row in metrics) == pytest.approx(1)
    # The best route's turns are simulated in the mean and in each member.
    turns = [
        int(row["trials"]) / result.routes[int(row["rank"]) - 1].metrics.length_m for row in metrics
    ]
    assert turns[0] == pytest.approx(6 * turns[1], rel=0.05)
    assert all(row["collisions"] == "0" for row in metrics)


def test_the_report_says_how_sure_the_side_is(result: RunResult) -> None:
    said = ensemble_text(result.case("still"))
    assert said[0].startswith(("Surely ", "Too close to call between "))
    assert "of 5 members" in said[0]
    page = Page(render(gather(result)))
    for sentence in said:
        assert sentence in page.root.text


@pytest.mark.parametrize(
    ("members", "season", "says"),
    [
        ({}, {}, "has neither of 'along' and 'spread'"),
        ({"spread": 0.1, "along": "files"}, {}, "has both of 'along' and 'spread'"),
        ({"spread": 0.1, "weights": [1.0, 2.0]}, {}, "has 'weights' for random members"),
        ({"along": "member"}, {}, "has members.along = 'member', which needs files with that"),
        ({"spread": 0.1, "choose": "worst"}, {}, "Give"),
    ],
)
def test_keys_that_do_not_agree_are_refused(
    members: dict[str, Any], season: dict[str, Any], says: str
) -> None:
    with pytest.raises(RequestError) as error:
        parse_scenario(table(members, **season))
    assert says.lower() in str(error.value).lower()
