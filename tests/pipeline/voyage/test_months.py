"""The months of a voyage."""

from __future__ import annotations

from datetime import date

import pytest
from hypothesis import given, strategies as st

from pipeline.scenario.season import period
from pipeline.voyage.quantities import read_months

months = st.dates(max_value=date(9998, 12, 31)).map(lambda day: f"{day:%Y-%m}".zfill(7))


@given(st.lists(months, unique=True, max_size=4))
def test_months_keep_their_order_and_are_periods(texts: list[str]) -> None:
    assert list(read_months(texts)) == texts
    for text in texts:
        begin = period(text).begin
        assert (begin.day, begin.hour) == (1, 0)


def test_every_fault_is_reported() -> None:
    with pytest.raises(ValueError, match="2024-13") as caught:
        read_months(["2024-13", "July", "2024-07", "2024-07", "2024-07-01"])
    assert len(caught.value.args) == 4
