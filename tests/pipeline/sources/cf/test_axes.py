"""Axes of the user's files: those that make no grid along longitude and latitude are refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from pipeline.sources.cf.axes import is_same_axis
from tests.pipeline.sources.cf.sample_files import LAT, LON, SEA, at_levels, refusal
from tests.pipeline.synthetic_currents import dataset


def _curvilinear() -> xr.Dataset:
    x, y = np.meshgrid(LON, LAT)
    axes = ("time", "y", "x")
    return xr.Dataset(
        {"uo": (axes, SEA.u[None], {"units": "m/s"}), "vo": (axes, SEA.v[None], {"units": "m/s"})},
        {"nav_lon": (("y", "x"), x + 0.1 * y), "nav_lat": (("y", "x"), y), "time": [0]},
    )


def _with_old_bounds() -> xr.Dataset:
    data = dataset(SEA)
    data["lon_bnds"] = (("longitude", "nv"), np.stack([LON - 0.75, LON - 0.25], axis=1))
    data.longitude.attrs["bounds"] = "lon_bnds"
    return data


BAD: dict[str, tuple[Callable[[], xr.Dataset], list[str]]] = {
    "curvilinear": (
        _curvilinear,
        ["curvilinear (nav_lon is along y, x)", "turn components", "'A turned grid'"],
    ),
    "too deep": (
        lambda: at_levels([92.3, 109.7], "m", "down"),
        ["uppermost level (depth) is 92.3 m deep", "surface"],
    ),
    "unsorted": (
        lambda: dataset(SEA).isel(latitude=[3, 1, 2, 0]),
        ["latitude neither ascends nor descends"],
    ),
    "a coordinate that is no number": (
        lambda: dataset(SEA).assign_coords(
            latitude=("latitude", np.where(LAT == 0, np.nan, LAT), {"units": "degrees_north"})
        ),
        ["latitude is no axis of a grid"],
    ),
    "coordinates outside their bounds": (
        _with_old_bounds,
        ["longitude lies outside its own bounds"],
    ),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_axes_are_refused_with_what_was_found_and_what_is_needed(
    tmp_path: Path, kind: str
) -> None:
    make, parts = BAD[kind]
    message = refusal(tmp_path, make)
    for part in ("bad.nc", *parts):
        assert part in message


def test_axes_are_the_same_but_for_rounding() -> None:
    assert is_same_axis(LON.astype("f4").astype(float) + 1e-5, LON)
    assert not is_same_axis(LON + 0.01, LON)
    assert not is_same_axis(LON[:-1], LON)
