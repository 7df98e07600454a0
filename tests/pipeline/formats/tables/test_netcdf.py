from __future__ import annotations

import re
import resource
import shutil
import tempfile
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.interpolate import RegularGridInterpolator

from pipeline.formats.tables.netcdf import has_currents, write_currents
from pipeline.model import CurrentGrid
from tests.pipeline.formats import small_run
from tests.pipeline.formats.gis.cases import (
    BAD_CREDIT,
    ODD,
    SCRIPT,
    badly_named,
    moved_east,
    renamed,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pipeline.formats.shared.result import RunResult

ROOT = Path(__file__).resolve().parents[4]
_MEDIUM = 2  # compliance_checker's weights: 3 is high, 2 medium, 1 low


@pytest.fixture(scope="module")
def currents(result: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("currents") / "currents.nc"
    write_currents(result, path)
    return path


@pytest.fixture
def small_files() -> Iterator[None]:
    """Limit files to 4 kB, which is like a full disk but needs no other disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4_000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def with_grids(result: RunResult, *grids: CurrentGrid) -> RunResult:
    return replace(result, fetched=replace(result.fetched, currents=grids))


def faults(path: Path) -> list[str]:
    """Faults of high and medium weight that the CF checker of IOOS finds in a file.

    It has its own table of standard names, so it needs no connection.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own and its libraries' deprecations
        from compliance_checker.runner import CheckSuite

        suite = CheckSuite()
        suite.load_all_available_checkers()
        with netCDF4.Dataset(path) as dataset:
            found = suite.run_all(dataset, ["cf:1.11"])
    [(groups, errors)] = found.values()
    assert not errors
    assert len(groups) > 10
    return [
        f"{group.name}: {group.msgs}"
        for group in groups
        if group.weight >= _MEDIUM and group.value[0] != group.value[1]
    ]


def test_the_cf_checker_finds_nothing(currents: Path) -> None:
    assert faults(currents) == []


def test_the_cf_checker_would_find_a_fault(currents: Path, tmp_path: Path) -> None:
    path = tmp_path / "currents.nc"
    shutil.copy(currents, path)
    with netCDF4.Dataset(path, "a") as dataset:
        dataset["uo"].standard_name = "eastward_motion_of_water"
        dataset["vo"].coordinates = "nowhere"
        dataset["lon"].units = "furlong"
    found = "\n".join(faults(path))
    assert "eastward_motion_of_water" in found
    assert "nowhere" in found
    assert "lon" in found


def test_the_figures_are_the_sources_own(currents: Path, result: RunResult) -> None:
    with xr.open_dataset(currents) as file:
        for component in (file.uo, file.vo):
            assert component.dims == ("season", "lat", "lon")
        for grid in result.fetched.currents:
            season = file.sel(season=grid.season)
            np.testing.assert_array_equal(season.lon, grid.lon)
            np.testing.assert_array_equal(season.lat, grid.lat)
            np.testing.assert_array_equal(season.uo, grid.u[0])
            np.testing.assert_array_equal(season.vo, grid.v[0])
            assert np.isnan(season.uo).sum() == np.isnan(grid.u).sum() > 0


def test_a_point_without_value_has_the_fill_value(currents: Path) -> None:
    with netCDF4.Dataset(currents) as file:
        file.set_auto_mask(False)
        for component in (file["uo"], file["vo"]):
            stored = component[:]
            assert np.isfinite(stored).all()
            assert (stored == component._FillValue).sum() == 8


# Offsets from the lines of other grids: at 0.5 nanodegrees it is one line, at 2 it is two.
_NUDGES = st.sampled_from([0.0, 2e-10, 5e-10, 2e-9, 1e-6, 0.04])


@st.composite
def axes(draw: st.DrawFn, middle: float) -> np.ndarray:
    places = draw(st.lists(st.integers(-6, 6), min_size=2, max_size=5, unique=True))
    return middle + 0.1 * np.sort(places) + draw(_NUDGES)


@st.composite
def current_grids(draw: st.DrawFn, season: str) -> CurrentGrid:
    """Grids around 180 degrees, some of whose points lack one or both components."""
    lon, lat = draw(axes(180.0)), draw(axes(-17.0))
    speeds = st.floats(-4, 4) | st.just(np.nan)
    u, v = (draw(hnp.arrays(float, (1, len(lat), len(lon)), elements=speeds)) for _ in "uv")
    return CurrentGrid(season, lon, lat, u, v, "2024-07", small_run.STAND_IN)


def sampled(field: xr.DataArray, points: np.ndarray) -> np.ndarray:
    """Bilinear values at points (n, 2) of latitude and longitude."""
    axes = (field.lat.values, field.lon.values)
    return np.asarray(RegularGridInterpolator(axes, field.values)(points))


def as_field(grid: CurrentGrid, values: np.ndarray) -> xr.DataArray:
    return xr.DataArray(values, {"lat": grid.lat, "lon": grid.lon}, ("lat", "lon"))


@given(
    st.tuples(*(current_grids(season) for season in ("spring", "summer", "autumn"))),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=40, deadline=None)
def test_a_season_read_bilinearly_equals_its_own_grid(
    grids: tuple[CurrentGrid, ...], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "currents.nc"
        write_currents(with_grids(small_run.parts(), *grids), path)
        file = xr.load_dataset(path)
    for name in ("lat", "lon"):
        every = np.concatenate([getattr(grid, name) for grid in grids])
        lines = file[name].values
        assert np.isin(lines, every).all()
        assert np.diff(lines).min() > 1e-9
        assert np.abs(every[:, None] - lines).min(axis=1).max() <= 1e-9
    for grid in grids:
        season = file.sel(season=grid.season)
        own = season.sel(lat=grid.lat, lon=grid.lon, method="nearest", tolerance=1e-9)
        # Away from its ends, which may be off by a nanodegree in the file.
        low, high = ((grid.lat[end], grid.lon[end]) for end in (0, -1))
        points = rng.uniform(np.array(low) + 1e-9, np.array(high) - 1e-9, (200, 2))
        outside = (season.lat < grid.lat[0] - 1e-9) | (season.lat > grid.lat[-1] + 1e-9)
        outside = outside | (season.lon < grid.lon[0] - 1e-9) | (season.lon > grid.lon[-1] + 1e-9)
        for name, figures in (("uo", grid.u[0]), ("vo", grid.v[0])):
            assert np.array_equal(own[name], figures, equal_nan=True)
            assert not (np.isfinite(season[name]) & outside).any()
            np.testing.assert_allclose(
                sampled(season[name], points),
                sampled(as_field(grid, figures), points),
                rtol=0,
                atol=1e-6,  # a field of 8 m/s in a tenth of a degree, off by a nanodegree
            )


def test_a_current_that_changes_is_written_as_it_is_at_departure(
    result: RunResult, tmp_path: Path
) -> None:
    """Departure is a quarter of the way from the second slice to the third."""
    axis = np.array([1.0, 2.0])
    u = np.array([[[9.0, 9], [9, 9]], [[0.0, 4], [8, 12]], [[4.0, 0], [8, 16]], [[7.0, 7], [7, 7]]])
    times = np.array([-90.0, -10.0, 30.0, 60.0])
    grid = CurrentGrid("tide", axis, axis, u, -u, "2026-11-22", small_run.STAND_IN, times_s=times)
    write_currents(with_grids(result, grid), tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        assert file.uo.sel(season="tide").values.tolist() == [[1.0, 3.0], [8.0, 13.0]]
        assert (file.vo == -file.uo).all()
        assert "time" not in file, "the values are not those of the whole period"


def test_a_finer_and_wider_season_leaves_the_other_as_it_is(
    result: RunResult, tmp_path: Path
) -> None:
    """Computed by hand: in a cell of 2 degrees with lines between, next to a gap, and outside."""
    nan = np.nan
    square = np.array([[[0.0, 1.0], [2.0, 5.0]]])
    coarse = np.array([[[1.0, 2.0, nan], [3.0, 6.0, 1.0]]])
    wide, credit = np.arange(5.0), small_run.STAND_IN
    grids = (
        CurrentGrid(
            "coarse", np.array([0.0, 2, 4]), np.array([1.0, 3]), coarse, -coarse, "", credit
        ),
        CurrentGrid("wide", wide, wide, np.zeros((1, 5, 5)), np.ones((1, 5, 5)), "", credit),
        CurrentGrid("small", wide[1:3], wide[1:3], square, square, "", credit),
    )
    write_currents(with_grids(result, *grids), tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        expected = [
            [nan, nan, nan, nan, nan],
            [1.0, 1.5, 2.0, nan, nan],
            [2.0, 3.0, 4.0, nan, nan],
            [3.0, 4.5, 6.0, 3.5, 1.0],
            [nan, nan, nan, nan, nan],
        ]
        np.testing.assert_array_equal(file.uo.sel(season="coarse"), expected)
        np.testing.assert_array_equal(file.vo.sel(season="coarse"), -np.array(expected))
        assert (file.vo.sel(season="wide") == 1).all()
        assert file.uo.sel(season="small").count() == 4
    assert faults(tmp_path / "currents.nc") == []


def test_a_reader_by_the_conventions_finds_east_and_north(currents: Path) -> None:
    with xr.open_dataset(currents) as file:
        for direction in ("eastward", "northward"):
            name = f"surface_{direction}_sea_water_velocity"
            [found] = file.filter_by_attrs(standard_name=name).data_vars.values()
            assert found.units == "m s-1"
        # Summer sets to the east.
        summer = file.sel(season="summer")
        assert float(summer.uo.mean()) == pytest.approx(0.3, abs=0.05)
        assert abs(float(summer.vo.mean())) < 0.05


def test_the_file_has_global_attributes(currents: Path, result: RunResult) -> None:
    with xr.open_dataset(currents) as file:
        assert re.fullmatch(r"CF-1\.\d+", file.attrs["Conventions"])
        assert file.attrs["title"] == "Surface currents of Two islands"
        assert file.attrs["history"].startswith("2026-01-02T03:04:05Z: written by renew-planner")
        assert file.attrs["scenario"] == "small-run"
        for credit in result.current_credits:
            assert credit.text in file.attrs["acknowledgement"]
            assert credit.licence in file.attrs["license"]


def test_each_season_has_its_source(result: RunResult, tmp_path: Path) -> None:
    summer, winter = result.fetched.currents
    summer = replace(summer, notes=("one", "two"), credit=replace(summer.credit, url="https://u"))
    write_currents(with_grids(result, summer, winter), tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        assert file.season.values.tolist() == ["summer", "winter"]
        for grid in (summer, winter):
            # A component of one season has them as coordinates.
            facts = {
                name: str(c.values) for name, c in file.uo.sel(season=grid.season).coords.items()
            }
            assert facts["season_title"] == result.season_title(grid.season)
            assert facts["valid"] == grid.valid
            assert facts["source"] == grid.credit.name
            assert facts["references"] == grid.credit.url
            assert facts["license"] == grid.credit.licence
            assert facts["acknowledgement"] == grid.credit.text
            assert facts["notes"] == "; ".join(grid.notes)
        assert all(file[name].attrs["long_name"] for name in file.coords)


@pytest.mark.parametrize(
    ("valid", "middle", "bounds"),
    [
        ("2024-07", "2024-07-16T12:00", ["2024-07-01", "2024-08-01"]),
        ("2020-06-17", "2020-06-17T12:00", ["2020-06-17", "2020-06-18"]),
        ("2024-01-03/2024-01-28", "2024-01-16T00:00", ["2024-01-03", "2024-01-29"]),
        (
            "2024-01-03T06:00Z/2024-01-03T18:00Z",
            "2024-01-03T12:00",
            ["2024-01-03T06", "2024-01-03T18"],
        ),
        ("2024-01-03T06:00Z", "2024-01-03T06:00", ["2024-01-03T06", "2024-01-03T06"]),
    ],
)
def test_the_time_is_that_of_the_source(
    result: RunResult, tmp_path: Path, valid: str, middle: str, bounds: list[str]
) -> None:
    summer, winter = result.fetched.currents
    path = tmp_path / "currents.nc"
    write_currents(with_grids(result, summer, replace(winter, valid=valid)), path)
    with xr.open_dataset(path) as file:
        season = file.sel(season="winter")
        assert season.uo.time.values == np.datetime64(middle)
        assert season.time_bounds.values.tolist() == [
            np.datetime64(bound, "ns").astype(int) for bound in bounds
        ]
        assert str(season.valid.values) == valid
    assert faults(path) == []


@pytest.mark.parametrize("valid", ["", "climatology of June", "2024-01-28/yesterday"])
def test_a_period_that_cannot_be_read_stays_a_text(
    result: RunResult, tmp_path: Path, valid: str
) -> None:
    summer, winter = result.fetched.currents
    path = tmp_path / "currents.nc"
    write_currents(with_grids(result, summer, replace(winter, valid=valid)), path)
    with xr.open_dataset(path) as file:
        assert not {"time", "time_bounds"} & set(file.variables)
        assert file.valid.values.tolist() == ["2020-06-17", valid]
    assert faults(path) == []


def test_longitudes_are_continuous_across_180_degrees(result: RunResult, tmp_path: Path) -> None:
    moved = moved_east(result, 60.4)
    write_currents(moved, tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        assert np.all(np.diff(file.lon) > 0)
        assert float(file.lon.min()) < 180 < float(file.lon.max())
    assert faults(tmp_path / "currents.nc") == []


def test_bad_names_are_stored_as_labels(result: RunResult, tmp_path: Path) -> None:
    bad = badly_named(result)
    odd = bad.scenario.model_copy(update={"title": f"{SCRIPT}\0\ud800"})
    summer, winter = bad.fetched.currents
    summer = replace(summer, credit=BAD_CREDIT, notes=(ODD,))
    write_currents(replace(with_grids(bad, summer, winter), scenario=odd), tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        assert file.season.values.tolist() == [SCRIPT, ODD]
        assert np.array_equal(file.uo.sel(season=ODD), winter.u[0], equal_nan=True)
        assert str(file.license.sel(season=SCRIPT).values) == BAD_CREDIT.licence
        assert str(file.acknowledgement.sel(season=SCRIPT).values) == BAD_CREDIT.text
        assert str(file.notes.sel(season=SCRIPT).values) == ODD
        assert file.attrs["title"] == f"Surface currents of {SCRIPT}\N{REPLACEMENT CHARACTER}?"
    assert faults(tmp_path / "currents.nc") == []


def test_characters_that_no_string_can_hold_are_replaced(result: RunResult, tmp_path: Path) -> None:
    names = {"summer": "<b>\0\0", "winter": "\ud800\U0001f30a"}
    write_currents(renamed(result, names), tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        assert file.season.values.tolist() == ["<b>\ufffd\ufffd", "?\U0001f30a"]


def test_the_example_in_the_documents_runs(
    currents: Path, result: RunResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    readme = (ROOT / "outputs" / "README.md").read_text("utf-8")
    [example] = re.findall(
        r"^## `currents\.nc`\n+```python\n(.*?)^```", readme, re.MULTILINE | re.DOTALL
    )
    monkeypatch.chdir(currents.parent)
    namespace: dict[str, Any] = {}
    exec(example, namespace)  # noqa: S102 - the document's own example is what is tested
    namespace["currents"].close()
    summer = result.fetched.currents[0]
    np.testing.assert_array_equal(namespace["summer"].uo, summer.u[0])
    at_start = sampled(as_field(summer, summer.u[0]), np.array([(9.1, 119.1)]))
    assert float(namespace["here"].uo) == pytest.approx(at_start[0], abs=1e-12)


def test_a_plane_has_no_currents_to_write(result: RunResult, planar_result: RunResult) -> None:
    assert has_currents(result)
    assert has_currents(small_run.with_a_failed_season(result))
    assert not has_currents(planar_result)


def test_a_missing_folder_is_an_os_error(result: RunResult, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nowhere"):
        write_currents(result, tmp_path / "nowhere" / "currents.nc")


@pytest.mark.usefixtures("small_files")
def test_a_file_that_cannot_be_finished_is_an_os_error(result: RunResult, tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"currents\.nc"):
        write_currents(result, tmp_path / "currents.nc")


def test_the_same_run_makes_the_same_figures(result: RunResult, tmp_path: Path) -> None:
    for name in ("one.nc", "two.nc"):
        write_currents(result, tmp_path / name)
    one, two = (xr.load_dataset(tmp_path / name) for name in ("one.nc", "two.nc"))
    assert one.identical(two)
