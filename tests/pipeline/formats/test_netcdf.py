from __future__ import annotations

import json
import re
import resource
import shutil
import subprocess
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

from pipeline.formats.netcdf import write_currents
from pipeline.formats.shared.result import RunResult
from pipeline.model import CurrentGrid
from pipeline.stages.write import formats_of
from tests.pipeline.formats import small_run
from tests.pipeline.formats.gis.cases import (
    BAD_CREDIT,
    ODD,
    SCRIPT,
    badly_named,
    moved_east,
    renamed,
)

ROOT = Path(__file__).resolve().parents[3]
_MEDIUM = 2  # compliance_checker's weights: 3 is high, 2 medium, 1 low


@pytest.fixture(scope="module")
def currents(result: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("currents") / "currents.nc"
    write_currents(result, "summer", path)
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


def test_the_figures_are_the_sources_own(result: RunResult, tmp_path: Path) -> None:
    for grid in result.fetched.currents:
        path = tmp_path / f"{grid.season}.nc"
        write_currents(result, grid.season, path)
        with xr.open_dataset(path) as file:
            for component, values in ((file.uo, grid.u[0]), (file.vo, grid.v[0])):
                assert component.dims == ("lat", "lon")
                np.testing.assert_array_equal(component, values)
                assert np.isnan(component).sum() > 0
            np.testing.assert_array_equal(file.lon, grid.lon)
            np.testing.assert_array_equal(file.lat, grid.lat)


def test_a_point_without_value_has_the_fill_value(currents: Path) -> None:
    with netCDF4.Dataset(currents) as file:
        file.set_auto_mask(False)
        for component in (file["uo"], file["vo"]):
            stored = component[:]
            assert np.isfinite(stored).all()
            assert (stored == component._FillValue).sum() == 4


def test_gdal_places_the_grid_where_it_is(result: RunResult, tmp_path: Path) -> None:
    """Two seasons on different grids: one file for both was at 0 to 27 by -24 to 0 degrees."""
    gdalinfo = shutil.which("gdalinfo")
    if gdalinfo is None:
        pytest.skip("gdalinfo is not installed (Debian: gdal-bin)")
    summer, winter = result.fetched.currents
    lon, lat = np.linspace(118.5, 120.5, 5), np.linspace(8.5, 10.5, 5)
    grid = np.arange(25.0).reshape(1, 5, 5) / 25
    other = replace(winter, lon=lon, lat=lat, u=grid, v=-grid)
    for one in (summer, other):
        path = tmp_path / f"{one.season}.nc"
        write_currents(with_grids(result, summer, other), one.season, path)
        asked = [gdalinfo, "-json", "-stats", f"NETCDF:{path}:uo"]
        found = json.loads(subprocess.run(asked, capture_output=True, check=True).stdout)
        west, east_step, _, north, _, south_step = found["geoTransform"]
        assert west + east_step / 2 == pytest.approx(one.lon[0])
        assert north + south_step / 2 == pytest.approx(one.lat[-1])
        assert found["size"] == [len(one.lon), len(one.lat)]
        assert "WGS 84" in found["coordinateSystem"]["wkt"]
        (band,) = found["bands"]
        assert band["minimum"] == pytest.approx(np.nanmin(one.u), abs=1e-6)
        assert band["maximum"] == pytest.approx(np.nanmax(one.u), abs=1e-6)


def as_field(grid: CurrentGrid, values: np.ndarray) -> xr.DataArray:
    return xr.DataArray(values, {"lat": grid.lat, "lon": grid.lon}, ("lat", "lon"))


def sampled(field: xr.DataArray, points: np.ndarray) -> np.ndarray:
    """Bilinear values at points (n, 2) of latitude and longitude."""
    axes = (field.lat.values, field.lon.values)
    return np.asarray(RegularGridInterpolator(axes, field.values)(points))


def test_a_current_that_changes_is_written_as_it_is_at_departure(
    result: RunResult, tmp_path: Path
) -> None:
    """Departure is a quarter of the way from the second slice to the third."""
    axis = np.array([1.0, 2.0])
    u = np.array([[[9.0, 9], [9, 9]], [[0.0, 4], [8, 12]], [[4.0, 0], [8, 16]], [[7.0, 7], [7, 7]]])
    times = np.array([-90.0, -10.0, 30.0, 60.0])
    grid = CurrentGrid("tide", axis, axis, u, -u, "2026-11-22", small_run.STAND_IN, times_s=times)
    write_currents(with_grids(result, grid), "tide", tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        assert file.uo.values.tolist() == [[1.0, 3.0], [8.0, 13.0]]
        assert (file.vo == -file.uo).all()
        assert "time" not in file, "the values are not those of the whole period"


def test_a_reader_by_the_conventions_finds_east_and_north(currents: Path) -> None:
    with xr.open_dataset(currents) as file:
        for direction in ("eastward", "northward"):
            name = f"surface_{direction}_sea_water_velocity"
            [found] = file.filter_by_attrs(standard_name=name).data_vars.values()
            assert found.units == "m s-1"
        # Summer sets to the east.
        assert float(file.uo.mean()) == pytest.approx(0.3, abs=0.05)
        assert abs(float(file.vo.mean())) < 0.05


def test_the_file_has_global_attributes(currents: Path, result: RunResult) -> None:
    with xr.open_dataset(currents) as file:
        assert re.fullmatch(r"CF-1\.\d+", file.attrs["Conventions"])
        assert file.attrs["title"] == "Surface current of Two islands: Summer"
        assert file.attrs["history"].startswith("2026-01-02T03:04:05Z: written by renew-planner")
        assert file.attrs["scenario"] == "small-run"
        credit = result.fetched.currents[0].credit
        assert file.attrs["acknowledgement"] == credit.text
        assert file.attrs["license"] == credit.licence
        assert file.attrs["source"] == credit.name
        assert (file.attrs["season"], file.attrs["valid"]) == ("summer", "2020-06-17")
        assert "notes" not in file.attrs


def test_notes_and_references_are_told(result: RunResult, tmp_path: Path) -> None:
    summer, winter = result.fetched.currents
    summer = replace(
        summer,
        notes=(small_run.note("one"), small_run.note("two")),
        credit=replace(summer.credit, url="https://u"),
    )
    write_currents(with_grids(result, summer, winter), "summer", tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        assert file.attrs["notes"] == "one; two"
        assert file.attrs["references"].startswith("https://u; RENEW")
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
    write_currents(with_grids(result, summer, replace(winter, valid=valid)), "winter", path)
    with xr.open_dataset(path) as file:
        assert file.uo.time.values == np.datetime64(middle)
        covered = [file.attrs[f"time_coverage_{end}"] for end in ("start", "end")]
        assert [np.datetime64(one.removesuffix("+00:00")) for one in covered] == [
            np.datetime64(bound) for bound in bounds
        ]
        assert file.attrs["valid"] == valid
    assert faults(path) == []


@pytest.mark.parametrize("valid", ["", "climatology of June", "2024-01-28/yesterday"])
def test_a_period_that_cannot_be_read_stays_a_text(
    result: RunResult, tmp_path: Path, valid: str
) -> None:
    summer, winter = result.fetched.currents
    path = tmp_path / "currents.nc"
    write_currents(with_grids(result, summer, replace(winter, valid=valid)), "winter", path)
    with xr.open_dataset(path) as file:
        assert "time" not in file.variables
        assert "time_coverage_start" not in file.attrs
        assert file.attrs.get("valid", "") == valid
    assert faults(path) == []


def test_longitudes_are_continuous_across_180_degrees(result: RunResult, tmp_path: Path) -> None:
    moved = moved_east(result, 60.4)
    write_currents(moved, "summer", tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        assert np.all(np.diff(file.lon) > 0)
        assert float(file.lon.min()) < 180 < float(file.lon.max())
    assert faults(tmp_path / "currents.nc") == []


def test_bad_names_are_stored_as_labels(result: RunResult, tmp_path: Path) -> None:
    bad = badly_named(result)
    odd = bad.scenario.model_copy(update={"title": f"{SCRIPT}\0\ud800"})
    summer, winter = bad.fetched.currents
    summer = replace(summer, credit=BAD_CREDIT, notes=(small_run.note(ODD),))
    path, run = tmp_path / "currents.nc", replace(with_grids(bad, summer, winter), scenario=odd)
    write_currents(run, SCRIPT, path)
    with xr.open_dataset(path) as file:
        assert file.attrs["season"] == SCRIPT
        assert file.attrs["license"] == BAD_CREDIT.licence
        assert file.attrs["acknowledgement"] == BAD_CREDIT.text
        assert file.attrs["notes"] == ODD
        assert f"{SCRIPT}\N{REPLACEMENT CHARACTER}?" in file.attrs["title"]
    assert faults(path) == []
    write_currents(run, ODD, path)
    with xr.open_dataset(path) as file:
        assert file.attrs["season"] == ODD


def test_characters_that_no_string_can_hold_are_replaced(result: RunResult, tmp_path: Path) -> None:
    names = {"summer": "<b>\0\0", "winter": "\ud800\U0001f30a"}
    for name, stored in zip(names.values(), ("<b>\ufffd\ufffd", "?\U0001f30a"), strict=True):
        write_currents(renamed(result, names), name, tmp_path / "currents.nc")
        with xr.open_dataset(tmp_path / "currents.nc") as file:
            assert file.attrs["season"] == stored


def test_the_example_in_the_documents_runs(
    currents: Path, result: RunResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    readme = (ROOT / "outputs" / "README.md").read_text("utf-8")
    [example] = re.findall(
        r"^## `SCENARIO-SEASON-currents\.nc`\n+```python\n(.*?)^```",
        readme,
        re.MULTILINE | re.DOTALL,
    )
    monkeypatch.chdir(currents.parent)
    namespace: dict[str, Any] = {}
    shutil.copy(currents, currents.with_name("palawan-season-summer-currents.nc"))
    exec(example, namespace)  # noqa: S102 - the document's own example is what is tested
    namespace["currents"].close()
    summer = result.fetched.currents[0]
    at_start = sampled(as_field(summer, summer.u[0]), np.array([(9.1, 119.1)]))
    assert float(namespace["here"].uo) == pytest.approx(at_start[0], abs=1e-12)


def test_a_plane_has_no_currents_to_write(result: RunResult, planar_result: RunResult) -> None:
    names = {"small-run-summer-currents.nc", "small-run-winter-currents.nc"}
    assert names <= set(formats_of(result))
    assert names <= set(formats_of(small_run.with_a_failed_season(result)))
    assert not [name for name in formats_of(planar_result) if name.endswith(".nc")]


def test_a_missing_folder_is_an_os_error(result: RunResult, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nowhere"):
        write_currents(result, "summer", tmp_path / "nowhere" / "currents.nc")


@pytest.mark.usefixtures("small_files")
def test_a_file_that_cannot_be_finished_is_an_os_error(result: RunResult, tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"currents\.nc"):
        write_currents(result, "summer", tmp_path / "currents.nc")


def test_the_same_run_makes_the_same_figures(result: RunResult, tmp_path: Path) -> None:
    for name in ("one.nc", "two.nc"):
        write_currents(result, "summer", tmp_path / name)
    one, two = (xr.load_dataset(tmp_path / name) for name in ("one.nc", "two.nc"))
    assert one.identical(two)
