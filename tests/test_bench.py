"""Times over commits, and the cost estimate of a million plans on its page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.bench import history, million_plans
from tests.bench.figure import at_most
from tests.bench.history import Time


def times(*seconds: float, machine: str = "A", figure: str = "plan") -> list[Time]:
    return [Time("2026-11-24", f"{i:07x}", machine, figure, s, 0.5) for i, s in enumerate(seconds)]


def test_times_are_appended_and_read_again(tmp_path: Path) -> None:
    file = tmp_path / "bench.csv"
    first, then = times(1.25, 0.5), times(2.0, machine="B, with a comma")
    history.save(first, file)
    history.save(then, file)
    assert history.saved(file) == [*first, *then]


def test_a_time_has_its_commit_and_a_machine_without_its_name() -> None:
    now = history.now("plan", 1.0, 0.5)
    assert re.fullmatch(r"[0-9a-f]{7,}\+?", now.commit)
    assert re.fullmatch(r".+, \d+ cores?", now.machine)


def test_only_figures_that_are_times_have_seconds() -> None:
    units = {" s": 250.0, " ms": 0.25, " %": None, " GB": None, "": None}
    assert {unit: at_most("one", 250.0, 1.0, unit).seconds for unit in units} == units


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(1.29, ""), (1.31, "1.31 s, 2.62 times a fixed loop, is 1.31 times the median of the last 5")],
)
def test_a_run_slower_than_the_median_of_the_last_five_is_named(seconds: float, said: str) -> None:
    before = times(9.0, 9.0, 9.0, 0.5, 0.6, 1.0, 1.1, 5.0)
    noise = [*times(0.1, machine="B"), *times(0.1, figure="start")]
    (now,) = times(seconds)
    sentence = history.slower(now, [*before, *noise])
    assert bool(sentence) == bool(said)
    assert said in sentence


def test_times_are_compared_as_multiples_of_the_loop() -> None:
    (now,) = times(2.0)
    assert history.slower(now, times(1.0))
    assert not history.slower(now._replace(loop_s=1.0), times(1.0))


def test_the_loop_takes_a_time_that_can_be_compared() -> None:
    assert 0.05 < history.loop_s() < 5.0


def test_a_new_machine_gets_no_note() -> None:
    (now,) = times(99.0)
    assert history.slower(now, times(1.0, machine="B")) == ""


def test_the_picture_is_that_of_the_times(tmp_path: Path) -> None:
    """If not: `python -m tests.bench --save` draws it."""
    drawn = tmp_path / "bench.svg"
    history.draw(history.saved(), drawn)
    new, kept = (file.read_text("utf-8") for file in (drawn, history.PICTURE))
    assert texts(new) == texts(kept)
    assert {time.figure for time in history.saved()} <= set(texts(kept))


def texts(svg: str) -> list[str]:
    return sorted(re.findall(r"<text[^>]*>([^<]*)</text>", svg))


PAGE = (Path(__file__).resolve().parent.parent / "docs" / "how-to" / "nightly.md").read_text(
    "utf-8"
)


@pytest.mark.parametrize(
    ("mark", "table"),
    [("reckoned", million_plans.table()), ("machines", million_plans.machines_table())],
)
def test_the_page_has_the_tables_as_they_are_reckoned(mark: str, table: str) -> None:
    found = re.search(rf"<!-- {mark} -->\n(.*?)<!-- /{mark} -->", PAGE, re.DOTALL)
    assert found is not None
    assert found[1] == table, "run `python -m tests.bench.million_plans` and put its tables there"


@pytest.mark.parametrize("case", million_plans.CASES)
def test_the_cores_reckoned_make_the_plans_in_time(case: million_plans.Case) -> None:
    number = million_plans.cores(case)
    assert million_plans.plans_a_night(case, number) >= million_plans.PLANS
    assert million_plans.plans_a_night(case, number - 1) < million_plans.PLANS


def test_commands_on_the_page_ask_for_the_cores_reckoned() -> None:
    number = million_plans.cores(million_plans.PALAWAN)
    assert f"--replicas={number}\n" in PAGE
    assert f"--ntasks={number} " in PAGE
