"""Currents of the service that change on the way, through its unmodified client."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.errors import StageError
from pipeline.machine.store import Store
from pipeline.model import CurrentGrid, Note
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.model import Scenario
from pipeline.sources.copernicus.adapter import Copernicus
from pipeline.stages.fetch import fetch
from tests.loopback_store import world
from tests.loopback_store.datasets import Ocean
from tests.loopback_store.server import Fault
from tests.loopback_store.world import LAND, REGION, TOLERANCE_M_S, connected, spec
from tests.pipeline.conftest import ACROSS_BOX

DEPARTURE = datetime(2024, 7, 15, 8, 20, tzinfo=UTC)
HOUR = timedelta(hours=1)
HOURLY, SIX_HOURLY, DAILY, HOURLY_MEANS = (
    "copernicus-total-hourly",
    "copernicus-forecast-6hourly",
    "copernicus-forecast-daily",
    "copernicus-forecast-hourly",
)


def source(name: str) -> Copernicus:
    """Return a source with one attempt and a short deadline."""
    return Copernicus(spec(name).model_copy(update={"deadline_s": 90.0, "attempts": 1}))


def midnight(day: int) -> datetime:
    """Return a midnight of July 2024."""
    return datetime(2024, 7, day, tzinfo=UTC)


def fetched(name: str, hours: float, folder: Path, departure: datetime = DEPARTURE) -> CurrentGrid:
    """Fetch a voyage's currents as a run does, which first asks whether they are there."""
    asked = world.changing_season(name, departure, hours)
    assert source(name).uncovered_reason(REGION, asked) == ""
    return source(name).current(REGION, asked, LAND, folder)


# --- which steps --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "hours", "valid", "stamps"),
    [
        (HOURLY, 5.0, "08:00Z/14:00Z", [midnight(15) + k * HOUR for k in range(8, 15)]),
        pytest.param(
            HOURLY_MEANS,
            3.0,
            "07:30Z/11:30Z",
            [midnight(15) + (k + 0.5) * HOUR for k in range(7, 12)],
            marks=pytest.mark.slow,
        ),
        pytest.param(
            SIX_HOURLY,
            20.0,
            "06:00Z/2024-07-16T06:00Z",
            [midnight(15) + k * HOUR for k in range(6, 31, 6)],
            marks=pytest.mark.slow,
        ),
        pytest.param(
            DAILY, 60.0, "", [midnight(day) for day in range(14, 19)], marks=pytest.mark.slow
        ),
    ],
)
def test_all_steps_from_before_departure_to_the_last_arrival_are_fields(
    tmp_path: Path, name: str, hours: float, valid: str, stamps: list[datetime]
) -> None:
    with connected(world.store(name), tmp_path / "home"):
        grid = fetched(name, hours, tmp_path)
    entry = spec(name)
    # The service labels the mean of a day with its first moment; it is valid in the middle.
    to_middle = 12 * HOUR if name == DAILY else 0 * HOUR
    assert grid.times_s.tolist() == [
        (stamp + to_middle - DEPARTURE).total_seconds() for stamp in stamps
    ]
    assert grid.times_s[0] <= 0 < grid.times_s[1]
    assert grid.times_s[-2] < 3600 * hours <= grid.times_s[-1]
    for step, stamp in enumerate(stamps):
        error = world.max_error_m_s(grid, entry.eastward, entry.northward, stamp, step=step)
        assert error < TOLERANCE_M_S
    assert np.ptp(grid.u, axis=0)[np.isfinite(grid.u[0])].max() > 0.005, "they do change"
    if valid:
        first, last = valid.split("/")
        ends = (first, last if "T" in last else f"2024-07-15T{last}")
        assert grid.valid == f"2024-07-15T{ends[0]}/{ends[1]}"
    assert (Note.of("steps-are-means", step="day") in grid.notes) == (name == DAILY)


@pytest.mark.slow
def test_the_cache_serves_every_departure_with_the_same_steps(tmp_path: Path) -> None:
    store = world.store(SIX_HOURLY)
    with connected(store, tmp_path / "home"):
        early = fetched(SIX_HOURLY, 10, tmp_path / "cache", midnight(15) + 7 * HOUR)
        requests = len(store.requests)
        late = fetched(SIX_HOURLY, 9, tmp_path / "cache", midnight(15) + 8 * HOUR)
        assert len(store.requests) == requests, "nothing was requested"
        assert np.array_equal(early.u, late.u, equal_nan=True)
        assert (early.times_s - late.times_s == 3600).all()
        fetched(SIX_HOURLY, 11, tmp_path / "cache", midnight(15) + 8 * HOUR)
        assert len(store.requests) > requests, "a step more"


@pytest.mark.slow
def test_a_forecast_that_ends_before_the_last_arrival_is_taken_to_its_end(tmp_path: Path) -> None:
    departure = world.today() + timedelta(days=9, hours=2)
    with connected(world.store(SIX_HOURLY), tmp_path / "home"):
        grid = fetched(SIX_HOURLY, 500, tmp_path / "cache", departure)
        again = fetched(SIX_HOURLY, 500, tmp_path / "cache", departure)
    assert grid.times_s.tolist() == [3600.0 * hour for hour in range(-2, 41, 6)]
    assert np.array_equal(again.u, grid.u, equal_nan=True)
    last = world.today() + timedelta(days=10, hours=18)
    assert world.max_error_m_s(grid, "uo", "vo", last, step=-1) < TOLERANCE_M_S


# --- what is refused ----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("is_listed", [False, True])
def test_a_hole_is_named_by_the_times_around_it(tmp_path: Path, is_listed: bool) -> None:
    whole = world.dataset(SIX_HOURLY).times
    steps = tuple(time for time in whole if time != midnight(16))
    store = world.store(
        SIX_HOURLY, times=whole if is_listed else steps, stored_times=steps if is_listed else None
    )
    with (
        connected(store, tmp_path / "home"),
        pytest.raises(StageError, match="between 2024-07-15T18 and 2024-07-16T06") as caught,
    ):
        fetched(SIX_HOURLY, 40, tmp_path)
    assert "name another" in str(caught.value)


@pytest.mark.slow
def test_a_chunk_that_is_lacking_at_one_time_alone(tmp_path: Path) -> None:
    """A part of the third step is not delivered; no gap is planned through."""
    store = world.store(SIX_HOURLY)
    # The client asks for the steps in their order.
    number = world.dataset(SIX_HOURLY).times.index(midnight(15) + 18 * HOUR)
    store.faults.append(Fault(f"*/uo/{number}.0.*", 404))
    store.faults.append(Fault(f"*/uo/{number // 64}.*", 404))
    with (
        connected(store, tmp_path / "home"),
        pytest.raises(StageError, match="cells of water"),
    ):
        fetched(SIX_HOURLY, 20, tmp_path)
    assert not list(tmp_path.glob("*.nc"))


@pytest.mark.parametrize(
    ("name", "departure", "words"),
    [
        ("copernicus-glorys-climatology", DEPARTURE, "does not show how currents change"),
        # A day more than the ten: the test may run past midnight.
        (HOURLY, world.today() + timedelta(days=12, hours=1), "covers November 2020 to ten days"),
        (HOURLY, datetime(2020, 10, 31, 23, tzinfo=UTC), "covers November 2020 to ten days"),
        (DAILY, datetime(2020, 11, 1, 6, tzinfo=UTC), "from November 2020 at the earliest"),
    ],
)
def test_departures_without_steps_around_them_are_refused_without_a_request(
    name: str, departure: datetime, words: str
) -> None:
    asked = world.changing_season(name, departure, 24)
    reason = source(name).uncovered_reason(REGION, asked)
    assert words in reason
    assert f"{departure:%Y-%m-%dT%H:%MZ}" in reason
    assert "name another source in 'currents'" in reason
    assert source(name).identity(asked), "which is called first"


# --- end to end ---------------------------------------------------------------------------------

_VOYAGE = """
schema_version = 1
name = "voyage"
start = [118.75, 9.35]
goal = [119.15, 9.9]
[vessel]
length_m = 7.0
speed_m_s = 3.0
turn_rate_deg_s = 10.0
[region]
bbox = {box}
[planner]
classes = 2
[[seasons]]
name = "tide"
time_method = "changing"
departure = {departure:%Y-%m-%dT%H:%M:%SZ}
currents = ["{currents}"]
"""


@pytest.mark.slow
def test_a_voyage_is_planned_completely_or_refused_with_the_end_of_the_currents(
    tmp_path: Path, across_outputs: Path
) -> None:
    """The vessel needs six hours; a departure in the forecast's last two is refused."""
    table = load_scenario("palawan-season").model_dump(mode="json")
    table["region"]["bbox"] = ACROSS_BOX
    land = fetch(
        Scenario.model_validate(table), Store(across_outputs / ".artefacts"), offline=True
    ).fetched.land
    ocean, path, output = Ocean(land.polygons), tmp_path / "voyage.toml", tmp_path / "outputs"

    def run(departure: datetime) -> tuple[int, str]:
        path.write_text(_VOYAGE.format(box=ACROSS_BOX, departure=departure, currents=HOURLY))
        result = CliRunner().invoke(app, ["run", str(path), "--output", str(output)])
        return result.exit_code, result.output

    with connected(world.store(HOURLY, ocean=ocean), tmp_path / "home"):
        code, text = run(DEPARTURE)
        assert code == 0, text
        assert "the current changes on the way: it has" in text
        manifest = json.loads((output / "voyage" / "manifest.json").read_text())
        (credit,) = manifest["current_sources"]
        assert credit["valid"].startswith("2024-07-15T08:00Z/2024-07-1")
        assert "changes on the way" in (output / "voyage" / "report.html").read_text()
        last = world.today() + timedelta(days=10, hours=23)
        code, text = run(last - 2 * HOUR)
    assert code == 2, text
    words = " ".join(text.split())
    assert "it would arrive at" in words
    assert f"the current is known until {last:%Y-%m-%d} 23:00 UTC" in words
    assert "take currents that reach further, or depart earlier" in words
