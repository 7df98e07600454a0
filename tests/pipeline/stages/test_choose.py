"""The departure of a season is chosen before it is planned, and its clock begins then."""

import math
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st

import renew
from pipeline.errors import RequestError
from pipeline.findings.choices import departure_text
from pipeline.findings.note_words import note_json, note_text
from pipeline.findings.result import RunResult
from pipeline.findings.text import exact_moment_text
from pipeline.formats.figures.plots import departure_figure
from pipeline.geo.projection import Projection
from pipeline.machine.store import Artefact, Store, artefact_key
from pipeline.model import DepartureChoice, Note
from pipeline.model.case import SpeedChoice
from pipeline.run import planned_scenario
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.model import PlannerOptions, Scenario
from pipeline.scenario.season import Season, departure_name
from pipeline.stages.choose import (
    Chosen,
    choose_departures,
    narrows_notes,
    offing_m,
    room_notes,
    with_offing,
)
from pipeline.stages.plan_case import planned, planned as planned_case
from renew.request import Request
from renew.vary import departures as renew_departures
from tests.pipeline.planar_cases import case_of
from tests.pipeline.results import rows_of
from tests.pipeline.tidal_run import DEPARTURE, run, tide

COUNT = 5


@pytest.fixture(scope="module")
def result() -> RunResult:
    """A run in open water, whose tide is known for fourteen hours."""
    return run(tide(14), ())


def _chosen(
    result: RunResult,
    folder: Path,
    notes: list[Note],
    scheduler: str | None = None,
    **asked: object,
) -> Chosen:
    keys = {**result.scenario.seasons[0].model_dump(exclude_none=True), **asked}
    season = Season.model_validate({k: v for k, v in keys.items() if v is not None})
    scenario = result.scenario.model_copy(update={"seasons": (season,)})
    fetched = replace(result.fetched, land_key="land", current_keys={"tide": "current"})
    case = replace(result.planned["tide"], speeds=SpeedChoice.of(season))
    store, given = Store(folder, "test"), Chosen(scenario, fetched, Artefact("cases", (case,)))
    return choose_departures(given, store, notes.append, scheduler)


WINDOW = {"first": DEPARTURE.isoformat(), "every": "1h", "count": COUNT}


def test_the_best_departure_becomes_the_seasons_own(result: RunResult, tmp_path: Path) -> None:
    notes: list[Note] = []
    departed = _chosen(
        result, tmp_path, notes, departure=None, departures=WINDOW, to_within="30min"
    )
    (choice,) = departed.choices
    assert len(choice.departures_s) > COUNT
    assert choice.unproven_s <= 1800.1
    assert choice.durations_s.min() == choice.least_s
    (season,) = departed.scenario.seasons
    assert season.departure == choice.chosen
    assert season.departures is None
    assert departed.case("tide").departure == choice.chosen
    # Single plans at the clock of the whole tide and at the season's own agree.
    options = departed.scenario.planner
    plan = planned_case(departed.case("tide"), options).plan
    assert plan is not None
    assert plan.best.times[0] == 0.0
    assert plan.best.duration == pytest.approx(choice.least_s, rel=2e-3)
    before = result.case("tide").case.current.velocity(result.stops[0], choice.chosen_s)
    now = departed.case("tide").current.velocity(result.stops[0], 0.0)
    assert now == pytest.approx(before, abs=1e-4)
    (grid,) = departed.fetched.currents
    (asked,) = result.fetched.currents
    assert grid.times_s + round(choice.chosen_s) == pytest.approx(asked.times_s)
    assert departed.fetched.current_keys["tide"] != "current"
    assert departed.cases.key != "cases"
    assert notes[0] == Note.of("departures-asked", count=5)
    (note,) = {*departed.notes}  # each note is given once
    assert note_text(note).startswith("Leave at ")
    assert note_json(note)["values"]["choice"]["chosen_s"] == choice.chosen_s  # type: ignore[index]
    # The choice is stored, and nothing is reported a second time.
    again: list[Note] = []
    same = _chosen(result, tmp_path, again, departure=None, departures=WINDOW, to_within="30min")
    assert again == []
    assert same.cases.key == departed.cases.key


def test_a_scheduler_finds_the_same_departure_and_the_same_failure(
    result: RunResult, tmp_path: Path
) -> None:
    from distributed import LocalCluster

    asked: dict[str, Any] = {"departure": None, "departures": {**WINDOW, "count": 3}}
    too_late = {"arrive_by": (DEPARTURE + timedelta(minutes=1)).isoformat()}
    found, reasons = [], []
    with LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0", protocol="tcp"
    ) as cluster:
        for folder, scheduler in (("here", None), ("there", str(cluster.scheduler_address))):
            notes: list[Note] = []
            departed = _chosen(result, tmp_path / folder, notes, scheduler, **asked)
            found.append(artefact_key("choice", departed.choices, departed.cases.key))
            # A worker does not tell how far it is.
            assert bool(notes) == (scheduler is None)
            with pytest.raises(RequestError) as error:
                _chosen(result, tmp_path / folder, [], scheduler, **too_late)
            reasons.append(str(error.value))
    assert found[0] == found[1]
    assert reasons[0] == reasons[1]


def test_each_minute_of_a_window_is_planned_once_at_most(
    result: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Halving steps around the best departure must not end at three times within a minute."""
    planned: list[float] = []
    sailing_at = renew_departures.sailing_at

    def counted(request: Request, departure: float) -> renew_departures.Sailing:
        planned.append(departure)
        return sailing_at(request, departure)

    monkeypatch.setattr(renew_departures, "sailing_at", counted)
    last = DEPARTURE + timedelta(minutes=50)
    window = {"first": DEPARTURE.isoformat(), "every": "30min", "count": 2}
    asked: dict[str, Any] = {
        "departures": {**window, "last": last.isoformat()},
        "to_within": "2min",
    }
    (choice,) = _chosen(result, tmp_path, [], departure=None, **asked).choices
    minutes = choice.departures_s / 60
    assert minutes == pytest.approx(minutes.round())
    assert len(set(minutes.round())) == len(minutes)
    assert sorted(planned) == list(choice.departures_s)
    assert minutes[-1] == 50


def test_a_season_without_a_name_of_its_own_is_named_by_the_chosen_departure(
    result: RunResult, tmp_path: Path
) -> None:
    """If the vessel leaves hours into the window, no file has its beginning in the name."""
    old = departure_name(DEPARTURE - timedelta(hours=1))
    (grid,) = result.fetched.currents
    data = result.scenario.seasons[0].model_dump(exclude_none=True)
    data |= {"name": old, "departures": {**WINDOW, "count": 3}}
    del data["departure"]
    season = Season.model_validate(data)
    scenario = result.scenario.model_copy(update={"seasons": (season,)})
    fetched = replace(
        result.fetched, currents=(replace(grid, case=old),), current_keys={old: "current"}
    )
    case = replace(result.planned["tide"], name=old)
    notes: list[Note] = []
    given = Chosen(scenario, fetched, Artefact("cases", (case,)))
    departed = choose_departures(given, Store(tmp_path, "test"), notes.append)
    (choice,) = departed.choices
    new = departure_name(choice.chosen)
    assert new != old
    (named,) = departed.scenario.seasons
    assert (named.name, choice.season, named.title) == (new, new, "")
    assert choice.asked == season
    assert [one.name for one in departed.cases.value] == [new]
    assert departed.case(new).departure == choice.chosen
    assert [one.case for one in departed.fetched.currents] == [new]
    assert list(departed.fetched.current_keys) == [new]


def test_an_arrival_sets_the_departure(result: RunResult, tmp_path: Path) -> None:
    by = DEPARTURE + timedelta(hours=6)
    departed = _chosen(result, tmp_path, [], arrive_by=by.isoformat())
    (choice,) = departed.choices
    arrival = choice.chosen + timedelta(seconds=choice.least_s)
    assert by - timedelta(seconds=2e-3 * choice.least_s + 1) <= arrival <= by
    assert departed.scenario.seasons[0].departure == choice.chosen
    (sentence,) = departure_text(choice)
    assert sentence.startswith(
        f"Leave at {exact_moment_text(choice.chosen)}, the latest departure that"
    )
    assert departure_figure(choice) is None


def test_an_arrival_that_cannot_be_made_is_refused_with_dates(
    result: RunResult, tmp_path: Path
) -> None:
    by = DEPARTURE + timedelta(minutes=20)
    with pytest.raises(RequestError) as caught:
        _chosen(result, tmp_path, [], arrive_by=by.isoformat())
    message = str(caught.value)
    assert "season 'tide': arrive_by = 2026-11-22 06:40 UTC can't be made" in message
    assert "a departure at 2026-11-22 06:20 UTC arrives at 2026-11-22" in message


@pytest.mark.slow
def test_each_departure_has_speeds_to_be_there_in_time(result: RunResult, tmp_path: Path) -> None:
    """The choice agrees with single plans at their own speeds, and keeps its arrival."""
    by = DEPARTURE + timedelta(hours=8)
    asked: dict[str, Any] = {
        "departure": None,
        "departures": {**WINDOW, "every": "2h", "count": 2},
        "arrive_by": by.isoformat(),
        "speed": {"least": 1.0, "most": 8.0},
    }
    departed = _chosen(result, tmp_path, [], **asked)
    (choice,) = departed.choices
    assert choice.has_speeds
    assert len(choice.departures_s) == 2
    (season,) = departed.scenario.seasons
    assert (season.departure, season.arrive_by) == (choice.chosen, by)
    speeds = departed.case("tide").speeds
    assert speeds is not None
    assert speeds.within_s == (by - choice.chosen).total_seconds()
    plan = planned_case(departed.case("tide"), departed.scenario.planner).plan
    assert plan is not None
    assert plan.best.fuel == pytest.approx(choice.fuels.min(), rel=2e-3)
    assert plan.best.times[-1] <= (by - choice.chosen).total_seconds()
    best, *_, proof = departure_text(choice)
    assert "it needs the least fuel to be there in time, at speeds chosen for" in best
    assert proof.startswith("Nothing is known about departures between these")
    figure = departure_figure(choice)
    assert figure is not None
    (axes,) = figure.axes
    above = np.asarray(axes.get_lines()[0].get_xydata())[:, 1]
    assert above == pytest.approx(100 * (choice.fuels / choice.fuels.min() - 1))


def test_a_season_without_a_departure_leaves_the_next_one_its_own(
    result: RunResult, tmp_path: Path
) -> None:
    (season,) = result.scenario.seasons
    late = season.model_copy(
        update={"name": "late", "departure": None, "arrive_by": DEPARTURE + timedelta(minutes=20)}
    )
    window = Season.model_validate(
        {**season.model_dump(exclude_none=True, exclude={"departure"}), "departures": WINDOW}
    )
    scenario = result.scenario.model_copy(update={"seasons": (late, window)})
    (grid,), case = result.fetched.currents, result.planned["tide"]
    fetched = replace(
        result.fetched,
        currents=(replace(grid, case="late"), grid),
        current_keys={"late": "current", "tide": "current"},
    )
    cases = (replace(case, name="late"), case)
    given = Chosen(scenario, fetched, Artefact("cases", cases))
    departed = choose_departures(given, Store(tmp_path, "test"), lambda _: None)
    assert [choice.season for choice in departed.choices] == ["tide"]
    assert [*departed.fetched.current_keys] == ["tide"]
    assert "can't be made" in departed.fetched.failures["late"]
    assert [one.departure for one in departed.scenario.seasons] == [
        None,
        departed.choices[0].chosen,
    ]


def test_a_departure_that_is_given_is_left_alone(result: RunResult, tmp_path: Path) -> None:
    departed = _chosen(result, tmp_path, [])
    assert departed.choices == ()
    assert departed.case("tide").current is result.planned["tide"].current
    assert departed.cases.key == "cases"


CHOICE = DepartureChoice(
    season="tide",
    first=DEPARTURE,
    departures_s=np.linspace(0.0, 14_400.0, 5),
    fuels=np.array([110.0, 100.5, 100.0, 104.0, np.inf]),
    durations_s=np.array([39600.0, 36180.0, 36000.0, 37440.0, np.inf]),
    homotopies=("e", "e", "e", "s1", ""),
    reasons=("", "", "", "", "all 2 classes were rejected: it is late"),
    chosen_s=7200.0,
    unproven_s=900.0,
)


def test_when_to_leave_is_written_in_sentences() -> None:
    best, dearest, window, shut, proof = departure_text(CHOICE)
    assert best.startswith("Leave at 2026-11-22 08:20 UTC: of 4 departures")
    assert "at 2026-11-22 06:20 UTC, needs 10.0 % more" in dearest
    assert "from 2026-11-22 07:20 UTC to 2026-11-22 08:20 UTC" in window
    assert shut.startswith(
        "1 of the departures planned can't be sailed; for example 2026-11-22 10:20"
    )
    assert "no other departure in this window saves more than 15.0 min" in proof
    unproven = departure_text(replace(CHOICE, unproven_s=np.inf))[-1]
    assert unproven.startswith("Nothing is known")


def test_the_plot_marks_the_best_departure_and_the_bound() -> None:
    figure = departure_figure(CHOICE)
    assert figure is not None
    (axes,) = figure.axes
    durations, dots, floor, chosen = (np.asarray(line.get_xydata()) for line in axes.get_lines())
    assert durations[:4] == pytest.approx(
        np.column_stack([np.arange(4), CHOICE.durations_s[:4] / 3600])
    )
    assert np.isnan(durations[4, 1])
    assert len(dots) == 4
    assert floor[0, 1] == pytest.approx(10 - 0.25)
    assert chosen[0, 0] == 2
    low, high = axes.get_ylim()
    assert low < 9.75
    assert high > 11
    assert "2026-11-22 08:20 UTC: 10.0 h" in axes.texts[0].get_text()


def test_the_choice_is_of_what_renew_plans(result: RunResult, tmp_path: Path) -> None:
    departed = _chosen(result, tmp_path, [], departure=None, departures={**WINDOW, "count": 2})
    (choice,) = departed.choices
    options = result.scenario.planner
    for at, fuel in zip(choice.departures_s, choice.fuels, strict=True):
        plan = renew.plan(
            result.water.chart,
            result.case("tide").case.current,
            result.cases[0].case.vessel,
            result.stops[0],
            result.stops[-1],
            departure=at,
            min_lateness=3600.0,
            **options.model_dump(exclude={"snap", "lanes"}),
        )
        assert plan.best.fuel == pytest.approx(fuel, rel=2e-3)


# --- The offing: its formula, and that it yields in narrows ---


FAR_M, MILE_M = 1e6, 1852.0


def ship(length_m: float, speed_kn: float, circle_m: float) -> VesselSpec:
    speed = speed_kn * MILE_M / 3600
    turn_rate = math.degrees(speed / (circle_m / 2))
    return VesselSpec(length_m=length_m, speed_m_s=speed, turn_rate_deg_s=turn_rate)


def test_it_is_what_a_mariner_would_keep() -> None:
    small = offing_m(catalogue.vessel("usv-7m"), 60.0, FAR_M)
    assert small / MILE_M == pytest.approx(0.4, abs=0.05)
    assert offing_m(ship(200, 15, 700), 60.0, FAR_M) / MILE_M == pytest.approx(0.9, abs=0.05)


@given(
    st.floats(2, 400),
    st.floats(2, 40),
    st.floats(100, 3000),
    st.floats(0, 500),
    st.floats(1e3, 1e7),
)
def test_it_is_wider_than_the_turn_and_the_charts_error_but_for_short_voyages(
    length_m: float, speed_kn: float, circle_m: float, accuracy_m: float, distance_m: float
) -> None:
    vessel = ship(length_m, speed_kn, circle_m)
    kept_m = offing_m(vessel, accuracy_m, distance_m)
    limit_m = distance_m / 200
    assert 0 < kept_m <= limit_m * (1 + 1e-9)
    if kept_m < limit_m * (1 - 1e-9):
        assert kept_m > accuracy_m + max(circle_m, length_m) * 0.999
        further = offing_m(vessel, accuracy_m, 2 * distance_m)
        assert kept_m == pytest.approx(further)


def a_wall(gap_m: float, **planner: object) -> Scenario:
    """Return a wall from edge to edge, with a gap of some width between start and goal."""
    walls = [[490, -10, 510, 500 - gap_m / 2], [490, 500 + gap_m / 2, 510, 1010]]
    corners = [shapely.get_coordinates(shapely.box(*wall)).tolist() for wall in walls]
    return parse_scenario(
        {
            "schema_version": 1,
            "name": "wall",
            "vessel": "paper-asv",
            "start": [50, 500],
            "goal": [950, 500],
            "plane": {"extent": [0, 0, 1000, 1000], "obstacles": corners},
            "seasons": [{"name": "calm", "uniform": {"u": 0.1}}],
            "planner": planner,
        }
    )


@pytest.mark.parametrize("gap_m", [60.0, 30.0])
def test_the_length_with_reduced_offing_is_reported(gap_m: float) -> None:
    scene, options = (
        case_of(a_wall(gap_m)),
        PlannerOptions(clearance=40.0, narrow_share=0.5, classes=1),
    )
    season = planned(scene, options)
    (note,) = narrows_notes(scene.water, [season], options)
    values: dict[str, Any] = dict(note.values)
    line = shapely.LineString(season.routes[0].path)
    land = shapely.union_all(scene.chart.no_go)
    assert values["least_m"] == pytest.approx(shapely.distance(line, land), rel=0.05)
    closer = shapely.intersection(line, shapely.buffer(land, 40.0)).length
    assert values["length_m"] == pytest.approx(closer, abs=2 * 4)
    assert gap_m / 4 * 0.95 <= values["least_m"] <= gap_m / 2
    said = note_text(note)
    assert "the best route keeps less than the offing of 40 m" in said
    assert "m beyond the chart's margin at" in said
    assert "inside the margin, that is half of the distance to land" in said


def test_a_reduced_offing_stands_below_the_table(tmp_path: Path) -> None:
    """The table's clearance is less than the offing there: both stand among the choices."""
    asked = a_wall(60.0, clearance=40.0, narrow_share=0.5, classes=1)
    with planned_scenario(asked, tmp_path, offline=True) as result:
        assert rows_of(result)[0].clearance_m < 40.0
        assert "offing-yields" in {note.kind for note in result.choices}


def test_where_the_offing_has_room_it_does_not_yield() -> None:
    scene, options = (
        case_of(a_wall(200.0)),
        PlannerOptions(clearance=40.0, narrow_share=0.5, classes=1),
    )
    assert narrows_notes(scene.water, [planned(scene, options)], options) == ()


def test_what_the_room_is_for_is_told_by_what_turns_need() -> None:
    """The turns' part is what a plan without an offing pads at most, on the same edges."""
    scene = case_of(a_wall(200.0))
    for clearance in (40.0, 0.5):
        options = PlannerOptions(clearance=clearance, classes=1)
        (note,) = room_notes(scene.water, [planned(scene, options)], options)
        values: dict[str, Any] = dict(note.values)
        bare = planned(scene, PlannerOptions(classes=1)).routes[0]
        assert values["turns_m"] == pytest.approx(bare.padding_used[:, 4].max(), rel=1e-6)
        assert values["offing_m"] == clearance
        assert ("the offing decides" in note_text(note)) == (clearance > 5)
    plain = PlannerOptions(clearance=40.0, classes=1, padding="none")
    assert room_notes(scene.water, [planned(scene, plain)], plain) == ()


def test_a_clearance_that_is_given_is_never_reduced() -> None:
    scene, options = case_of(a_wall(60.0)), PlannerOptions(clearance=40.0, classes=1)
    assert "the gap at" in planned(scene, options).failure
    scenario = parse_scenario(scenario_text(clearance=40.0))
    assert with_offing(scenario, scene, 60.0) is scenario.planner


def test_on_a_chart_it_is_chosen_with_its_share() -> None:
    scenario = parse_scenario(scenario_text())
    scene = case_of(a_wall(60.0))
    projection = Projection.at(118.5, 9.75)
    water = replace(scene.water, is_planar=False, projection=projection)
    scene = replace(scene, water=water)
    chosen = with_offing(scenario, scene, 60.0)
    assert chosen.narrow_share == 0.5
    assert chosen.clearance == 4.0  # a two-hundredth of 900 m, in whole metres


def scenario_text(**planner: float) -> dict[str, object]:
    return {
        "schema_version": 1,
        "name": "a-voyage",
        "vessel": "usv-7m",
        "start": [118.0, 9.0],
        "goal": [118.5, 9.5],
        "seasons": [{"name": "calm", "currents": ["still"]}],
        "planner": planner,
    }
