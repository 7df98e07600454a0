"""RTZ: valid by our own strict schema (and the published ones, if available), and correct."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any, TypeAlias

import pytest
from lxml import etree

from pipeline.findings.result import RunResult
from pipeline.formats.passage.routes import write_rtz
from pipeline.formats.passage.waypoints import case_waypoints
from tests.pipeline.formats import runs
from tests.pipeline.results import with_rows
from tests.validators import rtz_faults

# lxml has no types.
Element: TypeAlias = Any

VERSIONS = ("1.0", "1.1", "1.2")
MINUS_FIVE = timezone(timedelta(hours=-5))
DEPARTURE = datetime(2026, 12, 31, 20, 30, tzinfo=MINUS_FIVE)


def written(
    result: RunResult,
    path: Path,
    season: str = runs.SEASON,
    *,
    version: str = "1.1",
    departure: datetime | None = None,
) -> Element:
    outputs = result.scenario.outputs.model_copy(update={"rtz_version": version})
    scenario = result.scenario.model_copy(update={"outputs": outputs})
    write_rtz(replace(result, scenario=scenario).case(season), path, departure=departure)
    return etree.parse(path).getroot()


def all_of(root: Element, name: str) -> list[Element]:
    return list(root.iter(f"{{{root.nsmap[None]}}}{name}"))


@pytest.mark.gate_share(18)
@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("departure", [None, DEPARTURE])
def test_every_version_is_valid(
    any_run: RunResult, tmp_path: Path, version: str, departure: datetime | None
) -> None:
    for entry in any_run.results:
        path = tmp_path / f"{entry.name}.rtz"
        root = written(any_run, path, entry.name, version=version, departure=departure)
        assert not any(rtz_faults(root, version))
        assert root.get("version") == version
        assert path.stat().st_size < 400_000


@pytest.mark.gate_share(15)
@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize(
    "spoil",
    [
        lambda root: root.set("colour", "red"),
        lambda root: root[1][1].set("radius", "10.5"),
        lambda root: root[1][1].set("id", "-1"),
        lambda root: root[1][1][0].set("lon", "180"),
        lambda root: root[1][1][0].set("lat", "1e1"),
        lambda root: root[1][1].remove(root[1][1][0]),
        lambda root: root[1][2][1].set("portsideXTD", "1e-05"),
        lambda root: root[1][2][1].set("geometryType", "Straight"),
        lambda root: root[2][0][0][1].set("speed", "fast"),
        lambda root: root.remove(root[0]),
    ],
)
def test_the_schema_refuses_what_is_wrong(
    tmp_path: Path, version: str, spoil: Callable[[Element], None]
) -> None:
    root = written(runs.across_180(), tmp_path / "a.rtz", version=version)
    assert not any(rtz_faults(root, version))
    spoil(root)
    assert all(rtz_faults(root, version))


def test_a_file_is_valid_only_as_its_own_version(tmp_path: Path) -> None:
    for version in VERSIONS:
        root = written(runs.across_180(), tmp_path / "a.rtz", version=version)
        for other in set(VERSIONS) - {version}:
            assert all(rtz_faults(root, other))


def test_the_file_has_what_checkers_look_for(any_run: RunResult, tmp_path: Path) -> None:
    season = any_run.results[0].name
    root = written(any_run, tmp_path / "some-season.rtz", season)
    (info,) = all_of(root, "routeInfo")
    assert info.get("routeName") == "some-season"
    assert info.get("routeAuthor") == "RENEW"
    identities = [waypoint.get("id") for waypoint in all_of(root, "waypoint")]
    assert len(set(identities)) == len(identities) >= 2
    assert [e.get("waypointId") for e in all_of(root, "scheduleElement")] == identities


@pytest.mark.parametrize(
    ("title", "written_name"),
    [
        ("", "sea-otter"),
        ("Sea otter", "Sea otter"),
        ("Autonomous surface vehicle of the paper, 2 m", "sea-otter"),
    ],
)
def test_the_vessels_name_is_short(tmp_path: Path, title: str, written_name: str) -> None:
    """Checkers warn above 32 characters."""
    result = runs.across_180()
    vessel = result.scenario.vessel.model_copy(update={"name": "sea-otter", "title": title})
    result = replace(result, scenario=result.scenario.model_copy(update={"vessel": vessel}))
    (info,) = all_of(written(result, tmp_path / "a.rtz"), "routeInfo")
    assert info.get("vesselName") == written_name


def test_a_vessel_without_a_name_has_none_in_the_file(tmp_path: Path) -> None:
    result = runs.across_180()
    vessel = result.scenario.vessel.model_copy(update={"name": "vessel", "title": ""})
    result = replace(result, scenario=result.scenario.model_copy(update={"vessel": vessel}))
    root = written(result, tmp_path / "a.rtz")
    assert not any(rtz_faults(root, "1.1"))
    (info,) = all_of(root, "routeInfo")
    assert info.get("vesselName") is None


def test_positions_and_legs_are_those_of_the_best_route(any_run: RunResult, tmp_path: Path) -> None:
    season = any_run.results[0].name
    points = case_waypoints(any_run.case(season))[0]
    assert points.ranked.rank == 1
    root = written(any_run, tmp_path / "a.rtz", season)
    positions = all_of(root, "position")
    assert len(positions) == len(points.lonlat)
    for position, (longitude, latitude) in zip(positions, points.lonlat, strict=True):
        assert float(position.get("lat")) == pytest.approx(latitude, abs=1e-8)
        assert (float(position.get("lon")) - longitude) % 360 in (
            pytest.approx(0, abs=2e-8),
            pytest.approx(360, abs=2e-8),
        )
    # A waypoint has the leg that leads to it; the start has none.
    legs = [waypoint.find("{*}leg") for waypoint in all_of(root, "waypoint")]
    assert legs[0] is None
    for index, leg in enumerate(legs[1:]):
        assert leg.get("geometryType") == points.curve
        for name, limits in (("portsideXTD", points.port_m), ("starboardXTD", points.starboard_m)):
            metres = float(leg.get(name)) * 1852
            # Rounded down, by at most 2 cm.
            assert limits[index] - 0.02 <= metres <= limits[index]
    for waypoint, radius in zip(all_of(root, "waypoint"), points.radius_m, strict=True):
        assert radius - 0.02 <= float(waypoint.get("radius")) * 1852 <= radius


def test_speeds_and_positions_give_the_duration(any_run: RunResult, tmp_path: Path) -> None:
    season = any_run.results[0].name
    points = case_waypoints(any_run.case(season))[0]
    root = written(any_run, tmp_path / "a.rtz", season)
    knots = [float(e.get("speed")) for e in all_of(root, "scheduleElement")[1:]]
    hours = sum(points.length_m[:-1] / 1852 / knots)
    assert hours * 3600 == pytest.approx(points.time_s[-1], rel=1e-4)


def test_without_a_departure_there_are_no_times(any_run: RunResult, tmp_path: Path) -> None:
    season = any_run.results[0].name
    for version in VERSIONS:
        root = written(any_run, tmp_path / "a.rtz", season, version=version)
        names = {name for element in root.iter() for name in element.attrib}
        assert not names & {"eta", "etd", "stay", "validityPeriodStart", "validityPeriodStop"}


def test_with_a_departure_times_are_in_utc(tmp_path: Path) -> None:
    result = runs.across_180()
    points = case_waypoints(result.case(runs.SEASON))[0]
    elements = all_of(written(result, tmp_path / "a.rtz", departure=DEPARTURE), "scheduleElement")
    assert elements[0].get("etd") == "2027-01-01T01:30:00Z"
    assert elements[0].get("eta") is None
    for element, seconds in zip(elements[1:], points.time_s[1:], strict=True):
        time = datetime.fromisoformat(element.get("eta"))
        assert time.tzinfo == UTC
        assert (time - DEPARTURE).total_seconds() == pytest.approx(seconds, abs=1)
        assert element.get("etd") is None


def test_what_is_not_known_is_in_the_file(tmp_path: Path) -> None:
    result = runs.across_180()
    result = with_rows(result, lambda _, row: replace(row, filled_share=0.125))
    for version in VERSIONS:
        root = written(result, tmp_path / "a.rtz", version=version)
        assert not any(rtz_faults(root, version))
        (unknown,) = root.iter("{urn:renew:provenance:1}unknown")
        (info,) = all_of(root, "routeInfo")
        for place in (unknown.text, info.get("optimizationMethod")):
            assert "o depths in this chart: the draught was not used" in place
            assert "no current is given on 12.5 % of route 1" in place
