"""A power cut at any moment of a run: what is published is whole, and is mended next."""

from pathlib import Path

import pytest

from tests.pipeline.processes import renew
from tests.pipeline.small_plane import small_plane
from tests.robustness.power_cuts import Cuts, has_strace

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not has_strace(), reason="needs strace, and the right to use it"),
]


def test_a_power_cut_in_a_run(tmp_path: Path) -> None:
    from pipeline.run import run
    from pipeline.scenario.loading import load_scenario

    output, file = tmp_path / "out", tmp_path / "plane.toml"
    file.write_text(small_plane("plane"))
    run(load_scenario(str(file)), output)
    file.write_text(small_plane("plane", classes=2))
    command = renew("run", str(file), "--output", str(output))
    drawn = tmp_path / "out" / "plane" / "figures"
    drawn.mkdir()
    (drawn / "mine.png").write_bytes(b"a figure")
    cuts = Cuts(tmp_path, output, "plane", command)
    assert cuts.new is not None
    expected, metrics = {*cuts.new}, cuts.new["metrics.csv"]

    def again() -> None:
        run(load_scenario(str(file)), output)
        there = {
            str(path.relative_to(output / "plane")): path for path in (output / "plane").rglob("*")
        }
        assert {*there} == expected
        assert all(path.is_dir() or path.stat().st_size for path in there.values())
        assert there["metrics.csv"].read_bytes() == metrics
        assert len(list((output / ".results" / "plane").iterdir())) == 1

    count = cuts.start_again(again)
    print(f"run: {cuts.summary}, {count} starts")  # noqa: T201
