"""Damaged charts, currents and depths end a run with some lines, whatever the libraries do."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from pipeline.sources.current_field import LandMask
from tests.robustness.campaign import draw, number
from tests.robustness.damaged_files import damaged_scenario, make_originals
from tests.robustness.renew_processes import Renew


def failures(folder: Path, originals: dict[str, Path], cases: range, renew: Renew) -> list[str]:
    """Run scenarios on damaged files; describe what went wrong."""
    found, kinds = [], list(originals)
    for case in cases:
        rng, place = draw("damaged files", case), folder / str(case)
        what = damaged_scenario(rng, originals, kinds[case % len(kinds)], place)
        arguments = ["run", "damaged.toml", "--offline"]
        ended = renew(arguments, place, limit_s=40.0)
        if why := ended.fault():
            found.append(f"damaged file {case}, {what}: {why}")
        shutil.rmtree(place)
    return found


@pytest.mark.slow
def test_many_damaged_files(tmp_path: Path, shared: Path) -> None:
    cells = shared / "data" / "charts"
    (tmp_path / "originals").mkdir()
    originals = make_originals(
        tmp_path / "originals", LandMask.world(), cells if cells.is_dir() else None
    )
    files = number("damaged_files", 200)
    with Renew() as renew:
        found = failures(tmp_path, originals, range(files), renew)
        print(f"{files} damaged files: {dict(renew.met)}")  # noqa: T201
    assert not found, "\n".join(found)
    assert renew.met["exit 0"] > files / 20
    assert renew.met["exit 2"] + renew.met["exit 1"] > files / 4
