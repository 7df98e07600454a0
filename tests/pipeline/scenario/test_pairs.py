"""Random subsets of a scenario's features are planned, or refused by a row of the table of pairs.

What a feature needs (a departure, a clock, a draught) is drawn with it. Any other refusal, a plan
that fails, or a crash is a pair of features that doesn't compose and that nobody said so of.
"""

import random
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st

from pipeline.errors import RequestError
from pipeline.findings.result import RunResult
from pipeline.run import planned_scenario, run
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.pairs import OF_A_SEASON, OF_THE_SCENARIO, PAIRS
from pipeline.sources.current_field import Field
from tests.pipeline.results import plain_pages
from tests.pipeline.sources.depth_grids import emodnet
from tests.pipeline.synthetic_currents import dataset, write
from tests.strategies import examples

Draw = Callable[[Sequence[Any]], Any]
"""Draws one of several values."""
# Whether a voyage has a feature: half of them, a quarter, and one in twenty.
EITHER = (False, True)
FEW = (*[False] * 3, True)
RARE = (*[False] * 19, True)
# Half an hour before high water at the bar, off Boston, near enough to its station.
DEPARTURE = np.datetime64("2026-11-23T00:30")
START, UNDER_WAY, ANCHORAGE = [-71.03, 42.34], [-71.022, 42.34], [-71.02, 42.34]
GOAL = [-70.99, 42.34]
WEST, SOUTH, EAST, NORTH = BOX = (-71.05, 42.325, -70.97, 42.355)
ISLAND = shapely.box(-71.012, 42.337, -71.008, 42.343)
BAR = shapely.box(-71.0105, 42.30, -71.0095, 42.40)
SHORE = shapely.box(-71.02, 42.347, -71.00, 42.350)
SCALES = (*[1.0] * 11, 2.0)
ISLAND_M = [[40, 30], [60, 30], [60, 70], [40, 70]]
VESSEL = {"length_m": 7.0, "draught_m": 1.5, "speed_m_s": 3.0, "turn_rate_deg_s": 16.5}


def time(minutes: int) -> str:
    """Some minutes after the departure."""
    return f"{DEPARTURE + np.timedelta64(minutes, 'm')}:00Z"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the files of a water with a bar and an island."""
    made = tmp_path_factory.mktemp("pairs")
    make_files(made)
    return made


def make_files(folder: Path) -> None:
    """Write land, depths, currents, an area and havens."""
    (folder / "island.geojson").write_text(shapely.to_geojson(ISLAND))
    (folder / "area.geojson").write_text(shapely.to_geojson(SHORE))
    (folder / "havens.csv").write_text("name,lon,lat\nWest,-71.028,42.336\nEast,-70.992,42.336\n")
    lon, lat = np.arange(-71.06, -70.96, 0.001), np.arange(42.315, 42.365, 0.001)
    on_bar = shapely.contains_xy(BAR, *np.meshgrid(lon, lat))
    for name, depth_m in (("shallow", 0.8), ("deep", 3.0)):
        emodnet(folder / f"{name}.nc", lon, lat, np.where(on_bar, -depth_m, -20.0))
    lon = np.linspace(WEST - 0.02, EAST + 0.02, 15)
    lat = np.linspace(SOUTH - 0.02, NORTH + 0.02, 11)
    strength = 0.2 + 0.1 * (lat[:, None] - SOUTH) / (NORTH - SOUTH) * np.ones(lon.size)
    steps = [Field(lon, lat, strength * np.cos(0.5 * i), 0.3 * strength) for i in range(36)]
    hours = np.datetime64("2026-11-22T12:00") + np.arange(36) * np.timedelta64(1, "h")
    write(folder / "hourly.nc", dataset(*steps, times=hours))
    write(folder / "month.nc", dataset(steps[0], times=("2026-11-15",)))
    asked = off_boston(lambda values: values[0])
    asked |= {"name": "sailed", "planner": {"classes": 2}}
    asked["seasons"] = [{"name": "day", "departure": time(-4), "currents": ["still"]}]
    with plain_pages():
        run(parse_scenario(asked, folder), folder / "outputs", offline=True)


def planner(draw: Draw) -> dict[str, Any]:
    """Options of the planner, mostly its own."""
    options: dict[str, Any] = {"classes": 2, "drift": draw(["projected", "crab"])}
    if draw(RARE):
        options |= {"method": "sampled", "samples": 20}
    if draw(RARE):
        options["adrift"] = "2min"
    if draw(RARE):
        options["order"] = draw(["length", "depth-first"])
    if draw(RARE):
        options["padding"] = "none"
    elif draw(RARE):
        options["risk_at"] = "point"
    return options


def times(draw: Draw, *, has_clock: bool, has_speed: bool) -> dict[str, Any]:
    """When a season's vessel leaves and arrives: what is open needs a clock, or speeds."""
    season: dict[str, Any] = {}
    if has_clock and draw(EITHER):
        season["departures"] = {"first": time(0), "every": "20min", "count": 3}
        if draw(EITHER):
            season["to_within"] = "10min"
    elif has_clock or has_speed or draw(EITHER):
        season["departure"] = time(0)
    if has_speed or (has_clock and draw(EITHER)):
        season["arrive_by"] = time(100)
    if has_speed:
        season["speed"] = {"least": 2.0, "most": 4.0}
    return season


def off_boston(draw: Draw) -> dict[str, Any]:
    """Draw a voyage over a bar, in lon/lat."""
    has_tide, has_area, is_shut_for_hours = draw(FEW), draw(EITHER), draw(FEW)
    is_changing, has_speed = draw(EITHER), draw(FEW)
    has_clock = is_changing or has_tide or (has_area and is_shut_for_hours)
    season: dict[str, Any] = {"name": "day"}
    season |= times(draw, has_clock=has_clock, has_speed=has_speed)
    if is_changing:
        season |= {"time_method": "changing", "currents": ["./hourly.nc"]}
    elif draw(EITHER):
        season |= {"valid": "2026-11", "currents": ["./month.nc"]}
    else:
        season["currents"] = ["still"]
    if draw(FEW):
        season["members"] = {"spread": 0.1, "count": 3, "eddy_km": 3.0}
    chart = {"source": {"path": "island.geojson", "accuracy_m": 5, "complete": True}}
    asked: dict[str, Any] = {
        "schema_version": 1,
        "name": "bar",
        "start": START,
        "goal": GOAL,
        "vessel": VESSEL,
        "region": {"bbox": list(BOX)},
        "chart": {**chart, "datum": "MLLW", "depths": "shallow.nc" if has_tide else "deep.nc"},
        "seasons": [season],
        "planner": planner(draw),
        "scale": draw(SCALES),
    }
    if has_tide:
        asked["tide"] = {"stations": ["boston"]}
    if has_area:
        hours = {"from": time(-600), "until": time(20)} if is_shut_for_hours else {}
        asked["avoid"] = [{"path": "area.geojson", **hours}]
    if draw(FEW):
        can_wait = has_clock and draw(EITHER)
        asked["via"] = [{"at": ANCHORAGE, "wait": "1h"} if can_wait else ANCHORAGE]
    if draw(FEW):
        limit = draw([{"within": "40min"}, {"endurance": "4h"}])
        asked["havens"] = {"path": "havens.csv", **limit}
    if "departure" in season and draw(RARE):
        sailed = {"results": "outputs/sailed", "season": "day", "departed": time(-4)}
        asked |= {"under_way": sailed, "start": UNDER_WAY}
    if draw(RARE):
        season |= {"currents": [], "uniform": {"u": 0.1}}
    return asked


def in_a_plane(draw: Draw) -> dict[str, Any]:
    """Draw a voyage round an island in a plane, now and then with what lies in lon/lat."""
    season: dict[str, Any] = {"name": "day"}
    season |= {"gyre": {"amplitude": 0.3}} if draw(EITHER) else {"uniform": {"u": 0.1}}
    if draw(FEW):
        times = {"departure": time(0), "arrive_by": time(3)}
        season |= {"speed": {"least": 0.7, "most": 1.4}, **times}
    elif draw(EITHER):
        season["departure"] = time(0)
    if draw(FEW):
        season["members"] = {"spread": 0.05, "count": 3, "eddy_km": 0.05}
    asked: dict[str, Any] = {
        "schema_version": 1,
        "name": "plane",
        "start": [10, 50],
        "goal": [90, 50],
        "vessel": "paper-asv",
        "plane": {"extent": [0, 0, 100, 100], "obstacles": [ISLAND_M]},
        "seasons": [season],
        "planner": planner(draw),
        "scale": draw(SCALES),
    }
    if draw(FEW):
        asked["via"] = [[20, 60]]
    if draw(RARE):
        asked["avoid"] = [{"path": "area.geojson"}]
    if draw(RARE):
        asked["havens"] = {"path": "havens.csv", "within": "40min"}
    if draw(RARE):
        asked["region"] = {"bbox": list(BOX)}
    return asked


def drawn(water: Callable[[Draw], dict[str, Any]]) -> st.SearchStrategy[dict[str, Any]]:
    """Return the strategy that draws voyages of a water."""
    return st.composite(lambda draw: water(lambda values: draw(st.sampled_from(values))))()


def outcome(asked: dict[str, Any], folder: Path) -> str:
    """Return "planned", "refused", or what was refused by no row of the table, or failed."""
    try:
        scenario = parse_scenario(asked, folder)
    except RequestError as error:
        known = [pair.reason for pair in PAIRS]
        strange = [line for line in error.faults if not any(reason in line for reason in known)]
        return f"refused by no row: {'; '.join(strange)}" if strange else "refused"
    done = run(scenario, folder / "outputs", offline=True)
    return f"failed: {'; '.join(done.failures)}" if done.failures else "planned"


@examples(gate=1, new=300)
@given(asked=drawn(off_boston))
def test_a_voyage_in_lon_lat_is_planned_or_its_pair_is_in_the_table(
    asked: dict[str, Any], folder: Path
) -> None:
    assert outcome(asked, folder) in {"planned", "refused"}


@examples(gate=1, new=300)
@given(asked=drawn(in_a_plane))
def test_a_voyage_in_a_plane_is_planned_or_its_pair_is_in_the_table(
    asked: dict[str, Any], folder: Path
) -> None:
    assert outcome(asked, folder) in {"planned", "refused"}


def test_the_table_has_few_rows_with_known_features_and_a_reason_each() -> None:
    assert len(PAIRS) <= 15
    assert len({pair.reason for pair in PAIRS}) == len(PAIRS)
    named = {name for pair in PAIRS for name in (*pair.first, *pair.second)}
    assert named == {*OF_THE_SCENARIO, *OF_A_SEASON}


def test_each_row_is_met_in_the_voyages_that_are_drawn(folder: Path) -> None:
    rng, met = random.Random(1), set()  # noqa: S311 - a test's seed
    for _ in range(400):
        for water in (off_boston, in_a_plane):
            try:
                parse_scenario(water(rng.choice), folder)
            except RequestError as error:
                met |= {
                    pair.reason for pair in PAIRS if any(pair.reason in one for one in error.faults)
                }
    assert met == {pair.reason for pair in PAIRS}


def test_a_pair_is_named_with_its_season_reason_and_remedy(folder: Path) -> None:
    asked = in_a_plane(lambda values: values[0])
    season = {"name": "day", "uniform": {"u": 0.1}, "departure": time(0), "arrive_by": time(3)}
    season |= {"speed": {"least": 0.7, "most": 1.4}, "members": {"spread": 0.1}}
    with pytest.raises(RequestError) as caught:
        parse_scenario({**asked, "scale": 1.0, "planner": {}, "seasons": [season]}, folder)
    (line,) = caught.value.faults
    assert line == (
        "season 'day' has 'members' together with 'arrive_by' and 'speed': each member has times "
        "of its own, so no single choice arrives in time in all members; leave one of the two out"
    )


# --- pairs that compose, whose answer is compared with that of simpler voyages ---

SPREAD = {"spread": 0.1, "count": 3, "eddy_km": 3.0}


def planned(folder: Path, season: dict[str, Any], **changes: object) -> RunResult:
    """Plan a voyage off Boston in the hourly currents."""
    asked = off_boston(lambda values: values[0])
    asked |= {"planner": {"classes": 2}, **changes}
    asked["seasons"] = [
        {"name": "day", "time_method": "changing", "currents": ["./hourly.nc"], **season}
    ]
    with planned_scenario(parse_scenario(asked, folder), folder / "outputs", offline=True) as found:
        return found


@pytest.mark.slow
@pytest.mark.parametrize("members", [{}, {"members": SPREAD}])
def test_a_departure_of_a_window_is_planned_as_one_that_is_given(
    folder: Path, members: dict[str, Any]
) -> None:
    window = {"first": time(-240), "every": "2h", "count": 3}
    (chosen,) = planned(folder, {"departures": window, **members}).cases
    choice = chosen.departure_choice
    assert choice is not None
    assert choice.chosen_s == 4 * 3600
    (given_one,) = planned(folder, {"departure": time(0), **members}).cases
    fuels = [[ranked.metrics.fuel for ranked in case.routes] for case in (chosen, given_one)]
    np.testing.assert_allclose(fuels[0], fuels[1], rtol=1e-9)
    means = [
        [ranked.metrics.members_mean_fuel for ranked in case.routes] for case in (chosen, given_one)
    ]
    np.testing.assert_allclose(means[0], means[1], rtol=1e-9)


def test_of_a_window_the_best_departure_that_arrives_in_time_is_taken(folder: Path) -> None:
    window = {"first": time(-240), "every": "2h", "count": 3}
    (case,) = planned(folder, {"departures": window, "arrive_by": time(-60)}).cases
    choice = case.departure_choice
    assert choice is not None
    assert choice.chosen_s == 2 * 3600
    assert "arrives at 2026-11-23 00:4" in choice.reasons[2]
    assert np.isfinite(choice.fuels).tolist() == [True, True, False]
    late = {"first": time(0), "every": "2h", "count": 2}
    with pytest.raises(RequestError, match=r"arrives at .* UTC, later than 2026-11-23 00:40"):
        planned(folder, {"departures": late, "arrive_by": time(10)})


@pytest.mark.slow
def test_a_way_to_a_haven_keeps_out_of_an_area_that_is_always_shut(folder: Path) -> None:
    area = shapely.box(-71.0275, 42.337, -71.0225, 42.3385)
    (folder / "always.geojson").write_text(shapely.to_geojson(area))
    havens = {"path": "havens.csv", "within": "40min"}
    ways = {}
    for name, avoid in (("open", []), ("shut", [{"path": "always.geojson"}])):
        result = planned(folder, {"departure": time(0)}, havens=havens, avoid=avoid)
        (case,) = result.cases
        assert case.coverage is not None
        paths = [way.route.path for way in case.coverage.diversions]
        lonlat = [shapely.LineString(case.case.projection.to_lonlat(path)) for path in paths]
        ways[name] = [line.intersection(area).length for line in lonlat]
    assert max(ways["open"]) > 0
    assert max(ways["shut"]) == 0


@pytest.mark.slow
def test_the_way_to_an_anchorage_is_taken_off_the_endurance(folder: Path) -> None:
    via = [{"at": ANCHORAGE, "wait": "1h"}]
    season = {"departure": time(0)}
    first, onward = planned(folder, season, via=via).cases
    minutes = [case.routes[0].metrics.duration_s / 60 for case in (first, onward)]
    between = int(max(minutes)) + 1
    assert between < sum(minutes) - 1
    havens = {"path": "havens.csv", "endurance": f"{between}min"}
    with pytest.raises(
        RequestError, match=r"is below the .* that the best route of season 'day-on"
    ):
        planned(folder, season, via=via, havens=havens)
    enough = {"path": "havens.csv", "endurance": "2h"}
    assert len(planned(folder, season, via=via, havens=enough).coverages) == 2
