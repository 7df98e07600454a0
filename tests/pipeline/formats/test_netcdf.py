from __future__ import annotations

import re
import resource
import uuid
import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import netCDF4
import numpy as np
import pytest
import xarray as xr

from pipeline.formats.netcdf import has_currents, write_currents
from tests.pipeline.formats import small_run
from tests.pipeline.formats.gis.cases import ODD, SCRIPT, badly_named, moved_east, renamed

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from pipeline.formats.result import RunResult

_MEDIUM = 2  # compliance_checker's weights: 3 is high, 2 medium, 1 low


@pytest.fixture(scope="module")
def currents(result: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("currents") / "currents.nc"
    write_currents(result, path)
    return path


@pytest.fixture
def small_files() -> Iterator[None]:
    """Let no file grow beyond 4 kB: the nearest thing to a full disk that needs no other disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4_000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def with_valid(result: RunResult, valid: str) -> RunResult:
    grids = tuple(replace(grid, valid=valid) for grid in result.fetched.currents)
    return replace(result, fetched=replace(result.fetched, currents=grids))


def group_alone(path: Path, name: str) -> netCDF4.Dataset:
    """One season as a file of its own, in memory: the checker looks at no groups."""
    alone = netCDF4.Dataset(f"{uuid.uuid4()}.nc", "w", diskless=True)
    with netCDF4.Dataset(path) as file:
        group = file[name]
        alone.setncatts({**file.__dict__, **group.__dict__})
        for dimension in group.dimensions.values():
            alone.createDimension(dimension.name, dimension.size)
        for variable in group.variables.values():
            attributes = dict(variable.__dict__)
            fill = attributes.pop("_FillValue", None)
            copy = alone.createVariable(
                variable.name, variable.dtype, variable.dimensions, fill_value=fill
            )
            copy.setncatts(attributes)
            copy[...] = variable[...]
    return alone


def faults(dataset: netCDF4.Dataset) -> list[str]:
    """What the CF checker of IOOS holds against a dataset, of high and medium weight.

    Its table of standard names comes with it; the suite's guard refuses every connection.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own and its libraries' deprecations
        from compliance_checker.runner import CheckSuite

        suite = CheckSuite()
        suite.load_all_available_checkers()
        found = suite.run_all(dataset, ["cf:1.11"])
    [(groups, errors)] = found.values()
    assert not errors
    assert len(groups) > 10
    return [
        f"{group.name}: {message}"
        for group in groups
        if group.weight >= _MEDIUM
        for message in group.msgs
    ]


@pytest.mark.parametrize("season", ["summer", "winter"])
def test_the_cf_checker_finds_nothing(currents: Path, season: str) -> None:
    assert faults(group_alone(currents, season)) == []


def test_the_cf_checker_would_find_a_fault(currents: Path) -> None:
    dataset = group_alone(currents, "summer")
    dataset["uo"].standard_name = "eastward_motion_of_water"
    dataset["lon"].units = "furlong"
    found = "\n".join(faults(dataset))
    assert "eastward_motion_of_water" in found
    assert "lon" in found


def test_the_figures_are_the_sources_own(currents: Path, result: RunResult) -> None:
    for grid in result.fetched.currents:
        with xr.open_dataset(currents, group=grid.season) as season:
            np.testing.assert_array_equal(season.lon, grid.lon)
            np.testing.assert_array_equal(season.lat, grid.lat)
            assert season.uo.dims == ("time", "lat", "lon")
            np.testing.assert_array_equal(season.uo[0], grid.u)
            np.testing.assert_array_equal(season.vo[0], grid.v)
            assert np.isnan(season.uo).sum() == np.isnan(grid.u).sum() > 0


def test_a_reader_by_the_conventions_finds_east_and_north(currents: Path) -> None:
    with xr.open_dataset(currents, group="summer") as season:
        for direction in ("eastward", "northward"):
            name = f"surface_{direction}_sea_water_velocity"
            [found] = season.filter_by_attrs(standard_name=name).data_vars.values()
            assert found.units == "m s-1"
        # Summer sets to the east.
        assert float(season.uo.mean()) == pytest.approx(0.3, abs=0.05)
        assert abs(float(season.vo.mean())) < 0.05


def test_all_seasons_open_as_one_tree(currents: Path, result: RunResult) -> None:
    with xr.open_datatree(currents) as tree:
        assert list(tree.children) == ["summer", "winter"]
        assert re.fullmatch(r"CF-1\.\d+", tree.attrs["Conventions"])
        assert tree.attrs["title"] == "Surface currents of Two islands"
        assert tree.attrs["history"].startswith("2026-01-02T03:04:05Z: written by renew-planner")
        assert tree.attrs["scenario"] == "small-run"
        for grid in result.fetched.currents:
            attributes = tree[grid.season].attrs
            assert attributes["acknowledgement"] == grid.credit.text
            assert attributes["license"] == grid.credit.licence
            assert attributes["valid"] == grid.valid
            assert grid.credit.text in tree.attrs["acknowledgement"]


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
        ("2024-01-03T06:00Z", "2024-01-03T06:00", None),
    ],
)
def test_the_time_is_that_of_the_source(
    result: RunResult, tmp_path: Path, valid: str, middle: str, bounds: list[str] | None
) -> None:
    write_currents(with_valid(result, valid), tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc", group="winter") as season:
        assert season.time.values == [np.datetime64(middle)]
        if bounds is None:
            assert "time_bounds" not in season
        else:
            assert season.time_bounds.values.tolist() == [
                [np.datetime64(bound, "ns").astype(int) for bound in bounds]
            ]
    assert faults(group_alone(tmp_path / "currents.nc", "winter")) == []


@pytest.mark.parametrize("valid", ["", "climatology of June", "2024-01-28/yesterday"])
def test_a_time_that_cannot_be_read_is_left_as_it_is(
    result: RunResult, tmp_path: Path, valid: str
) -> None:
    write_currents(with_valid(result, valid), tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc", group="winter") as season:
        assert season.uo.dims == ("lat", "lon")
        assert season.attrs.get("valid", "") == valid
    assert faults(group_alone(tmp_path / "currents.nc", "winter")) == []


def test_longitudes_go_on_across_180_degrees(result: RunResult, tmp_path: Path) -> None:
    moved = moved_east(result, 60.4)
    write_currents(moved, tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc", group="summer") as season:
        assert np.all(np.diff(season.lon) > 0)
        assert float(season.lon.min()) < 180 < float(season.lon.max())
    assert faults(group_alone(tmp_path / "currents.nc", "summer")) == []


def test_bad_names_become_groups_and_are_kept_as_text(result: RunResult, tmp_path: Path) -> None:
    bad = badly_named(result)
    odd = bad.scenario.model_copy(update={"title": f"{SCRIPT}\0\ud800"})
    write_currents(replace(bad, scenario=odd), tmp_path / "currents.nc")
    with xr.open_datatree(tmp_path / "currents.nc") as tree:
        assert len(tree.children) == 2
        assert [child.attrs["season"] for child in tree.children.values()] == [SCRIPT, ODD]
        assert tree.attrs["title"] == f"Surface currents of {SCRIPT}\N{REPLACEMENT CHARACTER}?"
        assert all(child.path.count("/") == 1 for child in tree.children.values())


def test_seasons_whose_names_meet_keep_apart(result: RunResult, tmp_path: Path) -> None:
    write_currents(renamed(result, {"summer": "a/b", "winter": "a.b"}), tmp_path / "currents.nc")
    with xr.open_datatree(tmp_path / "currents.nc") as tree:
        assert [child.attrs["season"] for child in tree.children.values()] == ["a/b", "a.b"]


def test_a_plane_has_no_currents_to_write(result: RunResult, planar_result: RunResult) -> None:
    assert has_currents(result)
    assert has_currents(small_run.with_a_failed_season(result))
    assert not has_currents(planar_result)


def test_a_missing_folder_is_an_error_of_the_system(result: RunResult, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nowhere"):
        write_currents(result, tmp_path / "nowhere" / "currents.nc")


@pytest.mark.usefixtures("small_files")
def test_a_file_that_cannot_be_finished_is_an_error_of_the_system(
    result: RunResult, tmp_path: Path
) -> None:
    with pytest.raises(OSError, match=r"currents\.nc"):
        write_currents(result, tmp_path / "currents.nc")


def test_the_same_run_makes_the_same_figures(result: RunResult, tmp_path: Path) -> None:
    files: list[Any] = []
    for name in ("one.nc", "two.nc"):
        write_currents(result, tmp_path / name)
        files.append(xr.open_datatree(tmp_path / name))
    one, two = files
    assert one.identical(two)
    one.close()
    two.close()
