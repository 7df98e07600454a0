"""The cost estimate of a million plans on its page."""

from __future__ import annotations

import re

import pytest

from tests.bench import million_plans
from tests.conftest import ROOT

PAGE = (ROOT / "docs" / "how-to" / "nightly.md").read_text("utf-8")


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
