"""Fields of the user's files: a window of them, their steps, forecasts that overlap."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import shapely
import xarray as xr
from hypothesis import given, strategies as st

from pipeline.errors import RequestError
from pipeline.geo.projection import Bounds
from pipeline.model import CurrentGrid, Land, Note
from pipeline.scenario.season import Season
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.cf.axes import TimeSteps, latest_steps
from pipeline.sources.cf.contents import Contents, read_contents
from pipeline.sources.cf.fields import FieldReader, coverage_faults, find_window
from pipeline.sources.current_field import Field, LandMask
from tests.commands import PYTHON, ran
from tests.pipeline.nightly.nights import REFERENCE, write_forecast
from tests.pipeline.sources.cf.sample_files import BOX, LAT, LON, SEA, read
from tests.pipeline.synthetic_currents import coastal, dataset, sea, write

# --- across the seams ---------------------------------------------------------------------------

GLOBE = np.arange(0.0, 360.0, 2.0)
WORLD = sea(GLOBE, np.arange(-60.0, 61.0, 2.0), seed=4)


@pytest.mark.gate_share(5)
@pytest.mark.parametrize("first", [0.0, -180.0, 20.0])
@pytest.mark.parametrize("west", [-190.0, -21.0, 0.0, 170.0, 340.0])
@pytest.mark.parametrize("down", [False, True])
def test_a_region_across_a_seam_is_read_in_one_piece(
    tmp_path: Path, first: float, west: float, *, down: bool
) -> None:
    begin = int(np.flatnonzero(first % 360 == GLOBE)[0])
    data = dataset(WORLD).roll(longitude=-begin, roll_coords=False)
    lon = first + GLOBE
    data = data.assign_coords(longitude=("longitude", lon, {"units": "degrees_east"}))
    if down:
        data = data.isel(longitude=slice(None, None, -1))
    box = (west, -10.0, west + 31.0, 10.0)
    field = read(write(tmp_path / "world.nc", data), box=box)
    assert field.lon.tolist() == [x for x in range(-400, 800, 2) if west <= x <= west + 31]
    number = {float(lon): i for i, lon in enumerate(WORLD.lon)}
    for i, lon in enumerate(field.lon):
        at = number[lon % 360]
        rows = np.abs(WORLD.lat) <= 10
        assert np.array_equal(field.u[:, i], WORLD.u[rows, at])
        assert np.array_equal(field.v[:, i], WORLD.v[rows, at])


def test_a_repeated_longitude_is_read_once(tmp_path: Path) -> None:
    data = dataset(WORLD)
    again = data.isel(longitude=[0]).assign_coords(longitude=[360.0])
    both = xr.concat([data, again], "longitude")
    both.longitude.attrs = data.longitude.attrs
    field = read(write(tmp_path / "twice.nc", both), box=(-6.0, -10.0, 6.0, 10.0))
    assert field.lon.tolist() == [-6, -4, -2, 0, 2, 4, 6]


@given(
    first=st.floats(-360, 360),
    step=st.floats(0.1, 3),
    count=st.integers(2, 100),
    west=st.floats(-180, 180),
    wide=st.floats(0.5, 180),
    down=st.booleans(),
)
def test_a_window_has_all_nodes_inside_and_no_others(
    first: float, step: float, count: int, west: float, wide: float, *, down: bool
) -> None:
    lon = first + step * np.arange(count, dtype=float)
    lat = np.linspace(-60, 60, 41)
    contents = Contents(
        files=(),
        lon=lon[::-1] if down else lon,
        lat=lat[::-1] if down else lat,
        u=(),
        v=(),
        steps=TimeSteps(),
        notes=(),
        attributes={},
    )
    window = find_window(contents.lon, contents.lat, (west, -30.0, west + wide, 30.0))
    numbers = [i for run in window.columns for i in range(*run.indices(count))]
    assert len(numbers) == window.lon.size
    assert (np.diff(window.lon) > 0).all()
    for number, place in zip(numbers, window.lon, strict=True):
        turns = (place - contents.lon[number]) / 360
        assert abs(turns - round(turns)) < 1e-9
        assert west <= place <= west + wide
    inside = {
        round(float(value + 360 * turn), 6)
        for value in lon
        for turn in range(-3, 4)
        if west <= value + 360 * turn <= west + wide
    }
    assert len(window.lon) >= len(inside) - 2 * (step * count >= 359)
    assert (
        contents.lat[window.rows].tolist()
        == window.lat.tolist()
        == [y for y in lat if -30 <= y <= 30]
    )


# --- weights and gaps ---------------------------------------------------------------------------


def test_a_mean_is_of_the_steps_that_are_there_at_least_half(tmp_path: Path) -> None:
    days = [sea(LON, LAT, seed=day) for day in range(3)]
    days[1].v[45, 45] = days[1].v[45, 46] = days[2].v[45, 46] = np.nan
    times = ["2024-07-01", "2024-07-02", "2024-07-03"]
    path = write(tmp_path / "three.nc", dataset(*days, times=times))
    box = (122.0, 12.0, 123.0, 13.0)
    mean = read(path, weights=dict.fromkeys(range(3), 1 / 3), box=box)
    at = int(np.flatnonzero(mean.lat == LAT[45])[0]), int(np.flatnonzero(mean.lon == LON[45])[0])
    assert mean.v[at] == pytest.approx((days[0].v[45, 45] + days[2].v[45, 45]) / 2)
    assert np.isnan(mean.v[at[0], at[1] + 1])
    assert np.isnan(mean.u).sum() == np.isnan(mean.v).sum() == 1
    # Linear in time there is no such mean.
    assert np.isnan(read(path, weights={0: 0.3, 1: 0.7}, box=box).u[at])


# --- coverage -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("box", "part"),
    [
        ((99.74, 8, 122, 13), "west of 99.75 (the region reaches 99.74)"),
        ((117, -10.26, 122, 13), "south of -10.25"),
        ((117, 8, 139.76, 13), "east of 139.75"),
        ((117, 8, 122, 29.76), "north of 29.75"),
        ((-60, 8, -50, 13), "no data there at all"),
        ((90, -20, 150, 40), "west of 99.75 (the region reaches 90) nor south of -10.25"),
    ],
)
def test_how_far_a_region_reaches_beyond_the_grid_is_reported(
    tmp_path: Path, box: Bounds, part: str
) -> None:
    contents = read_contents((write(tmp_path / "sea.nc", dataset(SEA)),))
    (fault,) = coverage_faults(contents, box)
    assert part in fault
    assert coverage_faults(contents, (99.76, -10.24, 139.74, 29.74)) == []


def test_a_region_beyond_both_ends_of_the_grid_is_not_covered(tmp_path: Path) -> None:
    contents = read_contents((write(tmp_path / "sea.nc", dataset(SEA)),))
    (fault,) = coverage_faults(contents, (135.0, 0.0, 464.0, 10.0))
    assert "between 139.5 and 460 E" in fault


# --- memory -------------------------------------------------------------------------------------

READ_BIG_FILE = """
import resource, sys
from pipeline.sources.cf.contents import find_files, read_contents
from pipeline.sources.cf.fields import FieldReader, find_window
import dask.array, netCDF4, numcodecs, xarray, zarr
contents = read_contents(find_files(sys.argv[1:]))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
steps = len(contents.steps.labels)
window = find_window(contents.lon, contents.lat, (116.0, 7.0, 122.0, 13.0))
with FieldReader(contents, window) as reader:
    field = reader.field({i: 1 / steps for i in range(steps)})
grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
print(grown >> 10, field.u.min(), field.u.max(), field.v.min(), field.v.max())
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["zarr", "netcdf"])
def test_a_global_file_of_gigabytes_is_read_in_megabytes(tmp_path: Path, kind: str) -> None:
    steps, ny, nx = 90, 2160, 4320
    path = tmp_path / f"global.{'zarr' if kind == 'zarr' else 'nc'}"
    rows, columns = slice(1152, 1280), slice(3456, 3712)
    (_zarr if kind == "zarr" else _netcdf)(path, (steps, ny, nx), rows, columns)
    printed = ran(*PYTHON, READ_BIG_FILE, str(path), cwd=Path(__file__).parents[5]).split()
    assert 2 * 4 * steps * ny * nx > 6e9
    assert int(printed[0]) < 200, "megabytes"
    # Step i has i/100 east and -i/50 north.
    assert [float(value) for value in printed[1:]] == pytest.approx([0.445] * 2 + [-0.89] * 2)


def _axes(ny: int, nx: int) -> tuple[np.ndarray, np.ndarray]:
    return -90 + (np.arange(ny) + 0.5) / 12, -180 + (np.arange(nx) + 0.5) / 12


def _zarr(path: Path, shape: tuple[int, int, int], rows: slice, columns: slice) -> None:
    """Write the metadata of the whole array, but only the chunks of one block."""
    import dask.array as da

    lat, lon = _axes(*shape[1:])
    blank = da.full(  # type: ignore[no-untyped-call]
        shape, np.nan, dtype="f4", chunks=(10, 128, 256)
    )
    step = np.arange(shape[0])
    data = xr.Dataset(
        {name: (("time", "lat", "lon"), blank, {"units": "m/s"}) for name in ("uo", "vo")},
        {"time": step, "lat": lat, "lon": lon},
    )
    data.time.attrs["units"] = "days since 2024-01-01"
    data.to_zarr(path, zarr_format=2, consolidated=False, compute=False)
    block = np.broadcast_to(step[:, None, None], (shape[0], 128, 256)).astype("f4")
    part = xr.Dataset(
        {"uo": (("time", "lat", "lon"), block / 100), "vo": (("time", "lat", "lon"), -block / 50)}
    )
    part.to_zarr(
        path,
        zarr_format=2,
        consolidated=False,
        region={"time": slice(0, shape[0]), "lat": rows, "lon": columns},
    )


def _netcdf(path: Path, shape: tuple[int, int, int], rows: slice, columns: slice) -> None:
    """Write one block; the other chunks are never allocated."""
    with netCDF4.Dataset(path, "w") as file:
        for name, size in zip(("time", "lat", "lon"), shape, strict=True):
            file.createDimension(name, size)
            file.createVariable(name, "f8", (name,))
        file["time"][:], file["time"].units = np.arange(shape[0]), "days since 2024-01-01"
        file["lat"][:], file["lon"][:] = _axes(*shape[1:])
        for name, factor in (("uo", 0.01), ("vo", -0.02)):
            variable = file.createVariable(
                name, "f4", ("time", "lat", "lon"), fill_value=np.nan, chunksizes=(10, 128, 256)
            )
            variable.units = "m/s"
            for step in range(shape[0]):
                variable[step, rows, columns] = factor * step


# --- real files ---------------------------------------------------------------------------------

REAL = {
    "cmems": ("cmems_mod_glo_phy-cur_anfc_0.083deg_P1D-m_2024-01_1deg_5day.nc", "uo", "vo"),
    "cwb": ("cwb_ocm_M-B0071-000_20200617T00.nc", "uo", "vo"),
    "duacs": ("duacs_nrt_global_allsat_phy_l4_20190223_20190226.nc", "ugos", "vgos"),
    "oscar": ("oscar_climatology_1992-2012_monthly_third_deg.nc", "uo", "vo"),
}


@pytest.mark.gate_share(4)
@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("box", [BOX, (-10.0, 35.0, 12.0, 50.0), (172.0, -45.0, 189.0, -30.0)])
def test_real_files_node_by_node(shared: Path, name: str, box: Bounds) -> None:
    file, u_name, v_name = REAL[name]
    path = shared / "data" / "currents" / file
    contents = read_contents((path,))
    if coverage_faults(contents, box):
        assert name == "cwb"
        return
    last = len(contents.steps.labels) - 1
    with FieldReader(contents, find_window(contents.lon, contents.lat, box)) as reader:
        field = reader.field({last: 1.0})
    with netCDF4.Dataset(path) as raw:
        lon, lat = np.asarray(raw["longitude"][:]), np.asarray(raw["latitude"][:])
        u, v = (np.ma.filled(raw[key][last].astype(float), np.nan) for key in (u_name, v_name))
    rng = np.random.default_rng(0)
    for _ in range(200):
        j, i = rng.integers(field.lat.size), rng.integers(field.lon.size)
        offset = np.abs((lon - field.lon[i] + 180) % 360 - 180)
        column, row = int(offset.argmin()), int(np.abs(lat - field.lat[j]).argmin())
        assert offset[column] < 1e-4
        assert np.array_equal(field.u[j, i], u[row, column], equal_nan=True)
        assert np.array_equal(field.v[j, i], v[row, column], equal_nan=True)


# --- Changing currents from files: which steps are taken, and that each is looked at ---


REGION = shapely.box(118.3, 9.3, 119.2, 10.4)
FIRST = datetime(2026, 11, 22, tzinfo=UTC)
STEPS = 14
# Of the tide M2, hours.
PERIOD = 12.42


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


# --- what is refused ----------------------------------------------------------------------------


def test_a_hole_is_named_by_the_times_around_it(tmp_path: Path, steps: list[Field]) -> None:
    data = hourly(steps).drop_isel(time=[6, 7])
    message = refusal(tmp_path, data)
    assert "no step between 2026-11-22T05:00Z and 2026-11-22T08:00Z, and others every 1" in message
    # Where the voyage can't be under way any more a hole does no harm.
    fetched(season(1.0, max_hours=3), tmp_path / "bad.nc")


def test_steps_that_do_not_ascend_are_read_in_their_order_in_time(
    tmp_path: Path, steps: list[Field]
) -> None:
    order = [0, 1, 2, 4, 3, *range(5, STEPS)]
    mixed, sorted_ = (
        fetched(season(1.0, max_hours=6), write(tmp_path / f"{name}.nc", data))
        for name, data in (("mixed", hourly(steps).isel(time=order)), ("sorted", hourly(steps)))
    )
    np.testing.assert_array_equal(mixed.times_s, sorted_.times_s)
    np.testing.assert_array_equal(mixed.u, sorted_.u)
    np.testing.assert_array_equal(mixed.v, sorted_.v)


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


def test_gaps_at_some_times_are_filled_in_time(tmp_path: Path, steps: list[Field]) -> None:
    data = hourly(steps)
    true = data.uo.values.copy()
    data.uo[6, 24, 18] = data.uo[7, 24, 18] = np.nan
    data.uo[:, 26, 18] = np.where(np.arange(len(steps)) < 9, np.nan, true[:, 26, 18])  # too long
    data.vo[2:4, 25, 18] = np.nan  # the first two steps that are read
    grid = fetched(season(2.5, max_hours=12), write(tmp_path / "gaps.nc", data))
    first = 2
    column, rows = (
        np.searchsorted(axis, at)
        for axis, at in ((grid.lon, steps[0].lon[18]), (grid.lat, steps[0].lat[24:27]))
    )
    for hour, share in ((6, 1 / 3), (7, 2 / 3)):
        mixed = (1 - share) * true[5, 24, 18] + share * true[8, 24, 18]
        assert grid.u[hour - first, rows[0], column] == pytest.approx(mixed)
    assert np.isfinite(grid.v[:, rows[1], column]).all()
    assert np.isnan(grid.u[:, rows[2], column]).all()
    (told,) = [note for note in grid.notes if note.kind == "current-gaps-filled"]
    assert told.is_decision


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
    assert Note.of("filler-is-land") in grid.notes


@pytest.mark.parametrize(
    "asked", [season(2.5, max_hours=12), Season(name="mean", valid="2026-11", currents=("./x.nc",))]
)
def test_a_fill_value_at_some_times_is_no_data_at_any(
    tmp_path: Path, steps: list[Field], asked: Season
) -> None:
    data, true = hourly(steps), hourly(steps)
    for hour, columns in ((4, slice(18, 20)), (6, slice(10, 30))):  # at 4 h too few to tell
        for file, value in ((data, -3.2768), (true, np.nan)):
            file.uo[hour, 22:26, columns] = np.where(
                np.isnan(steps[0].u[22:26, columns]), np.nan, value
            )
    given, right = (
        fetched(asked, write(tmp_path / f"{i}.nc", file)) for i, file in enumerate((data, true))
    )
    assert np.array_equal(given.u, right.u, equal_nan=True)
    assert {note.kind for note in given.notes} == {"fill-value"} | {
        note.kind for note in right.notes
    }


# --- Two forecasts under one pattern: the later one counts in its span, and that is said ---


def test_the_later_forecast_wins_in_its_span_and_a_note_says_so(tmp_path: Path) -> None:
    early = write_forecast(tmp_path / "b.nc", steps=5, seed=1)
    late = write_forecast(tmp_path / "a.nc", REFERENCE + timedelta(hours=12), steps=5, seed=2)
    found = read_contents((late, early))
    # Steps at 0, 6 | 12, 18, 24, 30, 36 h: those of the early one at 12, 18 and 24 h give way.
    assert found.steps.moments == tuple(REFERENCE + i * timedelta(hours=6) for i in range(7))
    for series in (found.u, found.v):
        assert [part.file.name for part, _ in series] == ["b.nc"] * 2 + ["a.nc"] * 5
        assert [step for _, step in series] == [0, 1, 0, 1, 2, 3, 4]
    assert found.reference_time == REFERENCE + timedelta(hours=12)
    (note,) = (note for note in found.notes if note.kind == "forecasts-overlap")
    assert dict(note.values) == {"count": 3, "reference": found.reference_time}
    assert note.is_decision


def test_steps_between_those_of_a_later_forecast_give_way_too() -> None:
    at = REFERENCE
    hours = {(0, i): i for i in range(9)} | {(1, i): 4 + 3 * i for i in range(3)}
    times = {step: at + timedelta(hours=hour) for step, hour in hours.items()}
    index = sorted(times, key=times.__getitem__)
    left = latest_steps(index, times, [1, 2])
    assert [hours[step] for step in left] == [0, 1, 2, 3, 4, 7, 10]
    assert latest_steps(index, times, [1, None]) == index
    assert latest_steps(index, times, [2, 2]) == index


def test_the_latest_of_many_forecasts_is_found_at_once() -> None:
    """Each of 2,000 daily files has ten days: of all but the last the first day is left."""
    starts = np.arange(2_000)
    times = {(int(file), day): int(file) + day for file in starts for day in range(10)}
    left = latest_steps(sorted(times, key=times.__getitem__), times, list(starts + 1))
    assert left == [(file, 0) for file in range(1_999)] + [(1_999, day) for day in range(10)]
