"""The passage plan: its rows against the waypoints, and what the report says."""

import re
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
import shapely

import renew
from pipeline.findings.result import RunResult
from pipeline.formats.passage.waypoints import case_waypoints
from pipeline.formats.report.page import gather, plan_section
from pipeline.formats.tables import distance_text, position, rows
from tests.pipeline.formats import oracles, runs, small_run
from tests.pipeline.formats.page import Page
from tests.pipeline.formats.report.test_page import table_rows

DEPARTURE = datetime(2026, 12, 31, 20, 30, tzinfo=UTC)


def degrees(text: str) -> float:
    found = re.fullmatch(r"(\d{2,3})° (\d\d\.\d{3})' ([NESW])", text)
    assert found, text
    return (int(found[1]) + float(found[2]) / 60) * (-1 if found[3] in "SW" else 1)


@pytest.mark.parametrize("name", ["across_180", "far_north", "harbours"])
def test_rows_are_the_waypoints(name: str) -> None:
    result = getattr(runs, name)()
    points = case_waypoints(result.case(runs.SEASON))[0]
    found = rows(points, DEPARTURE)
    assert [found[0]["name"], found[-1]["name"]] == ["S01-1", f"G{len(found):02d}-1"]
    at = np.array([[degrees(row["longitude"]), degrees(row["latitude"])] for row in found])
    apart = at - points.lonlat
    apart[:, 0] = (apart[:, 0] + 180) % 360 - 180
    assert np.abs(apart).max() < 1e-5, "a thousandth of a minute"
    miles = [float(row["leg_nm"]) for row in found[1:]]
    assert miles == pytest.approx(points.length_m[:-1] / 1852, abs=0.006)
    assert float(found[0]["to_go_nm"]) == pytest.approx(sum(miles), abs=0.1)
    assert found[-1]["to_go_nm"] == "0.0"
    assert [float(row["course"]) for row in found[1:]] == pytest.approx(
        points.course_deg[:-1] % 360, abs=0.06
    )
    passed = [datetime.strptime(f"{row['passed']} +0000", "%Y-%m-%d %H:%M %z") for row in found]
    assert passed[0] == DEPARTURE
    seconds = [(one - DEPARTURE).total_seconds() for one in passed]
    assert seconds == pytest.approx(points.time_s, abs=61)


def test_every_longitude_is_within_180_degrees() -> None:
    assert position(188.25, "EW", 3) == "171° 45.000' W"


@pytest.mark.parametrize("name", ["across_180", "far_north", "harbours"])
def test_each_leg_is_as_clear_of_land_as_it_says(name: str) -> None:
    result = getattr(runs, name)()
    points = case_waypoints(result.case(runs.SEASON))[0]
    land = shapely.union_all(result.water.land)
    for row, leg in zip(rows(points, None)[1:], oracles.drawn(points, 20.0), strict=True):
        line = oracles.in_plane(result, leg)
        gap = shapely.get_coordinates(shapely.shortest_line(line, land))
        true_m = result.water.projection.geodesic_length_m(gap)
        figure, unit = row["clearance"].split()
        stated_m = float(figure) * (1852 if unit == "NM" else 1)
        assert stated_m <= true_m * 1.001
        assert stated_m == pytest.approx(true_m, rel=0.02, abs=20)


def test_a_following_current_is_given_with_its_direction() -> None:
    """In summer it sets to the east at 0.2 to 0.4 m/s, which is 0.4 to 0.8 kn."""
    result = small_run.parts()
    for row in rows(case_waypoints(result.case("summer"))[0], None)[1:]:
        to, knots = row["current"].split()
        assert 60 <= int(to) <= 120
        assert 0.38 <= float(knots) <= 0.8


def test_distances_are_never_overstated() -> None:
    assert distance_text(1851.99) == "1851 m"
    assert distance_text(2.999 * 1852) == "2.99 NM"
    assert distance_text(float("inf")) == "no land"
    assert position(-0.5, "NS", 2) == "00° 30.000' S"
    assert position(179.9999999, "EW", 3) == "180° 00.000' E"


@pytest.mark.parametrize(
    ("name", "begins"),
    [("vessel", "Vessel: 9.5 m long; "), ("otter", "Vessel: otter, 9.5 m long; ")],
)
def test_a_vessel_is_named_only_if_it_has_a_name(name: str, begins: str) -> None:
    result = runs.across_180()
    vessel = result.scenario.vessel.model_copy(
        update={"name": name, "title": "", "length_m": 9.5, "turn_rate_deg_s": 11.31768484}
    )
    scenario = result.scenario.model_copy(update={"vessel": vessel})
    found = plan_section(replace(result, scenario=scenario).cases[0])
    assert found is not None
    assert found["sentences"][0].startswith(begins)
    assert "turns at 11.3° a second." in found["sentences"][0]


def test_the_report_has_each_waypoint_and_leg(result: RunResult, page: Page) -> None:
    for number, case in enumerate(result.cases, 1):
        found = plan_section(case)
        assert found is not None
        headings, *cells = table_rows(page, f"season-{number}-plan")
        assert headings == found["headings"]
        assert cells == [[" ".join(cell.split()) for cell in row] for row in found["rows"]]
        names = [row[0] for row in cells]
        assert names == list(case_waypoints(case)[0].names)
        for sentence in found["sentences"]:
            assert sentence in page.root.text


def test_a_plane_has_no_passage_plan(planar_result: RunResult) -> None:
    assert plan_section(planar_result.cases[0]) is None


def test_still_water_has_no_arrows(result: RunResult) -> None:
    grids = tuple(replace(one, u=0 * one.u, v=0 * one.v) for one in result.fetched.currents)
    calm = renew.UniformCurrent(0.0, 0.0)
    still = replace(
        result,
        fetched=replace(result.fetched, currents=grids),
        planned={name: replace(case, current=calm) for name, case in result.planned.items()},
    )
    assert gather(still)["speed_labels"] == ()
