"""Part files are whole or absent; each case counts once, even where parts overlap."""

from __future__ import annotations

from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import given

from pipeline.errors import StageError
from pipeline.nightly.cycle.part_files import (
    PartFile,
    covering,
    gaps,
    part_path,
    parts_in,
    read_part,
    remove_unfinished,
    write_part,
)

RANGES = st.lists(
    st.tuples(st.integers(0, 40), st.integers(1, 15)).map(lambda t: (t[0], t[0] + t[1])), max_size=8
)


def parts_of(ranges: list[tuple[int, int]]) -> list[PartFile]:
    """Return parts for ranges of cases."""
    parts = [PartFile(Path("part"), first, end) for first, end in ranges]
    return sorted(parts, key=lambda part: (part.first, -part.end))


@given(RANGES)
def test_each_case_is_taken_once_and_the_gaps_are_the_rest(ranges: list[tuple[int, int]]) -> None:
    parts = parts_of(ranges)
    taken = [i for _, first, end in covering(parts) for i in range(first, end)]
    held = {i for first, end in ranges for i in range(first, end)}
    assert taken == sorted(held)
    missing = {i for first, end in gaps(parts, 5, 50) for i in range(first, end)}
    assert missing == set(range(5, 50)) - held


def test_only_whole_parts_count(tmp_path: Path) -> None:
    path = part_path(tmp_path, 3, 5)
    write_part(path, [{"index": 3, "rank": 0, "case": "a"}, {"index": 4, "rank": 0, "case": "b"}])
    assert parts_in(tmp_path) == [PartFile(path, 3, 5)]
    assert read_part(PartFile(path, 3, 5))["case"].to_pylist() == ["a", "b"]

    part_path(tmp_path, 5, 6).write_bytes(path.read_bytes()[:-9])
    flipped = bytearray(path.read_bytes())
    flipped[len(flipped) // 2] ^= 1
    part_path(tmp_path, 6, 7).write_bytes(flipped)
    (tmp_path / ".00000006-00000007.1f.tmp").write_bytes(b"half")
    (tmp_path / "notes.part").write_bytes(path.read_bytes())
    assert parts_in(tmp_path) == [PartFile(path, 3, 5)]
    remove_unfinished(tmp_path)
    assert not list(tmp_path.glob(".*"))


def test_a_missing_folder_is_reported(tmp_path: Path) -> None:
    with pytest.raises(StageError, match=r"can't write 00000000-00000001.part"):
        write_part(part_path(tmp_path / "gone", 0, 1), [{"index": 0, "rank": 0}])
