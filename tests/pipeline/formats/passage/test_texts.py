"""Texts in exchange files: caveats, bad names, nautical units."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import TYPE_CHECKING

import gpxpy
import numpy as np
import pyogrio
import pytest
from lxml import etree

from pipeline.findings.names import safe_name
from pipeline.findings.result import RunResult
from pipeline.findings.text import duration
from pipeline.formats.gis.geopackage import write_geojson
from pipeline.formats.passage.missions import write_mission, write_plan
from pipeline.formats.passage.routes import write_gpx, write_rtz
from pipeline.formats.passage.waypoints import (
    KNOTS_PER_M_S,
    case_waypoints,
    leg_text,
    time_after,
    waypoint_names,
    wrapped_longitude,
)
from pipeline.formats.tables import write_metrics
from pipeline.texts import clean
from pipeline.write import formats_of
from tests.pipeline.formats import runs, small_run
from tests.pipeline.formats.passage.test_gpx import check_order
from tests.pipeline.formats.passage.test_rtz import VERSIONS
from tests.pipeline.results import with_measures
from tests.validators import rtz_faults

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from pipeline.findings.result import RunResult

WRITERS: dict[str, Callable[..., None]] = {
    "rtz": write_rtz,
    "gpx": write_gpx,
    "plan": write_plan,
    "waypoints": write_mission,
    "geojson": write_geojson,
}
# Files with room for words; a mission for ArduPilot's tools has none.
SPEAKING = ("rtz", "gpx", "plan")


@pytest.mark.parametrize("end", WRITERS)
def test_what_cannot_be_written_is_an_os_error(end: str, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nowhere"):
        WRITERS[end](runs.across_180().case(runs.SEASON), tmp_path / "nowhere" / f"a.{end}")


@pytest.mark.parametrize("end", ["rtz", "gpx"])
def test_a_departure_without_a_zone_is_refused(end: str, tmp_path: Path) -> None:
    naive = datetime(2026, 12, 31, 20, 30)  # noqa: DTZ001 - this is what is refused
    with pytest.raises(ValueError, match="no time zone"):
        WRITERS[end](runs.across_180().case(runs.SEASON), tmp_path / "a", departure=naive)
    assert not list(tmp_path.iterdir())


def with_hits(result: RunResult) -> RunResult:
    """The run, with two turns of winter's best route that met land."""
    turns, *others = result.case("winter").measures.turns
    collided = np.zeros(len(turns.points), dtype=bool)
    collided[[5, 9]] = True
    best, *rows = result.case("winter").measures.routes
    flown = (replace(turns, collided=collided), *others)
    return with_measures(result, "winter", routes=(replace(best, collisions=2), *rows), turns=flown)


@pytest.mark.parametrize("end", SPEAKING)
def test_a_route_that_is_not_safe_says_so_in_every_file(end: str, tmp_path: Path) -> None:
    result = small_run.parts()
    told = {}
    for name, run in (("safe", result), ("unsafe", with_hits(result))):
        WRITERS[end](run.case("winter"), tmp_path / f"{name}.{end}")
        told[name] = (tmp_path / f"{name}.{end}").read_text(encoding="utf-8").lower()
    row = result.case("winter").measures.routes[0]
    assert f"not safe everywhere: 2 of {row.trials:,} hard-over turns" in told["unsafe"]
    assert "not safe" not in told["safe"]
    assert "everywhere" not in told["safe"]
    if end == "rtz":
        assert f"none of {row.trials:,} simulated hard-over turns met land" in told["safe"]
        assert f"2 of {row.trials:,} simulated hard-over turns met land" in told["unsafe"]


@pytest.mark.parametrize("end", SPEAKING)
def test_every_file_names_the_current_that_was_used(end: str, tmp_path: Path) -> None:
    """Summer is planned on a stand-in, winter on what was asked for."""
    result = small_run.parts()
    for season in ("summer", "winter"):
        WRITERS[end](result.case(season), tmp_path / f"{season}.{end}")
        grid = result.case(season).grid
        assert grid is not None
        told = (tmp_path / f"{season}.{end}").read_text(encoding="utf-8").lower()
        assert f"planned on {grid.credit.name}, valid {grid.valid}".lower() in told


def test_metrics_name_the_current_that_was_used(tmp_path: Path) -> None:
    result = small_run.parts()
    write_metrics(result, tmp_path / "metrics.csv")
    text = (tmp_path / "metrics.csv").read_text(encoding="utf-8")
    for grid in result.fetched.currents:
        assert f"{grid.credit.name}, {grid.valid.replace('/', ' to ')}" in text


NAMES = (
    "<script>alert(1)</script>",
    "../../etc/passwd",
    "a" * 300,
    "\N{SAILBOAT}\N{VARIATION SELECTOR-16} \N{FLAG IN HOLE}",
    "\N{RIGHT-TO-LEFT OVERRIDE}gpj.exe\N{POP DIRECTIONAL FORMATTING} \u05e9\u05dc\u05d5\u05dd",
    "tab\tnull\x00bell\x07escape\x1b[31mend",
    "half of a pair \ud83d",
    "quote\" apostrophe' &amp; ]]> <!-- -->",
    "not a character \uffff",
)


@pytest.fixture(params=NAMES, ids=range(len(NAMES)))
def named(request: pytest.FixtureRequest) -> tuple[str, RunResult]:
    """Give a run whose titles, vessel and credits all have such a name, as it comes in."""
    name = clean(request.param)
    result = runs.across_180()
    scenario = result.scenario.model_copy(
        update={
            "title": name,
            "description": name,
            "vessel": result.scenario.vessel.model_copy(update={"title": name}),
        }
    )
    land = replace(
        result.fetched.land,
        credits=tuple(replace(credit, text=name) for credit in result.fetched.land.credits),
    )
    return name, replace(result, scenario=scenario, fetched=replace(result.fetched, land=land))


@pytest.mark.gate_share(9)
@pytest.mark.parametrize("version", VERSIONS)
def test_rtz(named: tuple[str, RunResult], tmp_path: Path, version: str) -> None:
    name, result = named
    path = tmp_path / f"{safe_name(name)}.rtz"
    outputs = result.scenario.outputs.model_copy(update={"rtz_version": version})
    scenario = result.scenario.model_copy(update={"outputs": outputs})
    write_rtz(replace(result, scenario=scenario).case(runs.SEASON), path)
    root = etree.parse(path).getroot()
    assert not any(rtz_faults(root, version))
    assert root[0].get("routeName") == path.stem
    # An attribute's white space is spaces; a long title gives way to the vessel's name.
    short = name if len(name) <= 32 else result.scenario.vessel.name
    assert root[0].get("vesselName").split() == short.split()
    texts = {element.tag.rpartition("}")[2]: element.text for element in root.iter()}
    assert texts["title"].startswith(name)
    assert texts["description"] == name
    assert name in texts["credits"]


@pytest.mark.usefixtures("every_driver")
def test_gpx(named: tuple[str, RunResult], tmp_path: Path) -> None:
    name, result = named
    path = tmp_path / f"{safe_name(name)}.gpx"
    case = result.case(runs.SEASON)
    write_gpx(case, path, every=True)
    check_order(etree.parse(path).getroot())
    gpx = gpxpy.parse(path.read_text(encoding="utf-8"))
    assert (gpx.name or "").startswith(name)
    assert (gpx.description or "").count(name) == 2
    assert name.split()[0] in (gpx.copyright_author or "")
    assert len(pyogrio.read_dataframe(path, layer="routes")) == len(case.followed)


def test_geojson(named: tuple[str, RunResult], tmp_path: Path) -> None:
    name, result = named
    path = tmp_path / f"{safe_name(name)}.geojson"
    write_geojson(result.case(runs.SEASON), path)
    content = json.loads(path.read_text(encoding="utf-8"))
    assert content["title"].startswith(name)
    assert name in content["credits"]
    assert len(pyogrio.read_dataframe(path)) == len(content["features"])


def test_a_text_of_a_megabyte_is_shortened(tmp_path: Path) -> None:
    result = runs.across_180()
    path = tmp_path / "a.rtz"
    long = replace(result, scenario=result.scenario.model_copy(update={"description": "x" * 10**6}))
    write_rtz(long.case(runs.SEASON), path)
    assert path.stat().st_size < 100_000


def test_routes_of_a_plane_are_not_for_a_plotter(
    result: RunResult, planar_result: RunResult
) -> None:
    assert any(name.endswith(".gpx") for name in formats_of(result))
    assert not any(name.endswith((".gpx", ".pdf")) for name in formats_of(planar_result))


def test_a_knot_is_a_nautical_mile_an_hour() -> None:
    assert pytest.approx(19.438, abs=1e-3) == 10 * KNOTS_PER_M_S


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0, "0 h 00 min"), (29, "0 h 00 min"), (14_055, "3 h 54 min"), (360_000, "100 h 00 min")],
)
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("longitude", "normal"),
    [
        (0.0, 0.0),
        (179.5, 179.5),
        (180.0, -180.0),
        (181.8, -178.2),
        (-180.0, -180.0),
        (-181.0, 179.0),
        (359.5, -0.5),
        (179.999_999_999, -180.0),
    ],
)
def test_longitudes_are_from_minus_180_to_below_180(longitude: float, normal: float) -> None:
    assert wrapped_longitude(longitude) == pytest.approx(normal, abs=1e-8)
    assert wrapped_longitude(longitude) < 180


def test_times_are_in_utc_and_whole_seconds() -> None:
    departure = datetime(2026, 3, 1, 1, 0, 0, 700_000, tzinfo=timezone(timedelta(hours=2)))
    assert time_after(departure, 3600.4) == datetime(2026, 3, 1, 0, 0, 0, tzinfo=UTC)
    with pytest.raises(ValueError, match="no time zone; add one"):
        time_after(departure.replace(tzinfo=None), 0)


def test_waypoints_are_named_by_their_position_and_via_points_as_such() -> None:
    places = np.array([[0.0, 0.0], [1.0, 2.0], [3.0, 2.0], [4.0, 0.0]])
    assert waypoint_names(places, np.empty((0, 2)), 1) == ("S01-1", "W02-1", "W03-1", "G04-1")
    # Positions of waypoints are rounded to a millimetre.
    assert waypoint_names(places, np.array([[3.001, 2.0]]), 12)[2] == "V03-12"


def test_no_name_is_cut_by_a_plotter_that_keeps_six_characters() -> None:
    places = np.column_stack([np.arange(150.0), np.zeros(150)])
    names = [
        name for rank in range(1, 17) for name in waypoint_names(places, np.empty((0, 2)), rank)
    ]
    assert max(map(len, names)) == 6
    assert len(set(names)) == len(names)


def test_limits_are_a_mile_at_most_and_due_north_is_000() -> None:
    (points,) = case_waypoints(runs.open_sea().case(runs.SEASON))
    assert "cross-track limits 1852 m to port, 1852 m to starboard" in leg_text(points, 0)
    north = replace(points, course_deg=np.full_like(points.course_deg, 359.97))
    assert leg_text(north, 0).startswith("course 000.0°, ")


def test_a_leg_is_described_in_a_navigators_units() -> None:
    points = case_waypoints(runs.across_180().case(runs.SEASON))[0]
    text = leg_text(points, 0)
    course, miles, knots, time = text.partition(";")[0].split(", ")
    assert course == f"course {points.course_deg[0]:05.1f}°"
    assert float(miles.removesuffix(" NM")) * 1852 == pytest.approx(points.length_m[0], abs=10)
    assert float(knots.removesuffix(" kn")) * 1852 / 3600 == pytest.approx(
        points.speed_m_s[0], abs=0.003
    )
    assert time == duration(points.time_s[1])
    assert f"cross-track limits {int(points.port_m[0])} m to port" in text
