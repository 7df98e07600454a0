"""The how-to page's lines that take constants out of an atlas by pyTMD."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from pyTMD.io import load_database

from pipeline.sources.cf.axes import coordinate_names
from renew.inputs.tide import arguments
from tests.conftest import ROOT

LON, LAT = np.arange(355.0, 360.0, 0.5), np.arange(48.0, 51.0, 0.5)


def atlas_written(folder: Path) -> dict[str, np.ndarray[Any, Any]]:
    """Write an atlas in the form of FES2014, cm/s and degrees; return the constants by name."""
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
