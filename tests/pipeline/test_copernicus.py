"""Copernicus: what can be shown without its service. No part of the client is replaced."""

from __future__ import annotations

import base64
import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import netCDF4
import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from pipeline import catalogue
from pipeline.artefact import Store
from pipeline.catalogue import CopernicusSpec
from pipeline.cli import app
from pipeline.errors import StageError
from pipeline.fetch import fetch
from pipeline.model import Credit, Land
from pipeline.reading import load_scenario
from pipeline.sources.acceptance import Expected, Field, accept
from pipeline.sources.child import run_with_deadline
from pipeline.sources.copernicus import PASSWORD, USERNAME, Copernicus, without_secrets
from tests.pipeline.conftest import ACROSS_BOX

if TYPE_CHECKING:
    from collections.abc import Callable

REGION = shapely.box(117, 8, 120, 11)
ISLAND = shapely.box(118, 9, 119.5, 10.5)
LAND = Land((ISLAND,), Credit("an island", "land", "", ""), 0.0)
STEP = 1 / 12
EXPECTED = Expected(
    month="2024-07",
    region=REGION.bounds,
    cell_deg=STEP,
    eastward="uo",
    northward="vo",
    speed_limit_m_s=3.0,
)


@pytest.fixture(autouse=True)
def _no_account(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No credentials in the environment, and none in the client's own file."""
    for name in list(os.environ):
        if name.startswith("COPERNICUS"):
            monkeypatch.delenv(name)
    monkeypatch.setenv("COPERNICUSMARINE_CREDENTIALS_DIRECTORY", str(tmp_path / "home"))


def glorys() -> Copernicus:
    """Return the source of the catalogue."""
    spec = catalogue.source("copernicus-glorys-monthly")
    assert isinstance(spec, CopernicusSpec)
    return Copernicus(spec)


# --- without an account -------------------------------------------------------------------------


def test_without_credentials_it_is_unavailable_and_says_what_to_set() -> None:
    reason = glorys().unavailable()
    assert USERNAME in reason
    assert PASSWORD in reason


def test_credentials_of_either_kind_make_it_available(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(USERNAME, "someone")
    assert glorys().unavailable()
    monkeypatch.setenv(PASSWORD, "something")
    assert not glorys().unavailable()
    monkeypatch.delenv(USERNAME)
    file = tmp_path / "home" / ".copernicusmarine" / ".copernicusmarine-credentials"
    file.parent.mkdir(parents=True)
    file.write_text("")
    assert not glorys().unavailable()


def test_without_credentials_the_embedded_table_steps_in_and_says_so(across_outputs: Path) -> None:
    small = load_scenario("palawan-season").model_dump(mode="json")
    small["region"]["bbox"] = ACROSS_BOX
    scenario = load_scenario("palawan-season").model_validate(small)
    parts = fetch(scenario, Store(across_outputs / ".artefacts"))
    assert [grid.credit.name for grid in parts.fetched.currents] == [
        catalogue.source("embedded-palawan").title
    ] * 2
    assert not parts.failures
    asked, summer, winter = parts.fetched.notes
    assert asked.startswith("summer, winter: ")
    assert USERNAME in asked
    assert summer.startswith("summer: planned on Embedded table")
    assert winter.startswith("winter: planned on Embedded table")


def test_with_nothing_else_to_ask_the_request_is_refused(tmp_path: Path) -> None:
    text = catalogue.scenario_path("palawan-season").read_text()
    path = tmp_path / "only.toml"
    path.write_text(text.replace(', "embedded-palawan"', "").replace("palawan-season", "only"))
    output = tmp_path / "outputs"
    for extra, word in (([], USERNAME), (["--offline"], "leave --offline out")):
        result = CliRunner().invoke(app, ["run", str(path), "--output", str(output), *extra])
        assert result.exit_code == 2
        errors = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
        assert len(errors) == 2, "a line for each season"
        assert all(word in line for line in errors)
        assert not (output / "only").exists()


def test_the_request_is_strict_utc_pinned_and_one_month(tmp_path: Path) -> None:
    scenario = load_scenario("palawan-season")
    season = scenario.seasons[1]
    request = glorys().request(scenario.waters, season, tmp_path, "x.nc")
    assert request["start_datetime"] == "2024-12-01T00:00:00Z"
    assert request["end_datetime"] == "2024-12-31T23:59:59Z"
    assert request["coordinates_selection_method"] == "strict-inside"
    assert request["dataset_version"] == "202311"
    assert "skip_existing" not in request
    west, _, east, _ = scenario.waters.bounds
    assert request["minimum_longitude"] < west
    assert request["maximum_longitude"] > east
    json.dumps(request)


def test_the_clients_signature_takes_the_request(tmp_path: Path) -> None:
    scenario = load_scenario("palawan-season")
    request = glorys().request(scenario.waters, scenario.seasons[0], tmp_path, "x.nc")
    script = (
        "import inspect, json, sys, copernicusmarine\n"
        "inspect.signature(copernicusmarine.subset).bind(**json.load(sys.stdin))\n"
    )
    subprocess.run([sys.executable, "-c", script], input=json.dumps(request), text=True, check=True)


@pytest.mark.slow
def test_the_real_client_without_credentials_ends_as_a_reason_and_leaves_nothing(
    tmp_path: Path,
) -> None:
    # No proxy answers on port 9 (discard), and nothing else is reachable through it.
    source = Copernicus(glorys().spec.model_copy(update={"deadline_s": 60.0, "attempts": 1}))
    scenario = load_scenario("palawan-season")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("HTTP_PROXY", "HTTPS_PROXY", "http_proxy", "https_proxy"):
            patch.setenv(name, "http://127.0.0.1:9")
        begun = time.monotonic()
        with pytest.raises(StageError, match="copernicus-glorys-monthly: "):
            source.current(scenario.waters, scenario.seasons[0], LAND, tmp_path / "downloads")
    assert time.monotonic() - begun < 90
    assert list((tmp_path / "downloads").iterdir()) == []


# --- the child ----------------------------------------------------------------------------------


def test_a_child_that_hangs_is_killed_with_its_children_at_the_deadline(tmp_path: Path) -> None:
    pid_file = tmp_path / "pid"
    script = (
        "import subprocess, sys, time\n"
        f"child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        f"open({str(pid_file)!r}, 'w').write(str(child.pid))\n"
        "time.sleep(60)\n"
    )
    begun = time.monotonic()
    ended = run_with_deadline([sys.executable, "-c", script], "", 1.5)
    assert ended.code is None
    assert 1.4 < time.monotonic() - begun < 10
    grandchild = int(pid_file.read_text())
    for _ in range(50):
        status = Path(f"/proc/{grandchild}/stat")
        if not status.exists() or status.read_text().rsplit(")", 1)[1].split()[0] == "Z":
            return
        time.sleep(0.1)
    pytest.fail("the child's own child lives on")


def test_a_childs_input_exit_code_and_errors_come_through() -> None:
    script = "import sys; sys.stderr.write(sys.stdin.read() * 2); sys.exit(3)"
    ended = run_with_deadline([sys.executable, "-c", script], "ab", 30)
    assert (ended.code, ended.errors) == (3, "abab")


def test_credentials_are_blanked_out_of_what_the_client_says(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(USERNAME, "captain")
    monkeypatch.setenv(PASSWORD, "captain-nemo")
    file = tmp_path / "home" / ".copernicusmarine" / ".copernicusmarine-credentials"
    file.parent.mkdir(parents=True)
    stored = "[credentials]\nusername = ahab\npassword = moby=dick\n"
    file.write_bytes(base64.standard_b64encode(stored.encode()))
    said = without_secrets("login captain-nemo of captain or ahab with moby=dick failed")
    assert said == "login *** of *** or *** with *** failed"


# --- the acceptance check -----------------------------------------------------------------------


def field(step: float = STEP, region: tuple[float, ...] = REGION.bounds) -> Field:
    """Make a plausible field around the island: a smooth current, NaN on land."""
    west, south, east, north = region
    beyond = 2 * step
    lon = np.arange(west - beyond, east + beyond + step / 2, step)
    lat = np.arange(south - beyond, north + beyond + step / 2, step)
    x, y = np.meshgrid(lon, lat)
    u, v = 0.4 * np.sin(x) + 0.1, 0.3 * np.cos(y)
    on_land = shapely.contains_xy(ISLAND, x, y)
    u[on_land] = v[on_land] = np.nan
    return Field(lon, lat, u, v)


def write(
    path: Path,
    made: Field,
    *,
    time_value: float = 0.0,
    units: str = "m s-1",
    names: tuple[str, str] = ("uo", "vo"),
    depth: tuple[float, ...] = (0.494025,),
) -> Path:
    """Write a field as the service does: time, depth, latitude, longitude; packed values."""
    with netCDF4.Dataset(path, "w") as dataset:
        for name, size in (
            ("time", 1),
            ("depth", len(depth)),
            ("latitude", made.lat.size),
            ("longitude", made.lon.size),
        ):
            dataset.createDimension(name, size)
        dataset.createVariable("time", "f8", ("time",))[:] = [time_value]
        dataset["time"].units = "hours since 2024-07-01 00:00:00"
        dataset["time"].calendar = "gregorian"
        dataset.createVariable("depth", "f4", ("depth",))[:] = depth
        dataset.createVariable("latitude", "f4", ("latitude",))[:] = made.lat
        dataset.createVariable("longitude", "f4", ("longitude",))[:] = made.lon
        standard = ("eastward_sea_water_velocity", "northward_sea_water_velocity")
        for name, values, meaning in zip(names, (made.u, made.v), standard, strict=True):
            shape = ("time", "depth", "latitude", "longitude")
            variable = dataset.createVariable(name, "i2", shape, fill_value=-32767)
            variable.scale_factor, variable.add_offset = 6.1e-4, 0.0
            variable.units, variable.standard_name = units, meaning
            layer = np.ma.masked_array(np.nan_to_num(values), mask=np.isnan(values))
            variable[:] = np.ma.stack([np.ma.stack([layer] * len(depth))])
    return path


def test_a_sound_file_is_accepted_as_it_is(tmp_path: Path) -> None:
    made = field()
    read = accept(write(tmp_path / "sound.nc", made), EXPECTED, LAND)
    assert np.allclose(read.lon, made.lon, atol=1e-5)
    assert np.allclose(read.lat, made.lat, atol=1e-5)
    assert np.allclose(read.u, made.u, atol=4e-4, equal_nan=True)
    assert np.allclose(read.v, made.v, atol=4e-4, equal_nan=True)


def test_descending_latitudes_and_other_longitudes_are_the_same_field(tmp_path: Path) -> None:
    made = field()
    turned = Field(made.lon - 360, made.lat[::-1], made.u[::-1], made.v[::-1])
    read = accept(write(tmp_path / "turned.nc", turned), EXPECTED, LAND)
    straight = accept(write(tmp_path / "straight.nc", made), EXPECTED, LAND)
    assert np.allclose(read.lon, straight.lon, atol=1e-4)
    assert np.allclose(read.lat, straight.lat)
    assert np.array_equal(read.u, straight.u, equal_nan=True)


def _shifted(cells: int) -> Field:
    made = field()
    return replace(made, u=np.roll(made.u, cells, axis=1), v=np.roll(made.v, cells, axis=1))


def _without_a_chunk() -> Field:
    made = field()
    u, v = made.u.copy(), made.v.copy()
    u[:10, :20] = v[:10, :20] = np.nan
    return replace(made, u=u, v=v)


@pytest.mark.parametrize(
    ("make", "how", "said"),
    [
        (field, {"time_value": 24 * 40}, "months are ['2024-08']"),
        (field, {"units": "km h-1"}, "uo is in 'km h-1', not m/s"),
        (field, {"names": ("ugos", "vgos")}, "no variable 'uo'"),
        (field, {"names": ("vo", "uo")}, "not the eastward velocity"),
        (field, {"depth": (0.5, 1.5)}, "not the surface alone"),
        (field, {"depth": (92.3,)}, "not the surface alone"),
        (lambda: field(step=0.25), {}, "longitude steps by 0.25"),
        (lambda: field(region=(117, 8, 119, 11)), {}, "longitude ends at 119.1"),
        (lambda: field(region=(117, 9, 120, 11)), {}, "latitude ends at 8.8"),
        (lambda: replace(field(), u=field().u * 10), {}, "speeds reach"),
        (lambda: replace(field(), u=field().u * 0, v=field().v * 0), {}, "every speed is 0"),
        (lambda: replace(field(), u=field().u * np.nan), {}, "gaps where the other has none"),
        (lambda: _shifted(6), {}, "the field is shifted"),
        (_without_a_chunk, {}, "a part was not delivered"),
    ],
)
def test_every_defect_is_refused_with_its_reason(
    tmp_path: Path, make: Callable[[], Field], how: dict[str, Any], said: str
) -> None:
    path = write(tmp_path / "bad.nc", make(), **how)
    with pytest.raises(StageError) as caught:
        accept(path, EXPECTED, LAND)
    assert "bad.nc" in str(caught.value)
    assert said in str(caught.value)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_file_cut_short_or_no_netcdf_is_refused(tmp_path: Path, share: float) -> None:
    path = write(tmp_path / "cut.nc", field())
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(StageError, match=r"cut\.nc"):
        accept(path, EXPECTED, LAND)


def test_a_real_file_of_other_days_and_cells_is_refused(shared: Path) -> None:
    path = (
        shared
        / "data"
        / "currents"
        / "cmems_mod_glo_phy-cur_anfc_0.083deg_P1D-m_2024-01_1deg_5day.nc"
    )
    with pytest.raises(StageError, match=r"longitude steps by 0\.99999 to 1 degrees, not 0\.08"):
        accept(path, EXPECTED, LAND)
