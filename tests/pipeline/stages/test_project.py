"""Projection to the plane: the extent, and the current."""

from dataclasses import replace

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import given, settings, strategies as st
from hypothesis.extra import numpy as hnp

import renew
from pipeline.errors import RequestError
from pipeline.geo.projection import Projection, rotated
from pipeline.model import Credit, CurrentGrid, SimplifiedLand
from pipeline.model.inputs import bilinear, fill_gaps
from pipeline.scenario.region import Region
from pipeline.sources.current_field import Field, LandMask
from pipeline.sources.land.shapes import box_around
from pipeline.stages.project import extent_polygon, planar_current, project, water_of
from tests.pipeline.formats import small_run
from tests.pipeline.synthetic_currents import coastal, sea
from tests.true_scale import GEOD

PALAWAN = shapely.box(115.5, 7, 122, 13.5)


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


# --- The current in the planner's plane: rotated, bilinear, gaps filled, statistics as its cells'.


CREDIT = Credit("a test", "current", "", "")
REGIONS = {
    "Palawan": shapely.box(115.5, 7, 122, 13.5),
    "60 N": shapely.box(-10, 55, 20, 65),
    "70 N": shapely.box(5, 66, 35, 74),
    "across 180": shapely.box(170, -50, 190, -38),
    "Chile": shapely.box(-80, -55, -65, -40),
    "the pole": shapely.box(-60, 78, 60, 88),
}


def grid_of(field: Field) -> CurrentGrid:
    """Make a season's current of a field."""
    return CurrentGrid(
        "summer", field.lon, field.lat, field.u[None], field.v[None], "2024-07", CREDIT
    )


def around(region: shapely.Polygon, step: float, seed: int = 1) -> Field:
    """Make a sea that reaches two cells beyond a region."""
    west, south, east, north = region.bounds
    lon = np.arange(west - 2 * step, east + 2.5 * step, step)
    lat = np.arange(south - 2 * step, min(north + 2.5 * step, 89.5), step)
    return sea(lon, lat, seed)


def planar(
    grid: CurrentGrid, region: shapely.Polygon, scale: float = 1.0
) -> tuple[renew.GriddedCurrent, Projection]:
    """Put a grid into the region's plane."""
    projection = Projection.for_region(region, scale)
    current = planar_current(grid, projection, extent_polygon(region, projection).bounds)
    assert isinstance(current, renew.GriddedCurrent), "it does not change"
    return current, projection


# --- rotation -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", REGIONS)
@pytest.mark.parametrize("bearing", [0.0, 37.0, 90.0, 200.0])
@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_directions_in_the_plane_are_those_on_the_globe(
    name: str, bearing: float, scale: float
) -> None:
    """Directions of a uniform current, against geodesics of 100 m by PROJ's own library."""
    region = REGIONS[name]
    field = around(region, 1.0)
    east, north = 0.4 * np.sin(np.radians(bearing)), 0.4 * np.cos(np.radians(bearing))
    still = np.zeros((1, *field.u.shape))
    grid = CurrentGrid("s", field.lon, field.lat, still + east, still + north, "", CREDIT)
    current, projection = planar(grid, region, scale)
    plane = pyproj.Transformer.from_crs("OGC:CRS84", projection.crs, always_xy=True)
    west, south, east_end, north_end = region.bounds
    for lon, lat in np.random.default_rng(3).uniform(
        (west, south), (east_end, min(north_end, 85)), (40, 2)
    ):
        after = GEOD.fwd(lon, lat, bearing, 100.0)[:2]
        begin, end = (np.array(plane.transform(*point)) for point in ((lon, lat), after))
        expected = 0.4 * (end - begin) / np.linalg.norm(end - begin)
        found = current(begin[None] / scale)[0]
        assert np.hypot(*found) == pytest.approx(0.4, rel=1e-4), "speeds do not change"
        across = expected[0] * found[1] - expected[1] * found[0]
        assert abs(np.degrees(np.arctan2(across, expected @ found))) < 0.1


# --- bilinear interpolation ---------------------------------------------------------------------


@pytest.mark.parametrize("name", REGIONS)
def test_at_the_sources_nodes_it_has_their_values(name: str) -> None:
    field = around(REGIONS[name], 0.5)
    nodes = np.stack(np.meshgrid(field.lon, field.lat), axis=-1)
    found = bilinear(grid_of(field), nodes)
    assert np.allclose(found, np.stack([field.u, field.v], axis=-1), atol=1e-12)


@given(st.integers(0, 9), st.floats(0, 1), st.floats(0, 1), st.floats(0, 1), st.floats(0, 1))
def test_inside_a_cell_it_is_bilinear(
    seed: int, column: float, row: float, across: float, up: float
) -> None:
    """The textbook's formula, written out for one cell."""
    field = sea(np.arange(110, 113.1, 0.25), np.arange(8, 11.1, 0.25), seed)
    i, j = int(column * (field.lon.size - 2)), int(row * (field.lat.size - 2))
    place = np.array([field.lon[i] + 0.25 * across, field.lat[j] + 0.25 * up])
    weights = np.outer([1 - up, up], [1 - across, across])
    for part, found in zip(
        (field.u, field.v), bilinear(grid_of(field), place[None])[0], strict=True
    ):
        assert found == pytest.approx(float((weights * part[j : j + 2, i : i + 2]).sum()), abs=1e-9)


def test_beyond_the_grid_its_edge_is_held() -> None:
    field = sea(np.arange(110, 113.1, 0.25), np.arange(8, 11.1, 0.25))
    away = bilinear(grid_of(field), np.array([(100.0, 9.0), (111.0, 40.0), (130.0, -20.0)]))
    row, column = np.flatnonzero(field.lat == 9)[0], np.flatnonzero(field.lon == 111)[0]
    expected = [(part[row, 0], part[-1, column], part[0, -1]) for part in (field.u, field.v)]
    assert np.allclose(away.T, expected)


@pytest.mark.parametrize("name", REGIONS)
def test_the_planners_grid_is_the_field_at_its_own_nodes(name: str) -> None:
    region = REGIONS[name]
    grid = grid_of(around(region, 0.25))
    current, projection = planar(grid, region)
    nodes = np.stack(np.meshgrid(current.x, current.y), axis=-1)
    lonlat = projection.to_lonlat(nodes)
    expected = rotated(bilinear(grid, lonlat), projection.rotation_rad(lonlat))
    assert np.allclose(current(nodes), expected, atol=1e-12)
    # Between the nodes the error is small: a tenth of the rms of 0.3 m/s at the source's own nodes.
    places = np.stack(np.meshgrid(grid.lon[3:-3], grid.lat[3:-3][grid.lat[3:-3] < 80]), axis=-1)
    off = current(projection.to_plane(places)) - rotated(
        bilinear(grid, places), projection.rotation_rad(places)
    )
    assert np.sqrt((off**2).sum(axis=-1).mean()) < 0.03


@pytest.mark.parametrize("name", REGIONS)
def test_nodes_stand_at_half_a_cell_whichever_side_is_shorter(name: str) -> None:
    region = REGIONS[name]
    grid = grid_of(around(region, 0.5))
    current, projection = planar(grid, region)
    bounds = extent_polygon(region, projection).bounds
    assert (current.x[0], current.y[0], current.x[-1], current.y[-1]) == pytest.approx(bounds)
    up = 0.5 * 111_195
    across = up * np.cos(np.radians(grid.lat.mean()))
    half = max(min(up, across), up / 4) / 2
    for axis in (current.x, current.y):
        assert 0.8 * half < np.diff(axis).max() <= half * 1.001


# --- gaps ---------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(st.integers(0, 50), st.floats(0.05, 0.9))
def test_values_on_land_do_not_affect_the_water(seed: int, share: float) -> None:
    """Where land has one component or none, the filled field is the same."""
    rng = np.random.default_rng(seed)
    field = rng.uniform(-1, 1, (9, 11, 2))
    land = rng.uniform(size=(9, 11)) < share
    land[4, 5] = False
    first, second = field.copy(), field.copy()
    first[land] = np.nan
    second[land, rng.integers(2)] = np.nan
    assert np.array_equal(fill_gaps(first), fill_gaps(second))
    assert np.array_equal(fill_gaps(first)[~land], field[~land])


def test_a_uniform_stream_along_a_coast_stays_uniform() -> None:
    """If gaps were filled from anything but water, a stream would weaken towards the land."""
    region = REGIONS["Palawan"]
    field = coastal(around(region, 0.25), LandMask.world())
    u = np.where(field.gap, np.nan, 0.3)
    v = np.where(field.gap, np.nan, -0.2)
    assert field.gap.mean() > 0.05
    grid = CurrentGrid("s", field.lon, field.lat, u[None], v[None], "", CREDIT)
    west, south, east, north = region.bounds
    anywhere = np.random.default_rng(0).uniform((west, south), (east, north), (500, 2))
    assert np.allclose(bilinear(grid, anywhere), (0.3, -0.2), atol=1e-12)


# --- statistics ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["Palawan", "60 N", "across 180"])
@pytest.mark.parametrize("size", [4, 8])
def test_a_triangles_statistics_are_those_of_the_sources_cells_in_it(name: str, size: int) -> None:
    """Mean and standard deviation of speed, computed from the cells with their centre inside."""
    region = REGIONS[name]
    step = 0.25
    grid = grid_of(around(region, step))
    current, projection = planar(grid, region)
    places = np.stack(np.meshgrid(grid.lon, grid.lat), axis=-1)
    nodes = projection.to_plane(places).reshape(-1, 2)
    speeds = np.hypot(grid.u, grid.v).ravel()
    extent = shapely.box(current.x[0], current.y[0], current.x[-1], current.y[-1])
    rng = np.random.default_rng(7)
    triangles: list[np.ndarray] = []
    expected: list[tuple[float, float]] = []
    while len(triangles) < 150:
        middle = rng.uniform(extent.bounds[:2], extent.bounds[2:])
        turn = rng.uniform(0, 2 * np.pi) + np.array([0, 2.1, 4.2])
        reach = size * step * 111_195
        corners = middle + reach * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        triangle = shapely.Polygon(corners)
        if extent.contains(triangle):
            inside = shapely.contains_xy(triangle, nodes[:, 0], nodes[:, 1])
            triangles.append(corners)
            expected.append((speeds[inside].mean(), speeds[inside].std()))
    found = current.statistics(np.array(triangles))
    mean, spread = np.array(expected).T
    assert found.speed.mean() == pytest.approx(mean.mean(), rel=0.06)
    assert found.speed_std.mean() == pytest.approx(spread.mean(), rel=0.1)
    assert np.corrcoef(found.speed, mean)[0, 1] > 0.9
    assert np.corrcoef(found.speed_std, spread)[0, 1] > 0.8
