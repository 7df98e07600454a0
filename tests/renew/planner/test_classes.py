"""Classes planned one after the other: routes, and the rejected ones with their reasons."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from shapely import box

import renew
from tests.strategies import PAPER_VESSEL, single_gyre

STILL = renew.UniformCurrent(0.0, 0.0)
# A strait of 6 m between two walls; the way round leads past the end of one of them.
NARROW = [box(0, 45, 47, 55), box(53, 45, 90, 55)]
START, GOAL = (50.0, 10.0), (50.0, 90.0)


def test_a_blocked_class_names_its_strait_and_its_cost() -> None:
    chart = renew.Chart(box(0, 0, 100, 100), NARROW)
    plan = renew.plan(chart, STILL, PAPER_VESSEL, START, GOAL, padding=3.2)
    [rejected] = plan.rejected
    strait = rejected.strait
    assert strait is not None
    assert strait.width == pytest.approx(6)
    assert (strait.padding_left, strait.padding_right) == pytest.approx((3.2, 3.2))
    assert np.sort(strait.gap[:, 0]) == pytest.approx([47, 53])
    assert "triangle" not in rejected.reason
    assert rejected.reason.startswith("blocked at (50, 45) m, between (")
    assert "the gap is 6.00 m wide, and the padding takes 3.20 m on the left" in rejected.reason
    # A caller who knows longitude and latitude can spell the places in them.
    assert rejected.located_reason(lambda place: f"<{place[0]:g}>").startswith("blocked at <50>")
    # The strait would be the short way: 80 m. The way round costs more because of the padding.
    assert rejected.unpadded_fuel == pytest.approx(80, rel=1e-3)
    assert plan.best.fuel > 100
    again = pickle.loads(pickle.dumps(rejected))  # noqa: S301  (our own bytes)
    assert again.unpadded_fuel == rejected.unpadded_fuel
    assert again.reason == rejected.reason
    assert again.located_reason(str) == rejected.located_reason(str)


def test_classes_blocked_by_the_padding_of_others_are_planned_for_themselves() -> None:
    chart, gyre = single_gyre()
    plan = renew.plan(chart, gyre, PAPER_VESSEL, (10, 10), (90, 90))
    bare = renew.plan(chart, gyre, PAPER_VESSEL, (10, 10), (90, 90), padding="none")
    known = {r.homotopy for r in plan.routes} | {r.homotopy for r in plan.rejected}
    assert known == {r.homotopy for r in bare.routes}
    assert all(math.isfinite(r.unpadded_fuel) for r in plan.rejected)


def test_routes_come_by_fuel_and_a_class_is_either_planned_or_rejected() -> None:
    chart, gyre = single_gyre()
    plan = renew.plan(chart, gyre, PAPER_VESSEL, (10, 10), (90, 90))
    fuels = [route.fuel for route in plan.routes]
    assert fuels == sorted(fuels)
    names = [route.homotopy for route in plan.routes]
    names += [rejected.homotopy for rejected in plan.rejected]
    assert len(names) == len(set(names))
    few = renew.plan(chart, gyre, PAPER_VESSEL, (10, 10), (90, 90), classes=2)
    assert len(few.routes) == 2
