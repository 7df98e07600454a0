"""Constants fitted to a synthetic year of streams, and the series that are refused."""

from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.errors import RequestError
from pipeline.sources.cf.axes import coordinate_names
from pipeline.sources.cf.harmonic_fit import fit_files, separable
from renew.inputs.tide import arguments
from tests.conftest import ROOT
from tests.tide_oracles import NOISE, STREAM, fit_errors, series, utide_sum

HOUR = timedelta(hours=1)


def written(dataset: xr.Dataset, folder: Path, name: str = "hourly.nc") -> Path:
    path = folder / name
    dataset.to_netcdf(path, engine="netcdf4")
    return path


@pytest.fixture(scope="module")
def year(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, xr.Dataset]:
    """Return the file of a year, and its fit."""
    path = written(series(365), tmp_path_factory.mktemp("year"))
    return path, fit_files([str(path)])


def test_a_year_gives_the_constants_to_a_percent_and_a_degree(
    year: tuple[Path, xr.Dataset],
) -> None:
    _, found = year
    amplitude, phase, _ = fit_errors(found)
    assert amplitude <= 0.01
    assert phase <= 1
    assert found["u_mean"].values[0, 0] == pytest.approx(0.3, abs=0.01)
    np.testing.assert_allclose(found["residual_rms"].values[0], NOISE * 2**0.5, rtol=0.02)
    assert (found["variance_share"].values[0] > 0.9).all()
    assert np.isnan(found["residual_rms"].values[1, 2])
    assert np.isnan(found["u_re"].values[:, 1, 2]).all()


def test_the_month_after_is_predicted_to_a_tenth_of_the_noise(
    year: tuple[Path, xr.Dataset],
) -> None:
    assert fit_errors(year[1])[2] <= NOISE / 10


def test_the_fit_is_utide_s_with_the_same_constituents(tmp_path: Path) -> None:
    import utide

    short = series(60)
    found = fit_files([str(written(short, tmp_path))])
    names = found["constituent"].values.tolist()
    theirs = utide.solve(
        np.datetime64("2025-01-01") + (3600 * short["time"].values).astype("m8[s]"),
        short["u"].values[:, 0, 1], lat=50.0, constit=["M2", "S2", "N2", "K1", "O1", "M4"],
        nodal=True, trend=False, method="ols", conf_int="none", verbose=False,
    )  # fmt: skip
    assert set(STREAM) <= set(names)
    fitted = (found["u_re"] + 1j * found["u_im"]).values[:, 0, 1]
    for name, amplitude in zip(theirs.name, theirs.A, strict=True):
        assert abs(fitted[names.index(name)]) == pytest.approx(amplitude, abs=0.02)


def test_a_series_separates_constituents_by_rayleighs_criterion() -> None:
    month, year = separable(29, HOUR), separable(366, HOUR)
    assert {"M2", "S2", "N2", "K1", "O1", "Q1", "M4"} <= set(month)
    assert not {"K2", "P1", "NU2", "T2", "SSA", "SA"} & set(month)
    assert {"K2", "P1", "T2", "SSA", "SA", "S1"} <= set(year)
    assert separable(400, 24 * HOUR)[:2] == ("MF", "MM")


def test_means_of_an_hour_are_recognised_by_their_bounds_and_corrected(tmp_path: Path) -> None:
    minutes = np.arange(0, 60 * 24 * 40, 10) / 60 + 5 / 60
    means = utide_sum(minutes).reshape(-1, 6).mean(axis=1)
    hours = np.arange(len(means)) + 0.5
    field = np.repeat(means[:, None], 4, axis=1).reshape(-1, 2, 2)
    axes = {"time": ("time", hours, {"units": "hours since 2025-01-01", "bounds": "edges"}),
            "lat": [50.0, 50.1], "lon": [-2.0, -1.9]}  # fmt: skip
    data = {name: (("time", "lat", "lon"), field, {"units": "m s-1"}) for name in ("u", "v")}
    edges = ("time", "nv"), np.stack([hours - 0.5, hours + 0.5], axis=1)
    found = fit_files([str(written(xr.Dataset(data | {"edges": edges}, axes), tmp_path))])
    m4 = found.sel(constituent="M4").isel(lat=0, lon=0)
    # The mean of an hour has 0.957 of M4.
    assert np.hypot(m4["u_re"], m4["u_im"]) == pytest.approx(0.2, rel=0.01)


@pytest.mark.parametrize(
    ("change", "beginnings"),
    [
        (
            lambda one: one.isel(time=slice(28 * 24)),
            ["it has 28.0 days, fewer than 29; they separate"],
        ),
        (lambda one: one.isel(time=slice(None, None, 24)), ["its steps are 24 hours apart, which"]),
        (
            lambda one: one.drop_isel(time=[100, 101, 500]),
            ["it has 2 holes, the longest from 2025-01-05T03:00Z to 2025-01-05T06:00Z; fill"],
        ),
        (
            lambda one: one.isel(time=slice(None, 20 * 24, 24)),
            ["its steps are 24 hours apart, which separate ", "it has 20.0 days, fewer than 29"],
        ),
        (lambda one: one.isel(time=slice(1)), ["it has one time step, 2025-01-01; give 29 days"]),
    ],
)
def test_a_series_that_can_t_be_fitted_says_why(
    change: Callable[[xr.Dataset], xr.Dataset], beginnings: list[str], tmp_path: Path
) -> None:
    path = written(change(series(35)), tmp_path)
    with pytest.raises(RequestError) as caught:
        fit_files([str(path)])
    assert len(caught.value.faults) == len(beginnings)
    for line, beginning in zip(caught.value.faults, beginnings, strict=True):
        assert line.startswith(f"hourly.nc: {beginning}")


def test_the_command_writes_the_constants_and_says_how_well_they_fit(tmp_path: Path) -> None:
    dataset = series(40)
    first = written(dataset.isel(time=slice(500)), tmp_path, "a.nc")
    second = written(dataset.isel(time=slice(500, None)), tmp_path, "b.nc")
    out = tmp_path / "constants.nc"
    done = CliRunner().invoke(app, ["tide", "fit", str(second), str(first), "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "constituents at 5 nodes: M2, K1, S2, O1, N2" in done.stdout
    assert (
        "0 nodes have less than 70% of the variance, and 1 have an incomplete series."
        in done.stdout
    )
    with netCDF4.Dataset(out) as file:
        assert file["constituent"].dtype == "S1"
    with xr.open_dataset(out) as found:
        assert found["constituent"].values[0] == "M2"
        assert coordinate_names(found, "constituent")[:2] == ("M2", "K1")
        assert found["u_re"].dims == ("constituent", "lat", "lon")
        whole = fit_files([str(written(dataset, tmp_path))])
        np.testing.assert_allclose(found["v_im"], whole["v_im"], atol=1e-10)
    refused = CliRunner().invoke(app, ["tide", "fit", str(first), "--out", str(out / "x")])
    assert refused.exit_code == 2
    assert "--out: " in refused.stderr


# --- The how-to page's lines that take constants out of an atlas by pyTMD ---


LON, LAT = np.arange(355.0, 360.0, 0.5), np.arange(48.0, 51.0, 0.5)


def atlas_written(folder: Path) -> dict[str, np.ndarray[Any, Any]]:
    """Write an atlas in the form of FES2014, cm/s and degrees; return the constants by name."""
    from pyTMD.io import load_database

    found: dict[str, np.ndarray[Any, Any]] = {}
    x, y = np.meshgrid(LON, LAT)
    for part in "uv":
        for file in load_database()["FES2014"][part]["model_file"]:
            path = folder / file
            amplitude = (1 + len(found) / 10) * (1 + 0.2 * np.sin(x + 3 * y))
            # Never 0, which pyTMD takes for land.
            lag = (20 * x + 10 * y + 50 * len(found) + 7) % 360
            axes, letter = ("lat", "lon"), part.upper()
            path.parent.mkdir(parents=True, exist_ok=True)
            xr.Dataset(
                {f"{letter}a": (axes, 100 * amplitude, {"units": "cm/s"}),
                 f"{letter}g": (axes, lag, {"units": "degrees"})},
                {"lat": LAT, "lon": LON},
            ).to_netcdf(path, engine="netcdf4")  # fmt: skip
            found[f"{part} {path.stem}"] = amplitude * np.exp(-1j * np.radians(lag))
    return found


@pytest.mark.filterwarnings("ignore:You will likely lose important projection:UserWarning")
def test_constants_of_an_atlas_are_amplitude_and_lag_in_metres(tmp_path: Path) -> None:
    atlas = atlas_written(tmp_path)
    page = (ROOT / "docs" / "how-to" / "tides.md").read_text(encoding="utf-8")
    blocks = [block.partition("```")[0] for block in page.split("```python\n")[1:]]
    (recipe,) = (block for block in blocks if "def constants_of_atlas" in block)
    namespace: dict[str, Any] = {}
    exec(recipe, namespace)  # noqa: S102 - the page's own lines are tested
    lon, lat = LON[1:-2] - 360, LAT[1:-2]
    taken = namespace["constants_of_atlas"](tmp_path, "FES2014", lon, lat)
    for part in "uv":
        values = taken[f"{part}_re"] + 1j * taken[f"{part}_im"]
        for name in ("m2", "s2", "k1", "m4"):
            wanted = atlas[f"{part} {name}"][1:-2, 1:-2]
            np.testing.assert_allclose(
                values.sel(constituent=name.encode()).values, wanted, atol=1e-6
            )
    names = coordinate_names(taken, "constituent")
    assert len(names) == len(atlas) / 2
    factors, _ = arguments(names, np.array(["2026-09-10"], "datetime64[us]"))
    assert np.isfinite(factors).all()
