"""Figures of the planner: padding, the single gyre, time beside the sampled method."""

from __future__ import annotations

import statistics
import time
from typing import TYPE_CHECKING

import numpy as np

import renew
from renew.padding import turn_reach
from tests.bench.figure import Figure, at_most
from tests.strategies import PAPER_VESSEL, random_scene, single_gyre

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

START, GOAL = (10.0, 10.0), (90.0, 90.0)
CURRENT_AT_EDGE = 0.255
"""The current (m/s) towards or away from an edge for which both published paddings are met."""


def figures() -> Iterator[Figure]:
    """Yield the planner's figures, one by one as they are measured."""
    yield from _paddings()
    yield from _single_gyre()
    yield from _sampled()
    yield from _times()


def _paddings() -> Iterator[Figure]:
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
        )


def _single_gyre() -> Iterator[Figure]:
    """Fuel of the optimal method on the published single gyre (paper: 96.08)."""
    chart, current = single_gyre()

    def best(**options: object) -> renew.Route:
        return renew.plan(chart, current, PAPER_VESSEL, START, GOAL, **options).best  # type: ignore[arg-type]

    bare = best(padding="none")
    yield at_most("single gyre, no padding: fuel", bare.fuel, 84.8)
    yield at_most("single gyre, no padding: optimality gap", 100 * bare.optimality_gap, 3, " %")
    route = best(padding="none", clearance=12.55)
    yield at_most("single gyre, clearance 12.55 m: fuel", route.fuel, 89.6)
    route = best()
    yield at_most("single gyre, adaptive, risk 0.05: fuel", route.fuel, 88.5)
    yield _contingency("single gyre, adaptive", route, chart, current)


def _contingency(
    name: str, route: renew.Route, chart: renew.Chart, current: renew.CurrentField
) -> Figure:
    """Collisions of hard-over turns, over ten seeds of the draws."""
    reports = [renew.contingency(route, chart, current, PAPER_VESSEL, seed=s) for s in range(10)]
    collisions, trials = sum(r.collisions for r in reports), sum(r.trials for r in reports)
    return Figure(
        f"{name}: contingency collisions", "0", f"{collisions} of {trials}", collisions == 0
    )


def _sampled() -> Iterator[Figure]:
    """The paper's own method: ten seeds."""
    chart, current = single_gyre()
    routes = [
        renew.plan(
            chart, current, PAPER_VESSEL, START, GOAL, method="sampled", samples=500, seed=seed
        ).best
        for seed in range(10)
    ]
    fuel = statistics.median(route.fuel for route in routes)
    yield at_most("single gyre, sampled, median fuel of ten seeds", fuel, 110)
    collisions = sum(
        renew.contingency(route, chart, current, PAPER_VESSEL).collisions for route in routes
    )
    yield at_most("single gyre, sampled: contingency collisions", collisions, 0, digits=0)


def _times() -> Iterator[Figure]:
    """Time of a plan, warm, and as a ratio to the sampled method in the same run."""
    chart, current = single_gyre()
    scene, stream, start, goal = random_scene(0)
    for name, limit, run in (
        (
            "single gyre, k = 16",
            50,
            lambda method: renew.plan(chart, current, PAPER_VESSEL, START, GOAL, method=method),
        ),
        (
            "7 islands, k = 16",
            200,
            lambda method: renew.plan(scene, stream, PAPER_VESSEL, start, goal, method=method),
        ),
    ):
        optimal, sampled = _fastest(run, "optimal"), _fastest(run, "sampled")
        yield at_most(f"{name}: time of the optimal method", 1e3 * optimal, limit, " ms", 0)
        yield Figure(
            f"{name}: time as a ratio to the sampled method",
            "",
            f"{optimal / sampled:.2f}",
        )


def _fastest(run: Callable[[str], renew.Plan], method: str, times: int = 5) -> float:
    """Least time (s) of some runs after a warm-up: what the code takes on a quiet machine."""
    run(method)
    taken = []
    for _ in range(times):
        begin = time.perf_counter()
        run(method)
        taken.append(time.perf_counter() - begin)
    return min(taken)
