"""The months of a voyage."""

from __future__ import annotations

import calendar
from datetime import date

import pytest
from hypothesis import given, strategies as st

from pipeline.errors import RequestError
from pipeline.scenario.season import period
from pipeline.voyage.times import read_months

months = st.dates(max_value=date(9998, 12, 31)).map(lambda day: f"{day:%Y-%m}".zfill(7))


@given(st.lists(months, unique=True, max_size=4))
def test_months_keep_their_order_and_are_periods(texts: list[str]) -> None:
    titles = read_months(texts)
    assert list(titles) == texts
    for text, title in titles.items():
        begin = period(text).begin
        assert (begin.day, begin.hour) == (1, 0)
        assert title.split()[0] == calendar.month_name[begin.month]


def test_two_months_have_readable_titles() -> None:
    assert read_months(["2024-12", "2024-07"]) == {
        "2024-12": "December 2024",
        "2024-07": "July 2024",
    }


def test_every_fault_is_reported() -> None:
    with pytest.raises(RequestError) as caught:
        read_months(["2024-13", "July", "2024-07", "2024-07", "2024-07-01"])
    assert len(caught.value.faults) == 4
