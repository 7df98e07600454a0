"""A chart with a grid of depths: what becomes no-go, what is noted, and what is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import shapely
import xarray as xr

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_text
from pipeline.model import Credit, Land
from pipeline.model.depths import DepthRule
from pipeline.scenario.region import ChartSpec
from pipeline.sources.combined_charts import DepthFile, SoundedChart
from pipeline.sources.registry import land_source
from tests.pipeline.sources import depth_grids

REGION = shapely.box(-1.0, 49.5, 1.0, 50.5)
ISLAND = shapely.box(-0.2, 49.9, 0.2, 50.1)
STEP = 0.02
LON, LAT = np.arange(-1.5, 1.51, STEP), np.arange(49.0, 51.01, STEP)


@dataclass(frozen=True)
class Island:
    """One island, whatever the region."""

    identity: tuple[str, ...] = ("island",)

    def land(self, region: shapely.Polygon) -> Land:
        """Return the island."""
        del region
        return Land((ISLAND,), (Credit("an island", "land", "", ""),), 60.0)


def sea_floor() -> FloatArray:
    """Give 40 m of depth, the island 20 m high, and a shoal of 3 m in the south-east."""
    x, y = np.meshgrid(LON, LAT)
    height = np.full(x.shape, -40.0)
    height[(abs(x) <= 0.2) & (abs(y - 50) <= 0.1)] = 20.0
    height[(abs(x - 0.6) <= 0.05) & (abs(y - 49.7) <= 0.05)] = -3.0
    return height


def sounded(file: Path, safety_depth_m: float = 5.0) -> SoundedChart:
    return SoundedChart(Island(), DepthFile.open(file), DepthRule(safety_depth_m))


def test_shallow_water_joins_the_land_and_is_shown(tmp_path: Path) -> None:
    land = sounded(depth_grids.emodnet(tmp_path / "grid.nc", LON, LAT, sea_floor())).land(REGION)
    no_go = shapely.union_all(land.polygons)
    assert no_go.contains(shapely.Point(0.6, 49.7))
    assert no_go.contains(ISLAND)
    assert no_go.area < ISLAND.buffer(2 * STEP).area + (0.1 + 4 * STEP) ** 2
    (zone,) = land.zones
    assert zone.kind == "shoal"
    assert zone.area.contains(shapely.Point(0.6, 49.7))
    assert shapely.intersection(zone.area, ISLAND).area == pytest.approx(0, abs=1e-12)
    assert [credit.name for credit in land.credits] == [
        "an island",
        "A sea floor made up for a test",
    ]
    assert "less than 5 m deep" in note_text(land.notes[0])
    assert "one cell of 2" in note_text(land.notes[0])  # 0.02 degrees: 2.2 km
    assert len(land.notes) == 1
    assert land.depths is not None
    assert land.depths.at(np.array([[0.6, 49.7], [0.0, 50.0], [5.0, 50.0]])).tolist() == [
        True,
        True,
        False,
    ]


def test_an_incomplete_grid_is_noted_and_its_gaps_stay_water(tmp_path: Path) -> None:
    floor = sea_floor()
    floor[:, LON < -0.5] = np.nan
    south = LAT < 50.3
    land = sounded(depth_grids.gebco(tmp_path / "grid.nc", LON, LAT[south], floor[south])).land(
        REGION
    )
    x, y = 1 - 0.5 / 2, 0.8 / 1.0  # of the region's width and height
    assert f"has no depths for {1 - x * y:.0%}"[:-2] in note_text(land.notes[1])
    no_go = shapely.union_all(land.polygons)
    assert not no_go.intersects(shapely.box(-1.0, 49.5, -0.5, 50.5))
    assert land.depths is not None
    assert not land.depths.at(np.array([[-0.8, 50.0], [0.5, 50.4]])).any()


def test_a_grid_of_another_place_or_with_the_other_sign_is_refused(tmp_path: Path) -> None:
    file = depth_grids.gebco(tmp_path / "grid.nc", LON, LAT, sea_floor())
    with pytest.raises(RequestError, match=r"grid\.nc covers nothing of the region; give a grid"):
        sounded(file).land(shapely.box(10, 49.5, 12, 50.5))
    upside_down = depth_grids.gebco(tmp_path / "wrong.nc", LON, LAT, -sea_floor())
    with pytest.raises(RequestError, match=r"100% of the region's water lies above the sea.*up"):
        sounded(upside_down).land(REGION)


def test_the_identity_follows_the_file_and_the_depth(tmp_path: Path) -> None:
    file = depth_grids.gebco(tmp_path / "grid.nc", LON, LAT, sea_floor())
    first = sounded(file).identity
    assert first == sounded(file).identity
    assert first != sounded(file, 6.0).identity
    assert first != sounded(depth_grids.gebco(file, LON, LAT, sea_floor() - 1)).identity


def test_a_chart_with_depths_needs_a_draught(tmp_path: Path) -> None:
    file = depth_grids.gebco(tmp_path / "grid.nc", LON, LAT, sea_floor())
    chart = ChartSpec(depths=str(file), under_keel_clearance_m=1.5)
    with pytest.raises(RequestError, match=r"vessel\.draught_m is missing"):
        land_source(chart, None)
    source = land_source(chart, 4.0)
    assert isinstance(source, SoundedChart)
    assert math.isclose(source.rule.safety_depth_m, 5.5)


def test_damaged_files_are_read_or_refused_with_one_line(tmp_path: Path) -> None:
    file = depth_grids.gebco(tmp_path / "grid.nc", LON[::4], LAT[::4], sea_floor()[::4, ::4])
    with xr.open_dataset(file) as data:
        data.load().to_netcdf(tmp_path / "classic.nc", format="NETCDF3_CLASSIC")
    whole = (tmp_path / "classic.nc").read_bytes()
    rng = np.random.default_rng(20261122)
    outcomes = set()
    for _ in range(80):
        damaged = bytearray(whole)
        for _ in range(rng.integers(1, 6)):
            end = 1600 if rng.random() < 0.7 else len(whole)  # mostly in the header
            damaged[rng.integers(end)] = rng.integers(256)
        file.write_bytes(bytes(damaged))
        try:
            sounded(file).land(REGION)
        except RequestError as error:
            (fault,) = error.faults
            assert fault.startswith("chart.depths: ")
            assert "\n" not in fault
            outcomes.add("refused")
        else:
            outcomes.add("read")
    assert outcomes == {"read", "refused"}
