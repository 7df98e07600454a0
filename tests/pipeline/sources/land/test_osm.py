"""OpenStreetMap's land: cleaning polygons, and the real land."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import roaring_landmask
import shapely

from pipeline._types import Geometries
from pipeline.sources.land import osm

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


def test_far_land_is_not_returned() -> None:
    assert _near(_wkb(_square(50, 50)), EQUATOR) == []


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
    credit = osm.credit()
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
from pipeline.sources.land.osm import land
assert len(land(shapely.box(115.5, 7.0, 122.0, 13.5)).polygons) > 1000
print(re.search(r"VmHWM:\\s*(\\d+) kB", pathlib.Path("/proc/self/status").read_text())[1])
"""
    if not Path("/proc/self/status").exists():
        pytest.skip("needs Linux's /proc to read a process's peak memory")
    done = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True, cwd=root
    )
    assert int(done.stdout) < 600_000
