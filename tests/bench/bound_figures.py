"""Figures of the lower bound on fuel: beside an oracle, and how far below the best routes it is."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from typing import Any

from renew.bounds.fuel_lower_bound import fuel_lower_bound
from tests.bench.clock import warm
from tests.bench.figure import Figure, at_most
from tests.bounded_scenes import SCENES, SEEDS, bounded_scene, eddy_scene
from tests.strategies import Scene, random_scene, single_gyre

RANDOM = range(10)
"""Seeds of the random scenes whose gaps are measured."""


def figures() -> Iterator[Figure]:
    """How often the bound is above the oracle's fuel; the gaps of routes without padding."""
    yield from _beside_oracle()
    yield from _gaps()


def _beside_oracle() -> Iterator[Figure]:
    """How often the bound exceeds the fuel of a path in the water."""
    above, nearest = 0, 0.0
    for seed in SEEDS:
        scene = bounded_scene(seed)
        share = fuel_lower_bound(scene.voyage) / scene.oracle()
        above += share > 1
        nearest = max(nearest, share)
    name = f"bound above the oracle's fuel, {len(SEEDS)} scenes, half with thin walls"
    yield Figure(name, "0", f"{above} (nearest {nearest:.4f})", above == 0)


def _gaps() -> Iterator[Figure]:
    """Gaps of the best routes without padding, and what a bound takes."""
    times: list[float] = []
    yield at_most("single gyre: gap", _gap(single_gyre(), times), 0.5, " %")
    gaps = [_gap(random_scene(seed), times) for seed in RANDOM]
    yield at_most("random scenes: median gap", statistics.median(gaps), 0.6, " %")
    yield at_most("random scenes: largest gap", max(gaps), 1.0, " %")
    yield at_most("these scenes: median CPU of a bound", statistics.median(times), 0.30, " s")
    gaps = [100 * eddy_scene(*spec).plan(padding="none").best.optimality_gap for spec in SCENES]
    yield at_most(f"{len(SCENES)} scenes of small eddies: largest gap", max(gaps), 1.2, " %")


def _gap(scene: Scene[Any], times: list[float]) -> float:
    """Gap (%) of the best route without padding; appends the CPU time of the bound, s."""
    best = scene.plan(padding="none").best.fuel
    time, bound = warm(lambda: fuel_lower_bound(scene.voyage))
    times.append(time.cpu)
    return 100 * (best / bound - 1)
