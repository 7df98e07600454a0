"""OpenStreetMap's land, from the cache as the package has it; coarse land around a region."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import roaring_landmask
import shapely
from hypothesis import given, settings, strategies as st

from pipeline._types import Geometries
from pipeline.findings.note_words import note_text
from pipeline.sources.land import osm
from pipeline.sources.land.osm import surroundings
from pipeline.sources.land.shapes import box_around, buffered, repaired
from tests.commands import PYTHON, ran
from tests.true_scale import GEOD

PALAWAN = shapely.box(118.6, 9.6, 119.0, 10.0)
WRANGEL = shapely.box(177.5, 70.5, 183.0, 71.8)
FIJI = shapely.box(177.0, -17.5, 182.0, -16.0)
EQUATOR = shapely.box(0.0, 0.0, 10.0, 10.0)


def _wkb(*polygons: shapely.Polygon) -> bytes:
    wkb: bytes = shapely.to_wkb(shapely.MultiPolygon(polygons), byte_order=1)
    return wkb


def _near(wkb: bytes, box: shapely.Polygon) -> list[shapely.Polygon]:
    polygons, _ = osm.clean(osm.read_near(wkb, box), box)
    return list(polygons)


def _real(box: shapely.Polygon) -> tuple[Geometries, int]:
    return osm.clean(osm.polygons_near("Osm", box)[0], box)


def _square(x: float, y: float, size: float = 1.0) -> shapely.Polygon:
    return shapely.box(x, y, x + size, y + size)


def test_land_is_cut_along_the_box_and_islands_stay_whole() -> None:
    mainland, island = _square(-50, -50, 55), _square(7, 7)
    found = _near(_wkb(mainland, island, _square(20, 20)), EQUATOR)
    assert [p.wkt for p in found if p.equals(island)] == [island.wkt]
    assert shapely.union_all(found).equals(shapely.union_all([shapely.box(0, 0, 5, 5), island]))


def test_lakes_are_kept() -> None:
    lake = shapely.Polygon(_square(1, 1, 8).exterior, [_square(3, 3).exterior])
    (found,) = _near(_wkb(lake), EQUATOR)
    assert found.equals(lake)


def test_invalid_polygons_are_repaired_and_counted() -> None:
    bowtie = shapely.Polygon([(1, 1), (3, 3), (3, 1), (1, 3)])
    wkb = _wkb(bowtie, _square(5, 5))
    polygons, repaired = osm.clean(osm.read_near(wkb, EQUATOR), EQUATOR)
    assert repaired == 1
    assert shapely.is_valid(polygons).all()
    assert shapely.union_all(polygons).area == pytest.approx(2 + 1)


def test_duplicates_are_dropped() -> None:
    assert len(_near(_wkb(_square(1, 1), _square(5, 5), _square(1, 1)), EQUATOR)) == 2


@pytest.mark.parametrize("turn", [0, -360])
def test_pieces_on_both_sides_of_180_degrees_become_one(turn: int) -> None:
    box = shapely.box(170 + turn, -5, 190 + turn, 5)
    # Their corners on the seam don't match, as with coasts that were simplified piece by piece.
    found = _near(_wkb(shapely.box(178, -1, 180, 1), shapely.box(-180, -1.2, -179, 0.9)), box)
    (island,) = found
    assert island.bounds == (178 + turn, -1.2, 181 + turn, 1)
    assert not island.interiors


def test_real_land_around_puerto_princesa() -> None:
    polygons, repaired = _real(PALAWAN)
    land = shapely.union_all(polygons)
    for lon, lat, is_land in [
        (118.74, 9.74, True),  # the town
        (118.76, 9.76, True),  # the airport's runway
        (118.70, 9.75, False),  # the bay west of the town
        (118.95, 9.70, False),  # Sulu Sea
    ]:
        assert land.intersects(shapely.Point(lon, lat)) is is_land, (lon, lat)
    assert repaired == 0
    assert shapely.is_valid(polygons).all()


@pytest.mark.parametrize(("region", "islands"), [(WRANGEL, 1), (FIJI, 4)])
def test_real_islands_across_180_degrees_are_whole(region: shapely.Polygon, islands: int) -> None:
    polygons, _ = _real(region)
    west, _, east, _ = shapely.bounds(polygons).T
    assert np.count_nonzero((west < 180) & (east > 180)) >= islands
    # No gap along the seam: just beside it the land is as wide as on it.
    land = shapely.union_all(polygons)
    south, north = region.bounds[1], region.bounds[3]
    on, beside = (
        shapely.LineString([(x, south), (x, north)]).intersection(land).length
        for x in (180.0, 180.0 + 1e-7)
    )
    assert on == pytest.approx(beside, rel=1e-2)
    assert on > 0
    same, _ = _real(shapely.box(-182.5, south, -177.0, north))
    assert len(same) > 0, "the same islands, with longitudes below -180"


def test_credit_names_the_licence_and_the_release() -> None:
    (credit,) = osm.land_polygons(PALAWAN).credits
    assert "© OpenStreetMap contributors" in credit.text
    assert "roaring-landmask 0." in credit.text
    assert credit.licence == "ODbL 1.0"
    assert credit.kind == "land"


@pytest.mark.slow
def test_the_package_s_own_mask_agrees() -> None:
    oracle = roaring_landmask.RoaringLandmask.new_with_provider(
        roaring_landmask.LandmaskProvider.Osm
    )
    for region in (PALAWAN, FIJI, shapely.box(-6, 49.5, -3, 51.5), shapely.box(24, 59, 26, 61)):
        west, south, east, north = region.bounds
        rng = np.random.default_rng(1)
        lon, lat = rng.uniform((west, south), (east, north), (20_000, 2)).T
        land = shapely.union_all(_real(region)[0])
        shapely.prepare(land)
        expected = oracle.contains_many((lon + 180) % 360 - 180, lat)
        ours = shapely.intersects_xy(land, lon, lat)
        # The mask looks at a raster first, and so misses land within half a cell of the coast; what
        # it calls land is land.
        assert not (expected & ~ours).any()
        extra = shapely.distance(land.boundary, shapely.points(lon, lat)[ours & ~expected])
        assert len(extra) < 0.01 * len(ours)
        assert (extra < 0.003).all()


@pytest.mark.slow
def test_memory_stays_low(root: Path) -> None:
    # VmHWM and not ru_maxrss, which a child inherits from the process that started it.
    script = """
import re, pathlib, shapely
from pipeline.sources.land.osm import OsmLand
assert len(OsmLand().land(shapely.box(115.5, 7.0, 122.0, 13.5)).polygons) > 1000
print(re.search(r"VmHWM:\\s*(\\d+) kB", pathlib.Path("/proc/self/status").read_text())[1])
"""
    if not Path("/proc/self/status").exists():
        pytest.skip("needs Linux's /proc to read a process's peak memory")
    done = ran(*PYTHON, script, cwd=root)
    assert int(done) < 600_000


# --- The world's polygons come from the cache as the package has them; damage and full disks.


BOX = shapely.box(-5, -5, 15, 15)
ISLANDS = [shapely.box(x, x, x + 1, x + 1) for x in range(-20, 30, 2)]


def _texts(near: osm.NearPolygons | None) -> list[str]:
    assert near is not None
    polygons, is_valid = near
    assert is_valid.tolist() == shapely.is_valid(polygons).tolist()
    return [polygon.wkt for polygon in polygons]


@settings(max_examples=60)
@given(
    corners=st.lists(st.tuples(st.integers(-170, 160), st.integers(-80, 70)), max_size=12),
    chunk=st.integers(1, 5),
    lakes=st.sampled_from([(), (0,), (0, 2), (7,)]),
    west=st.integers(-180, 170),
    south=st.integers(-85, 75),
)
def test_both_ways_of_reading_find_what_a_plain_reader_finds(
    tmp_path_factory: pytest.TempPathFactory,
    corners: list[tuple[int, int]],
    chunk: int,
    lakes: tuple[int, ...],
    west: int,
    south: int,
) -> None:
    holes = [[(x, x), (x + 1, x), (x, x + 1)] for x in lakes]
    polygons = [
        shapely.Polygon(
            np.add([(-1, -1), (8, -1), (8, 8), (-1, 8)], corner),
            [np.add(ring, corner) for ring in holes],
        )
        for corner in corners
    ]
    box = shapely.box(west, south, west + 9.5, south + 9.5)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(osm, "_CHUNK", chunk)
        found = osm.read_near(_wkb(*polygons), box)
        path = tmp_path_factory.mktemp("cache") / "some.shoreline"
        osm.write_cached(path, _wkb(*polygons))
        cached = osm.read_cached(path, box)
    expected = [p for p in polygons if p.intersects(box)]
    assert sorted(_texts(found)) == sorted(p.wkt for p in expected)
    assert _texts(cached) == _texts(found)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give the file of a small world in a cache of its own, before it is made."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(osm, "unpacked", lambda _: _wkb(*ISLANDS))
    path = osm.cache_file("Osm")
    assert path is not None
    assert path.is_relative_to(tmp_path)
    return path


def test_it_is_unpacked_once(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, notes = osm.polygons_near("Osm", BOX)
    assert notes == ()
    assert os.listdir(cache.parent) == [cache.name]  # noqa: PTH208 - names alone
    monkeypatch.setattr(osm, "unpacked", None)
    second, notes = osm.polygons_near("Osm", BOX)
    assert notes == ()
    assert _texts(first) == _texts(second) == _texts(osm.read_near(_wkb(*ISLANDS), BOX))
    assert osm.remove_cached() > 1000
    assert not cache.exists()


@pytest.mark.parametrize("where", ["head", "table", "polygon", "cut", "empty", "longer"])
def test_a_damaged_file_is_made_again(cache: Path, where: str) -> None:
    whole, _ = osm.polygons_near("Osm", BOX)
    content = cache.read_bytes()
    table = 28 + len(ISLANDS) * 45
    at = {"head": 3, "table": 40, "polygon": table + (len(content) - table) // 2}
    if where in at:
        bad = bytearray(content)
        bad[at[where]] ^= 1
    else:
        bad = bytearray({"cut": content[:-9], "empty": b"", "longer": content + b"x"}[where])
    cache.write_bytes(bad)
    assert osm.read_cached(cache, BOX) is None
    again, notes = osm.polygons_near("Osm", BOX)
    assert notes == ()
    assert _texts(again) == _texts(whole)
    assert cache.read_bytes() == content


def test_without_room_it_is_unpacked_each_time_and_a_note_says_so(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    found, (note,) = osm.polygons_near("Osm", BOX)
    assert _texts(found) == _texts(osm.read_near(_wkb(*ISLANDS), BOX))
    assert "could not be kept in the user's cache" in note_text(note)
    assert "No space left on device" in note_text(note)
    assert list(cache.parent.iterdir()) == []


def test_without_a_home_or_a_folder_a_note_says_so(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache.parent.parent.joinpath("file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache.parent.parent / "file"))
    found, (note,) = osm.polygons_near("Osm", BOX)
    assert len(found[0]) == 11
    assert "Not a directory" in note_text(note)
    monkeypatch.setattr(osm, "user_cache", lambda: None)
    found, (note,) = osm.polygons_near("Osm", BOX)
    assert len(found[0]) == 11
    assert "there is no home" in note_text(note)


def test_what_killed_processes_left_is_removed(cache: Path) -> None:
    cache.parent.mkdir(parents=True)
    old, new = (cache.with_name(f".{cache.name}.{name}.tmp") for name in ("old", "new"))
    for path in (old, new):
        path.touch()
    os.utime(old, (0, 0))
    osm.polygons_near("Osm", BOX)
    assert sorted(cache.parent.iterdir()) == sorted([cache, new])


@pytest.mark.slow
def test_several_processes_may_make_it_at_once(cache: Path, root: Path) -> None:
    script = """
import shapely
from pipeline.sources.land import osm
from tests.pipeline.sources.land.test_osm import BOX, ISLANDS, _wkb
osm.unpacked = lambda _: _wkb(*ISLANDS)
for _ in range(20):
    found, notes = osm.polygons_near("Osm", BOX)
    assert notes == () and len(found[0]) == 11
    osm.write_cached(osm.cache_file("Osm"), _wkb(*ISLANDS))
"""
    running = [
        subprocess.Popen([sys.executable, "-c", script], cwd=root, stderr=subprocess.PIPE)
        for _ in range(2)
    ]
    for process in running:
        assert process.communicate(timeout=60)[1] == b""
        assert process.returncode == 0
    assert list(cache.parent.iterdir()) == [cache]


@pytest.mark.slow
@pytest.mark.parametrize("shoreline", ["Osm", "Gshhg"])
def test_of_the_real_world_both_ways_of_reading_are_equal(shoreline: osm.Shoreline) -> None:
    wkb = osm.unpacked(shoreline)
    for box in (
        shapely.box(115.5, 7.0, 122.0, 13.5),
        shapely.box(177.0, -18.0, 182.0, -16.0),
        shapely.box(-183.0, 70.0, -177.0, 72.0),
        shapely.box(-180.0, -90.0, 180.0, -78.0),
        shapely.box(0.0, 80.0, 60.0, 90.0),
    ):
        cached, notes = osm.polygons_near(shoreline, box)
        assert notes == ()
        direct = osm.read_near(wkb, box)
        assert [p.wkb for p in cached[0]] == [p.wkb for p in direct[0]]
        assert cached[1].tolist() == direct[1].tolist()
        assert len(direct[0])


# --- Land around a region for maps: the world's, coarse ---


CREEK = shapely.box(119.0, 9.0, 120.2, 10.6)  # Palawan's middle, cut on two sides
AROUND_FIJI = shapely.box(177.5, -18.5, 181.5, -16.0)


@pytest.mark.parametrize("region", [CREEK, AROUND_FIJI])
def test_it_is_the_worlds_land_outside_the_region_in_the_regions_longitudes(
    region: shapely.Polygon,
) -> None:
    found = shapely.union_all(surroundings(region))
    side = max(np.subtract(region.bounds[2:], region.bounds[:2]))
    wide = box_around(region, 0.5 * side * 111_000.0)
    fine = shapely.union_all(osm.land_polygons(wide).polygons)
    outside = wide.difference(region)
    assert found.intersection(region).area < 1e-12
    wrong = found.intersection(outside).symmetric_difference(fine.intersection(outside))
    # All of it lies within the detail of a coast.
    assert wrong.buffer(-0.002 * side).is_empty
    assert fine.intersection(outside).area > 0.01


def test_it_is_coarse() -> None:
    beyond_m = 0.75 * 1.6 * 111_195.0
    fine = osm.land_polygons(CREEK, beyond_m).polygons
    coarse = surroundings(CREEK)
    assert all(polygon.is_valid for polygon in coarse)
    vertices = [int(shapely.get_num_coordinates(np.array(one)).sum()) for one in (coarse, fine)]
    assert vertices[0] < 0.3 * vertices[1]


def test_small_polygons_are_left_out_before_they_are_read() -> None:
    whole, some = (osm.polygons_near("Osm", CREEK, least_deg=least)[0][0] for least in (0.0, 0.02))
    bounds = shapely.bounds(whole)
    is_large = (bounds[:, 2:] - bounds[:, :2]).max(axis=1) >= 0.02
    assert 0 < len(some) < len(whole)
    assert shapely.equals_exact(some, whole[is_large]).all()


def test_a_region_at_the_pole_has_surroundings() -> None:
    polar = shapely.box(0.0, 78.0, 40.0, 88.0)
    assert surroundings(polar)


# --- Operations on chart geometries: repair, boxes and buffers in true metres ---


@pytest.mark.parametrize("latitude", [0.0, 60.0, 89.0])
def test_the_box_is_wider_by_metres(latitude: float) -> None:
    region = shapely.box(10, latitude, 11, latitude + 0.5)
    west, south, east, north = box_around(region, 20_000).bounds
    assert 10 - west == pytest.approx(east - 11)
    assert (10 - west) * 111.2 * np.cos(np.radians(north)) >= 19.9
    assert south == pytest.approx(latitude - 0.18, abs=0.01)
    assert north == pytest.approx(latitude + 0.68, abs=0.01)


def test_the_box_is_at_most_360_degrees_wide() -> None:
    assert box_around(shapely.box(-180, 80, 180, 90), 20_000).bounds[2] == 180
    west, _, east, north = box_around(shapely.box(0, 88, 10, 90), 20_000).bounds
    assert east - west == pytest.approx(360)
    assert north == 90


@given(lon=st.floats(-179, 179), lat=st.floats(-80, 80), radius=st.floats(5, 500))
def test_buffered_points_enclose_their_circle(lon: float, lat: float, radius: float) -> None:
    (area,) = buffered(np.array([shapely.Point(lon, lat)], dtype=object), radius)
    edge = shapely.get_coordinates(shapely.segmentize(area.exterior, radius / 2e6))
    _, _, apart = GEOD.inv(np.full(len(edge), lon), np.full(len(edge), lat), *edge.T)
    assert radius * (1 - 1e-4) <= apart.min() < apart.max() < 1.03 * radius


def test_valid_geometries_are_not_repaired() -> None:
    lake = shapely.box(0.4, 0.4, 0.6, 0.6).exterior
    island = shapely.Polygon(shapely.box(0, 0, 1, 1).exterior, [lake])
    valid = np.array([island, shapely.Point(0, 0)], dtype=object)
    same, count = repaired(valid)
    assert same is valid
    assert count == 0
