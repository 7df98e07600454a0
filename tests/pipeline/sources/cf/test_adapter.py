"""The user's own files are read and checked, and used or refused by the command line."""

import hashlib
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.model import CurrentGrid, Land, Note
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.season import Season
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.current_field import Field, LandMask
from tests.pipeline.results import result_of
from tests.pipeline.small_region import small_region
from tests.pipeline.synthetic_currents import coastal, dataset, sea, write

NO_LAND = Land((), (), 0.0)
REGION = shapely.box(118.3, 9.3, 119.2, 10.4)
# Open water south of the middle of Palawan: small, so that planning is quick.
SCENARIO = (
    small_region("mine")
    + """[chart]
tolerance_m = 500
[[seasons]]
name = "summer"
title = "July 2024"
valid = "2024-07"
currents = ["field.nc"]
[planner]
classes = 2
"""
)
SHARED = {
    "cwb": "cwb_ocm_M-B0071-000_20200617T00.nc",
    "duacs": "duacs_nrt_global_allsat_phy_l4_20190223_20190226.nc",
    "glo": "cmems_mod_glo_phy-cur_anfc_0.083deg_P1D-m_2024-01_1deg_5day.nc",
    "oscar": "oscar_climatology_1992-2012_monthly_third_deg.nc",
}


@pytest.fixture(scope="module")
def palawan(world_mask: LandMask) -> Field:
    """Give a plausible sea around Palawan."""
    return coastal(
        sea(np.arange(108.0, 130.0, 0.25), np.arange(0.0, 20.0, 0.25), seed=2), world_mask
    )


def current(*paths: Path, valid: str = "2024-07", region: shapely.Polygon = REGION) -> CurrentGrid:
    """Read files as a season's current."""
    names = tuple(str(path) for path in paths)
    season = Season(name="summer", valid=valid, currents=(names,))
    source = CfFiles(names)
    assert source.uncovered_reason(region, season) == ""
    return source.current(region, season, NO_LAND, Path())


def run(folder: Path, text: str = SCENARIO, *extra: str) -> tuple[int, list[str], str]:
    """Run `renew run` on a scenario's text; return its exit code, error lines and notes."""
    path = folder / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    arguments = ["run", str(path), "--output", str(folder / "outputs"), *extra]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    lines = result.stderr.splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    return result.exit_code, errors, "\n".join(line for line in lines if ": note: " in line)


# --- what the planner is given ------------------------------------------------------------------


def test_the_grid_is_the_region_with_a_margin(tmp_path: Path, palawan: Field) -> None:
    data = dataset(palawan)
    data.attrs = {
        "title": "Somebody's\nmodel",
        "institution": "An institute",
        "source": "NEMO 4.2",
        "references": "https://example.org/model; https://doi.org/10.1234/abc.def.",
        "license": "CC BY 4.0",
    }
    grid = current(write(tmp_path / "field.nc", data))
    assert grid.lon.tolist() == np.arange(117.75, 119.9, 0.25).tolist()
    assert grid.lat.tolist() == np.arange(8.75, 11.1, 0.25).tolist()
    x, y = np.searchsorted(palawan.lon, grid.lon), np.searchsorted(palawan.lat, grid.lat)
    assert np.array_equal(grid.u[0], palawan.u[np.ix_(y, x)], equal_nan=True)
    assert np.array_equal(grid.v[0], palawan.v[np.ix_(y, x)], equal_nan=True)
    assert np.isnan(grid.u).any(), "Palawan is in it"
    assert grid.valid == "2024-07-01"
    asked = ("2024-07-01", "2024-08-01")
    sparse = Note.of("steps-sparse", count=1, steps=("2024-07-01",), asked=asked)
    assert grid.notes == (sparse,)
    credit = grid.credit
    assert credit.name == "Somebody's model"
    assert credit.text == "Somebody's model; An institute; NEMO 4.2"
    assert credit.licence == "CC BY 4.0"
    assert credit.url == "https://doi.org/10.1234/abc.def"


# Most are 10 m/s and less: no limit of speed finds them.
@pytest.mark.parametrize(
    ("filler", "names"),
    [(0.0, ""), (9999.0, ""), (-3.2768, ""), (-1.0, ""), (-3.2768, "uv"), (-3.2768, "u")],
)
def test_one_value_is_gaps(tmp_path: Path, palawan: Field, filler: float, names: str) -> None:
    """All land has it, or the whole west of the water, where these components have it."""
    u, v = palawan.u.copy(), palawan.v.copy()
    for part in (u, v)[: len(names) or 2]:
        where = part[:, : palawan.lon.size // 12] if names else part
        where[np.isfinite(where) == bool(names)] = filler
    data = dataset(Field(palawan.lon, palawan.lat, u, v))
    data.attrs = {}
    grid = current(write(tmp_path / "filled.nc", data))
    x, y = np.searchsorted(palawan.lon, grid.lon), np.searchsorted(palawan.lat, grid.lat)
    assert np.array_equal(grid.u[0], palawan.u[np.ix_(y, x)], equal_nan=True)
    assert ("fill-value" if filler else "filler-is-land") in {one.kind for one in grid.notes}
    assert grid.credit.name == "filled.nc, user's file"


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_the_identity_follows_the_content(tmp_path: Path, palawan: Field, suffix: str) -> None:
    path = write(tmp_path / f"field{suffix}", dataset(palawan))
    season = Season(name="summer", valid="2024-07", currents=((str(path),),))

    def identity(file: Path = path, of: Season = season) -> tuple[str, ...]:
        return CfFiles((str(file),)).identity(of)

    known = identity()
    assert identity() == known
    copy = tmp_path / f"copy{suffix}"
    (shutil.copytree if path.is_dir() else shutil.copy2)(path, copy)
    assert identity(copy) == known, "name and folder do not matter"
    assert identity(of=season.model_copy(update={"valid": "2024-07-01"})) != known
    part = max(
        (file for file in ([path] if path.is_file() else path.rglob("*")) if file.is_file()),
        key=lambda file: file.stat().st_size,
    )
    whole = bytearray(part.read_bytes())
    whole[-20] ^= 1
    stamp = part.stat().st_mtime_ns + 1_000_000
    part.write_bytes(whole)
    os.utime(part, ns=(stamp, stamp))
    assert identity() != known
    assert CfFiles((str(tmp_path / "absent.nc"),)).identity(season)[0] == "nothing"


def test_a_new_file_does_not_change_the_identity_of_earlier_days(
    tmp_path: Path, palawan: Field
) -> None:
    days = [f"2024-07-0{day}" for day in range(1, 5)]
    for day in days[:2]:
        write(tmp_path / f"{day}.nc", dataset(palawan, times=[day]))
    names = (str(tmp_path / "*.nc"),)
    seasons = [Season(name="s", valid=valid, currents=(names,)) for valid in (days[0], "2024-07")]
    before = [CfFiles(names).identity(season) for season in seasons]
    write(tmp_path / f"{days[2]}.nc", dataset(palawan, times=[days[2]]))
    after = [CfFiles(names).identity(season) for season in seasons]
    assert after[0] == before[0]
    assert after[1] != before[1]


# --- the four real files ------------------------------------------------------------------------


@pytest.mark.gate_share(4)
@pytest.mark.parametrize(
    ("name", "valid", "used", "notes", "share"),
    [
        ("cwb", "2020-06-17", "2020-06-17", 0, "9%"),
        ("cwb", "2020-06-17T05:00Z", "2020-06-17", 0, "9%"),
        ("cwb", "2020-06", "2020-06-17", 1, "9%"),
        ("duacs", "2019-02-23", "2019-02-23", 1, "2%"),
        ("glo", "2024-01", "2024-01-03/2024-01-28", 0, ""),
        ("glo", "2024-01-09T00:00Z", "2024-01-08", 1, ""),
        ("oscar", "2024-07", "July of a climatology", 1, "5%"),
    ],
)
def test_real_files_are_accepted_for_palawan(
    shared: Path, name: str, valid: str, used: str, notes: int, share: str
) -> None:
    path = shared / "data" / "currents" / SHARED[name]
    region = load_scenario("palawan-season").area
    grid = current(path, valid=valid, region=region)
    assert grid.valid == used
    on_gaps = [note for note in note_texts(grid.notes) if "has no data for" in note]
    assert len(grid.notes) - len(on_gaps) == notes, grid.notes
    assert len(on_gaps) == bool(share), grid.notes
    assert all(f"for {share} of the region's water" in note for note in on_gaps)
    assert np.isfinite(grid.u).mean() > 0.6
    assert grid.files[0][0] == path.name
    assert len(grid.files[0][1]) == 64


# --- the command line ---------------------------------------------------------------------------


def test_a_flipped_file_is_refused_and_nothing_is_written(
    tmp_path: Path, palawan: Field, across_outputs: Path
) -> None:
    shutil.copytree(across_outputs, tmp_path / "outputs")
    write(tmp_path / "field.nc", dataset(Field(palawan.lon, palawan.lat, -palawan.u, palawan.v)))
    code, errors, _ = run(tmp_path)
    assert code == 2
    assert "field.nc is refused: one component has the wrong sign" in errors[0]
    assert not (tmp_path / "outputs" / "mine").exists()
    stored = [
        set((of / ".artefacts" / "current").iterdir())
        for of in (tmp_path / "outputs", across_outputs)
    ]
    assert {file.name for file in stored[0]} == {file.name for file in stored[1]}


def test_currents_need_a_region() -> None:
    result = CliRunner().invoke(app, ["run", "single-gyre", "--currents", "x.nc"])
    assert result.exit_code == 2
    assert "--currents needs a scenario with a [region]" in result.stderr


def test_paths_start_at_the_scenarios_folder_and_names_are_of_the_catalogue(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    write(
        tmp_path / "folder" / "field.nc",
        dataset(sea(np.arange(118, 120, 0.25), np.arange(9, 11, 0.25))),
    )
    path = tmp_path / "folder" / "scenario.toml"
    own, fallback = '["field.nc"]', '[["field.nc"], "embedded-palawan"]'
    for text in (SCENARIO, SCENARIO.replace(own, fallback)):
        path.write_text(text)
        (season,) = load_scenario(str(path)).seasons
        assert season.currents[0] == (str(tmp_path / "folder" / "field.nc"),)
    assert season.currents[1] == "embedded-palawan"
    path.write_text(SCENARIO.replace("field.nc", "embeded-palawan"))
    with pytest.raises(RequestError, match=r"did you mean 'embedded-palawan'\?.*'\./field\.nc'"):
        load_scenario(str(path))
    path.write_text(SCENARIO.replace(own, "[[]]"))
    with pytest.raises(RequestError, match=r"seasons\[0\]\.currents\[0\]"):
        load_scenario(str(path))


@pytest.mark.usefixtures("plain_report")
def test_a_run_on_a_file_gives_its_credit(
    tmp_path: Path, palawan: Field, across_outputs: Path
) -> None:
    shutil.copytree(across_outputs, tmp_path / "outputs")
    path = write(tmp_path / "field.nc", dataset(palawan, names=("ugos", "vgos"), standard=("", "")))
    code, errors, notes = run(tmp_path, SCENARIO, "--verbose")
    assert (code, errors) == (0, [])
    assert "note: the currents are geostrophic" in notes
    manifest = json.loads((tmp_path / "outputs" / "mine" / "manifest.json").read_text())
    (source,) = manifest["current_sources"]
    assert (source["name"], source["valid"]) == ("A sea made up for a test", "2024-07-01")
    (hashed,) = manifest["inputs"]["currents"]["summer"]["files"].values()
    assert hashed == hashlib.sha256(path.read_bytes()).hexdigest()
    assert any("geostrophic" in note for note in manifest["notes"])
    asked = load_scenario(str(tmp_path / "scenario.toml"))
    plans = set((tmp_path / "outputs" / ".artefacts" / "plan").iterdir())
    result_of(asked, tmp_path / "outputs")
    assert set((tmp_path / "outputs" / ".artefacts" / "plan").iterdir()) == plans
    write(path, dataset(Field(palawan.lon, palawan.lat, 0.9 * palawan.u, 0.9 * palawan.v)))
    result_of(asked, tmp_path / "outputs")
    assert set((tmp_path / "outputs" / ".artefacts" / "plan").iterdir()) > plans
