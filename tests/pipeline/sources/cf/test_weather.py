"""Wind, gusts and waves in files as people have them: one reader reads all, or says why not."""

from pathlib import Path

import numpy as np
import pytest
import shapely
import xarray as xr

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_text
from pipeline.model import CurrentGrid, Land
from pipeline.scenario.season import Season
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.quantities import CURRENT, GUST, PERIOD, WAVES, WIND, Quantity
from tests.pipeline.sources.cf.grib_files import message, write_grib

REGION = shapely.box(-71.2, 42.2, -70.6, 42.6)
LON, LAT = np.arange(-72.0, -69.9, 0.25), np.arange(41.5, 43.6, 0.25)
TIMES = np.array(["2026-12-01T00", "2026-12-01T01", "2026-12-01T02"], "datetime64[ns]")
SEASON = Season.model_validate(
    {
        "name": "one",
        "currents": ["still"],
        "time_method": "changing",
        "departure": "2026-12-01T00:30:00Z",
        "max_hours": 2,
    }
)
# By quantity: names of its variables, and their standard names.
NAMES: dict[str, tuple[Quantity, dict[str, str]]] = {
    "wind": (WIND, {"u10": "eastward_wind", "v10": "northward_wind"}),
    "gust": (GUST, {"gust": "wind_speed_of_gust"}),
    "waves": (WAVES, {"swh": "sea_surface_wave_significant_height"}),
    "period": (PERIOD, {"pp1d": "sea_surface_wave_period_at_variance_spectral_density_maximum"}),
}
ROWS = pytest.mark.parametrize("row", NAMES)


def values(seed: int = 0) -> FloatArray:
    """Values (nt, ny, nx) that a packing leaves as they are."""
    shape = (len(TIMES), LAT.size, LON.size)
    return np.asarray(np.random.default_rng(seed).integers(0, 64, shape) / 16.0)


def fields(row: str, *, standard: bool = True, units: str = "") -> xr.Dataset:
    quantity, names = NAMES[row]
    data = {
        name: (
            ("time", "latitude", "longitude"),
            values(seed),
            {"units": units or quantity.unit, **({"standard_name": said} if standard else {})},
        )
        for seed, (name, said) in enumerate(names.items())
    }
    axes = {
        "time": TIMES,
        "latitude": ("latitude", LAT, {"units": "degrees_north"}),
        "longitude": ("longitude", LON, {"units": "degrees_east"}),
    }
    return xr.Dataset(data, axes)


def read(path: Path, quantity: Quantity) -> CurrentGrid:
    source = CfFiles((str(path),), quantity=quantity)
    assert source.uncovered_reason(REGION, SEASON) == ""
    return source.current(REGION, SEASON, Land((), (), 0.0), Path())


def expected(grid: CurrentGrid, name: int) -> FloatArray:
    columns, rows = np.isin(LON, grid.lon), np.isin(LAT, grid.lat)
    return values(name)[:, rows][:, :, columns]


@ROWS
@pytest.mark.parametrize("form", ["grib 1", "grib 2", "standard names", "names alone"])
def test_every_format_gives_the_values_that_were_written(
    tmp_path: Path, row: str, form: str
) -> None:
    quantity, names = NAMES[row]
    path = tmp_path / "field"
    if form.startswith("grib"):
        write_grib(path, fields(row), int(form[-1]))
    else:
        fields(row, standard=form == "standard names").to_netcdf(path, engine="netcdf4")
    grid = read(path, quantity)
    assert grid.lon[0] <= -71.2
    assert grid.lon[-1] >= -70.6
    np.testing.assert_array_equal(grid.times_s, [-1800.0, 1800.0, 5400.0])
    np.testing.assert_allclose(grid.u, expected(grid, 0), atol=1e-5)
    if len(names) > 1:
        np.testing.assert_allclose(grid.v, expected(grid, 1), atol=1e-5)
    else:
        assert not grid.v.any(), "it has no direction"


def test_a_wind_is_known_by_what_the_file_calls_it_and_that_is_said(tmp_path: Path) -> None:
    data = fields("wind", standard=False).rename(u10="u", v10="v")
    for name in "uv":
        data[name].attrs["long_name"] = f"10 metre {name.upper()} wind component"
    data.to_netcdf(tmp_path / "era5.nc", engine="netcdf4")
    grid = read(tmp_path / "era5.nc", WIND)
    np.testing.assert_array_equal(grid.v, expected(grid, 1))
    (told,) = (note for note in grid.notes if note.kind == "pair-taken")
    assert told.is_decision
    assert note_text(told).startswith("the wind is u and v of the file, by their names alone")


@pytest.mark.parametrize(
    ("row", "units", "factor"), [("wind", "knots", 1852 / 3600), ("waves", "ft", 0.3048)]
)
def test_units_are_converted(tmp_path: Path, row: str, units: str, factor: float) -> None:
    path = tmp_path / "field.nc"
    fields(row, units=units).to_netcdf(path, engine="netcdf4")
    grid = read(path, NAMES[row][0])
    np.testing.assert_allclose(grid.u, factor * expected(grid, 0))
    assert any(note.kind == "unit-converted" for note in grid.notes)


def test_centres_with_tables_of_their_own_are_read(tmp_path: Path) -> None:
    """ERA5's wave height is 229 of table 140, its wind 165 of table 128, its gust 29 of 228."""
    own = {"swh": (WAVES, 229, 140), "u10": (WIND, 165, 128), "v10": (WIND, 166, 128)}
    path = tmp_path / "era5.grb"
    parts = [
        message(
            1,
            name,
            LON,
            LAT,
            values(int(name == "v10"))[step],
            centre="ecmf",
            table2Version=table,
            indicatorOfParameter=number,
            dataDate=20261201,
            dataTime=100 * step,
        )
        for name, (_, number, table) in own.items()
        for step in range(len(TIMES))
    ]
    path.write_bytes(b"".join(parts))
    for quantity in (WAVES, WIND):
        grid = read(path, quantity)
        np.testing.assert_allclose(grid.u, expected(grid, 0), atol=1e-5)
    np.testing.assert_allclose(grid.v, expected(grid, 1), atol=1e-5)


def test_of_many_levels_the_wind_over_the_sea_is_read(tmp_path: Path) -> None:
    low, high = fields("wind"), fields("wind") + 7.0
    path = tmp_path / "levels.grb"
    over = {"typeOfLevel": "heightAboveGround"}
    write_grib(tmp_path / "high", high, 2, **over, level=100)
    write_grib(tmp_path / "low", low, 2, **over, level=10)
    path.write_bytes((tmp_path / "high").read_bytes() + (tmp_path / "low").read_bytes())
    grid = read(path, WIND)
    np.testing.assert_allclose(grid.u, expected(grid, 0), atol=1e-5)


def test_a_gap_gets_the_largest_values_around_it(tmp_path: Path) -> None:
    data = fields("waves")
    inside = (data.longitude > -71.3) & (data.longitude < -70.5) & (data.latitude == 42.5)
    data["swh"] = data.swh.where(~inside)
    path = tmp_path / "gaps.nc"
    data.to_netcdf(path, engine="netcdf4")
    grid = read(path, WAVES)
    assert np.isfinite(grid.u).all()
    row = int(np.flatnonzero(grid.lat == 42.5)[0])
    for column in np.flatnonzero((grid.lon > -71.0) & (grid.lon < -70.7)):
        around = np.s_[:, [row - 1, row + 1], column - 1 : column + 2]
        np.testing.assert_allclose(grid.u[:, row, column], grid.u[around].max(axis=(1, 2)))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: data * 1000.0, r"it reaches .* m, above 30: a fill value"),
        (lambda data: data - 5.0, r"it falls to -5 m: a fill value"),
        (lambda data: data.rename(swh="sst"), r"it has no wave height among sst .*vhm0, swh"),
    ],
)
def test_what_can_be_no_wave_height_is_refused(tmp_path: Path, change: object, said: str) -> None:
    data = fields("waves", standard=False)
    attributes = data.swh.attrs
    changed = change(data)  # type: ignore[operator]
    for name in changed.data_vars:
        changed[name].attrs = attributes
    path = tmp_path / "waves.nc"
    changed.to_netcdf(path, engine="netcdf4")
    source = CfFiles((str(path),), quantity=WAVES)
    with pytest.raises(RequestError, match=said):
        source.current(REGION, SEASON, Land((), (), 0.0), Path())


def test_a_file_of_wind_is_still_no_current(tmp_path: Path) -> None:
    path = write_grib(tmp_path / "wind.grb", fields("wind"))
    reason = CfFiles((str(path),), quantity=CURRENT).uncovered_reason(REGION, SEASON)
    assert "10 metre U wind component" in reason or "component of wind" in reason
    assert "the components of a current" in reason


def with_versions(data: xr.Dataset, *filled: str) -> xr.Dataset:
    """Data as the Climate Data Store gave them: of `expver` each time has those that it names."""
    both = data.expand_dims(expver=[1, 5]).transpose("time", "expver", ...)
    named = [[version in of for version in "15"] for of in filled]
    return both.where(xr.DataArray(named, dims=("time", "expver")))


@pytest.mark.parametrize("time", ["time", "valid_time"])
def test_era5_and_its_preliminary_times_are_one_series_and_that_is_said(
    tmp_path: Path, time: str
) -> None:
    path = tmp_path / "era5.nc"
    data = with_versions(fields("wind"), "1", "5", "5")
    data.rename({"time": time} if time != "time" else {}).to_netcdf(path, engine="netcdf4")
    grid = read(path, WIND)
    np.testing.assert_array_equal(grid.u, expected(grid, 0))
    np.testing.assert_array_equal(grid.v, expected(grid, 1))
    (told,) = (note for note in grid.notes if note.kind == "versions-merged")
    assert told.is_decision


@pytest.mark.parametrize("filled", [("1", "15", "5"), ("1", "", "5")])
def test_times_of_both_versions_of_era5_are_refused(
    tmp_path: Path, filled: tuple[str, ...]
) -> None:
    path = tmp_path / "era5.nc"
    with_versions(fields("wind"), *filled).to_netcdf(path, engine="netcdf4")
    reason = CfFiles((str(path),), quantity=WIND).uncovered_reason(REGION, SEASON)
    assert "values of both ERA5 and ERA5T, or of neither; keep one, as with `ncks -d" in reason
    with_versions(fields("wind"), *filled).isel(expver=[1]).to_netcdf(path, engine="netcdf4")
    assert not CfFiles((str(path),), quantity=WIND).uncovered_reason(REGION, SEASON)
