"""Figures of plans under way: time, the same way ahead, and simulated voyages in forecasts."""

from __future__ import annotations

import statistics
from collections.abc import Iterator

import renew
from pipeline.scenario.loading import load_scenario
from tests.bench import cover_figures
from tests.bench.clock import warm
from tests.bench.figure import Figure, at_most, quoted
from tests.bench.palawan_figures import cases_of, fetched_data
from tests.strategies import single_gyre
from tests.under_way import Outcome, Waters, replanned, sailed

VOYAGES = 100
"""Number of simulated voyages."""


def figures(*, is_whole: bool = False) -> Iterator[Figure]:
    """Yield figures of havens, times of a plan under way, and what simulated voyages came to."""
    yield from cover_figures.figures(is_whole=is_whole)
    gyre = single_gyre().plan()
    yield from _replanned("single gyre", gyre, renew.GyreCurrent(0.75, 100, 100), 50.0)
    scenario = load_scenario("palawan-usv")
    (scene, other), options = cases_of(scenario, fetched_data(scenario)), scenario.planner
    summer, winter = scene.current, other.current
    palawan = renew.plan(
        scene.chart,
        summer,
        scene.vessel,
        scene.start,
        scene.goal,
        classes=options.classes,
        distinct_by=options.distinct_by,
    )
    yield from _replanned("Palawan", palawan, winter, 1500.0)
    yield from cover_figures.palawan(palawan, scene.chart, scene.vessel)
    yield from _voyages()


def _replanned(
    name: str, plan: renew.Plan, newer: renew.CurrentField, limit_ms: float
) -> Iterator[Figure]:
    """Yield the time of a plan that keeps its class, from a third of the way on, and its fuel."""
    route = plan.best
    at = len(route.path) // 3
    place, time = route.path[at], float(route.times[at])
    heading = float(route.trajectory[route.trajectory[:, 0].searchsorted(time), 3])
    took, found = warm(lambda: renew.replan(plan, place, time, heading=heading, current=newer))
    key = name.lower().replace(" ", "_")
    took_ms = 1e3 * took.cpu
    yield at_most(f"{name}: replanned in another current", took_ms, limit_ms, " ms", 0, f"{key}_ms")
    kept = Figure(f"{name}: its class", "kept", found.answer, found.answer == "kept")
    yield kept
    same = renew.replan(plan, place, time)
    ahead = route.fuel * float((route.times[-1] - time) / (route.times[-1] - route.times[0]))
    off = abs(same.fuel / ahead - 1)
    text = f"{off:.1e}"
    yield Figure(f"{name}: the same way ahead, fuel off by", "<= 1e-6", text, off <= 1e-6)


def _voyages() -> Iterator[Figure]:
    """Yield what simulated voyages came to that are planned again in each forecast."""
    outcomes: list[Outcome] = []
    clairvoyant: list[float] = []
    cheaper = 0
    for seed in range(VOYAGES):
        sea = Waters.of(seed)
        plan = sea.plan(sea.forecast(0.0))
        again = replanned(sea, plan)
        outcomes.append(again)
        clairvoyant.append(again.arrival / sailed(sea, sea.plan(sea.truth)).arrival)
        cheaper += again.arrival <= sailed(sea, plan).arrival
    least = 0.9 * VOYAGES
    name = f"{VOYAGES} simulated voyages, planned again in each forecast"
    stranded = sum(one.stranded for one in outcomes)
    yield Figure(f"{name}: stranded", "0", f"{stranded}", stranded == 0)
    switches = statistics.median(one.switches for one in outcomes)
    yield at_most(f"{name}: median number of switches", switches, 1, digits=0)
    above = statistics.median(clairvoyant)
    yield at_most(f"{name}: median fuel by the clairvoyant's", above, 1.02, digits=4, key="fuel")
    values = {"cheaper": float(cheaper)}
    yield Figure(
        f"{name}: no dearer than never", f">= {least:.0f}", f"{cheaper}", cheaper >= least, values
    )
    without = sum(one.without_way for one in outcomes)
    yield quoted(f"{name}: answers without a way", without=without)
