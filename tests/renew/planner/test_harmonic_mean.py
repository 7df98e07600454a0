"""The paper's choice of a class by the harmonic mean of its sampled fuel."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given, strategies as st

import renew
from renew.planner.sampled_paths import chosen_class, harmonic_mean
from tests.strategies import PAPER_VESSEL, random_scene


@given(st.lists(st.floats(0.1, 1e6), min_size=1, max_size=20))
def test_it_is_that_of_the_standard_library(fuels: list[float]) -> None:
    assert harmonic_mean(np.array(fuels)) == pytest.approx(statistics.harmonic_mean(fuels))


def test_a_path_that_cannot_be_made_counts_as_infinite_fuel() -> None:
    assert harmonic_mean(np.array([10.0, np.inf])) == pytest.approx(20)


def test_the_class_with_the_least_mean_is_chosen() -> None:
    routes = [SimpleNamespace(harmonic_mean=mean) for mean in (5.0, 3.0, 4.0)]
    assert chosen_class(cast("Sequence[renew.Route]", routes)) == 1


def test_the_sampled_method_may_choose_another_class_than_that_of_the_cheapest_path() -> None:
    chart, current, start, goal = random_scene(2)
    plan = renew.plan(
        chart, current, PAPER_VESSEL, start, goal, padding="none", method="sampled", samples=60
    )
    means = [route.harmonic_mean for route in plan.routes]
    assert plan.best.harmonic_mean == min(means)
    assert all(route.harmonic_mean >= route.fuel for route in plan.routes)
