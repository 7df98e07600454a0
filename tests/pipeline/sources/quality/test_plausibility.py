"""Whether the sea could run like that: found where it could not, silent where it does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import shapely
import xarray as xr

from pipeline.model import Land
from pipeline.scenario import catalogue
from pipeline.scenario.catalogue import EmbeddedTableSpec
from pipeline.scenario.model import Season
from pipeline.sources.currents.embedded import EmbeddedTable
from pipeline.sources.quality import component_signs as turned
from pipeline.sources.quality.component_signs import likeliest
from pipeline.sources.quality.field import Field, Shore
from pipeline.sources.quality.misregistration import shift
from pipeline.sources.quality.plausibility import Verdict, judged, misplaced
from tests.pipeline.seas import EARTH_RADIUS_M, coastal, sea

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

NO_LAND = Land((), (), 0.0)
LIMIT_M_S = 10.0
SOUND = Verdict()
# Among the islands between Borneo and Luzon, and off Japan: coasts on all sides, and open sea.
ISLANDS = np.arange(112.0, 130.0, 0.25), np.arange(2.0, 18.0, 0.25)
OCEAN = np.arange(140.0, 160.0, 0.25), np.arange(20.0, 38.0, 0.25)


@pytest.fixture(scope="module")
def shore() -> Shore:
    """Give the world's land: it takes seconds to load."""
    return Shore.world()


def flipped(field: Field) -> Field:
    """Change the sign of the eastward component."""
    return replace(field, u=-field.u)


def both_flipped(field: Field) -> Field:
    """Change both signs."""
    return replace(field, u=-field.u, v=-field.v)


def swapped(field: Field) -> Field:
    """Change the components' places."""
    return replace(field, u=field.v, v=field.u)


def quarter(field: Field) -> Field:
    """Change places and one sign."""
    return replace(field, u=field.v, v=-field.u)


def moved(field: Field, east: float, north: float) -> Field:
    """Move a field as a wrong coordinate does."""
    return replace(field, lon=field.lon + east, lat=field.lat + north)


@pytest.mark.parametrize("axes", [ISLANDS, OCEAN])
@pytest.mark.parametrize("seed", range(3))
def test_a_sea_that_could_be_is_not_spoken_against(
    shore: Shore, axes: tuple[np.ndarray, np.ndarray], seed: int
) -> None:
    assert judged(coastal(sea(*axes, seed=seed), shore), shore, LIMIT_M_S) == SOUND


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (flipped, "one component has the wrong sign"),
        (lambda field: flipped(both_flipped(field)), "one component has the wrong sign"),
        (swapped, "the components are swapped: "),
        (lambda field: moved(field, 0.5, 0.0), "shifted by 0.5"),
        (lambda field: moved(field, -0.5, 0.5), "degrees west and 0.5"),
        (lambda field: replace(field, u=40 * field.u), "m/s, above 10: another unit, or damaged"),
        (
            lambda field: replace(
                field, u=np.nan_to_num(field.u, nan=-999.0), v=np.nan_to_num(field.v)
            ),
            "a gap's figure",
        ),
        (lambda field: replace(field, u=6 * field.u, v=6 * field.v), "probably km/h"),
        (lambda field: replace(field, u=0 * field.u, v=0 * field.v), "every speed is 0"),
        (lambda field: replace(field, u=0 * field.u + 0.2, v=0 * field.v), "the same everywhere"),
        (lambda field: replace(field, u=np.nan * field.u), "no figures at all"),
    ],
)
def test_what_spoils_a_field_is_a_fault(
    shore: Shore, spoil: Callable[[Field], Field], said: str
) -> None:
    verdict = judged(spoil(coastal(sea(*ISLANDS), shore)), shore, LIMIT_M_S)
    assert len(verdict.faults) == 1
    assert said in verdict.faults[0]


def test_the_embedded_tables_pass(shore: Shore) -> None:
    spec = catalogue.source("embedded-palawan")
    assert isinstance(spec, EmbeddedTableSpec)
    for name in spec.seasons:
        season = Season(name=name, valid="2024-07", currents=("embedded-palawan",))
        grid = EmbeddedTable(spec).current(shapely.box(116, 8, 121, 13), season, NO_LAND, Path())
        assert not judged(Field(grid.lon, grid.lat, grid.u, grid.v), shore, LIMIT_M_S).faults


def test_a_quarter_turn_is_no_more_than_a_doubt(shore: Shore) -> None:
    verdict = judged(quarter(sea(*OCEAN)), shore, LIMIT_M_S)
    assert not verdict.faults
    assert "the components are swapped and one has the wrong sign" in verdict.doubts[0]
    assert "waves and tides" in verdict.doubts[0]


def test_with_both_signs_wrong_nothing_is_told(shore: Shore) -> None:
    assert judged(both_flipped(sea(*OCEAN)), shore, LIMIT_M_S) == SOUND


@pytest.mark.parametrize("seed", range(8))
def test_waves_that_diverge_are_not_refused(shore: Shore, seed: int) -> None:
    """Internal tides run along their own direction: all divergence, no vorticity."""
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
    assert not judged(Field(lon, lat, u, v), shore, LIMIT_M_S).faults


def test_a_field_too_small_to_tell_is_left_alone(shore: Shore) -> None:
    small = sea(np.arange(145, 146, 0.25), np.arange(30, 31, 0.25))
    for field in (small, flipped(small), swapped(small)):
        assert likeliest(field) is None
        assert shift(field, shore) is None


@pytest.mark.parametrize(("east", "north"), [(0.5, 0), (0, -0.5), (-0.75, 0.25), (1.0, 1.0)])
def test_a_shift_is_measured(shore: Shore, east: float, north: float) -> None:
    found = shift(moved(coastal(sea(*ISLANDS), shore), east, north), shore)
    assert found is not None
    assert abs(found.east - east) <= 0.25
    assert abs(found.north - north) <= 0.25


def test_gaps_that_reach_beyond_the_land_are_no_shift(shore: Shore) -> None:
    """Fields often end a cell or two off the coast: on all sides alike."""
    from scipy.ndimage import binary_dilation

    field = coastal(sea(*ISLANDS), shore)
    for cells in (1, 2):
        wide = binary_dilation(field.gap, iterations=cells)
        u, v = (np.where(wide, np.nan, part) for part in (field.u, field.v))
        verdict = judged(replace(field, u=u, v=v), shore, LIMIT_M_S)
        assert not verdict.faults


def test_a_region_is_judged_by_the_land_that_is_known(shore: Shore) -> None:
    """Beyond the bounds land is not known, and must not pass for water."""
    field = coastal(sea(*ISLANDS), shore)
    west, south, east, north = 113.0, 3.0, 129.0, 17.0

    def is_land(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
        inside = (lon >= west) & (lon <= east) & (lat >= south) & (lat <= north)
        assert inside.all(), "asked beyond what is known"
        return shore.is_land(lon, lat)

    known = Shore(is_land, (west, south, east, north))
    assert shift(field, known) is None
    found = shift(moved(field, 0.5, 0.0), known)
    assert found is not None
    assert abs(found.east - 0.5) <= 0.25


def test_gaps_and_figures_are_counted_where_they_should_not_be(shore: Shore) -> None:
    field = coastal(sea(*OCEAN), shore)
    assert misplaced(field, shore)[0][0] == 0
    u = field.u.copy()
    u[30:40, 30:40] = np.nan
    (gaps, water), _ = misplaced(replace(field, u=u), shore)
    assert (gaps, water > 3000) == (100, True)
    box = (field.lon[30], field.lat[30], field.lon[34], field.lat[49])
    assert misplaced(replace(field, u=u), shore, box)[0] == (50, 100)
    land = Shore(lambda lon, lat: lon + lat < np.inf, shore.bounds)
    assert misplaced(sea(*OCEAN), land) == ((0, 0), (66 * 74, 66 * 74))


# --- error rates on real fields -----------------------------------------------------------------


def real_fields(folder: Path) -> Iterator[tuple[str, Field]]:
    """Yield real fields, the whole of each, longitudes ascending."""
    for name, file, axis, steps in (
        ("OCM 1/10°", "cwb_ocm_M-B0071-000_20200617T00.nc", "time", [0]),
        (
            "GLO12 1°",
            "cmems_mod_glo_phy-cur_anfc_0.083deg_P1D-m_2024-01_1deg_5day.nc",
            "time",
            [0],
        ),
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


def windows(whole: Field, shore: Shore, count: int) -> Iterator[Field]:
    """Yield what a file is looked at in for a region at random near a coast."""
    rng = np.random.default_rng(5)
    cell = whole.cell[1]
    is_global = np.ptp(whole.lon) > 350
    half = min(240 * cell, 75.0)
    while count:
        if is_global:
            x, y = rng.uniform(-180, 180), rng.uniform(-55, 65)
        else:
            x, y = rng.uniform(112, 124), rng.uniform(9, 34)
        near = shore.is_land(x + rng.uniform(-4, 4, 30), y + rng.uniform(-4, 4, 30))
        if near.all() or not near.any():
            continue
        lon = (whole.lon - x + 180) % 360 - 180 if is_global else whole.lon - x
        columns = np.flatnonzero(np.abs(lon) < half)
        columns = columns[np.argsort(lon[columns])]
        rows = np.flatnonzero(np.abs(whole.lat - y) < half)
        place = np.ix_(rows, columns)
        field = Field(x + lon[columns], whole.lat[rows], whole.u[place], whole.v[place])
        if (~field.gap).sum() > 60:
            count -= 1
            yield field


SPOILT: dict[str, tuple[Callable[[Field], Field], str]] = {
    "as it is": (lambda field: field, ""),
    "u flipped": (flipped, turned.FLIPPED),
    "v flipped": (lambda field: flipped(both_flipped(field)), turned.FLIPPED),
    "swapped": (swapped, turned.SWAPPED),
    "0.5° east": (lambda field: moved(field, 0.5, 0), "shifted"),
    "0.5° south": (lambda field: moved(field, 0, -0.5), "shifted"),
    "km/h for m/s": (lambda f: replace(f, u=3.6 * f.u, v=3.6 * f.v), "another unit"),
}
# Least shares told of. OSCAR's components under 0.2 m/s were set to zero upstream, and its coast
# was widened by half a degree: of most of it there are doubts, and no faults.
LEAST = {"OCM 1/10°": 1.0, "GLO12 1°": 0.95, "DUACS 1/4°": 0.8, "OSCAR 1/3°": 0.85}


@pytest.mark.slow
def test_the_error_rates_on_real_fields(shared: Path, shore: Shore) -> None:
    regions = 13  # of each product
    for name, whole in real_fields(shared / "data" / "currents"):
        refused, told = dict.fromkeys(SPOILT, 0), dict.fromkeys(SPOILT, 0)
        for field in windows(whole, shore, regions):
            for what, (spoil, said) in SPOILT.items():
                verdict = judged(spoil(field), shore, LIMIT_M_S)
                refused[what] += any(said in fault for fault in verdict.faults)
                told[what] += any(said in line for line in verdict.faults + verdict.doubts)
        for what in SPOILT:
            print(f"{name:12} {what:14} refused {refused[what]:3} told {told[what]:3} of {regions}")  # noqa: T201
        assert told["as it is"] == 0, "a false alarm"
        for what in SPOILT:
            assert what == "as it is" or told[what] >= LEAST[name] * regions, (name, what)
