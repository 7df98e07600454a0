"""A run may be killed at any time: the next one ends as if nothing had happened."""

from __future__ import annotations

import collections
import json
import random
import signal
from pathlib import Path

import numpy as np
import pytest

from tests.pipeline.small_plane import small_plane
from tests.pipeline.small_region import small_region
from tests.pipeline.synthetic_currents import dataset, sea, write
from tests.robustness.killed_runs import (
    EXIT_CODES,
    STAGES,
    Bench,
    killed,
    paths_in,
    results,
    run_to_the_end,
)

SEED = 20_260_111
KILLS = 100
_SIGNALS = tuple(EXIT_CODES)
# Two seasons: between the two versions one is withdrawn, another is new.
_PLANE = small_plane("killed") + '[[seasons]]\nname = "second"\nuniform = { v = 0.1 }\n'
_ISLAND = [[118.45, 10.22], [118.55, 10.22], [118.55, 10.28], [118.5, 10.31], [118.45, 10.28]]
_REGION = (
    small_region("killed")
    + """[chart]
source = {{ path = "./island.geojson", accuracy_m = 50 }}
tolerance_m = 500
[[seasons]]
name = "summer"
valid = "2024-07"
currents = ["embedded-palawan"]
[[seasons]]
name = "{second}"
valid = "{valid}"
currents = ["{currents}"]
[planner]
classes = 2
"""
)


def kill_and_continue(bench: Bench, stage: str, fraction: float, number: signal.Signals) -> str:
    """Kill a run and start it again; check what each leaves, and return where it was killed."""
    output, place = killed(bench, stage, fraction, number)
    what = f"{number.name} {fraction:.2f} through {stage}, killed in {place}"
    assert results(output) in (bench.old, bench.new), f"{what}: results of two runs are mixed"
    run_to_the_end(bench.scenario, output)
    again = results(output)
    assert again.keys() == bench.new.keys(), what
    assert not [name for name in again if again[name] != bench.new[name]], what
    assert paths_in(output) == bench.paths, what
    return place


@pytest.fixture(scope="module")
def plane(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """Give a scenario that has lost a season since its earlier results."""
    earlier = _PLANE.replace('"still"', '"withdrawn"')
    return Bench.prepare(tmp_path_factory.mktemp("plane"), earlier, _PLANE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stage", "fraction", "number", "places"),
    [
        ("plan", 0.5, signal.SIGTERM, {"plan", "evaluate"}),
        ("write", 0.7, signal.SIGKILL, {"write"}),
    ],
)
def test_a_killed_run_continues(
    plane: Bench, stage: str, fraction: float, number: signal.Signals, places: set[str]
) -> None:
    assert kill_and_continue(plane, stage, fraction, number) in places


@pytest.mark.slow
def test_a_hundred_killed_runs_continue(tmp_path: Path) -> None:
    """Kills spread evenly over the stages, each of which meets every signal."""
    shape = {"type": "Polygon", "coordinates": [[*_ISLAND, _ISLAND[0]]]}
    (tmp_path / "island.geojson").write_text(json.dumps(shape))
    field = sea(np.arange(117.0, 121.0, 0.25), np.arange(8.0, 12.0, 0.25))
    write(tmp_path / "sea.nc", dataset(field))
    bench = Bench.prepare(
        tmp_path,
        _REGION.format(second="withdrawn", valid="2024-07-01", currents="./sea.nc"),
        _REGION.format(second="winter", valid="2024-12", currents="embedded-palawan"),
    )
    assert "killed-withdrawn.rtz" in bench.old.keys() - bench.new.keys()
    rng = random.Random(SEED)  # noqa: S311 - a test's seed
    rounds = -(-KILLS // len(STAGES))
    met: collections.Counter[str] = collections.Counter()
    for i in range(KILLS):
        stage, turn = STAGES[i % len(STAGES)], i // len(STAGES)
        fraction = (turn + rng.random()) / rounds
        met[kill_and_continue(bench, stage, fraction, _SIGNALS[turn % len(_SIGNALS)])] += 1
    print(f"{KILLS} kills: {dict(met)}")  # noqa: T201
    assert set(met) >= set(STAGES)  # some meet the stages between them, too
