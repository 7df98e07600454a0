"""The offing: its formula, and that it yields in narrows."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import shapely
from hypothesis import given, strategies as st

from pipeline.findings.note_words import note_text
from pipeline.geo.projection import Projection
from pipeline.run import planned_scenario
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.model import PlannerOptions, Scenario
from pipeline.stages.choose import (
    narrows_notes,
    offing_m,
    room_notes,
    with_offing,
)
from pipeline.stages.plan_case import planned
from tests.pipeline.planar_cases import case_of
from tests.pipeline.results import rows_of

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
    st.floats(2, 400), st.floats(2, 40), st.floats(10, 3000), st.floats(0, 500), st.floats(1e3, 1e7)
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
    assert "gap is" in planned(scene, options).failure
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
