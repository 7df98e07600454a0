"""Files of depths: both conventions read the same; other files are refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.sources import combined_charts
from pipeline.sources.combined_charts import DepthFile
from tests.pipeline.sources import depth_grids

Writer = Callable[[Path, FloatArray, FloatArray, FloatArray], Path]

LON, LAT = np.arange(-2.0, 2.01, 0.1), np.arange(49.0, 51.01, 0.1)
HEIGHT = np.rint(np.add.outer(30 * (LAT - 50), 40 * LON) - 20)
HEIGHT[3:5, 6:9] = np.nan


@pytest.mark.parametrize("writer", [depth_grids.gebco, depth_grids.emodnet])
@pytest.mark.parametrize("turns", [-1, 0, 1])
def test_both_conventions_give_heights_in_the_longitudes_asked_for(
    tmp_path: Path, writer: Writer, turns: int
) -> None:
    found = DepthFile.open(writer(tmp_path / "grid.nc", LON, LAT, HEIGHT))
    heights = found.heights((-1.05 + 360 * turns, 49.25, 1.05 + 360 * turns, 50.55))
    assert heights is not None
    x, y = slice(10, 31), slice(3, 16)
    assert_allclose(heights.lon, LON[x] + 360 * turns, atol=1e-9)
    assert_allclose(heights.lat, LAT[y], atol=1e-9)
    assert_allclose(heights.height_m, HEIGHT[y, x], atol=0.006)
    assert np.isnan(heights.height_m).sum() == np.isnan(HEIGHT[y, x]).sum()
    assert found.title == "A sea floor made up for a test"


@pytest.mark.parametrize(
    ("name", "attributes", "sign"),
    [
        ("elevation", {}, 1.0),
        ("depth", {}, -1.0),
        ("depth", {"positive": "up"}, 1.0),
        ("z", {"standard_name": "height_above_geoid"}, 1.0),
        ("bathy", {"standard_name": "sea_floor_depth_below_geoid"}, -1.0),
        ("bathy", {"standard_name": "sea_floor_depth_below_sea_surface"}, -1.0),
        (
            "elevation",
            {
                "standard_name": "height_above_reference_ellipsoid",
                "long_name": "Elevation relative to sea level",
            },
            1.0,
        ),
    ],
)
def test_a_variable_is_found_by_its_standard_name_or_its_own(
    tmp_path: Path, name: str, attributes: dict[str, str], sign: float
) -> None:
    file = tmp_path / "grid.nc"
    depth_grids.dataset(LON, LAT, HEIGHT, name, units="m", **attributes).to_netcdf(file)
    heights = DepthFile.open(file).heights((-1.05, 49.25, 1.05, 50.55))
    assert heights is not None
    assert_allclose(heights.height_m, sign * HEIGHT[3:16, 10:31])


@pytest.mark.parametrize(
    ("name", "attributes", "parts"),
    [
        ("salinity", {"units": "1e-3"}, ["no depths among salinity (no standard name)", "GEBCO"]),
        ("elevation", {}, ["elevation has no unit", "set its attribute 'units'"]),
        ("elevation", {"units": "feet"}, ["elevation is in 'feet', not in m", "convert it"]),
        (
            "elevation",
            {"units": "m", "standard_name": "height_above_reference_ellipsoid"},
            ["no depths among elevation (height_above_reference_ellipsoid)"],
        ),
    ],
)
def test_what_has_no_depths_is_refused_with_what_was_found(
    tmp_path: Path, name: str, attributes: dict[str, str], parts: list[str]
) -> None:
    file = tmp_path / "other.nc"
    depth_grids.dataset(LON, LAT, HEIGHT, name, **attributes).to_netcdf(file)
    with pytest.raises(RequestError) as caught:
        DepthFile.open(file)
    (fault,) = caught.value.faults
    assert fault.startswith("chart.depths: other.nc: ")
    assert all(part in fault for part in parts), fault


def test_several_grids_are_refused_unless_one_has_the_usual_name(tmp_path: Path) -> None:
    both = depth_grids.dataset(LON, LAT, HEIGHT, "a", units="m", standard_name="height_above_geoid")
    both["b"] = both["a"]
    both.to_netcdf(tmp_path / "two.nc")
    with pytest.raises(RequestError, match=r"several grids of depths \(a .*, b .*\); keep one"):
        DepthFile.open(tmp_path / "two.nc")
    both.rename(b="elevation").to_netcdf(tmp_path / "named.nc")
    assert DepthFile.open(tmp_path / "named.nc").variable == "elevation"


def test_a_curvilinear_grid_text_and_damage_are_refused(tmp_path: Path) -> None:
    plain = depth_grids.dataset(LON, LAT, HEIGHT, "elevation", units="m")
    bent = plain.rename(lon="x", lat="y").drop_vars(["x", "y"])
    bent["longitude"] = (("y", "x"), np.broadcast_to(LON, HEIGHT.shape))
    bent.to_netcdf(tmp_path / "bent.nc")
    (tmp_path / "text.nc").write_text("no NetCDF at all")
    plain.to_netcdf(tmp_path / "cut.nc", format="NETCDF3_CLASSIC")
    whole = (tmp_path / "cut.nc").read_bytes()
    (tmp_path / "cut.nc").write_bytes(whole[: len(whole) // 2])
    for name, reason in (
        ("bent.nc", "grid is curvilinear"),
        ("text.nc", "neither NetCDF, Zarr nor GRIB"),
        ("cut.nc", "bytes before its last value"),
        ("absent.nc", "does not exist"),
    ):
        with pytest.raises(RequestError, match=reason) as caught:
            DepthFile.open(tmp_path / name)
        assert len(caught.value.faults) == 1


def test_too_many_cells_are_refused_and_a_region_without_cells_gives_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = DepthFile.open(depth_grids.gebco(tmp_path / "grid.nc", LON, LAT, HEIGHT))
    assert found.heights((10.0, 49.0, 11.0, 50.0)) is None
    monkeypatch.setattr(combined_charts, "_MAX_CELLS", 100)
    with pytest.raises(RequestError, match=r"21 x 41 cells in the region, more than 100; shrink"):
        found.heights((-3.0, 48.0, 3.0, 52.0))
