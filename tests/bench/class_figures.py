"""Each class beside the oracle's path of that class, the first classes, small eddies and walls."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import replace
from unittest import mock

import shapely

import renew
from renew._types import FloatArray
from renew.classes.h_signature import Rays, name
from renew.paths.corridor import Corridor
from renew.planner.one_class import ClassPlanner
from tests.bench.figure import Figure, at_most
from tests.bounded_scenes import SCENES, eddy_scene, walls
from tests.class_oracle import paths_by_class
from tests.strategies import PAPER_VESSEL, SIZE, random_scene

CLASSES, FIRST = 8, 16
"""Classes of a scene that are compared, and number of first ones that are looked for."""
LABELS, MORE_LABELS = 16, 24
"""Classes that the oracle follows: those that wind about islands are among them."""
CELLS, MORE_CELLS = 80, 100
"""Cells a side of the oracle's grid, for its paths of each class, and for the first classes."""


def each_class() -> Iterator[Figure]:
    """Fuel over the oracle's in the same class, before and after corners are rounded."""
    before, after, missing = [], [], 0
    for spec in SCENES:
        if spec[2] < 3:
            continue
        scene = eddy_scene(*spec)
        unrounded, plan = _planned(*spec)
        found = paths_by_class(*scene.asked, spec[3] / CELLS, labels=LABELS)
        least = _least(scene.chart, found)
        for route in plan.routes:
            if route.homotopy not in least:
                missing += 1
                continue
            after.append(route.fuel / least[route.homotopy])
            before.append(unrounded[route.homotopy] / least[route.homotopy])
    title = f"{len(after)} classes of scenes of small eddies beside the oracle's"
    yield at_most(f"{title}, before rounding: dearest", max(before), 1.002, digits=5)
    yield at_most(f"{title}, before rounding: median", statistics.median(before), 1.0005, digits=5)
    share = sum(ratio > 1.002 for ratio in before)
    yield Figure(f"{title}, before rounding: above 1.002", "0", str(share), share == 0)
    yield Figure(f"{title}, rounded: dearest", "", f"{max(after):.5f}")
    yield Figure(f"{title}, rounded: median", "", f"{statistics.median(after):.5f}")
    yield Figure("classes that the oracle doesn't follow", "", str(missing))


def first_classes() -> Iterator[Figure]:
    """How many of the true first classes are among the first that are planned.

    The oracle's grid can't pass the narrowest straits: a class that only the planner finds is as
    true as its fuel, and is counted for itself.
    """
    for islands in (7, 25, 50):
        shared, unseen = [], []
        for seed in range(3):
            scene = random_scene(seed, islands=islands)
            found = paths_by_class(*scene.asked, SIZE / MORE_CELLS, labels=MORE_LABELS)
            least = _least(scene.chart, found)
            plan = scene.plan(padding="none", classes=FIRST)
            ours = {route.homotopy: route.fuel for route in plan.routes}
            both = ours | least
            true = sorted(both, key=lambda one: both[one])[:FIRST]
            shared.append(sum(one in ours for one in true))
            unseen.append(sum(one not in least for one in true))
        text = (
            f"{', '.join(map(str, shared))} (unseen by the oracle: {', '.join(map(str, unseen))})"
        )
        asked = "at least 14" if islands > 7 else ""
        is_met = min(shared) >= 14 if asked else None
        yield Figure(f"of the true first {FIRST} classes, {islands} islands", asked, text, is_met)


def _least(chart: renew.Chart, found: list[tuple[float, FloatArray]]) -> dict[str, float]:
    """Fuel by the name of the class, from fuels in ascending order and paths (n, 2)."""
    rays = Rays.of(chart)
    least: dict[str, float] = {}
    for fuel, path in found:
        least.setdefault(name(rays.word(path)), fuel)
    return least


def _planned(
    seed: int, waves: int, islands: int, side: float
) -> tuple[dict[str, float], renew.Plan]:
    """Least fuel by class before corners were rounded, and the plan."""
    least: dict[str, float] = {}
    steered = ClassPlanner._steered

    def noted(
        planner: ClassPlanner, corridor: Corridor, used: Corridor, path: FloatArray
    ) -> object:
        found = steered(planner, corridor, used, path)
        fuel, key = planner.problem.voyage.fuel(path), corridor.channel.name
        least[key] = min(fuel, least.get(key, fuel))
        return found

    with mock.patch.object(ClassPlanner, "_steered", noted):
        plan = eddy_scene(seed, waves, islands, side).plan(padding="none", classes=CLASSES)
    return least, plan


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
