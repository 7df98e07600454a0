"""Water without data is reported wherever it lies, for each source of currents; land is not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from pipeline.findings.note_words import note_texts
from pipeline.model import CurrentGrid, Land
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import EmbeddedTableSpec
from pipeline.scenario.season import Season
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.copernicus.acceptance import accept
from pipeline.sources.current_field import (
    Field,
    LandMask,
    _raster_of_the_world,
    land_freed_at_end,
    water_without_data,
)
from pipeline.sources.registry import EmbeddedTable
from tests.pipeline.sources.copernicus import test_acceptance
from tests.pipeline.synthetic_currents import coastal, dataset, sea, write

# Cuyo: islands of some kilometres in open water, 0.05 degrees apart from most gaps of a grid.
CUYO = shapely.box(120.6, 10.4, 121.4, 11.2)
STEP = 0.05
ISLAND = shapely.box(0.0, 0.0, 1.0, 1.0)
AROUND = shapely.box(-2.0, -2.0, 3.0, 3.0)


@pytest.fixture(scope="module")
def cuyo(world_mask: LandMask) -> Field:
    """Give a plausible sea around Cuyo, with gaps at the nodes on land and nowhere else."""
    axes = np.arange(118.0, 124.0, STEP), np.arange(8.0, 14.0, STEP)
    return coastal(sea(*axes, seed=2), world_mask)


def with_hole(field: Field, lon: float, lat: float, cells: int) -> Field:
    """Remove the values of a square of cells around a place."""
    x, y = np.abs(field.lon - lon).argmin(), np.abs(field.lat - lat).argmin()
    half = cells // 2
    square = np.ix_(range(y - half, y + half + 1), range(x - half, x + half + 1))
    u, v = field.u.copy(), field.v.copy()
    u[square] = v[square] = np.nan
    return Field(field.lon, field.lat, u, v)


def read(folder: Path, field: Field) -> CurrentGrid:
    """Write a field as a user's file, and read it around Cuyo."""
    name = str(write(folder / "field.nc", dataset(field, times=["2024-07-01"])))
    source = CfFiles((name,))
    season = Season(name="summer", valid="2024-07-01", currents=((name,),))
    return source.current(CUYO, season, Land((), (), 0.0), folder)


def test_a_hole_across_an_island_is_noted_though_it_is_all_near_the_coast(
    tmp_path: Path, cuyo: Field, world_mask: LandMask
) -> None:
    # 7 x 7 cells: each of them lies within a few cells of land.
    lon, lat = 121.0, 10.85
    holed = with_hole(cuyo, lon, lat, 7)
    assert np.isnan(cuyo.u[np.isnan(holed.u)]).any(), "the hole has land in it"
    (note,) = note_texts(read(tmp_path, holed).notes)
    # By hand: the water whose nearest node has no value, point by point.
    x, y = (np.arange(low, low + 0.8, 0.002) + 0.001 for low in (120.6, 10.4))
    column, row = (
        np.abs(axis[None, :] - values[:, None]).argmin(axis=1)
        for axis, values in ((holed.lon, x), (holed.lat, y))
    )
    water = ~world_mask.on_grid(x, y)
    share = (water & np.isnan(holed.u)[np.ix_(row, column)]).sum() / water.sum()
    assert 0.15 < share < 0.25
    assert f"no data for {share:.0%} of the region's water" in note
    # The middle of the hole is 4 cells from the nearest value.
    assert f"up to {4 * STEP * 111.195:.0f} km" in note


def test_gaps_on_land_alone_are_not_noted(tmp_path: Path, cuyo: Field) -> None:
    x, y = (
        np.flatnonzero((axis > low) & (axis < low + 0.8))
        for axis, low in ((cuyo.lon, 120.6), (cuyo.lat, 10.4))
    )
    assert np.isnan(cuyo.u[np.ix_(y, x)]).any()
    assert read(tmp_path, cuyo).notes == ()


def test_a_single_cell_is_noted(tmp_path: Path, cuyo: Field) -> None:
    (note,) = note_texts(read(tmp_path, with_hole(cuyo, 120.75, 10.55, 1)).notes)
    assert "no data for less than 1% of the region's water" in note


def test_of_a_polygon_only_its_own_water_counts() -> None:
    mask = LandMask(lambda lon, lat: lon + lat > np.inf, AROUND.bounds)
    axis = np.arange(-2.0, 3.01, 0.25)
    field = with_hole(Field(axis, axis, np.ones((21, 21)), np.ones((21, 21))), 2.0, 2.0, 3)
    west, east = shapely.box(-1, -1, 1, 1), shapely.box(1, 1, 3, 3)
    assert water_without_data(field, mask, west) == ()
    for region, share in (
        (east, 0.75**2 / 4),
        (shapely.Polygon([(3, 3), (-1, 3), (3, -1)]), 0.75**2 / 8),
    ):
        (note,) = water_without_data(field, mask, region)
        assert dict(note.values)["share"] == pytest.approx(share, abs=0.01)


def test_a_field_without_any_value_has_nothing_near() -> None:
    mask = LandMask(lambda lon, lat: lon + lat > np.inf, AROUND.bounds)
    axis = np.arange(-2.0, 3.01, 0.5)
    nothing = np.full((11, 11), np.nan)
    (note,) = water_without_data(Field(axis, axis, nothing, nothing), mask, AROUND)
    assert dict(note.values) == {"share": 1.0, "distance_m": np.inf}


def test_the_embedded_table_says_where_it_has_no_data() -> None:
    spec = catalogue.source("embedded-palawan")
    assert isinstance(spec, EmbeddedTableSpec)
    region = shapely.box(116.5, 8.0, 120.5, 11.5)
    season = Season(name="summer", valid="2024-07", currents=("embedded-palawan",))

    def grid(*land: shapely.Polygon) -> CurrentGrid:
        return EmbeddedTable(spec).current(region, season, Land(land, (), 0.0), Path())

    as_water = grid()
    (note,) = note_texts(as_water.notes)
    assert "has no data for" in note
    row, column = np.nonzero(np.isnan(as_water.u[0]))
    around = shapely.buffer(shapely.points(as_water.lon[column], as_water.lat[row]), 0.1)
    assert grid(*around).notes == ()
    assert grid(*around[1:]).notes or not region.intersects(around[0])


@pytest.mark.parametrize(
    ("change", "is_noted"),
    [
        (lambda field: field, False),
        (lambda field: with_hole(field, 118.0, 9.75, 7), True),
    ],
)
def test_a_download_with_a_hole_at_a_coast_is_noted(
    tmp_path: Path, change: Callable[[Field], Field], *, is_noted: bool
) -> None:
    path = test_acceptance.write(tmp_path / "field.nc", change(test_acceptance.field()))
    # Of a region that is no box, the part outside does not count.
    corner = shapely.box(117, 8, 120, 11) - shapely.box(117, 8.05, 119.6, 11)
    east = replace(test_acceptance.MONTH, region=corner)
    for asked, is_noted_there in ((test_acceptance.MONTH, is_noted), (east, False)):
        _, notes = accept(path, asked, (), test_acceptance.LAND)
        assert any(note.kind == "current-lacking" for note in notes) is is_noted_there


def test_the_land_of_the_world_is_loaded_once_and_freed_at_the_end() -> None:
    original = getattr(LandMask.world, "__wrapped__", LandMask.world)  # that of tests keeps it
    _raster_of_the_world.cache_clear()
    with land_freed_at_end():
        for _ in range(3):
            mask = original()
            assert mask.is_land(np.array([118.7, 117.5]), np.array([9.9, 11.0])).tolist() == [
                True,
                False,
            ]
        assert _raster_of_the_world.cache_info()[:2] == (2, 1)  # hits, misses
    assert _raster_of_the_world.cache_info().currsize == 0
