"""What a night takes, as its page reckons it."""

import re

import pytest

from tests.bench import night_plans
from tests.conftest import ROOT

PAGE = (ROOT / "docs" / "how-to" / "nightly.md").read_text("utf-8")


@pytest.mark.parametrize(
    ("mark", "table"),
    [("reckoned", night_plans.table()), ("machines", night_plans.machines_table())],
)
def test_the_page_has_the_tables_as_they_are_reckoned(mark: str, table: str) -> None:
    found = re.search(rf"<!-- {mark} -->\n(.*?)<!-- /{mark} -->", PAGE, re.DOTALL)
    assert found is not None
    assert found[1] == table, "run `python -m tests.bench.night_plans` and put its tables there"


@pytest.mark.parametrize("case", night_plans.CASES)
def test_the_cores_reckoned_make_the_plans_in_time(case: night_plans.Case) -> None:
    number = night_plans.cores(case)
    assert night_plans.hours(case, number) <= night_plans.HOURS
    if number > 1:
        assert night_plans.hours(case, number - 1) > night_plans.HOURS


def test_commands_on_the_page_ask_for_the_cores_reckoned() -> None:
    number = night_plans.cores(night_plans.PALAWAN)
    assert f"--replicas={number}\n" in PAGE
    assert f"--ntasks={number} " in PAGE
