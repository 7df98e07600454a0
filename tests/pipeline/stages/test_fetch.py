"""Sources that are passed over are recorded with the season that they were passed over for."""

import math
from datetime import UTC, datetime
from pathlib import Path

import pytest
import shapely

from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.machine.store import Store
from pipeline.run import planned_scenario
from pipeline.scenario.loading import load_scenario, parse_scenario
from pipeline.scenario.model import Scenario
from pipeline.stages.fetch import fetch, with_max_hours
from pipeline.stages.region import require_covered
from tests.pipeline.conftest import ACROSS_BOX

EMBEDDED, SERVICE = "embedded-palawan", "copernicus-glorys-monthly"
REASON = f"{SERVICE} needs the network; leave --offline out"


def scenario(summer: list[str], winter: list[str]) -> Scenario:
    """Return two seasons in a small region with the given sources."""
    table = load_scenario("palawan-season").model_dump(mode="json")
    table["region"]["bbox"] = ACROSS_BOX
    table["start"], table["goal"] = [118.40, 10.20], [118.60, 10.30]
    table["planner"]["classes"] = 1
    for season, sources in zip(table["seasons"], (summer, winter), strict=True):
        season["currents"] = sources
    return Scenario.model_validate(table)


def test_only_the_season_that_falls_back_is_a_stand_in(across_outputs: Path) -> None:
    """Summer prefers the source that winter only falls back to."""
    asked = scenario([EMBEDDED], [SERVICE, EMBEDDED])
    with planned_scenario(asked, across_outputs, offline=True) as result:
        summer, winter = result.fetched.currents
    assert summer.credit.name == winter.credit.name
    assert not result.case("summer").is_stand_in
    assert result.case("winter").is_stand_in
    assert result.case("summer").title == "Summer (July 2024)"
    assert result.case("winter").title == "Winter"
    assert (summer.passed_over, winter.passed_over) == ((), ((SERVICE, REASON),))
    assert summer.stand_in_notes == ()
    used = f"winter: planned on {winter.credit.name}, valid {winter.valid}"
    assert note_texts(result.fetched.stand_in_notes) == [used]
    about = [one for one in result.fetched.notes if one.cases and one.kind != "room-kept"]
    assert note_texts(about) == [f"winter: {REASON}", used]


def test_land_goes_on_beyond_the_region_for_maps_only(across_outputs: Path) -> None:
    with planned_scenario(scenario([EMBEDDED], [EMBEDDED]), across_outputs, offline=True) as result:
        around = shapely.union_all(result.fetched.surroundings)
        region = result.scenario.area
    assert around.intersection(region).area < 1e-12
    assert around.area > 0
    west, south, east, north = result.scenario.area.bounds
    drawn = around.bounds
    assert drawn[0] < west - 0.1 or drawn[1] < south - 0.1
    assert drawn[2] > east + 0.1 or drawn[3] > north + 0.1
    charted = shapely.union_all(result.fetched.land.polygons)
    assert shapely.box(*charted.bounds).area < shapely.box(*drawn).area


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        (EMBEDDED, "has one field for a season"),
        (SERVICE, "covers January 1993 to some months ago, not 2026-11-22T06:00Z;"),
        ("copernicus-glorys-climatology", "does not show how currents change"),
    ],
)
def test_a_source_without_time_steps_of_its_own_is_refused(source: str, reason: str) -> None:
    with pytest.raises(RequestError, match=reason):
        require_covered(parse_scenario(changing(source)))


def test_a_voyage_may_take_three_times_as_long_as_straight_and_a_day() -> None:
    asked = parse_scenario(changing("still"))
    (season,) = asked.seasons
    # 60 nautical miles at 5 m/s are 6.2 hours.
    assert with_max_hours(season, asked).max_hours == math.ceil(3 * 111_000 / 5 / 3600 + 24)
    limited = season.model_copy(update={"max_hours": 7.5})
    assert with_max_hours(limited, asked).period.end == datetime(2026, 11, 22, 13, 30, tzinfo=UTC)


def changing(source: str) -> dict[str, object]:
    """Return a scenario of a degree of latitude whose current changes."""
    return {
        "schema_version": 1,
        "name": "tide",
        "vessel": "usv-7m",
        "start": [118.0, 9.0],
        "goal": [118.0, 10.0],
        "region": {"bbox": [117.0, 8.5, 119.0, 10.5]},
        "seasons": [
            {
                "name": "summer",
                "time_method": "changing",
                "departure": "2026-11-22T06:00:00Z",
                "currents": [source],
            }
        ],
    }


def test_seasons_with_the_same_reason_share_a_note(across_outputs: Path) -> None:
    asked = scenario([SERVICE, EMBEDDED], [SERVICE, EMBEDDED])
    fetched = fetch(asked, Store(across_outputs / ".artefacts"), offline=True)
    assert all(grid.is_stand_in for grid in fetched.currents)
    assert [note for note in note_texts(fetched.notes) if REASON in note] == [
        f"summer, winter: {REASON}"
    ]
    assert len(fetched.stand_in_notes) == 2


def test_what_was_passed_over_is_not_stored_with_the_current(across_outputs: Path) -> None:
    """The same artefact serves a run that prefers its source, and one that falls back to it."""
    store = Store(across_outputs / ".artefacts")
    fallback = fetch(scenario([SERVICE, EMBEDDED], [EMBEDDED]), store, offline=True)
    preferred = fetch(scenario([EMBEDDED], [EMBEDDED]), store, offline=True)
    assert fallback.current_keys == preferred.current_keys
    assert [grid.is_stand_in for grid in fallback.currents] == [True, False]
    assert [grid.is_stand_in for grid in preferred.currents] == [False, False]


@pytest.mark.parametrize("season", ["summer", "winter"])
def test_a_season_without_a_source_fails_with_its_reasons(
    across_outputs: Path, season: str
) -> None:
    sources = {"summer": [EMBEDDED], "winter": [EMBEDDED], season: [SERVICE]}
    store = Store(across_outputs / ".artefacts")
    parts = fetch(scenario(sources["summer"], sources["winter"]), store, offline=True)
    assert parts.failures == {season: f"no source of currents could be used: {REASON}"}
    assert [grid.case for grid in parts.currents] == [
        name for name in ("summer", "winter") if name != season
    ]
