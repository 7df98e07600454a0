"""Batches: cut by measured time, halved where a worker dies, until one case is left."""

import random
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from pipeline.nightly.planning import BatchWork
from pipeline.nightly.worker import PlanBatch


def batch(cases: Sequence[Any]) -> PlanBatch:
    """Return a batch; only its length and its cases' indices matter here."""
    return PlanBatch(tuple(cases), Path(f"chart {cases[0].chart}"), 3.0, "")


def work(
    charts: list[range], seconds: float, kills: Callable[[int], bool]
) -> tuple[list[list[int]], list[int], int]:
    """Do all batches on four workers; return those done, the broken cases, and the deaths."""
    broken: list[int] = []
    done: list[list[int]] = []
    batches = BatchWork(
        {
            Path(f"chart {at}"): [SimpleNamespace(index=i, chart=at) for i in chart]  # type: ignore[misc]
            for at, chart in enumerate(charts)
        },
        batch,
        lambda case: broken.append(case.index),
        lambda rows: done.append([row["index"] for row in rows]),
    )
    deaths = 0
    while (task := batches.next_task(4)) is not None:
        if any(kills(case.index) for case in task.cases):
            deaths += 1
            batches.died(task, "killed")
        else:
            batches.done(task, [{"index": case.index, "seconds": seconds} for case in task.cases])
    return done, broken, deaths


def covered(done: list[list[int]], broken: list[int]) -> list[int]:
    """Return all cases, each as often as it was done."""
    return sorted([*(index for indices in done for index in indices), *broken])


def test_every_case_is_done_once_whatever_kills() -> None:
    rng = random.Random(1)  # noqa: S311 - a test's seed
    for _ in range(50):
        count = rng.randint(1, 400)
        killers = set(rng.sample(range(count), min(count, rng.randint(0, 5))))
        middle = rng.randint(0, count)
        charts = [range(middle), range(middle, count)]
        done, broken, _ = work(charts, rng.uniform(0.001, 20), killers.__contains__)
        assert covered(done, broken) == list(range(count))
        assert set(broken) == killers


def test_one_killer_in_a_thousand_costs_few_workers() -> None:
    done, broken, deaths = work([range(1000)], 1.0, {617}.__contains__)
    assert (len(covered(done, broken)), broken) == (1000, [617])
    assert deaths <= 8  # halves of 40 cases, and one more try of the last


def test_batches_are_20_to_60_seconds_long_but_for_the_first_and_the_last() -> None:
    done, _, _ = work([range(100_000)], 0.1, lambda _: False)
    lasting = [0.1 * len(indices) for indices in done[1:] if indices[-1] < 100_000 - 6_400]
    assert lasting
    assert all(20 <= size <= 60 for size in lasting)
    assert len(done) < 400


def test_a_job_that_is_killed_half_way_was_at_little() -> None:
    """However short the night is, only the batches that its four workers have begun are lost."""
    for count in (200, 2_000, 20_000):
        done, _, _ = work([range(count)], 0.3, lambda _: False)
        at_half = [len(indices) for indices in done if indices[0] <= count / 2 <= indices[-1]]
        assert 4 * sum(at_half) / 2 <= max(0.05 * count, 4 * 2.0 / 0.3)


def test_what_is_unknown_begins_with_one_case() -> None:
    done, _, _ = work([range(100)], 1.0, lambda _: False)
    assert done[0] == [0]
    assert len(done[1]) > 1
