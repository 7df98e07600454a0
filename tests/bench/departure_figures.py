"""Figures of when to leave: order of arrivals, plans that a proof takes, and time beside plans."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from shapely import box

import renew
from tests.bench.figure import Figure, at_most
from tests.moving_waters import MovingScene, moving_scene
from tests.strategies import PAPER_VESSEL

SWEPT = 48
"""Number of departures that are planned at once, and one by one."""

PAIRS = 1000
"""Number of pairs of departures, each beside the next, whose arrivals are compared."""

PROVEN = (2, 4, 7)
"""Seeds of the scenes whose choice is proven in a window of 240 tolerances."""

# Scene whose departures are planned one by one as well; window (s); departures a tolerance apart.
_SEED, _WINDOW_S, _TOLERANCES = 7, 600.0, 240
# Share of the window at which pairs stand, of departures two seconds apart and closer.
_PAIRS_S = 200.0


def figures() -> Iterator[Figure]:
    """Order, proof and time of departures."""
    yield from swept()
    yield from proven()
    yield from ordered()


def swept() -> Iterator[Figure]:
    """CPU time of departures planned at once beside that of as many plans, and the fuel of both."""
    scene = moving_scene(_SEED)
    given = np.linspace(0.0, _WINDOW_S, SWEPT)
    scene.plan_departures(given[:2])
    begin = time.process_time()
    found = scene.plan_departures(given)
    at_once = time.process_time() - begin
    scene.plan(departure=0.0)
    begin = time.process_time()
    single = np.array([scene.plan(departure=t).best.fuel for t in given.tolist()])
    one_by_one = time.process_time() - begin
    name = f"{SWEPT} departures beside as many plans"
    yield at_most(f"{name}, CPU", at_once / one_by_one, 0.5)
    yield at_most(f"{name}, dearest", float((found.fuels / single).max()), 1.001, digits=5)


def proven() -> Iterator[Figure]:
    """Number of plans that prove the best of a window to a tolerance, the most of some scenes."""
    counts, worst = [], 0.0
    for seed in PROVEN:
        scene = moving_scene(seed)
        counts.append(_plans(scene, _WINDOW_S / _TOLERANCES))
        worst = max(worst, counts[-1])
    # Where all departures are alike the proof takes the most plans.
    chart = renew.Chart(box(0, 0, 200, 60))
    uniform = renew.UniformCurrent(0.1, 0.0)
    alike = 0

    def count(plans: int, unproven: float) -> None:
        nonlocal alike
        if unproven > _WINDOW_S / _TOLERANCES * (1 + 1e-5):
            alike = plans

    renew.plan_departures(
        chart,
        uniform,
        PAPER_VESSEL,
        (20, 30),
        (180, 30),
        np.linspace(0.0, _WINDOW_S, 5),
        to_within=_WINDOW_S / _TOLERANCES,
        progress=count,
    )
    text = ", ".join(map(str, counts))
    yield at_most(
        f"plans that prove the best of {_TOLERANCES} tolerances ({text}; all alike {alike + 1})",
        max(worst, alike + 1),
        _TOLERANCES,
        digits=0,
    )


def _plans(scene: MovingScene, tolerance: float) -> int:
    """Number of plans after which the best departure is proven."""
    proven = 0

    def count(plans: int, unproven: float) -> None:
        nonlocal proven
        if unproven > tolerance * (1 + 1e-5):
            proven = plans

    scene.plan_departures(
        np.linspace(0.0, _WINDOW_S, 5),
        to_within=tolerance,
        padding="none",
        classes=4,
        progress=count,
    )
    return proven + 1


def ordered() -> Iterator[Figure]:
    """Largest time by which a later departure arrives earlier."""
    scene = moving_scene(_SEED)
    found = scene.plan_departures(np.linspace(0.0, _PAIRS_S, PAIRS + 1))
    back = float(-np.diff(found.arrivals).min())
    yield at_most(f"{PAIRS} pairs of departures: largest step back, s", max(back, 0.0), 1e-6)
