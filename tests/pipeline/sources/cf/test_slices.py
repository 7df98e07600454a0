"""Changing currents from files: which steps are taken, and that each is looked at."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import shapely
import xarray as xr

from pipeline.errors import RequestError
from pipeline.model import CurrentGrid, Land, Note
from pipeline.scenario.season import Season
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.current_field import Field, LandMask
from tests.pipeline.synthetic_currents import coastal, dataset, sea, write

REGION = shapely.box(118.3, 9.3, 119.2, 10.4)
FIRST = datetime(2026, 11, 22, tzinfo=UTC)
STEPS = 14
# Of the tide M2, hours.
PERIOD = 12.42
GLO12 = "cmems_mod_glo_phy-cur_anfc_0.083deg_P1D-m_2024-01_1deg_5day.nc"


def tide(one: Field, other: Field, hour: float) -> Field:
    """Give a tide of two patterns, a quarter of a period apart: its currents rotate."""
    angle = 2 * np.pi * hour / PERIOD
    u, v = (
        np.cos(angle) * getattr(one, name) + np.sin(angle) * getattr(other, name) for name in "uv"
    )
    return Field(one.lon, one.lat, u, v)


@pytest.fixture(scope="module")
def steps(world_mask: LandMask) -> list[Field]:
    lon, lat = np.arange(114.0, 124.0, 0.25), np.arange(4.0, 16.0, 0.25)
    one, other = (coastal(sea(lon, lat, seed), world_mask) for seed in (2, 3))
    return [tide(one, other, hour) for hour in range(STEPS)]


def stamps(hours: list[float]) -> list[np.datetime64]:
    """Return times, hours after the first."""
    begin = np.datetime64(FIRST.replace(tzinfo=None), "ns")
    return [begin + np.timedelta64(round(3600 * hour), "s") for hour in hours]


def hourly(steps: list[Field], hours: list[float] | None = None) -> xr.Dataset:
    return dataset(*steps, times=stamps(hours or [float(i) for i in range(len(steps))]))


def season(hour: float = 2.5, max_hours: float | None = None) -> Season:
    departure = FIRST + timedelta(hours=hour)
    return Season(
        name="tide",
        time_method="changing",
        departure=departure,
        max_hours=max_hours,
        currents=("./tide.nc",),
    )


def fetched(asked: Season, *paths: Path) -> CurrentGrid:
    source = CfFiles(tuple(map(str, paths)))
    assert source.uncovered_reason(REGION, asked) == ""
    return source.current(REGION, asked, Land((), (), 0.0), Path())


def refusal(folder: Path, data: xr.Dataset, asked: Season | None = None) -> str:
    """Write a file that must be refused, before or while it is read; return the reason."""
    source = CfFiles((str(write(folder / "bad.nc", data)),))
    asked = asked or season(max_hours=20)
    found = source.uncovered_reason(REGION, asked)
    with pytest.raises(RequestError) as caught:
        source.current(REGION, asked, Land((), (), 0.0), Path())
    (line,) = caught.value.faults
    assert found in {"", line}
    return str(line)


# --- which steps --------------------------------------------------------------------------------


def test_the_steps_reach_from_before_departure_to_the_last_arrival(
    tmp_path: Path, steps: list[Field]
) -> None:
    path = write(tmp_path / "tide.nc", hourly(steps))
    grid = fetched(season(2.5, max_hours=6), path)
    assert grid.times_s.tolist() == [3600 * (hour - 2.5) for hour in range(2, 10)]
    assert grid.valid == "2026-11-22T02:00Z/2026-11-22T09:00Z"
    x, y = (np.searchsorted(getattr(steps[0], n), getattr(grid, n)) for n in ("lon", "lat"))
    for k, hour in enumerate(range(2, 10)):
        assert np.array_equal(grid.u[k], steps[hour].u[np.ix_(y, x)], equal_nan=True)
        assert np.array_equal(grid.v[k], steps[hour].v[np.ix_(y, x)], equal_nan=True)
    assert np.isnan(grid.u).any(), "Palawan is in it"
    halfway = (grid.u[0] + grid.u[1]) / 2
    assert np.allclose(grid.at_departure[0], halfway, atol=1e-12, equal_nan=True)


def test_a_file_that_ends_before_is_taken_to_its_end(tmp_path: Path, steps: list[Field]) -> None:
    path = write(tmp_path / "tide.nc", hourly(steps))
    grid = fetched(season(3.0, max_hours=1000), path)
    assert grid.times_s[0] == 0
    assert grid.times_s[-1] == 3600 * (STEPS - 1 - 3)


def test_several_files_are_one_series(tmp_path: Path, steps: list[Field]) -> None:
    whole = hourly(steps)
    parts = [
        write(tmp_path / f"{name}.nc", whole.isel(time=chosen))
        for name, chosen in (("b", slice(7, None)), ("a", slice(0, 7)))
    ]
    together = fetched(season(max_hours=20), *parts)
    single = fetched(season(max_hours=20), write(tmp_path / "whole.nc", whole))
    assert np.array_equal(together.u, single.u, equal_nan=True)
    assert np.array_equal(together.times_s, single.times_s)


def test_a_departure_in_another_zone_is_the_same_moment(tmp_path: Path, steps: list[Field]) -> None:
    path = write(tmp_path / "tide.nc", hourly(steps))
    manila = Season(
        name="tide",
        time_method="changing",
        departure=datetime.fromisoformat("2026-11-22T10:30:00+08:00"),
        max_hours=6,
        currents=("./tide.nc",),
    )
    assert fetched(manila, path).times_s.tolist() == fetched(season(2.5, 6), path).times_s.tolist()


def test_real_analyses_of_the_world(shared: Path) -> None:
    """Copernicus GLO12, six daily means of January 2024: the tide is averaged away."""
    file = shared / "data" / "currents" / GLO12
    with xr.open_dataset(file) as data:
        moments = data.time.values
    first, second = (
        datetime.fromisoformat(str(moment)[:19]).replace(tzinfo=UTC) for moment in moments[:2]
    )
    asked = Season(
        name="january",
        time_method="changing",
        departure=first + (second - first) / 4,
        max_hours=1000,
        currents=("./glo.nc",),
    )
    region = shapely.box(115.5, 7.0, 122.0, 13.5)
    source = CfFiles((str(file),))
    grid = source.current(region, asked, Land((), (), 0.0), Path())
    assert len(grid.times_s) == len(moments)
    days = (moments - moments[0]) / np.timedelta64(1, "s")
    assert np.allclose(np.diff(grid.times_s), np.diff(days))
    assert np.ptp(grid.u, axis=0)[np.isfinite(grid.u[0])].max() > 0.05, "they do change"


# --- what is refused ----------------------------------------------------------------------------


def test_a_hole_is_named_by_the_times_around_it(tmp_path: Path, steps: list[Field]) -> None:
    data = hourly(steps).drop_isel(time=[6, 7])
    message = refusal(tmp_path, data)
    assert "no step between 2026-11-22T05:00Z and 2026-11-22T08:00Z, and others every 1" in message
    # Where the voyage can't be under way any more a hole does no harm.
    fetched(season(1.0, max_hours=3), tmp_path / "bad.nc")


def test_steps_that_do_not_ascend(tmp_path: Path, steps: list[Field]) -> None:
    order = [0, 1, 2, 4, 3, *range(5, STEPS)]
    message = refusal(tmp_path, hourly(steps).isel(time=order))
    assert "2026-11-22T04:00Z stands before 2026-11-22T03:00Z" in message


def test_two_steps_of_one_time(tmp_path: Path, steps: list[Field]) -> None:
    hours = [0.0, 1, 2, 3, 3, *range(5, STEPS)]
    assert "two steps of 2026-11-22T03:00Z" in refusal(tmp_path, hourly(steps, hours))


@pytest.mark.parametrize(
    ("hour", "words"),
    [
        (-0.5, "2026-11-21T23:30Z, is before its first step, 2026-11-22;"),
        (STEPS - 1, "2026-11-22T13:00Z, is not before its last step, 2026-11-22T13:00Z;"),
    ],
)
def test_a_departure_outside_the_steps(
    tmp_path: Path, steps: list[Field], hour: float, words: str
) -> None:
    assert words in refusal(tmp_path, hourly(steps), season(hour))


def test_one_step_does_not_change(tmp_path: Path, steps: list[Field]) -> None:
    assert "one time step, 2026-11-22" in refusal(tmp_path, hourly(steps[:1]))


def test_a_gap_at_one_time_alone(tmp_path: Path, steps: list[Field]) -> None:
    data = hourly(steps)
    data.uo[6, 24, 18] = data.uo[7, 24, 18] = np.nan
    message = refusal(tmp_path, data)
    assert "1 cells have data either at 2026-11-22T06:00Z or at 2026-11-22T02:00Z" in message
    assert "1 cells have data either at 2026-11-22T07:00Z" in message


def test_an_impossible_speed_at_a_single_time_is_refused(
    tmp_path: Path, steps: list[Field]
) -> None:
    data = hourly(steps)
    data.vo[9, 24, 18] = 4321.0
    message = refusal(tmp_path, data)
    assert "at 2026-11-22T09:00Z speeds reach 4.32e+03 m/s" in message


def test_a_shifted_series_is_refused_as_one_field_is(tmp_path: Path, steps: list[Field]) -> None:
    data = hourly(steps[:4]).assign_coords(longitude=steps[0].lon + 1.0)
    source = CfFiles((str(write(tmp_path / "shifted.nc", data)),))
    with pytest.raises(RequestError, match="is shifted by"):
        source.current(REGION, season(0.5), Land((), (), 0.0), Path())


def test_zeros_on_land_are_gaps_at_all_times(tmp_path: Path, steps: list[Field]) -> None:
    zeros = [Field(s.lon, s.lat, np.nan_to_num(s.u), np.nan_to_num(s.v)) for s in steps]
    grid = fetched(season(max_hours=20), write(tmp_path / "zeros.nc", hourly(zeros)))
    single = fetched(season(max_hours=20), write(tmp_path / "gaps.nc", hourly(steps)))
    assert np.array_equal(grid.u, single.u, equal_nan=True)
    assert Note.of("zeros-are-land") in grid.notes
