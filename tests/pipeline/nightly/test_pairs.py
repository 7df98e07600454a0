"""Files of pairs: what is not known in them is refused, never dropped."""

from __future__ import annotations

from pathlib import Path

from pipeline.nightly.cases import read_pairs

_HEAD = "start_lon,start_lat,goal_lon,goal_lat,name"
_ROW = "119.90,10.00,120.24,9.96,a"


def _read(folder: Path, text: str) -> tuple[int, list[str]]:
    """Return the number of pairs in a file with a text, and its faults."""
    (folder / "pairs.csv").write_text(text)
    pairs, faults = read_pairs(folder / "pairs.csv", is_planar=False)
    return len(pairs), faults


def test_a_column_that_is_not_known_is_named_with_the_nearest_one(tmp_path: Path) -> None:
    read, faults = _read(tmp_path, f"{_HEAD},vessel,departure\n{_ROW},usv-7m,2026-11-22\n")
    assert read == 0
    assert [fault.partition(":")[0] for fault in faults] == ["pairs.csv, row 1"] * 2
    assert "unknown column 'vessel'" in faults[0]
    assert "unknown column 'departure'" in faults[1]
    _, faults = _read(tmp_path, f"{_HEAD.replace('goal_lat', 'goal_lta')}\n{_ROW}\n")
    assert "unknown column 'goal_lta': did you mean 'goal_lat'?" in faults[0]
    assert "has no column goal_lat" in faults[1]


def test_semicolons_are_refused_with_a_remedy_that_works(tmp_path: Path) -> None:
    head, row = _HEAD.replace(",", ";"), _ROW.replace(",", ";").replace(".", ",")
    read, faults = _read(tmp_path, f"{head}\n{row}\n")
    assert read == 0
    (fault,) = faults
    assert fault.startswith(
        "pairs.csv, row 1: is separated by ';'; separate by commas, with points"
    )
    mended = row.replace(",", ".").replace(";", ",")
    assert _read(tmp_path, f"{_HEAD}\n{mended}\n") == (1, [])
