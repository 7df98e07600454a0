"""The plane against geodesics, finite differences and PROJ's own factors, all over the globe."""

import pickle
from dataclasses import replace

import numpy as np
import pyproj
import pytest
import shapely
from dask.base import tokenize
from hypothesis import given, settings, strategies as st

from pipeline.errors import RequestError
from pipeline.geo.projection import (
    DepthCover,
    KnownCells,
    Projection,
    cut,
    densified,
    position_text,
    rotated,
    share_without,
)
from tests.true_scale import GEOD

# Every row of the module's table, both hemispheres, 70 N, across 180 degrees, and a pole.
REGIONS = {
    "palawan": (115.5, 7.0, 122.0, 13.5),
    "chile, tall": (-76.0, -45.0, -73.0, -30.0),
    "bering, across 180, to 70 N": (170.0, 58.0, 195.0, 70.0),
    "barents, wide, 70 N": (5.0, 68.0, 55.0, 74.0),
    "fiji, small, across 180": (176.0, -19.0, 183.0, -15.0),
    "south pacific, wide, across 180": (165.0, -30.0, 195.0, -18.0),
    "indonesia, equatorial": (100.0, -6.0, 140.0, 5.0),
    "north pole": (-180.0, 84.0, 180.0, 90.0),
    "weddell, wide, 76 S": (-60.0, -78.0, 0.0, -74.5),
    "far east": (120.0, 20.0, 150.0, 45.0),
}
FORMS = {
    "palawan": "tmerc",
    "chile, tall": "tmerc",
    "bering, across 180, to 70 N": "tmerc",
    "barents, wide, 70 N": "lcc",
    "fiji, small, across 180": "tmerc",
    "south pacific, wide, across 180": "lcc",
    "indonesia, equatorial": "merc",
    "north pole": "stere",
    "weddell, wide, 76 S": "stere",
    "far east": "lcc",
}

shares = st.floats(0.02, 0.98)
points_in = st.tuples(shares, shares)
regions = pytest.mark.parametrize("name", REGIONS)


def _projection(name: str, scale: float = 1.0) -> Projection:
    return Projection.for_region(shapely.box(*REGIONS[name]), scale)


def _point(name: str, share: tuple[float, float]) -> np.ndarray:
    west, south, east, north = REGIONS[name]
    return np.array([west + share[0] * (east - west), south + share[1] * (north - south)])


@regions
def test_the_form_follows_the_shape(name: str) -> None:
    assert f"+proj={FORMS[name]} " in _projection(name).crs


@regions
@settings(max_examples=25, deadline=None)
@given(share=points_in, scale=st.sampled_from([1.0, 15.0, 1000.0]))
def test_round_trip(name: str, share: tuple[float, float], scale: float) -> None:
    projection, point = _projection(name, scale), _point(name, share)
    planar = projection.to_plane(point)
    back = projection.to_lonlat(planar)
    assert back[0] == pytest.approx(point[0], abs=1e-8), "continuous longitudes, none jumps by 360"
    _, _, apart = GEOD.inv(*point, *back)
    assert apart < 1e-6
    again = projection.to_plane(back)
    assert np.linalg.norm(again - planar) * scale < 1e-6


@regions
@settings(max_examples=15, deadline=None)
@given(share=points_in, azimuth=st.floats(-180, 180), speed=st.floats(0.1, 5))
def test_vectors_turn_as_the_plane_does(
    name: str, share: tuple[float, float], azimuth: float, speed: float
) -> None:
    # Oracle: walk 50 m along the geodesic and look where that leads in the plane.
    projection, point = _projection(name, 1000.0), _point(name, share)
    lon, lat = point
    forth = GEOD.fwd(lon, lat, azimuth, 50.0)[:2]
    back = GEOD.fwd(lon, lat, azimuth + 180, 50.0)[:2]
    step = projection.to_plane(forth) - projection.to_plane(back)
    uv = speed * np.array([np.sin(np.radians(azimuth)), np.cos(np.radians(azimuth))])
    turned = rotated(uv, projection.rotation_rad(point))
    assert np.linalg.norm(turned) == pytest.approx(speed)
    off = np.cross(np.append(step, 0), np.append(turned, 0))[2]
    assert np.degrees(np.arctan2(off, step @ turned)) == pytest.approx(0, abs=2e-3)
    assert projection.rotate_to_lonlat(point, turned) == pytest.approx(uv)


@regions
def test_conformal_with_the_scale_that_it_says(name: str) -> None:
    projection = _projection(name)
    points = np.array([_point(name, (x, y)) for x in (0, 0.3, 1) for y in (0, 0.4, 0.99)])
    factors = pyproj.Proj(projection.crs).get_factors(points[:, 0], points[:, 1])
    assert np.max(factors.angular_distortion) < 1e-5
    assert projection.point_scale(points) == pytest.approx(factors.meridional_scale, abs=1e-7)
    assert projection.convergence(points) == pytest.approx(factors.meridian_convergence, abs=1e-5)


@regions
@settings(max_examples=15, deadline=None)
@given(share=points_in, azimuth=st.floats(-180, 180))
def test_lengths_over_600_km(name: str, share: tuple[float, float], azimuth: float) -> None:
    # A geodesic's planar length, each step over the point scale in its middle, is its true length.
    projection, point = _projection(name, 1000.0), _point(name, share)
    metres = np.linspace(0, 600_000, 61)
    lon, lat, azimuths = np.tile(np.append(point, azimuth), (61, 1)).T
    lonlat = np.column_stack(GEOD.fwd(lon, lat, azimuths, metres)[:2])
    xy = projection.to_plane(lonlat)
    steps = np.linalg.norm(np.diff(xy, axis=0), axis=1) * projection.scale
    middle = projection.to_lonlat((xy[1:] + xy[:-1]) / 2)
    assert (steps / projection.point_scale(middle)).sum() == pytest.approx(600_000, rel=1e-5)
    assert projection.geodesic_length_m(xy) == pytest.approx(600_000, rel=1e-6)


@pytest.mark.parametrize(
    ("bounds", "start", "azimuth"),
    [
        ((118.0, 22.0, 148.0, 45.0), (120.0, 23.5), 45.0),
        ((-20.0, -45.0, 20.0, -20.0), (-16.0, -40.0), 65.0),
        ((-40.0, 62.0, 40.0, 78.0), (-34.0, 68.0), 50.0),
        ((160.0, -30.0, 200.0, 5.0), (164.0, -26.0), 60.0),
        ((150.0, 45.0, 200.0, 66.0), (153.0, 48.0), 50.0),
        ((100.0, -8.0, 130.0, 9.0), (102.0, -6.0), 75.0),
    ],
    ids=["north", "south", "at 70 N", "across 180, south", "across 180, north", "equator"],
)
def test_lengths_and_directions_over_3000_km(
    bounds: tuple[float, float, float, float], start: tuple[float, float], azimuth: float
) -> None:
    projection = Projection.for_region(shapely.box(*bounds), 2000.0)
    end = GEOD.fwd(*start, azimuth, 3_000_000)[:2]
    assert projection.geodesic_length_m(projection.to_plane([start, end])) < 3_003_000
    # What a user sees of one straight leg: its line in steps of 3 km, each held against WGS 84.
    ends = projection.to_plane([start, end])
    share = np.linspace(0, 1, 1001)[:, None]
    xy = ends[:1] * (1 - share) + ends[1:] * share
    lon, lat = projection.to_lonlat(xy).T
    forth, _, steps = GEOD.inv(lon[:-1], lat[:-1], lon[1:], lat[1:])
    assert projection.geodesic_length_m(ends) == pytest.approx(steps.sum(), rel=1e-6)
    # Planar lengths need the point scale, and with it are right.
    planar = np.linalg.norm(np.diff(xy, axis=0), axis=1) * projection.scale
    middles = np.stack([(lon[1:] + lon[:-1]) / 2, (lat[1:] + lat[:-1]) / 2], axis=-1)
    assert (planar / projection.point_scale(middles)).sum() == pytest.approx(steps.sum(), rel=1e-5)
    # The leg's course in the plane, turned to true north at every step.
    ahead = np.broadcast_to(ends[1] - ends[0], middles.shape)
    east, north = projection.rotate_to_lonlat(np.stack([lon, lat], axis=-1)[:-1], ahead).T
    off = (np.degrees(np.arctan2(east, north)) - forth + 180) % 360 - 180
    # A step of 3 km turns by less than 0.03 degrees from its start to its middle.
    assert np.abs(off).max() < 0.05


@regions
def test_scale_is_balanced_and_the_plane_is_centred(name: str) -> None:
    projection = _projection(name)
    west, south, east, north = REGIONS[name]
    grid = np.stack(
        np.meshgrid(np.linspace(west, east, 15), np.linspace(south, north, 15)), axis=-1
    )
    scale = projection.point_scale(grid)
    assert scale.max() < 1.016
    assert scale.max() - 1 == pytest.approx(1 - scale.min(), rel=0.5)
    if FORMS[name] != "stere":
        middle = projection.to_plane([(west + east) / 2, (south + north) / 2])
        assert np.linalg.norm(middle) < 1.0


def test_either_way_of_counting_longitudes_gives_the_same_place() -> None:
    projection = _projection("fiji, small, across 180")
    assert projection.to_plane([-178.5, -17]) == pytest.approx(projection.to_plane([181.5, -17]))
    assert projection.to_lonlat(projection.to_plane([-178.5, -17]))[0] == pytest.approx(181.5)


def test_scale_divides_metres_and_only_them() -> None:
    true, small = _projection("palawan"), _projection("palawan", 1000.0)
    point = np.array([[119.0, 10.0], [120.0, 12.0]])
    assert small.to_plane(point) * 1000 == pytest.approx(true.to_plane(point))
    assert small.point_scale(point) == pytest.approx(true.point_scale(point))
    assert small.rotation_rad(point) == pytest.approx(true.rotation_rad(point))


def test_geometries_there_and_back() -> None:
    projection = _projection("palawan", 1000.0)
    lake = [(118.3, 9.2), (118.6, 9.2), (118.5, 9.5)]
    island = shapely.Polygon([(118, 9), (119, 9), (118.6, 10)], [lake])
    planar = projection.geometry_to_plane(island)
    assert shapely.equals_exact(projection.geometry_to_lonlat(planar), island, 1e-9)
    both = projection.geometry_to_plane(np.array([island, island], dtype=object))
    assert shapely.equals(both[0], planar)
    assert shapely.equals(both[1], planar)


def test_long_edges_follow_the_globe_when_densified() -> None:
    # Along a parallel at 60 N the chord of 20 degrees is off by tens of km.
    projection = Projection.for_region(shapely.box(0, 58, 20, 62))
    parallel = shapely.LineString([(0, 60), (20, 60)])
    plain = projection.geometry_to_plane(parallel)
    fine = projection.geometry_to_plane(parallel, densify_m=5_000)
    assert shapely.hausdorff_distance(plain, fine) > 20_000
    back = shapely.get_coordinates(projection.geometry_to_lonlat(fine, densify_m=1_000))
    assert np.abs(back[:, 1] - 60).max() < 1e-4
    assert len(back) > len(fine.coords)


def test_origin_at_a_point() -> None:
    projection = Projection.at(0.0, 0.0, 10.0)
    assert projection.to_plane([0, 0]) == pytest.approx([0, 0], abs=1e-9)
    assert projection.point_scale([0.0, 0.0]) == pytest.approx(1)
    # 100 planar metres north are 1 km at 1:10.
    _, _, apart = GEOD.inv(0, 0, *projection.to_lonlat([0, 100]))
    assert apart == pytest.approx(1000, rel=1e-6)


def test_regions_and_scales_that_make_no_sense_are_refused() -> None:
    with pytest.raises(RequestError, match="keep latitudes"):
        Projection.for_region(shapely.box(0, 80, 10, 95))
    with pytest.raises(RequestError, match="one turn"):
        Projection.for_region(shapely.box(-200, 0, 200, 10))
    with pytest.raises(RequestError, match="scale is 0"):
        Projection.for_region(shapely.box(0, 0, 1, 1), 0.0)
    with pytest.raises(RequestError, match="can't be projected"):
        _projection("palawan").to_plane([[120.0, 10.0], [120.0, 95.0]])


def test_equal_picklable_and_named_by_its_value() -> None:
    projection = _projection("palawan", 1000.0)
    projection.to_plane([120, 10])
    twin = pickle.loads(pickle.dumps(projection))  # noqa: S301  # our own bytes
    assert twin == projection == _projection("palawan", 1000.0)
    assert tokenize(twin) == tokenize(projection)
    assert hash(twin) == hash(projection)
    other = replace(projection, scale=999.0)
    assert other != projection
    assert tokenize(other) != tokenize(projection)
    assert twin.to_plane([120, 10]) == pytest.approx(projection.to_plane([120, 10]))


@regions
def test_the_crs_is_the_plane_in_true_metres(name: str) -> None:
    projection = _projection(name, 1000.0)
    point = _point(name, (0.7, 0.6))
    there = pyproj.Transformer.from_crs("OGC:CRS84", projection.crs, always_xy=True)
    assert np.array(there.transform(*point)) / 1000 == pytest.approx(projection.to_plane(point))


def test_a_path_is_cut_leg_by_leg() -> None:
    """Legs without length and whole multiples of the limit included; the old points all stay."""
    path = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 4.0], [3.0, 14.0], [3.1, 14.0]])
    ends, first = cut(path, 2.5)
    assert first.tolist() == [0, 2, 3, 7]
    assert ends[[*first, -1]].tolist() == path.tolist()
    apart = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    assert apart == pytest.approx([2.5, 2.5, 0.0, 2.5, 2.5, 2.5, 2.5, 0.1])
    assert densified(path, 2.5).tolist() == ends.tolist()
    assert cut(path, np.inf)[0].tolist() == path.tolist()


# --- Positions as text, and where something is known on a grid ---


@pytest.mark.parametrize(
    ("lon", "lat", "text"),
    [
        (119.871, 11.5244, "119.8710 E 11.5244 N"),
        (-70.9815, 42.3427, "70.9815 W 42.3427 N"),
        (-5.25, -36.5, "5.2500 W 36.5000 S"),
        (181.5, -17.0, "178.5000 W 17.0000 S"),
        (-181.0, 0.0, "179.0000 E 0.0000 N"),
    ],
)
def test_a_position_is_given_by_its_hemispheres(lon: float, lat: float, text: str) -> None:
    assert position_text(lon, lat) == text


# --- Cells with figures, and the share of a path outside them ---


LON, LAT = np.arange(5), np.array([10.0, 11.0, 12.0])
KNOWN = np.ones((3, 5), dtype=bool)
KNOWN[1, 2] = KNOWN[0, 0] = False
CELLS = KnownCells(LON.astype(float), LAT, KNOWN)


def test_a_cell_reaches_halfway_to_the_next_node() -> None:
    for place, expected in (
        ((2.0, 11.0), False),
        ((2.49, 11.49), False),
        ((2.51, 11.0), True),
        ((-0.49, 9.51), False),
        ((4.49, 12.49), True),
        ((4.51, 12.0), False),
        ((0.0, 9.4), False),
    ):
        assert CELLS.at(np.array([place])).tolist() == [expected], place


def test_areas_and_cells_count_together() -> None:
    cover = DepthCover((shapely.box(1.5, 10.5, 2.2, 11.5),), CELLS)
    places = np.array([(2.0, 11.0), (2.4, 11.0), (3.0, 11.0), (9.0, 11.0)])
    assert cover.at(places).tolist() == [True, False, True, False]
    assert DepthCover((shapely.box(8, 10, 10, 12),)).at(places).tolist() == [False] * 3 + [True]


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_the_share_is_that_of_the_length(scale: float) -> None:
    projection = Projection.for_region(shapely.box(0, 10, 4, 12), scale)
    path = projection.to_plane([(1.0, 11.0), (4.0, 11.0), (4.0, 12.0)])
    lengths = [projection.geodesic_length_m(path[i : i + 2]) for i in (0, 1)]
    share = share_without(path, projection, CELLS.at)
    assert share == pytest.approx(lengths[0] / 3 / sum(lengths), abs=2e-4)
    assert share_without(path, projection, lambda places: np.ones(len(places), dtype=bool)) == 0
