"""Figures of small eddies, thin walls and the order of classes, beside an independent oracle."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import replace

import shapely

import renew
from tests.bench.figure import Figure, at_most
from tests.eddies import SCENES, eddy_scene, walls
from tests.strategies import PAPER_VESSEL, random_scene

WALLS = 10
"""Number of scenes of each kind of thin wall."""

ISLANDS = range(3, 16)
"""Numbers of islands of the scenes in which the order of classes is looked at."""


def eddies() -> Iterator[Figure]:
    """The best route over the oracle's, hard-over turns, and the optimality gap."""
    ratios, gaps, collisions, trials = [], [], 0, 0
    for spec in SCENES:
        scene = eddy_scene(*spec)
        least, _ = scene.oracle()
        best = scene.plan(padding="none").best
        ratios.append(best.fuel / least)
        gaps.append(best.optimality_gap)
        route = scene.plan(classes=4).best
        report = renew.contingency(route, scene.chart, scene.current, PAPER_VESSEL)
        collisions, trials = collisions + report.collisions, trials + report.trials
    name = f"{len(SCENES)} scenes of small eddies, no padding"
    yield at_most(f"{name}: dearest beside the oracle", max(ratios), 1.001, digits=5)
    yield at_most(f"{name}: median", statistics.median(ratios), 1.0003, digits=5)
    yield at_most(f"{name}: median gap", 100 * statistics.median(gaps), 3, " %")
    text = f"{collisions} of {trials}"
    yield Figure("small eddies, adaptive: collisions", "0", text, collisions == 0)


def padded_eddies() -> Iterator[Figure]:
    """The best route with adaptive padding over an oracle that keeps out of the route's own V."""
    ratios = []
    for spec in SCENES:
        scene = eddy_scene(*spec)
        route = scene.plan(classes=4).best
        barred = shapely.get_parts(shapely.union_all([scene.chart.hard_no_go, route.soft_no_go]))
        inside = shapely.intersects(barred, shapely.points([scene.start, scene.goal])[:, None])
        if inside.any():
            # The oracle can't begin in V.
            continue
        water = replace(scene, chart=renew.Chart(scene.chart.extent, barred.tolist()))
        least, _ = water.oracle()
        ratios.append(route.fuel / least)
    name = f"{len(ratios)} scenes of small eddies, adaptive, beside an oracle out of the route's V"
    yield at_most(f"{name}: dearest", max(ratios), 1.001, digits=5)
    yield at_most(f"{name}: median", statistics.median(ratios), 1.0003, digits=5)


def thin_walls() -> Iterator[Figure]:
    """Serpentines, combs, spirals and bays: a route wherever the oracle has one."""
    for kind in ("serpentine", "comb", "spiral", "bay"):
        ratios, lost = [], 0
        for seed in range(WALLS):
            scene = walls(kind, seed)
            least, _ = scene.oracle()
            try:
                ratios.append(scene.plan(padding="none").best.fuel / least)
            except renew.UnreachableError:
                lost += 1
        yield at_most(f"{kind}: scenes without a route", lost, 0, digits=0)
        yield at_most(f"{kind}: dearest beside an unrounded oracle", max(ratios), 1.015, digits=4)


def order() -> Iterator[Figure]:
    """How often the best class is among the first four."""
    found, worst, count = 0, 1.0, 0
    for seed in range(110):
        scene = random_scene(seed, islands=ISLANDS[seed % len(ISLANDS)])
        four, many = (scene.plan(padding="none", classes=k).best for k in (4, 32))
        count += 1
        found += four.fuel <= many.fuel * (1 + 1e-3)
        worst = max(worst, four.fuel / many.fuel)
    text = f"{100 * found / count:.1f} % (worst {worst:.4f})"
    yield Figure("best class among the first 4, 110 scenes", "99 %", text, found / count >= 0.99)
