"""Faults of fields are found: wrong signs, swapped components, shifts, units, gaps in water."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
import xarray as xr

from pipeline._types import BoolArray, FloatArray
from pipeline.findings.note_words import note_texts
from pipeline.model import CurrentGrid, Land
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import EmbeddedTableSpec
from pipeline.scenario.season import Season
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.copernicus.adapter import accept
from pipeline.sources.current_field import (
    Field,
    LandMask,
    _raster_of_the_world,
    find_shift,
    land_freed_at_end,
    water_without_data,
)
from pipeline.sources.plausibility import (
    FLIPPED,
    ROTATED,
    SWAPPED,
    Assessment,
    assess_directions,
    assess_series,
    count_misplaced,
    likeliest_variant,
)
from pipeline.sources.registry import EmbeddedTable
from tests.pipeline.sources.copernicus import test_acceptance
from tests.pipeline.synthetic_currents import EARTH_RADIUS_M, coastal, dataset, sea, write

# Among the islands between Borneo and Luzon, and off Japan: coasts on all sides, and open sea.
ISLANDS = np.arange(112.0, 130.0, 0.25), np.arange(2.0, 18.0, 0.25)
OCEAN = np.arange(140.0, 160.0, 0.25), np.arange(20.0, 38.0, 0.25)


def with_u_flipped(field: Field) -> Field:
    """Change the sign of the eastward component."""
    return replace(field, u=-field.u)


def with_v_flipped(field: Field) -> Field:
    """Change the sign of the northward component."""
    return replace(field, v=-field.v)


def with_both_flipped(field: Field) -> Field:
    """Change both signs."""
    return replace(field, u=-field.u, v=-field.v)


def swapped(field: Field) -> Field:
    """Swap the components."""
    return replace(field, u=field.v, v=field.u)


def rotated(field: Field) -> Field:
    """Swap the components and change one sign."""
    return replace(field, u=field.v, v=-field.u)


def shifted(field: Field, east: float, north: float) -> Field:
    """Shift a field by degrees, as wrong coordinates do."""
    return replace(field, lon=field.lon + east, lat=field.lat + north)


# --- Plausibility of a field: real faults are found, and a plausible sea has none ---


NO_LAND = Land((), (), 0.0)
LIMIT_M_S = 10.0
PLAUSIBLE = Assessment()


def assess(field: Field, mask: LandMask, limit_m_s: float) -> Assessment:
    """Assess a single field."""
    return assess_series((field,), ("",), mask, limit_m_s)


@pytest.mark.parametrize("axes", [ISLANDS, OCEAN])
@pytest.mark.parametrize("seed", range(3))
def test_a_plausible_sea_has_neither_fault_nor_warning(
    world_mask: LandMask, axes: tuple[np.ndarray, np.ndarray], seed: int
) -> None:
    assert assess(coastal(sea(*axes, seed=seed), world_mask), world_mask, LIMIT_M_S) == PLAUSIBLE


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (with_u_flipped, "one component has the wrong sign"),
        (with_v_flipped, "one component has the wrong sign"),
        (swapped, "the components are swapped: "),
        (lambda field: shifted(field, 0.5, 0.0), "shifted by 0.5"),
        (lambda field: shifted(field, -0.5, 0.5), "degrees west and 0.5"),
        (lambda field: replace(field, u=40 * field.u), "m/s, above 10: another unit, or damaged"),
        (
            lambda field: replace(
                field, u=np.nan_to_num(field.u, nan=-999.0), v=np.nan_to_num(field.v)
            ),
            "a fill value",
        ),
        (lambda field: replace(field, u=6 * field.u, v=6 * field.v), "probably km/h"),
        (lambda field: replace(field, u=0 * field.u, v=0 * field.v), "every speed is 0"),
        (lambda field: replace(field, u=0 * field.u + 0.2, v=0 * field.v), "the same everywhere"),
        (lambda field: replace(field, u=np.nan * field.u), "no data at all"),
    ],
)
def test_each_fault_of_a_field_is_reported(
    world_mask: LandMask, fault: Callable[[Field], Field], message: str
) -> None:
    assessment = assess(fault(coastal(sea(*ISLANDS), world_mask)), world_mask, LIMIT_M_S)
    assert len(assessment.faults) == 1
    assert message in assessment.faults[0]


def test_the_embedded_tables_pass(world_mask: LandMask) -> None:
    spec = catalogue.source("embedded-palawan")
    assert isinstance(spec, EmbeddedTableSpec)
    for name in spec.seasons:
        season = Season(name=name, valid="2024-07", currents=("embedded-palawan",))
        grid = EmbeddedTable(spec).current(shapely.box(116, 8, 121, 13), season, NO_LAND, Path())
        field = Field(grid.lon, grid.lat, grid.u[0], grid.v[0])
        assert not assess(field, world_mask, LIMIT_M_S).faults


def test_a_quarter_turn_is_only_a_warning(world_mask: LandMask) -> None:
    assessment = assess(rotated(sea(*OCEAN)), world_mask, LIMIT_M_S)
    assert not assessment.faults
    assert "the components are swapped and one has the wrong sign" in assessment.warnings[0]
    assert "waves and tides" in assessment.warnings[0]


@pytest.mark.parametrize("seed", range(8))
def test_waves_that_diverge_are_not_refused(world_mask: LandMask, seed: int) -> None:
    """Currents of internal tides lie along their direction: all divergence, no vorticity."""
    rng = np.random.default_rng(seed)
    lon, lat = OCEAN
    x, y = np.meshgrid(np.radians(lon) * np.cos(np.radians(29)), np.radians(lat))
    u, v = np.zeros(x.shape), np.zeros(x.shape)
    for _ in range(40):
        bearing, phase = rng.uniform(0, 2 * np.pi, 2)
        wave = 2 * np.pi * EARTH_RADIUS_M / rng.uniform(120e3, 400e3)
        along = np.cos(wave * (np.cos(bearing) * x + np.sin(bearing) * y) + phase)
        u += 0.05 * np.cos(bearing) * along
        v += 0.05 * np.sin(bearing) * along
    assert not assess(Field(lon, lat, u, v), world_mask, LIMIT_M_S).faults


def test_gaps_that_reach_beyond_the_land_are_no_shift(world_mask: LandMask) -> None:
    """Fields often end a cell or two off the coast, on all sides alike."""
    from scipy.ndimage import binary_dilation

    field = coastal(sea(*ISLANDS), world_mask)
    for cells in (1, 2):
        gap = binary_dilation(field.gap, iterations=cells)
        u, v = (np.where(gap, np.nan, part) for part in (field.u, field.v))
        assert not assess(replace(field, u=u, v=v), world_mask, LIMIT_M_S).faults


def test_gaps_in_water_and_data_on_land_are_counted(world_mask: LandMask) -> None:
    field = coastal(sea(*OCEAN), world_mask)
    assert count_misplaced(field, world_mask)[0][0] == 0
    u = field.u.copy()
    u[30:40, 30:40] = np.nan
    (gaps, water), _ = count_misplaced(replace(field, u=u), world_mask)
    assert (gaps, water > 3000) == (100, True)
    box = (field.lon[30], field.lat[30], field.lon[34], field.lat[49])
    assert count_misplaced(replace(field, u=u), world_mask, box)[0] == (50, 100)
    land = LandMask(lambda lon, lat: lon + lat < np.inf, world_mask.bounds)
    assert count_misplaced(sea(*OCEAN), land) == ((0, 0), (66 * 74, 66 * 74))


# --- error rates on real fields -----------------------------------------------------------------


def real_fields(folder: Path) -> Iterator[tuple[str, Field]]:
    """Yield real fields, each as a whole, longitudes ascending."""
    for name, file, axis, steps in (
        ("OCM 1/10°", "cwb_ocm_M-B0071-000_20200617T00.nc", "time", [0]),
        ("GLO12 1°", "cmems_mod_glo_phy-cur_anfc_0.083deg_P1D-m_2024-01_1deg_5day.nc", "time", [0]),
        ("DUACS 1/4°", "duacs_nrt_global_allsat_phy_l4_20190223_20190226.nc", "time", [0]),
        ("OSCAR 1/3°", "oscar_climatology_1992-2012_monthly_third_deg.nc", "month", [6]),
    ):
        with xr.open_dataset(folder / file) as data:
            for step in steps:
                part = data.isel({axis: step}).sel(latitude=slice(-79, 80))
                names = sorted(map(str, part.data_vars))
                u, v = (part[n].values.astype(float) for n in names if n[0] in "uv")
                lon, lat = (part[n].values.astype(float) for n in ("longitude", "latitude"))
                yield name, Field(lon, lat, u, v)


def random_windows(whole: Field, mask: LandMask, count: int) -> Iterator[Field]:
    """Yield the windows in which a file is checked, for random regions near a coast."""
    rng = np.random.default_rng(5)
    cell = whole.cell_deg[1]
    is_global = np.ptp(whole.lon) > 350
    half = min(240 * cell, 75.0)
    while count:
        if is_global:
            x, y = rng.uniform(-180, 180), rng.uniform(-55, 65)
        else:
            x, y = rng.uniform(112, 124), rng.uniform(9, 34)
        near = mask.is_land(x + rng.uniform(-4, 4, 30), y + rng.uniform(-4, 4, 30))
        if near.all() or not near.any():
            continue
        lon = (whole.lon - x + 180) % 360 - 180 if is_global else whole.lon - x
        columns = np.flatnonzero(np.abs(lon) < half)
        columns = columns[np.argsort(lon[columns])]
        rows = np.flatnonzero(np.abs(whole.lat - y) < half)
        part = np.ix_(rows, columns)
        field = Field(x + lon[columns], whole.lat[rows], whole.u[part], whole.v[part])
        if (~field.gap).sum() > 60:
            count -= 1
            yield field


FAULTS: dict[str, tuple[Callable[[Field], Field], str]] = {
    "none": (lambda field: field, ""),
    "u flipped": (with_u_flipped, FLIPPED),
    "v flipped": (with_v_flipped, FLIPPED),
    "swapped": (swapped, SWAPPED),
    "0.5° east": (lambda field: shifted(field, 0.5, 0), "shifted"),
    "0.5° south": (lambda field: shifted(field, 0, -0.5), "shifted"),
    "km/h for m/s": (lambda f: replace(f, u=3.6 * f.u, v=3.6 * f.v), "another unit"),
}
# Least share of the faults that are reported, as fault or warning. Of OSCAR's: its components below
# 0.2 m/s were set to zero by its makers and its coast was widened by half a degree, so that most
# faults give warnings only.
MIN_SHARE = {"OCM 1/10°": 1.0, "GLO12 1°": 0.95, "DUACS 1/4°": 0.8, "OSCAR 1/3°": 0.85}


@pytest.mark.slow
def test_the_error_rates_on_real_fields(shared: Path, world_mask: LandMask) -> None:
    count = 13  # regions of each product
    for name, whole in real_fields(shared / "data" / "currents"):
        refused, reported = dict.fromkeys(FAULTS, 0), dict.fromkeys(FAULTS, 0)
        for field in random_windows(whole, world_mask, count):
            for kind, (fault, message) in FAULTS.items():
                found = assess(fault(field), world_mask, LIMIT_M_S)
                refused[kind] += any(message in line for line in found.faults)
                reported[kind] += any(message in line for line in found.faults + found.warnings)
        for kind in FAULTS:
            print(  # noqa: T201
                f"{name:12} {kind:14} refused {refused[kind]:3} reported {reported[kind]:3} "
                f"of {count}"
            )
        assert reported["none"] == 0, "a false alarm"
        for kind in FAULTS:
            assert kind == "none" or reported[kind] >= MIN_SHARE[name] * count, (name, kind)


# --- Wrong signs and swapped components, which are not judged where the data don't suffice.


def test_the_likeliest_variant_undoes_the_fault() -> None:
    field = sea(*OCEAN)
    for fault, name in (
        (with_u_flipped, FLIPPED),
        (with_v_flipped, FLIPPED),
        (swapped, SWAPPED),
        (rotated, ROTATED),
    ):
        variant = likeliest_variant(fault(field))
        assert variant is not None
        assert variant[0] == name
        assert variant[1] > 0.5
    assert likeliest_variant(field) is None
    assert likeliest_variant(with_both_flipped(field)) is None


def test_a_field_that_is_too_small_is_not_judged() -> None:
    small = sea(np.arange(145, 146, 0.25), np.arange(30, 31, 0.25))
    for field in (small, with_u_flipped(small), swapped(small)):
        assert likeliest_variant(field) is None


@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0, 90.0])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_tide_of_a_strait_is_not_judged(degrees: float, noise: float) -> None:
    """It runs to and fro, diverges where the level rises, and does not turn: a long wave."""
    lon, lat = np.linspace(5.0, 6.0, 41), np.linspace(60.0, 60.6, 41)
    x, y = np.meshgrid((lon - 5.5) * 55_600, (lat - 60.3) * 111_200)
    along = x * np.cos(np.radians(degrees)) + y * np.sin(np.radians(degrees))
    speed = 1.5 * np.cos(2 * np.pi * along / 200e3 + 0.7)
    rng = np.random.default_rng(1)
    u, v = (
        speed * part(np.radians(degrees)) + noise * rng.normal(size=speed.shape)
        for part in (np.cos, np.sin)
    )
    assert assess_directions(Field(lon, lat, u, v)) == Assessment()


def test_the_tide_of_a_bay_is_a_doubt_without_figures() -> None:
    """A long wave in two directions looks like eddies whose currents were turned by 90 degrees."""
    lon, lat = np.linspace(5.0, 6.0, 41), np.linspace(60.0, 60.6, 41)
    x, y = np.meshgrid((lon - 5.5) * 55_600, (lat - 60.3) * 111_200)
    u, v = np.cos(x / 20e3) * np.sin(y / 25e3), 0.8 * np.sin(x / 20e3) * np.cos(y / 25e3)
    (doubt,) = assess_directions(Field(lon, lat, u, v)).warnings
    assert "or it is waves and tides" in doubt
    assert "standard errors" not in doubt


# --- Shifted fields: the offset is found, and unshifted fields have none ---


@pytest.mark.parametrize(("east", "north"), [(0.5, 0), (0, -0.5), (-0.75, 0.25), (1.0, 1.0)])
def test_a_shift_is_measured(world_mask: LandMask, east: float, north: float) -> None:
    found = find_shift(shifted(coastal(sea(*ISLANDS), world_mask), east, north), world_mask)
    assert found is not None
    assert abs(found[0] - east) <= 0.25
    assert abs(found[1] - north) <= 0.25


def test_a_field_that_is_too_small_has_no_shift(world_mask: LandMask) -> None:
    small = sea(np.arange(145, 146, 0.25), np.arange(30, 31, 0.25))
    assert find_shift(small, world_mask) is None


def test_only_land_inside_the_masks_bounds_is_used(world_mask: LandMask) -> None:
    """Outside of them land is not known, and must not count as water."""
    field = coastal(sea(*ISLANDS), world_mask)
    west, south, east, north = 113.0, 3.0, 129.0, 17.0

    def is_land(lon: FloatArray, lat: FloatArray) -> BoolArray:
        inside = (lon >= west) & (lon <= east) & (lat >= south) & (lat <= north)
        assert inside.all(), "asked outside the bounds"
        return world_mask.is_land(lon, lat)

    known = LandMask(is_land, (west, south, east, north))
    assert find_shift(field, known) is None
    found = find_shift(shifted(field, 0.5, 0.0), known)
    assert found is not None
    assert abs(found[0] - 0.5) <= 0.25


# --- Water without data is reported wherever it lies, for each source of currents; land is not.


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
    [(lambda field: field, False), (lambda field: with_hole(field, 118.0, 9.75, 7), True)],
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
