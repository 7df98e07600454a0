"""A vessel with a power: energy in the figures, what is left, and what battery and tank allow."""

import csv
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.cli.answer import answer
from pipeline.errors import RequestError
from pipeline.findings.haven_rows import haven_rows
from pipeline.findings.note_words import note_texts
from pipeline.formats.passage.waypoints import case_waypoints, point_text
from pipeline.formats.tables import haven_facts, haven_texts, leg_headings, rows
from pipeline.model import planner_vessel
from pipeline.run import Outcome, run
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.loading import load_scenario, parse_scenario, scenario_text
from pipeline.scenario.model import Scenario
from pipeline.scenario.strict import validated
from tests.pipeline import tidal_run
from tests.pipeline.results import plain_pages
from tests.pipeline.voyage import sailing

FIGURES: dict[str, Any] = {"length_m": 7.0, "speed_m_s": 5.0, "turn_rate_deg_s": 16.5}
LAW = {"coefficient": 6.0, "exponent": 3.0, "hotel_w": 250.0}
# Power at 5 m/s.
WATTS = 6 * 125 + 250


def scenario(folder: Path, havens: dict[str, str] | None = None, **power: object) -> Scenario:
    """The voyage of `sailing` in still water, of a vessel with a power; with limits of havens."""
    table = load_scenario(str(sailing.scenario_file(folder))).model_dump(
        mode="json", exclude_defaults=True
    )
    departure = tidal_run.DEPARTURE.isoformat()
    table["seasons"] = [{"name": "calm", "currents": ["still"], "departure": departure}]
    table["vessel"] = FIGURES | {"power": {**LAW, **power}}
    if havens is not None:
        file = folder / "havens.csv"
        file.write_text("name,lon,lat\nWest,119.015,9.515\nEast,119.085,9.545\n")
        table["havens"] = {"path": str(file), **havens}
    return parse_scenario(table)


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Plan it with a battery that lasts 1.5 times as long as the voyage."""
    folder = tmp_path_factory.mktemp("energy")
    asked = scenario(folder, battery_wh=1500.0, reserve=0.2)
    assert parse_scenario(catalogue.read_toml(_written(asked, folder))) == asked
    with plain_pages():
        return run(asked, folder / "outputs", offline=True)


def _written(asked: Scenario, folder: Path) -> Path:
    (folder / "again.toml").write_text(scenario_text(asked))
    return folder / "again.toml"


def test_energy_is_power_times_time_and_the_rest_is_left(outcome: Outcome) -> None:
    with (outcome.directory / "metrics.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            used = WATTS * float(row["duration_s"]) / 3600
            assert float(row["energy_wh"]) == pytest.approx(used, rel=1e-6)
            assert float(row["left_wh"]) == pytest.approx(1200 - used, rel=1e-6)
    best = outcome.result.case("calm").routes[0].metrics
    assert f"{best.energy_wh:.1f} Wh, {best.left_wh:.1f} Wh left" in answer(outcome)


def test_each_waypoint_says_what_is_left(outcome: Outcome) -> None:
    points = case_waypoints(outcome.result.case("calm"))[0]
    left = 1200 - WATTS * points.time_s / 3600
    assert points.left == pytest.approx(left)
    assert leg_headings(points)["left"] == "Left, Wh"
    table = rows(points, tidal_run.DEPARTURE)
    assert [row["left"] for row in table] == [f"{math.floor(one):,}" for one in left]
    assert point_text(points, 0).endswith("; 1,200 Wh left")


@pytest.mark.slow
def test_havens_count_on_the_battery(tmp_path: Path) -> None:
    """As an endurance of that many hours does."""
    asked = scenario(tmp_path, {}, battery_wh=1500.0, reserve=0.2)
    case = run(asked, tmp_path / "outputs", offline=True).result.case("calm")
    assert "with what is on board" in haven_facts(case)[0]
    said = [haven_texts(row, case) for row in haven_rows(case)]
    assert any(row.get("fuel", "").endswith("Wh") for row in said)
    asked = scenario(tmp_path, {"endurance": f"{60 * 1200 // WATTS}min"}, battery_wh=9e3)
    given = run(asked, tmp_path / "outputs", offline=True).result.case("calm")
    assert case.coverage is not None
    assert given.coverage is not None
    for state in ("covered", "uncovered"):
        assert given.coverage.share(state) == pytest.approx(case.coverage.share(state), abs=1e-3)


def test_too_little_on_board_is_said_and_refused_for_havens(
    outcome: Outcome, tmp_path: Path
) -> None:
    asked = scenario(tmp_path, {}, tank_l=0.1, wh_per_l=3000.0)
    with pytest.raises(RequestError, match=r"havens\.endurance = '18.0 min' is below the .*tank"):
        run(asked, tmp_path / "outputs", offline=True)
    with pytest.raises(RequestError, match="or the vessel's battery or tank"):
        scenario(tmp_path, {})
    short = replace(outcome.result.planned["calm"], power=asked.vessel.power)
    best = outcome.result.case("calm").routes[0]
    short_row = replace(best.metrics, energy=short.energy)
    assert short_row.left == pytest.approx(1.08e6 - best.metrics.fuel)
    assert short_row.fuel_unit[0] == pytest.approx(1 / 1.08e7)
    from pipeline.findings.result import unsafe_notes

    (said,) = note_texts(unsafe_notes(replace(best, metrics=short_row)))
    assert said == (
        f"route 1 needs {best.metrics.fuel / 1.08e7:.4f} L, and battery or tank give 0.1000 L over "
        "the reserve: the vessel doesn't get there"
    )


@pytest.mark.parametrize(
    ("power", "words"),
    [
        ({"coefficient": 6.0}, "either w_at_m_s, or coefficient and exponent"),
        ({"w_at_m_s": [[1.0, 2.0], [2.0, 9.0]], **LAW}, "either w_at_m_s"),
        ({**LAW, "tank_l": 2.0}, "battery_wh, or tank_l and wh_per_l"),
        ({**LAW, "reserve": 1.0}, "not below 1"),
        ({"w_at_m_s": [[0.0, 2.0], [2.0, 9.0]]}, "not above 0"),
    ],
)
def test_tables_that_are_no_power_are_refused(power: dict[str, Any], words: str) -> None:
    with pytest.raises(RequestError, match=words):
        validated(VesselSpec, FIGURES | {"power": power})


def test_a_vessel_has_one_law() -> None:
    with pytest.raises(RequestError, match="has a power table and fuel_exponent"):
        validated(VesselSpec, FIGURES | {"power": LAW, "fuel_exponent": 3.0})
    spec = VesselSpec.model_validate(FIGURES | {"power": {"w_at_m_s": [[1, 9], [4, 99]]}})
    with pytest.raises(RequestError, match="speed = 5 m/s is above the speeds at which power"):
        planner_vessel(spec)
    found = planner_vessel(VesselSpec.model_validate(FIGURES | {"power": LAW}))
    assert found.rates(np.array([2.0, 5.0])) == pytest.approx([298.0, WATTS])
