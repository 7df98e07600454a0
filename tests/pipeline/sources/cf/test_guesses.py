"""Nothing is guessed in silence: each file is right, or it is said, or refused with a remedy."""

import re
from pathlib import Path

import numpy as np
import pytest
import shapely
import xarray as xr

from pipeline.errors import RequestError
from pipeline.findings.note_words import note_text
from pipeline.model import CurrentGrid, Land
from pipeline.scenario.season import Season
from pipeline.sources.cf.adapter import CfFiles
from tests.pipeline.sources.cf.guessed_files import CASES, DEPARTURE, growth, velocity

REGION = shapely.box(132.2, 16.8, 133.8, 18.2)
NO_LAND = Land((), (), 0.0)


def read(path: Path, region: shapely.Polygon = REGION, **about: object) -> CurrentGrid:
    """Read a file as the current of a voyage from `DEPARTURE` on; RequestError if it is refused."""
    changing = {"time_method": "changing", "departure": DEPARTURE, "max_hours": 6}
    season = Season.model_validate(
        {"name": "tide", "currents": [[str(path)]], **(about or changing)}
    )
    source = CfFiles((str(path),))
    if reason := source.uncovered_reason(region, season):
        raise RequestError(reason)
    return source.current(region, season, NO_LAND, Path())


def written(data: xr.Dataset, path: Path) -> Path:
    # In the classic format, which needs no process of its own to be opened.
    data.to_netcdf(path, engine="netcdf4", format="NETCDF3_64BIT")
    return path


def assert_right(grid: CurrentGrid, hours: float, share: float = 1.0, within: float = 1e-6) -> None:
    """Compare the current at departure with the formula's of an hour."""
    for own, true in zip(
        grid.at_departure, velocity(*np.meshgrid(grid.lon, grid.lat)), strict=True
    ):
        assert own.shape == true.shape
        assert np.abs(own - share * growth(hours) * true).max() < within


@pytest.mark.gate_share(40)
@pytest.mark.parametrize("kind", CASES)
def test_a_file_is_right_or_said_or_refused(tmp_path: Path, kind: str) -> None:
    case = CASES[kind]
    path = written(case.make(), tmp_path / case.name)
    if not case.refused:
        grid = read(path)
        assert_right(grid, case.hours, case.share, case.within)
        told = [note for note in grid.notes if case.said in note_text(note)]
        assert bool(told) == bool(case.said or grid.notes), grid.notes
        assert case.said or not told, told
        assert all(note.is_decision for note in told)
        return
    with pytest.raises(RequestError) as caught:
        read(path)
    assert case.refused in str(caught.value)
    if case.follow is not None:
        with xr.open_dataset(path, decode_cf=False) as data:
            followed = case.follow(data.load())
        assert_right(read(written(followed, tmp_path / "again.nc")), 15.0)


# --- files as they were found -------------------------------------------------------------------

_HOURLY, _TRUTH = ("reference/hourly.nc", "uo"), ("rotated-remapped/truth.nc", "uo")
# Of each file: what is said; and where, and at which step, the right current stands that is in it
# at noon of 15 March 2024 or, if it has one step, on that day.
PUBLISHED: dict[str, tuple[str, tuple[str, str], int]] = {
    "reference/hourly.nc": ("read as instants", _HOURLY, 2),
    "merged-uv/merged.nc": ("is utotal and vtotal", ("merged-uv/merged.nc", "utotal"), 2),
    "daily-midnight/daily_start.nc": ("read as means", ("daily-midnight/daily_noon.nc", "uo"), 1),
    "daily-midnight/daily_noon.nc": ("", ("daily-midnight/daily_noon.nc", "uo"), 1),
    "timezone/tz_minus6.nc": ("read as instants", _HOURLY, 1),
    "levels/level_number_up.nc": ("", _HOURLY, 0),
    "levels/s_rho.nc": ("", _HOURLY, 0),
    "spellings/m_sec.nc": ("by their names alone", _HOURLY, 2),
    "spellings/water_u.nc": ("by their names alone", _HOURLY, 2),
    "rotated-remapped/rotated_grid.nc": ("turned from the lines", _TRUTH, 0),
    "cfgrib-step/cfgrib.nc": ("read as instants", _HOURLY, 2),
    "index-dims/indexdims.nc": ("read as instants", _HOURLY, 2),
    "oscar-v2/oscar2.nc": ("though the file calls it julian", _HOURLY, 0),
    "hf-radar/hfr.nc": ("filled from the times before", _HOURLY, 2),
    "series/one_cell_gap.nc": ("read as instants", _HOURLY, 2),
    "grib/dir_speed_1.grb": ("the direction to which it moves", _HOURLY, 2),
}
# What interpolation between nodes of a turned grid, gaps that are filled from one step, and the
# rounding of a direction may change, m/s.
WITHIN = {"rotated_grid.nc": 0.01, "hfr.nc": 0.06, "dir_speed_1.grb": 1e-4}


@pytest.mark.parametrize("name", PUBLISHED)
def test_files_as_they_were_found_are_right_and_said(shared: Path, name: str) -> None:
    said, (source, variable), step = PUBLISHED[name]
    path = shared / "data" / "field" / name
    region = shapely.box(119.4, 9.4, 120.6, 10.6)
    noon: dict[str, object] = {"time_method": "changing", "departure": "2024-03-15T12:00:00Z"}
    about = noon | {"max_hours": 6} if step or "daily" in name else {"valid": "2024-03-15"}
    grid = read(path, region, **about)
    told = [note for note in grid.notes if said in note_text(note)]
    assert any(note.is_decision for note in told) or not said
    with xr.open_dataset(shared / "data" / "field" / source) as data:
        true = data[variable].isel(time=step).interp(lon=grid.lon, lat=grid.lat)
    off = np.abs(grid.at_departure[0] - true.values)
    assert np.isfinite(off).mean() > 0.75, "Palawan is in it"
    assert np.nanmax(off) < WITHIN.get(path.name, 1e-6)


def test_of_two_cycles_the_later_one_wins(shared: Path) -> None:
    series = shared / "data" / "field" / "series"
    paths = tuple(str(series / f"cycle_{day}.nc") for day in (15, 16))
    season = Season.model_validate(
        {"name": "both", "currents": [paths], "time_method": "changing", "max_hours": 30}
        | {"departure": "2024-03-15T12:00:00Z"}
    )
    grid = CfFiles(paths).current(shapely.box(119.4, 9.4, 120.6, 10.6), season, NO_LAND, Path())
    assert any(note.kind == "forecasts-overlap" for note in grid.notes)
    hours = 12 + grid.times_s / 3600
    for hour, values in zip(hours, grid.u, strict=True):
        with xr.open_dataset(paths[int(hour >= 24)], decode_times=False) as data:
            true = data.uo.sel(time=hour).interp(lon=grid.lon, lat=grid.lat).values
        assert np.nanmax(np.abs(values - true)) < 1e-6


def test_files_of_other_kinds_are_refused_or_said(shared: Path) -> None:
    data = shared / "data"
    for path, said in (
        (data / "field" / "wind-as-current" / "wind.nc", "10 metre U wind component"),
        (data / "field" / "archives" / "field.nc.gz", "`gunzip -k field.nc.gz` makes"),
        (data / "s100" / "104US004SC1BO_20251217T12Z.h5", "waterLevelHeight"),
        (data / "s100" / "noaa_s102_US004MI1CI.h5", "depth (sea_floor_depth_below_geoid)"),
    ):
        with pytest.raises(RequestError, match=re.escape(said)):
            CfFiles((str(path),)).contents()
    wa = CfFiles((str(data / "meshes" / "pygnome_wa_RTOFS_global.nc"),)).contents()
    assert any("by their names alone" in note_text(note) for note in wa.notes)
