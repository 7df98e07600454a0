"""Nothing is guessed in silence: each file is right, or it is said, or refused with a remedy."""

from __future__ import annotations

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
from tests.pipeline.sources.cf.guessed_files import (
    CASES,
    DEPARTURE,
    growth,
    straightened,
    velocity,
)

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


@pytest.mark.parametrize("kind", CASES)
def test_a_file_is_right_or_said_or_refused(tmp_path: Path, kind: str) -> None:
    case = CASES[kind]
    path = written(case.make(), tmp_path / case.name)
    if not case.refused:
        grid = read(path)
        assert_right(grid, case.hours, case.share)
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
        # Of a turned grid the values are interpolated, at twentieths of a degree.
        within = 5e-3 if kind == "turned" else 1e-6
        assert_right(read(written(followed, tmp_path / "again.nc")), 15.0, 1.0, within)


# --- files as they were found -------------------------------------------------------------------

_HOURLY, _TRUTH = ("reference/hourly.nc", "uo"), ("rotated-remapped/truth.nc", "uo")
# Of each file: what is said, or why it is refused; and where, and at which step, the right current
# stands that is in it at noon of 15 March 2024 or, if it has one step, on that day.
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
    "rotated-remapped/rotated_grid.nc": ("'A turned grid'", _TRUTH, 0),
    "cfgrib-step/cfgrib.nc": ("swap_dims", _HOURLY, 2),
    "index-dims/indexdims.nc": ("swap_dims", _HOURLY, 2),
    "oscar-v2/oscar2.nc": ("convert_calendar('standard')", _HOURLY, 0),
    "hf-radar/hfr.nc": ("interpolate_na", _HOURLY, 2),
}
# What interpolation between nodes of a turned grid, and over gaps in time, may change, m/s.
WITHIN = {"rotated_grid.nc": 0.01, "hfr.nc": 0.01}


REFUSED = {"rotated_grid.nc", "cfgrib.nc", "indexdims.nc", "oscar2.nc", "hfr.nc"}


def remedied(path: Path) -> xr.Dataset:
    """Follow the remedies for a file that is refused."""
    with xr.open_dataset(path) as data:
        found = data.load()
    if path.name == "cfgrib.nc":
        return found.swap_dims(step="valid_time")
    if path.name == "indexdims.nc":
        return found.swap_dims(x="lon", y="lat")
    if path.name == "oscar2.nc":
        return found.convert_calendar("standard").swap_dims(longitude="lon", latitude="lat")
    if path.name == "hfr.nc":
        filled = found.interpolate_na("TIME")
        return filled.where(filled.notnull().all("TIME"))
    # This one has a current on land, but not in the corners that arise as it is turned.
    flat = straightened(found.rename(vozocrtx="uo", vomecrty="vo"))
    return flat.sel(lon=slice(119.1, 121.2), lat=slice(8.9, 11.1))


@pytest.mark.parametrize("name", PUBLISHED)
def test_files_as_they_were_found_are_right_or_said_or_refused(
    shared: Path, tmp_path: Path, name: str
) -> None:
    said, (source, variable), step = PUBLISHED[name]
    path = shared / "data" / "field" / name
    region = shapely.box(119.4, 9.4, 120.6, 10.6)
    noon: dict[str, object] = {"time_method": "changing", "departure": "2024-03-15T12:00:00Z"}
    about = noon | {"max_hours": 6} if step or "daily" in name else {"valid": "2024-03-15"}
    if path.name in REFUSED:
        with pytest.raises(RequestError, match=re.escape(said)):
            read(path, region, **about)
        path = written(remedied(path), tmp_path / path.name)
        said = ""
    grid = read(path, region, **about)
    told = [note for note in grid.notes if said in note_text(note)]
    assert any(note.is_decision for note in told) or not said
    with xr.open_dataset(shared / "data" / "field" / source) as data:
        true = data[variable].isel(time=step).interp(lon=grid.lon, lat=grid.lat)
    off = np.abs(grid.at_departure[0] - true.values)
    assert np.isfinite(off).mean() > 0.75, "Palawan is in it"
    assert np.nanmax(off) < WITHIN.get(path.name, 1e-6)


def test_files_of_other_kinds_are_refused_or_said(shared: Path) -> None:
    """Direction and speed, meshes and S-100 are not read yet."""
    data = shared / "data"
    for path, said in (
        (data / "field" / "wind-as-current" / "wind.nc", "10 metre U wind component"),
        (data / "field" / "grib" / "dir_speed_1.grb", "Direction of current"),
        (data / "meshes" / "pygnome_small_trigrid_example.nc", "no pair of current components"),
        *((file, "S-100") for file in (data / "s100").iterdir()),
    ):
        with pytest.raises(RequestError, match=said):
            CfFiles((str(path),)).contents()
    wa = CfFiles((str(data / "meshes" / "pygnome_wa_RTOFS_global.nc"),)).contents()
    assert any("by their names alone" in note_text(note) for note in wa.notes)
