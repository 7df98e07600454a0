"""The cache of downloads: only complete files that match their sidecar are used."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from pipeline.machine.store import file_hash
from pipeline.sources.copernicus.download import CachedDownload

REQUEST = {"a": 1.5, "b": ["x"]}


def saved(folder: Path) -> CachedDownload:
    """Put a file into the cache."""
    cached = CachedDownload(folder / "data_0.083deg_2024-07_abc.nc")
    with cached.staging_folder() as staging:
        staged = staging / cached.file.name
        staged.write_bytes(b"content")
        cached.save(staged, {"request": REQUEST})
    return cached


def test_a_cached_file_is_found_by_its_sidecar(tmp_path: Path) -> None:
    cached = saved(tmp_path)
    metadata = cached.metadata(REQUEST)
    assert metadata is not None
    assert (metadata["sha256"], metadata["bytes"]) == (file_hash(cached.file), 7)
    assert metadata["retrieved_utc"].endswith("+00:00")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "data_0.083deg_2024-07_abc.json",
        "data_0.083deg_2024-07_abc.nc",
    ]


def test_a_cached_file_that_does_not_match_its_sidecar_is_not_used(tmp_path: Path) -> None:
    cached = saved(tmp_path)
    assert cached.metadata({"a": 2}) is None
    cached.file.write_bytes(b"cantent")
    assert cached.metadata(REQUEST) is None
    cached.file.unlink()
    assert cached.metadata(REQUEST) is None
    cached = saved(tmp_path)
    for damaged in ("", "[]", "{}", '{"request": ', json.dumps({"request": REQUEST})):
        cached.sidecar.write_text(damaged)
        assert cached.metadata(REQUEST) is None
    cached.sidecar.unlink()
    assert cached.metadata(REQUEST) is None


def test_staging_folders_of_killed_runs_are_removed_and_those_in_use_are_not(
    tmp_path: Path,
) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        left = [
            tmp_path / f"data_0.083deg.{ended.pid}.0123abcd.partial",
            tmp_path / f"data_0.083deg.{other.pid}.0123abcd.partial",
            tmp_path / f"data_0.083deg.{other.pid}.4567cdef.partial",
        ]
        for folder in left:
            folder.mkdir()
            (folder / "data.nc.XXXXXXXX").write_bytes(b"half")
        # Older than the process that has this id now.
        os.utime(left[2], (0, 0))
        with CachedDownload(tmp_path / "data.nc").staging_folder() as staging:
            assert [path.exists() for path in left] == [False, True, False]
            assert staging.is_dir()
        assert sorted(tmp_path.iterdir()) == [left[1]]
        other.kill()
