"""Currents in GRIB files, editions 1 and 2: read as the same in NetCDF, or refused by name."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import eccodes
import numpy as np
import pytest
import shapely
import xarray as xr

from pipeline.findings.note_words import note_texts
from pipeline.model import CurrentGrid, Land
from pipeline.scenario.season import Season
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.cf.dataset import fatal_files, open_dataset
from pipeline.sources.current_field import Field, LandMask
from tests.pipeline.sources.cf.grib_files import PARAMETERS, messages, write_grib
from tests.pipeline.synthetic_currents import coastal, dataset, sea

REGION = shapely.box(118.3, 9.3, 119.2, 10.4)
LON, LAT = np.arange(108.0, 130.0, 0.5), np.arange(0.0, 20.0, 0.5)
DAYS = ("2024-07-01", "2024-07-02", "2024-07-03")
EDITIONS = pytest.mark.parametrize("edition", [1, 2])


@pytest.fixture(scope="module")
def around_palawan(world_mask: LandMask) -> Field:
    """A sea around Palawan, with gaps on land."""
    return coastal(sea(LON, LAT, seed=2), world_mask)


@pytest.fixture(scope="module")
def days(around_palawan: Field) -> xr.Dataset:
    """Three days of it, each with a current of its own."""
    field = around_palawan
    steps = [Field(LON, LAT, scale * field.u, scale * field.v) for scale in (1.0, 0.7, 0.9)]
    return dataset(*steps, times=DAYS)


def season_of(path: Path, **season: object) -> tuple[Season, CfFiles]:
    """Return a season on 2 July 2024, unless something else is asked for, and its source."""
    about = season or {"valid": "2024-07-02"}
    one = Season.model_validate({"name": "summer", "currents": [[str(path)]], **about})
    return one, CfFiles((str(path),))


def current(path: Path, **season: object) -> CurrentGrid:
    """Read a file as a season's current."""
    one, source = season_of(path, **season)
    assert source.uncovered_reason(REGION, one) == ""
    return source.current(REGION, one, Land((), (), 0.0), Path())


def refusal(path: Path, **season: object) -> str:
    """Return the line with which a file is refused before a run."""
    one, source = season_of(path, **season)
    line = source.uncovered_reason(REGION, one)
    assert line.startswith(f"{path.name}: ")
    assert line.isprintable()
    return line


def joined(path: Path, parts: Sequence[bytes]) -> Path:
    path.write_bytes(b"".join(parts))
    return path


# --- what the planner is given ------------------------------------------------------------------


@EDITIONS
def test_a_grib_file_gives_what_the_same_netcdf_file_does(
    tmp_path: Path, days: xr.Dataset, edition: int
) -> None:
    """The NetCDF file is written from the values that the GRIB file's packing has left."""
    grib = write_grib(tmp_path / "sea.grb", days, edition)
    with open_dataset(grib) as data:
        packed = days.copy(data={name: data[name].isel(depth=0).values for name in ("uo", "vo")})
    assert np.nanmax(np.abs(packed.uo - days.uo)) < 1e-6
    for name in packed.data_vars:
        packed[name].attrs["cell_methods"] = "time: point"
    packed.to_netcdf(tmp_path / "sea.nc", engine="netcdf4")
    seasons: list[dict[str, object]] = [
        {},
        {"valid": "2024-07-01T18:00Z", "time_method": "linear"},
        {"valid": "2024-07"},
        {"time_method": "changing", "departure": "2024-07-01T06:00:00Z", "max_hours": 24},
    ]
    for season in seasons:
        one, other = (current(tmp_path / f"sea.{suffix}", **season) for suffix in ("grb", "nc"))
        for name in ("lon", "lat", "u", "v", "times_s"):
            np.testing.assert_allclose(
                getattr(one, name), getattr(other, name), rtol=0, atol=1e-12, equal_nan=True
            )
        assert (one.valid, one.notes) == (other.valid, other.notes)
        assert np.isnan(one.u).any(), "Palawan is in it"


ORDERS: dict[str, dict[str, int]] = {
    "rows": {},
    "columns": {"jPointsAreConsecutive": 1},
    "rows that turn round": {"alternativeRowScanning": 1},
}
ORDERS_OF_EDITIONS = [(1, "rows"), (1, "columns"), *((2, order) for order in ORDERS)]


@pytest.mark.gate_share(8)
@pytest.mark.parametrize(("edition", "order"), ORDERS_OF_EDITIONS)
@pytest.mark.parametrize("east", [1, -1])
@pytest.mark.parametrize("north", [1, -1])
def test_values_are_where_the_library_has_them(
    tmp_path: Path, edition: int, order: str, east: int, north: int
) -> None:
    """Also across the meridian of Greenwich, and with a hole."""
    lon, lat = np.arange(-2.0, 3.0, 0.5)[::east], np.arange(40.0, 43.0, 0.5)[::north]
    values = np.random.default_rng(3).uniform(-1, 1, (lat.size, lon.size)).round(3)
    values[1, 2] = np.nan
    field = Field(lon, lat, values, -values)
    path = write_grib(tmp_path / "sea.grb", dataset(field), edition, **ORDERS[order])
    with path.open("rb") as file:
        handle = eccodes.codes_grib_new_from_file(file)
        points = eccodes.codes_grib_get_data(handle)
        missing = eccodes.codes_get(handle, "missingValue")
        eccodes.codes_release(handle)
    with open_dataset(path) as data:
        uo = data.uo.isel(time=0, depth=0)
        whole = uo.assign_coords(longitude=(uo.longitude + 180) % 360 - 180).load()
        for one in points if order != "rows that turn round" else []:
            place = {"latitude": one["lat"], "longitude": (one["lon"] + 180) % 360 - 180}
            found = float(whole.sel(place, method="nearest"))
            assert found == pytest.approx(one["value"]) or one["value"] == missing
        np.testing.assert_allclose(uo.values, values, atol=1e-6)
        np.testing.assert_allclose(data.vo.isel(time=0, depth=0).values, -values, atol=1e-6)
        np.testing.assert_array_equal(uo[1:4:2, ::-3].values, uo.values[1:4:2, ::-3])
        assert np.allclose(np.exp(1j * np.radians(data.longitude - lon)), 1)
        assert np.allclose(data.latitude, lat)


def test_wind_and_other_parameters_beside_currents_are_left_out(
    tmp_path: Path, days: xr.Dataset
) -> None:
    wind = messages(days.rename(uo="u10", vo="v10"))
    joined(tmp_path / "both.grb", [*wind, *messages(days, 2), *wind])
    write_grib(tmp_path / "sea.grb", days, 2)
    one, other = (current(tmp_path / name) for name in ("both.grb", "sea.grb"))
    np.testing.assert_array_equal(one.u, other.u)
    assert one.credit.text == "US National Weather Service - NCEP"


def test_both_components_in_one_message_are_found(tmp_path: Path, days: xr.Dataset) -> None:
    """As NCEP writes them."""
    with (tmp_path / "multi.grb").open("wb") as file:
        for pair in zip(*[iter(messages(days, 2))] * 2, strict=True):
            multi = eccodes.codes_grib_multi_new()
            for one in pair:
                handle = eccodes.codes_new_from_message(one)
                eccodes.codes_grib_multi_append(handle, 4, multi)
                eccodes.codes_release(handle)
            eccodes.codes_grib_multi_write(multi, file)
            eccodes.codes_grib_multi_release(multi)
    write_grib(tmp_path / "sea.grb", days, 2)
    one, other = (current(tmp_path / name) for name in ("multi.grb", "sea.grb"))
    np.testing.assert_array_equal(one.u, other.u)
    np.testing.assert_array_equal(one.v, other.v)


@pytest.mark.gate_share(1)
@EDITIONS
def test_the_uppermost_level_is_the_surface(tmp_path: Path, days: xr.Dataset, edition: int) -> None:
    deep = messages(days * 0.1, edition, typeOfLevel="depthBelowSea", level=50)
    at_4_m = messages(days, edition, typeOfLevel="depthBelowSea", level=4)
    grid = current(joined(tmp_path / "levels.grb", [*deep, *at_4_m]))
    write_grib(tmp_path / "sea.grb", days, edition)
    np.testing.assert_array_equal(grid.u, current(tmp_path / "sea.grb").u)
    assert any("4 m" in text for text in note_texts(grid.notes))
    assert "50 m deep" in refusal(joined(tmp_path / "deep.grb", deep))


@EDITIONS
def test_a_forecast_is_placed_by_its_valid_time_and_a_mean_by_its_middle(
    tmp_path: Path, days: xr.Dataset, edition: int
) -> None:
    first = days.isel(time=[0])
    parts = [part for step in (0, 24) for part in messages(first, edition, step=step)]
    path = joined(tmp_path / "forecast.grb", parts)
    assert current(path, valid="2024-07-02T01:00Z").valid == "2024-07-02"
    season, source = season_of(path)
    assert str(source.issue(season).reference).startswith("2024-07-01 00:00")
    mean = write_grib(
        tmp_path / "mean.grb", first, edition, stepType="avg", startStep=0, endStep=24
    )
    with open_dataset(mean) as data:
        assert data.periods.values.tolist() == [[1719792000.0, 1719878400.0]]
    (moment,) = season_of(mean)[1].contents().steps.moments
    assert moment.isoformat() == "2024-07-01T12:00:00+00:00"


# --- what is refused ----------------------------------------------------------------------------


@EDITIONS
@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("u10", "v10"), "it has U component of wind, V component of wind, and not the components"),
        (("uo", "v10"), "it has only one component at 2024-07-01T00:00Z"),
    ],
)
def test_files_of_something_else_are_refused_by_name(
    tmp_path: Path, days: xr.Dataset, edition: int, names: tuple[str, str], said: str
) -> None:
    other = days.rename(uo=names[0], vo=names[1])
    assert said in refusal(write_grib(tmp_path / "other.grb", other, edition))


def test_the_same_number_in_a_centres_own_table_is_something_else(
    tmp_path: Path, days: xr.Dataset
) -> None:
    path = write_grib(tmp_path / "gust.grb", days, centre="ecmf", table2Version=128)
    assert "10 metre wind gust" in refusal(path)


def _ensemble(days: xr.Dataset) -> list[bytes]:
    about = {"productDefinitionTemplateNumber": 1, "numberOfForecastsInEnsemble": 2}
    return [part for n in (1, 2) for part in messages(days, 2, **about, perturbationNumber=n)]


def _larger(one: bytes) -> bytes:
    """State 60,000 nodes along both axes of a message of edition 1, and no steps."""
    grid = 8 + 28
    sizes = (60_000).to_bytes(2, "big") * 2
    flags = bytes([one[grid + 16] & 0x7F])
    steps = b"\xff" * 4
    axes = one[grid + 10 : grid + 16] + flags + one[grid + 17 : grid + 23]
    return one[: grid + 6] + sizes + axes + steps + one[grid + 27 :]


ODD: dict[str, tuple[Callable[[xr.Dataset], list[bytes]], str]] = {
    "twice": (lambda days: [*messages(days), *messages(days)], "two fields of the eastward"),
    "half": (lambda days: messages(days)[:-1], "only one component at 2024-07-03T00:00Z"),
    "ensemble": (_ensemble, "an ensemble of 2; keep one member"),
    "grids": (
        lambda days: [*messages(days), *messages(days.isel(latitude=slice(9)))],
        "on 2 grids",
    ),
    "levels": (
        lambda days: [*messages(days), *messages(days, typeOfLevel="heightAboveGround", level=10)],
        "2 levels, some of the kind heightAboveGround",
    ),
    "largest": (
        lambda days: messages(days, 2, stepType="max", startStep=0, endStep=6),
        "neither those of a time nor means (max)",
    ),
    "axes": (
        lambda days: messages(days, iDirectionIncrementInDegrees=2.0),
        "longitudes contradict each other",
    ),
    "grid": (lambda days: messages(days, 2, gridType="rotated_ll"), "of the kind rotated_ll"),
    "nodes": (lambda days: [_larger(one) for one in messages(days)], "60,000 x 60,000 nodes"),
}


@pytest.mark.parametrize("name", ODD)
def test_odd_files_are_refused(tmp_path: Path, days: xr.Dataset, name: str) -> None:
    make, said = ODD[name]
    assert said in refusal(joined(tmp_path / "odd.grb", make(days)))


@EDITIONS
def test_a_file_cut_anywhere_is_refused_and_nothing_is_written_beside_it(
    tmp_path: Path, days: xr.Dataset, edition: int
) -> None:
    whole = b"".join(messages(days, edition))
    size = len(whole) // 6
    paths = [
        joined(tmp_path / f"{at}.grb", [whole[:at]])
        for at in (12, 100, size - 1, size + 5, len(whole) // 2 + 7, len(whole) - 1)
    ]
    faults = fatal_files(paths)
    assert set(faults) == set(paths)
    for path in paths:
        assert "it ends in the middle of a message; fetch it again" in refusal(path)
    current(write_grib(tmp_path / "whole.grb", days, edition))
    assert {path.suffix for path in tmp_path.iterdir()} == {".grb"}


def test_complaints_of_the_library_reach_no_user(
    tmp_path: Path, days: xr.Dataset, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = bytearray(b"".join(messages(days)))
    whole[8:11] = b"\xff\xff\xff"
    assert "can't be read" in refusal(joined(tmp_path / "bad.grb", [bytes(whole)]))
    assert capfd.readouterr() == ("", "")


def test_without_the_library_the_extra_is_named(
    tmp_path: Path, days: xr.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_grib(tmp_path / "sea.grb", days)
    monkeypatch.setitem(sys.modules, "eccodes", None)
    with pytest.raises(ValueError, match=r"it is GRIB, .* pip install eccodes eccodeslib"):
        open_dataset(path)


def test_parameters_of_the_test_files_differ() -> None:
    """Else a wind could pass for a current."""
    for edition in (1, 2):
        assert len({numbers[edition] for numbers in PARAMETERS.values()}) == len(PARAMETERS)


@EDITIONS
def test_a_lone_level_of_another_kind_is_named(
    tmp_path: Path, days: xr.Dataset, edition: int
) -> None:
    """Programs for sailors write currents on many kinds of level; some models on the floor."""
    kind = "heightAboveGround" if edition == 1 else "seaBottom"
    keys: dict[str, float | str] = {"typeOfLevel": kind} | ({"level": 10} if edition == 1 else {})
    grid = current(write_grib(tmp_path / "lone.grb", days, edition, **keys))
    (note,) = [one for one in grid.notes if one.kind == "level-assumed"]
    assert note.is_decision
    assert note_texts([note])[0].startswith(f"the only level, {kind} = ")
