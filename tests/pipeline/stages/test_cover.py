"""Havens of a scenario: which ways lead to them, what is written, and what is refused."""

import csv
import itertools
from datetime import timedelta
from pathlib import Path
from typing import Any, TypeAlias

import geopandas
import gpxpy
import numpy as np
import pytest
import shapely

from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.formats.report.page import gather
from pipeline.formats.tables import HAVEN_COLUMNS
from pipeline.run import Event, Outcome, run
from pipeline.scenario.loading import load_scenario, parse_scenario, scenario_text
from pipeline.scenario.model import Scenario
from pipeline.sources.land.vector import read_havens
from tests.pipeline import tidal_run
from tests.pipeline.formats.gis.tables import layer
from tests.pipeline.voyage import sailing
from tests.pipeline.voyage.waters import scenario_of

Covered: TypeAlias = tuple[Outcome, Scenario, Path]
WITHIN_S = 1500.0
SHUT_UNTIL_NOON = {"path": "range.geojson", "until": "2026-11-22T12:00:00Z"}
# Near the start, near the goal, on the island, and off the chart.
HAVENS = """name,lon,lat
West,119.015,9.515
East,119.085,9.545
Island,119.05,9.53
Far,120.5,9.53
"""


@pytest.fixture(scope="module")
def covered(tmp_path_factory: pytest.TempPathFactory) -> Covered:
    """Plan a voyage with havens; return outcome, scenario and folder."""
    folder = tmp_path_factory.mktemp("havens")
    (folder / "havens.csv").write_text(HAVENS)
    asked = scenario(folder)
    return run(asked, folder / "outputs", offline=True), asked, folder


def scenario(folder: Path, **havens: object) -> Scenario:
    """Return the voyage of `sailing` in still water, with havens."""
    if not (folder / "havens.csv").exists():
        (folder / "havens.csv").write_text(HAVENS)
    file = sailing.scenario_file(folder)
    table = load_scenario(str(file)).model_dump(mode="json", exclude_defaults=True)
    departure = tidal_run.DEPARTURE.isoformat()
    table["seasons"] = [{"name": "calm", "currents": ["still"], "departure": departure}]
    path = str(folder / "havens.csv")
    return parse_scenario({**table, "havens": {"path": path, "within": "25min", **havens}})


def rows(outcome: Outcome) -> list[dict[str, str]]:
    """Return the rows of the table."""
    with (outcome.directory / "havens.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_stretches_of_the_table_are_the_whole_route(covered: Covered) -> None:
    found = [
        row for row in rows(covered[0]) if row["kind"] in {"covered", "uncovered", "not settled"}
    ]
    track = covered[0].result.case("calm").routes[0].route.trajectory
    assert [*found[0]] == [*HAVEN_COLUMNS]
    assert float(found[0]["begin_s"]) == 0.0
    assert float(found[-1]["end_s"]) == pytest.approx(track[-1, 0], rel=1e-3)
    for one, other in itertools.pairwise(found):
        assert one["end_s"] == other["begin_s"]


def test_who_carries_on_and_turns_off_is_at_a_haven_within_the_limit(covered: Covered) -> None:
    found = [row for row in rows(covered[0]) if row["kind"] == "covered"]
    assert found
    for row in found:
        ahead_s = float(row["turn_off_s"]) - float(row["begin_s"])
        assert float(row["turn_off_s"]) >= float(row["end_s"]) - 1e-6
        in_all_s = ahead_s + 3600 * float(row["hours"])
        # A vessel that is late may take longer; the limit holds for it, too.
        assert in_all_s <= 3600 * float(row["longest_hours"]) + 1e-3
        assert 3600 * float(row["longest_hours"]) <= WITHIN_S + 1e-6
        assert row["haven"] in {"West", "East"}


def test_up_to_the_last_change_the_other_side_costs_little_more(covered: Covered) -> None:
    (row,) = [one for one in rows(covered[0]) if one["kind"] == "last change"]
    result = covered[0].result
    best, other, *_ = result.case("calm").routes
    assert best.metrics.main_passage != other.metrics.main_passage
    assert row["haven"] == f"goal by route {other.rank}"
    spent = best.route.fuel * float(row["turn_off_s"]) / best.metrics.duration_s
    assert other.route.fuel <= spent + float(row["fuel"]) <= 1.02 * other.route.fuel
    goal = result.water.projection.to_lonlat(result.stops[-1])
    assert [float(row["haven_lon"]), float(row["haven_lat"])] == pytest.approx(goal.tolist())


def test_times_are_those_of_the_departure(covered: Covered) -> None:
    for row in rows(covered[0]):
        moment = tidal_run.DEPARTURE + timedelta(seconds=round(float(row["begin_s"])))
        assert row["begin"] == f"{moment:%Y-%m-%dT%H:%M:%SZ}"


def test_havens_on_land_and_off_the_chart_are_named(covered: Covered) -> None:
    said = note_texts(covered[0].fetched.notes)
    assert any("'Island'" in one and "lies on land" in one for one in said)
    assert any("'Far'" in one and "outside the region" in one for one in said)
    assert any("of the best route, by time, a planned way leads to a haven" in one for one in said)


def ways(outcome: Outcome) -> dict[int, dict[str, str]]:
    """Return a row for each way, by its number."""
    return {int(row["way"]): row for row in rows(outcome) if row["way"]}


def test_plotters_get_each_way_from_its_turn_off_to_its_haven(covered: Covered) -> None:
    folder, known = covered[0].directory, ways(covered[0])
    found = gpxpy.parse((folder / "strait-calm-havens.gpx").read_text()).routes
    assert [route.number for route in found] == sorted(known)
    for number, row in known.items():
        route = found[number - 1]
        gpx = [(one.longitude, one.latitude) for one in route.points]
        ends = [(row["lon"], row["lat"]), (row["haven_lon"], row["haven_lat"])]
        assert np.array([gpx[0], gpx[-1]]) == pytest.approx(np.array(ends, dtype=float), abs=1e-6)
        assert row["haven"] in str(route.name)


def test_the_layers_are_the_route_in_stretches_the_ways_and_the_havens(covered: Covered) -> None:
    package = covered[0].directory / "routes.gpkg"
    coverage, diversions, havens, routes = (
        layer(package, name) for name in ("coverage", "diversions", "havens", "routes")
    )
    kinds = [row["kind"] for row in rows(covered[0])]
    assert list(coverage.state) == kinds[: len(coverage)]
    best = routes[routes["rank"] == 1].geometry.item()
    assert coverage.geometry.length.sum() == pytest.approx(best.length, rel=1e-3)
    assert coverage.geometry.union_all().hausdorff_distance(best) < 1e-3
    assert sorted(diversions.diversion) == sorted(ways(covered[0]))
    assert set(havens.name) == {"West", "East"}


def test_a_section_of_the_report_says_when_to_turn_off(covered: Covered) -> None:
    (season,) = gather(covered[0].result)["seasons"]
    assert len(season["havens"]["rows"]) == len(rows(covered[0]))
    printed = season["havens"]["rows"]
    assert [row["kind"] for row in printed] == [row["kind"] for row in rows(covered[0])]
    (last,) = [row for row in rows(covered[0]) if row["kind"] == "abort point"][:1]
    page = next(row for row in printed if row["kind"] == "abort point")
    assert page["haven"] == last["haven"]
    assert (
        page["turn_off"] == last["turn_off"][:16].replace("T", " ")
        or last["turn_off"][17:19] >= "30"
    )
    assert "Ways to havens" in (covered[0].directory / "report.html").read_text()


def test_a_second_run_looks_for_no_way(covered: Covered) -> None:
    _, asked, folder = covered
    events: list[Event] = []
    again = run(asked, folder / "outputs", offline=True, on_event=events.append)
    assert not again.fresh
    assert "cover" in [event.stage for event in events if event.status == "done"]
    assert len(list((folder / "outputs" / ".artefacts" / "cover").glob("*.artefact"))) == 1


def test_a_scenario_with_havens_reads_back(covered: Covered) -> None:
    _, asked, folder = covered
    (folder / "again.toml").write_text(scenario_text(asked))
    assert load_scenario(str(folder / "again.toml")) == asked


def test_if_no_haven_lies_in_the_water_nothing_is_planned(tmp_path: Path) -> None:
    (tmp_path / "havens.csv").write_text("name,lon,lat\nIsland,119.05,9.53\nFar,120.5,9.5\n")
    events: list[Event] = []
    with pytest.raises(RequestError, match=r"Island lies on land.*Far lies outside the region"):
        run(scenario(tmp_path), tmp_path / "outputs", offline=True, on_event=events.append)
    assert "plan" not in {event.stage for event in events}


@pytest.mark.parametrize(
    ("havens", "others", "words"),
    [
        ({"within": None}, {}, "neither 'within' nor 'endurance'"),
        ({"within": "1min"}, {}, "one full turn takes the vessel 90 s"),
        ({"within": "6 hours"}, {}, "is not an interval"),
        ({"path": "nowhere.csv"}, {}, "does not exist; give a GeoJSON file"),
        ({}, {"avoid": [SHUT_UNTIL_NOON]}, r"has \[havens\] together with hours in \[\[avoid\]\]"),
    ],
)
def test_what_can_not_be_covered_is_refused(
    tmp_path: Path, havens: dict[str, Any], others: dict[str, Any], words: str
) -> None:
    table = scenario(tmp_path).model_dump(mode="json", exclude_defaults=True) | others
    table["havens"] = {k: v for k, v in (table["havens"] | havens).items() if v is not None}
    with pytest.raises(RequestError, match=words):
        parse_scenario(table, tmp_path)


def test_an_endurance_below_the_route_is_refused_with_its_time(covered: Covered) -> None:
    folder = covered[2]
    with pytest.raises(RequestError, match=r"endurance = '30min' is below the .* h that"):
        run(scenario(folder, endurance="30min"), folder / "outputs", offline=True)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("name,lon,lat\n", "has no points; give points"),
        ("name,foo\nA,1\n", "has no points; give points"),
        ("name,lon,lat\nA,200,95\n", "not on earth"),
        ("name,lon,lat\nA,1,2\nA,2,2\n", "several havens called 'A'"),
    ],
)
def test_a_file_without_usable_points_is_refused(tmp_path: Path, content: str, words: str) -> None:
    (tmp_path / "havens.csv").write_text(content)
    with pytest.raises(RequestError, match=words):
        read_havens(tmp_path / "havens.csv")


def test_points_without_a_name_are_numbered_and_projected_ones_turned_to_degrees(
    tmp_path: Path,
) -> None:
    frame = geopandas.GeoDataFrame(
        {"name": [None, "B"]},
        geometry=shapely.points([[119.0, 9.5], [119.1, 9.6]]),
        crs="EPSG:4326",
    )
    frame.to_crs("EPSG:32650").to_file(tmp_path / "h.gpkg", layer="h")
    havens = read_havens(tmp_path / "h.gpkg")
    assert list(havens) == ["haven 1", "B"]
    assert (havens["B"].x, havens["B"].y) == pytest.approx((119.1, 9.6), abs=1e-7)


def test_on_the_command_line_a_list_needs_a_limit_and_a_limit_a_list(tmp_path: Path) -> None:
    voyage = {
        "start": "119.005,9.53", "goal": "119.095,9.53", "vessel": "usv-7m", "currents": ["still"],
    }  # fmt: skip
    (tmp_path / "h.csv").write_text(HAVENS)
    havens = {"havens": tmp_path / "h.csv"}
    with pytest.raises(RequestError, match="--havens needs a limit"):
        scenario_of({**voyage, **havens})
    with pytest.raises(RequestError, match="add --havens FILE"):
        scenario_of({**voyage, "within": "6h"})
    listed = scenario_of({**voyage, **havens, "within": "6h"})[0].havens
    assert listed is not None
    assert (listed.path, listed.within) == (str(tmp_path / "h.csv"), "6h")
