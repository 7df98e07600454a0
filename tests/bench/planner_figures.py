"""Figures of the planner: padding, the gyre, random scenes, first classes, times."""

import statistics
from collections.abc import Iterator, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np

import renew
from renew.classes.h_signature import Rays, name
from renew.turns.turn_reach import turn_reach
from tests.bench.clock import Took, warm
from tests.bench.figure import Figure, at_most, quoted
from tests.class_oracle import paths_by_class
from tests.oracles import grid_dijkstra, tighten
from tests.published import ABLATION, FOUR_GYRE, GYRE
from tests.strategies import PAPER_VESSEL, SIZE, Scene, random_scene, single_gyre

Method: TypeAlias = Literal["optimal", "sampled"]

CURRENT_AT_EDGE = 0.255
"""The current (m/s) towards or away from an edge for which both published paddings are met."""
SAMPLES = 500
"""Chains a class of the sampled method, as published."""
ORACLE_SPACING = 4.0
"""Of the oracle's grid (m), before its path is tightened."""
CLASSES = 16
"""Number of first classes that are looked for."""
LABELS = 24
"""Classes that their oracle follows: those that wind about islands are among them."""
CELLS = 100
"""Cells a side of its grid."""


def paddings() -> Iterator[Figure]:
    """The published pair of paddings, travelling along an edge."""
    north = np.array([0.0, 1.0])
    for sense, published in ((1, 4.47), (-1, 1.96)):
        current = sense * CURRENT_AT_EDGE * north
        padding = float(turn_reach(PAPER_VESSEL, np.asarray(0.0), current, north))
        off = abs(padding / published - 1)
        towards = "towards" if sense > 0 else "away from"
        yield Figure(
            f"padding, {CURRENT_AT_EDGE} m/s {towards} the edge",
            f"{published} m within 5 %",
            f"{padding:.2f} m ({off:.1%} off)",
            off <= 0.05,
            {"towards" if sense > 0 else "away": padding},
        )


def single_gyre_fuel() -> Iterator[Figure]:
    """Fuel of the optimal method on the published single gyre (paper: 96.08)."""
    scene = single_gyre()
    bare = scene.plan(padding="none").best
    name = "single gyre, no padding"
    yield at_most(f"{name}: fuel", bare.fuel, 84.8, key="unpadded")
    gap = 100 * bare.optimality_gap
    yield at_most(f"{name}: optimality gap", gap, 3, " %", key="unpadded_gap")
    yield quoted("single gyre: bound", bound=bare.fuel / (1 + bare.optimality_gap))
    route = scene.plan(padding="none", clearance=12.55).best
    yield at_most("single gyre, clearance 12.55 m: fuel", route.fuel, 89.6, key="at_12_55")
    route = scene.plan().best
    name = "single gyre, adaptive"
    yield at_most(f"{name}, risk 0.05: fuel", route.fuel, 88.5, key="fuel")
    yield quoted(f"{name}: length and clearance", length=route.length, clearance=route.clearance)
    yield quoted(f"{name}: optimality gap, %", gap=100 * route.optimality_gap)
    yield quoted("single gyre, crab drift: fuel", crab=scene.plan(drift="crab").best.fuel)
    # Hard-over turns, over ten seeds of the draws.
    reports = [scene.turns(route, seed=seed) for seed in range(10)]
    collisions, trials = sum(r.collisions for r in reports), sum(r.trials for r in reports)
    yield Figure(
        f"{name}: contingency collisions",
        "0",
        f"{collisions} of {trials}",
        collisions == 0,
        {"collisions": collisions, "turns": trials},
    )


def sampled_method() -> Iterator[Figure]:
    """The paper's own method on its scenes, beside what it published: ten seeds each."""
    for scene in (GYRE, FOUR_GYRE, *ABLATION):
        best, collisions, trials = [], 0, 0
        for seed in range(10):
            route = scene.plan(method="sampled", samples=SAMPLES, seed=seed).best
            best.append(route.fuel)
            if scene.options.get("padding", "adaptive") == "adaptive":
                report = renew.contingency(route, scene.chart, scene.current, PAPER_VESSEL)
                collisions, trials = collisions + report.collisions, trials + report.trials
        name, key = (
            f"{scene.name}, sampled, ten seeds",
            "gyre_4" if scene is FOUR_GYRE else scene.name.replace(" ", "_"),
        )
        median = statistics.median(best)
        yield at_most(f"{name}: median fuel", median, scene.median, key=f"{key}_median")
        yield at_most(f"{name}: worst fuel", max(best), scene.worst, key=f"{key}_worst")
        yield Figure(
            f"{name}: contingency collisions", "0", f"{collisions} of {trials}", collisions == 0
        )


def random_scenes() -> Iterator[Figure]:
    """Fuel on twenty random scenes beside the oracle's, and the largest optimality gap."""
    dearer, gaps = [], []
    for seed in range(20):
        scene = random_scene(seed)
        route = scene.plan(padding="none").best
        _, path = grid_dijkstra(*scene.asked, ORACLE_SPACING)
        least, _ = tighten(path, scene.chart, scene.current, PAPER_VESSEL)
        dearer.append(route.fuel / least)
        gaps.append(route.optimality_gap)
    name = "random scenes, no padding"
    dearest = max(dearer)
    yield at_most(f"{name}: dearest beside the oracle", dearest, 1.005, digits=4, key="dearest")
    yield quoted(f"{name}: above the oracle, %", above=100 * (dearest - 1))
    yield at_most(f"{name}: largest optimality gap", 100 * max(gaps), 5, " %", key="largest_gap")


def first_classes() -> Iterator[Figure]:
    """How many of the true first classes are among the first that are planned.

    The oracle's grid can't pass the narrowest straits: a class that only the planner finds is as
    true as its fuel, and is counted for itself.
    """
    for islands in (7, 25, 50):
        shared, unseen = [], []
        for seed in range(3):
            scene = random_scene(seed, islands=islands)
            found = paths_by_class(*scene.asked, SIZE / CELLS, labels=LABELS)
            rays, least = Rays.of(scene.chart), dict[str, float]()
            for fuel, path in found:  # the least first
                least.setdefault(name(rays.word(path)), fuel)
            plan = scene.plan(padding="none", classes=CLASSES)
            ours = {route.homotopy: route.fuel for route in plan.routes}
            both = ours | least
            true = sorted(both, key=lambda one: both[one])[:CLASSES]
            shared.append(sum(one in ours for one in true))
            unseen.append(sum(one not in least for one in true))
        text = (
            f"{', '.join(map(str, shared))} (unseen by the oracle: {', '.join(map(str, unseen))})"
        )
        asked = "at least 14" if islands > 7 else ""
        is_met = min(shared) >= 14 if asked else None
        yield Figure(f"of the true first {CLASSES} classes, {islands} islands", asked, text, is_met)


def times() -> Iterator[Figure]:
    """Yield the time of a plan, warm, and its ratio to the sampled method's in the same run."""
    yield from _time("single gyre, k = 16", 50, [single_gyre()])
    # The slowest of some scenes: one may be an easy one.
    yield from _time("7 islands, k = 16", 200, [random_scene(seed) for seed in range(3)])


def _time(name: str, limit_ms: float, scenes: Sequence[Scene[Any]]) -> Iterator[Figure]:
    """Time of both methods on the scene that is slowest with the optimal one."""

    def run(scene: Scene[Any], method: Method) -> Took:
        return warm(lambda: scene.plan(method=method, samples=SAMPLES))[0]

    optimal, slowest = max(((run(scene, "optimal"), i) for i, scene in enumerate(scenes)))
    yield at_most(f"{name}: time of the optimal method", 1e3 * optimal.wall, limit_ms, " ms", 0)
    sampled = run(scenes[slowest], "sampled")
    yield Figure(
        f"{name}: time as a ratio to the sampled method, N = {SAMPLES}",
        "",
        f"{optimal.wall / sampled.wall:.3f} ({1e3 * sampled.wall:.0f} ms)",
    )
