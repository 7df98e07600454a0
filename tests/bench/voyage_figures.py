"""Time and memory of `renew go` in waters drawn by a seed, each in a process of its own, warm."""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tests.bench.clock import Ran, ran
from tests.bench.drawn_waters import DrawnWater, drawn
from tests.bench.figure import Figure, at_most

SEEDS = range(16)


def figures() -> Iterator[Figure]:
    """Yield what each water takes, then the median and the worst of all."""
    taken = []
    for seed in SEEDS:
        water = drawn(seed)
        try:
            one = voyage(water)
        except RuntimeError as error:
            yield Figure(f"go, {water.name}", "", f"exit code {str(error).split()[-1]}")
            continue
        taken.append(one)
        text = f"{one.wall:.1f} s, CPU {one.cpu:.1f} s, {1000 * one.peak:.0f} MB"
        yield Figure(f"go, {water.name}", "", text)
    wall, cpu, peak = zip(*taken, strict=True)
    yield at_most("go, drawn waters: median of CPU time", statistics.median(cpu), 6, " s")
    yield at_most("go, drawn waters: median of time", statistics.median(wall), 6, " s")
    yield at_most("go, drawn waters: longest time", max(wall), 10, " s")
    yield at_most("go, drawn waters: largest memory", max(peak), 0.6, " GB")


def voyage(water: DrawnWater) -> Ran:
    """Plan a voyage in still water as a user does; RuntimeError where it is refused."""
    with tempfile.TemporaryDirectory() as folder:
        vessel = Path(folder) / "vessel.toml"
        given = {"length_m", "speed_m_s", "turn_rate_deg_s"}
        spec = {"schema_version": 1, **water.spec.model_dump(include=given)}
        lines = [f"{key} = {value}" for key, value in spec.items()]
        names = [f'{key} = "drawn"' for key in ("name", "title", "origin")]
        vessel.write_text("\n".join([*lines, *names]), "utf-8")
        ends = (f"{lon},{lat}" for lon, lat in (water.start, water.goal))
        asked = ("--vessel", str(vessel), "--currents", "still", "--offline", "--output", folder)
        return ran("-m", "pipeline.cli.main", "go", *ends, *asked)
