"""On which side of Palawan the best route goes; and what binds on the README's two voyages.

The side by scale, chart, vessel, season and method. What binds is the room that turns need, or the
offing: each voyage is planned as its page says, and again without padding at the same offing.
"""

import math
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pipeline
import renew
from experiments.environments.coarse import vertices
from experiments.environments.loading import Environment, load_environment, load_spec
from pipeline.machine.store import Store
from pipeline.model import planner_vessel
from pipeline.run import Outcome, run
from pipeline.scenario import catalogue
from pipeline.scenario.loading import load_scenario
from pipeline.stages.choose import room_notes
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


def offing() -> Iterator[Figure]:
    """Yield what turns need, and the turns that meet land with and without padding."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder)
        usv = pipeline.go(
            (120.30, 12.80),
            (116.80, 7.70),
            vessel="usv-7m",
            months=["2024-07"],
            name="usv",
            output=output,
            offline=True,
        )
        yield from _voyage("usv", usv)
        yield from _voyage("usv_bare", _unpadded(usv, output))
        season = run(load_scenario("palawan-season"), output, offline=True)
        yield from _voyage("season", season)
        yield from _voyage("season_bare", _unpadded(season, output))


def _unpadded(outcome: Outcome, output: Path) -> Outcome:
    """The same voyage at the same offing, without padding for turns."""
    planner = outcome.scenario.planner.model_copy(update={"padding": "none"})
    changed = {"planner": planner, "name": f"{outcome.scenario.name}-bare"}
    return run(outcome.scenario.model_copy(update=changed), output, offline=True)


def _voyage(name: str, outcome: Outcome) -> Iterator[Figure]:
    """Fuel and turns of the best route of each season, and what its room is for."""
    seasons = [season.name for season in outcome.scenario.seasons]
    for at, season in enumerate(seasons):
        key = f"{name}_{season}" if len(seasons) > 1 else name
        best = outcome.result.case(season).measures.routes[0]
        yield quoted(
            f"{key}: fuel, turns, turns that met land",
            **{
                f"{key}_fuel": best.fuel,
                f"{key}_turns": best.trials,
                f"{key}_collisions": best.collisions,
            },
        )
        for note in room_notes(
            outcome.result.water, outcome.result.results[at : at + 1], outcome.scenario.planner
        ):
            values: dict[str, Any] = dict(note.values)
            yield quoted(
                f"{key}: most that turns need, offing, m",
                **{f"{key}_most_padding": values["turns_m"], f"{key}_offing": values["offing_m"]},
            )
