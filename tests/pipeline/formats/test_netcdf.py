import json
import re
import resource
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import shapely
import xarray as xr

import renew
from pipeline.findings.result import RunResult
from pipeline.findings.route_profile import legs
from pipeline.formats.records import write_currents
from pipeline.geo.projection import Projection
from pipeline.model import CurrentGrid
from pipeline.stages.project import extent_polygon
from pipeline.write import formats_of
from tests.conftest import ROOT
from tests.pipeline.formats import small_run
from tests.pipeline.formats.currents_files import (
    along_routes,
    faults,
    in_file,
    planners,
    with_grids,
)
from tests.pipeline.formats.gis.cases import (
    BAD_CREDIT,
    ODD,
    SCRIPT,
    badly_named,
    moved_east,
    renamed,
)
from tests.pipeline.results import with_case, with_water
from tests.true_scale import GEOD


@pytest.fixture
def small_files() -> Iterator[None]:
    """Limit files to 4 kB, which has the effect of a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4_000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


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


@pytest.mark.parametrize("season", ["summer", "winter"])
def test_a_reader_finds_the_planners_current(
    result: RunResult, tmp_path: Path, season: str
) -> None:
    """Within 1e-5 m/s: figures have 24 bits, and north turns nearly linearly within a cell."""
    write_currents(result.case(season), tmp_path / "currents.nc")
    points = along_routes(result, season, 1000)
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        assert np.isfinite(file.uo).all()
        assert np.isfinite(file.vo).all()
        found = in_file(file, result.water.projection.to_lonlat(points))
    np.testing.assert_allclose(found, planners(result, season, points), rtol=0, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("west", "south", "east", "north", "cell_deg", "tolerance"),
    [
        (5.0, 58.0, 9.0, 60.0, 1 / 12, 1e-4),  # transverse Mercator
        (5.0, 58.0, 9.0, 60.0, 1 / 4, 3e-4),
        (-30.0, 40.0, -8.0, 52.0, 1 / 12, 1e-4),  # Lambert
        (10.0, 76.0, 26.0, 81.0, 1 / 12, 1e-3),
    ],
)
def test_north_that_turns_in_the_plane_hardly_matters(
    result: RunResult,
    tmp_path: Path,
    west: float,
    south: float,
    east: float,
    north: float,
    cell_deg: float,
    tolerance: float,
) -> None:
    """On a rough current, whose figures are random from cell to cell."""
    rng = np.random.default_rng(1)
    lon, lat = (np.arange(begin, end, cell_deg) for begin, end in ((west, east), (south, north)))
    u, v = rng.uniform(-0.5, 0.5, (2, 1, len(lat), len(lon)))
    region = shapely.box(west, south, east, north)
    projection = Projection.for_region(region, 1000.0)
    chart = renew.Chart(extent_polygon(region, projection), [])
    moved = with_water(result, chart=chart, projection=projection)
    grid = CurrentGrid("summer", lon, lat, u, v, "", small_run.STAND_IN)
    run = with_grids(moved, grid)
    write_currents(run.case("summer"), tmp_path / "currents.nc")
    xmin, ymin, xmax, ymax = chart.bounds
    points = rng.uniform((xmin, ymin), (xmax, ymax), (1000, 2))
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        found = in_file(file, projection.to_lonlat(points))
        nodes = np.stack([file.lon, file.lat], axis=-1)
        x, y = np.meshgrid(file.x, file.y)
        np.testing.assert_allclose(
            projection.to_plane(nodes) * 1000.0, np.stack([x, y], axis=-1), rtol=0, atol=0.01
        )
    np.testing.assert_allclose(found, planners(run, "summer", points), rtol=0, atol=tolerance)
    assert faults(tmp_path / "currents.nc") == []


def sailed(file: xr.Dataset, result: RunResult, path: np.ndarray) -> np.ndarray:
    """Speed over ground (n - 1,) on each leg of a path, integrated through the file's current."""
    through_water = result.cases[0].case.vessel.speed
    speeds = []
    for begin, end in pairwise(path):
        ends = result.water.projection.to_lonlat(np.linspace(begin, end, 401))
        azimuth, _, length = GEOD.inv(*ends[:-1].T, *ends[1:].T)
        course = np.radians(azimuth)
        ahead = np.stack([np.sin(course), np.cos(course)], axis=-1)
        current = in_file(file, (ends[:-1] + ends[1:]) / 2)
        along = (current * ahead).sum(axis=1)
        across = current[:, 0] * ahead[:, 1] - current[:, 1] * ahead[:, 0]
        made = along + (
            np.sqrt(through_water**2 - across**2)
            if result.scenario.planner.drift == "crab"
            else through_water
        )
        speeds.append(length.sum() / (length / made).sum())
    return np.array(speeds)


@pytest.mark.gate_share(1)
@pytest.mark.parametrize("season", ["summer", "winter"])
def test_a_reader_finds_the_legs_speeds(result: RunResult, tmp_path: Path, season: str) -> None:
    write_currents(result.case(season), tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        for ranked in result.case(season).routes:
            found = sailed(file, result, np.asarray(ranked.route.path))
            np.testing.assert_allclose(found, legs(ranked).speed_m_s[:-1], rtol=1e-3)


def test_filled_nodes_are_flagged(result: RunResult, currents: Path) -> None:
    """Gap and flag cover four of the source's cells, each of which is four of the planner's."""
    with xr.open_dataset(currents) as file:
        flag = file.filled
        assert flag.flag_meanings.split() == ["from_source", "filled_from_neighbours"]
        assert flag.flag_values.tolist() == [0, 1]
        assert "filled" in file.uo.ancillary_variables.split()
        within = (abs(file.lon - 119.5) < 0.2) & (abs(file.lat - 9.5) < 0.2)
        assert within.any()
        np.testing.assert_array_equal(flag.values.astype(bool), within.values)
    cells = result.fetched.currents[0].cells
    assert not cells.at(np.array([[119.5, 9.5]]))[0]


def test_gdal_places_the_grid_where_it_is(result: RunResult, tmp_path: Path) -> None:
    """Two seasons on different grids: one file for both was at 0 to 27 by -24 to 0 degrees."""
    gdalinfo = shutil.which("gdalinfo")
    if gdalinfo is None:
        pytest.skip("gdalinfo is not installed (Debian: gdal-bin)")
    summer, winter = result.fetched.currents
    lon, lat = np.linspace(118.5, 120.5, 5), np.linspace(8.5, 10.5, 5)
    grid = np.arange(25.0).reshape(1, 5, 5) / 25
    run = with_grids(result, summer, replace(winter, lon=lon, lat=lat, u=grid, v=-grid))
    for season in ("summer", "winter"):
        path = tmp_path / f"{season}.nc"
        write_currents(run.case(season), path)
        asked = [gdalinfo, "-json", "-stats", f"NETCDF:{path}:uo"]
        found = json.loads(subprocess.run(asked, capture_output=True, check=True).stdout)
        west, east_step, _, north, _, south_step = found["geoTransform"]
        with xr.open_dataset(path) as file:
            assert west + east_step / 2 == pytest.approx(float(file.x[0]))
            assert north + south_step / 2 == pytest.approx(float(file.y[-1]))
            assert found["size"] == [file.sizes["x"], file.sizes["y"]]
            (band,) = found["bands"]  # GDAL prints three decimals
            assert band["minimum"] == pytest.approx(float(file.uo.min()), abs=6e-4)
            assert band["maximum"] == pytest.approx(float(file.uo.max()), abs=6e-4)
        assert "Transverse_Mercator" in found["coordinateSystem"]["wkt"].replace(" ", "_")


@pytest.fixture
def tide(result: RunResult) -> RunResult:
    """The same run in a current that changes: departure is on 22 November 2026 at 6 h."""
    rng = np.random.default_rng(2)
    lon, lat = np.linspace(118.9, 120.3, 8), np.linspace(8.9, 10.1, 7)
    u, v = rng.uniform(-0.4, 0.4, (2, 4, 7, 8))
    u[:, 3, 2] = v[:, 3, 2] = np.nan
    times = np.array([-5400.0, -600.0, 3000.0, 90_000.0])
    grid = CurrentGrid("summer", lon, lat, u, v, "2026-11", small_run.STAND_IN, times_s=times)
    run = with_grids(result, grid)
    departure = datetime(2026, 11, 22, 6, tzinfo=UTC)
    return with_case(run, "summer", departure=departure)


def test_a_current_that_changes_is_written_at_all_its_times(
    tide: RunResult, tmp_path: Path
) -> None:
    write_currents(tide.case("summer"), tmp_path / "currents.nc")
    points = along_routes(tide, "summer", 1000)
    lonlat = tide.water.projection.to_lonlat(points)
    seconds = np.random.default_rng(3).uniform(-5400.0, 90_000.0, 1000)
    departure = np.datetime64("2026-11-22T06:00", "ns")
    times = xr.DataArray(departure + (seconds * 1e9).astype("m8[ns]"), dims="point")
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        assert file.uo.dims == ("time", "y", "x")
        assert file.time.values[0] == np.datetime64("2026-11-22T04:30")
        found = in_file(file, lonlat, time=times)
    assert found == pytest.approx(planners(tide, "summer", points, seconds), abs=1e-4)
    assert faults(tmp_path / "currents.nc") == []


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


def test_notes_and_references_are_written(result: RunResult, tmp_path: Path) -> None:
    summer, winter = result.fetched.currents
    summer = replace(
        summer,
        notes=(small_run.note("one"), small_run.note("two")),
        credit=replace(summer.credit, url="https://u"),
    )
    write_currents(with_grids(result, summer, winter).case("summer"), tmp_path / "currents.nc")
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
    changed = with_grids(result, summer, replace(winter, valid=valid))
    write_currents(changed.case("winter"), path)
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
    changed = with_grids(result, summer, replace(winter, valid=valid))
    write_currents(changed.case("winter"), path)
    with xr.open_dataset(path) as file:
        assert "time" not in file.variables
        assert "time_coverage_start" not in file.attrs
        assert file.attrs.get("valid", "") == valid
    assert faults(path) == []


def test_longitudes_are_continuous_across_180_degrees(result: RunResult, tmp_path: Path) -> None:
    moved = moved_east(result, 60.4)
    write_currents(moved.case("summer"), tmp_path / "currents.nc")
    with xr.open_dataset(tmp_path / "currents.nc") as file:
        assert np.all(np.diff(file.lon, axis=1) > 0)
        assert float(file.lon.min()) < 180 < float(file.lon.max())
    assert faults(tmp_path / "currents.nc") == []


def test_bad_names_are_stored_as_labels(result: RunResult, tmp_path: Path) -> None:
    bad = badly_named(result)
    odd = bad.scenario.model_copy(update={"title": f"{SCRIPT}\0\ud800"})
    summer, winter = bad.fetched.currents
    summer = replace(summer, credit=BAD_CREDIT, notes=(small_run.note(ODD),))
    path, run = tmp_path / "currents.nc", replace(with_grids(bad, summer, winter), scenario=odd)
    write_currents(run.case(SCRIPT), path)
    with xr.open_dataset(path) as file:
        assert file.attrs["season"] == SCRIPT
        assert file.attrs["license"] == BAD_CREDIT.licence
        assert file.attrs["acknowledgement"] == BAD_CREDIT.text
        assert file.attrs["notes"] == ODD
        assert f"{SCRIPT}\N{REPLACEMENT CHARACTER}?" in file.attrs["title"]
    assert faults(path) == []
    write_currents(run.case(ODD), path)
    with xr.open_dataset(path) as file:
        assert file.attrs["season"] == ODD


def test_characters_that_no_string_can_hold_are_replaced(result: RunResult, tmp_path: Path) -> None:
    names = {"summer": "<b>\0\0", "winter": "\ud800\U0001f30a"}
    for name, stored in zip(names.values(), ("<b>\ufffd\ufffd", "?\U0001f30a"), strict=True):
        write_currents(renamed(result, names).case(name), tmp_path / "currents.nc")
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
    place = result.water.projection.to_plane([[119.1, 9.1]])
    east, north = planners(result, "summer", place)[0]
    assert float(namespace["here"].uo) == pytest.approx(east, abs=1e-6)
    assert float(namespace["here"].vo) == pytest.approx(north, abs=1e-6)


def test_a_plane_has_no_currents_to_write(result: RunResult, planar_result: RunResult) -> None:
    names = {"small-run-summer-currents.nc", "small-run-winter-currents.nc"}
    assert names <= set(formats_of(result))
    assert names <= set(formats_of(small_run.with_a_failed_season(result)))
    assert not [name for name in formats_of(planar_result) if name.endswith(".nc")]


def test_a_missing_folder_is_an_os_error(result: RunResult, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nowhere"):
        write_currents(result.case("summer"), tmp_path / "nowhere" / "currents.nc")


@pytest.mark.usefixtures("small_files")
def test_a_file_that_cannot_be_finished_is_an_os_error(result: RunResult, tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"currents\.nc"):
        write_currents(result.case("summer"), tmp_path / "currents.nc")


def test_the_same_run_makes_the_same_figures(result: RunResult, tmp_path: Path) -> None:
    for name in ("one.nc", "two.nc"):
        write_currents(result.case("summer"), tmp_path / name)
    one, two = (xr.load_dataset(tmp_path / name) for name in ("one.nc", "two.nc"))
    assert one.identical(two)
