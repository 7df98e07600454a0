"""The world's polygons come from the cache as the package has them; damage and full disks."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

from pipeline.findings.note_words import note_text
from pipeline.sources.land import osm

BOX = shapely.box(-5, -5, 15, 15)
ISLANDS = [shapely.box(x, x, x + 1, x + 1) for x in range(-20, 30, 2)]


def _wkb(*polygons: shapely.Polygon) -> bytes:
    wkb: bytes = shapely.to_wkb(shapely.MultiPolygon(polygons), byte_order=1)
    return wkb


def _texts(near: osm.NearPolygons | None) -> list[str]:
    assert near is not None
    assert near.is_valid.tolist() == shapely.is_valid(near.polygons).tolist()
    return [polygon.wkt for polygon in near.polygons]


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
    assert len(found.polygons) == 11
    assert "Not a directory" in note_text(note)
    monkeypatch.setattr(osm, "user_cache", lambda: None)
    found, (note,) = osm.polygons_near("Osm", BOX)
    assert len(found.polygons) == 11
    assert "there is no home" in note_text(note)


def test_what_killed_processes_left_is_removed(cache: Path) -> None:
    cache.parent.mkdir(parents=True)
    old, new = (cache.with_name(f".{cache.name}.{name}.tmp") for name in ("old", "new"))
    for path in (old, new):
        path.touch()
    os.utime(old, (0, 0))
    osm.polygons_near("Osm", BOX)
    assert sorted(cache.parent.iterdir()) == sorted([cache, new])


def test_several_processes_may_make_it_at_once(cache: Path, root: Path) -> None:
    script = """
import shapely
from pipeline.sources.land import osm
from tests.pipeline.sources.land.test_world import BOX, ISLANDS, _wkb
osm.unpacked = lambda _: _wkb(*ISLANDS)
for _ in range(20):
    found, notes = osm.polygons_near("Osm", BOX)
    assert notes == () and len(found.polygons) == 11
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
        assert [p.wkb for p in cached.polygons] == [p.wkb for p in direct.polygons]
        assert cached.is_valid.tolist() == direct.is_valid.tolist()
        assert len(direct.polygons)
