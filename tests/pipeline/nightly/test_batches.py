"""Batches: cut by measured time, halved where a worker dies, until one case is left."""

from __future__ import annotations

import random
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from pipeline.nightly.planning import BatchWork


def work(
    charts: list[list[tuple[int, int]]], seconds: float, kills: Callable[[int], bool]
) -> tuple[list[tuple[int, int]], list[int], int]:
    """Do all batches on four workers; return those done, the broken cases, and the deaths."""
    broken: list[int] = []
    reports: list[Any] = []
    batches = BatchWork(
        charts,
        lambda first, end: SimpleNamespace(first=first, end=end),  # type: ignore[arg-type, return-value]
        broken.append,
        lambda batch, rows, took: reports.append(batch),  # noqa: ARG005 - as it is called
    )
    deaths = 0
    while (task := batches.next_task(4)) is not None:
        if any(kills(index) for index in range(task.first, task.end)):
            deaths += 1
            batches.died(task, "killed")
        else:
            took = seconds * (task.end - task.first)
            batches.done(task, ([], took))
    return [(one.first, one.end) for one in reports], broken, deaths


def covered(done: list[tuple[int, int]], broken: list[int]) -> list[int]:
    """Return all cases, each as often as it was done."""
    return sorted([i for first, end in done for i in range(first, end)] + broken)


def test_every_case_is_done_once_whatever_kills() -> None:
    rng = random.Random(1)  # noqa: S311 - a test's seed
    for _ in range(50):
        count = rng.randint(1, 400)
        killers = set(rng.sample(range(count), min(count, rng.randint(0, 5))))
        middle = rng.randint(0, count)
        charts = [[(0, middle)] * bool(middle), [(middle, count)] * (middle < count)]
        done, broken, _ = work(charts, rng.uniform(0.001, 20), killers.__contains__)
        assert covered(done, broken) == list(range(count))
        assert set(broken) == killers


def test_one_killer_in_a_thousand_costs_few_workers() -> None:
    done, broken, deaths = work([[(0, 1000)]], 1.0, {617}.__contains__)
    assert (len(covered(done, broken)), broken) == (1000, [617])
    assert deaths <= 8  # halves of 40 cases, and one more try of the last


def test_batches_are_20_to_60_seconds_long_but_for_the_first_and_the_last() -> None:
    done, _, _ = work([[(0, 100_000)]], 0.1, lambda _: False)
    sizes = [0.1 * (end - first) for first, end in done]
    lasting = sizes[1 : next(i for i, (_, end) in enumerate(done) if end > 100_000 - 6_400)]
    assert lasting
    assert all(20 <= size <= 60 for size in lasting)
    assert len(done) < 400


def test_a_job_that_is_killed_half_way_was_at_little() -> None:
    """However short the night is, only the batches that its four workers have begun are lost."""
    for count in (200, 2_000, 20_000):
        done, _, _ = work([[(0, count)]], 0.3, lambda _: False)
        at_half = [end - first for first, end in done if first <= count / 2 < end]
        assert 4 * sum(at_half) / 2 <= max(0.05 * count, 4 * 2.0 / 0.3)


def test_what_is_unknown_begins_with_one_case() -> None:
    first: list[Any] = []
    batches = BatchWork(
        [[(0, 100)]],
        lambda begin, end: first.append((begin, end)),  # type: ignore[arg-type, return-value]
        lambda _: None,
        lambda *_: None,
    )
    batches.next_task(2)
    assert first == [(0, 1)]
