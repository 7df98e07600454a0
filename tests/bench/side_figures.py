"""On which side of Palawan the best route goes, by scale, chart, vessel, season and method."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import renew
from experiments.environments.coarse import vertices
from experiments.environments.loading import Environment, load_environment, load_spec
from pipeline.machine.store import Store
from pipeline.model import planner_vessel
from pipeline.scenario import catalogue
from renew.voyage.voyage import Voyage, Waters
from tests.bench.figure import Figure, quoted

SCALES = (5000, 4000, 3000, 2000, 1000, 1)
SPEEDS_M_S = (2.0, 2.5, 3.0)
"""Speeds of the paper's vessel at true scale, beside its own of 1 m/s."""
SEEDS = range(10)
_AS_PUBLISHED = {"method": "sampled", "samples": 500, "order": "depth-first"}


def figures() -> Iterator[Figure]:
    """Yield the fuel of the best route on each side; a side that is shut has none."""
    spec = load_spec("palawan-as-published")
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder))
        scaled = {
            scale: load_environment(spec.model_copy(update={"scale": scale}), store)
            for scale in SCALES
        }
    for scale, environment in scaled.items():
        for case in spec.cases[:2]:
            yield _sides(environment, f"at_{scale}_{case.season}", environment.voyage(case))
        still = Waters(environment.result.water.chart, renew.UniformCurrent(0.0, 0.0))
        voyage = replace(environment.voyage(spec.cases[0]), waters=still)
        yield _sides(environment, f"at_{scale}_still", voyage)
        yield _vertices(f"at_{scale}", voyage)
    own = scaled[1].result.cases[0].case.vessel
    vessels = {f"speed_{10 * speed:.0f}": replace(own, speed=speed) for speed in SPEEDS_M_S}
    vessels["usv"] = planner_vessel(catalogue.vessel("usv-7m"))
    for key, vessel in vessels.items():
        for case in spec.cases[:2]:
            voyage = replace(scaled[1].voyage(case), vessel=vessel)
            yield _sides(scaled[1], f"{key}_{case.season}", voyage)
    for case in spec.cases[2:]:
        voyage, key = scaled[5000].voyage(case), case.name.replace("-", "_")
        yield _vertices(key, voyage)
        yield _sides(scaled[5000], key, voyage)
        yield _as_published(scaled[5000], key, voyage)


def _vertices(key: str, voyage: Voyage) -> Figure:
    """Vertices of a chart."""
    return quoted(f"{key}: vertices", **{f"{key}_vertices": vertices(voyage.chart)})


def _sides(environment: Environment, key: str, voyage: Voyage) -> Figure:
    """Fuel of the best route on each side."""
    best: dict[str, float] = {}
    for route in _plan(environment, voyage).routes:
        side = environment.side(route.path)
        best[side] = min(route.fuel, best.get(side, math.inf))
    name = f"{key}: {', '.join(sorted(best, key=best.__getitem__))}"
    return quoted(name, **{f"{key}_{side}": fuel for side, fuel in best.items()})


def _as_published(environment: Environment, key: str, voyage: Voyage) -> Figure:
    """Number of seeds whose choice by the harmonic mean of random chains goes east."""
    plans = [_plan(environment, voyage, **_AS_PUBLISHED, seed=seed) for seed in SEEDS]
    east = sum(environment.side(plan.best.path) == "east" for plan in plans)
    return quoted(f"{key}: seeds that go east as published", **{f"{key}_east_seeds": east})


def _plan(environment: Environment, voyage: Voyage, **options: object) -> renew.Plan:
    """A plan with the environment's options."""
    options |= environment.options(environment.spec.cases[0])
    ends = voyage.start, voyage.goal
    return renew.plan(voyage.chart, voyage.current, voyage.vessel, *ends, **options)  # type: ignore[arg-type]
