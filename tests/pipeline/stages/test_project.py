"""Projection to the plane: the extent, and the current."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp

import renew
from pipeline.errors import RequestError
from pipeline.geo.projection import Projection
from pipeline.model import Credit, CurrentGrid, SimplifiedLand
from pipeline.scenario.region import Region
from pipeline.sources.interpolation import fill_gaps
from pipeline.sources.land.shapes import box_around
from pipeline.stages.project import extent_polygon, planar_current, project, water_of
from tests.pipeline.formats import small_run

CREDIT = Credit("made up", "current", "", "")
GEOD = pyproj.Geod(ellps="WGS84")
PALAWAN = shapely.box(115.5, 7, 122, 13.5)


def grid_of(function: object, step: float = 0.5, region: shapely.Polygon = PALAWAN) -> CurrentGrid:
    """Return a grid that extends a cell beyond a region, from a function of lon and lat."""
    west, south, east, north = region.bounds
    lon = np.arange(west - step, east + 1.5 * step, step)
    lat = np.arange(south - step, north + 1.5 * step, step)
    u, v = function(*np.meshgrid(lon, lat))  # type: ignore[operator]
    return CurrentGrid("summer", lon, lat, u[None], v[None], "2024-07", CREDIT)


@pytest.mark.parametrize(
    "region",
    [
        PALAWAN,
        shapely.box(170, 55, 190, 70),
        shapely.box(-10, -50, 30, -35),
        shapely.Polygon([(115.5, 7), (122, 7), (119, 13.5)]),
    ],
)
def test_the_extent_has_few_corners_and_follows_the_region(region: shapely.Polygon) -> None:
    projection = Projection.for_region(region, 1000.0)
    extent = extent_polygon(region, projection)
    assert extent.is_valid
    assert len(extent.exterior.coords) - 1 <= 32
    dense = projection.geometry_to_plane(shapely.segmentize(region, 0.05))
    xmin, ymin, xmax, ymax = extent.bounds
    assert extent.hausdorff_distance(dense) < 0.003 * np.hypot(xmax - xmin, ymax - ymin)


# Half round the world: an edge along a parallel is an arc in the plane.
ARCTIC = shapely.box(120, 72, 240, 80)


@pytest.mark.parametrize(
    "region", [ARCTIC, shapely.box(0, 45, 179, 60), shapely.box(60, -75, 239, -55)]
)
def test_no_chart_reaches_beyond_the_land_that_is_fetched(region: shapely.Polygon) -> None:
    projection = Projection.for_region(region)
    beyond = projection.geometry_to_lonlat(extent_polygon(region, projection), 10_000.0)
    assert box_around(region).covers(beyond)


def test_land_that_is_cut_along_a_parallel_does_not_reach_beyond_it_in_the_plane() -> None:
    """A straight line from end to end would be 800 km off, over the sea north of Siberia."""
    coast = shapely.box(110, 60, 250, 71)
    asked = small_run.scenario()
    ends = {"start": (130.0, 73.0), "goal": (230.0, 73.0), "scale": 1.0}
    arctic = asked.model_copy(update={**ends, "region": Region(bbox=ARCTIC.bounds)})
    got = small_run.fetched(asked)
    land = replace(got.land, polygons=(coast,), second_shore=(coast,))
    open_sea = SimplifiedLand((), (), 0, 0, 0.0, 0.0)
    scene = water_of(arctic, land, open_sea)
    sea = [(lon, 72.05) for lon in range(121, 240)]
    for polygons in (scene.land, scene.second_shore):
        for place in scene.projection.to_plane(sea):
            assert not shapely.intersects_xy(np.array(polygons), *place).any()


def test_palawans_extent_has_at_most_twelve_corners() -> None:
    projection = Projection.for_region(PALAWAN, 1000.0)
    assert len(extent_polygon(PALAWAN, projection).exterior.coords) - 1 <= 12


@pytest.mark.parametrize("region", [PALAWAN, shapely.box(-40, 60, -10, 72)])
@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_a_drifter_moves_the_same_way_in_the_plane_and_on_the_globe(
    region: shapely.Polygon, scale: float
) -> None:
    def field(lon: np.ndarray, lat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return 0.3 + 0.02 * (lon - lon.mean()), 0.5 - 0.03 * (lat - lat.mean())

    grid = grid_of(field, 0.25, region)
    projection = Projection.for_region(region, scale)
    bounds = extent_polygon(region, projection).bounds
    current = planar_current(grid, projection, bounds)
    rng = np.random.default_rng(1)
    west, south, east, north = region.bounds
    for lon, lat in rng.uniform((west, south), (east, north), (50, 2)):
        u = 0.3 + 0.02 * (lon - grid.lon.mean())
        v = 0.5 - 0.03 * (lat - grid.lat.mean())
        metres = 100.0
        bearing = np.degrees(np.arctan2(u, v))
        after = GEOD.fwd(lon, lat, bearing, metres)[:2]
        begin, end = projection.to_plane(np.array([(lon, lat), after]))
        drift = (end - begin) / np.linalg.norm(end - begin) * np.hypot(u, v)
        # Speeds are not scaled; directions agree to 0.1 degrees; the resampling adds its own.
        assert np.linalg.norm(current(begin) - drift) < 3e-3


def test_nodes_are_half_of_a_source_cell_apart() -> None:
    projection = Projection.for_region(PALAWAN, 1000.0)
    bounds = extent_polygon(PALAWAN, projection).bounds
    current = planar_current(grid_of(lambda lon, lat: (0 * lon, 0 * lat)), projection, bounds)
    assert isinstance(current, renew.GriddedCurrent), "it does not change"
    half_cell = 0.25 * 111.2
    assert 0.8 * half_cell < np.diff(current.x).max() <= half_cell
    assert 0.8 * half_cell < np.diff(current.y).max() <= half_cell
    assert (current.x[0], current.y[0], current.x[-1], current.y[-1]) == pytest.approx(bounds)


@given(
    hnp.arrays(
        float,
        st.tuples(st.integers(2, 7), st.integers(2, 7), st.just(2)),
        elements=st.floats(-2, 2),
    ),
    st.randoms(use_true_random=False),
)
def test_gaps_are_filled_from_water_only(field: np.ndarray, random: object) -> None:
    ny, nx, _ = field.shape
    gaps = [(j, i) for j in range(ny) for i in range(nx) if random.random() < 0.6]  # type: ignore[attr-defined]
    if len(gaps) == ny * nx:
        gaps.pop()
    holed = field.copy()
    for j, i in gaps:
        holed[j, i] = np.nan
    whole = fill_gaps(holed)
    known = np.isfinite(holed)
    assert np.array_equal(whole[known], field[known])
    assert np.isfinite(whole).all()
    # Land adds nothing of its own: filled values stay in the range of the water's.
    for c in range(2):
        values = field[..., c][known[..., c]]
        assert whole[..., c].min() >= values.min() - 1e-12
        assert whole[..., c].max() <= values.max() + 1e-12
    # The first ring is the plain mean of its neighbours, a loop at a time.
    for j, i in gaps:
        around = [
            field[y, x]
            for y in range(max(j - 1, 0), min(j + 2, ny))
            for x in range(max(i - 1, 0), min(i + 2, nx))
            if (y, x) not in gaps
        ]
        if around:
            assert np.allclose(whole[j, i], np.mean(around, axis=0))


def test_a_current_without_values_is_refused() -> None:
    with pytest.raises(RequestError, match="no values at all"):
        fill_gaps(np.full((3, 3, 2), np.nan))


def test_land_that_the_plane_makes_invalid_is_repaired() -> None:
    """A ring thinner than rounding crosses itself in the plane; unions with it failed once."""
    asked = small_run.scenario(seasons=[small_run.scenario().seasons[1].model_dump()])
    got = small_run.fetched(asked)
    bow = shapely.Polygon([(119.2, 9.2), (119.3, 9.3), (119.3, 9.2), (119.2, 9.3)])
    assert not bow.is_valid
    land = replace(got.land, polygons=(*got.land.polygons, bow), second_shore=(bow,))
    simplified = SimplifiedLand(got.land.polygons, got.land.polygons, 9, 9, 0.0, 0.0)
    (case,) = project(asked, replace(got, land=land), simplified)
    scene = case.water
    for polygons, count in ((scene.land, 4), (scene.second_shore, 2)):
        assert shapely.is_valid(np.array(polygons, dtype=object)).all()
        assert len(polygons) == count
    assert scene.depths is None
    assert case.current_cells is not None
    assert case.current_cells.known.sum() == 8 * 9 - 4
