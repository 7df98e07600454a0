"""The passage plan: its rows against the waypoints, and its pages as printed."""

from __future__ import annotations

import itertools
import re
import shutil
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import shapely

import renew
from pipeline.findings.result import RunResult
from pipeline.formats.passage.waypoints import case_waypoints
from pipeline.formats.passage_plan import write_passage_plan
from pipeline.formats.report.page import gather
from pipeline.formats.tables import distance_text, position, rows
from pipeline.model import ShoreCrossing
from tests.commands import ran
from tests.pipeline.formats import oracles, runs, small_run
from tests.pipeline.results import with_measures, with_water

DEPARTURE = datetime(2026, 12, 31, 20, 30, tzinfo=UTC)


def degrees(text: str) -> float:
    found = re.fullmatch(r"(\d{2,3})° (\d\d\.\d{3})' ([NESW])", text)
    assert found, text
    return (int(found[1]) + float(found[2]) / 60) * (-1 if found[3] in "SW" else 1)


def texts(path: Path) -> list[str]:
    """The text of each page, as another program reads it."""
    if shutil.which("pdftotext") is None:
        pytest.skip("pdftotext is not installed (Debian: poppler-utils)")
    command = ["pdftotext", "-layout", str(path), "-"]
    printed = ran(*command)
    return printed.split("\f")[:-1]


def word_boxes(path: Path) -> list[tuple[str, shapely.Polygon]]:
    """Return the words of the first page left of the map or below it, with their boxes, points."""
    if shutil.which("pdftotext") is None:
        pytest.skip("pdftotext is not installed (Debian: poppler-utils)")
    command = ["pdftotext", "-bbox", "-l", "1", str(path), "-"]
    printed = ran(*command)
    found = re.findall(
        r'<word xMin="(.*?)" yMin="(.*?)" xMax="(.*?)" yMax="(.*?)">(.*?)</word>', printed
    )
    boxes = [(word, shapely.box(*map(float, corners))) for *corners, word in found]
    map_area = shapely.box(550, 0, 842, 228)
    return [(word, box) for word, box in boxes if not map_area.intersects(box)]


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
def test_a_vessel_is_named_only_if_it_has_a_name(tmp_path: Path, name: str, begins: str) -> None:
    result = runs.across_180()
    vessel = result.scenario.vessel.model_copy(
        update={"name": name, "title": "", "length_m": 9.5, "turn_rate_deg_s": 11.31768484}
    )
    path = tmp_path / "passage-plan.pdf"
    scenario = result.scenario.model_copy(update={"vessel": vessel})
    write_passage_plan(replace(result, scenario=scenario), path)
    page = texts(path)[0]
    assert begins in page
    assert "turns at 11.3° a second." in page


@pytest.fixture(scope="module")
def plan(result: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the file of the run as it is."""
    path = tmp_path_factory.mktemp("plan") / "plan.pdf"
    write_passage_plan(result, path)
    return path


def test_a_page_says_what_a_navigator_asks(plan: Path) -> None:
    pages = texts(plan)
    assert len(pages) == 2
    for page, season in zip(pages, ("Summer", "Winter"), strict=True):
        assert f"Two islands: {season}" in page
        for part in (
            "S01-1",
            "W02-1",
            "kn through the water",
            "Padding at the tightest place",
            "scale of 1:1000",
        ):
            assert part in page
        assert "Mind: No depths in this chart" in " ".join(page.split())
        assert small_run.LAND.text in page


@pytest.mark.slow
def test_the_map_goes_on_beyond_the_regions_edge_and_names_it(
    result: RunResult, tmp_path: Path
) -> None:
    cape = shapely.box(120.15, 9.3, 121.5, 9.6)
    fetched = replace(result.fetched, surroundings=(cape,))
    for name, run in (("with", replace(result, fetched=fetched)), ("without", result)):
        write_passage_plan(run, tmp_path / f"{name}.pdf")
    assert (tmp_path / "with.pdf").stat().st_size != (tmp_path / "without.pdf").stat().st_size
    words = "edge of the region that was planned in"
    assert words not in texts(tmp_path / "with.pdf")[0]  # it lies beyond this map
    chart = renew.Chart(shapely.box(-60, -50, 60, 28), result.water.chart.no_go)
    near = with_water(result, chart=chart)
    write_passage_plan(near, tmp_path / "near.pdf")
    assert words in texts(tmp_path / "near.pdf")[0]


def test_land_of_another_shoreline_is_reported(result: RunResult, tmp_path: Path) -> None:
    crossings = (ShoreCrossing(1, 119.4, 9.4, 2461.0),)
    crossed = with_measures(result, "summer", shore_crossings=crossings)
    path = tmp_path / "passage-plan.pdf"
    write_passage_plan(crossed, path)
    summer, winter = (" ".join(page.split()) for page in texts(path))
    assert "2,461 m at 119.4000 E 9.4000 N" in summer
    assert "shoreline" not in winter


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_no_words_lie_on_each_other(result: RunResult, tmp_path: Path, scale: float) -> None:
    """The facts above the table are longer at a scale; the map's own numbers may touch."""
    scaled = replace(result, scenario=result.scenario.model_copy(update={"scale": scale}))
    write_passage_plan(scaled, tmp_path / "a.pdf")
    boxes = word_boxes(tmp_path / "a.pdf")
    assert len(boxes) > 100
    for (word, box), (other, near) in itertools.combinations(boxes, 2):
        shared = shapely.intersection(box, near).area
        # Boxes are as high as the font, nearly twice a letter, so those of lines touch.
        assert shared < 0.5 * min(box.area, near.area), (word, other)


def test_many_waypoints_go_on_another_page(result: RunResult, tmp_path: Path) -> None:
    points = case_waypoints(result.case("summer"))[0]
    at = np.linspace(0, 1, 60)[:, None]
    many = points.lonlat[0] + at * (points.lonlat[-1] - points.lonlat[0])
    each = np.append(np.full(59, 100.0), np.nan)
    long = replace(
        points,
        lonlat=many,
        course_deg=each,
        length_m=each,
        speed_m_s=each,
        port_m=each,
        starboard_m=each,
        time_s=np.linspace(0, 1e5, 60),
        names=("Start", *(f"WP{number:02d}" for number in range(2, 60)), "Goal"),
    )
    cached = {"summer": (long,), "winter": case_waypoints(result.case("winter"))}
    other = replace(result)
    other.kept["_exchange_waypoints"] = cached
    write_passage_plan(other, tmp_path / "a.pdf")
    pages = texts(tmp_path / "a.pdf")
    assert len(pages) == 4
    for number in range(2, 60):
        assert sum(f"WP{number:02d} " in page for page in pages[:3]) == 1
    assert "page 2 of 3" in pages[1]


def test_the_same_run_is_the_same_file(result: RunResult, plan: Path, tmp_path: Path) -> None:
    write_passage_plan(result, tmp_path / "two.pdf")
    assert plan.read_bytes() == (tmp_path / "two.pdf").read_bytes()


def test_what_cannot_be_written_is_an_os_error(result: RunResult, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nowhere"):
        write_passage_plan(result, tmp_path / "nowhere" / "a.pdf")


def test_still_water_is_valid_at_no_time_and_has_no_arrows(
    result: RunResult, plan: Path, tmp_path: Path
) -> None:
    moving = f"Current: {small_run.STAND_IN.name}, valid 2020-06-17."
    assert moving in texts(plan)[0].replace("\n", " ")
    grids = tuple(replace(one, u=0 * one.u, v=0 * one.v) for one in result.fetched.currents)
    calm = renew.UniformCurrent(0.0, 0.0)
    still = replace(
        result,
        fetched=replace(result.fetched, currents=grids),
        planned={name: replace(case, current=calm) for name, case in result.planned.items()},
    )
    write_passage_plan(still, tmp_path / "still.pdf")
    assert f"Current: {small_run.STAND_IN.name}. " in " ".join(
        texts(tmp_path / "still.pdf")[0].split()
    )
    assert gather(still)["speed_labels"] == ()
