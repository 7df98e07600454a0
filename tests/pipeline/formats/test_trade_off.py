"""The trade-off of fuel against arrival: as files, in sentences, as a plot."""

import csv
import re
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import renew
from pipeline.findings.choices import SpeedTradeOff, speed_notes, trade_off, trade_off_text
from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RunResult
from pipeline.formats.figures.plots import trade_off_figure
from pipeline.formats.report.page import gather, render
from pipeline.formats.tables import write_scenario, write_table
from pipeline.scenario.catalogue import read_toml
from pipeline.scenario.season import Season
from pipeline.write import formats_of
from tests.pipeline import chosen_speeds
from tests.pipeline.formats import small_run
from tests.pipeline.formats.page import Page
from tests.pipeline.tidal_run import DEPARTURE


@pytest.fixture(scope="module")
def result() -> RunResult:
    return chosen_speeds.planned()


@pytest.fixture(scope="module")
def found(result: RunResult) -> SpeedTradeOff:
    one = trade_off(result.case("chosen"))
    assert one is not None
    return one


def test_the_files_hold_the_curve_and_the_chosen_arrival(result: RunResult, tmp_path: Path) -> None:
    write_table(result, tmp_path / "trade-off.csv")
    with (tmp_path / "trade-off.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["season"] for row in rows} == {"chosen"}
    hours = [float(row["hours"]) for row in rows]
    fuels = [float(row["fuel"]) for row in rows]
    assert hours == sorted(hours)
    # The curve is for speeds that vary continuously; a route has one speed a leg.
    assert (np.diff(fuels) <= 1e-3 * fuels[0]).all()
    (chosen,) = (row for row in rows if row["is_chosen"] == "True")
    best = result.case("chosen").routes[0].metrics
    assert float(chosen["fuel"]) == best.fuel
    assert float(chosen["of_chosen"]) == 1.0
    assert float(chosen["hours"]) * 3600 == pytest.approx(best.duration_s)
    arrival = datetime.fromisoformat(chosen["arrival"])
    assert abs(arrival - DEPARTURE - chosen_speeds.WITHIN) < timedelta(seconds=10)


def test_another_arrival_costs_what_the_curve_says(result: RunResult, found: SpeedTradeOff) -> None:
    """A plan for another arrival needs the fuel that the trade-off has there, nearly."""
    by = result.results[0].arrive_by_s
    assert by is not None
    for share in (0.75, 1.3):
        plan = chosen_speeds.plan_by_renew(result, share * by)
        assert found.fuel_after(share * found.duration_s) == pytest.approx(plan.best.fuel, rel=5e-3)


def test_the_sentences_say_how_fast_and_what_time_is_worth(
    result: RunResult, found: SpeedTradeOff
) -> None:
    how, worth, earliest, latest = trade_off_text(found)
    low, high = map(float, re.findall(r"of ([\d.]+)–([\d.]+) m/s", how)[0])
    assert found.slowest - 1e-6 <= low < found.slowest + 0.01
    assert found.fastest - 0.01 < high <= found.fastest + 1e-6
    assert "among 0.8–3 m/s, bring the vessel to the goal by 2026-11-22 08:00 UTC" in how
    more = found.fuel_after(1.1 * found.duration_s)
    assert f"10.0 min more would save {100 * (1 - more / found.fuel):.1f} %" in worth
    assert "10.0 min less would take" in worth
    assert f"{100 * (found.fuels[0] / found.fuel - 1):.1f} % more fuel" in earliest
    assert "More time saves fuel until" in latest
    (note,) = note_texts(speed_notes(result))
    assert note == f"chosen: {how[:-1]}"
    one_speed = replace(found, slowest=2.0, fastest=2.0, durations_s=np.array([found.duration_s]))
    one_speed = replace(one_speed, fuels=np.array([found.fuel]))
    (only,) = trade_off_text(one_speed)
    assert "A speed of 2 m/s through water all the way" in only
    assert trade_off_figure(one_speed) is None
    early = replace(found, arrive_by=found.arrive_by + timedelta(days=1))
    early = replace(early, choice=replace(found.choice, within_s=found.choice.within_s + 86_400.0))
    assert "before the deadline of 2026-11-23 08:00 UTC" in trade_off_text(early)[0]


def test_the_plot_marks_the_chosen_arrival(found: SpeedTradeOff) -> None:
    figure = trade_off_figure(found)
    assert figure is not None
    (axes,) = figure.axes
    curve, deadline, chosen = (np.asarray(line.get_xydata()) for line in axes.get_lines())
    size = 100 / found.metrics.still_fuel
    assert curve == pytest.approx(np.column_stack([found.durations_s / 3600, size * found.fuels]))
    assert deadline[0, 0] == pytest.approx(chosen_speeds.WITHIN.total_seconds() / 3600)
    assert chosen == pytest.approx(np.array([[found.duration_s / 3600, size * found.fuel]]))
    assert axes.texts[0].get_text().startswith("2026-11-22 08:00 UTC\n1.7 h")


def test_the_page_says_how_fast_and_plots_it(result: RunResult) -> None:
    text = Page(render(gather(result))).root.flat_text
    assert text.count("How fast") == 2
    assert "Speed through water" in text
    assert "at one speed in the same time" in text
    speeds = result.case("chosen").routes[0].route.speeds
    assert f"{speeds.min():.2f}–{speeds.max():.2f} m/s" in text
    assert "2026-11-22 06:20 UTC to 2026-11-22 08:00 UTC" in text


def test_still_water_is_that_of_the_same_time(result: RunResult) -> None:
    own, best = (result.case(name).routes[0] for name in ("own", "chosen"))
    for metrics, speed in (
        (own.metrics, 1.5),
        (best.metrics, best.metrics.length_m / best.metrics.duration_s),
    ):
        vessel = replace(result.cases[0].case.vessel, speed=speed)
        line = np.array([[0.0, 0.0], [metrics.length, 0.0]])
        still = renew.fuel(line, renew.UniformCurrent(0.0, 0.0), vessel)
        assert metrics.still_fuel == pytest.approx(still)


def test_the_files_are_written_where_speeds_are_chosen_and_the_choice_is_kept(
    result: RunResult, tmp_path: Path
) -> None:
    assert "trade-off.csv" in formats_of(result)
    assert "trade-off.csv" not in formats_of(small_run.parts())
    write_scenario(result, tmp_path / "scenario.toml")
    chosen, own = read_toml(tmp_path / "scenario.toml")["seasons"]
    assert Season.model_validate(chosen) == result.scenario.seasons[0]
    assert "speed" not in own
