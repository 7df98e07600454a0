"""Steps of a plan: what a watcher is told while it is at work, and that nobody else is."""

from __future__ import annotations

import numpy as np
from shapely import box

import renew
from renew.watching import Step, watched

CHART = renew.Chart(box(0, 0, 100, 100), [box(40, 30, 60, 70)])
CURRENT = renew.UniformCurrent(0.2, 0.1)
VESSEL = renew.Vessel(speed=1.0, turn_rate=0.6, length=2.0)


def plan() -> renew.Plan:
    return renew.plan(CHART, CURRENT, VESSEL, (10, 50), (90, 50))


def test_every_route_was_told_as_a_path_after_its_class_was_begun() -> None:
    steps: list[Step] = []
    with watched(steps.append):
        watched_plan = plan()
    assert steps[0].kind == "class"
    told = [step.path for step in steps if step.path is not None]
    for route in watched_plan.routes:
        assert any(np.array_equal(path, route.path) for path in told)
    assert all((step.path is not None) == (step.kind == "path") for step in steps)


def test_watching_changes_nothing_and_ends_with_its_block() -> None:
    steps: list[Step] = []
    with watched(steps.append):
        with watched(None):
            unseen = plan()
        assert steps == []
        seen = plan()
    count = len(steps)
    again = plan()
    assert len(steps) == count
    for one, other in ((unseen, seen), (seen, again)):
        assert [route.fuel for route in one.routes] == [route.fuel for route in other.routes]
